/* SPDX-License-Identifier: Apache-2.0 */
/* test_oscillation.c: the watch for oscillation of one and of both axes. */
#include "core/oscillation.h"

#include <math.h>

#include "nominal.h"
#include "unity.h"

#define PI 3.14159265358979323846
#define HZ 10000

static struct oscillation_cfg cfg;
static struct oscillation_state state[2];
static bool enabled[2];
static bool seen;    /* in the last period */
static int first_at; /* period in which an oscillation was first seen, -1: none */
static int now;      /* period */

/* 30 N of x and 40 N of y, corner 40 Hz, 60 ms; masses 2 and 4, viscous friction 0.5 and 1 */
void setUp(void)
{
    cfg = (struct oscillation_cfg){.on = true,
                                   .slow = mk(1 - exp(-2 * PI * 40 / HZ)),
                                   .axis = {{.limit = mk(30 / 4.0), .force_max = mk(300 / 4.0)},
                                            {.limit = mk(40 / 4.0), .force_max = mk(300 / 4.0)}},
                                   .mass = mk2(2 / 4.0, 4 / 4.0),
                                   .viscous = mk2(0.5 / 4, 1 / 4.0),
                                   .half_wave = HZ / 40,
                                   .lasts = 600,
                                   .control_hz = HZ};
    state[0] = state[1] = (struct oscillation_state){.count = 0};
    enabled[0] = enabled[1] = true;
    first_at = -1;
    now = 0;
}
void tearDown(void)
{
}

static void step(double x, double y)
{
    seen = oscillation_step(&cfg, state, enabled, mk2(x, y), mk2(0, 0), mk2(0, 0));
    first_at = seen && first_at < 0 ? now : first_at;
    now++;
}

/* The share of a sine that the high-pass lets through, from the difference equation of a first-order high-pass */
static double passed(double hz)
{
    const double w = 2 * PI * hz / HZ, p = exp(-2 * PI * 40 / HZ);
    return 2 * sin(w / 2) / sqrt(1 - 2 * p * cos(w) + p * p);
}

/* `ms` of a force on x that is `amplitude` at the output of the high-pass */
static void swing(double hz, double amplitude, int ms)
{
    for (int i = 0; i < 10 * ms; i++) {
        step(amplitude / passed(hz) * sin(2 * PI * hz * now / HZ), 0);
    }
}

static void test_a_force_that_swings_beyond_the_limit_is_seen_within_100_ms_from_35_Hz_on(void)
{
    for (int hz = 30; hz <= 600; hz += 15) {
        setUp();
        swing(hz, 33, hz < 35 ? 120 : 100); /* three and a half periods */
        TEST_ASSERT_TRUE_MESSAGE(first_at >= 0, "not seen");
        TEST_ASSERT_TRUE_MESSAGE(first_at >= 590, "seen too soon");
        TEST_ASSERT_DOUBLE_WITHIN(0.02 * hz, hz, val(state[0].frequency));
        TEST_ASSERT_DOUBLE_WITHIN(3, 33, val(state[0].force)); /* its beginning passes the filter better */
        TEST_ASSERT_EQUAL_INT32(0, state[1].count);
    }
}

static void test_a_force_that_swings_within_the_limit_is_not_seen(void)
{
    for (int hz = 5; hz <= 600; hz += 15) {
        setUp();
        swing(hz, hz < 20 ? 20 : 29, 1000); /* its beginning passes the filter better */
        TEST_ASSERT_EQUAL_INT32(0, state[0].count);
    }
}

static void test_a_force_that_swings_slower_than_half_the_corner_is_not_seen(void)
{
    swing(19, 100, 1000);
    TEST_ASSERT_EQUAL_INT32(0, state[0].count);
    swing(24, 100, 1000); /* a half wave begins late, where it exceeds half of the one before */
    TEST_ASSERT_TRUE(state[0].count > 0);
}

static void test_what_swings_on_is_counted_on(void)
{
    swing(100, 50, 300);
    const int32_t count = state[0].count;
    TEST_ASSERT_TRUE(count >= 3 && count <= 5);
    swing(100, 50, 300);
    TEST_ASSERT_TRUE(state[0].count >= count + 3);
}

