/* SPDX-License-Identifier: Apache-2.0 */
/* Homing on the simulated machine, frame by frame. */
#include <string.h>

#include "test_axis_modes.h"

/* Home axis `axis` and wait, at most `ms` */
static void homing(int axis, int method, unsigned ms)
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
    static const double at_mm[2] = {12.3, -30};
    for (int i = 0; i < 4; i++) {
        const int axis = i % 2, method = 35 + i / 2 * 2;
        start_at(at_mm[0] * 1e-3, at_mm[1] * 1e-3);
        set(axis, 0x607C, 0, 4, 5000000);
        homing(axis, method, 100);
        expect_attained(axis);
        TEST_ASSERT_DOUBLE_WITHIN(0.5e-3, 5.0, reported_mm(axis));
        TEST_ASSERT_DOUBLE_WITHIN(0.5e-3, at_mm[1 - axis], reported_mm(1 - axis));
        const struct servo_loop_command *c = &rig.device.drive.loop.command;
        TEST_ASSERT_INT32_WITHIN(500, (int32_t)((5.0 - at_mm[axis]) * 1e6), atomic_load(&c->origin_nm[axis]));
        TEST_ASSERT_EQUAL_INT32(0, atomic_load(&c->origin_nm[1 - axis]));
    }
}

static void test_homing_sets_bits_10_12_and_13_of_the_statusword_and_no_other(void)
{
    static const struct {
        enum homing_state state;
        unsigned moving, standing;
    } bits[] = {{HOMING_NONE, 0, 1u << TARGET_REACHED},
                {HOMING_BEGIN, 0, 0},
                {HOMING_FOUND, 0, 0},
                {HOMING_DONE, 1u << ATTAINED | 1u << TARGET_REACHED, 1u << ATTAINED | 1u << TARGET_REACHED},
                {HOMING_FAILING, 1u << HOMING_ERROR, 1u << HOMING_ERROR},
                {HOMING_FAILED, 1u << HOMING_ERROR, 1u << HOMING_ERROR | 1u << TARGET_REACHED}};
    for (unsigned i = 0; i < sizeof bits / sizeof bits[0]; i++) {
        struct axis_modes m = {.generating = false};
        m.axis[1].mode = MODE_HOMING;
        m.axis[1].homing.state = bits[i].state;
        TEST_ASSERT_EQUAL_HEX(bits[i].moving, axis_modes_status(&m, 1, 0, false));
        TEST_ASSERT_EQUAL_HEX(bits[i].standing, axis_modes_status(&m, 1, 0, true));
    }
}

static void test_homing_speeds_up_with_its_own_acceleration(void)
{
    for (int axis = 0; axis < 2; axis++) {
        start_at(0.05, 0.05);
        set(axis, 0x609A, 0, 4, 40000); /* 40 mm/s2 */
        set(axis, 0x6099, 1, 4, 20000);
        set(axis, 0x6098, 0, 1, 17);
        rig_enable(&rig);
        mode(axis, HOMING);
        rig_controlwords(&rig, axis == 0 ? RUN : ENABLE, axis == 1 ? RUN : ENABLE);
        rig_ms(&rig, 300); /* of 500 */
        TEST_ASSERT_DOUBLE_WITHIN(2, -40 * 0.3, mmps(axis));
        rig_ms(&rig, 400);
        TEST_ASSERT_DOUBLE_WITHIN(0.2, -20, mmps(axis));
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
    enum { PERIODS = 400 };
    static int32_t force_mN[PERIODS][2];
    enable_for_homing();
    rig_controlwords(&rig, ENABLE, ENABLE); /* no axis is homed here */
    for (int i = 0; i < PERIODS; i++) {
        rig_run(&rig, 1);
        memcpy(force_mN[i], rig.out.force_mN, sizeof force_mN[i]);
    }
    enable_for_homing();
    rig_controlwords(&rig, RUN, ENABLE);
    for (int i = 0; i < PERIODS; i++) {
        rig_run(&rig, 1);
        TEST_ASSERT_EQUAL_INT32(force_mN[i][0], rig.out.force_mN[0]);
        TEST_ASSERT_EQUAL_INT32(force_mN[i][1], rig.out.force_mN[1]);
    }
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.5e-3, -120.0, reported_mm(0));
}

