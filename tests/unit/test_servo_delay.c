/* SPDX-License-Identifier: Apache-2.0 */
/* test_servo_delay.c: what the reference asks for is demanded earlier where the force acts late. */
#include "core/servo.h"

#include "nominal.h"
#include "unity.h"

#define LATE_X 0.2 /* T0: 1 ms */
#define LATE_Y 0.06

static struct spline_ring ring;
static struct servo_cfg cfg;
static struct servo_state state;
static struct servo_in in;
static struct servo_out out;

static uint32_t periods;

/* A circle of 4 mm at 100 mm/s, or slower by `rate`. The axes are on it. */
static double place(double rate)
{
    const double knots = 50 + rate * periods / 10.0;
    const double phi = knots * 0.025;
    at_um(4000 * cos(phi), 4000 * sin(phi), in.measured);
    path_set(&in.path, path_time_of(knots));
    in.path.rate = mk(rate);
    return phi;
}

static void steps(double rate, unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        place(rate);
        servo_step(&cfg, &state, &in, &out);
        periods++;
    }
}

static void late(double x, double y)
{
    cfg.delay = (struct servo_delay_cfg){.on = true, .time = {mk(x), mk(y)}};
}

/* The drive as it starts, on the circle at this rate. */
static void start(double rate)
{
    periods = 0;
    const double phi = place(rate);
    servo_reset(&cfg, &state, in.measured);
    state.observer[0].vel = mk(-500 * rate * sin(phi));
    state.observer[1].vel = mk(500 * rate * cos(phi));
}

void setUp(void)
{
    cfg = nominal();
    circle_ring(&ring, 4000, 0.025, 400);
    in = (struct servo_in){
        .enabled = {true, true}, .controller = CONTROLLER_CASCADE, .path = path_at(&ring, 50), .ring = &ring};
    late(LATE_X, LATE_Y);
    start(1);
}

void tearDown(void)
{
}

/* Force of one period beyond that of a drive that knows of no delay, once the path has been followed a while. */
static vec2 more(double rate, unsigned count)
{
    start(rate);
    steps(rate, count);
    const vec2 with = out.force;
    cfg.delay.on = false;
    start(rate);
    steps(rate, count);
    cfg.delay.on = true;
    return v2_sub(with, out.force);
}

static void check_lead(double rate)
{
    const vec2 lead = more(rate, 46);
    struct spline_point at;
    spline_at(&ring, ring.count, path_s(&in.path), &at);
    const double cube = rate * rate * rate, a_x = rate * rate * val(at.d2.x), a_y = rate * rate * val(at.d2.y);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, LATE_X * (MASS_X * cube * val(at.d3.x) + VISCOUS_X * a_x), val(lead.x));
    TEST_ASSERT_DOUBLE_WITHIN(0.02, LATE_Y * (MASS_Y * cube * val(at.d3.y) + VISCOUS_Y * a_y), val(lead.y));
    TEST_ASSERT_TRUE(fabs(val(lead.x)) > 0.5 * cube && fabs(val(lead.y)) > 0.5 * cube);
}

static void test_the_reference_is_demanded_as_of_when_the_force_acts(void)
{
    check_lead(1);
    check_lead(0.5); /* the jerk goes with its third power */
}

static void test_the_lead_is_no_force_that_the_models_see(void)
{
    in.controller = CONTROLLER_CCU;
    steps(1, 40);
    const struct servo_demand seen = state.demand[state.slot % 2];
    const double law = val(out.smc.u_linear.x) + val(out.compensator.u.x);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, law, val(seen.net.x));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, val(out.smc.u_linear.x), val(seen.model.x));
    TEST_ASSERT_TRUE(fabs(val(out.force.x) - law - val(out.smc.u_friction.x)) > 0.5);
}

static void test_friction_is_that_of_the_speed_then(void)
{
    cfg.friction = (struct friction_cfg){
        .on = true, .axis = {friction_design(mk(0), mk(1.5), mk(200)), friction_design(mk(0), mk(1.5), mk(200))}};
    start(1);
    steps(1, 41);
    const double late_x = val(state.friction.shape.x), late_y = val(state.friction.shape.y);
    cfg.delay.on = false;
    late(0, 0);
    start(1);
    steps(1, 41);
    /* x speeds up and y slows down here: less and more of 0.5 exp(-speed / 200) */
    TEST_ASSERT_TRUE(fabs(late_x) < fabs(val(state.friction.shape.x)) - 1e-4);
    TEST_ASSERT_TRUE(fabs(late_y) > fabs(val(state.friction.shape.y)) + 1e-3);
}

static void test_an_axis_without_power_has_no_lead(void)
{
    steps(1, 10);
    TEST_ASSERT_TRUE(fabs(val(state.lead.x)) > 0.5);
    in.enabled[0] = false;
    steps(1, 4);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.lead.x));
    TEST_ASSERT_TRUE(fabs(val(state.lead.y)) > 0.5);
}

static void test_while_a_force_is_given_there_is_no_lead(void)
{
    steps(1, 10);
    TEST_ASSERT_TRUE(fabs(val(state.lead.x)) > 0.5);
    TEST_ASSERT_TRUE(fabs(val(state.lead.y)) > 0.5);
    in.forced = 2;
    steps(1, 4);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.lead.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.lead.y));
}

static void test_a_change_of_controllers_makes_no_step(void)
{
    steps(1, 40);
    const vec2 before = out.force;
    in.controller = CONTROLLER_TRACK;
    steps(1, 1);
    TEST_ASSERT_DOUBLE_WITHIN(0.2, val(before.x), val(out.force.x));
    TEST_ASSERT_DOUBLE_WITHIN(0.2, val(before.y), val(out.force.y));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_the_reference_is_demanded_as_of_when_the_force_acts);
    RUN_TEST(test_the_lead_is_no_force_that_the_models_see);
    RUN_TEST(test_friction_is_that_of_the_speed_then);
    RUN_TEST(test_an_axis_without_power_has_no_lead);
    RUN_TEST(test_while_a_force_is_given_there_is_no_lead);
    RUN_TEST(test_a_change_of_controllers_makes_no_step);
    return UNITY_END();
}
