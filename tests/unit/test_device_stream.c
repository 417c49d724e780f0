/* SPDX-License-Identifier: Apache-2.0 */
/* The whole firmware on a simulated machine. Streams: begin, run, hold, end, and the next one. */
#include <math.h>

#include "test_device.h"

static void test_begin_is_refused_before_the_axes_are_enabled(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 3);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &stream));
}

static void test_begin_is_refused_with_a_total_of_1_or_2(void)
{
    rig_enable(&rig);
    stream.count = 1;
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &stream));
    stream.count = 2;
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &stream));
    stream.count = 3;
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
}

static void test_begin_is_refused_outside_the_start_window_of_each_axis(void)
{
    rig_enable(&rig); /* held at 0, 0; window 10 um */
    rig_write(&rig, 0x2200, 4, 4, 100);
    for (uint8_t sub = 2; sub <= 3; sub++) {
        rig_write(&rig, 0x2200, sub, 4, 10001);
        TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 1));
        rig_write(&rig, 0x2200, sub, 4, -10001);
        TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 1));
        rig_write(&rig, 0x2200, sub, 4, INT32_MIN);
        TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 1));
        rig_write(&rig, 0x2200, sub, 4, -10000);
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 1));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 2));
        rig_write(&rig, 0x2200, sub, 4, -10000);
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 1));
        rig_write(&rig, 0x2200, sub, 4, 0);
        rig_write(&rig, 0x2200, 1, 1, 1);
    }
}

static void test_begin_and_abort_are_refused_while_the_path_runs(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 500);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 1));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 2));
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 10);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 1));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 2));
    TEST_ASSERT_EQUAL_UINT32(STOPPING, stream_state());
}

static void test_begin_is_refused_while_bit_4_is_still_set(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &stream));
    rig_controlwords(&rig, ENABLE, RUN);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
}

static void test_knots_without_a_stream_are_counted_and_change_nothing(void)
{
    rig_enable(&rig);
    rig_knot(&rig, 0, 5, 5);
    rig_knot(&rig, 7, 5, 5);
    TEST_ASSERT_EQUAL_UINT32(2, rig_read(&rig, 0x2200, 17));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 7));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 14));
}

static void test_refused_knot_is_answered_at_once_with_what_is_expected(void)
{
    rig_enable(&rig);
    rig_begin(&rig, &stream);
    rig_knot(&rig, 0, 0, 0);
    const unsigned before = rig.status_count;
    rig_knot(&rig, 2, 0, 0);
    TEST_ASSERT_EQUAL_UINT(before + 1, rig.status_count);
    TEST_ASSERT_EQUAL_UINT16(1, rig.accepted);
    TEST_ASSERT_EQUAL_UINT16(QUEUE_ROOM - 1u, rig.free);
}

static void test_path_runs_to_its_end_and_is_held_there(void)
{
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream_state());
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    rig_feed(&rig, &stream, stream.count);
    rig_ms(&rig, 50);
    TEST_ASSERT_EQUAL_UINT32(FILLING, stream_state());
    TEST_ASSERT_FALSE(rig_bit(&rig, IP_ACTIVE));
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_UINT32(RUNNING, stream_state());
    TEST_ASSERT_TRUE(rig_bit(&rig, IP_ACTIVE));
    for (int i = 0; i < 15; i++) {
        run_on_the_line(99);
        TEST_ASSERT_FALSE(rig_bit(&rig, TARGET_REACHED));
        rig_feed(&rig, &stream, stream.count);
    }
    run_on_the_line(100);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_TRUE(rig_bit(&rig, TARGET_REACHED));
    TEST_ASSERT_FALSE(rig_bit(&rig, IP_ACTIVE));
    TEST_ASSERT_EQUAL_UINT32(1500, rig_read(&rig, 0x2200, 8));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 18));
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 40e-3, rig.plant.pos_m[0]);
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 30e-3, rig.plant.pos_m[1]);
    expect_standing_on_the_line();
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    expect_power(true, true);
}

