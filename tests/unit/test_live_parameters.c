/* SPDX-License-Identifier: Apache-2.0 */
/* Parameters that are taken while an axis has power, and are in effect from the next movement on (OD_LIVE). */
#include <math.h>

#include "test_axis_modes.h"

enum { ABORT_HARDWARE = 0x06060000, QUICK = 0x0B };

/* ---- which they are ---- */

static bool is_live(uint16_t index)
{
    static const uint16_t live[] = {0x605A, 0x605D, 0x6065, 0x6067, 0x6068, 0x607C, 0x607D,
                                    0x607F, 0x6083, 0x6084, 0x6085, 0x6098, 0x6099, 0x609A};
    for (unsigned i = 0; i < sizeof live / sizeof live[0]; i++) {
        if (index == live[i] || index == live[i] + 0x800u) {
            return true;
        }
    }
    return false;
}

static void test_what_changes_the_loop_is_refused_with_power_and_what_is_of_a_movement_is_taken(void)
{
    rig_enable(&rig);
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *e = &od_table[i];
        if ((e->flags & OD_CONFIG) != 0) {
            const int64_t same = od_read(&rig.device.od, e);
            const uint32_t code = rig_write(&rig, e->index, e->sub, od_size(e), same);
            TEST_ASSERT_EQUAL_HEX32_MESSAGE(is_live(e->index) ? 0 : ABORT_STATE, code, "index");
        }
    }
    set(0, 0x6083, 0, 4, 123456);
    set(1, 0x6065, 0, 4, 123456);
    rig_ms(&rig, 100); /* a checksum would have told by now */
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_FALSE(rig_had_emcy(&rig, 0x5510));
}

static void test_flipped_bit_of_another_parameter_is_not_hidden_by_a_write(void)
{
    rig_enable(&rig);
    rig_ms(&rig, 100);
    rig.device.od.axis[1].plant.mass ^= 1u;
    TEST_ASSERT_EQUAL_HEX32(ABORT_HARDWARE, rig_write(&rig, 0x6083, 0, 4, 500000));
    rig_ms(&rig, 40);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x5510));
    TEST_ASSERT_FALSE(rig.out.enable[0] || rig.out.enable[1]);
}

/* ---- ramps ---- */

/* Milliseconds until the axis stands */
static unsigned stop_takes(void)
{
    unsigned ms = 0;
    while (fabs(mmps(0)) > 0.05 && ms < 2000) {
        rig_ms(&rig, 1);
        ms++;
    }
    return ms;
}

static void test_ramps_written_on_the_way_are_those_of_the_next_movement(void)
{
    start_jog_mode();
    velocity(0, 50000);
    rig_ms(&rig, 20);
    set(0, 0x6083, 0, 4, 10000); /* 1 m/s2 to 0.01: the ramp under way does not change */
    set(0, 0x6084, 0, 4, 250000);
    rig_ms(&rig, 120);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 50, mmps(0));
    velocity(0, 0);
    TEST_ASSERT_UINT_WITHIN(20, 250, stop_takes());
    velocity(0, 50000);
    rig_ms(&rig, 1000);
    TEST_ASSERT_DOUBLE_WITHIN(1, 10, mmps(0));
}

static void test_deceleration_written_while_it_slows_down_is_that_of_the_next_stop(void)
{
    start_jog_mode();
    velocity(0, 50000);
    rig_ms(&rig, 200);
    set(0, 0x6084, 0, 4, 100000);
    velocity(0, 0);
    rig_ms(&rig, 50);
    set(0, 0x6084, 0, 4, 5000000);
    TEST_ASSERT_UINT_WITHIN(30, 450 + 50, stop_takes());
    velocity(0, 50000);
    rig_ms(&rig, 300);
    velocity(0, 0);
    TEST_ASSERT_UINT_WITHIN(20, 60, stop_takes());
}

static void test_quick_stop_ramp_written_on_the_way_is_that_of_the_next_quick_stop(void)
{
    start_jog_mode();
    velocity(0, 50000);
    rig_ms(&rig, 200);
    set(0, 0x6085, 0, 4, 100000);
    rig_controlwords(&rig, QUICK, QUICK);
    rig_ms(&rig, 50);
    set(0, 0x6085, 0, 4, 9000000);
    set(0, 0x605A, 0, 2, 5); /* nor does it go by 6084h and stay in quick stop active, */
    TEST_ASSERT_UINT_WITHIN(30, 450 + 50, stop_takes());
    rig_ms(&rig, 100);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    rig_enable(&rig); /* until the next one */
    velocity(0, 50000);
    rig_ms(&rig, 200);
    rig_controlwords(&rig, QUICK, QUICK);
    TEST_ASSERT_UINT_WITHIN(20, 100, stop_takes());
    rig_ms(&rig, 100);
    rig_expect_states(&rig, RIG_QUICK_STOP, RIG_DISABLED);
}

static void test_halt_goes_by_the_option_written_before_it(void)
{
    start_jog_mode();
    set(0, 0x6084, 0, 4, 100000);
    set(0, 0x6085, 0, 4, 5000000);
    velocity(0, 50000);
    rig_ms(&rig, 200);
    set(0, 0x605D, 0, 2, 2);
    rig_controlwords(&rig, HALT, HALT);
    TEST_ASSERT_UINT_WITHIN(20, 60, stop_takes());
}

