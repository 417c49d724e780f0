/* SPDX-License-Identifier: Apache-2.0 */
/* test_observer.c: the extended state observer of one axis. */
#include "core/observer.h"

#include <math.h>

#include "nominal.h"
#include "unity.h"

static struct observer_cfg cfg;
static struct observer_state state;

void setUp(void)
{
    cfg = observer_design(mk(5), mk(DT)); /* 1000 rad/s; x = 0.05 */
    observer_reset(&state, 0);
}
void tearDown(void)
{
}

#define POLE ((1 - 2.5 * DT) / (1 + 2.5 * DT))

static pos_t um(double x)
{
    return (pos_t)llround(x * 1e3 * POS_PER_NM);
}

static void step(double measured_um, double force, double mass, double viscous)
{
    observer_step(&cfg, &state, um(measured_um), mk(force), mk(mass), mk(viscous));
}

static void test_gains_are_those_of_the_critically_damped_filter(void)
{
    const double q = 1 - POLE;
    ASSERT_NEAR(1 - POLE * POLE * POLE, val(cfg.gain_pos), 1.0);
    ASSERT_NEAR(1.5 * q * q * (1 + POLE) / DT, val(cfg.gain_vel), 50.0); /* 1 - p carries the roundings of p */
    ASSERT_NEAR(q * q * q / DT / DT, val(cfg.gain_acc), 100.0);
}

static void test_reset_is_at_rest_with_nothing_unexplained(void)
{
    step(100, 5, 2, 0);
    observer_reset(&state, um(-7));
    TEST_ASSERT_TRUE(state.pos == um(-7));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.vel));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.disturbance));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.acc));
}

/* The error after a step of position is, for a triple pole at p, p^k times a polynomial of degree 2 in k: its third
 * difference, weighted by p^-k, is zero. */
static void test_all_three_poles_are_where_the_bandwidth_puts_them(void)
{
    const int count = NUM_FIXED ? 15 : 40; /* the rounding of the gains splits a triple pole */
    double e[40];
    for (int k = 0; k < count; k++) {
        step(500, 0, 2, 0);
        e[k] = (500.0 - (double)state.pos / (POS_PER_NM * 1e3)) / pow(POLE, k);
    }
    for (int k = 0; k + 3 < count; k++) {
        /* The positions are rounded to 1e-4 um, which p^-k and the weights 1 3 3 1 of the difference amplify. In fixed
         * point the rounding of the gains counts, on 500 um. */
        TEST_ASSERT_DOUBLE_WITHIN((1e-3 + HALF_STEPS(10000)) / pow(POLE, k), 0,
                                  e[k + 3] - 3 * e[k + 2] + 3 * e[k + 1] - e[k]);
    }
    TEST_ASSERT_TRUE(fabs(e[0]) > 250); /* the first step leaves p^3 of the error */
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 500 * POLE * POLE * POLE, e[0]);
}

static void test_a_ramp_is_followed_without_error(void)
{
    for (int k = 0; k <= 400; k++) {
        step(100 * k * DT, 0, 2, 0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 100 * 400 * DT, (double)state.pos / (POS_PER_NM * 1e3));
    TEST_ASSERT_DOUBLE_WITHIN(2e-3, 100, val(state.vel));
    TEST_ASSERT_DOUBLE_WITHIN(2e-2, 0, val(state.disturbance));
}

static void test_an_unknown_constant_acceleration_is_found(void)
{
    for (int k = 0; k <= 400; k++) {
        const double t = k * DT;
        step(0.5 * 30 * t * t, 0, 2, 0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(5e-3, 30 * 400 * DT, val(state.vel));
    TEST_ASSERT_DOUBLE_WITHIN(5e-2, 30, val(state.disturbance));
    TEST_ASSERT_DOUBLE_WITHIN(5e-2, 30, val(state.acc));
}

static void test_a_known_force_leaves_nothing_unexplained(void)
{
    for (int k = 1; k <= 400; k++) {
        const double t = k * DT;
        step(0.5 * 30 * t * t, 60, 2, 0);
        TEST_ASSERT_DOUBLE_WITHIN(2e-2, 0, val(state.disturbance));
        TEST_ASSERT_DOUBLE_WITHIN(5e-3, 30 * t, val(state.vel));
    }
}

static void test_viscous_friction_is_known(void)
{
    /* 100 um/T0 held against 0.5 N/(um/T0) */
    state.vel = mk(100);
    for (int k = 1; k <= 100; k++) {
        step(100 * k * DT, 50, 2, 0.5);
        TEST_ASSERT_DOUBLE_WITHIN(2e-2, 0, val(state.disturbance));
        TEST_ASSERT_DOUBLE_WITHIN(2e-3, 100, val(state.vel));
    }
}

static void test_an_unknown_force_is_its_acceleration(void)
{
    /* 60 N known, 80 N at work on a mass of 2 */
    for (int k = 0; k <= 400; k++) {
        const double t = k * DT;
        step(0.5 * 40 * t * t, 60, 2, 0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(5e-2, 10, val(state.disturbance));
    TEST_ASSERT_DOUBLE_WITHIN(5e-2, 40, val(state.acc));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_gains_are_those_of_the_critically_damped_filter);
    RUN_TEST(test_reset_is_at_rest_with_nothing_unexplained);
    RUN_TEST(test_all_three_poles_are_where_the_bandwidth_puts_them);
    RUN_TEST(test_a_ramp_is_followed_without_error);
    RUN_TEST(test_an_unknown_constant_acceleration_is_found);
    RUN_TEST(test_a_known_force_leaves_nothing_unexplained);
    RUN_TEST(test_viscous_friction_is_known);
    RUN_TEST(test_an_unknown_force_is_its_acceleration);
    return UNITY_END();
}
