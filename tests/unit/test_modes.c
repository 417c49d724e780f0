/* SPDX-License-Identifier: Apache-2.0 */
/* Modes of operation on the simulated machine, frame by frame: jogging, homing, quick stop and halt. */
#include "test_drive_rig.h"

enum { SHUTDOWN = 0x06, ENABLE = 0x0F, RUN = 0x1F, HALT = 0x100, QUICK_STOP = 0x0B };
enum { TARGET_REACHED = 10, INTERNAL_LIMIT = 11, SPEED_0 = 12, ATTAINED = 12, HOMING_ERROR = 13 };
enum { VELOCITY = 3, HOMING = 6, PATH = 7 };
enum { DONE = 4 };

#define ABORT_STATE 0x08000022u
#define ABORT_VALUE 0x06090030u

static struct rig rig;

static void start_at(double x_m, double y_m)
{
    struct ks_machine machine = rig_machine();
    for (int i = 0; i < 2; i++) {
        machine.switch_m[i] = 0.002; /* at 198 mm */
        machine.index_m[i] = 0.01;
    }
    machine.start_m[0] = x_m;
    machine.start_m[1] = y_m;
    rig_start(&rig, &machine);
}

void setUp(void)
{
    start_at(0, 0);
}

void tearDown(void)
{
}

static void mode(int axis, int value)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, (uint16_t)(0x6060 + 0x800 * axis), 0, 1, value));
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL(value, (int8_t)rig_read(&rig, (uint16_t)(0x6061 + 0x800 * axis), 0));
}

static void velocity(int axis, int32_t umps)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, (uint16_t)(0x60FF + 0x800 * axis), 0, 4, umps));
}

static void set(int axis, uint16_t index, uint8_t sub, uint8_t size, int64_t value)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, (uint16_t)(index + 0x800 * axis), sub, size, value));
}

static bool status(int axis, int bit)
{
    return ((unsigned)rig.statusword[axis] >> bit & 1u) != 0;
}

static double mmps(int axis)
{
    return rig.plant.vel_mps[axis] * 1e3;
}

static double mm(int axis)
{
    return rig.plant.pos_m[axis] * 1e3;
}

static double told_mm(int axis)
{
    return (int32_t)rig_read(&rig, (uint16_t)(0x6064 + 0x800 * axis), 0) * 1e-6;
}

static void start_jog_mode(void)
{
    rig_enable(&rig);
    mode(0, VELOCITY);
    mode(1, VELOCITY);
}

/* ---- modes ---- */

static void test_modes_that_there_are_not_are_refused(void)
{
    TEST_ASSERT_EQUAL_HEX32(ABORT_VALUE, rig_write(&rig, 0x6060, 0, 1, 4));
    TEST_ASSERT_EQUAL_HEX32(ABORT_VALUE, rig_write(&rig, 0x6860, 0, 1, 5));
    TEST_ASSERT_EQUAL_HEX32(0x64, rig_read(&rig, 0x6502, 0));
    TEST_ASSERT_EQUAL_HEX32(ABORT_VALUE, rig_write(&rig, 0x605A, 0, 2, 3));
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
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, mm(0), told_mm(0));
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
    rig_controlwords(&rig, ENABLE, ENABLE); /* has to wait until the path stands */
    rig_ms(&rig, 50);
    rig_expect_states(&rig, RIG_ENABLED, RIG_READY);
    velocity(0, 0);
    rig_ms(&rig, 200);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
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

/* ---- homing ---- */

/* Home axis `axis` and wait, at most `ms` */
static void home(int axis, int method, unsigned ms)
{
    set(axis, 0x6098, 0, 1, method);
    rig_enable(&rig);
    mode(axis, HOMING);
    TEST_ASSERT_FALSE(status(axis, ATTAINED) || status(axis, HOMING_ERROR));
    TEST_ASSERT_TRUE(status(axis, TARGET_REACHED)); /* not started */
    rig_controlwords(&rig, axis == 0 ? RUN : ENABLE, axis == 1 ? RUN : ENABLE);
    rig_ms(&rig, 2);
    bool over = false;
    for (unsigned i = 0; i < ms && !over; i++) {
        rig_ms(&rig, 1);
        over = (status(axis, ATTAINED) || status(axis, HOMING_ERROR)) && status(axis, TARGET_REACHED);
    }
}

