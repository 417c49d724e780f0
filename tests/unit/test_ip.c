/* SPDX-License-Identifier: Apache-2.0 */
/* Interpolated position by CiA 402: records of 60C1h, by PDO and SDO, on the simulated machine. */
#include <math.h>

#include "drive_rig.h"

enum { ENABLE = 0x0F, RUN = 0x1F };
enum { TARGET_REACHED = 10, IP_ACTIVE = 12 };
enum { IDLE, FILLING, RUNNING, STOPPING, DONE, STOPPED };

#define ABORT_STATE 0x08000022u

static struct rig rig;

void setUp(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
}

void tearDown(void)
{
}

/* One record of both axes by RPDO3 */
static void record(int32_t x, int32_t y)
{
    uint8_t data[8];
    co_put(&data[0], (uint32_t)x, 4);
    co_put(&data[4], (uint32_t)y, 4);
    rig_send(&rig, 0x401, 8, data);
}

static uint32_t stream(uint8_t sub)
{
    return rig_read(&rig, 0x2200, sub);
}

static double mm(int axis)
{
    return rig.plant.pos_m[axis] * 1e3;
}

/* Record i of a way of 20 mm in x and 10 mm in y that takes `count` records, from rest to rest */
static struct knot on_the_way(int i, int count)
{
    const int32_t d = rig_line((unsigned)i, (unsigned)count, 20e6);
    return (struct knot){{d, d / 2}};
}

/* A master that sends a record each `ms`, and goes on with the last one until the drive has rested for a while */
static void send_way(int count, unsigned ms, int more)
{
    for (int i = 0; i < count + more; i++) {
        const struct knot k = on_the_way(i < count ? i : count - 1, count);
        record(k.nm[0], k.nm[1]);
        rig_ms(&rig, ms);
    }
}

static void expect_at_the_end(void)
{
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 20, mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 10, mm(1));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_first_record_begins_a_stream_from_where_the_axes_are_held(void)
{
    rig_enable(&rig);
    record(3000, -4000);
    TEST_ASSERT_EQUAL_UINT32(FILLING, stream(5));
    TEST_ASSERT_EQUAL_UINT32(1, stream(7));
    TEST_ASSERT_EQUAL_INT32(3000, (int32_t)stream(10));
    TEST_ASSERT_EQUAL_INT32(-4000, (int32_t)stream(11));
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x60C4, 4));
}

static void test_record_too_far_from_where_the_axes_are_begins_nothing(void)
{
    rig_enable(&rig);
    record(10001, 0); /* the window is 10 um */
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream(5));
    TEST_ASSERT_EQUAL_UINT32(1, stream(17));
    record(0, -10001);
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream(5));
    record(10000, -10000);
    TEST_ASSERT_EQUAL_UINT32(FILLING, stream(5));
}

static void test_record_of_an_axis_that_is_not_enabled_is_refused(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 3);
    record(0, 0);
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream(5));
    TEST_ASSERT_EQUAL_UINT32(1, stream(17));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x68C1, 1, 4, 0));
}

static void test_records_by_sdo_count_when_y_is_written(void)
{
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C1, 1, 4, 1000));
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream(5));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68C1, 1, 4, 2000));
    TEST_ASSERT_EQUAL_UINT32(1, stream(7));
    TEST_ASSERT_EQUAL_INT32(1000, (int32_t)stream(10));
    TEST_ASSERT_EQUAL_INT32(2000, (int32_t)stream(11));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68C1, 1, 4, 2500));
    TEST_ASSERT_EQUAL_UINT32(2, stream(7));
}

static void test_way_in_records_of_a_millisecond_is_followed_to_its_end(void)
{
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    send_way(800, 1, 100);
    expect_at_the_end();
    TEST_ASSERT_TRUE(rig_bit(&rig, IP_ACTIVE));
    TEST_ASSERT_EQUAL_UINT32(0, stream(18));
    rig_controlwords(&rig, ENABLE, ENABLE); /* at rest: nothing happens */
    rig_ms(&rig, 300);
    TEST_ASSERT_FALSE(rig_bit(&rig, IP_ACTIVE));
    expect_at_the_end();
}

