/* SPDX-License-Identifier: Apache-2.0 */
/* Feed hold, feed override, and going on after a fault that has stopped the axes on their path; over the wire. */
#include "drive_rig.h"

enum { SHUTDOWN = 0x06, SWITCH_ON = 0x07, ENABLE = 0x0F, RUN = 0x1F, HALT = 0x11F, FAULT_RESET = 0x80 };
enum { TARGET_REACHED = 10, IP_ACTIVE = 12 };
enum { IDLE, FILLING, RUNNING, STOPPING, DONE, STOPPED };
enum { RESUME = 3 };

#define ABORT_STATE 0x08000022u
#define ABORT_TOO_HIGH 0x06090031u

static struct rig rig;
static struct rig_stream line;

void setUp(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    line = (struct rig_stream){.count = 800, .length_nm = 40e6}; /* 100 mm/s at most, all of it in the queue */
}

void tearDown(void)
{
}

static uint32_t stream(uint8_t sub)
{
    return rig_read(&rig, 0x2200, sub);
}

static uint32_t resume(void)
{
    return rig_write(&rig, 0x2200, 1, 1, RESUME);
}

static uint32_t override(uint16_t permille)
{
    return rig_write(&rig, 0x2131, 0, 2, permille);
}

static void enable_again(void)
{
    rig.heartbeat_every_ms = 50;
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords(&rig, SWITCH_ON, SWITCH_ON);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

/* On the way until the heartbeat was missed, the axes stand and are off */
static void stop_by_silence(void)
{
    rig_enable(&rig);
    rig_go(&rig, &line, 200);
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 350);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream(5));
    rig.heartbeat_every_ms = 50; /* it is back */
    rig_ms(&rig, 50);
}

static uint32_t crc32_of_line(void)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (unsigned i = 0; i < line.count; i++) {
        const struct knot k = rig_stream_knot(&line, i);
        for (unsigned bit = 0; bit < 64; bit++) {
            const uint32_t one = (uint32_t)k.nm[bit / 32] >> bit % 32 & 1u;
            crc = crc >> 1 ^ (((crc ^ one) & 1u) != 0 ? 0xEDB88320u : 0u);
        }
    }
    return ~crc;
}

static void expect_at_the_end_by_all_knots(void)
{
    TEST_ASSERT_EQUAL_UINT32(DONE, stream(5));
    TEST_ASSERT_EQUAL_UINT32(line.count, stream(8));
    TEST_ASSERT_EQUAL_HEX32(crc32_of_line(), stream(12));
    TEST_ASSERT_DOUBLE_WITHIN(2000, line.x + 32e6, rig.plant.pos_m[0] * 1e9);
    TEST_ASSERT_DOUBLE_WITHIN(2000, line.y + 24e6, rig.plant.pos_m[1] * 1e9);
}

/* ---- feed hold ---- */

static void test_halt_stops_on_the_path_and_the_path_goes_on_when_it_is_taken_back(void)
{
    rig_enable(&rig);
    rig_go(&rig, &line, 200);
    for (int i = 0; i < 3; i++) {
        rig_controlwords(&rig, HALT, HALT);
        rig_ms(&rig, 130);
        TEST_ASSERT_EQUAL_UINT32(STOPPED, stream(5));
        TEST_ASSERT_FALSE(rig_bit(&rig, IP_ACTIVE));
        const uint32_t executed = stream(8);
        rig_ms(&rig, 500);
        TEST_ASSERT_EQUAL_UINT32(executed, stream(8));
        rig_controlwords(&rig, RUN, RUN);
        rig_ms(&rig, 100);
        TEST_ASSERT_EQUAL_UINT32(RUNNING, stream(5));
    }
    rig_ms(&rig, 800);
    expect_at_the_end_by_all_knots();
}

/* ---- feed override ---- */

static void test_override_sets_the_rate_of_path_time_while_it_runs(void)
{
    static const uint16_t permille[] = {800, 1200, 500, 1000};
    rig_enable(&rig);
    rig_go(&rig, &line, 50);
    for (int i = 0; i < 4; i++) {
        TEST_ASSERT_EQUAL_HEX32(0, override(permille[i]));
        rig_ms(&rig, 120);
        TEST_ASSERT_EQUAL_UINT32(permille[i], stream(13));
    }
    rig_ms(&rig, 600);
    expect_at_the_end_by_all_knots();
}

