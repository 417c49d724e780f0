/* SPDX-License-Identifier: Apache-2.0 */
/* Knot frames: what is taken, what is refused and how it is counted. CRC values come from a polynomial long division
 * written for this purpose (checked on the catalogue's DFh for "123456789"), checksums from zlib. */
#include "motion/queue.h"
#include "unity.h"

static struct od_stream stream;
static struct queue queue;
static struct spline_ring ring;

static const struct knot origin = {{0, 0}};

void setUp(void)
{
    stream = (struct od_stream){0};
    queue_init(&queue, &ring, &stream);
    queue_begin(&queue, origin, 0);
}

void tearDown(void)
{
}

static struct od_knot frame(uint8_t sequence, int32_t dx, int32_t dy)
{
    struct od_knot f = {.sequence = sequence, .dx = dx, .dy = dy};
    f.crc = queue_crc8(&f);
    return f;
}

static enum queue_result give(uint8_t sequence, int32_t dx, int32_t dy)
{
    const struct od_knot f = frame(sequence, dx, dy);
    return queue_frame(&queue, &f);
}

static void expect_rejected(uint32_t sequence, uint32_t crc, uint32_t full, uint32_t state)
{
    TEST_ASSERT_EQUAL_UINT32(sequence, stream.rejected_sequence);
    TEST_ASSERT_EQUAL_UINT32(crc, stream.rejected_crc);
    TEST_ASSERT_EQUAL_UINT32(full, stream.rejected_full);
    TEST_ASSERT_EQUAL_UINT32(state, stream.rejected_state);
}

/* ---- CRC ---- */

static void test_crc_is_that_of_autosar(void)
{
    static const struct {
        struct od_knot frame;
        uint8_t crc;
    } vector[] = {
        {{.sequence = 0, .dx = 0, .dy = 0}, 0x6A},
        {{.sequence = 1, .dx = 1, .dy = -1}, 0x59},
        {{.sequence = 255, .dx = 8388607, .dy = -8388608}, 0xE2},
        {{.sequence = 51, .dx = -5614302, .dy = -2241349}, 0xED},
        {{.sequence = 49, .dx = 3420978, .dy = 3618357}, 0xCF}, /* the text 1234567 */
        {{.sequence = 7, .dx = -123456, .dy = 654321}, 0xAA},
    };
    for (unsigned i = 0; i < sizeof vector / sizeof vector[0]; i++) {
        TEST_ASSERT_EQUAL_HEX8(vector[i].crc, queue_crc8(&vector[i].frame));
    }
}

static void test_every_single_bit_error_of_a_frame_is_refused(void)
{
    const struct od_knot good = frame(0, 123456, -654321);
    for (unsigned bit = 0; bit < 64; bit++) {
        struct od_knot f = good;
        if (bit < 8) {
            f.sequence ^= (uint8_t)(1u << bit);
        } else if (bit < 16) {
            f.crc ^= (uint8_t)(1u << (bit - 8));
        } else if (bit < 40) {
            f.dx = (int32_t)((uint32_t)f.dx ^ 1u << (bit - 16));
        } else {
            f.dy = (int32_t)((uint32_t)f.dy ^ 1u << (bit - 40));
        }
        TEST_ASSERT_EQUAL(QUEUE_BAD_CRC, queue_frame(&queue, &f));
    }
    expect_rejected(0, 64, 0, 0);
    TEST_ASSERT_EQUAL_UINT32(0, stream.accepted);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, queue_frame(&queue, &good));
}

/* ---- sequence ---- */

static void test_knots_add_up_from_the_start(void)
{
    queue_begin(&queue, (struct knot){{1000, -2000}}, 3);
    TEST_ASSERT_EQUAL_INT32(1000, stream.end_x);
    TEST_ASSERT_EQUAL_INT32(-2000, stream.end_y);
    TEST_ASSERT_EQUAL_INT32(1000, ring.start.nm[0]);
    TEST_ASSERT_EQUAL_INT32(-2000, ring.start.nm[1]);
    TEST_ASSERT_EQUAL(STREAM_FILLING, stream.state);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(0, 5, 7));
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(1, -6, 70));
    TEST_ASSERT_EQUAL_INT32(999, stream.end_x);
    TEST_ASSERT_EQUAL_INT32(-1923, stream.end_y);
    TEST_ASSERT_EQUAL_INT32(1005, ring.knot[0].nm[0]);
    TEST_ASSERT_EQUAL_INT32(-1993, ring.knot[0].nm[1]);
    TEST_ASSERT_EQUAL_INT32(999, ring.knot[1].nm[0]);
    TEST_ASSERT_EQUAL_UINT32(2, ring.count);
    TEST_ASSERT_EQUAL_UINT32(2, stream.accepted);
    TEST_ASSERT_EQUAL_UINT16(2, stream.accepted16);
    TEST_ASSERT_EQUAL_UINT16(QUEUE_ROOM - 2, stream.free);
}