static void test_six_half_waves_are_needed_however_long_they_last(void)
{
    cfg.lasts = 0;
    for (int i = 0; i < 6; i++) {
        step(i % 2 == 0 ? 100 : -100, 0);
        TEST_ASSERT_FALSE(seen);
    }
    step(100, 0);
    TEST_ASSERT_TRUE(seen);
    TEST_ASSERT_EQUAL_DOUBLE(4000, val(state[0].frequency)); /* of 5000: it is limited */
}

static void test_what_decays_within_the_time_is_not_seen(void)
{
    /* the answer of a mode to a step, at each damping from 2 % on: exp(-0.02 2 pi 100 Hz 60 ms) = 0.47 */
    for (double damping = 0.02; damping < 1; damping *= 1.3) {
        setUp();
        for (int i = 0; i < 2000; i++) {
            const double w = 2 * PI * 100 * i / HZ;
            step(2000 * exp(-damping * w) * sin(w), 0);
        }
        TEST_ASSERT_EQUAL_INT32(0, state[0].count);
    }
    setUp();
    for (int i = 0; i < 2000; i++) { /* it is seen where it rings for longer */
        const double w = 2 * PI * 100 * i / HZ;
        step(2000 * exp(-0.005 * w) * sin(w), 0);
    }
    TEST_ASSERT_TRUE(state[0].count > 0);
}

/* Half waves of a square of these lengths (ms) and heights (N) in turn; at the longest it is still beyond the limit */
static void square(const int *ms, const double *N, int n)
{
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < 10 * ms[i]; k++) {
            step(i % 2 == 0 ? N[i] : -N[i], 0);
        }
    }
}

static void test_what_rings_slowly_and_decays_is_not_seen(void)
{
    /* a long axis after a reversal: 33 Hz and 3 %. Two periods, which last 60 ms, leave 70 % of it. */
    for (int i = 0; i < 5000; i++) {
        const double w = 2 * PI * 33 * i / HZ;
        step(150 * exp(-0.027 * w) * sin(w), 0);
    }
    TEST_ASSERT_EQUAL_INT32(0, state[0].count);
}

static void test_what_has_no_period_is_not_seen(void)
{
    /* a path whose acceleration changes with the curve, where the drive believes a wrong mass */
    square((const int[]){9, 13, 18, 12, 9, 14, 20, 13, 9, 12, 17, 12},
           (const double[]){60, 60, 60, 60, 60, 60, 60, 60, 60, 60, 60, 60}, 12);
    TEST_ASSERT_EQUAL_INT32(0, state[0].count);
    square((const int[]){12, 12, 12, 12, 12, 12, 12, 12}, (const double[]){60, 60, 60, 60, 60, 60, 60, 60}, 8);
    TEST_ASSERT_TRUE(state[0].count > 0);
}

static void test_each_half_wave_is_compared_with_the_one_a_period_before(void)
{
    /* further to one side than to the other, and longer, is periodic, too */
    square((const int[]){14, 8, 14, 8, 14, 8, 14, 8, 14}, (const double[]){90, 60, 90, 60, 90, 60, 90, 60, 90}, 9);
    TEST_ASSERT_TRUE(state[0].count > 0);
    for (int late = 2; late < 6; late++) { /* one of the last four is too long, too short, or too small */
        const int change[] = {20, 6, 12};
        for (int kind = 0; kind < 3; kind++) {
            int ms[7];
            double N[7];
            for (int i = 0; i < 7; i++) {
                ms[i] = i == late ? change[kind] : 12;
                N[i] = i == late && kind == 2 ? 48 : 60;
            }
            setUp();
            square(ms, N, 7);
            TEST_ASSERT_EQUAL_INT32(0, state[0].count);
        }
    }
}

static void test_small_swings_within_large_ones_do_not_delay_it(void)
{
    for (int i = 0; i < 1000; i++) { /* a ripple crosses the limit to both sides near each zero of the large swing */
        const double w = 2 * PI * 80 * i / HZ;
        step(400 * sin(w) + 180 * sin(7 * w), 0);
    }
    TEST_ASSERT_TRUE(first_at >= 0);
    TEST_ASSERT_TRUE(first_at <= 750);
    TEST_ASSERT_DOUBLE_WITHIN(4, 80, val(state[0].frequency));
}