static void test_override_of_0_holds_and_what_comes_next_resumes(void)
{
    rig_enable(&rig);
    rig_go(&rig, &line, 200);
    TEST_ASSERT_EQUAL_HEX32(0, override(0));
    rig_ms(&rig, 130);
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream(5));
    TEST_ASSERT_EQUAL_UINT32(0, stream(13));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 1)); /* it may move at any time */
    TEST_ASSERT_EQUAL_HEX32(0, override(1000));
    rig_ms(&rig, 900);
    expect_at_the_end_by_all_knots();
}

static void test_override_above_120_percent_is_refused(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, override(1200));
    TEST_ASSERT_EQUAL_HEX32(ABORT_TOO_HIGH, override(1201));
    TEST_ASSERT_EQUAL_UINT32(1200, rig_read(&rig, 0x2131, 0));
}

static void test_override_does_not_slow_a_jog(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, override(0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6060, 0, 1, 3));
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60FF, 0, 4, 20000));
    rig_ms(&rig, 500);
    TEST_ASSERT_DOUBLE_WITHIN(100e-6, 0.02, rig.plant.vel_mps[0]);
}

static void test_knots_that_run_out_at_120_percent_end_in_a_stop_on_the_path(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, override(1200));
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &line));
    rig_feed(&rig, &line, 400);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 500);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF10));
    TEST_ASSERT_UINT32_WITHIN(2, 398, stream(8));
    TEST_ASSERT_TRUE(rig_off_line(&rig, &line) < 2000);
}

/* ---- on again after a fault ---- */

static void test_path_goes_on_after_the_heartbeat_was_lost(void)
{
    stop_by_silence();
    const uint32_t executed = stream(8);
    enable_again();
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream(5));
    TEST_ASSERT_EQUAL_UINT32(executed, stream(8));
    TEST_ASSERT_EQUAL_HEX32(0, resume());
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 800);
    expect_at_the_end_by_all_knots();
}

static void test_path_goes_on_after_an_underrun_once_knots_are_there(void)
{
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &line));
    rig_feed(&rig, &line, 300);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 600);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    enable_again();
    TEST_ASSERT_EQUAL_HEX32(0, resume());
    rig_feed(&rig, &line, line.count);
    TEST_ASSERT_EQUAL_UINT32(line.count, stream(7));
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 800);
    expect_at_the_end_by_all_knots();
}

static void test_path_goes_on_after_the_master_has_switched_the_axes_off(void)
{
    rig_enable(&rig);
    rig_go(&rig, &line, 200);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_ms(&rig, 150);
    rig_expect_states(&rig, RIG_READY, RIG_READY);
    enable_again();
    TEST_ASSERT_EQUAL_HEX32(0, resume());
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 800);
    expect_at_the_end_by_all_knots();
}

static void test_path_goes_on_after_the_axes_were_switched_off_twice(void)
{
    rig_enable(&rig);
    rig_go(&rig, &line, 200);
    for (int i = 0; i < 2; i++) {
        rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
        rig_ms(&rig, 150);
        rig_expect_states(&rig, RIG_READY, RIG_READY);
        enable_again();
    }
    TEST_ASSERT_EQUAL_HEX32(0, resume());
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 800);
    expect_at_the_end_by_all_knots();
}

static void test_path_does_not_go_on_by_bit_4_alone(void)
{
    stop_by_silence();
    enable_again();
    rig_controlwords(&rig, RUN, RUN);
    const uint32_t executed = stream(8);
    rig_ms(&rig, 300);
    TEST_ASSERT_EQUAL_UINT32(executed, stream(8));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume()); /* it would start at once */
    rig_controlwords(&rig, RUN, ENABLE);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume());
    rig_controlwords(&rig, ENABLE, RUN);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume());
    rig_controlwords(&rig, ENABLE, ENABLE);
    TEST_ASSERT_EQUAL_HEX32(0, resume());
    rig_ms(&rig, 300);
    TEST_ASSERT_EQUAL_UINT32(executed, stream(8));
}

static void test_no_knot_is_taken_before_the_path_is_resumed(void)
{
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &line));
    rig_feed(&rig, &line, 300);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 600);
    rig_feed(&rig, &line, 310);
    TEST_ASSERT_EQUAL_UINT32(300, stream(7));
    TEST_ASSERT_EQUAL_UINT32(10, stream(17));
    enable_again();
    rig_feed(&rig, &line, 320);
    TEST_ASSERT_EQUAL_UINT32(300, stream(7));
}

