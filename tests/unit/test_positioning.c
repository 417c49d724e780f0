/* SPDX-License-Identifier: Apache-2.0 */
/* Profile position (mode 1) over the bus: the whole firmware on a simulated machine. */
#include <math.h>

#include "test_axis_modes.h"

enum { POSITION = 1, ACKNOWLEDGED = 12, FOLLOWING = 13 };
enum { NEW = 1 << 4, AT_ONCE = 1 << 5, RELATIVE = 1 << 6 };

static uint16_t words[2];

static void word(int axis, unsigned bits)
{
    words[axis] = (uint16_t)(ENABLE | bits);
    rig_controlwords(&rig, words[0], words[1]);
}

/* Give a set-point as a function block does: the edge, and then without it. */
static void go(int axis, int32_t nm, unsigned bits)
{
    set(axis, 0x607A, 0, 4, nm);
    word(axis, NEW | bits);
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(status(axis, ACKNOWLEDGED));
    word(axis, bits);
    rig_ms(&rig, 2);
}

static void start_positioning(void)
{
    words[0] = words[1] = ENABLE;
    rig_enable(&rig);
    mode(0, POSITION);
    mode(1, POSITION);
}

static void expect_at(int axis, double at_mm)
{
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, at_mm, mm(axis));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, at_mm, (int32_t)rig_read(&rig, (uint16_t)(0x6062 + 0x800 * axis), 0) * 1e-6);
    TEST_ASSERT_TRUE(status(axis, TARGET_REACHED));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_axis_moves_to_its_target_with_its_velocity_and_ramps(void)
{
    start_positioning();
    set(0, 0x6081, 0, 4, 50000);
    set(0, 0x6083, 0, 4, 500000);
    set(0, 0x6084, 0, 4, 250000);
    go(0, 20000000, 0);
    TEST_ASSERT_FALSE(status(0, ACKNOWLEDGED));
    TEST_ASSERT_TRUE(status(1, TARGET_REACHED));
    double fastest = 0, hardest = 0, before = 0;
    unsigned ms = 0;
    for (; !status(0, TARGET_REACHED) && ms < 2000; ms++) {
        rig_ms(&rig, 1);
        fastest = fmax(fastest, mmps(0));
        hardest = fmax(hardest, fabs(mmps(0) - before));
        before = mmps(0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 50, fastest);
    TEST_ASSERT_TRUE(hardest < 0.55);       /* mm/s in a ms: m/s2 */
    TEST_ASSERT_TRUE(ms > 500 && ms < 720); /* 400 + 50 + 100 of the ramps, and 50 of the mean */
    rig_ms(&rig, 50);
    expect_at(0, 20);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mm(1));
}

static void test_both_axes_move_independently_and_back(void)
{
    start_positioning();
    set(1, 0x6081, 0, 4, 40000);
    go(0, 3000000, 0);
    go(1, -5000000, 0);
    rig_ms(&rig, 600);
    expect_at(0, 3);
    expect_at(1, -5);
    go(0, -1234567, 0);
    rig_ms(&rig, 600);
    expect_at(0, -1.234567);
    expect_at(1, -5);
}

static void test_next_set_point_waits_and_a_third_one_is_not_taken(void)
{
    start_positioning();
    go(0, 4000000, 0);
    rig_ms(&rig, 20);
    set(0, 0x607A, 0, 4, 2000000);
    word(0, NEW);
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(status(0, ACKNOWLEDGED));
    word(0, 0);
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(status(0, ACKNOWLEDGED)); /* the buffer is full */
    set(0, 0x607A, 0, 4, 9000000);
    word(0, NEW);
    rig_ms(&rig, 2);
    word(0, 0);
    double furthest = 0;
    for (int i = 0; i < 700; i++) {
        rig_ms(&rig, 1);
        furthest = fmax(furthest, mm(0));
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 4, furthest);
    TEST_ASSERT_FALSE(status(0, ACKNOWLEDGED));
    expect_at(0, 2);
}

