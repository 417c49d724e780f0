/* SPDX-License-Identifier: Apache-2.0 */
/* test_servo_forced.c: a control period in which the force of an axis is given, and not the law's. */
#include "core/servo.h"

#include "nominal.h"
#include "unity.h"

static struct spline_ring ring;
static struct servo_cfg cfg;
static struct servo_state state;
static struct servo_in in;
static struct servo_out out;

static uint32_t periods;

/* The reference moves at 100 mm/s on a circle of 20 mm; the axes are on it, and 10 um behind. */
static double place(void)
{
    const double knots = 50 + periods / 10.0, phi = knots * 0.005 - 10.0 / 20000;
    at_um(20000 * cos(phi), 20000 * sin(phi), in.measured);
    path_set(&in.path, path_time_of(knots));
    return phi;
}

static void step(void)
{
    place();
    servo_step(&cfg, &state, &in, &out);
    periods++;
}

static void steps(unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        step();
    }
}

void setUp(void)
{
    cfg = nominal();
    circle_ring(&ring, 20000, 0.005, 400);
    in = (struct servo_in){
        .enabled = {true, true}, .controller = CONTROLLER_TRACK, .path = path_at(&ring, 50), .ring = &ring};
    periods = 0;
    const double phi = place();
    servo_reset(&cfg, &state, in.measured);
    state.observer[0].vel = mk(-500 * sin(phi));
    state.observer[1].vel = mk(500 * cos(phi));
    steps(100);
}

void tearDown(void)
{
}

static void test_force_that_is_given_acts_and_the_axis_has_no_errors(void)
{
    in.forced = 1;
    in.force = v2(mk(-120), mk(500));
    steps(3);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, -120, val(out.force.x));
    TEST_ASSERT_TRUE(fabs(val(out.force.y)) < 200);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.contour.e_w.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.contour.e_n.y));
    TEST_ASSERT_TRUE(fabs(val(out.contour.e_w.y)) > 1);
    TEST_ASSERT_FALSE(out.saturated);
    in.forced = 2;
    steps(1);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 500, val(out.force.y));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.contour.e_w.y));
}

/* The observer gets what accelerates: the force without the friction that the law would cancel, of which it asks none. */
static void test_observer_gets_the_force_that_is_given(void)
{
    in.forced = 3;
    in.force = v2(mk(-120), mk(60));
    steps(1);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, -120, val(state.demand[state.slot % 2].net.x));
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 60, val(state.demand[state.slot % 2].net.y));
}

static void test_force_that_is_given_keeps_to_the_limit_and_to_the_power(void)
{
    in.forced = 3;
    in.force = v2(mk(700), mk(-700));
    steps(1);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 600, val(out.force.x));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, -600, val(out.force.y));
    TEST_ASSERT_TRUE(out.saturated);
    in.enabled[0] = false;
    steps(1);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.force.x));
    in.enabled[1] = false;
    steps(1);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.force.y));
}

static void test_law_goes_on_from_the_force_that_was_given(void)
{
    in.forced = 1;
    in.force = v2(mk(-120), mk(0));
    steps(10);
    const double y = val(out.force.y);
    in.forced = 0;
    steps(1);
    TEST_ASSERT_DOUBLE_WITHIN(1, -120, val(out.force.x));
    TEST_ASSERT_DOUBLE_WITHIN(5, y, val(out.force.y));
    steps(1500);
    TEST_ASSERT_TRUE(fabs(val(state.offset.x)) < 0.1);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_force_that_is_given_acts_and_the_axis_has_no_errors);
    RUN_TEST(test_observer_gets_the_force_that_is_given);
    RUN_TEST(test_force_that_is_given_keeps_to_the_limit_and_to_the_power);
    RUN_TEST(test_law_goes_on_from_the_force_that_was_given);
    return UNITY_END();
}