static void test_homed_axis_follows_streams_and_limits_in_its_new_positions(void)
{
    struct rig_stream s = {.count = 1500, .length_nm = 50e6};
    start_at(0.05, 0.02);
    set(0, 0x607C, 0, 4, 100000000); /* 100 mm; limits at 150 */
    homing(0, 37, 100);
    mode(0, PATH);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_go(&rig, &s, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, rig_read(&rig, 0x2200, 5));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 50 + 40, mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 20 + 30, mm(1));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 140, reported_mm(0));
    rig_controlwords(&rig, ENABLE, ENABLE);
    mode(0, VELOCITY);
    velocity(0, 50000);
    rig_ms(&rig, 1000);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 150, reported_mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 100, mm(0));
}

static void test_home_point_of_a_limit_switch_is_where_it_opens(void)
{
    for (int max = 0; max < 2; max++) {
        for (int axis = 0; axis < 2; axis++) {
            const double where = max ? 0.19 : -0.19;
            start_at(axis == 0 ? where : 0, axis == 1 ? where : 0);
            homing(axis, 17 + max, 3000);
            expect_attained(axis);
            /* the axis stands where it stopped; 0 is the edge of the switch at 198 mm, to half a count and a period */
            TEST_ASSERT_DOUBLE_WITHIN(0.4e-3, mm(axis) - (max ? 198 : -198), reported_mm(axis));
            TEST_ASSERT_TRUE(max ? reported_mm(axis) < 0 : reported_mm(axis) > 0); /* off the switch */
        }
    }
}

/* With a map of the screw the home point is where the encoder has 607Ch, so that it is the same each time. There the axis is
 * at 607Ch and the error of the map. */
static void test_home_point_is_the_same_each_time_with_a_map_of_the_screw(void)
{
    start_at(0.0123, 0);
    set(0, 0x2108, 2, 4, -200000000); /* -200 to 200 mm: 0.5 um/mm */
    set(0, 0x2108, 3, 4, 400000000);
    set(0, 0x2109, 1, 4, -100000);
    set(0, 0x2109, 2, 4, 100000);
    set(0, 0x2108, 1, 1, 2);
    set(0, 0x607C, 0, 4, 80000000); /* 40 um there */
    homing(0, 33, 3000);
    for (int k = 0; k < 3; k++) {
        expect_attained(0);
        rig_ms(&rig, 1000); /* the map by the new position takes effect at 0.2 mm/s */
        const double encoder_mm = mm(0) - (10 - 10 * k) + 80;
        TEST_ASSERT_DOUBLE_WITHIN(0.3e-3, encoder_mm + 0.5e-3 * encoder_mm, reported_mm(0));
        rig_controlwords(&rig, ENABLE, ENABLE); /* and to the next pulse */
        rig_ms(&rig, 10);
        rig_controlwords(&rig, RUN, ENABLE);
        rig_ms(&rig, 8000);
    }
}

static void test_axis_that_is_on_the_switch_leaves_it_first(void)
{
    start_at(-0.199, 0);
    set(0, 0x607C, 0, 4, -195000000);
    homing(0, 17, 3000);
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.4e-3, mm(0) + 198 - 195, reported_mm(0));
}

static void test_home_point_of_switch_and_index_is_the_first_pulse_off_the_switch(void)
{
    start_at(-0.19, 0);
    homing(0, 1, 8000);
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.2e-3, mm(0) + 190, reported_mm(0));
    start_at(0, 0.193);
    homing(1, 2, 8000);
    expect_attained(1);
    TEST_ASSERT_DOUBLE_WITHIN(0.2e-3, mm(1) - 190, reported_mm(1));
}

static void test_next_index_pulse_is_found_in_either_direction(void)
{
    start_at(0.0123, 0);
    homing(0, 33, 3000);
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.2e-3, mm(0) - 10, reported_mm(0));
    start_at(0.0123, 0);
    homing(0, 34, 6000);
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.2e-3, mm(0) - 20, reported_mm(0));
}

