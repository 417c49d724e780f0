/* SPDX-License-Identifier: Apache-2.0 */
/* test_spline.c: the B-spline of the reference trajectory, path time, and the cache of pieces. */
#include "core/spline.h"

#include "nominal.h"
#include "unity.h"

static struct spline_ring ring;

void setUp(void)
{
    ring.count = 0;
    ring.start = (struct knot){{0, 0}};
}
void tearDown(void)
{
}

static struct spline_point at(double knots)
{
    struct spline_point p;
    const struct path_state path = path_at(&ring, knots);
    spline_at(&ring, path.count, path_s(&path), &p);
    return p;
}

static double um_of(pos_t p)
{
    return (double)p / (POS_PER_NM * 1e3);
}

/* Tolerance of a position. In fixed point 1/6 is half a step
 * off, which is multiplied by second differences of up to 36 um. */
#define POS (1e-8 + HALF_STEPS(40))

/* Knots 2, 3, 4, 5 are 1.5, 3, 7.5, 3 um in x, and minus twice that in y. */
static void four_knots(void)
{
    const double x[] = {0, 0, 1.5, 3, 7.5, 3, 0};
    for (int i = 0; i < 7; i++) {
        add_knot(&ring, x[i], -2 * x[i]);
    }
}

static void test_at_a_knot_the_curve_passes_through_a_sixth_of_before_four_times_it_and_after(void)
{
    four_knots();
    TEST_ASSERT_DOUBLE_WITHIN(POS, 3.5, um_of(at(3).pos[0])); /* (1.5 + 12 + 7.5)/6 */
    TEST_ASSERT_DOUBLE_WITHIN(POS, -7.0, um_of(at(3).pos[1]));
    TEST_ASSERT_DOUBLE_WITHIN(POS, 6.0, um_of(at(4).pos[0])); /* (3 + 30 + 3)/6 */
}

static void test_derivatives_at_a_knot_are_differences_of_knots(void)
{
    four_knots();
    const struct spline_point p = at(3); /* h = 0.2 */
    ASSERT_NEAR(6.0 / 0.4, val(p.d1.x), 15.0);
    ASSERT_NEAR(-12.0 / 0.4, val(p.d1.y), 30.0);
    ASSERT_NEAR((1.5 - 6.0 + 7.5) / 0.04, val(p.d2.x), 375.0);
    ASSERT_NEAR((3.0 - 3 * 7.5 + 3 * 3.0 - 1.5) / 0.008, val(p.d3.x), 4500.0);
    ASSERT_NEAR(-2 * (3.0 - 3 * 7.5 + 3 * 3.0 - 1.5) / 0.008, val(p.d3.y), 9000.0);
}

static void test_halfway_the_weights_are_1_23_23_1_of_48(void)
{
    four_knots();
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 + POS, (1.5 + 23 * 3.0 + 23 * 7.5 + 3) / 48.0, um_of(at(3.5).pos[0]));
}

static void test_derivatives_are_those_of_the_position_by_finite_differences(void)
{
    circle_ring(&ring, 4000, 0.025, 100);
    for (double s = 50.1; s < 51.0; s += 0.2) {
        const double h = 0.01;
        const struct spline_point before = at(s - h), p = at(s), after = at(s + h);
        const double dt = 2 * h * 0.2;
        /* The error of the differences is h^2/6 r''' <= (0.002)^2/6 * 500 (0.125)^2,
         * and two positions of 1e-5 um rounding. In fixed point it is half a step of
         * u times 100 um a knot, and 15 and 50 roundings of each derivative. */
        TEST_ASSERT_DOUBLE_WITHIN(0.01 + HALF_STEPS(220) / dt, (um_of(after.pos[0]) - um_of(before.pos[0])) / dt,
                                  val(p.d1.x));
        TEST_ASSERT_DOUBLE_WITHIN(0.01 + HALF_STEPS(220) / dt, (um_of(after.pos[1]) - um_of(before.pos[1])) / dt,
                                  val(p.d1.y));
        TEST_ASSERT_DOUBLE_WITHIN(0.05 + HALF_STEPS(30) / dt, (val(after.d1.x) - val(before.d1.x)) / dt, val(p.d2.x));
        TEST_ASSERT_DOUBLE_WITHIN(0.01 + HALF_STEPS(100) / dt, (val(after.d2.y) - val(before.d2.y)) / dt, val(p.d3.y));
    }
}

static void test_position_velocity_and_acceleration_are_continuous_across_a_knot(void)
{
    four_knots();
    for (int i = 1; i < 6; i++) {
        const struct spline_point before = at(i - 1e-6), after = at(i);
        TEST_ASSERT_DOUBLE_WITHIN(1e-4, um_of(before.pos[0]), um_of(after.pos[0]));
        TEST_ASSERT_DOUBLE_WITHIN(1e-2, val(before.d1.x), val(after.d1.x));
        TEST_ASSERT_DOUBLE_WITHIN(1e-2, val(before.d2.x),
                                  val(after.d2.x)); /* the jerk changes it by 4e-3 in 1e-6 knots */
    }
}