static void test_duplicate_and_gap_are_refused_and_change_nothing(void)
{
    give(0, 10, 10);
    TEST_ASSERT_EQUAL(QUEUE_OUT_OF_SEQUENCE, give(0, 10, 10));
    TEST_ASSERT_EQUAL(QUEUE_OUT_OF_SEQUENCE, give(2, 10, 10));
    TEST_ASSERT_EQUAL(QUEUE_OUT_OF_SEQUENCE, give(255, 10, 10));
    expect_rejected(3, 0, 0, 0);
    TEST_ASSERT_EQUAL_INT32(10, stream.end_x);
    TEST_ASSERT_EQUAL_UINT32(1, stream.accepted);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(1, 10, 10));
}

static void test_sequence_wraps_after_255(void)
{
    for (unsigned i = 0; i < 600; i++) {
        TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give((uint8_t)i, 1, -1));
    }
    TEST_ASSERT_EQUAL_INT32(600, stream.end_x);
    TEST_ASSERT_EQUAL_INT32(-600, stream.end_y);
}

static void test_differences_reach_both_ends_of_24_bits(void)
{
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(0, 8388607, -8388608));
    TEST_ASSERT_EQUAL_INT32(8388607, stream.end_x);
    TEST_ASSERT_EQUAL_INT32(-8388608, stream.end_y);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(1, -8388608, 8388607));
    TEST_ASSERT_EQUAL_INT32(-1, stream.end_x);
    TEST_ASSERT_EQUAL_INT32(-1, stream.end_y);
}

static void test_sum_beyond_int32_ends_at_its_limit(void)
{
    queue_begin(&queue, (struct knot){{INT32_MAX - 5, INT32_MIN + 5}}, 0);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(0, 6, -6));
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, stream.end_x);
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, stream.end_y);
}

/* ---- room ---- */

static void fill(unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, queue_push(&queue, (struct knot){{(int32_t)i, 0}}));
    }
}

static void test_full_queue_takes_no_more_until_knots_are_executed(void)
{
    TEST_ASSERT_EQUAL_UINT16(QUEUE_ROOM, stream.free);
    fill(QUEUE_ROOM);
    TEST_ASSERT_EQUAL_UINT16(0, stream.free);
    TEST_ASSERT_EQUAL(QUEUE_FULL, give((uint8_t)QUEUE_ROOM, 1, 1));
    expect_rejected(0, 0, 1, 0);
    queue_executed(&queue, 3);
    TEST_ASSERT_EQUAL_UINT16(3, stream.free);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give((uint8_t)QUEUE_ROOM, 1, 1));
    TEST_ASSERT_EQUAL_UINT16(2, stream.free);
    TEST_ASSERT_EQUAL_UINT32(QUEUE_ROOM + 1u, stream.accepted);
}

static void test_knots_behind_the_path_are_kept_for_a_lagging_foot_point(void)
{
    fill(QUEUE_ROOM);
    queue_executed(&queue, 500);
    for (int32_t i = QUEUE_ROOM; i < (int32_t)QUEUE_ROOM + 500; i++) {
        TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, queue_push(&queue, (struct knot){{i, 0}}));
    }
    for (int32_t i = 500 - 32; i < (int32_t)QUEUE_ROOM + 500; i++) {
        TEST_ASSERT_EQUAL_INT32(i, ring.knot[(uint32_t)i % SPLINE_RING].nm[0]);
    }
}

