/* SPDX-License-Identifier: Apache-2.0 */
/* Modes of operation on the simulated machine, frame by frame: taking over, jogging, quick stop and halt. */
#include <math.h>

#include "test_axis_modes.h"

/* ---- modes ---- */

static void test_velocity_that_is_there_before_its_mode_moves_the_axis_once_the_mode_is_in_use(void)
{
    rig_enable(&rig);
    velocity(0, 20000);
    mode(0, VELOCITY);
    rig_ms(&rig, 500);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 20, mmps(0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_modes_that_there_are_not_are_refused(void)
{
    TEST_ASSERT_EQUAL_HEX32(ABORT_VALUE, rig_write(&rig, 0x6060, 0, 1, 4));
    TEST_ASSERT_EQUAL_HEX32(ABORT_VALUE, rig_write(&rig, 0x6860, 0, 1, 5));
    TEST_ASSERT_EQUAL_HEX32(0x3E5, rig_read(&rig, 0x6502, 0));
    TEST_ASSERT_EQUAL_HEX32(ABORT_VALUE, rig_write(&rig, 0x605A, 0, 2, 3));
    TEST_ASSERT_EQUAL_HEX32(ABORT_VALUE, rig_write(&rig, 0x685A, 0, 2, 4));
    TEST_ASSERT_EQUAL_HEX32(ABORT_VALUE, rig_write(&rig, 0x6098, 0, 1, 3));
    TEST_ASSERT_EQUAL_HEX32(ABORT_VALUE, rig_write(&rig, 0x6898, 0, 1, 36));
}

static void test_mode_is_taken_over_at_standstill_only(void)
{
    start_jog_mode();
    velocity(0, 10000);
    rig_ms(&rig, 50);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6060, 0, 1, PATH));
    rig_ms(&rig, 50);
    TEST_ASSERT_EQUAL(VELOCITY, rig_read(&rig, 0x6061, 0));
    TEST_ASSERT_DOUBLE_WITHIN(0.5, 10, mmps(0));
    velocity(0, 0);
    rig_ms(&rig, 150);
    TEST_ASSERT_EQUAL(PATH, rig_read(&rig, 0x6061, 0));
}

static void test_mode_that_is_written_while_a_stream_runs_is_taken_when_it_stands(void)
{
    struct rig_stream s = {.count = 500, .length_nm = 10e6};
    rig_enable(&rig);
    rig_go(&rig, &s, 200);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6060, 0, 1, VELOCITY));
    for (unsigned i = 200; i < 490; i++) {
        rig_ms(&rig, 1);
        TEST_ASSERT_EQUAL(PATH, rig_read(&rig, 0x6061, 0));
    }
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL(VELOCITY, rig_read(&rig, 0x6061, 0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 8, mm(0));
}

static void test_mode_that_is_written_while_a_stream_slows_down_is_taken_when_it_stands(void)
{
    struct rig_stream s = {.count = 500, .length_nm = 10e6};
    rig_enable(&rig);
    rig_go(&rig, &s, 200);
    rig_controlwords(&rig, RUN | HALT, RUN | HALT);
    rig_ms(&rig, 20);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6060, 0, 1, VELOCITY));
    rig_ms(&rig, 50);
    TEST_ASSERT_TRUE(mmps(0) > 1);
    TEST_ASSERT_EQUAL(PATH, rig_read(&rig, 0x6061, 0));
    rig_ms(&rig, 100);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    TEST_ASSERT_EQUAL(VELOCITY, rig_read(&rig, 0x6061, 0));
}

static void test_mode_is_not_taken_from_a_stream_that_override_0_holds(void)
{
    struct rig_stream s = {.count = 500, .length_nm = 10e6};
    rig_enable(&rig);
    rig_go(&rig, &s, 200);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2131, 0, 2, 0));
    rig_ms(&rig, 200);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6060, 0, 1, VELOCITY));
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    TEST_ASSERT_EQUAL(PATH, rig_read(&rig, 0x6061, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2131, 0, 2, 1000));
    rig_ms(&rig, 600);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 8, mm(0));
    TEST_ASSERT_EQUAL(VELOCITY, rig_read(&rig, 0x6061, 0));
}

