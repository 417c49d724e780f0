/* SPDX-License-Identifier: Apache-2.0 */
/* test_smc.c: the sliding mode law, its surface and its adaptive gain. */
#include "core/smc.h"

#include <math.h>

#include "nominal.h"
#include "unity.h"

static struct smc_cfg cfg;
static struct plant_cfg plant;
static struct smc_state state;
static struct smc_in in;
static struct smc_out out;

/* lambda 1, gamma 0.5, beta 6, masses 2 and 4; no viscous friction, no gain, and no error or motion in the axis
 * frame. */
void setUp(void)
{
    cfg = nominal().gains.smc;
    cfg.lambda = mk(1);
    cfg.gamma = mk(0.5);
    cfg.k_bar = mk(1.0 / 128);
    cfg.e_max = mk(128);
    cfg.zeta_rate = cfg.xi = mk(0); /* only the tests of the adaptation have one */
    plant =
        (struct plant_cfg){.mass = mk2(2, 4), .viscous = mk2(0, 0), .coulomb = mk2(10, 20), .force_max = mk2(600, 600)};
    state.k_hat[0] = state.k_hat[1] = acc_from(mk(0));
    in = (struct smc_in){.t = mk2(1, 0)};
}
void tearDown(void)
{
}

static void step(void)
{
    smc_step(&cfg, &plant, &state, &in, &out);
    smc_adapt(&cfg, &state, 0, out.s_bar, mk(DT));
    smc_adapt(&cfg, &state, 1, out.s_bar, mk(DT));
}

/* The error that trig_cosh() promises, times gamma beta. */
#define COSH (1e-5 + NUM_FIXED * 3 * 2e-5)

/* A of (10) at the error e. */
static double slope(double e)
{
    in.e = mk2(e, 0);
    in.e_dot = mk2(0, 0);
    step();
    return val(out.s_bar.x) / e;
}

static void test_sliding_variable_is_a_times_error_plus_its_rate(void)
{
    in.e = mk2(2, -3);
    in.e_dot = mk2(5, 7);
    step();
    const double a1 = 1 + 0.5 * 6 / cosh(2.0 / 128), a2 = 1 + 0.5 * 6 / cosh(3.0 / 128);
    ASSERT_NEAR(a1 * 2 + 5, val(out.s_bar.x), 13.0);
    ASSERT_NEAR(a2 * -3 + 7, val(out.s_bar.y), 19.0);
}

static void test_psi_shrinks_far_from_the_contour(void)
{
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 1 + 0.5 * 6, slope(0.1));
    TEST_ASSERT_DOUBLE_WITHIN(COSH, 1 + 0.5 * 6 / cosh(0.5), slope(64));
    TEST_ASSERT_DOUBLE_WITHIN(COSH, 1 + 0.5 * 6 / cosh(0.5), slope(-64));
    TEST_ASSERT_TRUE(slope(90) < slope(50) && slope(50) < slope(10));
}

static void test_psi_as_printed_grows_far_from_the_contour(void)
{
    cfg.psi_printed = true;
    TEST_ASSERT_DOUBLE_WITHIN(COSH, 1 + 0.5 * 6 * cosh(0.5), slope(64));
    TEST_ASSERT_TRUE(slope(90) > slope(50) && slope(50) > slope(10));
}

static void test_psi_is_constant_beyond_e_max(void)
{
    TEST_ASSERT_DOUBLE_WITHIN(COSH, 1 + 0.5 * 6 / cosh(1), slope(128));
    TEST_ASSERT_DOUBLE_WITHIN(COSH, 1 + 0.5 * 6 / cosh(1), slope(1000));
    TEST_ASSERT_DOUBLE_WITHIN(COSH, 1 + 0.5 * 6 / cosh(1), slope(-1000));
}

/* B from u = -M (A e' + B e), the feedback of (15) with K = 0. */
static double b_at(double e, double e_dot)
{
    in.e = mk2(0, e);
    in.e_dot = mk2(0, e_dot);
    step();
    const double a = (val(out.s_bar.y) - e_dot) / e;
    return (-val(out.u_linear.y) / 4 - a * e_dot) / e;
}