static void test_complete_stream_takes_no_more(void)
{
    queue_begin(&queue, origin, 3);
    TEST_ASSERT_FALSE(queue_complete(&queue));
    fill(2);
    TEST_ASSERT_FALSE(queue_complete(&queue));
    fill(1);
    TEST_ASSERT_TRUE(queue_complete(&queue));
    TEST_ASSERT_EQUAL(QUEUE_FULL, give(3, 1, 1));
    TEST_ASSERT_EQUAL_UINT32(3, stream.accepted);
}

static void test_open_ended_stream_is_never_complete(void)
{
    TEST_ASSERT_FALSE(queue_complete(&queue));
    fill(900);
    TEST_ASSERT_FALSE(queue_complete(&queue));
}

static void test_total_written_for_the_next_stream_does_not_touch_this_one(void)
{
    queue_begin(&queue, origin, 5);
    fill(3);
    stream.total = 3;
    TEST_ASSERT_FALSE(queue_complete(&queue));
    stream.total = 100;
    fill(2);
    TEST_ASSERT_TRUE(queue_complete(&queue));
}

/* ---- not open ---- */

static void test_frames_without_a_stream_count_as_such_whatever_their_number(void)
{
    queue_hold(&queue, origin);
    TEST_ASSERT_EQUAL(QUEUE_NOT_OPEN, give(0, 1, 1));
    TEST_ASSERT_EQUAL(QUEUE_NOT_OPEN, give(9, 1, 1));
    struct od_knot bad = frame(0, 1, 1);
    bad.crc ^= 1u;
    TEST_ASSERT_EQUAL(QUEUE_NOT_OPEN, queue_frame(&queue, &bad));
    expect_rejected(0, 0, 0, 3);
    TEST_ASSERT_EQUAL_UINT32(0, stream.accepted);
}

static void test_queue_is_closed_at_power_on(void)
{
    stream.rejected_crc = stream.rejected_full = stream.rejected_state = stream.rejected_sequence = 7;
    stream.rejected_length = 7;
    stream.underruns = 7;
    queue_init(&queue, &ring, &stream);
    TEST_ASSERT_EQUAL(QUEUE_NOT_OPEN, give(0, 1, 1));
    TEST_ASSERT_EQUAL_UINT16(QUEUE_ROOM, stream.free);
    TEST_ASSERT_EQUAL_UINT32(0, stream.underruns);
    expect_rejected(0, 0, 0, 1);
    TEST_ASSERT_EQUAL_UINT32(0, stream.rejected_length);
}

static void test_closed_queue_keeps_its_knots_and_takes_no_more(void)
{
    fill(10);
    queue_close(&queue);
    TEST_ASSERT_EQUAL(QUEUE_NOT_OPEN, give(10, 1, 1));
    TEST_ASSERT_EQUAL_UINT32(10, ring.count);
}

static void test_begin_forgets_knots_and_counters(void)
{
    fill(10);
    give(99, 0, 0);
    queue_executed(&queue, 5);
    stream.underruns = 2;
    stream.rejected_crc = stream.rejected_full = stream.rejected_state = 7;
    queue_begin(&queue, (struct knot){{5, 6}}, 50);
    expect_rejected(0, 0, 0, 0);
    TEST_ASSERT_EQUAL_UINT32(0, stream.accepted);
    TEST_ASSERT_EQUAL_UINT16(0, stream.accepted16);
    TEST_ASSERT_EQUAL_UINT32(0, stream.executed);
    TEST_ASSERT_EQUAL_UINT32(0, stream.checksum);
    TEST_ASSERT_EQUAL_UINT32(0, stream.underruns);
    TEST_ASSERT_EQUAL_UINT32(0, ring.count);
    TEST_ASSERT_EQUAL_UINT16(QUEUE_ROOM, stream.free);
}

/* ---- soft limits ---- */

static void test_knot_on_the_soft_limit_is_taken_and_one_beyond_ends_the_stream(void)
{
    queue.min_nm[0] = -100;
    queue.max_nm[0] = 100;
    queue.min_nm[1] = -50;
    queue.max_nm[1] = 50;
    queue_begin(&queue, origin, 0);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(0, 100, -50));
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(1, -200, 100));
    TEST_ASSERT_FALSE(queue.outside);
    TEST_ASSERT_EQUAL(QUEUE_OUTSIDE, give(2, -1, 0));
    TEST_ASSERT_TRUE(queue.outside);
    TEST_ASSERT_EQUAL_INT32(-100, stream.end_x);
    TEST_ASSERT_EQUAL(QUEUE_NOT_OPEN, give(2, 0, 0));
    TEST_ASSERT_EQUAL_UINT32(2, stream.accepted);
    TEST_ASSERT_EQUAL_UINT32(1, stream.rejected_range);
}