static void test_mode_that_there_is_not_is_not_taken_from_a_pdo_either(void)
{
    const uint8_t four = 4, three = 3;
    set(0, 0x1402, 1, 4, 0x80000401);
    set(0, 0x1602, 0, 1, 0);
    set(0, 0x1602, 1, 4, 0x60600008);
    set(0, 0x1602, 0, 1, 1);
    set(0, 0x1402, 1, 4, 0x401);
    rig_enable(&rig);
    rig_send(&rig, 0x401, 1, &four);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL(PATH, rig_read(&rig, 0x6060, 0));
    TEST_ASSERT_EQUAL(PATH, rig_read(&rig, 0x6061, 0));
    rig_send(&rig, 0x401, 1, &three);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL(VELOCITY, rig_read(&rig, 0x6061, 0));
}

static void test_stream_moves_nothing_unless_both_axes_are_in_its_mode(void)
{
    struct rig_stream s = {.count = 500, .length_nm = 1e6};
    rig_enable(&rig);
    mode(1, VELOCITY);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &s));
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 100);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mm(0));
    rig_controlwords(&rig, ENABLE, ENABLE);
    mode(1, PATH);
    rig_go(&rig, &s, 600);
    TEST_ASSERT_EQUAL_UINT32(DONE, rig_read(&rig, 0x2200, 5));
}

static void test_stream_that_waits_is_forgotten_with_its_mode(void)
{
    struct rig_stream s = {.count = 500, .length_nm = 1e6};
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &s));
    rig_feed(&rig, &s, 500);
    mode(0, VELOCITY);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 5));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 7));
}

/* ---- jogging ---- */

static void test_axis_in_profile_velocity_goes_with_the_target_velocity(void)
{
    start_jog_mode();
    TEST_ASSERT_TRUE(status(0, SPEED_0));
    velocity(0, 50000);
    rig_ms(&rig, 60);
    TEST_ASSERT_FALSE(status(0, TARGET_REACHED));
    TEST_ASSERT_FALSE(status(0, SPEED_0));
    rig_ms(&rig, 100);
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED));
    for (int i = 0; i < 200; i++) {
        rig_ms(&rig, 1);
        TEST_ASSERT_DOUBLE_WITHIN(0.2, 50, mmps(0));
        TEST_ASSERT_DOUBLE_WITHIN(0.001, 0, mm(1));
    }
    velocity(0, -20000);
    rig_ms(&rig, 250);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, -20, mmps(0));
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED));
    velocity(0, 0);
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mmps(0));
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED) && status(0, SPEED_0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 18)); /* underruns */
}

/* Bit 10 is about the latest set-point, also for a master that reads 6041h in the same millisecond. */
static void test_target_reached_is_gone_with_the_next_set_point(void)
{
    start_jog_mode();
    rig_ms(&rig, 20);
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED));
    velocity(0, 20000);
    TEST_ASSERT_BITS_LOW(1u << TARGET_REACHED, rig_read(&rig, 0x6041, 0));
    rig_ms(&rig, 1000);
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED));
    velocity(0, 0);
    TEST_ASSERT_BITS_LOW(1u << TARGET_REACHED, rig_read(&rig, 0x6041, 0));
    rig_ms(&rig, 1000);
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED));
}

/* An RPDO with 60FFh, as the one of a master that has mapped it */
static void test_target_reached_is_gone_with_the_next_set_point_of_a_pdo(void)
{
    rig_enable(&rig);
    rig_nmt(&rig, 128);
    rig_ms(&rig, 300);
    set(0, 0x1402, 1, 4, 0x80000401);
    set(0, 0x1602, 0, 1, 0);
    set(0, 0x1602, 1, 4, 0x60FF0020);
    set(0, 0x1602, 0, 1, 1);
    set(0, 0x1402, 1, 4, 0x401);
    start_jog_mode();
    rig_ms(&rig, 20);
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED));
    static const uint8_t fast[4] = {0x20, 0x4E};
    rig_send(&rig, 0x401, 4, fast);
    TEST_ASSERT_BITS_LOW(1u << TARGET_REACHED, rig_read(&rig, 0x6041, 0));
    rig_ms(&rig, 1000);
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED));
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 20, mmps(0));
}