static void test_knots_on_a_line_give_uniform_motion(void)
{
    line_ring(&ring, 10, -20, 3, -4, 50);
    const struct spline_point p = at(20.3);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 + HALF_STEPS(8), 10 + 3 * 20.3, um_of(p.pos[0]));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 + HALF_STEPS(8), -20 - 4 * 20.3, um_of(p.pos[1]));
    ASSERT_NEAR(15, val(p.d1.x), 15.0);
    ASSERT_NEAR(-20, val(p.d1.y), 20.0);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(p.d2.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(p.d3.y));
}

static void test_before_the_first_knot_the_sequence_goes_on_with_the_start(void)
{
    ring.start = (struct knot){{6000, -6000}};
    add_knot(&ring, 12, 0);
    add_knot(&ring, 30, 0);
    TEST_ASSERT_DOUBLE_WITHIN(POS, 14.0, um_of(at(0).pos[0]));
    TEST_ASSERT_DOUBLE_WITHIN(POS, -1.0, um_of(at(0).pos[1]));
}

static void test_after_the_last_knot_the_curve_rests_on_it(void)
{
    four_knots();
    ring.knot[6] = (struct knot){{77000, -5000}};
    const struct spline_point p = at(8);
    TEST_ASSERT_EQUAL_DOUBLE(77, um_of(p.pos[0]));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(p.d1.x));
    TEST_ASSERT_EQUAL_DOUBLE(-5, um_of(at(1000).pos[1]));
}

static void test_without_knots_the_curve_rests_on_the_start(void)
{
    ring.start = (struct knot){{-7000, 8000}};
    const struct spline_point p = at(3.3);
    TEST_ASSERT_EQUAL_DOUBLE(-7, um_of(p.pos[0]));
    TEST_ASSERT_EQUAL_DOUBLE(8, um_of(p.pos[1]));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(p.d1.y));
}

static void test_a_ring_that_has_wrapped_gives_the_newest_knots(void)
{
    line_ring(&ring, 0, 0, 3, -4, 3 * SPLINE_RING + 17);
    const double s = 3 * SPLINE_RING - 0.75;
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 3 * s, um_of(at(s).pos[0]));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, -4 * s, um_of(at(s).pos[1]));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 3 * (s - SPLINE_PAST), um_of(at(s - SPLINE_PAST).pos[0]));
}

static void test_knots_beyond_the_snapshot_are_not_seen(void)
{
    line_ring(&ring, 0, 0, 3, 0, 50);
    struct spline_point p;
    spline_at(&ring, 20, path_time_of(30), &p);
    TEST_ASSERT_EQUAL_DOUBLE(3 * 19, um_of(p.pos[0]));
}

static void test_two_metres_out_the_curve_is_the_same_to_the_last_bit(void)
{
    four_knots();
    const struct spline_point here = at(3.37);
    for (uint32_t i = 0; i < ring.count; i++) {
        ring.knot[i].nm[0] += 2000000000;
        ring.knot[i].nm[1] -= 2000000000;
    }
    const struct spline_point far = at(3.37);
    TEST_ASSERT_TRUE(far.pos[0] - here.pos[0] == pos_from_nm(2000000000));
    TEST_ASSERT_TRUE(far.pos[1] - here.pos[1] == pos_from_nm(-2000000000));
    TEST_ASSERT_EQUAL_DOUBLE(val(here.d2.x), val(far.d2.x));
}

static void test_control_periods_of_10_and_20_khz_are_whole_numbers_of_path_time(void)
{
    TEST_ASSERT_TRUE(PATH_ONE % 10 == 0);
    TEST_ASSERT_TRUE(PATH_ONE % 20 == 0);
}

static void test_knots_passed_are_those_of_a_division_however_long_the_path(void)
{
    static const path_time_t knots[] = {0,         1,          4,          5,          858993458, 858993459,
                                        858993460, 1717986917, 1717986918, 1717986919, 3435973835};
    for (unsigned i = 0; i < sizeof knots / sizeof knots[0]; i++) {
        for (path_time_t part = 0; part < PATH_ONE; part += PATH_ONE - 1) {
            uint32_t fraction = 0;
            TEST_ASSERT_EQUAL_UINT32(knots[i], path_knots(knots[i] * PATH_ONE + part, &fraction));
            TEST_ASSERT_EQUAL_UINT32(part, fraction);
        }
    }
}

