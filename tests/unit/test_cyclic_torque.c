/* SPDX-License-Identifier: Apache-2.0 */
/* Cyclic synchronous torque (mode 10) over the bus: the whole firmware on a simulated machine. */
#include <math.h>

#include "test_axis_modes.h"

enum { CST = 10, CSV = 9, FOLLOWS = 12, UNDERRUN = 0xFF10, RANGE = 0xFF11, SWITCH = 0xFF12, CYCLE_MS = 4 };
enum { FROZEN = 0x7305, SATURATED = 0xFF14, HEARTBEAT_LOST = 0x8130, TWO_N = 0x2710 };

static const uint8_t no_data[1];

/* A cycle of the master: set-points of both axes, then SYNC. */
static void cycle(int x, int y)
{
    uint8_t data[4];
    co_put(&data[0], (uint16_t)x, 2);
    co_put(&data[2], (uint16_t)y, 2);
    rig_send(&rig, 0x401, 4, data);
    rig_send(&rig, 0x80, 0, no_data);
    rig_ms(&rig, CYCLE_MS);
}

static void cycles(unsigned count, int x, int y)
{
    for (unsigned i = 0; i < count; i++) {
        cycle(x, y);
    }
}

static void start_torque_on(int axes)
{
    map_set_points(0x6071, 16);
    for (int i = 0; i < 2; i++) {
        set(i, 0x60C2, 1, 1, CYCLE_MS);
    }
    rig_enable(&rig);
    for (int i = 0; i < axes; i++) {
        mode(i, CST);
    }
    cycles(10, 0, 0);
}

static void start_torque(void)
{
    start_torque_on(2);
    TEST_ASSERT_TRUE(status(0, FOLLOWS) && status(1, FOLLOWS));
}

static void expect_no_fault(void)
{
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[0]);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

static double force_N(int axis)
{
    return rig.out.force_mN[axis] * 1e-3;
}

static void expect_stop(uint16_t emcy)
{
    rig_ms(&rig, 400);
    TEST_ASSERT_EQUAL_HEX16(emcy, rig.emcy[0]);
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[1]);
    TEST_ASSERT_EQUAL_UINT(1, rig.emcy_count);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 0, mmps(0));
}

/* ---- the force ---- */

static void test_force_is_the_set_point_and_accelerates_the_mass(void)
{
    start_torque();
    TEST_ASSERT_EQUAL_UINT(600000, rig_read(&rig, 0x6076, 0));
    cycles(25, 200, -100);
    TEST_ASSERT_EQUAL_DOUBLE(120, force_N(0));
    TEST_ASSERT_EQUAL_DOUBLE(-60, force_N(1));
    TEST_ASSERT_EQUAL_INT(200, (int16_t)rig_read(&rig, 0x6077, 0));
    TEST_ASSERT_EQUAL_INT(-100, (int16_t)rig_read(&rig, 0x6877, 0));
    /* M v' = F - L - C v, of Table 1; SYNC and two control periods are 1.2 ms at most */
    const double t = 0.1;
    const double x = (120 - 45.5) / 467.2 * (1 - exp(-467.2 / 88.08 * t));
    const double y = -(60 - 54.8) / 631.0 * (1 - exp(-631.0 / 97.9 * t));
    TEST_ASSERT_DOUBLE_WITHIN(0.0012 * 0.85 + 1e-4, x, mmps(0) * 1e-3);
    TEST_ASSERT_DOUBLE_WITHIN(0.0012 * 0.06 + 1e-4, y, mmps(1) * 1e-3);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, mm(0), reported_mm(0));
    expect_no_fault();
}

static void test_set_point_acts_from_sync_on(void)
{
    static const uint8_t data[4] = {100, 0, 100, 0};
    start_torque();
    rig_send(&rig, 0x401, 4, data);
    rig_ms(&rig, 3);
    TEST_ASSERT_EQUAL_DOUBLE(0, force_N(0));
    rig_send(&rig, 0x80, 0, no_data);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_DOUBLE(60, force_N(0));
    TEST_ASSERT_EQUAL_DOUBLE(60, force_N(1));
}