static void test_master_that_only_stops_sending_at_rest_causes_no_underrun(void)
{
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    send_way(800, 1, 0); /* its last six records are equal */
    rig_ms(&rig, 400);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream(5));
    TEST_ASSERT_EQUAL_UINT32(800, stream(8)); /* all executed */
    TEST_ASSERT_TRUE(rig_bit(&rig, TARGET_REACHED));
    TEST_ASSERT_EQUAL_UINT32(0, stream(18));
    expect_at_the_end();
    rig_ms(&rig, 1000);
    expect_at_the_end();
}

static void test_master_that_stops_sending_on_its_way_causes_an_underrun_on_the_path(void)
{
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    for (int i = 0; i < 400; i++) {
        const struct knot k = on_the_way(i, 800);
        record(k.nm[0], k.nm[1]);
        rig_ms(&rig, 1);
    }
    for (int i = 0; i < 400; i++) {
        rig_ms(&rig, 1);
        TEST_ASSERT_DOUBLE_WITHIN(2e-3, mm(0) / 2, mm(1)); /* on the line */
    }
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF10));
}

static void test_next_record_after_the_end_begins_the_next_stream(void)
{
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    send_way(400, 1, 0);
    rig_ms(&rig, 300);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream(5));
    for (int i = 399; i >= 0; i--) { /* and back */
        const struct knot k = on_the_way(i, 400);
        record(k.nm[0], k.nm[1]);
        TEST_ASSERT_BITS_LOW(1u << TARGET_REACHED, rig_read(&rig, 0x6041, 0)); /* that of the stream before */
        rig_ms(&rig, 1);
    }
    rig_ms(&rig, 300);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream(5));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mm(0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_pause_on_the_way_is_no_end_while_records_keep_coming(void)
{
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    for (int i = 0; i < 900; i++) { /* the first half, a rest of 300 ms, the second half */
        const int at = i < 300 ? i : i < 600 ? 299 : i - 300;
        const struct knot half = on_the_way(at < 300 ? at : at - 300, 300);
        record(half.nm[0] / 2 + (at < 300 ? 0 : 10000000), half.nm[1] / 2 + (at < 300 ? 0 : 5000000));
        rig_ms(&rig, 1);
    }
    rig_ms(&rig, 300);
    expect_at_the_end();
    TEST_ASSERT_EQUAL_UINT32(DONE, stream(5));
    TEST_ASSERT_EQUAL_UINT32(900, stream(8));
}

static void test_total_that_is_set_while_it_runs_is_the_end(void)
{
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    send_way(800, 1, 0);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 4, 4, 799));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 4, 4, 800));
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream(5));
    expect_at_the_end();
}

static void test_total_that_would_end_the_way_at_speed_is_refused_and_the_way_goes_on(void)
{
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    for (int i = 0; i < 900; i++) {
        const struct knot k = on_the_way(i < 800 ? i : 799, 800);
        record(k.nm[0], k.nm[1]);
        rig_ms(&rig, 1);
        if (i == 399) {
            TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 4, 4, 400));
        }
    }
    expect_at_the_end();
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 4, 4, 900));
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream(5));
}

static void test_records_every_ten_milliseconds_make_the_same_way(void)
{
    for (int axis = 0; axis < 2; axis++) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, (uint16_t)(0x60C2 + 0x800 * axis), 1, 1, 10));
    }
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    double fastest = 0;
    for (int i = 0; i < 90; i++) {
        const struct knot k = on_the_way(i < 80 ? i : 79, 80);
        record(k.nm[0], k.nm[1]);
        for (int n = 0; n < 10; n++) {
            rig_ms(&rig, 1);
            fastest = fmax(fastest, rig.plant.vel_mps[0]);
            TEST_ASSERT_DOUBLE_WITHIN(2e-3, mm(0) / 2, mm(1));
        }
    }
    TEST_ASSERT_DOUBLE_WITHIN(2e-3, 2 * 0.02 / 0.69, fastest); /* 69 records of 10 ms; peak twice the mean */
    expect_at_the_end();
    TEST_ASSERT_EQUAL_UINT32(0, stream(18));
}

