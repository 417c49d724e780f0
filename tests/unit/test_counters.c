/* SPDX-License-Identifier: Apache-2.0 */
/* What a counter does at its end, which a drive that is on for weeks reaches: docs/protocol.md, Counters. */
#include "test_device.h"

#include "motion/queue.h"

#define DRIVE rig.device.drive

static void enable_and_wait(unsigned ms)
{
    rig_enable(&rig);
    rig_ms(&rig, ms);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

/* ---- time ---- */

/* 2^32 control periods are 4.97 days, and no whole number of milliseconds. */
static void test_every_millisecond_has_its_ten_periods_when_the_count_of_periods_wraps(void)
{
    enable_and_wait(20);
    const uint32_t before = DRIVE.loop.published;
    DRIVE.loop.ticks = UINT32_MAX - 95u;
    for (unsigned period = 1; period <= 200; period++) {
        rig_run(&rig, 1);
        TEST_ASSERT_EQUAL_UINT32(before + period / 10u, DRIVE.loop.published);
    }
    TEST_ASSERT_LESS_THAN_UINT32(1000, DRIVE.loop.ticks);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

/* 49.7 days */
static void be_on_for(uint32_t ms)
{
    struct servo_loop *loop = &DRIVE.loop;
    const uint32_t turn = SERVO_LOOP_RECORDS;
    const uint32_t way = (ms - loop->published) / turn * turn; /* the records stay in turn */
    loop->published += way;
    loop->snapshot.ms += way;
    rig.device.ms += way;
    DRIVE.fault_monitor.ms += way;
    DRIVE.configured_ms += way;
}

static void test_jog_and_warnings_go_on_when_the_count_of_milliseconds_wraps(void)
{
    enable_and_wait(20);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6060, 0, 1, 3));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60FF, 0, 4, 20000));
    rig_ms(&rig, 500);
    be_on_for(UINT32_MAX - 99u);
    const double from_mm = rig.plant.pos_m[0] * 1e3;
    rig_ms(&rig, 50);
    TEST_ASSERT_EQUAL_HEX32(0x08000022, rig_write(&rig, 0x1016, 1, 4, 0)); /* a warning of a second: FF18h */
    rig_ms(&rig, 100);
    TEST_ASSERT_LESS_THAN_UINT32(1000, rig_read(&rig, 0x2020, 3));
    TEST_ASSERT_EQUAL_HEX16(0xFF18, rig.emcy[rig.emcy_count - 1]);
    rig_ms(&rig, 850);
    TEST_ASSERT_EQUAL_HEX16(0xFF18, rig.emcy[rig.emcy_count - 1]);
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[rig.emcy_count - 1]); /* after a second, across the wrap */
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 22, rig.plant.pos_m[0] * 1e3 - from_mm);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

static void test_axes_are_enabled_when_the_count_of_their_states_wraps(void)
{
    DRIVE.axis[0].changes = UINT32_MAX;
    DRIVE.axis[1].changes = UINT32_MAX - 2u;
    rig_ms(&rig, 20);
    enable_and_wait(20);
}

static void test_master_enables_the_axes_when_the_count_of_periods_wraps(void)
{
    DRIVE.loop.ticks = UINT32_MAX - 25u;
    enable_and_wait(20);
}

/* ---- totals ---- */

static void test_energy_stays_at_its_end(void)
{
    enable_and_wait(20);
    DRIVE.loop.servo.energy[0].mJ = INT32_MAX - 3;
    DRIVE.loop.servo.energy[1].mJ = 1000;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6060, 0, 1, 3));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60FF, 0, 4, 50000));
    rig_ms(&rig, 1000);
    TEST_ASSERT_EQUAL_UINT32(INT32_MAX, rig_read(&rig, 0x2220, 2));
    TEST_ASSERT_EQUAL_UINT32(INT32_MAX + rig_read(&rig, 0x2220, 3), rig_read(&rig, 0x2210, 12));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2220, 1, 1, 1));
    rig_ms(&rig, 2);
    TEST_ASSERT_LESS_THAN_UINT32(1000, rig_read(&rig, 0x2220, 2));
}

static void test_energy_of_both_axes_has_room_for_both_at_their_ends(void)
{
    enable_and_wait(20);
    DRIVE.loop.servo.energy[0].mJ = DRIVE.loop.servo.energy[1].mJ = INT32_MAX;
    rig_ms(&rig, 5);
    TEST_ASSERT_EQUAL_UINT32(2u * (uint32_t)INT32_MAX, rig_read(&rig, 0x2210, 12));
}

static void test_refused_claims_stay_at_their_end(void)
{
    rig.device.od.master.refused = UINT16_MAX - 1u;
    rig_nmt(&rig, 1);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2140, 2, 4, 0x17F));
    for (int i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2140, 2, 4, 0x27E));
    }
    TEST_ASSERT_EQUAL_UINT32(UINT16_MAX, rig_read(&rig, 0x2140, 5));
}

/* ---- one stream ---- */

