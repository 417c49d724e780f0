/* SPDX-License-Identifier: Apache-2.0 */
/* test_trig.c: transcendental functions. */
#include "core/trig.h"

#include <math.h>

#include "num_test.h"
#include "unity.h"

void setUp(void)
{
}
void tearDown(void)
{
}

/* The error that trig.h promises, relative to cosh x. */
#define PROMISE (NUM_FIXED ? 2e-5 : 1e-6)

static void test_cosh_and_sinh_are_as_exact_as_promised_over_their_range(void)
{
    for (int i = -256; i <= 256; i++) {
        const double x = i / 64.0;
        const struct trig_cosh r = trig_cosh(mk(x));
        TEST_ASSERT_DOUBLE_WITHIN(PROMISE * cosh(x), cosh(x), val(r.cosh_x));
        TEST_ASSERT_DOUBLE_WITHIN(PROMISE * (NUM_FIXED ? cosh(x) : fabs(sinh(x))) + 0x1p-32, sinh(x), val(r.sinh_x));
    }
}

static void test_cosh_is_clamped_at_four(void)
{
    TEST_ASSERT_EQUAL_DOUBLE(val(trig_cosh(mk(4)).cosh_x), val(trig_cosh(mk(5)).cosh_x));
    TEST_ASSERT_EQUAL_DOUBLE(val(trig_cosh(mk(-4)).sinh_x), val(trig_cosh(mk(-1000)).sinh_x));
}

static void test_cosh_of_zero_is_one(void)
{
    TEST_ASSERT_EQUAL_DOUBLE(1, val(trig_cosh(mk(0)).cosh_x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(trig_cosh(mk(0)).sinh_x));
}

static void test_decay_is_as_exact_as_promised_over_its_range(void)
{
    for (int i = 0; i <= 64 * TRIG_DECAY_MAX; i++) {
        TEST_ASSERT_DOUBLE_WITHIN(NUM_FIXED ? 5e-5 : 3e-6, exp(-i / 64.0), val(trig_decay(mk(i / 64.0))));
    }
}

static void test_circle_is_as_exact_as_promised_all_round(void)
{
    for (uint32_t i = 0; i < 1000; i++) {
        const uint32_t phase = i * 4294967u;
        const double angle = phase / 4294967296.0 * 2 * 3.14159265358979323846;
        const struct trig_circle c = trig_circle(phase);
        TEST_ASSERT_DOUBLE_WITHIN(NUM_FIXED ? 1e-5 : 5e-7, cos(angle), val(c.cos));
        TEST_ASSERT_DOUBLE_WITHIN(NUM_FIXED ? 1e-5 : 5e-7, sin(angle), val(c.sin));
    }
}

static void test_circle_of_whole_quarters_is_exact(void)
{
    static const int cosine[] = {1, 0, -1, 0};
    for (uint32_t i = 0; i < 4; i++) {
        const struct trig_circle c = trig_circle(i << 30);
        TEST_ASSERT_EQUAL_DOUBLE(cosine[i], val(c.cos));
        TEST_ASSERT_EQUAL_DOUBLE(cosine[(i + 3) % 4], val(c.sin));
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_cosh_and_sinh_are_as_exact_as_promised_over_their_range);
    RUN_TEST(test_cosh_is_clamped_at_four);
    RUN_TEST(test_cosh_of_zero_is_one);
    RUN_TEST(test_decay_is_as_exact_as_promised_over_its_range);
    RUN_TEST(test_circle_is_as_exact_as_promised_all_round);
    RUN_TEST(test_circle_of_whole_quarters_is_exact);
    return UNITY_END();
}