static void test_period_must_be_the_same_for_both_axes_and_stay_so_while_a_stream_is_open(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C2, 1, 1, 10));
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C1, 1, 4, 0));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x68C1, 1, 4, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68C2, 1, 1, 10));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68C1, 1, 4, 0));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x60C2, 1, 1, 1));
    TEST_ASSERT_EQUAL_UINT32(10, stream(7));
}

static void test_full_queue_refuses_a_record_and_loses_nothing(void)
{
    rig_enable(&rig);
    for (uint16_t axis = 0; axis < 2; axis++) { /* largest and present size of the buffer */
        TEST_ASSERT_EQUAL_UINT32(QUEUE_ROOM, rig_read(&rig, (uint16_t)(0x60C4 + 0x800 * axis), 1));
        TEST_ASSERT_EQUAL_UINT32(QUEUE_ROOM, rig_read(&rig, (uint16_t)(0x60C4 + 0x800 * axis), 2));
    }
    for (int i = 0; i < (int)QUEUE_ROOM; i++) {
        record(i, -i);
    }
    TEST_ASSERT_EQUAL_UINT32(0, stream(16));
    record((int)QUEUE_ROOM, -(int)QUEUE_ROOM);
    TEST_ASSERT_EQUAL_UINT32(1, stream(16));
    TEST_ASSERT_EQUAL_UINT32(QUEUE_ROOM, stream(7));
    TEST_ASSERT_EQUAL_INT32(QUEUE_ROOM - 1, (int32_t)stream(10));
}

static void test_buffer_is_cleared_by_60C4h(void)
{
    rig_enable(&rig);
    record(0, 0);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C4, 6, 1, 1));
    TEST_ASSERT_EQUAL_UINT32(1, stream(7));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C4, 3, 1, 0)); /* its organisation */
    TEST_ASSERT_EQUAL_UINT32(1, stream(7));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68C4, 6, 1, 0));
    TEST_ASSERT_EQUAL_UINT32(0, stream(7));
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream(5));
}

static void test_buffer_position_60C4h_is_the_number_of_knots_that_wait(void)
{
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    for (int i = 0; i < 400; i++) {
        const struct knot k = on_the_way(i, 800);
        record(k.nm[0], k.nm[1]);
    }
    for (int i = 0; i < 3; i++) {
        rig_ms(&rig, 100);
        const uint32_t waiting = 400 - stream(8);
        TEST_ASSERT_TRUE(waiting > 0 && waiting < 400);
        TEST_ASSERT_UINT32_WITHIN(1, waiting, rig_read(&rig, 0x60C4, 4));
        TEST_ASSERT_UINT32_WITHIN(1, waiting, rig_read(&rig, 0x68C4, 4));
    }
}

static void test_record_beyond_the_soft_limits_is_counted_and_a_fault(void)
{
    rig_enable(&rig);
    record(0, 0);
    record(150000001, 0);
    TEST_ASSERT_EQUAL_UINT32(1, stream(20));
    rig_ms(&rig, 3);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF11));
}

static void test_record_after_one_that_was_refused_is_refused_too(void)
{
    static const int32_t beyond[] = {150000001, 30000}; /* the soft limit; 20 um/ms2 */
    for (unsigned i = 0; i < 2; i++) {
        setUp();
        rig_enable(&rig);
        record(0, 0);
        record(beyond[i], 0);
        record(0, 0); /* in the same millisecond: before the fault */
        TEST_ASSERT_EQUAL_UINT32(1, stream(20));
        TEST_ASSERT_EQUAL_UINT32(1, stream(17));
        TEST_ASSERT_EQUAL_UINT32(1, stream(7));
        TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x68C1, 1, 4, 0));
        rig_ms(&rig, 3);
        TEST_ASSERT_TRUE(rig_had_emcy(&rig, i == 0 ? 0xFF11 : 0xFF13));
    }
}