static void test_offset_is_added_and_what_is_beyond_the_limit_is_cut_and_told(void)
{
    start_torque();
    set(0, 0x60B2, 0, 2, 50);
    cycle(100, 0);
    TEST_ASSERT_EQUAL_DOUBLE(90, force_N(0));
    TEST_ASSERT_FALSE(status(0, INTERNAL_LIMIT));
    static const int beyond[] = {1000, -1051, 32767, -32768};
    for (int k = 0; k < 4; k++) {
        cycle(beyond[k], 0);
        TEST_ASSERT_EQUAL_DOUBLE(beyond[k] > 0 ? 600 : -600, force_N(0));
        TEST_ASSERT_TRUE(status(0, INTERNAL_LIMIT));
    }
    cycle(-1050, 0);
    TEST_ASSERT_EQUAL_DOUBLE(-600, force_N(0));
    TEST_ASSERT_FALSE(status(0, INTERNAL_LIMIT));
    expect_no_fault();
}

static void test_other_axis_is_held_by_a_law_that_couples_none(void)
{
    static const unsigned laws[][2] = {{0, 0}, {1, 0}, {2, 0}, {3, 3}, {4, 3}};
    for (int k = 0; k < 5; k++) {
        setUp();
        set(0, 0x2000, 1, 1, laws[k][0]);
        start_torque_on(1);
        cycles(30, 200, 0);
        TEST_ASSERT_EQUAL_UINT(laws[k][1], rig_read(&rig, 0x2000, 2));
        TEST_ASSERT_TRUE(mmps(0) > 60);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mm(1));
        rig_controlwords(&rig, RUN | HALT, ENABLE);
        rig_ms(&rig, 400);
        TEST_ASSERT_EQUAL_UINT(laws[k][0], rig_read(&rig, 0x2000, 2));
        TEST_ASSERT_DOUBLE_WITHIN(0.1, 0, mmps(0));
        TEST_ASSERT_DOUBLE_WITHIN(2e-3, 0, mm(1));
        expect_no_fault();
    }
}

static void test_axis_y_alone_is_moved_while_x_jogs(void)
{
    map_set_points(0x6071, 16);
    set(1, 0x60C2, 1, 1, CYCLE_MS);
    rig_enable(&rig);
    mode(0, VELOCITY);
    velocity(0, 20000);
    rig_ms(&rig, 300);
    mode(1, CST);
    cycles(5, 0, 0);
    TEST_ASSERT_TRUE(status(1, FOLLOWS));
    cycles(25, 0, 200);
    TEST_ASSERT_EQUAL_DOUBLE(120, force_N(1));
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 20, mmps(0));
    TEST_ASSERT_TRUE(mmps(1) > 40);
    velocity(0, 0);
    cycles(50, 0, 0);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 0, mmps(0));
    expect_no_fault();
}

static void test_set_point_by_sdo_counts_from_the_next_sync_on(void)
{
    start_torque();
    set(0, 0x6071, 0, 2, 100);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_DOUBLE(0, force_N(0));
    rig_send(&rig, 0x80, 0, no_data);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_DOUBLE(60, force_N(0));
}

/* ---- set-points that do not come ---- */

static void test_lost_set_point_is_bridged(void)
{
    start_torque();
    cycles(10, 100, 0);
    rig_send(&rig, 0x80, 0, no_data);
    rig_ms(&rig, CYCLE_MS);
    TEST_ASSERT_EQUAL_DOUBLE(60, force_N(0));
    cycles(10, 100, 0);
    expect_no_fault();
}

