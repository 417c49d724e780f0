/* SPDX-License-Identifier: Apache-2.0 */
/* Path time: its rate, its stops, and that it never outruns the knots. A knot is 1 ms, a control period 0.1 knots. */
#include "motion/path_clock.h"

#include <math.h>

#include "num_test.h"
#include "unity.h"

enum { PERIODS = 10 }; /* control periods a knot */

static struct path_clock path;
static struct path_clock_in in;

void setUp(void)
{
    path_clock_reset(&path);
    in = (struct path_clock_in){.count = 1000000, .rate = NUM(1), .stop_time = NUM(50), .step = PATH_ONE / PERIODS};
}

void tearDown(void)
{
}

static double s(void)
{
    return (double)path_s(&path.at) / (double)PATH_ONE;
}

static enum path_clock_event step(unsigned periods)
{
    enum path_clock_event event = PATH_NOTHING;
    for (unsigned i = 0; i < periods; i++) {
        event = path_clock_step(&path, &in);
    }
    return event;
}

/* Bring the path to rate 1, some way on */
static void cruise(void)
{
    step(1001);
    TEST_ASSERT_EQUAL_DOUBLE(1, val(path.at.rate));
}

/* ---- at rate 1 ---- */

static void test_path_starts_at_once_at_rate_1(void)
{
    TEST_ASSERT_EQUAL(PATH_NOTHING, step(1));
    TEST_ASSERT_EQUAL_INT64(0, path_s(&path.at));
    TEST_ASSERT_EQUAL_DOUBLE(1, val(path.at.rate));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(path.at.rate_dot));
    step(1);
    TEST_ASSERT_EQUAL_INT64(PATH_ONE / 10, path_s(&path.at));
}

static void test_ten_periods_are_one_knot_without_drift_over_a_million_periods(void)
{
    step(1);
    for (unsigned i = 1; i <= 100000; i++) {
        step(PERIODS);
        TEST_ASSERT_EQUAL_INT64((int64_t)i * PATH_ONE, path_s(&path.at));
    }
}

static void test_path_waits_at_its_start_until_commanded_to_run(void)
{
    in.rate = NUM(0);
    TEST_ASSERT_EQUAL(PATH_STANDS, step(100));
    TEST_ASSERT_EQUAL_INT64(0, path_s(&path.at));
}

static void test_path_waits_at_its_start_for_the_knots_that_a_stop_needs(void)
{
    /* a stop from rate 1 takes 25 knots; s may go to count - 3; one period passes before it can begin */
    in.count = 28;
    TEST_ASSERT_EQUAL(PATH_STANDS, step(100));
    in.count = 29;
    TEST_ASSERT_EQUAL(PATH_NOTHING, step(1));
}

static void test_complete_stream_starts_however_short_it_is(void)
{
    in.count = 3;
    in.complete = true;
    TEST_ASSERT_EQUAL(PATH_NOTHING, step(1));
    TEST_ASSERT_EQUAL(PATH_AT_END, step(21));
}

static void test_path_ends_exactly_at_the_last_knot_of_a_complete_stream(void)
{
    in.count = 200;
    in.complete = true;
    TEST_ASSERT_EQUAL(PATH_NOTHING, step(1990));
    TEST_ASSERT_EQUAL_INT64(PATH_ONE * 1989 / 10, path_s(&path.at));
    TEST_ASSERT_EQUAL(PATH_AT_END, step(1));
    TEST_ASSERT_EQUAL_INT64(199 * PATH_ONE, path_s(&path.at));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(path.at.rate));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(path.at.rate_dot));
    TEST_ASSERT_EQUAL_UINT32(200, path_clock_executed(&path));
    TEST_ASSERT_EQUAL(PATH_AT_END, step(100));
    TEST_ASSERT_EQUAL_INT64(199 * PATH_ONE, path_s(&path.at));
}

static void test_executed_counts_the_knots_at_or_before_s(void)
{
    TEST_ASSERT_EQUAL_UINT32(0, path_clock_executed(&path));
    step(2);
    TEST_ASSERT_EQUAL_UINT32(1, path_clock_executed(&path));
    step(8);
    TEST_ASSERT_EQUAL_UINT32(1, path_clock_executed(&path));
    step(1);
    TEST_ASSERT_EQUAL_UINT32(2, path_clock_executed(&path));
}

