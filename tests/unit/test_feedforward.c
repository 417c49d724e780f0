/* SPDX-License-Identifier: Apache-2.0 */
/* test_feedforward.c: the adaptive feedforward of friction and mass. */
#include "core/feedforward.h"

#include <math.h>

#include "nominal.h"
#include "unity.h"

static struct feedforward_cfg cfg;
static struct plant_cfg plant;
static struct feedforward_state state;

#define SPEED 0.5 /* boundary layer of the reference velocity's sign */

void setUp(void)
{
    cfg = (struct feedforward_cfg){.friction_rate = mk(0.5), .mass_rate = mk(0.25), .acceleration = mk(12)};
    plant = (struct plant_cfg){.mass = mk2(4, 2), .coulomb = mk2(10, 20)};
    feedforward_reset(&state);
}
void tearDown(void)
{
}

static void adapt(int periods, vec2 r_dot, vec2 r_ddot, double ux, double uy)
{
    for (int i = 0; i < periods; i++) {
        for (int axis = 0; axis < 2; axis++) {
            feedforward_step(&cfg, &plant, &state, axis, smc_direction(mk(SPEED), r_dot), r_ddot, mk2(ux, uy), mk(DT));
        }
    }
}

static void test_nothing_is_fed_forward_before_any_adaptation(void)
{
    const vec2 f = feedforward_force(&state, smc_direction(mk(SPEED), mk2(100, -100)), mk2(50, 50));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(f.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(f.y));
}

static void test_friction_adapts_along_the_direction_of_motion(void)
{
    adapt(1, mk2(100, -100), mk2(0, 0), 8, -16);
    ASSERT_NEAR(0.5 * DT * 8, acc_val(state.friction[0]), 8);
    ASSERT_NEAR(0.5 * DT * 16, acc_val(state.friction[1]), 16); /* a force along a negative motion is friction */
    adapt(1, mk2(-100, 100), mk2(0, 0), 8, -16);
    ASSERT_NEAR(0, acc_val(state.friction[0]), 16);
    ASSERT_NEAR(0, acc_val(state.friction[1]), 32);
}

static void test_friction_adapts_less_within_the_boundary_layer_and_not_at_rest(void)
{
    adapt(1, mk2(SPEED / 4, 0), mk2(0, 0), 8, 8);
    ASSERT_NEAR(0.5 * DT * 8 / 4, acc_val(state.friction[0]), 8);
    TEST_ASSERT_EQUAL_DOUBLE(0, acc_val(state.friction[1]));
}

static void test_mass_adapts_along_the_acceleration_and_is_normalised_by_it(void)
{
    adapt(1, mk2(0, 0), mk2(5, -16), 8, 8); /* 5, 12, 13 and 16, 12, 20 are sides of right triangles */
    ASSERT_NEAR(0.25 * DT * 8 * 5 / (13.0 * 13.0), acc_val(state.mass[0]), 8);
    ASSERT_NEAR(-0.25 * DT * 8 * 16 / (20.0 * 20.0), acc_val(state.mass[1]), 8);
    TEST_ASSERT_EQUAL_DOUBLE(0, acc_val(state.friction[0]));
}

static void test_a_great_acceleration_does_not_leave_the_range(void)
{
    adapt(1, mk2(0, 0), mk2(3000, -3000), 600, 600);
    ASSERT_NEAR(0.25 * DT * 600 / 3000, acc_val(state.mass[0]), 600);
    ASSERT_NEAR(-0.25 * DT * 600 / 3000, acc_val(state.mass[1]), 600);
}

static void test_force_is_friction_that_turns_with_the_motion_and_mass_times_acceleration(void)
{
    state.friction[0] = acc_from(mk(3));
    state.friction[1] = acc_from(mk(5));
    state.mass[0] = acc_from(mk(0.5));
    state.mass[1] = acc_from(mk(-0.25));
    const vec2 f = feedforward_force(&state, smc_direction(mk(SPEED), mk2(100, -100)), mk2(8, 16));
    TEST_ASSERT_EQUAL_DOUBLE(3 + 0.5 * 8, val(f.x));
    TEST_ASSERT_EQUAL_DOUBLE(-5 - 0.25 * 16, val(f.y));
}

static void test_estimates_stay_within_bounds_of_the_nominal_plant(void)
{
    adapt(20000, mk2(100, 100), mk2(12, 12), 600, -600);
    TEST_ASSERT_EQUAL_DOUBLE(3 * 10, acc_val(state.friction[0]));
    TEST_ASSERT_EQUAL_DOUBLE(-20, acc_val(state.friction[1])); /* the sum with the nominal is not negative */
    TEST_ASSERT_EQUAL_DOUBLE(4, acc_val(state.mass[0]));
    TEST_ASSERT_EQUAL_DOUBLE(-1, acc_val(state.mass[1]));
}

static void test_rates_of_zero_adapt_nothing(void)
{
    cfg.friction_rate = cfg.mass_rate = mk(0);
    adapt(100, mk2(100, 100), mk2(12, 12), 600, -600);
    TEST_ASSERT_EQUAL_DOUBLE(0, acc_val(state.friction[0]));
    TEST_ASSERT_EQUAL_DOUBLE(0, acc_val(state.mass[1]));
}

/* On a sine, with a compensator that supplies at once the part of friction 6 N and mass 1.5 that the feedforward
 * lacks. */
static void test_it_converges_to_the_friction_and_mass_that_are_missing(void)
{
    cfg.friction_rate = mk(0.2);
    cfg.mass_rate = mk(0.2);
    for (int i = 0; i < 20000; i++) {
        const double w = 0.1 * DT * i;
        const vec2 r_dot = mk2(400 * cos(w), 0);
        const vec2 r_ddot = mk2(-40 * sin(w), 0);
        const double fed = val(feedforward_force(&state, smc_direction(mk(SPEED), r_dot), r_ddot).x);
        adapt(1, r_dot, r_ddot, 6 * (val(r_dot.x) > 0 ? 1 : -1) + 1.5 * val(r_ddot.x) - fed, 0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 6, acc_val(state.friction[0]));
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 1.5, acc_val(state.mass[0]));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_nothing_is_fed_forward_before_any_adaptation);
    RUN_TEST(test_friction_adapts_along_the_direction_of_motion);
    RUN_TEST(test_friction_adapts_less_within_the_boundary_layer_and_not_at_rest);
    RUN_TEST(test_mass_adapts_along_the_acceleration_and_is_normalised_by_it);
    RUN_TEST(test_a_great_acceleration_does_not_leave_the_range);
    RUN_TEST(test_force_is_friction_that_turns_with_the_motion_and_mass_times_acceleration);
    RUN_TEST(test_estimates_stay_within_bounds_of_the_nominal_plant);
    RUN_TEST(test_rates_of_zero_adapt_nothing);
    RUN_TEST(test_it_converges_to_the_friction_and_mass_that_are_missing);
    return UNITY_END();
}