static void test_master_that_falls_silent_is_an_underrun(void)
{
    for (int k = 0; k < 3; k++) {
        setUp();
        start_torque();
        cycles(20, 200, 0);
        if (k == 2) { /* without force, but on its way */
            cycle(0, 0);
        }
        for (int i = 0; k == 1 && i < 10; i++) { /* SYNC goes on */
            rig_send(&rig, 0x80, 0, no_data);
            rig_ms(&rig, CYCLE_MS);
        }
        rig_ms(&rig, k == 1 ? 0 : 6 * CYCLE_MS);
        TEST_ASSERT_TRUE(rig_had_emcy(&rig, UNDERRUN));
        TEST_ASSERT_FALSE(status(0, FOLLOWS));
        expect_stop(UNDERRUN);
    }
}

static void test_silence_at_rest_without_force_is_none(void)
{
    start_torque();
    cycles(5, 0, 0);
    for (int i = 0; i < 50; i++) {
        rig_send(&rig, 0x80, 0, no_data);
        rig_ms(&rig, CYCLE_MS);
    }
    rig_ms(&rig, 500);
    expect_no_fault();
    cycles(5, 0, 0);
    cycles(10, 200, 0);
    TEST_ASSERT_EQUAL_DOUBLE(120, force_N(0));
    expect_no_fault();
}

static void test_set_point_of_before_enabling_or_of_a_halt_does_not_act(void)
{
    set(0, 0x6071, 0, 2, 200);
    start_torque_on(1);
    rig_controlwords(&rig, ENABLE | HALT, ENABLE);
    cycles(5, 200, 0);
    TEST_ASSERT_FALSE(status(0, FOLLOWS));
    rig_controlwords(&rig, ENABLE, ENABLE);
    for (int i = 0; i < 10; i++) {
        rig_send(&rig, 0x80, 0, no_data);
        rig_ms(&rig, CYCLE_MS);
    }
    TEST_ASSERT_FALSE(status(0, FOLLOWS));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mm(0));
    cycle(200, 0);
    cycle(200, 0);
    TEST_ASSERT_EQUAL_DOUBLE(120, force_N(0));
    expect_no_fault();
}

/* ---- limits and faults ---- */

static void test_axis_that_could_not_stop_inside_its_soft_limits_is_stopped_inside_of_them(void)
{
    for (int k = 0; k < 2; k++) {
        setUp();
        set(0, 0x607D, 1, 4, -20000000);
        set(0, 0x607D, 2, 4, 20000000);
        start_torque();
        for (int i = 0; i < 200 && rig.emcy_count == 0; i++) {
            cycle(k == 0 ? 150 : -150, 0);
        }
        expect_stop(RANGE);
        TEST_ASSERT_TRUE(fabs(mm(0)) < 20.001);
        TEST_ASSERT_TRUE(fabs(mm(0)) > 12);
    }
}

static void test_axis_pressed_against_its_soft_limit_stays_within_the_window(void)
{
    set(0, 0x607D, 2, 4, 5000);
    start_torque();
    cycles(100, 77, 0); /* 46.2 N: hardly more than friction */
    expect_stop(RANGE);
    TEST_ASSERT_TRUE(mm(0) < 0.02);
}

static void test_limit_switch_stops_the_axis(void)
{
    start_at(0.19, 0); /* the switch is at 198 mm */
    set(0, 0x607D, 2, 4, 250000000);
    start_torque();
    for (int i = 0; i < 300 && rig.emcy_count == 0; i++) {
        cycle(100, 0);
    }
    expect_stop(SWITCH);
    TEST_ASSERT_TRUE(mm(0) > 198 && mm(0) < 201);
}

static void test_overspeed_cuts_the_power(void)
{
    start_at(-0.14, 0);
    start_torque();
    cycles(60, 1000, 0);
    TEST_ASSERT_EQUAL_HEX16(0x8400, rig.emcy[0]);
    TEST_ASSERT_FALSE(rig.out.enable[0] || rig.out.enable[1]);
}

static void test_encoder_that_stands_while_the_axis_is_pushed_cuts_the_power(void)
{
    start_torque();
    rig.frozen[0] = true;
    rig.frozen_count[0] = 0;
    cycles(20, 600, 0);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x7320));
    TEST_ASSERT_FALSE(rig.out.enable[0] || rig.out.enable[1]);
}