static void test_count_is_passed_on_to_the_spline(void)
{
    in.count = 77;
    step(1);
    TEST_ASSERT_EQUAL_UINT32(77, path.at.count);
}

/* ---- stop and resume ---- */

/* Integral of the stop's profile by hand: with u = t / T, slope 0 .. -4/3 .. 0 in quarters of T, sigma = 1 - 8/3 u^2 in
 * the first quarter, 7/6 - 4/3 u in the middle, 8/3 (1 - u)^2 in the last. */
static double stop_rate(double u)
{
    return u <= 0     ? 1
           : u < 0.25 ? 1 - 8.0 / 3 * u * u
           : u < 0.75 ? 7.0 / 6 - 4.0 / 3 * u
           : u < 1    ? 8.0 / 3 * (1 - u) * (1 - u)
                      : 0;
}

static double stop_way(double u)
{
    return u < 0.25   ? u - 8.0 / 9 * u * u * u
           : u < 0.75 ? -1.0 / 72 + 7.0 / 6 * u - 2.0 / 3 * u * u
           : u < 1    ? 0.5 - 8.0 / 9 * (1 - u) * (1 - u) * (1 - u)
                      : 0.5;
}

static void check_stop_and_resume(double stop_time, double tolerance)
{
    const unsigned periods = (unsigned)(stop_time * PERIODS + 0.5);
    in.stop_time = mk(stop_time);
    cruise();
    const double from = s();
    double last_rate = 1;
    in.rate = NUM(0);
    for (unsigned i = 1; i <= periods; i++) {
        const double u = (double)i / periods;
        step(1);
        TEST_ASSERT_DOUBLE_WITHIN(tolerance, stop_rate(u), val(path.at.rate));
        TEST_ASSERT_DOUBLE_WITHIN(tolerance * stop_time, stop_way(u) * stop_time, s() - from);
        TEST_ASSERT_TRUE_MESSAGE(val(path.at.rate) <= last_rate, "sigma rose during a stop");
        last_rate = val(path.at.rate);
    }
    TEST_ASSERT_EQUAL(PATH_STANDS, step(3));
    const int64_t stood_at = path_s(&path.at);
    TEST_ASSERT_EQUAL(PATH_STANDS, step(1000));
    TEST_ASSERT_EQUAL_INT64(stood_at, path_s(&path.at));

    in.rate = NUM(1);
    const double again = s();
    for (unsigned i = 1; i <= periods; i++) {
        const double u = (double)i / periods;
        TEST_ASSERT_EQUAL(PATH_NOTHING, step(1));
        TEST_ASSERT_DOUBLE_WITHIN(tolerance, stop_rate(1 - u), val(path.at.rate));
        TEST_ASSERT_DOUBLE_WITHIN(tolerance * stop_time, (0.5 - stop_way(1 - u)) * stop_time, s() - again);
    }
    step(3);
    TEST_ASSERT_EQUAL_DOUBLE(1, val(path.at.rate));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(path.at.rate_dot));
}

static void test_stop_takes_stop_time_and_half_as_many_knots_and_so_does_the_way_back(void)
{
    check_stop_and_resume(50, 0.004);
}

static void test_longest_stop_keeps_its_profile(void)
{
    check_stop_and_resume(1000, 0.001);
}

static void test_shortest_stop_is_over_after_its_ten_periods(void)
{
    in.stop_time = NUM(1);
    cruise();
    const double from = s();
    in.rate = NUM(0);
    TEST_ASSERT_EQUAL(PATH_STANDS, step(14));
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 0.5, s() - from);
}

static void test_rate_dot_is_the_change_of_the_rate(void)
{
    cruise();
    in.rate = NUM(0);
    for (int i = 0; i < 490; i++) {
        const double before = val(path.at.rate);
        step(1);
        TEST_ASSERT_DOUBLE_WITHIN(3 * NUM_ROUNDING / 0.02, (val(path.at.rate) - before) / 0.02, val(path.at.rate_dot));
    }
}

static void test_rate_dot_never_steps_whatever_run_does(void)
{
    const double largest = 4.0 / 3 / 10; /* 1/T0: 4/3 in a stop_time of 10 T0 */
    unsigned random = 1;
    double last = 0;
    cruise();
    for (int i = 0; i < 200000; i++) {
        random = random * 1664525u + 1013904223u;
        if (random >> 24 == 0) {
            in.rate = val(in.rate) > 0 ? NUM(0) : NUM(1);
        }
        step(1);
        const double now = val(path.at.rate_dot);
        TEST_ASSERT_DOUBLE_WITHIN(largest * 1.00001, 0, now);
        TEST_ASSERT_DOUBLE_WITHIN(0.01601 * largest, last,
                                  now); /* 0.008 where jerk limits, as much more where it arrives */
        last = now;
    }
}