static void expect_attained(int axis)
{
    TEST_ASSERT_TRUE_MESSAGE(status(axis, ATTAINED) && status(axis, TARGET_REACHED), "homing has not been attained");
    TEST_ASSERT_FALSE(status(axis, HOMING_ERROR));
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void expect_error(int axis)
{
    TEST_ASSERT_TRUE_MESSAGE(status(axis, HOMING_ERROR) && status(axis, TARGET_REACHED), "no homing error");
    TEST_ASSERT_FALSE(status(axis, ATTAINED));
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(axis));
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED); /* still enabled */
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_current_position_becomes_the_home_offset(void)
{
    for (int method = 35; method <= 37; method += 2) {
        start_at(0.0123, -0.03);
        set(0, 0x607C, 0, 4, 5000000);
        home(0, method, 100);
        expect_attained(0);
        TEST_ASSERT_DOUBLE_WITHIN(0.5e-3, 5.0, told_mm(0));
        TEST_ASSERT_DOUBLE_WITHIN(0.5e-3, -30.0, told_mm(1));
    }
}

static void enable_for_homing(void)
{
    start_at(0.0123, -0.03);
    set(0, 0x607C, 0, 4, -120000000);
    set(0, 0x6098, 0, 1, 37);
    rig_enable(&rig);
    mode(0, HOMING);
    rig_ms(&rig, 50);
}

/* The same run twice, once without homing: two rigs beside each other are more than a chip's memory. */
static void test_origin_is_shifted_without_a_force_on_any_axis(void)
{
    static int32_t force_mN[1000][2];
    enable_for_homing();
    rig_controlwords(&rig, ENABLE, ENABLE); /* no axis is homed here */
    for (int i = 0; i < 1000; i++) {
        rig_run(&rig, 1);
        memcpy(force_mN[i], rig.out.force_mN, sizeof force_mN[i]);
    }
    enable_for_homing();
    rig_controlwords(&rig, RUN, ENABLE);
    for (int i = 0; i < 1000; i++) {
        rig_run(&rig, 1);
        TEST_ASSERT_EQUAL_INT32(force_mN[i][0], rig.out.force_mN[0]);
        TEST_ASSERT_EQUAL_INT32(force_mN[i][1], rig.out.force_mN[1]);
    }
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.5e-3, -120.0, told_mm(0));
}

static void test_homed_axis_follows_streams_and_limits_in_its_new_positions(void)
{
    struct rig_stream s = {.count = 1500, .length_nm = 50e6};
    start_at(0.05, 0.02);
    set(0, 0x607C, 0, 4, 100000000); /* 100 mm; limits at 150 */
    home(0, 37, 100);
    mode(0, PATH);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_go(&rig, &s, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, rig_read(&rig, 0x2200, 5));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 50 + 40, mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 20 + 30, mm(1));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 140, told_mm(0));
    rig_controlwords(&rig, ENABLE, ENABLE);
    mode(0, VELOCITY);
    velocity(0, 50000);
    rig_ms(&rig, 1000);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 150, told_mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 100, mm(0));
}

static void test_home_point_of_a_limit_switch_is_where_it_opens(void)
{
    for (int max = 0; max < 2; max++) {
        for (int axis = 0; axis < 2; axis++) {
            const double where = max ? 0.19 : -0.19;
            start_at(axis == 0 ? where : 0, axis == 1 ? where : 0);
            home(axis, 17 + max, 3000);
            expect_attained(axis);
            /* the axis stands where it stopped; 0 is the edge of the switch at 198 mm, to half a count and a period */
            TEST_ASSERT_DOUBLE_WITHIN(0.4e-3, mm(axis) - (max ? 198 : -198), told_mm(axis));
            TEST_ASSERT_TRUE(max ? told_mm(axis) < 0 : told_mm(axis) > 0); /* off the switch */
        }
    }
}

static void test_axis_that_is_on_the_switch_leaves_it_first(void)
{
    start_at(-0.199, 0);
    set(0, 0x607C, 0, 4, -195000000);
    home(0, 17, 3000);
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.4e-3, mm(0) + 198 - 195, told_mm(0));
}

static void test_home_point_of_switch_and_index_is_the_first_pulse_off_the_switch(void)
{
    start_at(-0.19, 0);
    home(0, 1, 8000);
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.2e-3, mm(0) + 190, told_mm(0));
    start_at(0, 0.193);
    home(1, 2, 8000);
    expect_attained(1);
    TEST_ASSERT_DOUBLE_WITHIN(0.2e-3, mm(1) - 190, told_mm(1));
}

static void test_next_index_pulse_is_found_in_either_direction(void)
{
    start_at(0.0123, 0);
    home(0, 33, 3000);
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.2e-3, mm(0) - 10, told_mm(0));
    start_at(0.0123, 0);
    home(0, 34, 6000);
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.2e-3, mm(0) - 20, told_mm(0));
}