static void test_switch_may_lie_beyond_the_soft_limits_and_the_axis_comes_back_from_there(void)
{
    start_at(-0.14, 0); /* soft limits at 150, the switch at 198 mm */
    set(0, 0x607C, 0, 4, -198000000);
    homing(0, 17, 8000);
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, mm(0), reported_mm(0));
    rig_controlwords(&rig, ENABLE, ENABLE);
    mode(0, VELOCITY);
    velocity(0, -50000);
    rig_ms(&rig, 100);
    TEST_ASSERT_TRUE(status(0, SPEED_0));
    velocity(0, 100000);
    rig_ms(&rig, 1500);
    TEST_ASSERT_TRUE(reported_mm(0) > -100);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_both_switches_active_is_a_homing_error(void)
{
    rig.inputs[0] = HAL_LIMIT_MIN | HAL_LIMIT_MAX;
    homing(0, 17, 100);
    expect_error(0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mm(0));
}

static void test_switch_that_is_not_found_within_the_travel_is_a_homing_error(void)
{
    set(0, 0x607D, 1, 4, -3000000);
    set(0, 0x607D, 2, 4, 3000000);
    homing(0, 17, 3000);
    expect_error(0);
    TEST_ASSERT_DOUBLE_WITHIN(1.5, -6, mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, mm(0), reported_mm(0)); /* nothing was shifted */
}

static void test_search_for_the_index_ends_at_a_limit_switch(void)
{
    start_at(0.195, 0); /* next pulse upwards: 200 mm, where the table ends */
    homing(0, 34, 8000);
    expect_error(0);
}

static void test_homing_is_interrupted_when_bit_4_goes_and_begins_anew_with_its_edge(void)
{
    start_at(-0.15, 0);
    homing(0, 17, 300);
    TEST_ASSERT_FALSE(status(0, TARGET_REACHED));
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 300);
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED));
    TEST_ASSERT_FALSE(status(0, ATTAINED) || status(0, HOMING_ERROR));
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, mm(0), reported_mm(0));
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 5000);
    expect_attained(0);
}

static void test_halt_ends_homing_until_the_next_edge(void)
{
    start_at(-0.15, 0);
    homing(0, 17, 300);
    rig_controlwords(&rig, RUN | HALT, ENABLE);
    rig_ms(&rig, 300);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 100);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
}

/* The next homing of axis x, by the edge of bit 4: TPDO1 shows twice or more that the last result is gone. */
static void expect_result_gone(void)
{
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    const unsigned before = rig.status_count;
    rig_controlwords(&rig, RUN, ENABLE);
    TEST_ASSERT_BITS(1u << TARGET_REACHED | 1u << ATTAINED | 1u << HOMING_ERROR, 0, rig_read(&rig, 0x6041, 0));
    rig_ms(&rig, 20);
    TEST_ASSERT_FALSE(status(0, ATTAINED) || status(0, HOMING_ERROR) || status(0, TARGET_REACHED));
    TEST_ASSERT_GREATER_OR_EQUAL_UINT(before + 2, rig.status_count);
}

static void test_homing_again_shows_that_the_result_before_is_gone(void)
{
    start_at(-0.19, 0);
    homing(0, 37, 100);
    expect_attained(0);
    expect_result_gone(); /* it finds its home where it stands */
    rig_ms(&rig, 20);
    expect_attained(0);
    rig_controlwords(&rig, 0, 0); /* another method and offset, in the same mode */
    rig_ms(&rig, 2);
    set(0, 0x6098, 0, 1, 17);
    set(0, 0x607C, 0, 4, -150000000);
    rig_enable(&rig);
    expect_result_gone();
    rig_ms(&rig, 4000);
    expect_attained(0);
    TEST_ASSERT_DOUBLE_WITHIN(0.4e-3, mm(0) + 198 - 150, reported_mm(0));
}

static void test_homing_that_fails_again_shows_that_the_error_before_is_gone(void)
{
    rig.inputs[0] = HAL_LIMIT_MIN | HAL_LIMIT_MAX;
    homing(0, 17, 100);
    expect_error(0);
    expect_result_gone();
    rig_ms(&rig, 20);
    expect_error(0);
}