static void test_resume_in_the_middle_of_a_stop_never_stands(void)
{
    cruise();
    in.rate = NUM(0);
    step(250);
    in.rate = NUM(1);
    for (int i = 0; i < 1000; i++) {
        TEST_ASSERT_EQUAL(PATH_NOTHING, step(1));
    }
    TEST_ASSERT_EQUAL_DOUBLE(1, val(path.at.rate));
}

/* ---- feed override ---- */

static void test_path_starts_at_the_rate_of_the_override(void)
{
    in.rate = NUM(0.75);
    TEST_ASSERT_EQUAL(PATH_NOTHING, step(1));
    TEST_ASSERT_EQUAL_DOUBLE(0.75, val(path.at.rate));
    step(1000);
    TEST_ASSERT_EQUAL_INT64(75 * PATH_ONE, path_s(&path.at));
}

static void test_rate_goes_to_the_override_and_stays_there(void)
{
    static const double rates[] = {0.8, 1.2, 0.001, 1.2, 0.5, 1};
    cruise();
    for (unsigned i = 0; i < sizeof rates / sizeof rates[0]; i++) {
        in.rate = mk(rates[i]);
        TEST_ASSERT_EQUAL(PATH_NOTHING, step(700)); /* 1.15 stop times from 0 to 1.2 */
        TEST_ASSERT_EQUAL_DOUBLE(val(mk(rates[i])), val(path.at.rate));
        TEST_ASSERT_EQUAL_DOUBLE(0, val(path.at.rate_dot));
        const double from = s();
        step(1000);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, 100 * rates[i], s() - from);
    }
}

static void test_override_above_1_takes_a_path_on_that_runs_at_1(void)
{
    cruise();
    in.rate = NUM(1.2);
    TEST_ASSERT_EQUAL(PATH_NOTHING, step(700));
    TEST_ASSERT_EQUAL_DOUBLE(val(NUM(1.2)), val(path.at.rate));
}

static void test_smallest_override_with_the_longest_stop_is_no_underrun_from_its_first_period_on(void)
{
    in.stop_time = NUM(1000);
    step(20001);
    in.rate = NUM(0);
    TEST_ASSERT_EQUAL(PATH_STANDS, step(30000));
    in.rate = NUM(0.001);
    for (int i = 0; i < 100; i++) {
        TEST_ASSERT_EQUAL(PATH_NOTHING, step(1));
    }
}

static void test_override_of_0_stands_and_is_no_underrun(void)
{
    cruise();
    in.rate = NUM(0);
    TEST_ASSERT_EQUAL(PATH_STANDS, step(600));
    in.rate = NUM(0.001); /* the least there is */
    for (unsigned i = 0; i < 5000; i++) {
        TEST_ASSERT_EQUAL(PATH_NOTHING, step(1));
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 0.001, val(path.at.rate));
}

static void test_stop_from_120_percent_takes_115_hundredths_of_the_stop_time_and_069_as_many_knots(void)
{
    in.rate = NUM(1.2);
    step(2000);
    const double from = s();
    in.rate = NUM(0);
    step(570);
    TEST_ASSERT_TRUE(val(path.at.rate) > 0);
    TEST_ASSERT_EQUAL(PATH_STANDS, step(10));
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 0.69 * 50, s() - from);
}

static void test_path_at_120_percent_waits_for_the_knots_that_its_stop_needs(void)
{
    in.rate = NUM(1.2);
    in.count = 37; /* 34.5 for the stop, 3 that the spline needs */
    TEST_ASSERT_EQUAL(PATH_STANDS, step(100));
    in.count = 38;
    TEST_ASSERT_EQUAL(PATH_NOTHING, step(1));
    TEST_ASSERT_EQUAL_DOUBLE(val(NUM(1.2)), val(path.at.rate));
}