static void check_b(double e, double e_dot)
{
    /* psi is 6 cosh(k e) or 6 / cosh(k e). Its derivative is computed from differences in double. */
    const double h = 1e-4, x1 = (e + e_dot * h) / 128, x0 = (e - e_dot * h) / 128;
    const double psi_dot =
        cfg.psi_printed ? 6 * (cosh(x1) - cosh(x0)) / (2 * h) : 6 * (1 / cosh(x1) - 1 / cosh(x0)) / (2 * h);
    TEST_ASSERT_DOUBLE_WITHIN(2e-5 + HALF_STEPS(16), 0.5 * psi_dot, b_at(e, e_dot));
}

static void test_b_is_the_rate_of_a(void)
{
    check_b(50, 30);
    check_b(-50, 30);
    check_b(20, -60);
    cfg.psi_printed = true;
    check_b(50, 30);
    check_b(-50, 30);
}

static void test_b_is_zero_beyond_e_max_where_a_is_constant(void)
{
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 0, b_at(150, 30));
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 0, b_at(-150, 30));
}

static void test_adaptive_gain_pulls_against_the_sliding_variable(void)
{
    state.k_hat[0] = acc_from(mk(0.25));
    state.k_hat[1] = acc_from(mk(0.5));
    in.e_dot = mk2(3, -4);
    step();
    /* u = -M (A e' + K s), A = 4 at e = 0, s = e' */
    ASSERT_NEAR(-2 * (4 * 3 + 0.25 * 3), val(out.u_linear.x), 25.5);
    ASSERT_NEAR(-4 * (4 * -4 + 0.5 * -4), val(out.u_linear.y), 72.0);
}

static void test_stiffness_pulls_against_the_error_and_leaves_the_sliding_variable(void)
{
    cfg.beta = mk(0);
    in.e = mk2(3, -5);
    in.e_dot = mk2(2, 0);
    step();
    ASSERT_NEAR(-2 * 1 * 2, val(out.u_linear.x), 4.0);
    cfg.stiffness = mk(0.75);
    step();
    ASSERT_NEAR(3 + 2, val(out.s_bar.x), 5.0);
    ASSERT_NEAR(-2 * (1 * 2 + 0.75 * 3), val(out.u_linear.x), 8.5);
    ASSERT_NEAR(-4 * (0.75 * -5), val(out.u_linear.y), 15.0);
}

static void test_stiffness_adds_to_the_rate_of_a(void)
{
    const double without = b_at(50, 30);
    cfg.stiffness = mk(0.75);
    TEST_ASSERT_DOUBLE_WITHIN(2e-5 + HALF_STEPS(16), without + 0.75, b_at(50, 30));
}

static void test_force_is_mass_times_the_demanded_acceleration_plus_viscous_friction(void)
{
    plant.viscous = mk2(0.5, 0.25);
    in.a_n = mk2(10, -20);
    in.q_dot = mk2(4, 8);
    step();
    ASSERT_NEAR(2 * 10 + 0.5 * 4, val(out.u_linear.x), 22.0);
    ASSERT_NEAR(4 * -20 + 0.25 * 8, val(out.u_linear.y), 82.0);
}

static void test_the_law_acts_in_the_frame_at_the_foot_point(void)
{
    in.t = mk2(0.6, 0.8);
    in.e_dot = mk2(5, 0); /* along the path */
    step();
    ASSERT_NEAR(-2 * 4 * 5 * 0.6, val(out.u_linear.x), 40.0);
    ASSERT_NEAR(-4 * 4 * 5 * 0.8, val(out.u_linear.y), 80.0);
    in.e_dot = mk2(0, 5); /* along the normal (-0.8, 0.6) */
    step();
    ASSERT_NEAR(-2 * 4 * 5 * -0.8, val(out.u_linear.x), 40.0);
    ASSERT_NEAR(-4 * 4 * 5 * 0.6, val(out.u_linear.y), 80.0);
    in.e_dot = mk2(0, 0);
    in.a_n = mk2(0, 5);
    step();
    ASSERT_NEAR(2 * 5 * -0.8, val(out.u_linear.x), 40.0);
    ASSERT_NEAR(4 * 5 * 0.6, val(out.u_linear.y), 80.0);
}