static void check_feed_hold(uint16_t x, uint16_t y)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_controlwords(&rig, x, y);
    run_on_the_line(10);
    TEST_ASSERT_EQUAL_UINT32(STOPPING, stream_state());
    TEST_ASSERT_TRUE(rig_bit(&rig, IP_ACTIVE));
    run_on_the_line(STOP_MS + 190);
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    TEST_ASSERT_FALSE(rig_bit(&rig, IP_ACTIVE));
    TEST_ASSERT_FALSE(rig_bit(&rig, TARGET_REACHED));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 13));
    expect_standing_on_the_line();
    TEST_ASSERT_UINT32_WITHIN(2, 700 + STOP_MS / 2, rig_read(&rig, 0x2200, 8));
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);

    rig_controlwords(&rig, RUN, RUN);
    for (int i = 0; i < 10; i++) {
        rig_feed(&rig, &stream, stream.count);
        run_on_the_line(100);
    }
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 40e-3, rig.plant.pos_m[0]);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_clearing_bit_4_holds_the_path_and_setting_it_goes_on(void)
{
    check_feed_hold(ENABLE, ENABLE);
}

static void test_halt_holds_the_path_and_clearing_it_goes_on(void)
{
    check_feed_hold(HALT | 0x10, HALT | 0x10);
}

static void test_halt_of_one_axis_stops_both(void)
{
    check_feed_hold(RUN, HALT);
}

static void test_second_stream_follows_the_first(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    rig_controlwords(&rig, ENABLE, ENABLE);
    stream.length_nm = -20e6;
    rig_go(&rig, &stream, 1);
    TEST_ASSERT_FALSE(rig_bit(&rig, TARGET_REACHED));
    TEST_ASSERT_EQUAL_UINT32(RUNNING, stream_state());
    for (int i = 0; i < 16; i++) {
        rig_feed(&rig, &stream, stream.count);
        run_on_the_line(100);
    }
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 24e-3, rig.plant.pos_m[0]);
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 18e-3, rig.plant.pos_m[1]);
}

static void test_target_reached_of_the_stream_before_is_gone_when_the_next_one_has_begun(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 1600);
    rig_controlwords(&rig, ENABLE, ENABLE);
    TEST_ASSERT_BITS_HIGH(1u << TARGET_REACHED, rig_read(&rig, 0x6041, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    TEST_ASSERT_BITS_LOW(1u << TARGET_REACHED, rig_read(&rig, 0x6041, 0));
    TEST_ASSERT_BITS_LOW(1u << TARGET_REACHED, rig_read(&rig, 0x6841, 0));
}

static void test_second_stream_waits_for_its_own_knots(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 1600);
    rig_controlwords(&rig, ENABLE, ENABLE);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    rig_ms(&rig, 5);
    TEST_ASSERT_EQUAL_UINT32(FILLING, stream_state());
    rig_feed(&rig, &stream, 20);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 8));
    rig_feed(&rig, &stream, stream.count);
    run_on_the_line(100);
    TEST_ASSERT_EQUAL_UINT32(RUNNING, stream_state());
}

static void test_stream_that_never_started_is_stopped_when_the_axes_are_disabled(void)
{
    rig_enable(&rig);
    rig_begin(&rig, &stream);
    rig_feed(&rig, &stream, 10);
    rig_controlwords(&rig, SWITCH_ON, SWITCH_ON);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    rig_knot(&rig, 10, 0, 0);
    TEST_ASSERT_EQUAL_UINT32(10, rig_read(&rig, 0x2200, 7));
}

static void test_stopped_stream_is_given_up_by_command_2(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, STOP_MS + 200);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 2));
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream_state());
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 7));
    const double x = rig.plant.pos_m[0];
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 100);
    TEST_ASSERT_DOUBLE_WITHIN(300e-9, x, rig.plant.pos_m[0]);
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream_state());
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
}