static void test_stream_that_starts_outside_the_soft_limits_may_come_back_but_go_no_further(void)
{
    queue.min_nm[0] = queue.min_nm[1] = -100;
    queue.max_nm[0] = queue.max_nm[1] = 100;
    queue_begin(&queue, (struct knot){{150, 0}}, 0);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(0, 0, 0));
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(1, -60, 0));
    TEST_ASSERT_EQUAL(QUEUE_OUTSIDE, give(2, 61, 0));
}

/* ---- origin ---- */

static void test_origin_lies_between_the_users_positions_and_the_rings(void)
{
    queue.origin_nm[0] = 1000;
    queue.origin_nm[1] = -500;
    queue_begin(&queue, (struct knot){{7, 8}}, 0);
    TEST_ASSERT_EQUAL_INT32(-993, ring.start.nm[0]);
    TEST_ASSERT_EQUAL_INT32(508, ring.start.nm[1]);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(0, 10, 20));
    TEST_ASSERT_EQUAL_INT32(17 - 1000, ring.knot[0].nm[0]);
    TEST_ASSERT_EQUAL_INT32(28 + 500, ring.knot[0].nm[1]);
    TEST_ASSERT_EQUAL_INT32(17, stream.end_x);
    TEST_ASSERT_EQUAL_INT32(28, stream.end_y);
    const struct knot user = queue_user(&queue, ring.knot[0]);
    TEST_ASSERT_EQUAL_INT32(17, user.nm[0]);
    TEST_ASSERT_EQUAL_INT32(28, user.nm[1]);
}

static void test_checksum_is_that_of_the_users_positions(void)
{
    queue_begin(&queue, (struct knot){{7, 8}}, 0);
    give(0, 10, 20);
    queue_executed(&queue, 1);
    const uint32_t checksum = stream.checksum;
    queue.origin_nm[0] = -123456;
    queue_begin(&queue, (struct knot){{7, 8}}, 0);
    give(0, 10, 20);
    queue_executed(&queue, 1);
    TEST_ASSERT_EQUAL_HEX32(checksum, stream.checksum);
}

static void test_knot_that_the_servo_cannot_count_is_refused(void)
{
    queue.min_nm[0] = -2000000000;
    queue.max_nm[0] = 2000000000;
    queue.origin_nm[0] = 2000000000;
    queue_begin(&queue, (struct knot){{0, 0}}, 0);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, queue_push(&queue, (struct knot){{-147483648, 0}}));
    TEST_ASSERT_EQUAL(QUEUE_OUTSIDE, queue_push(&queue, (struct knot){{-147483649, 0}}));
}

static void test_knot_that_the_servo_cannot_count_upwards_is_refused(void)
{
    queue.origin_nm[1] = -2000000000;
    queue_begin(&queue, origin, 0);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, queue_push(&queue, (struct knot){{0, 147483647}}));
    TEST_ASSERT_EQUAL(QUEUE_OUTSIDE, queue_push(&queue, (struct knot){{0, 147483648}}));
}

/* ---- acceleration ---- */

static void test_knot_that_bends_the_way_by_more_than_the_limit_ends_the_stream_in_each_direction(void)
{
    for (int axis = 0; axis < 2; axis++) {
        for (int sign = -1; sign <= 1; sign += 2) {
            queue_begin(&queue, origin, 0);
            queue_limit_acceleration(&queue, 100);
            TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(0, axis == 0 ? sign * 100 : 0, axis == 1 ? sign * 100 : 0));
            TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(1, axis == 0 ? sign * 200 : 0, axis == 1 ? sign * 200 : 0));
            TEST_ASSERT_EQUAL(QUEUE_OUTSIDE, give(2, axis == 0 ? sign * 301 : 0, axis == 1 ? sign * 301 : 0));
            TEST_ASSERT_EQUAL_UINT32(1, stream.rejected_range);
            TEST_ASSERT_EQUAL(QUEUE_NOT_OPEN, give(2, axis == 0 ? sign * 200 : 0, axis == 1 ? sign * 200 : 0));
            expect_rejected(0, 0, 0, 1);
        }
    }
}