static void test_deceleration_and_jerk_of_path_time_keep_their_limits_whatever_is_wanted_when(void)
{
    static const double stop_times[] = {20, 100, 1000};
    unsigned random = 7;
    for (unsigned k = 0; k < 3; k++) {
        const double slope_max = PATH_SLOPE_MAX / (stop_times[k] / 5); /* 1/T0 */
        const double jerk_step = PATH_JERK_MAX / (stop_times[k] * PERIODS) / (stop_times[k] / 5);
        const double arrival = fmax(1.0 / 128 / (stop_times[k] / 5), jerk_step);
        in.stop_time = mk(stop_times[k]);
        path_clock_reset(&path);
        step(1);
        double last = 0;
        for (unsigned i = 0; i < 200000; i++) {
            random = random * 1664525u + 1013904223u;
            if (random >> 22 == 0) {
                in.rate = mk((random >> 4) % 1201 / 1000.0);
            }
            step(1);
            const double now = val(path.at.rate_dot);
            TEST_ASSERT_DOUBLE_WITHIN(slope_max * 1.00001 + NUM_ROUNDING, 0, now);
            const double step_max = jerk_step * 1.01 + 2 * NUM_STEP + NUM_ROUNDING + (now == 0 ? arrival : 0);
            TEST_ASSERT_DOUBLE_WITHIN(step_max, last, now);
            last = now;
        }
    }
}

/* ---- knots that come late ---- */

static void test_path_stops_short_of_the_knots_that_are_missing_and_reports_an_underrun(void)
{
    in.count = 200;
    unsigned starved = 0;
    enum path_clock_event event = PATH_NOTHING;
    for (int i = 0; i < 3000 && event != PATH_UNDERRUN; i++) {
        event = step(1);
        TEST_ASSERT_NOT_EQUAL(PATH_STANDS, event);
        starved += event == PATH_STARVED ? 1 : 0;
    }
    TEST_ASSERT_EQUAL(PATH_UNDERRUN, event);
    TEST_ASSERT_TRUE(starved > 400);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(path.at.rate));
    TEST_ASSERT_TRUE(s() <= 197.0);
    TEST_ASSERT_TRUE_MESSAGE(s() > 196.5, "stopped early");
}

static void test_path_asked_to_stop_reports_no_underrun(void)
{
    in.count = 200;
    step(1600);
    in.rate = NUM(0);
    for (int i = 0; i < 1000; i++) {
        const enum path_clock_event event = step(1);
        TEST_ASSERT_TRUE(event == PATH_NOTHING || event == PATH_STANDS);
    }
}

static void test_hiccup_slows_the_path_and_it_recovers(void)
{
    in.count = 200;
    while (val(path.at.rate) > 0.5 || s() < 100) {
        TEST_ASSERT_NOT_EQUAL(PATH_UNDERRUN, step(1));
    }
    in.count = 400;
    for (int i = 0; i < 1000; i++) {
        TEST_ASSERT_EQUAL(PATH_NOTHING, step(1));
    }
    TEST_ASSERT_EQUAL_DOUBLE(1, val(path.at.rate));
}

static void test_knots_at_half_the_rate_halve_the_speed_without_a_stop(void)
{
    in.count = 100;
    unsigned starved = 0;
    for (unsigned i = 0; i < 40000; i++) {
        in.count = 100 + i / 20; /* a knot every 2 ms */
        const enum path_clock_event event = step(1);
        TEST_ASSERT_NOT_EQUAL(PATH_UNDERRUN, event);
        starved += event == PATH_STARVED ? 1 : 0;
    }
    TEST_ASSERT_DOUBLE_WITHIN(20, 40000 / 20 + 80, s());
    TEST_ASSERT_TRUE(starved > 0);
}