static void test_path_does_not_go_on_when_an_axis_was_moved_away(void)
{
    for (int i = 0; i < 4; i++) {
        setUp();
        stop_by_silence();
        rig.plant.pos_m[i / 2] += i % 2 == 0 ? 20e-6 : -20e-6; /* the window is 10 um */
        rig_ms(&rig, 20);
        enable_again();
        TEST_ASSERT_EQUAL_UINT32(IDLE, stream(5));
        TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume());
    }
}

static void test_path_goes_on_when_an_axis_was_moved_a_little(void)
{
    stop_by_silence();
    rig.plant.pos_m[0] += 8e-6;
    rig.plant.pos_m[1] -= 8e-6;
    rig_ms(&rig, 20);
    enable_again();
    TEST_ASSERT_EQUAL_HEX32(0, resume());
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 800);
    expect_at_the_end_by_all_knots();
}

static void test_path_does_not_go_on_after_the_power_was_cut_on_the_way(void)
{
    rig_enable(&rig);
    rig_go(&rig, &line, 300);
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_ms(&rig, 300);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    rig.inputs[0] = 0;
    rig_ms(&rig, 300);
    enable_again();
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream(5));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume());
}

static void test_path_with_a_knot_outside_the_limits_does_not_go_on(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x607D, 2, 4, 20000000));
    rig_enable(&rig);
    rig_go(&rig, &line, 400);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    enable_again();
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume());
}

static void test_path_goes_on_only_if_what_waits_of_it_lies_within_the_limits_of_now(void)
{
    stop_by_silence();
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x687D, 2, 4, 23999999)); /* it ends at 24 mm */
    rig_ms(&rig, 5);
    enable_again();
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume());
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_ms(&rig, 5);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x687D, 2, 4, 24000000));
    rig_ms(&rig, 5);
    enable_again();
    TEST_ASSERT_EQUAL_HEX32(0, resume());
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 800);
    expect_at_the_end_by_all_knots();
}

static void test_nothing_to_resume_is_refused(void)
{
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume());
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume());
    rig_go(&rig, &line, 200);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume());
    rig_ms(&rig, 800);
    expect_at_the_end_by_all_knots();
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_ms(&rig, 10);
    enable_again();
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume());
}

static void test_another_stream_may_begin_where_a_path_was_left(void)
{
    stop_by_silence();
    enable_again();
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &line));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, resume());
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_halt_stops_on_the_path_and_the_path_goes_on_when_it_is_taken_back);
    RUN_TEST(test_override_sets_the_rate_of_path_time_while_it_runs);
    RUN_TEST(test_override_of_0_holds_and_what_comes_next_resumes);
    RUN_TEST(test_override_above_120_percent_is_refused);
    RUN_TEST(test_override_does_not_slow_a_jog);
    RUN_TEST(test_knots_that_run_out_at_120_percent_end_in_a_stop_on_the_path);
    RUN_TEST(test_path_goes_on_after_the_heartbeat_was_lost);
    RUN_TEST(test_path_goes_on_after_an_underrun_once_knots_are_there);
    RUN_TEST(test_path_goes_on_after_the_master_has_switched_the_axes_off);
    RUN_TEST(test_path_does_not_go_on_by_bit_4_alone);
    RUN_TEST(test_no_knot_is_taken_before_the_path_is_resumed);
    RUN_TEST(test_path_does_not_go_on_when_an_axis_was_moved_away);
    RUN_TEST(test_path_goes_on_when_an_axis_was_moved_a_little);
    RUN_TEST(test_path_does_not_go_on_after_the_power_was_cut_on_the_way);
    RUN_TEST(test_path_with_a_knot_outside_the_limits_does_not_go_on);
    RUN_TEST(test_path_goes_on_only_if_what_waits_of_it_lies_within_the_limits_of_now);
    RUN_TEST(test_nothing_to_resume_is_refused);
    RUN_TEST(test_another_stream_may_begin_where_a_path_was_left);
    RUN_TEST(test_path_goes_on_after_the_axes_were_switched_off_twice);
    return UNITY_END();
}
