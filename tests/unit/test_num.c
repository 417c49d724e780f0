/* SPDX-License-Identifier: Apache-2.0 */
/* test_num.c: arithmetic and conversions of each numeric back end, and plane vectors. */
#include <math.h>

#include "num_test.h"
#include "unity.h"

void setUp(void)
{
}
void tearDown(void)
{
}

static void test_position_to_nm_rounds_to_the_nearest(void)
{
    TEST_ASSERT_EQUAL_INT32(7, pos_to_nm(pos_from_nm(7)));
    TEST_ASSERT_EQUAL_INT32(7, pos_to_nm(pos_from_nm(7) + POS_PER_NM / 2 - 1));
    TEST_ASSERT_EQUAL_INT32(8, pos_to_nm(pos_from_nm(7) + POS_PER_NM / 2));
    TEST_ASSERT_EQUAL_INT32(-7, pos_to_nm(pos_from_nm(-7) - POS_PER_NM / 2 + 1));
    TEST_ASSERT_EQUAL_INT32(-8, pos_to_nm(pos_from_nm(-7) - POS_PER_NM / 2));
}

static void test_position_to_nm_saturates_at_32_bits(void)
{
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, pos_to_nm(pos_from_nm((int64_t)INT32_MAX + 5)));
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, pos_to_nm(pos_from_nm((int64_t)INT32_MIN - 5)));
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, pos_to_nm(pos_from_nm(INT32_MIN)));
}

static void test_positions_at_a_metre_are_resolved_to_thousandths_of_a_nm(void)
{
    const pos_t p = pos_from_nm(1000000000);
    TEST_ASSERT_DOUBLE_WITHIN(0x1p-32 + HALF_STEPS(1), 66 / 65536e3, val(pos_sub(p + 66, p)));
    TEST_ASSERT_DOUBLE_WITHIN(0x1p-32 + HALF_STEPS(1), -66 / 65536e3, val(pos_sub(p, p + 66)));
    TEST_ASSERT_TRUE(pos_add(p, mk(1.0 / 1024)) - p == 64000);
    TEST_ASSERT_TRUE(pos_add(p, mk(-1.0 / 1024)) - p == -64000);
}

static void test_a_position_moved_by_a_difference_is_the_other_position(void)
{
    for (pos_t d = -4000; d <= 4000; d += 7) {
        TEST_ASSERT_TRUE(pos_add(pos_from_nm(-12345), pos_sub(pos_from_nm(-12345) + 1000 * d, pos_from_nm(-12345))) ==
                         pos_from_nm(-12345) + 1000 * d);
    }
}

static void test_q32_and_scaled_integers_are_rounded_to_the_nearest(void)
{
    TEST_ASSERT_TRUE(n_to_q32(mk(-2.5)) == -(5LL << 31));
    TEST_ASSERT_EQUAL_INT32(3, n_to_scaled(mk(0.2578125), 10));
    TEST_ASSERT_EQUAL_INT32(-3, n_to_scaled(mk(-0.2578125), 10));
    TEST_ASSERT_EQUAL_INT32(2, n_to_scaled(mk(0.2490234375), 10));
    TEST_ASSERT_EQUAL_INT32(-2, n_to_scaled(mk(-0.2490234375), 10));
    if (!NUM_FIXED) {
        TEST_ASSERT_EQUAL_INT32(0, n_to_scaled(mk(0x1.fffffep-2), 1)); /* the largest float below one half */
    }
}

static void test_scaled_integers_above_2_to_the_23_are_exact(void)
{
    TEST_ASSERT_EQUAL_INT32(8388609, n_to_scaled(mk(8388609.0 / 4096), 4096));
    TEST_ASSERT_EQUAL_INT32(-8388609, n_to_scaled(mk(-8388609.0 / 4096), 4096));
    TEST_ASSERT_EQUAL_INT32(16777215, n_to_scaled(mk(16777215.0 / 8192), 8192));
}

static void test_scaled_halves_above_2_to_the_22_are_rounded_to_even(void)
{
    if (!NUM_FIXED) {
        for (int32_t even = 4194304; even < 4194400; even += 2) {
            TEST_ASSERT_EQUAL_INT32(even, n_to_scaled(mk(even + 0.5), 1));
            TEST_ASSERT_EQUAL_INT32(even + 2, n_to_scaled(mk(even + 1.5), 1));
            TEST_ASSERT_EQUAL_INT32(-even, n_to_scaled(mk(-even - 0.5), 1));
            TEST_ASSERT_EQUAL_INT32(-even - 2, n_to_scaled(mk(-even - 1.5), 1));
            TEST_ASSERT_EQUAL_INT32(even + 1, n_to_scaled(mk(even + 1), 1));
        }
    }
}

static void test_scaled_integers_saturate(void)
{
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, n_to_scaled(mk(4000), 1000000));
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, n_to_scaled(mk(-4000), 1000000));
}