static void test_set_point_at_once_takes_the_place_of_all_others(void)
{
    start_positioning();
    go(0, 50000000, 0);
    rig_ms(&rig, 200);
    set(0, 0x607A, 0, 4, 60000000);
    word(0, NEW);
    rig_ms(&rig, 2);
    word(0, 0);
    rig_ms(&rig, 2);
    TEST_ASSERT_DOUBLE_WITHIN(0.5, 20, mmps(0));
    set(0, 0x6081, 0, 4, 60000);
    go(0, -1000000, AT_ONCE);
    TEST_ASSERT_FALSE(status(0, TARGET_REACHED));
    rig_ms(&rig, 800);
    expect_at(0, -1);
}

static void test_set_point_at_once_just_ahead_is_passed_and_come_back_to(void)
{
    start_positioning();
    set(0, 0x6081, 0, 4, 100000);
    go(0, 50000000, 0);
    rig_ms(&rig, 300);
    const double here = mm(0);
    go(0, (int32_t)(here * 1e6) + 1000000, AT_ONCE);
    rig_ms(&rig, 100);
    TEST_ASSERT_TRUE(mm(0) > here + 1.1);
    rig_ms(&rig, 700);
    expect_at(0, here + 1);
}

static void test_relative_set_points_count_from_the_target_before(void)
{
    start_positioning();
    go(0, 1000000, RELATIVE);
    go(0, 1000000, RELATIVE); /* waits */
    rig_ms(&rig, 600);
    expect_at(0, 2);
    go(0, -500000, RELATIVE);
    rig_ms(&rig, 20);
    go(0, -500000, RELATIVE | AT_ONCE);
    rig_ms(&rig, 600);
    expect_at(0, 1);
    go(0, 4000000, RELATIVE);
    rig_ms(&rig, 20);
    go(0, 1000000, RELATIVE); /* waits */
    set(0, 0x607A, 0, 4, 2000000);
    word(0, NEW | RELATIVE | AT_ONCE); /* counts from what waited */
    rig_ms(&rig, 900);
    word(0, 0);
    rig_ms(&rig, 2);
    expect_at(0, 8);
}

static void test_relative_target_ends_where_positions_end(void)
{
    for (int k = 0; k < 2; k++) {
        setUp();
        start_positioning();
        set(0, 0x607D, 1, 4, -5000000);
        set(0, 0x607D, 2, 4, 5000000);
        go(0, k == 0 ? 1000000 : -1000000, 0);
        rig_ms(&rig, 400);
        go(0, k == 0 ? INT32_MAX : INT32_MIN, RELATIVE);
        rig_ms(&rig, 600);
        TEST_ASSERT_TRUE(status(0, INTERNAL_LIMIT));
        expect_at(0, k == 0 ? 5 : -5);
    }
}

static void test_halt_interrupts_a_movement_which_then_goes_on(void)
{
    start_positioning();
    go(0, 10000000, 0);
    rig_ms(&rig, 200);
    word(0, HALT);
    rig_ms(&rig, 200);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mmps(0));
    TEST_ASSERT_TRUE(status(0, TARGET_REACHED)); /* stands */
    TEST_ASSERT_TRUE(mm(0) > 2 && mm(0) < 6);
    word(0, 0);
    rig_ms(&rig, 3);
    TEST_ASSERT_FALSE(status(0, TARGET_REACHED));
    rig_ms(&rig, 700);
    expect_at(0, 10);
}

static void test_stop_ends_a_movement_for_good(void)
{
    static const uint16_t stops[] = {QUICK_STOP, SHUTDOWN, 0x07, 0};
    for (unsigned n = 0; n < 4; n++) {
        setUp();
        start_positioning();
        go(0, 10000000, 0);
        go(0, 20000000, 0);
        rig_ms(&rig, 200);
        rig_controlwords(&rig, stops[n], stops[n]);
        rig_ms(&rig, 300);
        TEST_ASSERT_NOT_EQUAL(RIG_ENABLED, rig_state(&rig, 0));
        const double here = mm(0);
        TEST_ASSERT_TRUE(here < 8);
        rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
        rig_controlwords(&rig, 0x07, 0x07);
        rig_controlwords(&rig, ENABLE, ENABLE);
        rig_ms(&rig, 300);
        rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, here, mm(0));
        TEST_ASSERT_TRUE(status(0, TARGET_REACHED));
    }
}