static void test_open_ended_stream_ends_with_an_underrun_on_its_path(void)
{
    rig_enable(&rig);
    const unsigned count = stream.count;
    stream.count = 0;
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    stream.count = count;
    rig_feed(&rig, &stream, 900);
    rig_controlwords(&rig, RUN, RUN);
    run_on_the_line(1000);
    expect_fault(0xFF10);
    TEST_ASSERT_UINT32_WITHIN(2, 897, rig_read(&rig, 0x2200, 8));
    expect_standing_on_the_line();
}

static void test_energy_is_counted_from_the_reset_on(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 1600);
    const uint32_t both = rig_read(&rig, 0x2220, 2) + rig_read(&rig, 0x2220, 3);
    TEST_ASSERT_TRUE(both > 500); /* 50 mm against 70 N of friction alone: 3.5 J; heat besides */
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2220, 1, 1, 1));
    rig_ms(&rig, 1);
    TEST_ASSERT_UINT32_WITHIN(10, 0, rig_read(&rig, 0x2220, 2));
    TEST_ASSERT_UINT32_WITHIN(10, 0, rig_read(&rig, 0x2220, 3));
}

static void test_change_of_controller_during_motion_does_not_step_the_force(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 500);
    for (int controller = 0; controller < 5; controller++) {
        const int next = (controller + 1) % 5;
        double usual = 0, at = 0;
        rig_write(&rig, 0x2000, 1, 1, controller);
        rig_ms(&rig, 100);
        for (int i = 0; i < 200; i++) {
            const struct hal_drive_out before = rig.out;
            if (i == 100) {
                rig_write(&rig, 0x2000, 1, 1, next);
            }
            rig_run(&rig, 1);
            const double step = fmax(fabs((double)rig.out.force_mN[0] - before.force_mN[0]),
                                     fabs((double)rig.out.force_mN[1] - before.force_mN[1]));
            usual = i < 100 ? fmax(usual, step) : usual;
            at = i == 100 ? step : at;
        }
        TEST_ASSERT_TRUE_MESSAGE(at <= usual + 100, "more than 0.1 N above the largest step of the 10 ms before");
        run_on_the_line(20);
        rig_feed(&rig, &stream, stream.count);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_begin_is_refused_before_the_axes_are_enabled);
    RUN_TEST(test_begin_is_refused_with_a_total_of_1_or_2);
    RUN_TEST(test_begin_is_refused_outside_the_start_window_of_each_axis);
    RUN_TEST(test_begin_and_abort_are_refused_while_the_path_runs);
    RUN_TEST(test_begin_is_refused_while_bit_4_is_still_set);
    RUN_TEST(test_knots_without_a_stream_are_counted_and_change_nothing);
    RUN_TEST(test_refused_knot_is_answered_at_once_with_what_is_expected);
    RUN_TEST(test_path_runs_to_its_end_and_is_held_there);
    RUN_TEST(test_clearing_bit_4_holds_the_path_and_setting_it_goes_on);
    RUN_TEST(test_halt_holds_the_path_and_clearing_it_goes_on);
    RUN_TEST(test_halt_of_one_axis_stops_both);
    RUN_TEST(test_second_stream_follows_the_first);
    RUN_TEST(test_target_reached_of_the_stream_before_is_gone_when_the_next_one_has_begun);
    RUN_TEST(test_second_stream_waits_for_its_own_knots);
    RUN_TEST(test_stream_that_never_started_is_stopped_when_the_axes_are_disabled);
    RUN_TEST(test_stopped_stream_is_given_up_by_command_2);
    RUN_TEST(test_open_ended_stream_ends_with_an_underrun_on_its_path);
    RUN_TEST(test_energy_is_counted_from_the_reset_on);
    RUN_TEST(test_change_of_controller_during_motion_does_not_step_the_force);
    return UNITY_END();
}
