/* SPDX-License-Identifier: Apache-2.0 */
/* Records of 60C1h that wait 4 ms (2171h): jitter, another clock, and records that cease. */
#include <math.h>

#include "test_device.h"

enum { UNDERRUN = 0xFF10, SPEED_NM = 50000 /* in a ms, of x; y has half of it */, RAMP_MS = 200 };

static uint64_t random_state;
static unsigned sent, record_ms;
static double clock_ppm, jitter, begin_ms, most_lag_ms, most_off_um;

static double noise(void)
{
    random_state = random_state * 6364136223846793005u + 1442695040888963407u;
    return (double)(random_state >> 33) / 2147483648.0 * 2 - 1;
}

/* x of the master, nm: from rest to its speed with a ramp of cos^2 */
static double way_nm(double ms)
{
    const double pi = 3.14159265358979, t = fmin(fmax(ms, 0), RAMP_MS);
    return SPEED_NM * (0.5 * (t - RAMP_MS / pi * sin(pi * t / RAMP_MS)) + fmax(0, ms - RAMP_MS));
}

static double now_ms(void)
{
    return (double)rig.plant.period * 0.1;
}

static void send_record(void)
{
    const int32_t x = (int32_t)lround(way_nm(sent * record_ms));
    uint8_t data[8];
    co_put(&data[0], (uint32_t)x, 4);
    co_put(&data[4], (uint32_t)(x / 2), 4);
    rig_send(&rig, 0x401, 8, data);
    sent++;
}

/* The master works for so long; the lag is that of the axis behind where the master is by its own clock. */
static void work(unsigned ms)
{
    for (const uint64_t end = rig.plant.period + 10u * ms; rig.plant.period < end;) {
        const double due_ms = sent * record_ms * (1 + clock_ppm * 1e-6);
        const double at_ms = due_ms + noise() * jitter * record_ms;
        while (now_ms() - begin_ms < at_ms && rig.plant.period < end) {
            rig_run(&rig, 1);
        }
        if (rig.plant.period < end) {
            send_record();
        }
        const double x = rig.plant.pos_m[0] * 1e9;
        if (x > way_nm(RAMP_MS)) {
            const double master_ms = (now_ms() - begin_ms) / (1 + clock_ppm * 1e-6);
            most_lag_ms = fmax(most_lag_ms, (way_nm(master_ms) - x) / SPEED_NM);
            most_off_um = fmax(most_off_um, fabs(rig.plant.pos_m[0] / 2 - rig.plant.pos_m[1]) * 1e6);
        }
    }
}

static void begin(unsigned ms, double part, double ppm)
{
    setUp();
    random_state = 1;
    sent = 0;
    record_ms = ms;
    jitter = part;
    clock_ppm = ppm;
    most_lag_ms = most_off_um = 0;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C2, 1, 1, ms));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68C2, 1, 1, ms));
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    begin_ms = now_ms();
}

static void expect_running(void)
{
    TEST_ASSERT_EQUAL_UINT32(RUNNING, stream_state());
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[0]);
    TEST_ASSERT_TRUE(most_off_um < 3);
}

static void test_lag_is_at_most_five_ms_with_jitter_and_another_clock(void)
{
    static const double ppm[] = {0, 500, -500};
    for (int k = 0; k < 3; k++) {
        begin(1, k == 0 ? 0 : 0.2, ppm[k]);
        work(2000);
        expect_running();
        TEST_ASSERT_TRUE(most_lag_ms < 5);
        TEST_ASSERT_TRUE(most_lag_ms > 3);
    }
}

static void test_longer_records_wait_for_another_one(void)
{
    static const unsigned ms[] = {2, 4, 10, 20};
    for (int k = 0; k < 4; k++) {
        begin(ms[k], 0.2, 300);
        work(2000);
        expect_running();
        TEST_ASSERT_TRUE(most_lag_ms < 1.5 + 3.4 * ms[k]); /* 1.5 of them make the B-spline */
    }
}

static void test_records_that_cease_are_a_stop_along_the_tangent(void)
{
    for (int k = 0; k < 2; k++) {
        begin(1, 0.2, 0);
        rig_write(&rig, 0x6084, 0, 4, k == 0 ? 1000000 : 4000000);
        work(700);
        const double x = rig.plant.pos_m[0];
        rig_ms(&rig, 8);
        TEST_ASSERT_EQUAL_HEX16(UNDERRUN, rig.emcy[0]);
        double before = rig.plant.vel_mps[0];
        for (int i = 0; i < 300; i++) {
            rig_ms(&rig, 1);
            TEST_ASSERT_DOUBLE_WITHIN(3e-6, rig.plant.pos_m[0] / 2, rig.plant.pos_m[1]);
            TEST_ASSERT_TRUE(rig.plant.vel_mps[0] - before > -0.006); /* no jump */
            before = rig.plant.vel_mps[0];
        }
        rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
        TEST_ASSERT_EQUAL_UINT(1, rig.emcy_count);
        TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0, rig.plant.vel_mps[0]);
        TEST_ASSERT_TRUE(rig.plant.pos_m[0] - x < 0.008);
    }
}

/* A master that sends no more when it halts the axes */
static void test_halt_without_more_records_is_no_fault_and_the_next_record_begins_anew(void)
{
    begin(1, 0, 0);
    work(700);
    rig_controlwords(&rig, RUN | 0x100, RUN | 0x100);
    rig_ms(&rig, 400);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0, rig.plant.vel_mps[0]);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 10);
    const int32_t at[2] = {(int32_t)rig_read(&rig, 0x6062, 0), (int32_t)rig_read(&rig, 0x6862, 0)};
    for (int i = 0; i < 600; i++) {
        uint8_t data[8];
        co_put(&data[0], (uint32_t)(at[0] + rig_line((unsigned)(i < 500 ? i : 499), 500, 5e6)), 4);
        co_put(&data[4], (uint32_t)at[1], 4);
        rig_send(&rig, 0x401, 8, data);
        rig_ms(&rig, 1);
    }
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, at[0] * 1e-9 + 5e-3, rig.plant.pos_m[0]);
}

/* One that goes on sending: the path is left alone, and goes on where it stands. */
static void test_halt_with_more_records_stops_on_the_path(void)
{
    begin(1, 0, 0);
    work(700);
    rig_controlwords(&rig, RUN | 0x100, RUN | 0x100);
    work(300);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0, rig.plant.vel_mps[0]);
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    rig_controlwords(&rig, RUN, RUN);
    work(300);
    expect_running();
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0.05, rig.plant.vel_mps[0]);
}

static void test_long_lag_stops_on_the_path_as_records_cease(void)
{
    begin(1, 0.2, 0);
    rig_controlwords(&rig, 0, 0);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2171, 0, 2, 72));
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    begin_ms = now_ms();
    work(700);
    expect_running();
    const double last = rig.device.od.stream.end_x * 1e-9;
    rig_ms(&rig, 300);
    TEST_ASSERT_EQUAL_HEX16(UNDERRUN, rig.emcy[0]);
    TEST_ASSERT_TRUE(rig.plant.pos_m[0] < last);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_lag_is_at_most_five_ms_with_jitter_and_another_clock);
    RUN_TEST(test_longer_records_wait_for_another_one);
    RUN_TEST(test_records_that_cease_are_a_stop_along_the_tangent);
    RUN_TEST(test_halt_without_more_records_is_no_fault_and_the_next_record_begins_anew);
    RUN_TEST(test_halt_with_more_records_stops_on_the_path);
    RUN_TEST(test_long_lag_stops_on_the_path_as_records_cease);
    return UNITY_END();
}
