/* SPDX-License-Identifier: Apache-2.0 */
/* Power, force, brake and movement of one axis, one after the other, each with its time. */
#include "drive/amplifier.h"

#include "drive/servo_loop.h"
#include "hal/hal.h"
#include "unity.h"

enum { LIVE = 10, RELEASE = 20, ENGAGE = 30 };

static struct amplifier amplifier;
static struct od_axis od;
static uint32_t now;

void setUp(void)
{
    amplifier = (struct amplifier){0};
    od = (struct od_axis){.wiring.enable_delay = LIVE, .brake = {.release_delay = RELEASE, .engage_delay = ENGAGE}};
    now = UINT32_MAX - 5; /* the clock wraps */
}

void tearDown(void)
{
}

static void expect_after(uint32_t passed_ms, unsigned inputs, enum amplifier_state state)
{
    now += passed_ms;
    amplifier_step(&amplifier, &od, true, inputs, now);
    TEST_ASSERT_EQUAL(state, amplifier.state);
}

static void be_live(void)
{
    expect_after(0, 0, AMPLIFIER_STARTING);
    expect_after(LIVE + 1, 0, AMPLIFIER_RELEASING);
    expect_after(RELEASE + 1, 0, AMPLIFIER_LIVE);
}

/* The time of the last tick may be almost a millisecond ago. */
static void test_each_step_takes_at_least_its_time(void)
{
    expect_after(0, 0, AMPLIFIER_STARTING);
    expect_after(LIVE, 0, AMPLIFIER_STARTING);
    expect_after(1, 0, AMPLIFIER_RELEASING);
    expect_after(RELEASE, 0, AMPLIFIER_RELEASING);
    expect_after(1, 0, AMPLIFIER_LIVE);
    expect_after(1000, 0, AMPLIFIER_LIVE);
}

static void test_without_times_all_is_done_in_one_step(void)
{
    od = (struct od_axis){0};
    expect_after(0, 0, AMPLIFIER_LIVE);
    TEST_ASSERT_TRUE(amplifier_engage(&amplifier, &od, true, now));
}

static void test_one_that_says_ready_is_live_at_once(void)
{
    od.wiring.ready = 1;
    expect_after(0, HAL_AMPLIFIER_FAULT, AMPLIFIER_STARTING);
    expect_after(1, HAL_LIMIT_MIN, AMPLIFIER_RELEASING);
    od.wiring.ready = 0;
    amplifier_step(&amplifier, &od, false, HAL_AMPLIFIER_FAULT, now);
    expect_after(0, 0, AMPLIFIER_STARTING);
    expect_after(1, 0, AMPLIFIER_STARTING); /* this one never says so */
}

/* A contact that sticks, or one that has not opened yet since the axis was live: neither says that it is live now. */
static void test_ready_counts_only_where_it_was_not_ready_before(void)
{
    od.wiring.ready = 1;
    expect_after(0, 0, AMPLIFIER_STARTING);
    expect_after(LIVE, 0, AMPLIFIER_STARTING);
    expect_after(1, 0, AMPLIFIER_RELEASING);
    amplifier_step(&amplifier, &od, false, 0, now);
    expect_after(1, 0, AMPLIFIER_STARTING);
    expect_after(1, 0, AMPLIFIER_STARTING);
    expect_after(1, HAL_AMPLIFIER_FAULT, AMPLIFIER_STARTING);
    expect_after(1, 0, AMPLIFIER_RELEASING);
    expect_after(1, 0, AMPLIFIER_RELEASING);
    amplifier_step(&amplifier, &od, false, 0, now); /* it has not opened yet */
    expect_after(1, 0, AMPLIFIER_STARTING);
    expect_after(1, 0, AMPLIFIER_STARTING);
    amplifier_step(&amplifier, &od, false, HAL_AMPLIFIER_FAULT, now); /* while it is off */
    amplifier_step(&amplifier, &od, false, 0, now);
    expect_after(1, 0, AMPLIFIER_STARTING);
    expect_after(1, 0, AMPLIFIER_RELEASING);
}