static void test_target_is_reached_after_the_time_in_the_window(void)
{
    start_positioning();
    set(0, 0x6068, 0, 2, 200);
    go(0, 1000000, 0);
    unsigned stood = 0;
    for (int i = 0; i < 1000 && !status(0, TARGET_REACHED); i++) {
        rig_ms(&rig, 1);
        stood += fabs(mm(0) - 1) < 2e-3 ? 1 : 0;
    }
    TEST_ASSERT_TRUE(stood >= 200 && stood < 300);
    expect_at(0, 1);
    rig.plant.pos_m[0] += 20e-6; /* pushed out of the window */
    rig_ms(&rig, 2);
    TEST_ASSERT_FALSE(status(0, TARGET_REACHED));
    rig.plant.pos_m[0] -= 40e-6;
    rig_ms(&rig, 1);
    TEST_ASSERT_FALSE(status(0, TARGET_REACHED));
}

static void test_velocity_is_the_least_of_what_is_set_and_zero_waits(void)
{
    start_positioning();
    set(0, 0x6081, 0, 4, 90000);
    set(0, 0x607F, 0, 4, 30000);
    go(0, 20000000, 0);
    rig_ms(&rig, 300);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 30, mmps(0));
    set(0, 0x6081, 0, 4, 0);
    go(0, 0, AT_ONCE);
    rig_ms(&rig, 300);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    TEST_ASSERT_FALSE(status(0, TARGET_REACHED));
    set(0, 0x607F, 0, 4, 1000000);
    set(0, 0x6081, 0, 4, 700000); /* beyond nine tenths of 2130h, which bit 11 says */
    go(0, 130000000, AT_ONCE);
    rig_ms(&rig, 250);
    TEST_ASSERT_TRUE(status(0, INTERNAL_LIMIT));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_values_that_would_lie_are_refused(void)
{
    TEST_ASSERT_EQUAL_HEX32(0x06090031, rig_write(&rig, 0x6082, 0, 4, 1000));
    TEST_ASSERT_EQUAL_HEX32(0x06090032, rig_write(&rig, 0x6086, 0, 2, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6886, 0, 2, 3));
}

static void test_following_error_is_bit_13(void)
{
    start_positioning();
    set(0, 0x6065, 0, 4, 30000);
    TEST_ASSERT_FALSE(status(0, FOLLOWING));
    rig.device.od.axis[0].following_error = 30001;
    drive_step(&rig.device.drive, &(struct drive_in){0});
    TEST_ASSERT_BITS_HIGH(1 << FOLLOWING, rig.device.od.axis[0].statusword);
    TEST_ASSERT_BITS_LOW(1 << FOLLOWING, rig.device.od.axis[1].statusword);
    rig.device.od.axis[0].following_error = -30001;
    drive_step(&rig.device.drive, &(struct drive_in){0});
    TEST_ASSERT_BITS_HIGH(1 << FOLLOWING, rig.device.od.axis[0].statusword);
    mode(0, VELOCITY);
    rig.device.od.axis[0].following_error = -30001;
    drive_step(&rig.device.drive, &(struct drive_in){0});
    TEST_ASSERT_BITS_LOW(1 << FOLLOWING, rig.device.od.axis[0].statusword);
    mode(0, 8);
    rig.device.od.axis[0].following_error = -30001;
    drive_step(&rig.device.drive, &(struct drive_in){0});
    TEST_ASSERT_BITS_HIGH(1 << FOLLOWING, rig.device.od.axis[0].statusword);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_axis_moves_to_its_target_with_its_velocity_and_ramps);
    RUN_TEST(test_both_axes_move_independently_and_back);
    RUN_TEST(test_next_set_point_waits_and_a_third_one_is_not_taken);
    RUN_TEST(test_set_point_at_once_takes_the_place_of_all_others);
    RUN_TEST(test_set_point_at_once_just_ahead_is_passed_and_come_back_to);
    RUN_TEST(test_relative_set_points_count_from_the_target_before);
    RUN_TEST(test_relative_target_ends_where_positions_end);
    RUN_TEST(test_halt_interrupts_a_movement_which_then_goes_on);
    RUN_TEST(test_stop_ends_a_movement_for_good);
    RUN_TEST(test_target_is_reached_after_the_time_in_the_window);
    RUN_TEST(test_velocity_is_the_least_of_what_is_set_and_zero_waits);
    RUN_TEST(test_values_that_would_lie_are_refused);
    RUN_TEST(test_following_error_is_bit_13);
    return UNITY_END();
}
