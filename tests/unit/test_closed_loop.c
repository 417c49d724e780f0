/* SPDX-License-Identifier: Apache-2.0 */
/* test_closed_loop.c: the servo on a simulated machine, in every numeric back end. The axes stay on the circle; in
 * the checking back end the results are as precise as in double.
 */
#include "drive/configuration.h"
#include "nominal.h"
#include "sim/plant.h"
#include "table1.h"
#include "unity.h"

enum { KNOTS = 700 };

static struct spline_ring ring;
static struct servo_cfg cfg;
static struct servo_state state;
static struct servo_in in;
static struct servo_out out;
static struct plant plant;
static double worst_error_um, worst_force_N; /* difference between fixed point and its shadow */

/* A circle that starts at rest at angle 0, reaches the feed within 50 ms, and then holds it. */
static void circle(double radius_um, double feed_mps)
{
    const double ramp = 50, step = feed_mps * 1e6 * 1e-3 / radius_um;
    ring.count = 0;
    for (int i = 0; i < KNOTS; i++) {
        const double x = i < ramp ? i / ramp : 1;
        const double a = step * (ramp * (x * x * x - 0.5 * x * x * x * x) + (i > ramp ? i - ramp : 0));
        add_knot(&ring, radius_um * cos(a), radius_um * sin(a));
    }
    ring.start = ring.knot[0];
}

static void power_on(const struct od_data *od)
{
    const struct ks_machine machine = {.mass_kg = {88.08, 97.90},
                                       .viscous_Nspm = {467.2, 631.0},
                                       .coulomb_N = {45.5, 54.8},
                                       .breakaway = {1, 1},
                                       .stribeck_mps = {1e-3, 1e-3},
                                       .force_limit_N = {600, 600},
                                       .force_noise_N = {2, 2},
                                       .encoder_m = {76.29e-9, 76.29e-9},
                                       .travel_min_m = {-0.15, -0.15},
                                       .travel_max_m = {0.15, 0.15},
                                       .start_m = {ring.start.nm[0] * 1e-9, ring.start.nm[1] * 1e-9},
                                       .delay_periods = 1,
                                       .substeps = 10};
    TEST_ASSERT_NULL(plant_check(&machine));
    plant_init(&plant, &machine, 1, 1e-4);
    cfg = configuration_servo(od);
    worst_error_um = worst_force_N = 0;
}

static void measure(void)
{
    int32_t count[2];
    plant_encoders(&plant, count);
    at_um(count[0] * 76.29e-3, count[1] * 76.29e-3, in.measured);
}

static double shadow_error(num x)
{
#ifdef KONTUR_NUM_CHK
    return fabs(val(x) - x.d);
#else
    (void)x;
    return 0;
#endif
}

static void period(double knots, double rate)
{
    measure();
    path_set(&in.path, path_time_of(knots));
    in.path.rate = mk(rate);
    servo_step(&cfg, &state, &in, &out);
    const double force[2] = {val(out.force.x), val(out.force.y)};
    plant_step(&plant, force);
    worst_error_um = fmax(worst_error_um, fmax(shadow_error(out.contour.e_n.x), shadow_error(out.contour.e_n.y)));
    worst_force_N = fmax(worst_force_N, fmax(shadow_error(out.force.x), shadow_error(out.force.y)));
}

void setUp(void)
{
}
void tearDown(void)
{
}

static void start_with(enum controller controller, const struct od_data *od)
{
    power_on(od);
    in = (struct servo_in){.enabled = {true, true}, .controller = controller, .path = path_at(&ring, 0), .ring = &ring};
    measure();
    servo_reset(&cfg, &state, in.measured);
}

static void start(enum controller controller)
{
    const struct od_data od = table1();
    start_with(controller, &od);
}

static double off_um(double radius_um)
{
    return fabs(hypot(plant.pos_m[0], plant.pos_m[1]) * 1e6 - radius_um);
}

static void expect_as_exact_as_double(void)
{
    TEST_ASSERT_DOUBLE_WITHIN_MESSAGE(2e-3, 0, worst_error_um, "contour error, um");
    TEST_ASSERT_DOUBLE_WITHIN_MESSAGE(0.1, 0, worst_force_N, "force, N");
}

static void test_every_controller_stays_on_every_circle_and_is_as_exact_as_double(void)
{
    static const double circles[3][2] = {{4000, 4.488e-3}, {20000, 0.1}, {4000, 0.1}};
    for (int k = 0; k < 3; k++) {
        circle(circles[k][0], circles[k][1]);
        for (int c = 0; c < CONTROLLERS; c++) {
            double worst_um = 0;
            start((enum controller)c);
            for (int i = 0; i < (KNOTS - 5) * 10; i++) {
                period(i * 0.1, 1);
                worst_um = fmax(worst_um, off_um(circles[k][0]));
            }
            TEST_ASSERT_TRUE(worst_um < 30);
            expect_as_exact_as_double();
        }
    }
}

/* The path slows down to a stop within 50 ms, waits, and goes on. */
static void test_a_stop_on_the_path_and_switching_on_it_are_as_exact_as_double(void)
{
    circle(4000, 0.1);
    start(CONTROLLER_CCU);
    double s = 0, rate = 1, worst_um = 0;
    for (int i = 0; i < 6000; i++) {
        in.controller = (enum controller)(i / 300 % CONTROLLERS);
        const double before = rate;
        rate += i > 2000 && i < 3500 ? -0.002 : 0.002;
        rate = fmin(fmax(rate, 0), 1);
        in.path.rate_dot = mk((rate - before) * 50);
        period(s, rate);
        s += 0.1 * rate;
        worst_um = fmax(worst_um, off_um(4000));
    }
    TEST_ASSERT_TRUE(s > 300);
    TEST_ASSERT_TRUE(worst_um < 60);
    expect_as_exact_as_double();
}

/* Careful gains let an axis stick 0.4 mm from where it should be. At 0.3 mm/s that is 200 times what lag_max allows. The
 * checking back end would stop at quotients that lag_max limits. */
#ifndef KONTUR_NUM_CHK
static void test_factory_gains_do_not_swing_where_the_axes_are_far_off_a_slow_path(void)
{
    struct od_data od;
    od_init(&od, 1);
    circle_ring(&ring, 2000, 0.3 / 2000, KNOTS);
    ring.start.nm[0] += 400000; /* where the axes are; the path begins further on */
    ring.start.nm[1] += 400000;
    for (int c = 0; c < CONTROLLERS; c++) {
        double most_N = 0;
        start_with((enum controller)c, &od);
        for (int i = 0; i < (KNOTS - 7) * 10; i++) {
            period(2 + i * 0.1, 1);
            most_N = fmax(most_N, fmax(fabs(val(out.force.x)), fabs(val(out.force.y))));
        }
        TEST_ASSERT_TRUE_MESSAGE(most_N < 80, "force, N");
    }
}
#endif

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_every_controller_stays_on_every_circle_and_is_as_exact_as_double);
    RUN_TEST(test_a_stop_on_the_path_and_switching_on_it_are_as_exact_as_double);
#ifndef KONTUR_NUM_CHK
    RUN_TEST(test_factory_gains_do_not_swing_where_the_axes_are_far_off_a_slow_path);
#endif
    return UNITY_END();
}
