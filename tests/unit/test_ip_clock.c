/* SPDX-License-Identifier: Apache-2.0 */
/* Records of 60C1h from a master whose clock is not the drive's: path time follows it, and the lag stays. */
#include "test_device.h"

enum { SECONDS = 12, LENGTH_NM = 60000000 };

static unsigned rate_min, rate_max;
static uint32_t lag_ms = 4; /* 2171h */

static void record(unsigned i, unsigned count)
{
    const int32_t x = rig_line(i < count ? i : count - 1, count, LENGTH_NM);
    uint8_t data[8];
    co_put(&data[0], (uint32_t)x, 4);
    co_put(&data[4], (uint32_t)(x / 2), 4);
    rig_send(&rig, 0x401, 8, data);
}

/* Knots that wait */
static int lag(void)
{
    return (int)(rig.device.od.stream.accepted - rig.device.od.stream.executed);
}

/* Records each `ms` by a clock that is faster by ppm. Returns by how many knots the lag has grown since the first second. */
static int drive_with(int ppm, unsigned ms)
{
    const unsigned count = SECONDS * 1000u / ms;
    unsigned sent = 0;
    int begin = 0;
    setUp();
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C2, 1, 1, ms));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68C2, 1, 1, ms));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2171, 0, 2, lag_ms));
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    rate_min = 2000;
    rate_max = 0;
    for (unsigned t = 0; t < (SECONDS - 1) * 1000u; t++) {
        const double master_ms = t * (1 + ppm * 1e-6);
        while (sent * ms <= master_ms) {
            record(sent++, count);
        }
        rig_ms(&rig, 1);
        if (t == 1000) {
            begin = lag();
        }
        if (t >= 1000) {
            const unsigned rate = rig.device.od.stream.rate;
            rate_min = rate < rate_min ? rate : rate_min;
            rate_max = rate > rate_max ? rate : rate_max;
        }
    }
    TEST_ASSERT_EQUAL_UINT32(RUNNING, stream_state());
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    TEST_ASSERT_EQUAL_UINT32(0, rig.device.od.stream.underruns);
    return lag() - begin;
}

static void test_lag_stays_with_a_master_that_is_faster_or_slower(void)
{
    static const int ppm[] = {0, 500, -500, 1000, -1000, 4000, -4000};
    static const unsigned most[] = {1, 6}; /* with a short lag and with a long one; 4000 ppm alone would be 40 */
    for (int k = 0; k < 2; k++) {
        lag_ms = k == 0 ? 4 : 72;
        for (unsigned i = 0; i < sizeof ppm / sizeof ppm[0]; i++) {
            TEST_ASSERT_INT_WITHIN(most[k], 0, drive_with(ppm[i], 1));
            TEST_ASSERT_TRUE(rate_min >= 995 && rate_max <= 1005);
            TEST_ASSERT_TRUE(ppm[i] != 0 || (rate_min == 1000 && rate_max == 1000));
        }
        TEST_ASSERT_INT_WITHIN(10u + most[k], 0, drive_with(1000, 10));
    }
}

static void test_rate_is_followed_within_half_a_percent_and_no_further(void)
{
    lag_ms = 72;
    TEST_ASSERT_TRUE(drive_with(20000, 1) > 100);
    TEST_ASSERT_EQUAL_UINT(1005, rate_max);
    TEST_ASSERT_TRUE(drive_with(-6000, 1) < -8);
    TEST_ASSERT_EQUAL_UINT(995, rate_min);
}

static void test_record_that_is_lost_stops_the_path_on_the_path_and_is_told(void)
{
    unsigned sent = 0;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2171, 0, 2, 72));
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    for (unsigned t = 0; t < QUEUE_ROOM + 500u && stream_state() != STOPPED; t++) {
        record(sent++, 12000);
        record(sent++, 12000);
        rig_ms(&rig, 1);
    }
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF34));
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    rig_ms(&rig, 50);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 0, rig.plant.vel_mps[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, rig.plant.pos_m[0] / 2, rig.plant.pos_m[1]);
    record(sent, 12000);
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 2)); /* discard */
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_HEX8(0, rig.device.od.error_register);
}

static void test_feed_override_is_left_as_it_is(void)
{
    setUp();
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2131, 0, 2, 500));
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    for (unsigned t = 0; t < 900; t++) {
        record(t, 12000);
        rig_ms(&rig, 1);
    }
    TEST_ASSERT_EQUAL_UINT(500, rig.device.od.stream.rate);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_lag_stays_with_a_master_that_is_faster_or_slower);
    RUN_TEST(test_rate_is_followed_within_half_a_percent_and_no_further);
    RUN_TEST(test_record_that_is_lost_stops_the_path_on_the_path_and_is_told);
    RUN_TEST(test_feed_override_is_left_as_it_is);
    return UNITY_END();
}