static void test_piece_of_a_ring_that_was_emptied_is_made_anew(void)
{
    struct spline_cache cache = {0};
    struct spline_piece empty;
    four_knots();
    const num before = spline_cached_piece(&cache, &ring, ring.count, 3)->c1.x;
    TEST_ASSERT_TRUE(val(before) != 0);
    TEST_ASSERT_EQUAL_UINT32(4, spline_cached_piece(&cache, &ring, ring.count, 3)->final);
    TEST_ASSERT_EQUAL_UINT32(0, spline_cached_piece(&cache, &ring, ring.count, 5)->final); /* knot 7 may still come */
    spline_piece(&ring, 0, 3, &empty); /* the background loop has emptied the ring, and the next path has not started */
    TEST_ASSERT_EQUAL_DOUBLE(0, val(empty.c1.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(spline_cached_piece(&cache, &ring, 0, 3)->c1.x));
}

/* How many pieces from that of `knot` on are in the cache */
static uint32_t cached(const struct spline_cache *cache, uint32_t knot)
{
    uint32_t n = 0;
    while (n < SPLINE_CACHE_SIZE && cache->piece[(knot + n) % SPLINE_CACHE_SIZE].final == knot + n + 1u) {
        n++;
    }
    return n;
}

static void test_pieces_ahead_are_prefetched_one_in_a_period_up_to_the_look_ahead(void)
{
    struct spline_cache cache = {0};
    for (int i = 0; i < 60; i++) {
        add_knot(&ring, i, i * i);
    }
    for (uint32_t n = 1; n <= 12; n++) {
        spline_prefetch(&cache, &ring, 60, 0);
        TEST_ASSERT_EQUAL_UINT32(n < SPLINE_LOOKAHEAD + 1u ? n : SPLINE_LOOKAHEAD + 1u, cached(&cache, 0));
    }
    spline_prefetch(&cache, &ring, 60, 30); /* path time has jumped */
    TEST_ASSERT_EQUAL_UINT32(1, cached(&cache, 30));
    for (int i = 0; i < 20; i++) {
        spline_prefetch(&cache, &ring, 35, 30); /* fewer knots are accepted: pieces 30, 31, 32 have all of theirs */
    }
    TEST_ASSERT_EQUAL_UINT32(3, cached(&cache, 30));
}

static void test_period_whose_foot_point_moved_to_another_piece_prefetches_none_unless_it_is_close(void)
{
    struct spline_cache cache = {0};
    for (int i = 0; i < 60; i++) {
        add_knot(&ring, i, i * i);
    }
    for (uint32_t n = 1; n <= 3; n++) { /* 0, 1 and 2 knots ahead */
        cache.piece_changed = true;
        spline_prefetch(&cache, &ring, 60, 0);
        TEST_ASSERT_EQUAL_UINT32(n, cached(&cache, 0));
    }
    cache.piece_changed = true;
    spline_prefetch(&cache, &ring, 60, 0);
    TEST_ASSERT_EQUAL_UINT32(3, cached(&cache, 0));
    spline_prefetch(&cache, &ring, 60, 0); /* the next period has time for it */
    TEST_ASSERT_EQUAL_UINT32(4, cached(&cache, 0));
}

static void test_period_that_has_computed_a_piece_prefetches_none(void)
{
    struct spline_cache cache = {0};
    for (int i = 0; i < 60; i++) {
        add_knot(&ring, i, i * i);
    }
    (void)spline_cached_piece(&cache, &ring, 60, 0);
    cache.piece_changed = true; /* and the foot point has moved */
    spline_prefetch(&cache, &ring, 60, 0);
    TEST_ASSERT_EQUAL_UINT32(0, cache.next);
    for (uint32_t n = 1; n <= 3; n++) { /* what is prefetched does not count */
        spline_prefetch(&cache, &ring, 60, 0);
        TEST_ASSERT_EQUAL_UINT32(n, cache.next);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_at_a_knot_the_curve_passes_through_a_sixth_of_before_four_times_it_and_after);
    RUN_TEST(test_derivatives_at_a_knot_are_differences_of_knots);
    RUN_TEST(test_halfway_the_weights_are_1_23_23_1_of_48);
    RUN_TEST(test_derivatives_are_those_of_the_position_by_finite_differences);
    RUN_TEST(test_position_velocity_and_acceleration_are_continuous_across_a_knot);
    RUN_TEST(test_knots_on_a_line_give_uniform_motion);
    RUN_TEST(test_before_the_first_knot_the_sequence_goes_on_with_the_start);
    RUN_TEST(test_after_the_last_knot_the_curve_rests_on_it);
    RUN_TEST(test_without_knots_the_curve_rests_on_the_start);
    RUN_TEST(test_a_ring_that_has_wrapped_gives_the_newest_knots);
    RUN_TEST(test_knots_beyond_the_snapshot_are_not_seen);
    RUN_TEST(test_two_metres_out_the_curve_is_the_same_to_the_last_bit);
    RUN_TEST(test_control_periods_of_10_and_20_khz_are_whole_numbers_of_path_time);
    RUN_TEST(test_knots_passed_are_those_of_a_division_however_long_the_path);
    RUN_TEST(test_piece_of_a_ring_that_was_emptied_is_made_anew);
    RUN_TEST(test_pieces_ahead_are_prefetched_one_in_a_period_up_to_the_look_ahead);
    RUN_TEST(test_period_whose_foot_point_moved_to_another_piece_prefetches_none_unless_it_is_close);
    RUN_TEST(test_period_that_has_computed_a_piece_prefetches_none);
    return UNITY_END();
}