static void test_power_ends_at_once_in_each_state(void)
{
    const enum amplifier_state states[] = {AMPLIFIER_OFF, AMPLIFIER_STARTING, AMPLIFIER_RELEASING, AMPLIFIER_LIVE,
                                           AMPLIFIER_ENGAGING};
    for (unsigned i = 0; i < sizeof states / sizeof states[0]; i++) {
        amplifier = (struct amplifier){.state = states[i], .since_ms = now};
        amplifier_step(&amplifier, &od, false, 0, now);
        TEST_ASSERT_EQUAL(AMPLIFIER_OFF, amplifier.state);
    }
}

static void test_the_brake_has_its_time_before_the_axis_loses_its_power(void)
{
    be_live();
    TEST_ASSERT_TRUE(amplifier_engage(&amplifier, &od, false, now));
    TEST_ASSERT_EQUAL(AMPLIFIER_LIVE, amplifier.state);
    TEST_ASSERT_FALSE(amplifier_engage(&amplifier, &od, true, now));
    TEST_ASSERT_EQUAL(AMPLIFIER_ENGAGING, amplifier.state);
    expect_after(ENGAGE, 0, AMPLIFIER_ENGAGING);
    TEST_ASSERT_FALSE(amplifier_engage(&amplifier, &od, true, now));
    TEST_ASSERT_TRUE(amplifier_engage(&amplifier, &od, true, now + 1));
}

static void test_an_axis_that_keeps_its_power_after_all_releases_its_brake_again(void)
{
    be_live();
    TEST_ASSERT_FALSE(amplifier_engage(&amplifier, &od, true, now));
    TEST_ASSERT_TRUE(amplifier_engage(&amplifier, &od, false, now + 3));
    TEST_ASSERT_EQUAL(AMPLIFIER_RELEASING, amplifier.state);
    expect_after(3 + RELEASE + 1, 0, AMPLIFIER_LIVE);
}

static void test_a_brake_that_was_never_released_needs_no_time(void)
{
    expect_after(0, 0, AMPLIFIER_STARTING);
    TEST_ASSERT_TRUE(amplifier_engage(&amplifier, &od, true, now));
    TEST_ASSERT_EQUAL(AMPLIFIER_STARTING, amplifier.state);
}

static void test_what_the_servo_tick_gets(void)
{
    static const struct {
        enum amplifier_state state;
        uint32_t word;
        bool holds, released;
    } rows[] = {
        {AMPLIFIER_OFF, SERVO_LOOP_OFF, false, false},        {AMPLIFIER_STARTING, SERVO_LOOP_STARTING, false, false},
        {AMPLIFIER_RELEASING, SERVO_LOOP_ON, true, true},     {AMPLIFIER_LIVE, SERVO_LOOP_ON, true, true},
        {AMPLIFIER_ENGAGING, SERVO_LOOP_BRAKED, true, false},
    };
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct amplifier a = {.state = rows[i].state};
        TEST_ASSERT_EQUAL_HEX32(rows[i].word, amplifier_word(&a));
        TEST_ASSERT_EQUAL(rows[i].holds, amplifier_holds(&a));
        TEST_ASSERT_EQUAL(rows[i].released, amplifier_released(&a));
        for (unsigned bit = 0; bit < 32; bit++) { /* one that flips leaves no state */
            const uint32_t flipped = (uint32_t)rows[i].state ^ 1u << bit;
            for (unsigned j = 0; j < sizeof rows / sizeof rows[0]; j++) {
                TEST_ASSERT_NOT_EQUAL_HEX32(rows[j].state, flipped);
                TEST_ASSERT_NOT_EQUAL_HEX32(rows[j].word, rows[i].word ^ 1u << bit);
            }
        }
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_each_step_takes_at_least_its_time);
    RUN_TEST(test_without_times_all_is_done_in_one_step);
    RUN_TEST(test_one_that_says_ready_is_live_at_once);
    RUN_TEST(test_ready_counts_only_where_it_was_not_ready_before);
    RUN_TEST(test_power_ends_at_once_in_each_state);
    RUN_TEST(test_the_brake_has_its_time_before_the_axis_loses_its_power);
    RUN_TEST(test_an_axis_that_keeps_its_power_after_all_releases_its_brake_again);
    RUN_TEST(test_a_brake_that_was_never_released_needs_no_time);
    RUN_TEST(test_what_the_servo_tick_gets);
    return UNITY_END();
}