static void test_friction_is_that_of_the_reference_velocity_and_is_returned_apart(void)
{
    in.direction = smc_direction(mk(0.25), mk2(400, -400));
    step();
    TEST_ASSERT_EQUAL_DOUBLE(10, val(out.u_friction.x));
    TEST_ASSERT_EQUAL_DOUBLE(-20, val(out.u_friction.y));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.u_linear.x));
}

static void test_friction_rises_linearly_within_its_boundary_layer(void)
{
    in.direction = smc_direction(mk(0.25), mk2(0.125, -0.0625));
    step();
    TEST_ASSERT_EQUAL_DOUBLE(5, val(out.u_friction.x));
    TEST_ASSERT_EQUAL_DOUBLE(-5, val(out.u_friction.y));
}

/* K after a step at s_bar = s that starts from k. */
static double adapted(double k, double s)
{
    state.k_hat[0] = state.k_hat[1] = acc_from(mk(k));
    in.e = mk2(0, 0);
    in.e_dot = mk2(s, -s);
    step();
    TEST_ASSERT_EQUAL_DOUBLE(acc_val(state.k_hat[0]), acc_val(state.k_hat[1]));
    return acc_val(state.k_hat[0]);
}

static void test_gain_rises_above_epsilon_and_falls_below(void)
{
    cfg.xi = mk(0.01 * ACC_GAIN);
    cfg.epsilon = mk(4);
    cfg.zeta = mk(0.5);
    cfg.zeta_rate = mk(0.125 * ACC_GAIN);
    ASSERT_NEAR(1 + 0.01 * 5 * DT, adapted(1, 5), 1.0);
    ASSERT_NEAR(1 - 0.01 * 3 * DT, adapted(1, 3), 1.0);
}

static void test_gain_at_or_below_its_floor_rises_at_the_floors_rate(void)
{
    cfg.zeta = mk(0.5);
    cfg.zeta_rate = mk(0.125 * ACC_GAIN);
    ASSERT_NEAR(0.5 + 0.125 * DT, adapted(0.5, 1), 0.5);
    ASSERT_NEAR(0.25 + 0.125 * DT, adapted(0.25, 100), 0.5);
}

static void test_gain_is_never_negative_and_never_above_its_limit(void)
{
    cfg.xi = mk(0.05 * ACC_GAIN);
    cfg.epsilon = mk(50);
    cfg.zeta = mk(0.01);
    cfg.k_max = mk(2);
    TEST_ASSERT_EQUAL_DOUBLE(0, adapted(0.02, 49));
    TEST_ASSERT_EQUAL_DOUBLE(2, adapted(1.95, 60));
}

static void test_reset_starts_both_gains_from_k_0(void)
{
    smc_reset(&cfg, &state);
    ASSERT_NEAR(0.5, acc_val(state.k_hat[0]), 0.5);
    ASSERT_NEAR(0.5, acc_val(state.k_hat[1]), 0.5);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_sliding_variable_is_a_times_error_plus_its_rate);
    RUN_TEST(test_psi_shrinks_far_from_the_contour);
    RUN_TEST(test_psi_as_printed_grows_far_from_the_contour);
    RUN_TEST(test_psi_is_constant_beyond_e_max);
    RUN_TEST(test_b_is_the_rate_of_a);
    RUN_TEST(test_b_is_zero_beyond_e_max_where_a_is_constant);
    RUN_TEST(test_adaptive_gain_pulls_against_the_sliding_variable);
    RUN_TEST(test_stiffness_pulls_against_the_error_and_leaves_the_sliding_variable);
    RUN_TEST(test_stiffness_adds_to_the_rate_of_a);
    RUN_TEST(test_force_is_mass_times_the_demanded_acceleration_plus_viscous_friction);
    RUN_TEST(test_the_law_acts_in_the_frame_at_the_foot_point);
    RUN_TEST(test_friction_is_that_of_the_reference_velocity_and_is_returned_apart);
    RUN_TEST(test_friction_rises_linearly_within_its_boundary_layer);
    RUN_TEST(test_gain_rises_above_epsilon_and_falls_below);
    RUN_TEST(test_gain_at_or_below_its_floor_rises_at_the_floors_rate);
    RUN_TEST(test_gain_is_never_negative_and_never_above_its_limit);
    RUN_TEST(test_reset_starts_both_gains_from_k_0);
    return UNITY_END();
}