static void test_integers_of_64_bits_are_rounded_to_the_nearest_whatever_their_sign(void)
{
    if (!NUM_FIXED) {
        TEST_ASSERT_EQUAL_DOUBLE(-3000000000.0, val(n_ratio(-3000000000, 1)));
        TEST_ASSERT_EQUAL_DOUBLE(3000000000.0, val(n_ratio(3000000000, 1)));
        TEST_ASSERT_EQUAL_DOUBLE(-4294967296.0, val(n_ratio(-4294967295, 1)));
        TEST_ASSERT_EQUAL_DOUBLE(-0x1p40, val(n_ratio(-(1LL << 40) - 1, 1)));
        TEST_ASSERT_EQUAL_DOUBLE(-0x1p63, val(n_ratio(INT64_MIN, 1)));
        TEST_ASSERT_EQUAL_DOUBLE(0x1p63, val(n_ratio(INT64_MAX, 1)));
    }
}

static void test_nan_becomes_0_and_infinity_saturates(void)
{
    if (!NUM_FIXED) {
        const num inf = mk((double)INFINITY), nan = mk((double)NAN);
        TEST_ASSERT_TRUE(n_to_q32(nan) == 0);
        TEST_ASSERT_TRUE(n_to_q32(inf) == 4000000000000000000 / (1LL << 38) * (1LL << 38));
        TEST_ASSERT_TRUE(n_to_q32(n_neg(inf)) == -n_to_q32(inf));
        TEST_ASSERT_TRUE(n_to_q32(mk(1e10)) == n_to_q32(inf));
        TEST_ASSERT_EQUAL_INT32(0, n_to_scaled(nan, 1));
        TEST_ASSERT_EQUAL_INT32(INT32_MAX, n_to_scaled(inf, 1));
        TEST_ASSERT_EQUAL_INT32(INT32_MIN, n_to_scaled(n_neg(inf), 1));
    }
}

/* Integers of all sizes, and integers halfway between two floats, where a single low bit decides. */
static void test_integers_of_any_size_become_the_nearest_float(void)
{
    uint64_t random = 1;
    for (int i = 0; i < (NUM_FIXED ? 0 : 20000); i++) {
        random = random * 6364136223846793005u + 1442695040888963407u;
        const int64_t any = (int64_t)random >> (i % 62);
        const int64_t halfway = (int64_t)((random >> 39 | 1u << 24) * 2u + 1u) * ((int64_t)1 << (i % 37));
        const int64_t each[] = {any, halfway, -halfway, halfway + 1, halfway - 1, 1 - halfway, -halfway - 1};
        for (unsigned k = 0; k < sizeof each / sizeof *each; k++) {
            TEST_ASSERT_TRUE(val(n_ratio(each[k], 1)) == (double)(float)each[k]);
        }
    }
}

static void test_sat_is_linear_inside_its_layer_and_one_outside(void)
{
    TEST_ASSERT_EQUAL_DOUBLE(0.25, val(n_sat(mk(0.5), mk(2))));
    TEST_ASSERT_EQUAL_DOUBLE(-0.25, val(n_sat(mk(-0.5), mk(2))));
    TEST_ASSERT_EQUAL_DOUBLE(1, val(n_sat(mk(2), mk(2))));
    TEST_ASSERT_EQUAL_DOUBLE(-1, val(n_sat(mk(-2), mk(2))));
    TEST_ASSERT_EQUAL_DOUBLE(1, val(n_sat(mk(4000), mk(0.001))));
    TEST_ASSERT_EQUAL_DOUBLE(-1, val(n_sat(mk(-4000), mk(0.001))));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(n_sat(mk(0), mk(0.001))));
}

static void test_clamp_min_max_and_abs_pick_the_right_one(void)
{
    TEST_ASSERT_EQUAL_DOUBLE(3, val(n_clamp(mk(7), mk(-2), mk(3))));
    TEST_ASSERT_EQUAL_DOUBLE(-2, val(n_clamp(mk(-7), mk(-2), mk(3))));
    TEST_ASSERT_EQUAL_DOUBLE(1, val(n_clamp(mk(1), mk(-2), mk(3))));
    TEST_ASSERT_EQUAL_DOUBLE(-2, val(n_min(mk(-2), mk(3))));
    TEST_ASSERT_EQUAL_DOUBLE(3, val(n_max(mk(-2), mk(3))));
    TEST_ASSERT_EQUAL_DOUBLE(2, val(n_abs(mk(-2))));
    TEST_ASSERT_EQUAL_DOUBLE(2, val(n_abs(mk(2))));
}