static void test_way_shorter_than_a_stop_starts_once_it_is_whole(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2171, 0, 2, 72));
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    for (int i = 0; i < 10; i++) {
        record(i * 100, 0);
    }
    rig_ms(&rig, 200);
    TEST_ASSERT_EQUAL_UINT32(FILLING, stream(5));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 4, 4, 10));
    rig_ms(&rig, 200);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream(5));
    TEST_ASSERT_DOUBLE_WITHIN(0.2e-3, 900e-6, mm(0));
}

static void test_way_starts_with_the_knots_of_the_lag_and_of_two_records(void)
{
    static const uint32_t lag_ms[] = {4, 72, 4}, record_ms[] = {1, 1, 10};
    for (int n = 0; n < 3; n++) {
        setUp();
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2171, 0, 2, lag_ms[n]));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C2, 1, 1, record_ms[n]));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68C2, 1, 1, record_ms[n]));
        rig_enable(&rig);
        rig_controlwords(&rig, RUN, RUN);
        const uint32_t least = lag_ms[n] + record_ms[n] - 1 + record_ms[n] / 4;
        while (stream(7) < least) {
            TEST_ASSERT_TRUE(stream(7) == 0 || stream(5) == FILLING);
            record(0, 0);
            rig_ms(&rig, 3);
        }
        TEST_ASSERT_EQUAL_UINT32(RUNNING, stream(5));
    }
}

static void test_total_of_0_does_not_end_an_open_stream(void)
{
    rig_enable(&rig);
    record(0, 0);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 4, 4, 0));
    record(0, 0);
    TEST_ASSERT_EQUAL_UINT32(2, stream(7));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 4, 4, 3));
    record(0, 0);
    record(0, 0);
    TEST_ASSERT_EQUAL_UINT32(3, stream(7));
}

static void test_record_begins_the_next_stream_after_one_with_a_total(void)
{
    struct rig_stream s = {.count = 10};
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &s));
    for (int i = 0; i < 10; i++) {
        record(s.x, s.y);
    }
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 50);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream(5));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C2, 1, 1, 10)); /* between streams the period may change */
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68C2, 1, 1, 10));
    record(s.x, s.y);
    TEST_ASSERT_EQUAL_UINT32(FILLING, stream(5));
    TEST_ASSERT_EQUAL_UINT32(10, stream(7)); /* a record is ten knots */
}

static void test_record_begins_nothing_while_the_axes_still_move(void)
{
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    for (int i = 0; i < 400; i++) {
        const struct knot k = on_the_way(i, 800);
        record(k.nm[0], k.nm[1]);
        rig_ms(&rig, 1);
    }
    rig_controlwords(&rig, 0, 0); /* disable voltage: the path ends here, and has not come to rest */
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C1, 1, 4, (int32_t)rig_read(&rig, 0x6064, 0)));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x68C1, 1, 4, (int32_t)rig_read(&rig, 0x6864, 0)));
    TEST_ASSERT_EQUAL_UINT32(400, stream(7));
}

static void test_records_go_into_a_stream_that_was_started_with_a_total(void)
{
    struct rig_stream s = {.count = 10};
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &s));
    for (int i = 0; i < 10; i++) {
        record(s.x, s.y);
    }
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 20);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream(5));
}

static void test_record_between_knot_frames_is_refused(void)
{
    struct rig_stream s = {.count = 10};
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &s));
    rig_knot(&rig, 0, 0, 0);
    record(s.x, s.y); /* by a bus that corrupted the identifier of another frame: it has no checksum of its own */
    TEST_ASSERT_EQUAL_UINT32(1, stream(7));
    TEST_ASSERT_EQUAL_UINT32(1, stream(17));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x68C1, 1, 4, (uint32_t)s.y));
    rig_knot(&rig, 1, 0, 0);
    TEST_ASSERT_EQUAL_UINT32(2, stream(7));
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &s));
    record(s.x, s.y);
    TEST_ASSERT_EQUAL_UINT32(1, stream(7));
}

