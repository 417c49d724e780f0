/* SPDX-License-Identifier: Apache-2.0 */
/* Records of 60C1h become the knots of the same curve. */
#include <math.h>
#include <stdlib.h>

#include "motion/ip_record.h"
#include "unity.h"

static struct ip_record record;

void setUp(void)
{
}

void tearDown(void)
{
}

static void test_a_record_a_millisecond_is_a_knot(void)
{
    ip_record_start(&record, 1, (struct knot){{5, -5}});
    for (int32_t i = 0; i < 100; i++) {
        const struct knot k = ip_record_step(&record, (struct knot){{i * i, -7 * i}});
        TEST_ASSERT_EQUAL_INT32(i * i, k.nm[0]);
        TEST_ASSERT_EQUAL_INT32(-7 * i, k.nm[1]);
    }
}

/* A uniform cubic B-spline with these control points, t in units of their distance, t = 0 at the first */
static double spline(const double *c, double t)
{
    const int i = (int)floor(t);
    const double u = t - i;
    const double *k = &c[i - 1];
    return ((1 - u) * (1 - u) * (1 - u) * k[0] + (3 * u * u * u - 6 * u * u + 4) * k[1] +
            (-3 * u * u * u + 3 * u * u + 3 * u + 1) * k[2] + u * u * u * k[3]) /
           6;
}

static void test_knots_make_the_curve_of_the_records(void)
{
    static const double points[] = {0, 0, 0, 0, 3e6, -2e6, 8e6, 8e6, -5e6, 1e6, 1e6, 1e6, 1e6, 1e6, 1e6};
    enum { POINTS = sizeof points / sizeof points[0] };
    for (uint8_t m = 1; m <= RECORD_MS_MAX; m++) {
        double fine[POINTS * RECORD_MS_MAX];
        ip_record_start(&record, m, (struct knot){{0, 0}});
        for (int i = 0; i < POINTS * m; i++) {
            fine[i] = ip_record_step(&record, (struct knot){{(int32_t)points[i / m], 0}}).nm[0];
        }
        /* the three averages put it 3 (m - 1) / 2 later; a record counts from the middle of its m repetitions */
        for (double t = 2; t < POINTS - 5; t += 0.37) {
            const double at = t * m + (m - 1) / 2.0 + 3 * (m - 1) / 2.0;
            TEST_ASSERT_DOUBLE_WITHIN(1, spline(points, t), spline(fine, at));
        }
    }
}

static void test_path_rests_exactly_where_the_last_records_are(void)
{
    for (uint8_t m = 1; m <= RECORD_MS_MAX; m++) {
        struct knot k = {{0, 0}};
        ip_record_start(&record, m, (struct knot){{-2000000000, 17}});
        for (int i = 0; i < 4 * m; i++) {
            k = ip_record_step(&record, (struct knot){{2000000000, -123456789}});
        }
        TEST_ASSERT_EQUAL_INT32(2000000000, k.nm[0]);
        TEST_ASSERT_EQUAL_INT32(-123456789, k.nm[1]);
    }
}

static void test_knots_lie_between_the_records(void)
{
    ip_record_start(&record, 7, (struct knot){{-1000, 1000}});
    for (int i = 0; i < 1000; i++) {
        const int32_t value = (i / 7) % 3 == 0 ? 1000 : -1000;
        const struct knot k = ip_record_step(&record, (struct knot){{value, -value}});
        TEST_ASSERT_TRUE(abs(k.nm[0]) <= 1000 && abs(k.nm[1]) <= 1000);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_a_record_a_millisecond_is_a_knot);
    RUN_TEST(test_knots_make_the_curve_of_the_records);
    RUN_TEST(test_path_rests_exactly_where_the_last_records_are);
    RUN_TEST(test_knots_lie_between_the_records);
    return UNITY_END();
}
