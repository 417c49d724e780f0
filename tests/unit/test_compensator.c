/* SPDX-License-Identifier: Apache-2.0 */
/* test_compensator.c: the uncertainty compensator and its reference model. */
#include "core/compensator.h"

#include "nominal.h"
#include "unity.h"

static struct compensator_cfg cfg;
static struct plant_cfg plant;
static struct compensator_state state;
static struct compensator_out out;
static pos_t q[2];

/* alpha 0.5, phi 8, mu 3, so that z is limited to 16; masses 2 and 4. */
void setUp(void)
{
    cfg = (struct compensator_cfg){.alpha = mk(0.5),
                                   .mu_0 = mk(3),
                                   .mu_max = mk(5),
                                   .rho = mk(0.03125 * ACC_GAIN),
                                   .phi = mk(8),
                                   .dead_zone = mk(4),
                                   .turning = mk(1)};
    plant = (struct plant_cfg){.mass = mk2(2, 4), .viscous = mk2(0.5, 1), .coulomb = mk2(10, 20)};
    at_um(100, 200, q);
    compensator_reset(&cfg, &state, q, mk2(6, 7));
}
void tearDown(void)
{
}

/* One period with the plant (dx, dy) and (vx, vy) off the model, in the axis frame, which does not turn. */
static void step_off_by(double dx, double dy, double vx, double vy)
{
    pos_t p[2];
    at_um(100 + dx, 200 + dy, p);
    compensator_step(&cfg, &plant, &state, p, mk2(6 + vx, 7 + vy), mk2(1, 0), mk(0), &out);
    compensator_adapt(&cfg, &state, 0, out.s, mk(DT));
    compensator_adapt(&cfg, &state, 1, out.s, mk(DT));
}

static void test_the_model_starts_where_the_plant_is(void)
{
    step_off_by(0, 0, 0, 0);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.s.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.s.y));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.u.x));
    TEST_ASSERT_EQUAL_DOUBLE(3, acc_val(state.mu[0]));
    TEST_ASSERT_EQUAL_DOUBLE(3, acc_val(state.mu[1]));
}

static void test_sliding_variable_is_alpha_z_plus_its_rate(void)
{
    step_off_by(4, -2, 1, 3);
    TEST_ASSERT_EQUAL_DOUBLE(0.5 * 4 + 1, val(out.s.x));
    TEST_ASSERT_EQUAL_DOUBLE(0.5 * -2 + 3, val(out.s.y));
}

static void test_compensation_is_minus_alpha_rate_minus_mu_sat(void)
{
    state.mu[1] = acc_from(mk(1));
    step_off_by(4, -2, 1, 3); /* s = 3, 2 */
    TEST_ASSERT_EQUAL_DOUBLE(-(0.5 * 1 + 3 * 3.0 / 8), val(out.v.x));
    TEST_ASSERT_EQUAL_DOUBLE(-(0.5 * 3 + 1 * 2.0 / 8), val(out.v.y));
}

static void test_compensation_is_full_beyond_the_boundary_layer(void)
{
    step_off_by(0, 0, 20, -20);
    TEST_ASSERT_EQUAL_DOUBLE(-(0.5 * 20 + 3), val(out.v.x));
    TEST_ASSERT_EQUAL_DOUBLE(0.5 * 20 + 3, val(out.v.y));
}

static void test_force_is_mass_times_the_compensation_turned_into_the_axis_frame(void)
{
    pos_t p[2];
    at_um(100 + 3, 200 + 4, p); /* along t = (0.6, 0.8): z_n = (5, 0) */
    compensator_step(&cfg, &plant, &state, p, mk2(6, 7), mk2(0.6, 0.8), mk(0), &out);
    ASSERT_NEAR(5, val(out.z_n.x), 5.0);
    ASSERT_NEAR(0, val(out.z_n.y), 5.0);
    const double v = -3 * 2.5 / 8;
    ASSERT_NEAR(v, val(out.v.x), 5.0);
    ASSERT_NEAR(0, val(out.v.y), 5.0);
    ASSERT_NEAR(2 * 0.6 * v, val(out.u.x), 10.0);
    ASSERT_NEAR(4 * 0.8 * v, val(out.u.y), 20.0);
}