/* A last step that the limit lets vanish is a way to end; in each direction */
static void test_stream_does_not_end_at_speed(void)
{
    static const int32_t step[4][2] = {{101, 0}, {-101, 0}, {0, 101}, {0, -101}};
    for (unsigned i = 0; i < 4; i++) {
        const int32_t x = step[i][0], y = step[i][1];
        queue_begin(&queue, origin, 3);
        queue_limit_acceleration(&queue, 100);
        give(0, x / 2, y / 2);
        TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(1, x, y));
        TEST_ASSERT_EQUAL(QUEUE_OUTSIDE, give(2, x, y));
        TEST_ASSERT_TRUE(queue.over_acceleration && !queue_complete(&queue));
        TEST_ASSERT_EQUAL_UINT32(1, stream.rejected_range);
        queue_begin(&queue, origin, 3);
        queue_limit_acceleration(&queue, 100);
        give(0, x / 2, y / 2);
        give(1, x, y);
        TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(2, x / 2 * 2, y / 2 * 2));
        TEST_ASSERT_TRUE(queue_complete(&queue));
        queue_begin(&queue, origin, 0);
        queue_limit_acceleration(&queue, 100);
        give(0, x / 2, y / 2);
        give(1, x, y);
        TEST_ASSERT_FALSE(queue_end(&queue, 2));
        TEST_ASSERT_FALSE(queue_complete(&queue));
        TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(2, x / 2 * 2, y / 2 * 2));
        TEST_ASSERT_TRUE(queue_end(&queue, 3));
    }
}

/* ---- suspended ---- */

static void test_suspended_stream_goes_on_where_it_was_once_it_has_stopped(void)
{
    fill(10);
    queue_suspend(&queue);
    TEST_ASSERT_EQUAL(QUEUE_NOT_OPEN, give(10, 1, 0));
    stream.state = STREAM_STOPPING;
    TEST_ASSERT_FALSE(queue_resume(&queue));
    stream.state = STREAM_STOPPED;
    TEST_ASSERT_TRUE(queue_resume(&queue));
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, give(10, 1, 0));
    TEST_ASSERT_FALSE_MESSAGE(queue_resume(&queue), "it goes on already");
}

static void limit_to(int32_t min, int32_t max)
{
    queue.min_nm[0] = queue.min_nm[1] = min;
    queue.max_nm[0] = queue.max_nm[1] = max;
}

static bool resumes(void)
{
    queue_suspend(&queue);
    stream.state = STREAM_STOPPED;
    return queue_resume(&queue);
}