static void test_a_step_at_its_beginning_does_not_delay_it(void)
{
    for (int i = 0; i < 1000; i++) {
        step((i < 10 ? 500 : 0) + 60 * sin(2 * PI * 100 * i / HZ), 0);
    }
    TEST_ASSERT_TRUE(first_at >= 0);
    TEST_ASSERT_TRUE(first_at <= 800);
}

static void test_what_lasts_without_being_regular_is_looked_at_anew(void)
{
    int ms[600];
    double N[600];
    for (int i = 0; i < 600; i++) { /* 6 s, longer than is counted */
        ms[i] = i / 2 % 2 == 0 ? 7 : 13;
        N[i] = 60;
    }
    square(ms, N, 600);
    TEST_ASSERT_EQUAL_INT32(0, state[0].count);
    TEST_ASSERT_TRUE(state[0].ticks < 32000);
    swing(100, 60, 130);
    TEST_ASSERT_TRUE(state[0].count > 0);
    TEST_ASSERT_DOUBLE_WITHIN(15, 100, val(state[0].frequency));
}

static void test_a_force_that_moves_a_mass_by_less_than_a_count_of_the_encoder_is_not_seen(void)
{
    /* counts of 1 um at 100 kg: at 150 Hz 89 N move it by a count, at 60 Hz 14 N */
    const double count = 100 * (PI * 40) * (PI * 40) * 1e-6 / 4;
    cfg.axis[0].count = mk(count);
    swing(150, 80, 1000);
    TEST_ASSERT_EQUAL_INT32(0, state[0].count);
    swing(150, 100, 100);
    TEST_ASSERT_TRUE(state[0].count > 0);
    setUp();
    cfg.axis[0].count = mk(count);
    swing(60, 33, 100);
    TEST_ASSERT_TRUE(state[0].count > 0);
    setUp();
    cfg.axis[0].count = mk(count); /* 355 N at 300 Hz */
    swing(300, 290, 1000);
    TEST_ASSERT_EQUAL_INT32(0, state[0].count);
    swing(300, 310, 100); /* half of what the amplifier can give */
    TEST_ASSERT_TRUE(state[0].count > 0);
}

static void test_steps_that_follow_each_other_slower_than_the_corner_are_not_seen(void)
{
    for (int i = 0; i < 10000; i++) { /* friction at the reversals of a small circle */
        step(i / 260 % 2 == 0 ? 100 : -100, 0);
    }
    TEST_ASSERT_EQUAL_INT32(0, state[0].count);
    for (int i = 0; i < 10000; i++) {
        step(i / 240 % 2 == 0 ? 100 : -100, 0);
    }
    TEST_ASSERT_TRUE(state[0].count > 0);
}

static void test_pulses_to_one_side_are_not_seen(void)
{
    for (int i = 0; i < 10000; i++) { /* between them the filter gives -19 N at most */
        step(i % 100 < 10 ? 100 : 0, 0);
    }
    TEST_ASSERT_EQUAL_INT32(0, state[0].count);
}

static void test_a_half_wave_that_is_missing_begins_anew(void)
{
    for (int k = 0; k < 20; k++) {
        swing(100, 50, 50);
        for (int i = 0; i < 251; i++) {
            step(0, 0);
        }
    }
    TEST_ASSERT_EQUAL_INT32(0, state[0].count);
}

static void test_the_force_that_the_path_needs_is_no_oscillation(void)
{
    for (int i = 0; i < 10000; i++) {
        const double a = sin(2 * PI * 50 * i / HZ), v = cos(2 * PI * 50 * i / HZ);
        const vec2 r_dot = mk2(500 * v, -300 * v), r_ddot = mk2(200 * a, -150 * a);
        oscillation_step(&cfg, state, enabled, mk2(2 * 200 * a + 0.5 * 500 * v, -4 * 150 * a - 1 * 300 * v), r_dot,
                         r_ddot);
    }
    TEST_ASSERT_EQUAL_INT32(0, state[0].count);
    TEST_ASSERT_EQUAL_INT32(0, state[1].count);
    for (int i = 0; i < 10000; i++) { /* an axis that does not follow it */
        const double a = sin(2 * PI * 50 * i / HZ);
        oscillation_step(&cfg, state, enabled, mk2(0, 0), mk2(0, 0), mk2(200 * a, -150 * a));
    }
    TEST_ASSERT_TRUE(state[0].count > 0 && state[1].count > 0);
}