static void test_result_of_a_homing_ends_when_its_mode_is_left(void)
{
    homing(0, 37, 100);
    expect_attained(0);
    mode(0, PATH);
    mode(0, HOMING);
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED)); /* not started */
    TEST_ASSERT_FALSE(status(0, ATTAINED) || status(0, HOMING_ERROR));
}

static void test_result_of_a_homing_ends_with_the_next_start_on_halt_too(void)
{
    homing(0, 37, 100);
    expect_attained(0);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    expect_attained(0);
    rig_controlwords(&rig, RUN | 0x100, ENABLE);
    rig_ms(&rig, 50);
    TEST_ASSERT_FALSE(status(0, ATTAINED) || status(0, HOMING_ERROR));
}

static void test_result_of_a_homing_ends_when_the_axis_loses_its_power(void)
{
    homing(0, 37, 100);
    expect_attained(0);
    rig_controlwords(&rig, SHUTDOWN, ENABLE);
    rig_ms(&rig, 2);
    TEST_ASSERT_FALSE(status(0, ATTAINED) || status(0, HOMING_ERROR));
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_FALSE(status(0, ATTAINED) || status(0, HOMING_ERROR));
}

/* Power comes with bit 4 set already: nothing starts, and nothing is attained. */
static void test_start_that_comes_before_power_attains_nothing(void)
{
    homing(0, 37, 100);
    expect_attained(0);
    rig_controlwords(&rig, SHUTDOWN, ENABLE);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_READY, RIG_ENABLED);
    rig_controlwords(&rig, SHUTDOWN | 0x10, ENABLE);
    rig_controlwords(&rig, 0x17, ENABLE);
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 50);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_FALSE(status(0, ATTAINED) || status(0, HOMING_ERROR));
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
    TEST_ASSERT_DOUBLE_WITHIN(0.4e-3, mm(0) + 198, reported_mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(0.4e-3, mm(1) - 198, reported_mm(1));
}

static void test_homing_that_loses_its_power_does_not_go_on_by_itself(void)
{
    start_at(-0.15, 0);
    homing(0, 17, 300);
    rig_controlwords(&rig, 0, ENABLE); /* disable voltage */
    rig_ms(&rig, 300);
    rig_expect_states(&rig, RIG_DISABLED, RIG_ENABLED);
    rig_controlwords(&rig, 0x16, ENABLE); /* and on again, with bit 4 set all the time */
    rig_controlwords(&rig, 0x17, ENABLE);
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    const double at = mm(0);
    rig_ms(&rig, 300);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, at, mm(0));
    TEST_ASSERT_FALSE(status(0, ATTAINED) || status(0, HOMING_ERROR));
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 5000);
    expect_attained(0);
}

static void test_mode_that_is_written_while_an_axis_homes_is_taken_when_it_has_its_home(void)
{
    start_at(-0.19, 0);
    set(0, 0x6098, 0, 1, 17);
    rig_enable(&rig);
    mode(0, HOMING);
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6060, 0, 1, VELOCITY));
    bool attained = false;
    for (int i = 0; i < 3000 && rig_read(&rig, 0x6061, 0) == HOMING; i++) {
        attained = status(0, ATTAINED);
        rig_ms(&rig, 1);
    }
    TEST_ASSERT_TRUE(attained);
    TEST_ASSERT_EQUAL(VELOCITY, rig_read(&rig, 0x6061, 0));
    TEST_ASSERT_DOUBLE_WITHIN(0.4e-3, mm(0) + 198, reported_mm(0)); /* 0 is the edge of the switch at 198 mm */
}

static void test_node_that_is_reset_while_an_axis_homes_has_not_started_to(void)
{
    start_at(-0.15, 0);
    homing(0, 17, 300);
    rig_nmt(&rig, 129);
    rig_ms(&rig, 300);
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, ENABLE); /* mode 7 is that of a reset */
    mode(0, HOMING);
    const double at = mm(0);
    rig_ms(&rig, 300);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, at, mm(0));
    TEST_ASSERT_FALSE(status(0, ATTAINED) || status(0, HOMING_ERROR));
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED));
}