static void test_suspended_stream_goes_on_only_within_the_soft_limits_of_then(void)
{
    static const int32_t way[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
    for (unsigned i = 0; i < 4; i++) {
        limit_to(-1000, 1000);
        queue_begin(&queue, origin, 0);
        for (uint8_t n = 0; n < 100; n++) {
            give(n, way[i][0], way[i][1]);
        }
        limit_to(-99, 99);
        TEST_ASSERT_FALSE(resumes());
        TEST_ASSERT_EQUAL(QUEUE_NOT_OPEN, give(100, 0, 0));
        limit_to(-100, 100);
        TEST_ASSERT_TRUE(resumes());
        TEST_ASSERT_EQUAL(QUEUE_OUTSIDE, give(100, way[i][0], way[i][1]));
    }
}

static void test_suspended_stream_that_comes_back_to_the_soft_limits_goes_on(void)
{
    limit_to(-100, 100);
    queue_begin(&queue, (struct knot){{150, 0}}, 0);
    give(0, -10, 0);
    TEST_ASSERT_TRUE(resumes());
    queue_executed(&queue, 1);
    give(1, -10, 0);
    TEST_ASSERT_TRUE(resumes());
    TEST_ASSERT_EQUAL(QUEUE_OUTSIDE, give(2, 11, 0));
}

static void test_stream_that_a_knot_has_ended_cannot_go_on(void)
{
    queue_limit_acceleration(&queue, 100);
    TEST_ASSERT_EQUAL(QUEUE_OUTSIDE, give(0, 101, 0));
    queue_suspend(&queue);
    stream.state = STREAM_STOPPED;
    TEST_ASSERT_FALSE(queue_resume(&queue));
    queue.max_nm[0] = 50;
    queue_begin(&queue, origin, 0);
    TEST_ASSERT_EQUAL(QUEUE_OUTSIDE, give(0, 51, 0));
    queue_suspend(&queue);
    stream.state = STREAM_STOPPED;
    TEST_ASSERT_FALSE(queue_resume(&queue));
}

/* ---- open end ---- */

static void test_stream_rests_when_its_last_four_knots_are_equal(void)
{
    queue_begin(&queue, origin, 0);
    for (uint8_t i = 0; i < 4; i++) {
        TEST_ASSERT_FALSE(queue_ends_standing(&queue));
        give(i, i == 0 ? 5 : 0, 0);
    }
    TEST_ASSERT_TRUE(queue_ends_standing(&queue));
    give(4, 0, 1);
    TEST_ASSERT_FALSE(queue_ends_standing(&queue));
}

static void test_open_ended_stream_is_given_its_end_while_it_is_open(void)
{
    queue_begin(&queue, origin, 0);
    give(0, 1, 1);
    give(1, 1, 1);
    TEST_ASSERT_FALSE_MESSAGE(queue_end(&queue, 1), "it has more already");
    TEST_ASSERT_FALSE(queue_end(&queue, 0));
    TEST_ASSERT_TRUE(queue_end(&queue, 2));
    TEST_ASSERT_TRUE(queue_complete(&queue));
    TEST_ASSERT_FALSE_MESSAGE(queue_end(&queue, 3), "it has an end");
    queue_begin(&queue, origin, 10);
    TEST_ASSERT_FALSE(queue_end(&queue, 20));
    queue_begin(&queue, origin, 0);
    queue_close(&queue);
    TEST_ASSERT_FALSE(queue_end(&queue, 20));
}

static void test_each_of_the_four_soft_limits_is_watched(void)
{
    static const int32_t beyond[4][2] = {{101, 0}, {-101, 0}, {0, 101}, {0, -101}};
    for (unsigned i = 0; i < 4; i++) {
        queue.min_nm[0] = queue.min_nm[1] = -100;
        queue.max_nm[0] = queue.max_nm[1] = 100;
        queue_begin(&queue, origin, 0);
        TEST_ASSERT_FALSE(queue.outside);
        TEST_ASSERT_EQUAL(QUEUE_OUTSIDE, give(0, beyond[i][0], beyond[i][1]));
    }
}

/* ---- executed ---- */

static void push_test_knot(uint32_t i)
{
    const struct knot k = {{(int32_t)(i * 7919u % 20001u) - 10000, (int32_t)((uint64_t)i * 104729u % 30011u) - 15005}};
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, queue_push(&queue, k));
}

static void test_checksum_is_zlibs_crc32_of_the_executed_knots_across_the_wrap_of_the_ring(void)
{
    uint32_t pushed = 0;
    queue_begin(&queue, origin, 5000);
    for (uint32_t done = 0; done < 5000; done += 13) {
        while (pushed < 5000 && stream.free > 0) {
            push_test_knot(pushed++);
        }
        queue_executed(&queue, done);
        TEST_ASSERT_EQUAL_UINT32(done, stream.executed);
        TEST_ASSERT_EQUAL_UINT16(QUEUE_ROOM - (pushed - done), stream.free);
    }
    TEST_ASSERT_EQUAL_UINT32(5000, stream.accepted);
    TEST_ASSERT_EQUAL_UINT16(5000, stream.accepted16);
    TEST_ASSERT_TRUE(queue_complete(&queue));
    queue_executed(&queue, 5000);
    TEST_ASSERT_EQUAL_HEX32(0xDB348984, stream.checksum);
    TEST_ASSERT_EQUAL_UINT16(QUEUE_ROOM, stream.free);
}

static void test_checksum_of_extreme_knot(void)
{
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, queue_push(&queue, (struct knot){{INT32_MIN, INT32_MAX}}));
    queue_executed(&queue, 1);
    TEST_ASSERT_EQUAL_HEX32(0xE7C7CC38, stream.checksum);
}

static void test_executed_never_passes_accepted_and_never_goes_back(void)
{
    fill(10);
    queue_executed(&queue, 99);
    TEST_ASSERT_EQUAL_UINT32(10, stream.executed);
    queue_executed(&queue, 4);
    TEST_ASSERT_EQUAL_UINT32(10, stream.executed);
}