static void test_both_axes_jog_at_once_each_with_its_own_ramp(void)
{
    start_jog_mode();
    velocity(0, 40000);
    rig_ms(&rig, 20);
    velocity(1, -30000);
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 40, mmps(0));
    TEST_ASSERT_DOUBLE_WITHIN(0.2, -30, mmps(1));
    velocity(0, 0);
    rig_ms(&rig, 150);
    TEST_ASSERT_TRUE(status(0, SPEED_0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    TEST_ASSERT_DOUBLE_WITHIN(0.2, -30, mmps(1));
}

static void test_jog_goes_on_where_it_ended_as_often_as_it_is_asked(void)
{
    start_jog_mode();
    for (int i = 0; i < 5; i++) {
        velocity(0, i % 2 == 0 ? 10000 : -10000);
        rig_ms(&rig, 137);
        velocity(0, 0);
        rig_ms(&rig, 113 + (unsigned)i);
        TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, mm(0), reported_mm(0));
    }
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_jog_ends_at_a_soft_limit_by_slowing_down(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        setUp();
        set(0, 0x607D, 1, 4, -5000000);
        set(0, 0x607D, 2, 4, 5000000);
        start_jog_mode();
        velocity(0, sign * 100000);
        rig_ms(&rig, 1000);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, sign * 5, mm(0));
        TEST_ASSERT_TRUE(status(0, SPEED_0) && status(0, INTERNAL_LIMIT));
        TEST_ASSERT_FALSE(status(0, TARGET_REACHED));
        TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
        velocity(0, -sign * 10000);
        rig_ms(&rig, 150);
        TEST_ASSERT_DOUBLE_WITHIN(0.2, -sign * 10, mmps(0));
        TEST_ASSERT_FALSE(status(0, INTERNAL_LIMIT));
    }
}

static void test_jog_that_has_ended_leaves_no_stream_open(void)
{
    for (int off = 0; off < 2; off++) {
        setUp();
        start_jog_mode();
        velocity(0, 10000);
        rig_ms(&rig, 200);
        TEST_ASSERT_TRUE(rig.device.drive.path.modes.generating && rig.device.drive.path.queue.open);
        velocity(0, 0);
        if (off != 0) {
            rig_controlwords(&rig, 0, 0);
        }
        rig_ms(&rig, 300);
        TEST_ASSERT_FALSE(rig.device.drive.path.modes.generating || rig.device.drive.path.queue.open);
    }
}

static void test_axis_that_stands_at_its_soft_limit_begins_no_jog_beyond_it(void)
{
    for (int i = 0; i < 4; i++) {
        const int axis = i % 2, max = i / 2;
        setUp();
        set(axis, 0x607D, max != 0 ? 2 : 1, 4, 0);
        start_jog_mode();
        velocity(axis, max != 0 ? 10000 : -10000);
        rig_ms(&rig, 50);
        TEST_ASSERT_FALSE(rig.device.drive.path.modes.generating);
        TEST_ASSERT_TRUE(status(axis, INTERNAL_LIMIT));
        velocity(axis, max != 0 ? -10000 : 10000);
        rig_ms(&rig, 150);
        TEST_ASSERT_DOUBLE_WITHIN(0.2, max != 0 ? -10 : 10, mmps(axis));
    }
}

static void test_axis_outside_its_soft_limits_is_jogged_back(void)
{
    start_at(0.160, 0);
    start_jog_mode();
    velocity(0, 10000);
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 160, mm(0));
    velocity(0, -50000);
    rig_ms(&rig, 500);
    TEST_ASSERT_TRUE(mm(0) < 150);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_limit_switch_stops_a_jog_without_a_fault_and_lets_it_go_back(void)
{
    start_jog_mode();
    velocity(0, 50000);
    rig_ms(&rig, 200);
    rig.inputs[0] = HAL_LIMIT_MAX;
    const double at = mm(0);
    rig_ms(&rig, 150);
    TEST_ASSERT_TRUE(status(0, SPEED_0) && status(0, INTERNAL_LIMIT));
    TEST_ASSERT_TRUE(mm(0) - at < 0.5 * 50 * 50 / 3000 + 50 * 0.040); /* quick-stop ramp, rounding, knots ahead */
    TEST_ASSERT_EQUAL_HEX32(2, rig_read(&rig, 0x60FD, 0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    velocity(0, -10000);
    rig_ms(&rig, 100);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, -10, mmps(0));
}

static void test_jog_is_no_faster_than_the_trip_allows(void)
{
    rig_write(&rig, 0x2130, 1, 4, 30000);
    start_jog_mode();
    velocity(0, 100000);
    rig_ms(&rig, 400);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 27, mmps(0));
    TEST_ASSERT_TRUE(status(0, INTERNAL_LIMIT));
    TEST_ASSERT_FALSE(status(0, TARGET_REACHED));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_halt_stops_the_jog_and_its_end_goes_on(void)
{
    start_jog_mode();
    velocity(0, 50000);
    rig_ms(&rig, 200);
    rig_controlwords(&rig, ENABLE | HALT, ENABLE);
    rig_ms(&rig, 200);
    TEST_ASSERT_TRUE(status(0, SPEED_0) && status(0, TARGET_REACHED));
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 50, mmps(0));
}