static void test_home_point_that_puts_the_origin_out_of_range_is_a_homing_error(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        start_at(-sign * 0.19, 0); /* 2000 mm + 190 mm: more than 2147 */
        set(0, 0x607C, 0, 4, sign * 2000000000LL);
        homing(0, 37, 100);
        expect_error(0);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, -sign * 190, reported_mm(0)); /* nothing was shifted */
        start_at(-sign * 0.12, 0);
        set(0, 0x607C, 0, 4, sign * 2000000000LL);
        homing(0, 37, 100);
        expect_attained(0);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, sign * 2000, reported_mm(0));
    }
}

#ifndef KONTUR_NUM_CHK /* a path that ends on its way has derivatives out of the range of num */
static void test_search_that_leads_out_of_the_range_of_positions_stops_with_a_fault(void)
{
    struct ks_machine machine = rig_machine();
    machine.travel_min_m[0] = -2.0;
    machine.start_m[0] = -1.99;
    rig_start(&rig, &machine);
    set(0, 0x2100, 5, 4, 8200000); /* counts of 82 nm, not 76: the drive takes that for -2139 mm */
    homing(0, 37, 100);
    expect_attained(0);
    rig_controlwords(&rig, 0, 0);
    set(0, 0x6098, 0, 1, 17);
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 3000);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF11));
    TEST_ASSERT_DOUBLE_WITHIN(0.2, -2147.48 / 82 * 76.29, mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
}
#endif

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_current_position_becomes_the_home_offset);
    RUN_TEST(test_homing_sets_bits_10_12_and_13_of_the_statusword_and_no_other);
    RUN_TEST(test_homing_speeds_up_with_its_own_acceleration);
    RUN_TEST(test_origin_is_shifted_without_a_force_on_any_axis);
    RUN_TEST(test_homed_axis_follows_streams_and_limits_in_its_new_positions);
    RUN_TEST(test_home_point_of_a_limit_switch_is_where_it_opens);
    RUN_TEST(test_home_point_is_the_same_each_time_with_a_map_of_the_screw);
    RUN_TEST(test_axis_that_is_on_the_switch_leaves_it_first);
    RUN_TEST(test_home_point_of_switch_and_index_is_the_first_pulse_off_the_switch);
    RUN_TEST(test_next_index_pulse_is_found_in_either_direction);
    RUN_TEST(test_switch_may_lie_beyond_the_soft_limits_and_the_axis_comes_back_from_there);
    RUN_TEST(test_both_switches_active_is_a_homing_error);
    RUN_TEST(test_switch_that_is_not_found_within_the_travel_is_a_homing_error);
    RUN_TEST(test_search_for_the_index_ends_at_a_limit_switch);
    RUN_TEST(test_homing_is_interrupted_when_bit_4_goes_and_begins_anew_with_its_edge);
    RUN_TEST(test_halt_ends_homing_until_the_next_edge);
    RUN_TEST(test_homing_again_shows_that_the_result_before_is_gone);
    RUN_TEST(test_homing_that_fails_again_shows_that_the_error_before_is_gone);
    RUN_TEST(test_result_of_a_homing_ends_when_its_mode_is_left);
    RUN_TEST(test_result_of_a_homing_ends_with_the_next_start_on_halt_too);
    RUN_TEST(test_result_of_a_homing_ends_when_the_axis_loses_its_power);
    RUN_TEST(test_start_that_comes_before_power_attains_nothing);
    RUN_TEST(test_both_axes_home_at_once);
    RUN_TEST(test_homing_that_loses_its_power_does_not_go_on_by_itself);
    RUN_TEST(test_mode_that_is_written_while_an_axis_homes_is_taken_when_it_has_its_home);
    RUN_TEST(test_node_that_is_reset_while_an_axis_homes_has_not_started_to);
    RUN_TEST(test_home_point_that_puts_the_origin_out_of_range_is_a_homing_error);
#ifndef KONTUR_NUM_CHK
    RUN_TEST(test_search_that_leads_out_of_the_range_of_positions_stops_with_a_fault);
#endif
    return UNITY_END();
}
