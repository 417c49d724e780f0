/* SPDX-License-Identifier: Apache-2.0 */
/* test_cascade.c: the P-PI cascade and cross-coupled control. */
#include "core/cascade.h"

#include "nominal.h"
#include "unity.h"

static struct cascade_cfg cfg;
static struct plant_cfg plant;
static struct cascade_state state;
static struct contour_out c;

/* K_p 0.5, K_v 2, K_i 0.25, W 3; masses 2 and 4. */
void setUp(void)
{
    cfg =
        (struct cascade_cfg){.k_p = mk(0.5), .k_v = mk(2), .k_i = mk(0.25), .coupling = mk(3), .integral_max = mk(100)};
    plant = (struct plant_cfg){.mass = mk2(2, 4), .viscous = mk2(0.5, 1)};
    cascade_reset(&state);
    c = (struct contour_out){.t = mk2(1, 0)};
}
void tearDown(void)
{
}

static vec2 force(bool coupled)
{
    return cascade_step(&cfg, &plant, &state, &c, coupled, mk(DT));
}

static void test_without_error_the_force_is_the_feedforward(void)
{
    c.r_dot = mk2(10, -20);
    c.r_ddot = mk2(3, 5);
    const vec2 u = force(true);
    ASSERT_NEAR(2 * 3 + 0.5 * 10, val(u.x), 11.0);
    ASSERT_NEAR(4 * 5 + 1 * -20, val(u.y), 40.0);
}

static void test_force_is_mass_times_the_pi_law_of_the_velocity_error(void)
{
    c.e_w = mk2(8, -4);
    c.e_w_dot = mk2(1, -3);
    const vec2 u = force(false);
    const double ex = -(1 + 0.5 * 8), ey = 3 + 0.5 * 4;
    ASSERT_NEAR(2 * 2 * (ex + 0.25 * ex * DT), val(u.x), 40.0);
    ASSERT_NEAR(4 * 2 * (ey + 0.25 * ey * DT), val(u.y), 60.0);
    ASSERT_NEAR(ex * DT, val(state.integral.x), 1.0);
    ASSERT_NEAR(ey * DT, val(state.integral.y), 1.0);
}

static void test_integral_sums_up_and_stops_at_its_limit(void)
{
    c.e_w = mk2(-20, 20);
    for (int i = 0; i < 100; i++) {
        force(false);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 100 * 10 * DT, val(state.integral.x));
    for (int i = 0; i < 1000; i++) {
        force(false);
    }
    TEST_ASSERT_EQUAL_DOUBLE(100, val(state.integral.x));
    TEST_ASSERT_EQUAL_DOUBLE(-100, val(state.integral.y));
}

static void test_coupled_control_accelerates_along_the_normal_alone(void)
{
    c.t = mk2(0.6, 0.8);
    c.e_n = mk2(50, 6); /* the error along the path plays no part */
    c.e_n_dot = mk2(70, 2);
    const vec2 u = force(true);
    const double w = -(2 + 0.5 * 6), a = 3 * 2 * (w + 0.25 * w * DT);
    ASSERT_NEAR(2 * -0.8 * a, val(u.x), 100.0);
    ASSERT_NEAR(4 * 0.6 * a, val(u.y), 100.0);
    ASSERT_NEAR(w * DT, val(state.coupled), 1.0);
}

static void test_coupled_control_is_added_to_the_cascade(void)
{
    c.e_w = mk2(8, -4);
    c.e_n = mk2(0, 6);
    const vec2 alone = force(false);
    cascade_reset(&state);
    const vec2 both = force(true);
    const double w = -0.5 * 6;
    ASSERT_NEAR(val(alone.x), val(both.x), 40.0); /* t = (1, 0): the normal is y */
    ASSERT_NEAR(val(alone.y) + 4 * 3 * 2 * (w + 0.25 * w * DT), val(both.y), 200.0);
}

static void test_coupled_integral_is_limited_and_forgotten_when_not_coupled(void)
{
    c.e_n = mk2(0, -100);
    for (int i = 0; i < 150; i++) {
        force(true);
    }
    TEST_ASSERT_EQUAL_DOUBLE(100, val(state.coupled));
    force(false);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.coupled));
}

/* At rest with a constant force of 30 N on x and -50 N on y, the integral compensates it. */
static void test_a_constant_disturbance_leaves_no_error(void)
{
    double x[2] = {0, 0}, v[2] = {0, 0};
    const double disturbance[2] = {30, -50}, mass[2] = {2, 4};
    for (int k = 0; k < 20000; k++) {
        c.e_w = mk2(x[0], x[1]);
        c.e_w_dot = mk2(v[0], v[1]);
        const vec2 u = force(false);
        const double f[2] = {val(u.x), val(u.y)};
        for (int i = 0; i < 2; i++) {
            v[i] += (f[i] + disturbance[i]) / mass[i] * DT;
            x[i] += v[i] * DT;
        }
        if (k == 50) {
            TEST_ASSERT_TRUE(x[0] > 1);
        }
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0, x[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0, x[1]);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_without_error_the_force_is_the_feedforward);
    RUN_TEST(test_force_is_mass_times_the_pi_law_of_the_velocity_error);
    RUN_TEST(test_integral_sums_up_and_stops_at_its_limit);
    RUN_TEST(test_coupled_control_accelerates_along_the_normal_alone);
    RUN_TEST(test_coupled_control_is_added_to_the_cascade);
    RUN_TEST(test_coupled_integral_is_limited_and_forgotten_when_not_coupled);
    RUN_TEST(test_a_constant_disturbance_leaves_no_error);
    return UNITY_END();
}
