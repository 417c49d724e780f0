/* SPDX-License-Identifier: Apache-2.0 */
/* test_pace.c: pacing of the process kontur-sim: no drift, bounded catching up, exact SYNC periods. */
#include "port/linux/pace.h"
#include "unity.h"

#define MS 1000000ull
#define HOUR_NS (3600ull * 1000u * MS)

enum { HZ = 10000 };
static const uint64_t start_ns = 987654321;
static struct pace pace;

void setUp(void)
{
    pace_init(&pace, HZ, start_ns);
}

void tearDown(void)
{
}

static void test_nothing_is_due_at_power_on(void)
{
    TEST_ASSERT_EQUAL_UINT32(0, pace_due(&pace, start_ns, 0));
    TEST_ASSERT_EQUAL_UINT32(0, pace_due(&pace, start_ns + 99999, 0));
    TEST_ASSERT_EQUAL_UINT32(1, pace_due(&pace, start_ns + 100000, 0));
}

static void test_time_does_not_drift_however_unevenly_it_is_polled(void)
{
    uint64_t tick = 0, now = start_ns;
    for (unsigned i = 0; i < 100000; i++) {
        now += 1 + (uint64_t)i * 7919u % (3 * MS);
        tick += pace_due(&pace, now, tick);
    }
    TEST_ASSERT_EQUAL_UINT64((now - start_ns) / 100000u, tick);
    TEST_ASSERT_EQUAL_UINT64(0, pace.lost_ms);
}

static void test_years_do_not_overflow(void)
{
    const uint64_t year_ns = 8766 * HOUR_NS, year_ticks = 8766ull * 3600u * HZ;
    TEST_ASSERT_EQUAL_UINT32(10, pace_due(&pace, start_ns + 100 * year_ns, 100 * year_ticks - 10));
}

static void test_a_short_stall_is_made_up_for(void)
{
    TEST_ASSERT_EQUAL_UINT32(2000, pace_due(&pace, start_ns + 200 * MS, 0));
    TEST_ASSERT_EQUAL_UINT64(0, pace.lost_ms);
}

static void test_a_longer_stall_is_lost_once_and_counted(void)
{
    TEST_ASSERT_EQUAL_UINT32(1991,
                             pace_due(&pace, start_ns + 5000 * MS + 100000, 0)); /* complete milliseconds are lost */
    TEST_ASSERT_EQUAL_UINT64(4801, pace.lost_ms);
    TEST_ASSERT_EQUAL_UINT32(0, pace_due(&pace, start_ns + 5000 * MS + 100000, 1991));
    TEST_ASSERT_EQUAL_UINT32(10, pace_due(&pace, start_ns + 5001 * MS + 100000, 1991));
    TEST_ASSERT_EQUAL_UINT64(4801, pace.lost_ms);
}

static void test_sync_periods_add_up_exactly(void)
{
    TEST_ASSERT_EQUAL_UINT32(10, pace_sync(&pace, 1000));
    uint64_t periods = 0;
    for (unsigned i = 0; i < 1000; i++) {
        periods += pace_sync(&pace, 1234);
    }
    TEST_ASSERT_EQUAL_UINT64(12340, periods);
    TEST_ASSERT_EQUAL_UINT32(0, pace_sync(&pace, 50));
    TEST_ASSERT_EQUAL_UINT32(1, pace_sync(&pace, 50));
}

static void test_an_answer_cannot_come_sooner_than_a_bus_carries_it(void)
{
    TEST_ASSERT_TRUE(pace_bus_free(&pace, 0)); /* no frame has come yet */
    pace_frame(&pace, 100);
    TEST_ASSERT_FALSE(pace_bus_free(&pace, 100));
    TEST_ASSERT_FALSE(pace_bus_free(&pace, 101));
    TEST_ASSERT_TRUE(pace_bus_free(&pace, 102)); /* 0.2 ms */
    pace_frame(&pace, 102);
    TEST_ASSERT_FALSE(pace_bus_free(&pace, 103));
}

static void test_the_wait_for_the_bus_ends_with_the_tick_from_which_it_is_free(void)
{
    TEST_ASSERT_EQUAL_UINT64(0, pace_bus_wait_ns(&pace, start_ns));
    pace_frame(&pace, 36000ull * HZ + 7); /* ten hours */
    const uint64_t wait_ns = pace_bus_wait_ns(&pace, start_ns + 10 * HOUR_NS);
    TEST_ASSERT_EQUAL_UINT64(900000, wait_ns);
    TEST_ASSERT_EQUAL_UINT64(0, pace_bus_wait_ns(&pace, start_ns + 10 * HOUR_NS + MS));
    TEST_ASSERT_TRUE(
        pace_bus_free(&pace, pace_due(&pace, start_ns + 10 * HOUR_NS + wait_ns, 36000ull * HZ) + 36000ull * HZ));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_nothing_is_due_at_power_on);
    RUN_TEST(test_time_does_not_drift_however_unevenly_it_is_polled);
    RUN_TEST(test_years_do_not_overflow);
    RUN_TEST(test_a_short_stall_is_made_up_for);
    RUN_TEST(test_a_longer_stall_is_lost_once_and_counted);
    RUN_TEST(test_sync_periods_add_up_exactly);
    RUN_TEST(test_an_answer_cannot_come_sooner_than_a_bus_carries_it);
    RUN_TEST(test_the_wait_for_the_bus_ends_with_the_tick_from_which_it_is_free);
    return UNITY_END();
}