/* Property: knots come in random bursts with random gaps, run comes and goes, override and stop times vary. */
static void test_path_never_outruns_its_knots_whenever_they_come(void)
{
    static const double stop_times[] = {1, 2, 7, 50, 100, 333, 1000};
    unsigned random = 12345;
    for (unsigned trial = 0; trial < 210; trial++) {
        path_clock_reset(&path);
        in = (struct path_clock_in){.rate = NUM(1), .step = PATH_ONE / PERIODS};
        in.stop_time = mk(stop_times[trial % 7]);
        const unsigned total = 1500 + trial;
        unsigned wait = 0;
        int64_t before = 0;
        for (unsigned i = 0; i < 40000; i++) {
            random = random * 1664525u + 1013904223u;
            if (wait-- == 0) {
                in.count += (random >> 8) % 40;
                in.count = in.count > total ? total : in.count;
                wait = (random >> 16) % (trial % 3 == 0 ? 2000 : 400);
                in.rate = (random >> 28) == 0 ? NUM(0) : trial % 5 < 2 ? mk((random >> 4) % 1201 / 1000.0) : NUM(1);
                in.complete = in.count == total && trial % 2 == 0;
            }
            const enum path_clock_event event = path_clock_step(&path, &in);
            const int64_t end = in.complete ? (int64_t)total - 1 : in.count > 3 ? (int64_t)in.count - 3 : 0;
            TEST_ASSERT_TRUE_MESSAGE(path_s(&path.at) <= end * PATH_ONE, "s is beyond the knots");
            TEST_ASSERT_TRUE_MESSAGE(path_s(&path.at) >= before, "s went back");
            const double most = trial % 5 < 2 ? 1.2 : 1.00002;
            TEST_ASSERT_TRUE_MESSAGE(val(path.at.rate) >= 0 && val(path.at.rate) <= val(mk(most)), "sigma too high");
            if (event == PATH_UNDERRUN) {
                TEST_ASSERT_EQUAL_DOUBLE(0, val(path.at.rate));
                TEST_ASSERT_TRUE(val(in.rate) > 0 && !in.complete && path_s(&path.at) > 0);
            }
            if (event == PATH_AT_END) {
                TEST_ASSERT_TRUE(in.complete);
                TEST_ASSERT_EQUAL_INT64(((int64_t)total - 1) * PATH_ONE, path_s(&path.at));
                break;
            }
            before = path_s(&path.at);
        }
        if (trial % 2 == 0) {
            in.count = total;
            in.complete = true;
            in.rate = NUM(1);
            for (unsigned i = 0; i < 40000 && path_clock_step(&path, &in) != PATH_AT_END; i++) {
            }
            TEST_ASSERT_EQUAL_INT64(((int64_t)total - 1) * PATH_ONE, path_s(&path.at));
        }
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_path_starts_at_once_at_rate_1);
    RUN_TEST(test_ten_periods_are_one_knot_without_drift_over_a_million_periods);
    RUN_TEST(test_path_waits_at_its_start_until_commanded_to_run);
    RUN_TEST(test_path_waits_at_its_start_for_the_knots_that_a_stop_needs);
    RUN_TEST(test_complete_stream_starts_however_short_it_is);
    RUN_TEST(test_path_ends_exactly_at_the_last_knot_of_a_complete_stream);
    RUN_TEST(test_executed_counts_the_knots_at_or_before_s);
    RUN_TEST(test_count_is_passed_on_to_the_spline);
    RUN_TEST(test_stop_takes_stop_time_and_half_as_many_knots_and_so_does_the_way_back);
    RUN_TEST(test_longest_stop_keeps_its_profile);
    RUN_TEST(test_shortest_stop_is_over_after_its_ten_periods);
    RUN_TEST(test_rate_dot_is_the_change_of_the_rate);
    RUN_TEST(test_rate_dot_never_steps_whatever_run_does);
    RUN_TEST(test_resume_in_the_middle_of_a_stop_never_stands);
    RUN_TEST(test_path_starts_at_the_rate_of_the_override);
    RUN_TEST(test_rate_goes_to_the_override_and_stays_there);
    RUN_TEST(test_override_of_0_stands_and_is_no_underrun);
    RUN_TEST(test_stop_from_120_percent_takes_115_hundredths_of_the_stop_time_and_069_as_many_knots);
    RUN_TEST(test_path_at_120_percent_waits_for_the_knots_that_its_stop_needs);
    RUN_TEST(test_deceleration_and_jerk_of_path_time_keep_their_limits_whatever_is_wanted_when);
    RUN_TEST(test_path_stops_short_of_the_knots_that_are_missing_and_reports_an_underrun);
    RUN_TEST(test_path_asked_to_stop_reports_no_underrun);
    RUN_TEST(test_hiccup_slows_the_path_and_it_recovers);
    RUN_TEST(test_knots_at_half_the_rate_halve_the_speed_without_a_stop);
    RUN_TEST(test_path_never_outruns_its_knots_whenever_they_come);
    RUN_TEST(test_override_above_1_takes_a_path_on_that_runs_at_1);
    RUN_TEST(test_smallest_override_with_the_longest_stop_is_no_underrun_from_its_first_period_on);
    return UNITY_END();
}
