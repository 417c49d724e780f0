/* SPDX-License-Identifier: Apache-2.0 */
/* test_screw.c: cogging and ripple by the angle of the screw. */
#include "core/screw.h"

#include <math.h>

#include "nominal.h"
#include "unity.h"

#define LEAD_NM 5000000
#define PI 3.14159265358979323846

static struct screw_cfg cfg;

void setUp(void)
{
    cfg = (struct screw_cfg){.on = true}; /* y is off */
    cfg.axis[0].turns = screw_turns(LEAD_NM);
    for (uint32_t n = 0; n < SCREW_HARMONICS; n++) {
        cfg.axis[0].harmonic[n] = (struct screw_harmonic){.order = n == 2 ? 6 : n + 1,
                                                          .cogging_cos = mk(0),
                                                          .cogging_sin = mk(0),
                                                          .ripple_cos = mk(0),
                                                          .ripple_sin = mk(0)};
        cfg.axis[1].harmonic[n] = cfg.axis[0].harmonic[n];
    }
}
void tearDown(void)
{
}

static double at_nm(double nm, double demand)
{
    const pos_t at = (pos_t)llround(nm * POS_PER_NM);
    TEST_ASSERT_EQUAL_DOUBLE(7, val(screw_cancel(&cfg.axis[1], at, mk(7))));
    return val(screw_cancel(&cfg.axis[0], at, mk(demand)));
}

static void test_cogging_of_each_harmonic_is_subtracted(void)
{
    static const double order[SCREW_HARMONICS] = {1, 2, 6};
    for (int n = 0; n < SCREW_HARMONICS; n++) {
        setUp();
        cfg.axis[0].harmonic[n].cogging_cos = mk(3);
        cfg.axis[0].harmonic[n].cogging_sin = mk(-2);
        for (int i = -100; i <= 100; i++) {
            const double nm = i * 123456.0;
            const double a = 2 * PI * order[n] * nm / LEAD_NM;
            TEST_ASSERT_DOUBLE_WITHIN(1e-5 + HALF_STEPS(40), 10 - 3 * cos(a) + 2 * sin(a), at_nm(nm, 10));
        }
    }
}

static void test_the_motors_ripple_makes_the_demand_of_the_cancelled_force(void)
{
    cfg.axis[0].harmonic[0].ripple_cos = mk(0.03);
    cfg.axis[0].harmonic[1].ripple_sin = mk(-0.02);
    cfg.axis[0].harmonic[2].cogging_sin = mk(4);
    for (int i = -50; i <= 50; i++) {
        const double a = 2 * PI * i * 234567.0 / LEAD_NM;
        const double u = at_nm(i * 234567.0, 300);
        const double force = u * (1 + 0.03 * cos(a) - 0.02 * sin(2 * a)) + 4 * sin(6 * a);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3 + HALF_STEPS(4000), 300, force);
    }
}

static void test_angle_is_exact_at_the_ends_of_a_long_axis(void)
{
    cfg.axis[0].harmonic[2].cogging_cos = mk(1);
    const double turns = 400; /* 2 m */
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, -1, at_nm(turns * LEAD_NM, 0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, -1, at_nm(-turns * LEAD_NM, 0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 1, at_nm((turns + 1.0 / 12) * LEAD_NM, 0));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_cogging_of_each_harmonic_is_subtracted);
    RUN_TEST(test_the_motors_ripple_makes_the_demand_of_the_cancelled_force);
    RUN_TEST(test_angle_is_exact_at_the_ends_of_a_long_axis);
    return UNITY_END();
}