static void test_accepted_reports_its_low_16_bits(void)
{
    for (uint32_t i = 0; i < 70000; i++) {
        push_test_knot(i);
        queue_executed(&queue, i);
    }
    TEST_ASSERT_EQUAL_UINT32(70000, stream.accepted);
    TEST_ASSERT_EQUAL_UINT16(70000 - 65536, stream.accepted16);
}

static void test_open_ended_stream_is_done_when_the_path_stands_and_only_its_last_interval_is_left(void)
{
    for (uint32_t left = 4; left <= 5; left++) {
        setUp();
        for (int i = 0; i < 20; i++) {
            TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, queue_push(&queue, origin));
        }
        const struct path_progress path = {.current = true, .standing = true, .at_end = true, .executed = 20 - left};
        queue_follow(&queue, &path, true, false);
        TEST_ASSERT_EQUAL(left == 4, stream.state == STREAM_DONE);
        TEST_ASSERT_EQUAL(left == 4, !queue.open);
        TEST_ASSERT_EQUAL_UINT32(left == 4 ? 20 : 15, stream.executed);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_crc_is_that_of_autosar);
    RUN_TEST(test_every_single_bit_error_of_a_frame_is_refused);
    RUN_TEST(test_knots_add_up_from_the_start);
    RUN_TEST(test_duplicate_and_gap_are_refused_and_change_nothing);
    RUN_TEST(test_sequence_wraps_after_255);
    RUN_TEST(test_differences_reach_both_ends_of_24_bits);
    RUN_TEST(test_sum_beyond_int32_ends_at_its_limit);
    RUN_TEST(test_full_queue_takes_no_more_until_knots_are_executed);
    RUN_TEST(test_knots_behind_the_path_are_kept_for_a_lagging_foot_point);
    RUN_TEST(test_complete_stream_takes_no_more);
    RUN_TEST(test_open_ended_stream_is_never_complete);
    RUN_TEST(test_total_written_for_the_next_stream_does_not_touch_this_one);
    RUN_TEST(test_frames_without_a_stream_count_as_such_whatever_their_number);
    RUN_TEST(test_queue_is_closed_at_power_on);
    RUN_TEST(test_closed_queue_keeps_its_knots_and_takes_no_more);
    RUN_TEST(test_begin_forgets_knots_and_counters);
    RUN_TEST(test_knot_on_the_soft_limit_is_taken_and_one_beyond_ends_the_stream);
    RUN_TEST(test_stream_that_starts_outside_the_soft_limits_may_come_back_but_go_no_further);
    RUN_TEST(test_origin_lies_between_the_users_positions_and_the_rings);
    RUN_TEST(test_checksum_is_that_of_the_users_positions);
    RUN_TEST(test_knot_that_the_servo_cannot_count_is_refused);
    RUN_TEST(test_stream_rests_when_its_last_four_knots_are_equal);
    RUN_TEST(test_open_ended_stream_is_given_its_end_while_it_is_open);
    RUN_TEST(test_each_of_the_four_soft_limits_is_watched);
    RUN_TEST(test_checksum_is_zlibs_crc32_of_the_executed_knots_across_the_wrap_of_the_ring);
    RUN_TEST(test_checksum_of_extreme_knot);
    RUN_TEST(test_executed_never_passes_accepted_and_never_goes_back);
    RUN_TEST(test_accepted_reports_its_low_16_bits);
    RUN_TEST(test_knot_that_the_servo_cannot_count_upwards_is_refused);
    RUN_TEST(test_knot_that_bends_the_way_by_more_than_the_limit_ends_the_stream_in_each_direction);
    RUN_TEST(test_stream_does_not_end_at_speed);
    RUN_TEST(test_suspended_stream_goes_on_where_it_was_once_it_has_stopped);
    RUN_TEST(test_suspended_stream_goes_on_only_within_the_soft_limits_of_then);
    RUN_TEST(test_suspended_stream_that_comes_back_to_the_soft_limits_goes_on);
    RUN_TEST(test_stream_that_a_knot_has_ended_cannot_go_on);
    RUN_TEST(test_open_ended_stream_is_done_when_the_path_stands_and_only_its_last_interval_is_left);
    return UNITY_END();
}