/* ---- what the drive keeps of the contour error ---- */

static void test_estimated_contour_error_is_kept_over_the_path_time_that_ran(void)
{
    struct rig_stream s = {.count = 1500, .length_nm = 50e6};
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &s));
    rig_feed(&rig, &s, s.count);
    rig_controlwords(&rig, RUN, RUN);
    double sum = 0, max = 0;
    unsigned samples = 0;
    for (int i = 0; i < 1600; i++) {
        rig_ms(&rig, 1);
        if (i % 100 == 0) {
            rig_feed(&rig, &s, s.count);
        }
        const struct servo_snapshot *now = servo_loop_snapshot(&rig.device.drive.loop);
        if (now->path_rate_permille > 0) {
            const double e = fabs((double)now->contour_error_nm);
            sum += e;
            max = fmax(max, e);
            samples++;
        }
    }
    TEST_ASSERT_EQUAL_UINT32(samples, rig_read(&rig, 0x2211, 3));
    TEST_ASSERT_UINT32_WITHIN(1, 1499, samples);
    TEST_ASSERT_EQUAL_UINT32((uint32_t)max, rig_read(&rig, 0x2211, 2));
    TEST_ASSERT_DOUBLE_WITHIN(1, sum * 1000 / samples, rig_read(&rig, 0x2211, 1));
    rig_ms(&rig, 500); /* standing adds nothing */
    TEST_ASSERT_EQUAL_UINT32(samples, rig_read(&rig, 0x2211, 3));
    rig_controlwords(&rig, ENABLE, ENABLE);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &s));
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2211, 3)); /* anew */
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2211, 1));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_first_record_begins_a_stream_from_where_the_axes_are_held);
    RUN_TEST(test_record_too_far_from_where_the_axes_are_begins_nothing);
    RUN_TEST(test_record_of_an_axis_that_is_not_enabled_is_refused);
    RUN_TEST(test_records_by_sdo_count_when_y_is_written);
    RUN_TEST(test_way_in_records_of_a_millisecond_is_followed_to_its_end);
    RUN_TEST(test_master_that_only_stops_sending_at_rest_causes_no_underrun);
    RUN_TEST(test_master_that_stops_sending_on_its_way_causes_an_underrun_on_the_path);
    RUN_TEST(test_next_record_after_the_end_begins_the_next_stream);
    RUN_TEST(test_pause_on_the_way_is_no_end_while_records_keep_coming);
    RUN_TEST(test_total_that_is_set_while_it_runs_is_the_end);
    RUN_TEST(test_total_that_would_end_the_way_at_speed_is_refused_and_the_way_goes_on);
    RUN_TEST(test_records_every_ten_milliseconds_make_the_same_way);
    RUN_TEST(test_period_must_be_the_same_for_both_axes_and_stay_so_while_a_stream_is_open);
    RUN_TEST(test_full_queue_refuses_a_record_and_loses_nothing);
    RUN_TEST(test_buffer_is_cleared_by_60C4h);
    RUN_TEST(test_buffer_position_60C4h_is_the_number_of_knots_that_wait);
    RUN_TEST(test_record_beyond_the_soft_limits_is_counted_and_a_fault);
    RUN_TEST(test_records_go_into_a_stream_that_was_started_with_a_total);
    RUN_TEST(test_record_between_knot_frames_is_refused);
    RUN_TEST(test_estimated_contour_error_is_kept_over_the_path_time_that_ran);
    RUN_TEST(test_record_after_one_that_was_refused_is_refused_too);
    RUN_TEST(test_way_shorter_than_a_stop_starts_once_it_is_whole);
    RUN_TEST(test_way_starts_with_the_knots_of_the_lag_and_of_two_records);
    RUN_TEST(test_total_of_0_does_not_end_an_open_stream);
    RUN_TEST(test_record_begins_the_next_stream_after_one_with_a_total);
    RUN_TEST(test_record_begins_nothing_while_the_axes_still_move);
    return UNITY_END();
}