/* Way from the command to standstill of a jog at 100 mm/s, mm */
static double stop_way(uint16_t controlword, unsigned ms)
{
    start_jog_mode();
    velocity(0, 100000);
    rig_ms(&rig, 300);
    const double from = mm(0);
    rig_controlwords(&rig, controlword, ENABLE);
    rig_ms(&rig, ms);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    return mm(0) - from;
}

static void test_halt_option_chooses_the_ramp(void)
{
    const double slow = stop_way(ENABLE | HALT, 300); /* 5 mm at 1 m/s2, 3.5 mm of knots ahead and rounding */
    TEST_ASSERT_DOUBLE_WITHIN(0.3, 5 + 3.5, slow);
    setUp();
    set(0, 0x605D, 0, 2, 2);
    const double quick = stop_way(ENABLE | HALT, 300); /* 1.67 mm at 3 m/s2 */
    TEST_ASSERT_DOUBLE_WITHIN(0.3, 1.67 + 3.5, quick);
}

static void test_quick_stop_option_chooses_ramp_and_what_comes_after(void)
{
    static const struct {
        int option;
        double way_mm;
        unsigned state;
    } rows[] = {{1, 8.5, RIG_DISABLED}, {2, 5.17, RIG_DISABLED}, {5, 8.5, RIG_QUICK_STOP}, {6, 5.17, RIG_QUICK_STOP}};
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        setUp();
        set(0, 0x605A, 0, 2, rows[i].option);
        TEST_ASSERT_DOUBLE_WITHIN(0.3, rows[i].way_mm, stop_way(QUICK_STOP, 300));
        rig_expect_states(&rig, rows[i].state, RIG_ENABLED);
        TEST_ASSERT_EQUAL(rows[i].state == RIG_QUICK_STOP, rig.out.enable[0]);
        if (rows[i].state == RIG_QUICK_STOP) { /* transition 16 */
            velocity(0, 0);
            rig_controlwords(&rig, ENABLE, ENABLE);
            rig_ms(&rig, 20);
            rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
            velocity(0, 10000);
            rig_ms(&rig, 100);
            TEST_ASSERT_DOUBLE_WITHIN(0.2, 10, mmps(0));
        }
    }
}

static void test_quick_stop_option_0_cuts_the_power_at_once(void)
{
    set(0, 0x605A, 0, 2, 0);
    start_jog_mode();
    velocity(0, 50000);
    rig_ms(&rig, 200);
    rig_controlwords(&rig, QUICK_STOP, ENABLE);
    rig_run(&rig, 1);
    TEST_ASSERT_FALSE(rig.out.enable[0]);
    rig_ms(&rig, 500);
    rig_expect_states(&rig, RIG_DISABLED, RIG_ENABLED);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0, mm(1));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_quick_stop_that_stays_goes_on_with_the_stream_where_it_stopped(void)
{
    struct rig_stream s = {.count = 1500, .length_nm = 50e6};
    set(0, 0x605A, 0, 2, 6);
    set(1, 0x605A, 0, 2, 6);
    rig_enable(&rig);
    rig_go(&rig, &s, 600);
    rig_controlwords(&rig, QUICK_STOP, QUICK_STOP);
    rig_ms(&rig, 200);
    rig_expect_states(&rig, RIG_QUICK_STOP, RIG_QUICK_STOP);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    TEST_ASSERT_TRUE(rig_off_line(&rig, &s) < 1000);
    rig_controlwords(&rig, RUN, RUN);
    rig_feed(&rig, &s, s.count);
    rig_ms(&rig, 1200);
    TEST_ASSERT_EQUAL_UINT32(DONE, rig_read(&rig, 0x2200, 5));
}

static void test_master_that_falls_silent_stops_the_jog_and_the_power(void)
{
    start_jog_mode();
    velocity(0, 50000);
    velocity(1, 50000);
    rig_ms(&rig, 200);
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 400);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x8130));
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, hypot(mmps(0), mmps(1)));
}

