/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/sync_clock.h"

#include <math.h>

#include "unity.h"

static struct sync_clock c;
static uint64_t state;

void setUp(void)
{
    c = (struct sync_clock){0};
    state = 1;
}

void tearDown(void)
{
}

static double noise(void)
{
    state = state * 6364136223846793005u + 1442695040888963407u;
    return (double)(state >> 33) / 2147483648.0 * 2 - 1;
}

/* SYNC k of a master, whose cycle has `period` control periods and is by `ppm` longer, in cycles late by `late` */
static void sync(unsigned k, unsigned period, double ppm, double late)
{
    sync_clock_sync(&c, 1000 + (uint32_t)lround((k * (1 + ppm * 1e-6) + late) * period), period);
}

static double cycles(int64_t q32)
{
    return (double)q32 / (double)SYNC_CYCLE;
}

static void test_phase_and_frequency_follow_a_master_with_jitter_and_another_clock(void)
{
    static const double ppm[] = {0, 500, -500};
    static const unsigned period[] = {10, 20, 40, 100, 400};
    for (int n = 0; n < 15; n++) {
        double most = 0;
        setUp();
        for (unsigned k = 0; k < 5000; k++) {
            const double late = 0.2 * noise();
            sync(k, period[n % 5], ppm[n / 5], late);
            TEST_ASSERT_EQUAL_UINT32(k + 1, c.cycle);
            most = k < 1000 ? 0 : fmax(most, fabs(cycles(c.late) - late));
        }
        TEST_ASSERT_TRUE(most < 0.12); /* of which rounding to a control period is up to 0.05 */
        TEST_ASSERT_DOUBLE_WITHIN(400, -ppm[n / 5], cycles(c.drift) * 1e6);
    }
}

static void test_punctual_master_is_known_to_a_thousandth(void)
{
    for (unsigned k = 0; k < 2000; k++) {
        sync(k, 100, 300, 0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(5e-3, 0, cycles(c.late)); /* a control period is 0.01 */
    TEST_ASSERT_DOUBLE_WITHIN(30, -300, cycles(c.drift) * 1e6);
}

static void test_clock_that_is_further_off_counts_as_the_most_that_can_be(void)
{
    for (unsigned k = 0; k < 2000; k++) {
        sync(k, 400, -20000, 0);
    }
    TEST_ASSERT_EQUAL_INT64(SYNC_CYCLE / SYNC_DRIFT, c.drift);
    for (unsigned k = 2000; k < 4000; k++) {
        sync(k, 400, 20000, 0);
    }
    TEST_ASSERT_EQUAL_INT64(-SYNC_CYCLE / SYNC_DRIFT, c.drift);
}

static void test_lost_sync_is_counted_by_the_time_of_the_next(void)
{
    for (unsigned k = 0; k < 500; k++) {
        if (k % 7 != 3) {
            sync(k, 10, 0, 0.2 * noise());
            TEST_ASSERT_EQUAL_UINT32(k + 1, c.cycle);
        }
    }
}

static void test_burst_is_that_of_the_present_cycle(void)
{
    for (unsigned k = 0; k < 100; k++) {
        sync(k, 100, 0, 0);
    }
    for (unsigned k = 100; k < 104; k++) { /* all with the last of them, a little later and later */
        sync(103, 100, 0, (k - 100) * 0.01);
    }
    TEST_ASSERT_EQUAL_UINT32(104, c.cycle);
    sync(103, 100, 0, 0.04); /* once more */
    TEST_ASSERT_EQUAL_UINT32(104, c.cycle);
    sync(104, 100, 0, 0);
    TEST_ASSERT_EQUAL_UINT32(105, c.cycle);
}

static void test_time_is_known_after_four_syncs_and_until_eight_cycles_without(void)
{
    for (unsigned k = 0; k < 3; k++) {
        sync(k, 20, 0, 0);
        TEST_ASSERT_FALSE(sync_clock_locked(&c, c.at));
    }
    sync(3, 20, 0, 0);
    TEST_ASSERT_TRUE(sync_clock_locked(&c, c.at));
    TEST_ASSERT_TRUE(sync_clock_locked(&c, c.at + 160));
    TEST_ASSERT_FALSE(sync_clock_locked(&c, c.at + 161));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 1.5, cycles(sync_clock_since(&c, c.at + 30)));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 16, cycles(sync_clock_since(&c, c.at + 1000000))); /* no more than that */
    const uint32_t before = c.cycle;
    sync(12, 20, 0, 0);
    TEST_ASSERT_EQUAL_UINT32(1, c.count);
    TEST_ASSERT_EQUAL_UINT32(before + 1, c.cycle);
}

static void test_other_period_begins_anew(void)
{
    for (unsigned k = 0; k < 10; k++) {
        sync(k, 20, 0, 0);
    }
    sync(5, 40, 0, 0);
    TEST_ASSERT_EQUAL_UINT32(1, c.count);
    TEST_ASSERT_EQUAL_UINT32(40, c.period);
}

static void test_control_periods_wrap(void)
{
    for (unsigned k = 0; k < 100; k++) {
        sync_clock_sync(&c, 0xFFFFFE00u + k * 10u, 10);
        TEST_ASSERT_EQUAL_UINT32(k + 1, c.cycle);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, cycles(c.late));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_phase_and_frequency_follow_a_master_with_jitter_and_another_clock);
    RUN_TEST(test_punctual_master_is_known_to_a_thousandth);
    RUN_TEST(test_clock_that_is_further_off_counts_as_the_most_that_can_be);
    RUN_TEST(test_lost_sync_is_counted_by_the_time_of_the_next);
    RUN_TEST(test_burst_is_that_of_the_present_cycle);
    RUN_TEST(test_time_is_known_after_four_syncs_and_until_eight_cycles_without);
    RUN_TEST(test_other_period_begins_anew);
    RUN_TEST(test_control_periods_wrap);
    return UNITY_END();
}
