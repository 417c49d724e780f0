/* SPDX-License-Identifier: Apache-2.0 */
/* The way of a jogged axis, knot by knot: speed, acceleration and jerk are what was asked for, and it ends where it must. */
#include <stdlib.h>

#include "motion/profile.h"
#include "unity.h"

enum { UP = 1000000, DOWN = 2000000, SPEED = 100000 }; /* 1 and 2 m/s2, 100 mm/s */

static struct profile profile;
static struct profile_in in;
static int64_t last[4]; /* knots */
static int64_t steepest_um_s2, sharpest_um_s3;

void setUp(void)
{
    in = (struct profile_in){.up_umps2 = UP, .down_umps2 = DOWN, .min_nm = -150000000, .max_nm = 150000000};
    profile_start(&profile, 0);
    for (int i = 0; i < 4; i++) {
        last[i] = 0;
    }
    steepest_um_s2 = sharpest_um_s3 = 0;
}

void tearDown(void)
{
}

static int64_t larger(int64_t a, int64_t b)
{
    return a > b ? a : b;
}

/* nm a ms is um/s; its differences are 1000 um/s2 and 1e6 um/s3 */
static void step(void)
{
    for (int i = 3; i > 0; i--) {
        last[i] = last[i - 1];
    }
    last[0] = profile_step(&profile, &in);
    steepest_um_s2 = larger(steepest_um_s2, 1000 * llabs(last[0] - 2 * last[1] + last[2]));
    sharpest_um_s3 = larger(sharpest_um_s3, 1000000 * llabs(last[0] - 3 * last[1] + 3 * last[2] - last[3]));
}

static void run(unsigned ms)
{
    for (unsigned i = 0; i < ms; i++) {
        step();
    }
}

static void test_speed_ramps_to_its_target_and_stays_there(void)
{
    in.target_umps = SPEED;
    run(99); /* 100 ms at 1 m/s2 */
    TEST_ASSERT_FALSE(profile_reached(&profile, SPEED));
    run(PROFILE_SETTLE);
    TEST_ASSERT_FALSE(profile_reached(&profile, SPEED));
    run(1);
    TEST_ASSERT_TRUE(profile_reached(&profile, SPEED));
    for (int i = 0; i < 100; i++) {
        step();
        TEST_ASSERT_EQUAL_INT64(SPEED, last[0] - last[1]);
    }
}

static void test_acceleration_and_jerk_are_bounded(void)
{
    in.target_umps = SPEED;
    run(300);
    TEST_ASSERT_INT64_WITHIN(3000, UP, steepest_um_s2); /* knots are whole nm: 3 of them in a second difference */
    TEST_ASSERT_TRUE(sharpest_um_s3 <= UP / PROFILE_ROUND * 1000 + 6000000);
    steepest_um_s2 = 0;
    in.target_umps = -SPEED;
    run(400);
    TEST_ASSERT_INT64_WITHIN(3000, DOWN, steepest_um_s2);
    TEST_ASSERT_TRUE(sharpest_um_s3 <= DOWN / PROFILE_ROUND * 1000 + 6000000);
    TEST_ASSERT_EQUAL_INT64(-SPEED, last[0] - last[1]);
}

static void test_stop_ends_where_its_ramp_does(void)
{
    in.target_umps = SPEED;
    run(200);
    in.target_umps = 0;
    const int64_t ramp_pm = profile.pos_pm;
    run(200);
    TEST_ASSERT_TRUE(profile_stands(&profile));
    TEST_ASSERT_TRUE(profile_reached(&profile, 0));
    /* 100 mm/s at 2 m/s2, in steps of a ms: v^2 / 2 a, less half a step */
    TEST_ASSERT_INT64_WITHIN(1, ramp_pm / 1000 + 2500000 - 50000, last[0]);
    TEST_ASSERT_EQUAL_INT64(last[1], last[0]);
}

static void test_way_back_is_the_way_there_mirrored(void)
{
    struct profile mirrored;
    struct profile_in mirrored_in = in;
    profile_start(&mirrored, 0);
    for (int i = 0; i < 2000; i++) {
        in.target_umps = i < 700 ? 77777 : i < 1200 ? -33333 : 0;
        mirrored_in.target_umps = -in.target_umps;
        TEST_ASSERT_EQUAL_INT32(-profile_step(&profile, &in), profile_step(&mirrored, &mirrored_in));
    }
}

static void test_it_ends_exactly_on_a_limit_and_never_beyond(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        for (int32_t limit = 1; limit < 40000000; limit = limit * 3 + 7) {
            setUp();
            in.target_umps = sign * SPEED;
            in.min_nm = -limit;
            in.max_nm = limit;
            for (int i = 0; i < 2000; i++) {
                step();
                TEST_ASSERT_TRUE(last[0] >= -limit && last[0] <= limit);
            }
            TEST_ASSERT_TRUE(steepest_um_s2 <= DOWN + 3000);
            TEST_ASSERT_TRUE(profile_stands(&profile));
            TEST_ASSERT_EQUAL_INT64(sign * limit, last[0]);
        }
    }
}

static void test_it_says_when_a_limit_holds_it_back(void)
{
    in.target_umps = SPEED;
    in.max_nm = 10000000;
    run(100);
    TEST_ASSERT_FALSE(profile.limited);
    run(40);
    TEST_ASSERT_TRUE(profile.limited);
    in.target_umps = -SPEED;
    run(1);
    TEST_ASSERT_FALSE(profile.limited);
}

static void test_axis_outside_its_limits_comes_back_only(void)
{
    profile_start(&profile, 160000000);
    in.target_umps = SPEED;
    run(100);
    TEST_ASSERT_EQUAL_INT64(160000000, last[0]);
    in.target_umps = -SPEED;
    run(500);
    TEST_ASSERT_TRUE(last[0] < 130000000);
}

static void test_nothing_is_lost_over_a_long_way(void)
{
    in.max_nm = 2000000000;
    in.target_umps = 1; /* 1 nm/ms */
    run(100000);
    TEST_ASSERT_INT64_WITHIN(26, 100000, last[0]); /* half of PROFILE_ROUND behind */
    in.target_umps = 0;
    run(100);
    TEST_ASSERT_INT64_WITHIN(1, 100000, last[0]);
}

static void test_extreme_speeds_and_ramps_do_not_overflow(void)
{
    in.min_nm = INT32_MIN;
    in.max_nm = INT32_MAX;
    in.down_umps2 = 1000;
    in.up_umps2 = 100000000;
    in.target_umps = 10000000; /* 10 m/s: 50 km to stop, at 1 mm/s2 */
    profile_start(&profile, INT32_MIN);
    for (int i = 0; i < 100000; i++) {
        const int64_t before = last[0];
        step();
        TEST_ASSERT_TRUE(i == 0 || last[0] >= before);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_speed_ramps_to_its_target_and_stays_there);
    RUN_TEST(test_acceleration_and_jerk_are_bounded);
    RUN_TEST(test_stop_ends_where_its_ramp_does);
    RUN_TEST(test_way_back_is_the_way_there_mirrored);
    RUN_TEST(test_it_ends_exactly_on_a_limit_and_never_beyond);
    RUN_TEST(test_it_says_when_a_limit_holds_it_back);
    RUN_TEST(test_axis_outside_its_limits_comes_back_only);
    RUN_TEST(test_nothing_is_lost_over_a_long_way);
    RUN_TEST(test_extreme_speeds_and_ramps_do_not_overflow);
    return UNITY_END();
}