static void test_fault_ends_the_force_at_once(void)
{
    start_torque();
    cycles(20, 200, 0);
    rig.inputs[1] = HAL_STOP;
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(force_N(0) != 120);
    rig_ms(&rig, 300);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x9000));
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 0, mmps(0));
}

/* In the tick, before the background knows. */
static void test_path_stop_ends_the_force_in_the_next_period(void)
{
    start_torque();
    cycles(20, 200, 0);
    rig.busy = true;
    servo_loop_raise(&rig.device.drive.loop, FAULT_UNDERRUN);
    rig_run(&rig, 2);
    TEST_ASSERT_TRUE(force_N(0) != 120);
    rig.busy = false;
    expect_stop(UNDERRUN);
}

static void test_background_that_hangs_ends_the_force(void)
{
    start_torque();
    cycles(20, 200, 0);
    rig.busy = true;
    rig_ms(&rig, CYCLIC_AHEAD + 2);
    TEST_ASSERT_EQUAL_DOUBLE(0, force_N(0));
}

static void test_axis_without_force_can_be_moved_by_hand(void)
{
    start_torque();
    cycles(50, 0, 0);
    rig.plant.vel_mps[0] = 0.02; /* a push */
    cycles(1, 0, 0);
    TEST_ASSERT_EQUAL_DOUBLE(0, force_N(0));
    cycles(50, 0, 0);
    TEST_ASSERT_EQUAL_DOUBLE(0, force_N(0));
    TEST_ASSERT_TRUE(mm(0) > 0.1);
    rig_controlwords(&rig, ENABLE | HALT, ENABLE | HALT);
    const double here = mm(0);
    rig_ms(&rig, 300);
    TEST_ASSERT_DOUBLE_WITHIN(0.015, here, mm(0));
    expect_no_fault();
}

/* In the word by which the force acts */
static void test_bit_that_flips_frees_no_axis(void)
{
    rig_enable(&rig);
    const uint32_t law = rig_read(&rig, 0x2000, 2);
    atomic_store(&rig.device.drive.loop.command.forced, 1u << 5);
    rig_run(&rig, 1);
    TEST_ASSERT_EQUAL_UINT32(0, rig.device.drive.loop.servo.forced);
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_UINT32(law, rig_read(&rig, 0x2000, 2));
    expect_no_fault();
}

/* ---- stops ---- */

static void test_every_stop_is_obeyed(void)
{
    for (unsigned n = 0; n < sizeof axis_stops / sizeof axis_stops[0]; n++) {
        setUp();
        start_torque();
        cycles(40, 200, 150);
        TEST_ASSERT_TRUE(mmps(0) > 80);
        rig_controlwords(&rig, axis_stops[n].word, axis_stops[n].word);
        rig_run(&rig, 2);
        TEST_ASSERT_TRUE(force_N(0) != 120 && force_N(1) != 90);
        cycle(200, 150);
        TEST_ASSERT_FALSE(status(0, FOLLOWS) || status(1, FOLLOWS));
        cycles(100, 200, 150); /* its master goes on all the same */
        rig_expect_states(&rig, axis_stops[n].state, axis_stops[n].state);
        TEST_ASSERT_DOUBLE_WITHIN(0.1, 0, mmps(0));
        TEST_ASSERT_DOUBLE_WITHIN(0.1, 0, mmps(1));
        TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    }
}

static void test_law_takes_over_without_a_jump(void)
{
    start_torque();
    cycles(40, 200, 0);
    rig_controlwords(&rig, RUN | HALT, RUN | HALT);
    rig_run(&rig, 1);
    double before = force_N(0), most = fabs(before - 120), furthest = 0;
    for (int i = 0; i < 4000; i++) {
        rig_run(&rig, 1);
        most = fmax(most, fabs(force_N(0) - before));
        before = force_N(0);
        const double error = (int32_t)rig_read(&rig, 0x60F4, 0) * 1e-3;
        furthest = fmax(furthest, fabs(error));
    }
    TEST_ASSERT_TRUE(most < 30);
    TEST_ASSERT_TRUE(furthest < 150);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 0, mmps(0));
    expect_no_fault();
}