static void test_switch_may_lie_beyond_the_soft_limits_and_the_axis_comes_back_from_there(void)
{
    start_at(-0.14, 0); /* soft limits at 150, the switch at 198 mm */
    set(0, 0x607C, 0, 4, -198000000);
    home(0, 17, 8000);
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, mm(0), told_mm(0));
    rig_controlwords(&rig, ENABLE, ENABLE);
    mode(0, VELOCITY);
    velocity(0, -50000);
    rig_ms(&rig, 100);
    TEST_ASSERT_TRUE(status(0, SPEED_0));
    velocity(0, 100000);
    rig_ms(&rig, 1500);
    TEST_ASSERT_TRUE(told_mm(0) > -100);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_both_switches_active_is_a_homing_error(void)
{
    rig.inputs[0] = HAL_LIMIT_MIN | HAL_LIMIT_MAX;
    home(0, 17, 100);
    expect_error(0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mm(0));
}

static void test_switch_that_is_not_found_within_the_travel_is_a_homing_error(void)
{
    set(0, 0x607D, 1, 4, -3000000);
    set(0, 0x607D, 2, 4, 3000000);
    home(0, 17, 3000);
    expect_error(0);
    TEST_ASSERT_DOUBLE_WITHIN(1.5, -6, mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, mm(0), told_mm(0)); /* nothing was shifted */
}

static void test_search_for_the_index_ends_at_a_limit_switch(void)
{
    start_at(0.195, 0); /* next pulse upwards: 200 mm, where the table ends */
    home(0, 34, 8000);
    expect_error(0);
}

static void test_homing_is_interrupted_when_bit_4_goes_and_begins_anew_with_its_edge(void)
{
    start_at(-0.15, 0);
    home(0, 17, 300);
    TEST_ASSERT_FALSE(status(0, TARGET_REACHED));
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 300);
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED));
    TEST_ASSERT_FALSE(status(0, ATTAINED) || status(0, HOMING_ERROR));
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, mm(0), told_mm(0));
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 5000);
    expect_attained(0);
}

static void test_halt_ends_homing_until_the_next_edge(void)
{
    start_at(-0.15, 0);
    home(0, 17, 300);
    rig_controlwords(&rig, RUN | HALT, ENABLE);
    rig_ms(&rig, 300);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 100);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
}

static void test_both_axes_home_at_once(void)
{
    start_at(-0.19, 0.195);
    set(0, 0x6098, 0, 1, 17);
    set(1, 0x6098, 0, 1, 18);
    rig_enable(&rig);
    mode(0, HOMING);
    mode(1, HOMING);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 4000);
    expect_attained(0);
    expect_attained(1);
    TEST_ASSERT_DOUBLE_WITHIN(0.4e-3, mm(0) + 198, told_mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(0.4e-3, mm(1) - 198, told_mm(1));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_modes_that_there_are_not_are_refused);
    RUN_TEST(test_mode_is_taken_over_at_standstill_only);
    RUN_TEST(test_stream_moves_nothing_unless_both_axes_are_in_its_mode);
    RUN_TEST(test_stream_that_waits_is_forgotten_with_its_mode);
    RUN_TEST(test_axis_in_profile_velocity_goes_with_the_target_velocity);
    RUN_TEST(test_both_axes_jog_at_once_each_with_its_own_ramp);
    RUN_TEST(test_jog_goes_on_where_it_ended_as_often_as_it_is_asked);
    RUN_TEST(test_jog_ends_at_a_soft_limit_by_slowing_down);
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
    RUN_TEST(test_disabled_axis_slows_down_first_while_the_other_one_goes_on);
    RUN_TEST(test_knots_from_the_bus_do_not_get_into_a_jog);
    RUN_TEST(test_stream_that_runs_into_a_limit_switch_stops_on_its_path_with_a_fault);
    RUN_TEST(test_current_position_becomes_the_home_offset);
    RUN_TEST(test_origin_is_shifted_without_a_force_on_any_axis);
    RUN_TEST(test_homed_axis_follows_streams_and_limits_in_its_new_positions);
    RUN_TEST(test_home_point_of_a_limit_switch_is_where_it_opens);
    RUN_TEST(test_axis_that_is_on_the_switch_leaves_it_first);
    RUN_TEST(test_home_point_of_switch_and_index_is_the_first_pulse_off_the_switch);
    RUN_TEST(test_next_index_pulse_is_found_in_either_direction);
    RUN_TEST(test_switch_may_lie_beyond_the_soft_limits_and_the_axis_comes_back_from_there);
    RUN_TEST(test_both_switches_active_is_a_homing_error);
    RUN_TEST(test_switch_that_is_not_found_within_the_travel_is_a_homing_error);
    RUN_TEST(test_search_for_the_index_ends_at_a_limit_switch);
    RUN_TEST(test_homing_is_interrupted_when_bit_4_goes_and_begins_anew_with_its_edge);
    RUN_TEST(test_halt_ends_homing_until_the_next_edge);
    RUN_TEST(test_both_axes_home_at_once);
    return UNITY_END();
}