static void test_pre_operational_stops_the_jog_whatever_the_quick_stop_option(void)
{
    for (int option = 0; option <= 6; option += 2) {
        setUp();
        if (option != 4) {
            set(0, 0x605A, 0, 2, option);
        }
        start_jog_mode();
        velocity(0, 50000);
        rig_ms(&rig, 200);
        rig_nmt(&rig, 128);
        rig_run(&rig, 1);
        TEST_ASSERT_TRUE(rig.out.enable[0]);
        rig_ms(&rig, 300);
        TEST_ASSERT_FALSE(rig.out.enable[0]);
        TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    }
}

static void test_axis_alone_jogs_while_the_other_one_has_no_power(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 3);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords(&rig, ENABLE, SHUTDOWN);
    mode(0, VELOCITY);
    velocity(0, 20000);
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 20, mmps(0));
    rig_controlwords(&rig, ENABLE, ENABLE); /* not before the path stands */
    rig_ms(&rig, 50);
    rig_expect_states(&rig, RIG_ENABLED, RIG_READY);
    velocity(0, 0);
    rig_ms(&rig, 200);
    rig_expect_states(&rig, RIG_ENABLED, RIG_READY);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

/* It coasts, and its next mode must not wait for a ramp that nothing follows. */
static void test_axis_whose_power_is_cut_ends_its_profile_with_the_quick_stop_ramp(void)
{
    set(1, 0x6084, 0, 4, 10000); /* 10 mm/s2: from 50 mm/s it would take 5 s */
    start_jog_mode();
    velocity(0, 20000);
    velocity(1, 50000);
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(0.5, 50, mmps(1));
    rig_controlwords(&rig, ENABLE, 0);
    rig_ms(&rig, 1);
    TEST_ASSERT_FALSE(rig.out.enable[1]);
    set(1, 0x6060, 0, 1, HOMING);
    rig_ms(&rig, 200);
    TEST_ASSERT_EQUAL(HOMING, rig_read(&rig, 0x6861, 0));
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 20, mmps(0));
}

static void test_disabled_axis_slows_down_first_while_the_other_one_goes_on(void)
{
    start_jog_mode();
    velocity(0, 50000);
    velocity(1, 50000);
    rig_ms(&rig, 200);
    rig_controlwords(&rig, 0x07, ENABLE);
    rig_ms(&rig, 20);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    rig_ms(&rig, 200);
    rig_expect_states(&rig, RIG_SWITCHED_ON, RIG_ENABLED);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mmps(0));
    TEST_ASSERT_DOUBLE_WITHIN(0.5, 50, mmps(1));
}

static void test_knots_from_the_bus_do_not_get_into_a_jog(void)
{
    start_jog_mode();
    velocity(0, 20000);
    rig_ms(&rig, 100);
    const uint8_t next = (uint8_t)rig_read(&rig, 0x2200, 7);
    rig_knot(&rig, next, 1000, 0);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x68C1, 1, 4, 0));
    rig_ms(&rig, 100);
    TEST_ASSERT_TRUE(rig_read(&rig, 0x2200, 17) >= 2);
    TEST_ASSERT_DOUBLE_WITHIN(0.001, 0, mm(1));
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 20, mmps(0));
}

static void test_stream_that_runs_into_a_limit_switch_stops_on_its_path_with_a_fault(void)
{
    struct rig_stream s = {.count = 1500, .length_nm = 50e6};
    rig_enable(&rig);
    rig_go(&rig, &s, 700);
    rig.inputs[1] = HAL_LIMIT_MAX;
    rig_ms(&rig, 200);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF12));
    TEST_ASSERT_TRUE(rig_off_line(&rig, &s) < 1000);
    /* reset, and off the switch by a jog */
    rig_controlwords(&rig, 0x80, 0x80);
    rig_ms(&rig, 20);
    start_jog_mode();
    velocity(1, -20000);
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, -20, mmps(1));
}