static void test_each_axis_has_its_own_limit(void)
{
    for (int i = 0; i < 2000; i++) {
        step(36 * sin(2 * PI * 300 * i / HZ), 36 * sin(2 * PI * 300 * i / HZ));
    }
    TEST_ASSERT_TRUE(state[0].count > 0);
    TEST_ASSERT_EQUAL_INT32(0, state[1].count);
    for (int i = 0; i < 2000; i++) {
        step(0, 46 * sin(2 * PI * 200 * i / HZ));
    }
    TEST_ASSERT_TRUE(state[1].count > 0);
    TEST_ASSERT_DOUBLE_WITHIN(6, 300, val(state[0].frequency));
    TEST_ASSERT_DOUBLE_WITHIN(4, 200, val(state[1].frequency));
}

static void test_an_axis_that_is_disabled_begins_anew(void)
{
    for (int axis = 0; axis < 2; axis++) {
        setUp();
        for (int i = 0; i < 2000; i++) {
            const double u = 100 * sin(2 * PI * 100 * i / HZ);
            enabled[axis] = i % 500 != 0;
            step(axis == 0 ? u : 0, axis == 0 ? 0 : u);
        }
        TEST_ASSERT_EQUAL_INT32(0, state[axis].count);
    }
}

static void test_a_force_that_swings_further_to_one_side_than_to_the_other_is_seen(void)
{
    for (int i = 0; i < 1000; i++) {
        step((i / 20 % 2 == 0 ? 100 : -100) + 1.0 * i, 0); /* it rises by 10 kN/s, which leaves 40 N of h */
    }
    TEST_ASSERT_TRUE(state[0].count > 0);
    TEST_ASSERT_TRUE(first_at < 700);
}

static void test_of_a_force_beyond_all_limits_the_largest_is_told(void)
{
    for (int i = 0; i < 1000; i++) {
        step(i / 50 % 2 == 0 ? 4000 : -4000, 0);
    }
    TEST_ASSERT_TRUE(state[0].count > 0);
    TEST_ASSERT_EQUAL_DOUBLE(4000, val(state[0].force));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_a_force_that_swings_beyond_the_limit_is_seen_within_100_ms_from_35_Hz_on);
    RUN_TEST(test_a_force_that_swings_within_the_limit_is_not_seen);
    RUN_TEST(test_a_force_that_swings_slower_than_half_the_corner_is_not_seen);
    RUN_TEST(test_what_swings_on_is_counted_on);
    RUN_TEST(test_six_half_waves_are_needed_however_long_they_last);
    RUN_TEST(test_what_decays_within_the_time_is_not_seen);
    RUN_TEST(test_what_rings_slowly_and_decays_is_not_seen);
    RUN_TEST(test_what_has_no_period_is_not_seen);
    RUN_TEST(test_each_half_wave_is_compared_with_the_one_a_period_before);
    RUN_TEST(test_small_swings_within_large_ones_do_not_delay_it);
    RUN_TEST(test_a_step_at_its_beginning_does_not_delay_it);
    RUN_TEST(test_what_lasts_without_being_regular_is_looked_at_anew);
    RUN_TEST(test_a_force_that_moves_a_mass_by_less_than_a_count_of_the_encoder_is_not_seen);
    RUN_TEST(test_steps_that_follow_each_other_slower_than_the_corner_are_not_seen);
    RUN_TEST(test_pulses_to_one_side_are_not_seen);
    RUN_TEST(test_a_half_wave_that_is_missing_begins_anew);
    RUN_TEST(test_the_force_that_the_path_needs_is_no_oscillation);
    RUN_TEST(test_each_axis_has_its_own_limit);
    RUN_TEST(test_an_axis_that_is_disabled_begins_anew);
    RUN_TEST(test_a_force_that_swings_further_to_one_side_than_to_the_other_is_seen);
    RUN_TEST(test_of_a_force_beyond_all_limits_the_largest_is_told);
    return UNITY_END();
}