static void test_arithmetic_gives_its_results(void)
{
    TEST_ASSERT_EQUAL_DOUBLE(5.25, val(n_add(mk(3), mk(2.25))));
    TEST_ASSERT_EQUAL_DOUBLE(0.75, val(n_sub(mk(3), mk(2.25))));
    TEST_ASSERT_EQUAL_DOUBLE(6.75, val(n_mul(mk(3), mk(2.25))));
    TEST_ASSERT_EQUAL_DOUBLE(-1.5, val(n_div(mk(3), mk(-2))));
    TEST_ASSERT_EQUAL_DOUBLE(-3, val(n_neg(mk(3))));
    TEST_ASSERT_EQUAL_DOUBLE(1.5, val(n_sqrt(mk(2.25))));
    TEST_ASSERT_EQUAL_DOUBLE(1.25, val(n_hypot(mk(-0.75), mk(1))));
    TEST_ASSERT_EQUAL_DOUBLE(-0.375, val(n_ratio(-3, 8)));
    TEST_ASSERT_EQUAL_DOUBLE(7, val(n_mad(mk(1), mk(2), mk(3))));
    TEST_ASSERT_TRUE(n_lt(mk(1), mk(1.5)) && !n_lt(mk(1), mk(1)) && !n_lt(mk(1.5), mk(1)));
}

static void test_a_product_and_a_sum_are_rounded_once(void)
{
    const num b = mk(1 + 0x1p-12), a = mk(-1 - 0x1p-11); /* a + b b = 2^-24, below the last place of b b */
    const double expected = NUM_FIXED ? 0 : 0x1p-24;
    TEST_ASSERT_EQUAL_DOUBLE(expected, val(n_mad(a, b, b)));
    TEST_ASSERT_EQUAL_DOUBLE(-expected, val(n_msub(n_neg(a), b, b)));
    TEST_ASSERT_EQUAL_DOUBLE(-5, val(n_msub(mk(1), mk(2), mk(3))));
}

static void expect(double x, double y, vec2 v)
{
    ASSERT_NEAR(x, val(v.x), 5.0);
    ASSERT_NEAR(y, val(v.y), 5.0);
}

static void test_the_frame_has_the_normal_a_quarter_turn_left_of_the_tangent(void)
{
    const vec2 t = mk2(0.6, 0.8);
    expect(-0.8, 0.6, v2_normal(t));
    expect(5, 0, v2_to_frame(t, mk2(3, 4)));
    expect(0, 5, v2_to_frame(t, mk2(-4, 3)));
    expect(3, 4, v2_from_frame(t, mk2(5, 0)));
    expect(-4, 3, v2_from_frame(t, mk2(0, 5)));
}

static void test_from_frame_undoes_to_frame(void)
{
    const vec2 t = mk2(-0.28, 0.96);
    expect(1.5, -2.5, v2_from_frame(t, v2_to_frame(t, mk2(1.5, -2.5))));
}

static void test_ie_turns_a_quarter_to_the_right(void)
{
    expect(2, -1, v2_ie(mk2(1, 2)));
}

static void test_vector_operations_give_their_results(void)
{
    expect(4, 6, v2_add(mk2(1, 2), mk2(3, 4)));
    expect(-2, -2, v2_sub(mk2(1, 2), mk2(3, 4)));
    expect(2, 4, v2_scale(mk(2), mk2(1, 2)));
    expect(7, 10, v2_mad(mk2(1, 2), mk(2), mk2(3, 4)));
    expect(3, 8, v2_mul(mk2(1, 2), mk2(3, 4)));
    TEST_ASSERT_EQUAL_DOUBLE(11, val(v2_dot(mk2(1, 2), mk2(3, 4))));
    TEST_ASSERT_EQUAL_DOUBLE(-2, val(v2_cross(mk2(1, 2), mk2(3, 4))));
    TEST_ASSERT_EQUAL_DOUBLE(5, val(v2_norm(mk2(-3, 4))));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_position_to_nm_rounds_to_the_nearest);
    RUN_TEST(test_position_to_nm_saturates_at_32_bits);
    RUN_TEST(test_positions_at_a_metre_are_resolved_to_thousandths_of_a_nm);
    RUN_TEST(test_a_position_moved_by_a_difference_is_the_other_position);
    RUN_TEST(test_q32_and_scaled_integers_are_rounded_to_the_nearest);
    RUN_TEST(test_scaled_integers_above_2_to_the_23_are_exact);
    RUN_TEST(test_scaled_halves_above_2_to_the_22_are_rounded_to_even);
    RUN_TEST(test_scaled_integers_saturate);
    RUN_TEST(test_integers_of_any_size_become_the_nearest_float);
    RUN_TEST(test_sat_is_linear_inside_its_layer_and_one_outside);
    RUN_TEST(test_clamp_min_max_and_abs_pick_the_right_one);
    RUN_TEST(test_arithmetic_gives_its_results);
    RUN_TEST(test_a_product_and_a_sum_are_rounded_once);
    RUN_TEST(test_the_frame_has_the_normal_a_quarter_turn_left_of_the_tangent);
    RUN_TEST(test_from_frame_undoes_to_frame);
    RUN_TEST(test_ie_turns_a_quarter_to_the_right);
    RUN_TEST(test_vector_operations_give_their_results);
    RUN_TEST(test_integers_of_64_bits_are_rounded_to_the_nearest_whatever_their_sign);
    RUN_TEST(test_nan_becomes_0_and_infinity_saturates);
    return UNITY_END();
}