/* z_n' = R^T (z' + theta' I_e z): a z that is constant in the axis frame turns backwards in the frame. */
static void test_rate_of_z_has_the_frames_rotation_in_it(void)
{
    pos_t p[2];
    at_um(100 + 4, 200, p);
    compensator_step(&cfg, &plant, &state, p, mk2(6, 7), mk2(1, 0), mk(0.25), &out);
    TEST_ASSERT_EQUAL_DOUBLE(0.5 * 4, val(out.s.x));
    TEST_ASSERT_EQUAL_DOUBLE(-0.25 * 4, val(out.s.y));
}

static void test_rate_of_z_in_the_axes_has_no_rotation_in_it(void)
{
    pos_t p[2];
    cfg.turning = mk(0);
    at_um(100 + 4, 200, p);
    compensator_step(&cfg, &plant, &state, p, mk2(6 + 1, 7 + 3), mk2(1, 0), mk(0.25), &out);
    TEST_ASSERT_EQUAL_DOUBLE(0.5 * 4 + 1, val(out.s.x));
    TEST_ASSERT_EQUAL_DOUBLE(3, val(out.s.y));
}

static void test_mu_grows_only_outside_the_dead_zone(void)
{
    step_off_by(0, 0, 4, 4.5);
    TEST_ASSERT_EQUAL_DOUBLE(3, acc_val(state.mu[0]));
    ASSERT_NEAR(3 + 0.03125 * 4.5 * DT, acc_val(state.mu[1]), 3.0);
    step_off_by(0, 0, -6, 1);
    ASSERT_NEAR(3 + 0.03125 * 6 * DT, acc_val(state.mu[0]), 3.0);
}

static void test_mu_stops_at_its_limit(void)
{
    for (int i = 0; i < 1000; i++) {
        step_off_by(0, 0, 100, 0);
    }
    TEST_ASSERT_EQUAL_DOUBLE(5, acc_val(state.mu[0]));
    TEST_ASSERT_EQUAL_DOUBLE(3, acc_val(state.mu[1]));
}

static void test_mu_as_printed_starts_from_zero_and_always_grows(void)
{
    cfg.law_printed = true;
    compensator_reset(&cfg, &state, q, mk2(6, 7));
    TEST_ASSERT_EQUAL_DOUBLE(0, acc_val(state.mu[0]));
    step_off_by(0, 0, 1, -2);
    ASSERT_NEAR(0.03125 * 1 * DT, acc_val(state.mu[0]), 1.0);
    ASSERT_NEAR(0.03125 * 2 * DT, acc_val(state.mu[1]), 1.0);
}

static void test_z_is_limited_to_phi_over_alpha_and_the_model_follows(void)
{
    step_off_by(20, -30, 0, 0);
    TEST_ASSERT_EQUAL_DOUBLE(16, val(out.z_n.x));
    TEST_ASSERT_EQUAL_DOUBLE(-16, val(out.z_n.y));
    TEST_ASSERT_TRUE(state.q_bar[0] == q[0] + pos_from_nm(4000));
    TEST_ASSERT_TRUE(state.q_bar[1] == q[1] - pos_from_nm(14000));
    step_off_by(15, -15, 0, 0); /* back within the limit of the moved model */
    ASSERT_NEAR(11, val(out.z_n.x), 11.0);
    ASSERT_NEAR(-1, val(out.z_n.y), 1.0);
}

