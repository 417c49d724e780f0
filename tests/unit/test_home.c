/* SPDX-License-Identifier: Apache-2.0 */
/* Homing of one axis by what it is told of it. On the simulated machine: test_homing.c. */
#include "home.h"

#include "hal.h"
#include "unity.h"

enum { SEARCH = 20000, ZERO = 2000 };

static struct home home;
static struct home_in in;

void setUp(void)
{
    home = (struct home){0};
    in = (struct home_in){.reach_nm = 1000, .switch_umps = SEARCH, .zero_umps = ZERO};
}

void tearDown(void)
{
}

static void expect_error_at_standstill_only(void)
{
    TEST_ASSERT_EQUAL_INT32(0, home_step(&home, &in));
    TEST_ASSERT_EQUAL(HOME_FAILING, home.state);
    TEST_ASSERT_TRUE(home_busy(&home));
    in.resting = true;
    TEST_ASSERT_EQUAL_INT32(0, home_step(&home, &in));
    TEST_ASSERT_EQUAL(HOME_FAILED, home.state);
    TEST_ASSERT_FALSE(home_busy(&home));
}

static void test_method_that_there_is_not_is_an_error_and_moves_nothing(void)
{
    home_start(&home, 3, &in);
    expect_error_at_standstill_only();
}

static void test_both_switches_on_while_it_searches_is_an_error(void)
{
    home_start(&home, 17, &in);
    TEST_ASSERT_EQUAL_INT32(-SEARCH, home_step(&home, &in));
    in.inputs = HAL_LIMIT_MIN | HAL_LIMIT_MAX;
    expect_error_at_standstill_only();
}

static void test_search_reaches_as_far_as_it_may_in_either_direction_and_no_further(void)
{
    for (int dir = -1; dir <= 1; dir += 2) {
        setUp();
        in.position_nm = 50;
        home_start(&home, dir < 0 ? 33 : 34, &in);
        in.position_nm = 50 + dir * 1000;
        TEST_ASSERT_EQUAL_INT32(dir * ZERO, home_step(&home, &in));
        in.position_nm += dir;
        expect_error_at_standstill_only();
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_method_that_there_is_not_is_an_error_and_moves_nothing);
    RUN_TEST(test_both_switches_on_while_it_searches_is_an_error);
    RUN_TEST(test_search_reaches_as_far_as_it_may_in_either_direction_and_no_further);
    return UNITY_END();
}