/* ---- limits ---- */

static void test_limits_that_leave_the_axis_outside_are_refused_with_power_only(void)
{
    start_jog_mode();
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x607D, 1, 4, 1000000));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x687D, 2, 4, -1000000));
    rig_controlwords(&rig, 0, 0);
    rig_ms(&rig, 5);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x607D, 1, 4, 1000000));
}

static void test_limits_written_on_the_way_are_those_of_the_next_path(void)
{
    start_jog_mode();
    velocity(0, 50000);
    rig_ms(&rig, 200);
    set(0, 0x607D, 2, 4, 12000000);
    rig_ms(&rig, 400);
    TEST_ASSERT_TRUE(mm(0) > 20); /* this one goes by the limit that it began with */
    velocity(0, 0);
    rig_ms(&rig, 300);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    const double stood = mm(0);
    velocity(0, 50000); /* outside: back only */
    rig_ms(&rig, 300);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, stood, mm(0));
    velocity(0, -50000);
    rig_ms(&rig, 600);
    velocity(0, 0);
    rig_ms(&rig, 300);
    TEST_ASSERT_TRUE(mm(0) < 12);
    velocity(0, 50000);
    rig_ms(&rig, 1500);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 12, mm(0));
    velocity(0, 0);
    rig_ms(&rig, 100);
    set(0, 0x607D, 2, 4, 160000000); /* wider than at power-on */
    velocity(0, 200000);
    rig_ms(&rig, 1500);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 160, mm(0));
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

static void test_following_window_written_on_the_way_is_in_effect_at_once(void)
{
    start_jog_mode();
    velocity(0, 50000);
    rig_ms(&rig, 200);
    rig.lost[0] += 30; /* counts: 2.3 um */
    rig_ms(&rig, 20);
    TEST_ASSERT_FALSE(rig_had_emcy(&rig, 0x8611));
    set(0, 0x6065, 0, 4, 1000); /* 1 um */
    rig_ms(&rig, 20);
    TEST_ASSERT_FALSE(rig_had_emcy(&rig, 0x8611));
    rig.lost[0] += 30;
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x8611));
}

static void test_quick_stop_option_written_with_power_decides_on_the_stop_input(void)
{
    rig_enable(&rig);
    set(0, 0x605A, 0, 2, 0);
    rig.inputs[0] = HAL_STOP;
    rig_run(&rig, 2);
    TEST_ASSERT_FALSE(rig.out.enable[0] || rig.out.enable[1]);
}

/* ---- homing ---- */

static void home(void)
{
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 60);
    TEST_ASSERT_TRUE(status(0, ATTAINED));
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
}

static void test_homing_goes_by_what_was_written_before_it_began(void)
{
    rig_enable(&rig);
    mode(0, HOMING);
    set(0, 0x6098, 0, 1, 35);
    set(0, 0x607C, 0, 4, 7000000);
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 5);
    set(0, 0x607C, 0, 4, 3000000);
    set(0, 0x6098, 0, 1, 17);
    rig_ms(&rig, 60);
    TEST_ASSERT_TRUE(status(0, ATTAINED));
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 7, reported_mm(0));
    rig_controlwords(&rig, ENABLE, ENABLE);
    set(0, 0x6098, 0, 1, 35);
    rig_ms(&rig, 2);
    home();
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 3, reported_mm(0));
}

static void test_homing_moves_with_the_speeds_written_before_it_began(void)
{
    rig_enable(&rig);
    mode(0, HOMING);
    set(0, 0x6098, 0, 1, 17);
    set(0, 0x6099, 1, 4, 10000);
    set(0, 0x609A, 0, 4, 1000000);
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, -10, mmps(0));
    set(0, 0x6099, 1, 4, 50000);
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, -10, mmps(0));
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 200);
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, -50, mmps(0));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_what_changes_the_loop_is_refused_with_power_and_what_is_of_a_movement_is_taken);
    RUN_TEST(test_flipped_bit_of_another_parameter_is_not_hidden_by_a_write);
    RUN_TEST(test_ramps_written_on_the_way_are_those_of_the_next_movement);
    RUN_TEST(test_deceleration_written_while_it_slows_down_is_that_of_the_next_stop);
    RUN_TEST(test_quick_stop_ramp_written_on_the_way_is_that_of_the_next_quick_stop);
    RUN_TEST(test_halt_goes_by_the_option_written_before_it);
    RUN_TEST(test_limits_that_leave_the_axis_outside_are_refused_with_power_only);
    RUN_TEST(test_limits_written_on_the_way_are_those_of_the_next_path);
    RUN_TEST(test_following_window_written_on_the_way_is_in_effect_at_once);
    RUN_TEST(test_quick_stop_option_written_with_power_decides_on_the_stop_input);
    RUN_TEST(test_homing_goes_by_what_was_written_before_it_began);
    RUN_TEST(test_homing_moves_with_the_speeds_written_before_it_began);
    return UNITY_END();
}