static void test_the_model_coasts_with_its_viscous_friction(void)
{
    compensator_model(&plant, &state, mk2(0, 0), mk(DT));
    const double vx = 6 - DT * 0.5 * 6 / 2, vy = 7 - DT * 1 * 7 / 4;
    ASSERT_NEAR(vx, val(state.q_bar_dot.x), 6.0);
    ASSERT_NEAR(vy, val(state.q_bar_dot.y), 7.0);
    ASSERT_NEAR(0.5 * (6 + vx) * DT, val(pos_sub(state.q_bar[0], q[0])), 1.0);
    ASSERT_NEAR(0.5 * (7 + vy) * DT, val(pos_sub(state.q_bar[1], q[1])), 1.0);
}

/* M q'' + C q' = u from rest: v = u/c (1 - exp(-c t/m)), x = u/c (t - m/c (1 - exp(-c t/m))) */
static void test_the_model_integrates_a_constant_force(void)
{
    compensator_reset(&cfg, &state, q, mk2(0, 0));
    for (int i = 0; i < 500; i++) { /* 10 T0, twice the time constant */
        compensator_model(&plant, &state, mk2(40, -40), mk(DT));
    }
    const double t = 10, fade_x = 1 - exp(-0.25 * t), fade_y = 1 - exp(-0.25 * t);
    /* Euler's rule is of first order. It errs by (dt/2)(c/m) = 0.25 % of the speed still to be gained, v_end e^-1
     * at most. */
    TEST_ASSERT_DOUBLE_WITHIN(80 * 0.0025, 80 * fade_x, val(state.q_bar_dot.x));
    TEST_ASSERT_DOUBLE_WITHIN(40 * 0.0025, -40 * fade_y, val(state.q_bar_dot.y));
    TEST_ASSERT_DOUBLE_WITHIN(80 * 0.0025 * t, 80 * (t - 4 * fade_x), val(pos_sub(state.q_bar[0], q[0])));
    TEST_ASSERT_DOUBLE_WITHIN(40 * 0.0025 * t, -40 * (t - 4 * fade_y), val(pos_sub(state.q_bar[1], q[1])));
}

/* In steady state v = -sigma whatever phi is: a constant disturbance is cancelled and z stays bounded. */
static void test_a_constant_disturbance_is_cancelled(void)
{
    double x = 0, v = 0;
    const double sigma = 2;
    cfg.dead_zone = mk(100);
    plant.viscous = mk2(0, 0);
    compensator_reset(&cfg, &state, q, mk2(0, 0));
    for (int i = 0; i < 3000; i++) {
        pos_t p[2];
        at_um(100 + x, 200, p);
        compensator_step(&cfg, &plant, &state, p, mk2(v, 0), mk2(1, 0), mk(0), &out);
        v += (sigma + val(out.v.x)) * DT;
        x += v * DT;
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, -sigma, val(out.v.x));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, sigma / 3 * 8 / 0.5, val(out.z_n.x)); /* mu s/phi = sigma, s = alpha z */
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_the_model_starts_where_the_plant_is);
    RUN_TEST(test_sliding_variable_is_alpha_z_plus_its_rate);
    RUN_TEST(test_compensation_is_minus_alpha_rate_minus_mu_sat);
    RUN_TEST(test_compensation_is_full_beyond_the_boundary_layer);
    RUN_TEST(test_force_is_mass_times_the_compensation_turned_into_the_axis_frame);
    RUN_TEST(test_rate_of_z_has_the_frames_rotation_in_it);
    RUN_TEST(test_rate_of_z_in_the_axes_has_no_rotation_in_it);
    RUN_TEST(test_mu_grows_only_outside_the_dead_zone);
    RUN_TEST(test_mu_stops_at_its_limit);
    RUN_TEST(test_mu_as_printed_starts_from_zero_and_always_grows);
    RUN_TEST(test_z_is_limited_to_phi_over_alpha_and_the_model_follows);
    RUN_TEST(test_the_model_coasts_with_its_viscous_friction);
    RUN_TEST(test_the_model_integrates_a_constant_force);
    RUN_TEST(test_a_constant_disturbance_is_cancelled);
    return UNITY_END();
}