static void test_estimated_contour_error_stays_when_its_samples_are_at_their_end(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 100);
    DRIVE.loop.contour_statistics.samples = UINT32_MAX - 2u;
    DRIVE.loop.contour_statistics.sum_nm = UINT64_C(7) * UINT32_MAX;
    rig_ms(&rig, 20);
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, rig_read(&rig, 0x2211, 3));
    TEST_ASSERT_UINT32_WITHIN(1, 7000, rig_read(&rig, 0x2211, 1));
}

static void test_stream_has_at_most_as_many_knots_as_path_time_can_count(void)
{
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0x06090031, rig_write(&rig, 0x2200, 4, 4, QUEUE_KNOTS_MAX + INT64_C(1)));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 4, 4, QUEUE_KNOTS_MAX));
}

/* An open-ended stream at its last knots, 34.7 days after it began: they are refused, and it stops on its path. */
static void test_stream_that_goes_on_for_ever_stops_on_its_path_at_its_last_knot(void)
{
    const uint32_t way = (QUEUE_KNOTS_MAX - 600u) / SPLINE_RING * SPLINE_RING; /* the ring stays in turn */
    rig_enable(&rig);
    stream.count = 0;
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    stream.count = SPLINE_RING + 1000u;
    rig_feed(&rig, &stream, 500);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 200);
    struct path *path = &DRIVE.path;
    path->queue.stream->accepted += way;
    path->queue.stream->executed += way;
    path->queue.ring->count += way;
    DRIVE.loop.path.at.knot += way;
    DRIVE.loop.executed += way;
    DRIVE.loop.servo.spline_cache = (struct spline_cache){0};
    for (uint32_t ms = way; ms < QUEUE_KNOTS_MAX; ms += 50u) {
        rig_feed(&rig, &stream, stream.count);
        run_on_the_line(50);
    }
    TEST_ASSERT_EQUAL_UINT32(QUEUE_KNOTS_MAX, rig_read(&rig, 0x2200, 7));
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF10));
    expect_standing_on_the_line();
}

/* ---- positions ---- */

static void test_axis_further_from_power_on_than_positions_count_is_told_so(void)
{
    static const double far_m[2] = {2.2, -2.2};
    for (int k = 0; k < 2; k++) {
        setUp();
        rig.plant.machine.travel_min_m[0] = -3;
        rig.plant.machine.travel_max_m[0] = 3;
        rig_ms(&rig, 10);
        rig_write(&rig, 0x2130, 1, 4, 0x7FFFFFFF);
        const double step_m = far_m[k] / 22000; /* it is pushed there without power, slowly enough for its encoder */
        for (int i = 0; i < 22000; i++) {
            rig.plant.pos_m[0] += step_m;
            rig_run(&rig, 1);
        }
        rig_ms(&rig, 200);
        rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
        rig_nmt(&rig, 1);
        rig_ms(&rig, 100);
        rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
        rig_controlwords(&rig, SWITCH_ON, SWITCH_ON);
        rig_controlwords(&rig, ENABLE, ENABLE);
        rig_ms(&rig, 20);
        rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
        TEST_ASSERT_EQUAL_HEX32(0x8612, rig_read(&rig, 0x603F, 0));
        TEST_ASSERT_FALSE(rig.out.enable[0] || rig.out.enable[1]);
    }
}

static void test_position_at_its_end_stays_there_with_what_the_geometry_adds(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2100, 5, 4, 4000000000)); /* 40 um a count */
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2900, 5, 4, 4000000000));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2116, 1, 4, -100000000)); /* y gets -0.1 of x */
    rig_ms(&rig, 5);
    rig.lost[0] = -60000; /* counts: 2.4 m */
    rig.lost[1] = -70000;
    rig_ms(&rig, 5);
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, (int32_t)rig_read(&rig, 0x6064, 0));
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, (int32_t)rig_read(&rig, 0x6864, 0));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_every_millisecond_has_its_ten_periods_when_the_count_of_periods_wraps);
    RUN_TEST(test_jog_and_warnings_go_on_when_the_count_of_milliseconds_wraps);
    RUN_TEST(test_axes_are_enabled_when_the_count_of_their_states_wraps);
    RUN_TEST(test_master_enables_the_axes_when_the_count_of_periods_wraps);
    RUN_TEST(test_energy_stays_at_its_end);
    RUN_TEST(test_energy_of_both_axes_has_room_for_both_at_their_ends);
    RUN_TEST(test_refused_claims_stay_at_their_end);
    RUN_TEST(test_estimated_contour_error_stays_when_its_samples_are_at_their_end);
    RUN_TEST(test_stream_has_at_most_as_many_knots_as_path_time_can_count);
    RUN_TEST(test_stream_that_goes_on_for_ever_stops_on_its_path_at_its_last_knot);
    RUN_TEST(test_axis_further_from_power_on_than_positions_count_is_told_so);
    RUN_TEST(test_position_at_its_end_stays_there_with_what_the_geometry_adds);
    return UNITY_END();
}