static void test_mode_is_left_at_standstill(void)
{
    start_torque();
    cycles(20, 200, 0);
    set(0, 0x6060, 0, 1, VELOCITY);
    cycles(5, 200, 0);
    TEST_ASSERT_EQUAL_INT(CST, (int8_t)rig_read(&rig, 0x6061, 0));
    for (int i = 0; i < 200 && rig_read(&rig, 0x6061, 0) == CST; i++) {
        cycle(0, 0);
    }
    TEST_ASSERT_EQUAL_INT(VELOCITY, (int8_t)rig_read(&rig, 0x6061, 0));
    velocity(0, 20000);
    rig_ms(&rig, 300);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 20, mmps(0));
    expect_no_fault();
}

static void test_second_axis_is_enabled_while_the_first_one_rests_without_force(void)
{
    start_torque();
    rig_controlwords(&rig, ENABLE, SHUTDOWN);
    cycles(100, 0, 0);
    rig_controlwords(&rig, ENABLE, 0x07);
    rig_controlwords(&rig, ENABLE, ENABLE);
    cycles(10, 0, 0);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    cycles(20, 100, 100);
    TEST_ASSERT_EQUAL_DOUBLE(60, force_N(0));
    TEST_ASSERT_EQUAL_DOUBLE(60, force_N(1));
    expect_no_fault();
}

static void test_reset_forgets_the_force(void)
{
    start_torque();
    cycles(20, 200, 0);
    rig_nmt(&rig, 129);
    rig_ms(&rig, 300);
    rig_enable(&rig);
    rig_ms(&rig, 300);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 0, mmps(0));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_force_is_the_set_point_and_accelerates_the_mass);
    RUN_TEST(test_set_point_acts_from_sync_on);
    RUN_TEST(test_offset_is_added_and_what_is_beyond_the_limit_is_cut_and_told);
    RUN_TEST(test_other_axis_is_held_by_a_law_that_couples_none);
    RUN_TEST(test_axis_y_alone_is_moved_while_x_jogs);
    RUN_TEST(test_set_point_by_sdo_counts_from_the_next_sync_on);
    RUN_TEST(test_lost_set_point_is_bridged);
    RUN_TEST(test_master_that_falls_silent_is_an_underrun);
    RUN_TEST(test_silence_at_rest_without_force_is_none);
    RUN_TEST(test_set_point_of_before_enabling_or_of_a_halt_does_not_act);
    RUN_TEST(test_axis_that_could_not_stop_inside_its_soft_limits_is_stopped_inside_of_them);
    RUN_TEST(test_axis_pressed_against_its_soft_limit_stays_within_the_window);
    RUN_TEST(test_limit_switch_stops_the_axis);
    RUN_TEST(test_overspeed_cuts_the_power);
    RUN_TEST(test_encoder_that_stands_while_the_axis_is_pushed_cuts_the_power);
    RUN_TEST(test_fault_ends_the_force_at_once);
    RUN_TEST(test_path_stop_ends_the_force_in_the_next_period);
    RUN_TEST(test_background_that_hangs_ends_the_force);
    RUN_TEST(test_axis_without_force_can_be_moved_by_hand);
    RUN_TEST(test_bit_that_flips_frees_no_axis);
    RUN_TEST(test_every_stop_is_obeyed);
    RUN_TEST(test_law_takes_over_without_a_jump);
    RUN_TEST(test_mode_is_left_at_standstill);
    RUN_TEST(test_second_axis_is_enabled_while_the_first_one_rests_without_force);
    RUN_TEST(test_reset_forgets_the_force);
    return UNITY_END();
}
