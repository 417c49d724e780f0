/* SPDX-License-Identifier: Apache-2.0 */
/* test_excitation.c: the force of an excitation, and what is correlated of signals, each against sums in double. */
#include "core/excitation.h"

#include <math.h>

#include "num_test.h"
#include "unity.h"

#define PI 3.14159265358979323846
enum { WINDOW = 400, SETTLE = 50 };

static struct excitation_cfg cfg;
static struct excitation_state state;

void setUp(void)
{
    cfg = (struct excitation_cfg){
        .amplitude = mk(4), .lines = 3, .periods = {5, 37, 199}, .settle = SETTLE, .window = WINDOW, .windows = 2};
    excitation_begin(&cfg, &state);
}

void tearDown(void)
{
}

/* Phase of line k in control period n, of the definition: it begins with pi k (k + 1) / lines */
static double phase(uint32_t k, int n)
{
    return 2 * PI * cfg.periods[k] * n / WINDOW + PI * k * (k + 1) / cfg.lines;
}

/* The force of period n after the begin, in full size */
static double full_N(int n)
{
    double sum = 0;
    for (uint32_t k = 0; k < cfg.lines; k++) {
        sum += 4 * cos(phase(k, n));
    }
    return sum;
}

static bool take(double force, double first, double second)
{
    const num signal[EXCITATION_SIGNALS] = {mk(force), mk(first), mk(second)};
    return excitation_correlate(&cfg, &state, signal);
}

static double result(uint32_t line, enum excitation_signal signal, bool imaginary)
{
    return val(excitation_result(&cfg, &state, line, signal, imaginary));
}

static void test_force_is_a_sum_of_sines_that_grows_while_it_settles(void)
{
    for (int n = 0; n < SETTLE + WINDOW; n++) {
        const double share = n < SETTLE ? (double)n / SETTLE : 1;
        TEST_ASSERT_DOUBLE_WITHIN(5e-4, share * full_N(n), val(excitation_step(&cfg, &state)));
        TEST_ASSERT_FALSE(take(0, 0, 0));
    }
}

/* Of the force itself it is the amplitude, whatever the phase. */
static void test_line_of_the_force_itself_is_its_amplitude(void)
{
    bool complete = false;
    for (int n = 0; !complete; n++) {
        TEST_ASSERT_EQUAL(n > SETTLE + 2 * WINDOW - 1, complete);
        const double d = val(excitation_step(&cfg, &state));
        complete = take(d, 0, 0);
    }
    TEST_ASSERT_EQUAL_UINT32(2, state.done);
    for (uint32_t k = 0; k < cfg.lines; k++) {
        TEST_ASSERT_DOUBLE_WITHIN(2e-4, 4, result(k, EXCITATION_FORCE, false));
        TEST_ASSERT_DOUBLE_WITHIN(2e-4, 0, result(k, EXCITATION_FORCE, true));
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, result(k, EXCITATION_FIRST, false));
    }
}

/* Any signals, of which the sums are made here again */
static void test_each_signal_is_correlated_with_each_line_window_by_window(void)
{
    double re[2][3][3] = {{{0}}}, im[2][3][3] = {{{0}}};
    uint32_t random = 1;
    int window = 0;
    for (int n = 0; n < SETTLE + 2 * WINDOW; n++) {
        double x[3];
        for (int i = 0; i < 3; i++) {
            random = random * 1664525u + 1013904223u;
            x[i] = (double)(random >> 22) / 64 - 8;
        }
        (void)excitation_step(&cfg, &state);
        (void)take(x[0], x[1], x[2]);
        window = (n - SETTLE) / WINDOW;
        for (uint32_t k = 0; k < 3 && n >= SETTLE; k++) {
            for (int i = 0; i < 3; i++) {
                re[window][k][i] += 2.0 / WINDOW * x[i] * cos(phase(k, n));
                im[window][k][i] -= 2.0 / WINDOW * x[i] * sin(phase(k, n));
            }
        }
        if (n == SETTLE + WINDOW - 1 || n == SETTLE + WINDOW + 7 || n == SETTLE + 2 * WINDOW - 1) {
            const int complete = n == SETTLE + 2 * WINDOW - 1 ? 1 : 0;
            for (uint32_t k = 0; k < 3; k++) {
                for (int i = 0; i < 3; i++) {
                    TEST_ASSERT_DOUBLE_WITHIN(1e-4, re[complete][k][i], result(k, (enum excitation_signal)i, false));
                    TEST_ASSERT_DOUBLE_WITHIN(1e-4, im[complete][k][i], result(k, (enum excitation_signal)i, true));
                }
            }
        }
    }
}

static void test_constant_speed_and_the_other_lines_are_not_seen(void)
{
    for (int n = 0; n < SETTLE + WINDOW; n++) {
        (void)excitation_step(&cfg, &state);
        (void)take(7, 3 * cos(phase(1, n)), 100);
    }
    for (uint32_t k = 0; k < cfg.lines; k++) {
        TEST_ASSERT_DOUBLE_WITHIN(2e-4, 0, result(k, EXCITATION_FORCE, false));
        TEST_ASSERT_DOUBLE_WITHIN(2e-4, k == 1 ? 3 : 0, result(k, EXCITATION_FIRST, false));
        TEST_ASSERT_DOUBLE_WITHIN(2e-4, 0, result(k, EXCITATION_FIRST, true));
        TEST_ASSERT_DOUBLE_WITHIN(2e-3, 0, result(k, EXCITATION_SECOND, false));
    }
}

static void test_without_a_window_or_a_line_there_is_no_result(void)
{
    (void)excitation_step(&cfg, &state);
    TEST_ASSERT_FALSE(take(1, 1, 1));
    TEST_ASSERT_EQUAL_DOUBLE(0, result(0, EXCITATION_FORCE, false));
    for (int n = 1; n < SETTLE + WINDOW; n++) {
        (void)excitation_step(&cfg, &state);
        (void)take(val(state.at[0].cos), 0, 0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 1, result(0, EXCITATION_FORCE, false));
    TEST_ASSERT_EQUAL_DOUBLE(0, result(3, EXCITATION_FORCE, false));
}

/* 8 lines in phase would have a peak of 8. */
static void test_phases_keep_the_peak_of_many_lines_small(void)
{
    cfg.lines = EXCITATION_LINES;
    for (uint32_t k = 0; k < EXCITATION_LINES; k++) {
        cfg.periods[k] = 3 * (k + 1);
    }
    excitation_begin(&cfg, &state);
    double peak = 0;
    for (int n = 0; n < SETTLE + WINDOW; n++) {
        peak = fmax(peak, fabs(val(excitation_step(&cfg, &state)) / 4));
        (void)take(0, 0, 0);
    }
    TEST_ASSERT_TRUE(peak > 2.8 && peak < 5);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_force_is_a_sum_of_sines_that_grows_while_it_settles);
    RUN_TEST(test_line_of_the_force_itself_is_its_amplitude);
    RUN_TEST(test_each_signal_is_correlated_with_each_line_window_by_window);
    RUN_TEST(test_constant_speed_and_the_other_lines_are_not_seen);
    RUN_TEST(test_without_a_window_or_a_line_there_is_no_result);
    RUN_TEST(test_phases_keep_the_peak_of_many_lines_small);
    return UNITY_END();
}
