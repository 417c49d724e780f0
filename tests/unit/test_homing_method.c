/* SPDX-License-Identifier: Apache-2.0 */
/* Homing of one axis by what it is told of it. On the simulated machine: test_homing.c. */
#include "motion/homing.h"

#include "hal/hal.h"
#include "unity.h"

enum { SEARCH = 20000, ZERO = 2000 };

static struct homing homing;
static struct homing_in in;

void setUp(void)
{
    homing = (struct homing){0};
    in = (struct homing_in){.reach_nm = 1000, .switch_umps = SEARCH, .zero_umps = ZERO};
}

void tearDown(void)
{
}

/* Start, and step up to where the search begins. */
static void start(int8_t method)
{
    homing_start(&homing, method);
    for (int i = 0; i < HOMING_SHOWN; i++) {
        TEST_ASSERT_EQUAL_INT32(0, homing_step(&homing, &in));
        TEST_ASSERT_EQUAL(HOMING_BEGIN, homing.state);
    }
}

static void expect_error_at_standstill_only(void)
{
    TEST_ASSERT_EQUAL_INT32(0, homing_step(&homing, &in));
    TEST_ASSERT_EQUAL(HOMING_FAILING, homing.state);
    TEST_ASSERT_TRUE(homing_busy(&homing));
    in.standing = true;
    TEST_ASSERT_EQUAL_INT32(0, homing_step(&homing, &in));
    TEST_ASSERT_EQUAL(HOMING_FAILED, homing.state);
    TEST_ASSERT_FALSE(homing_busy(&homing));
}

static void test_method_that_there_is_not_is_an_error_and_moves_nothing(void)
{
    start(3);
    expect_error_at_standstill_only();
}

static void test_both_switches_on_while_it_searches_is_an_error(void)
{
    start(17);
    TEST_ASSERT_EQUAL_INT32(-SEARCH, homing_step(&homing, &in));
    in.inputs = HAL_LIMIT_MIN | HAL_LIMIT_MAX;
    expect_error_at_standstill_only();
}

static void test_search_reaches_as_far_as_it_may_in_either_direction_and_no_further(void)
{
    for (int dir = -1; dir <= 1; dir += 2) {
        setUp();
        in.position_nm = 50;
        start(dir < 0 ? 33 : 34);
        TEST_ASSERT_EQUAL_INT32(dir * ZERO, homing_step(&homing, &in));
        in.position_nm = 50 + dir * 1000;
        TEST_ASSERT_EQUAL_INT32(dir * ZERO, homing_step(&homing, &in));
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
