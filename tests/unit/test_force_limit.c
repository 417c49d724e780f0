/* SPDX-License-Identifier: Apache-2.0 */
/* test_force_limit.c: the continuous limit of the force (I2t). */
#include "core/force_limit.h"

#include <math.h>

#include "num_test.h"
#include "unity.h"

#define PERIOD_S 1e-4
#define PEAK 600.0

static struct force_limit_cfg cfg;
static struct force_limit_state state;
static double limit_N[2];

static void configure(double x_N, double y_N, double tau_s)
{
    cfg = (struct force_limit_cfg){
        .on = true,
        .continuous = mk2(x_N > 0 ? x_N : PEAK, y_N > 0 ? y_N : PEAK),
        .inverse = mk2(x_N > 0 ? 1 / x_N : 0, y_N > 0 ? 1 / y_N : 0),
        .rate = {mk(PERIOD_S / tau_s * ACC_GAIN), mk(PERIOD_S / tau_s * ACC_GAIN)},
    };
}

void setUp(void)
{
    configure(300, 200, 0.5);
    force_limit_reset(&state, mk2(PEAK, PEAK));
}

void tearDown(void)
{
}

static void step(double x_N, double y_N)
{
    force_limit_step(&cfg, &state, 0, mk2(x_N, y_N), mk2(PEAK, PEAK));
    force_limit_step(&cfg, &state, 1, mk2(x_N, y_N), mk2(PEAK, PEAK));
    limit_N[0] = val(state.limit.x);
    limit_N[1] = val(state.limit.y);
}

static void test_reset_is_cold_and_lets_the_peak_pass(void)
{
    step(500, 500);
    force_limit_reset(&state, mk2(PEAK, 77));
    TEST_ASSERT_EQUAL_DOUBLE(0, acc_val(state.heat[0]));
    TEST_ASSERT_EQUAL_DOUBLE(0, acc_val(state.heat[1]));
    TEST_ASSERT_EQUAL_DOUBLE(PEAK, val(state.limit.x));
    TEST_ASSERT_EQUAL_DOUBLE(77, val(state.limit.y));
}

static void test_heat_is_the_mean_square_over_the_thermal_time(void)
{
    for (int k = 0; k < 5000; k++) { /* one thermal time */
        step(150, -100);
    }
    const double expected = 0.25 * (1 - exp(-1));
    TEST_ASSERT_DOUBLE_WITHIN(2e-4, expected, acc_val(state.heat[0]));
    TEST_ASSERT_DOUBLE_WITHIN(2e-4, expected, acc_val(state.heat[1]));
    for (int k = 0; k < 5000; k++) {
        step(0, 0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(2e-4, expected * exp(-1), acc_val(state.heat[0]));
}

static void test_heat_of_a_long_thermal_time_is_not_lost_in_rounding(void)
{
    configure(300, 300, 1000);
    for (int k = 0; k < 100000; k++) { /* 10 s */
        step(150, 30);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.01 * 0.25 * 0.01, 0.25 * (1 - exp(-0.01)), acc_val(state.heat[0]));
    TEST_ASSERT_DOUBLE_WITHIN(0.01 * 0.01 * 0.01 + HALF_STEPS(1), 0.01 * (1 - exp(-0.01)), acc_val(state.heat[1]));
}

static void test_an_axis_at_its_limit_comes_to_the_continuous_force_without_a_step(void)
{
    double before[2] = {PEAK, PEAK};
    double amplifier_N2[2] = {0, 0};
    const double continuous[2] = {300, 200};
    for (int k = 0; k < 30000; k++) {
        step(before[0], before[1]);
        for (int i = 0; i < 2; i++) {
            TEST_ASSERT_TRUE(limit_N[i] <= before[i] + HALF_STEPS(2 * 20 * (PEAK - continuous[i]))); /* of the heat */
            TEST_ASSERT_TRUE(limit_N[i] >= continuous[i]);
            TEST_ASSERT_TRUE(before[i] - limit_N[i] < 15); /* 20 (peak - continuous) (peak / continuous)^2 dt / tau */
            before[i] = limit_N[i];
            /* An amplifier with this limit switches to it where the mean square of the force is that of the limit. */
            amplifier_N2[i] += (before[i] * before[i] - amplifier_N2[i]) * (1 - exp(-PERIOD_S / 0.5));
            TEST_ASSERT_TRUE(amplifier_N2[i] < continuous[i] * continuous[i] * (1 + 2e-3 * NUM_FIXED));
        }
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 300, limit_N[0]);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 200, limit_N[1]);
    for (int k = 0; k < 500; k++) {
        step(0, 0);
    }
    TEST_ASSERT_EQUAL_DOUBLE(PEAK, limit_N[0]); /* after a tenth of the thermal time at rest */
}

static void test_limit_falls_from_95_percent_and_not_below_the_continuous_force(void)
{
    const double heat[] = {0.9, 0.949, 0.975, 0.999, 1.5};
    const double limit[] = {600, 600, 450, 306, 300};
    for (int k = 0; k < 5; k++) {
        state.heat[0] = acc_from(mk(heat[k]));
        step(300 * sqrt(heat[k]), 0);
        TEST_ASSERT_DOUBLE_WITHIN(0.1, limit[k], limit_N[0]);
    }
}

static void test_an_axis_without_a_continuous_force_keeps_its_peak_and_cools(void)
{
    configure(0, 200, 0.5);
    state.heat[0] = acc_from(mk(0.99));
    step(PEAK, PEAK);
    TEST_ASSERT_EQUAL_DOUBLE(PEAK, limit_N[0]);
    TEST_ASSERT_TRUE(acc_val(state.heat[0]) < 0.99);
}

static void test_a_continuous_force_above_the_peak_limits_nothing(void)
{
    configure(605, 700, 0.5);
    for (int k = 0; k < 20000; k++) {
        step(PEAK, PEAK);
        TEST_ASSERT_EQUAL_DOUBLE(PEAK, limit_N[0]);
        TEST_ASSERT_EQUAL_DOUBLE(PEAK, limit_N[1]);
    }
    TEST_ASSERT_TRUE(acc_val(state.heat[0]) > 0.96);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_reset_is_cold_and_lets_the_peak_pass);
    RUN_TEST(test_heat_is_the_mean_square_over_the_thermal_time);
    RUN_TEST(test_heat_of_a_long_thermal_time_is_not_lost_in_rounding);
    RUN_TEST(test_an_axis_at_its_limit_comes_to_the_continuous_force_without_a_step);
    RUN_TEST(test_limit_falls_from_95_percent_and_not_below_the_continuous_force);
    RUN_TEST(test_an_axis_without_a_continuous_force_keeps_its_peak_and_cools);
    RUN_TEST(test_a_continuous_force_above_the_peak_limits_nothing);
    return UNITY_END();
}