static void test_end_of_the_last_jog_is_not_taken_for_that_of_the_next(void)
{
    start_jog_mode();
    velocity(0, 10000);
    rig_ms(&rig, 200);
    velocity(0, 0);
    rig_ms(&rig, 200);
    velocity(0, 10000);
    rig_controlwords_at_once(&rig, ENABLE, ENABLE); /* begins a path */
    rig_controlwords_at_once(&rig, ENABLE, ENABLE); /* the tick still stands at the end of the one before */
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 10, mmps(0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_total_of_the_next_stream_does_not_end_a_jog(void)
{
    start_jog_mode();
    velocity(0, 20000);
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 4, 4, rig_read(&rig, 0x2200, 7)));
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 20, mmps(0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

#ifndef KONTUR_NUM_CHK /* a path that ends on its way has derivatives out of the range of num */
static void test_jog_that_nobody_makes_knots_for_stops_with_a_fault(void)
{
    start_jog_mode();
    velocity(0, 20000);
    rig_ms(&rig, 200);
    const double at = mm(0);
    for (int i = 0; i < 50 * 10; i++) { /* 50 ms in which the background does nothing */
        device_tick(&rig.device);
        const double force_N[2] = {rig.out.force_mN[0] * 1e-3, rig.out.force_mN[1] * 1e-3};
        plant_step(&rig.plant, force_N);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.3, at + 20 * 0.010, mm(0)); /* knots of 10 ms */
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF10));
    TEST_ASSERT_FALSE(rig.out.enable[0]);
    TEST_ASSERT_EQUAL_UINT32(DONE, rig_read(&rig, 0x2200, 5));
}
#endif

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_velocity_that_is_there_before_its_mode_moves_the_axis_once_the_mode_is_in_use);
    RUN_TEST(test_modes_that_there_are_not_are_refused);
    RUN_TEST(test_mode_is_taken_over_at_standstill_only);
    RUN_TEST(test_stream_moves_nothing_unless_both_axes_are_in_its_mode);
    RUN_TEST(test_stream_that_waits_is_forgotten_with_its_mode);
    RUN_TEST(test_axis_in_profile_velocity_goes_with_the_target_velocity);
    RUN_TEST(test_target_reached_is_gone_with_the_next_set_point);
    RUN_TEST(test_target_reached_is_gone_with_the_next_set_point_of_a_pdo);
    RUN_TEST(test_both_axes_jog_at_once_each_with_its_own_ramp);
    RUN_TEST(test_jog_goes_on_where_it_ended_as_often_as_it_is_asked);
    RUN_TEST(test_jog_ends_at_a_soft_limit_by_slowing_down);
    RUN_TEST(test_jog_that_has_ended_leaves_no_stream_open);
    RUN_TEST(test_axis_that_stands_at_its_soft_limit_begins_no_jog_beyond_it);
    RUN_TEST(test_axis_outside_its_soft_limits_is_jogged_back);
    RUN_TEST(test_limit_switch_stops_a_jog_without_a_fault_and_lets_it_go_back);
    RUN_TEST(test_jog_is_no_faster_than_the_trip_allows);
    RUN_TEST(test_halt_stops_the_jog_and_its_end_goes_on);
    RUN_TEST(test_halt_option_chooses_the_ramp);
    RUN_TEST(test_quick_stop_option_chooses_ramp_and_what_comes_after);
    RUN_TEST(test_quick_stop_option_0_cuts_the_power_at_once);
    RUN_TEST(test_quick_stop_that_stays_goes_on_with_the_stream_where_it_stopped);
    RUN_TEST(test_master_that_falls_silent_stops_the_jog_and_the_power);
    RUN_TEST(test_pre_operational_stops_the_jog_whatever_the_quick_stop_option);
    RUN_TEST(test_axis_alone_jogs_while_the_other_one_has_no_power);
    RUN_TEST(test_axis_whose_power_is_cut_ends_its_profile_with_the_quick_stop_ramp);
    RUN_TEST(test_disabled_axis_slows_down_first_while_the_other_one_goes_on);
    RUN_TEST(test_knots_from_the_bus_do_not_get_into_a_jog);
    RUN_TEST(test_stream_that_runs_into_a_limit_switch_stops_on_its_path_with_a_fault);
    RUN_TEST(test_mode_that_is_written_while_a_stream_runs_is_taken_when_it_stands);
    RUN_TEST(test_mode_is_not_taken_from_a_stream_that_override_0_holds);
    RUN_TEST(test_mode_that_there_is_not_is_not_taken_from_a_pdo_either);
    RUN_TEST(test_total_of_the_next_stream_does_not_end_a_jog);
#ifndef KONTUR_NUM_CHK
    RUN_TEST(test_jog_that_nobody_makes_knots_for_stops_with_a_fault);
#endif
    RUN_TEST(test_end_of_the_last_jog_is_not_taken_for_that_of_the_next);
    RUN_TEST(test_mode_that_is_written_while_a_stream_slows_down_is_taken_when_it_stands);
    return UNITY_END();
}
