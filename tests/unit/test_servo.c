/* SPDX-License-Identifier: Apache-2.0 */
/* test_servo.c: one control period as a whole: change of controllers, limits, and the inputs of observer and models. */
#include "core/servo.h"

#include "nominal.h"
#include "unity.h"

static struct spline_ring ring;
static struct servo_cfg cfg;
static struct servo_state state;
static struct servo_in in;
static struct servo_table_in table;
static struct servo_out out;

static uint32_t periods;

/* Put the axes `behind_um` behind the reference and `out_um` outside its circle. Returns their angle. */
static double place(double behind_um, double out_um)
{
    const double knots = 50 + periods / 10.0, phi = knots * 0.005 - behind_um / 20000;
    at_um((20000 + out_um) * cos(phi), (20000 + out_um) * sin(phi), in.measured);
    path_set(&in.path, path_time_of(knots));
    return phi;
}

/* A period. The drive takes a configuration over by servo_reset(), these tests without one. */
static void tick(void)
{
    state.extras = true;
    if (!cfg.force_limit.on) {
        state.force_limit.limit = cfg.plant.force_max;
    }
    servo_step(&cfg, &state, &in, &out);
}

/* The reference moves at 100 mm/s on a circle of 20 mm, which is 12.5 um/T0^2 and 50 N. The axes move with it, 20
 * um behind and 4 um outside. */
void setUp(void)
{
    cfg = nominal();
    circle_ring(&ring, 20000, 0.005, 400);
    in = (struct servo_in){.enabled = {true, true},
                           .controller = CONTROLLER_CCU,
                           .path = path_at(&ring, 50),
                           .ring = &ring,
                           .table = &table};
    table = (struct servo_table_in){{0, 0}, {0, 0}};
    periods = 0;
    const double phi = place(20, 4);
    servo_reset(&cfg, &state, in.measured);
    state.observer[0].vel = mk(-500 * sin(phi));
    state.observer[1].vel = mk(500 * cos(phi));
}
void tearDown(void)
{
}

static void step(double behind_um, double out_um)
{
    place(behind_um, out_um);
    tick();
    periods++;
}

/* The force demand of the last period. */
static const struct servo_demand *demand(void)
{
    return &state.demand[state.slot % 2];
}

static void test_reset_is_at_rest_where_the_encoders_are(void)
{
    in.enabled[0] = in.enabled[1] = false;
    servo_reset(&cfg, &state, in.measured);
    TEST_ASSERT_EQUAL(CONTROLLERS, state.controller); /* none has been at work */
    TEST_ASSERT_FALSE(state.enabled[0] || state.enabled[1]);
    for (int i = 0; i < 2; i++) { /* and each would begin here */
        TEST_ASSERT_TRUE(state.compensator.q_bar[i] == in.measured[i]);
        TEST_ASSERT_EQUAL_DOUBLE(acc_val(acc_from(cfg.gains.smc.k_0)), acc_val(state.smc.k_hat[i]));
    }
    tick();
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.velocity.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.velocity.y));
    TEST_ASSERT_TRUE(state.observer[0].pos == in.measured[0]);
    TEST_ASSERT_TRUE(state.observer[1].pos == in.measured[1]);
}

static void run(enum controller controller, int count)
{
    in.controller = controller;
    for (int i = 0; i < count; i++) {
        step(20, 4);
    }
}

static void test_every_switch_of_controllers_keeps_the_force(void)
{
    for (int from = 0; from < CONTROLLERS; from++) {
        for (int to = 0; to < CONTROLLERS; to++) {
            if (from == to) {
                continue;
            }
            setUp();
            run((enum controller)from, 200);
            const vec2 before = out.force;
            run((enum controller)to, 1);
            /* u + (force - u) */
            ASSERT_NEAR(val(before.x), val(out.force.x), 600.0);
            ASSERT_NEAR(val(before.y), val(out.force.y), 600.0);
            TEST_ASSERT_TRUE(fabs(val(before.x)) + fabs(val(before.y)) > 20);
        }
    }
}

/* Notches on x and y, and a low-pass filter on x */
static void filter(void)
{
    const struct force_section_spec spec[2][FORCE_SECTIONS] = {{{170000, 70, 170000, 700}, {0, 0, 700000, 700}},
                                                               {{90000, 100, 90000, 500}}};
    TEST_ASSERT_TRUE(force_filter_design(&cfg.force_filter, 0, spec[0], 10000));
    TEST_ASSERT_TRUE(force_filter_design(&cfg.force_filter, 1, spec[1], 10000));
}

static void test_force_filters_start_with_the_force_of_the_law(void)
{
    vec2 first[2], second[2];
    for (int filtered = 0; filtered < 2; filtered++) {
        setUp();
        if (filtered != 0) {
            filter();
        }
        run(CONTROLLER_CC, 1);
        first[filtered] = out.force;
        run(CONTROLLER_CC, 50);
        in.enabled[1] = false;
        run(CONTROLLER_CC, 50);
        in.enabled[1] = true;
        run(CONTROLLER_CC, 1);
        second[filtered] = v2_sub(out.force, state.filtering);
        TEST_ASSERT_EQUAL_DOUBLE(0, val(state.filtering.x));
        TEST_ASSERT_EQUAL_DOUBLE(0, val(state.filtering.y));
    }
    TEST_ASSERT_TRUE(fabs(val(first[0].x)) + fabs(val(first[0].y)) > 20);
    TEST_ASSERT_EQUAL_DOUBLE(val(first[0].x), val(first[1].x));
    TEST_ASSERT_EQUAL_DOUBLE(val(first[0].y), val(first[1].y));
    TEST_ASSERT_TRUE(fabs(val(second[0].x)) + fabs(val(second[1].y)) > 20);
}

static void test_models_get_the_force_that_the_filters_let_through(void)
{
    filter();
    run(CONTROLLER_CASCADE, 50);
    step(-30, 10); /* a step of the force, of which the filters let a part through */
    TEST_ASSERT_TRUE(fabs(val(state.filtering.x)) > 1);
    TEST_ASSERT_TRUE(fabs(val(state.filtering.y)) > 1);
    const vec2 balance = v2_mul(cfg.plant.coulomb, smc_direction(cfg.gains.smc.friction_speed, out.contour.r_dot));
    const vec2 net = v2_sub(out.force, balance);
    ASSERT_NEAR(val(net.x), val(demand()->net.x), 600.0);
    ASSERT_NEAR(val(net.y), val(demand()->net.y), 600.0);
    ASSERT_NEAR(val(net.x), val(demand()->model.x), 600.0);
    ASSERT_NEAR(val(net.y), val(demand()->model.y), 600.0);
}

static void test_a_switch_keeps_the_force_that_goes_into_the_filters(void)
{
    filter();
    run(CONTROLLER_CASCADE, 50);
    step(-30, 10);
    const vec2 before = v2_sub(out.force, state.filtering);
    in.controller = CONTROLLER_CC;
    step(-30, 10);
    const vec2 after = v2_sub(out.force, state.filtering);
    ASSERT_NEAR(val(before.x), val(after.x), 1200.0);
    ASSERT_NEAR(val(before.y), val(after.y), 1200.0);
}

static void test_heat_lowers_the_limit_of_its_axis(void)
{
    for (int i = 0; i < 2; i++) {
        setUp();
        cfg.force_limit = (struct force_limit_cfg){
            .on = true, .continuous = mk2(10, 10), .inverse = mk2(0.1, 0.1), .rate = {mk(0.001), mk(0.001)}};
        run(CONTROLLER_CC, 10);
        TEST_ASSERT_FALSE(out.saturated);
        state.force_limit.heat[i] = acc_from(mk(1.5));
        while (state.slot != 1u + (unsigned)i) { /* the turn before that of the axis */
            step(20, 4);
        }
        step(-30, 10);
        TEST_ASSERT_TRUE(out.saturated);
        ASSERT_NEAR(10, fabs(val(i == 0 ? out.force.x : out.force.y)), 10);
        TEST_ASSERT_TRUE(fabs(val(i == 0 ? out.force.y : out.force.x)) > 11);
    }
}

static void test_an_axis_cools_without_power(void)
{
    cfg.force_limit = (struct force_limit_cfg){
        .on = true, .continuous = mk2(10, 10), .inverse = mk2(0.1, 0.1), .rate = {mk(1), mk(1)}};
    run(CONTROLLER_CC, 10);
    in.enabled[0] = in.enabled[1] = false;
    run(CONTROLLER_CC, 1);
    run(CONTROLLER_CC, 3); /* the turn of y */
    const double hot = acc_val(state.force_limit.heat[1]);
    TEST_ASSERT_TRUE(hot > 0.001);
    run(CONTROLLER_CC, 100);
    TEST_ASSERT_DOUBLE_WITHIN(0.01 * hot, hot * exp(-25.0 / ACC_GAIN), acc_val(state.force_limit.heat[1]));
}

static void test_after_a_switch_the_offset_fades_and_the_new_law_remains(void)
{
    cfg.blend = mk(0.75);
    run(CONTROLLER_CASCADE, 100);
    run(CONTROLLER_TRACK, 1);
    const double x = val(state.offset.x);
    TEST_ASSERT_TRUE(fabs(x) > 1);
    run(CONTROLLER_TRACK, 1);
    ASSERT_NEAR(0.75 * x, val(state.offset.x), 100.0);
    run(CONTROLLER_TRACK, 100);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.offset.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.offset.y));
    TEST_ASSERT_FALSE(state.blending);
    const vec2 u = v2_add(out.smc.u_linear, out.smc.u_friction);
    ASSERT_NEAR(val(u.x), val(out.force.x), 600.0);
}

static void test_a_switch_starts_the_new_law_with_fresh_gains_and_integrals(void)
{
    run(CONTROLLER_CCC, 100);
    TEST_ASSERT_TRUE(fabs(val(state.cascade.coupled)) > 0);
    run(CONTROLLER_CCU, 1);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.cascade.coupled));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.compensator.z_n.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.compensator.s.y));
}

static void test_laws_start_anew_when_an_axis_is_enabled_or_disabled_and_not_while_one_is_enabled_alone(void)
{
    for (int axis = 0; axis < 2; axis++) {
        setUp();
        cfg.gains.smc.zeta = cfg.gains.smc.k_max; /* (16) is its constant rate */
        const double grown = val(cfg.gains.smc.k_0) + 4.5 * val(cfg.gains.smc.zeta_rate) / ACC_GAIN * 4 * DT;
        for (int other = 0; other < 3; other++) {
            in.enabled[1 - axis] = other == 1;
            run(CONTROLLER_CC, 3);
            TEST_ASSERT_TRUE(acc_val(state.smc.k_hat[0]) < grown);
            run(CONTROLLER_CC, 17);
            TEST_ASSERT_TRUE(acc_val(state.smc.k_hat[0]) > grown); /* five times */
        }
    }
}

static void test_force_is_within_its_limits(void)
{
    cfg.plant.force_max = mk2(50, 40);
    run(CONTROLLER_CC, 100);
    for (int i = 0; i < 50; i++) {
        step(-30, 10);
        TEST_ASSERT_TRUE(fabs(val(out.force.x)) <= 50 && fabs(val(out.force.y)) <= 40);
    }
    TEST_ASSERT_TRUE(out.saturated);
}

static void test_force_within_its_limits_is_not_called_saturated(void)
{
    step(20, 4);
    TEST_ASSERT_TRUE(fabs(val(out.force.x)) > 20);
    TEST_ASSERT_FALSE(out.saturated);
}

static void test_force_that_is_limited_in_either_axis_alone_is_called_saturated(void)
{
    for (int axis = 0; axis < 2; axis++) {
        for (int powered = 0; powered < 2; powered++) {
            setUp();
            cfg.plant.force_max = axis == 0 ? mk2(1, 600) : mk2(600, 1);
            in.enabled[axis] = powered != 0;
            step(20, 4);
            TEST_ASSERT_EQUAL(powered, out.saturated); /* what a disabled axis would need is of no interest */
            const double force[2] = {val(out.force.x), val(out.force.y)};
            ASSERT_NEAR(powered, fabs(force[axis]), 1.0);
            TEST_ASSERT_TRUE(fabs(force[1 - axis]) > 10);
        }
    }
}

static void test_force_half_a_newton_beyond_its_limit_is_called_saturated_and_half_a_newton_within_is_not(void)
{
    step(20, 4);
    const double force[2] = {fabs(val(out.force.x)), fabs(val(out.force.y))};
    for (int axis = 0; axis < 2; axis++) {
        for (int beyond = 0; beyond < 2; beyond++) {
            setUp();
            const double limit = force[axis] + (beyond != 0 ? -0.5 : 0.5);
            cfg.plant.force_max = axis == 0 ? mk2(limit, 600) : mk2(600, limit);
            step(20, 4);
            TEST_ASSERT_EQUAL(beyond, out.saturated);
            TEST_ASSERT_EQUAL(beyond, state.saturated);
        }
    }
}

static void test_a_disabled_axis_gets_no_force(void)
{
    run(CONTROLLER_CCU, 20);
    in.enabled[0] = false;
    step(20, 4);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.force.x));
    TEST_ASSERT_TRUE(fabs(val(out.force.y)) > 0);
    in.enabled[0] = true;
    in.enabled[1] = false;
    step(20, 4);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.force.y));
    TEST_ASSERT_TRUE(fabs(val(out.force.x)) > 0);
    in.enabled[0] = false;
    step(20, 4);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.force.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.force.y));
    TEST_ASSERT_FALSE(out.saturated);
}

/* The encoder of x stands still while y moves. No force acts
 * on x, so observer and reference model of x must get none. */
static void test_an_axis_that_is_disabled_and_rests_is_seen_at_rest(void)
{
    in.enabled[0] = false;
    servo_reset(&cfg, &state, in.measured);
    const pos_t x = in.measured[0];
    for (int i = 0; i < 20; i++) {
        path_set(&in.path, path_time_of(50 + i / 10.0));
        in.measured[0] = x;
        tick();
        TEST_ASSERT_EQUAL_DOUBLE(0, val(out.velocity.x));
        TEST_ASSERT_EQUAL_DOUBLE(0, val(demand()->model.x));
    }
}

static void test_enabling_starts_without_an_offset_and_from_where_the_axes_are(void)
{
    run(CONTROLLER_CC, 100);
    in.enabled[0] = in.enabled[1] = false;
    run(CONTROLLER_CC, 10);
    in.enabled[0] = in.enabled[1] = true;
    run(CONTROLLER_CCU, 1);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.offset.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.compensator.z_n.x));
    TEST_ASSERT_TRUE(state.compensator.q_bar[0] == state.observer[0].pos);
}

/* The force demand of period k acts from reading k+1 to reading k+2, so the observer predicts with it at k+2. */
static void test_observer_gets_the_force_that_has_just_acted(void)
{
    cfg.plant.coulomb = mk2(0, 0);
    line_ring(&ring, 0, 0, 0, 0, 60);
    at_um(-10, 0, in.measured);
    servo_reset(&cfg, &state, in.measured);
    in.path = path_at(&ring, 50);
    double force[3], acc[3];
    for (int k = 0; k < 3; k++) {
        tick();
        force[k] = val(out.force.x);
        acc[k] = val(state.observer[0].acc);
    }
    TEST_ASSERT_TRUE(force[0] > 1);
    TEST_ASSERT_EQUAL_DOUBLE(0, acc[0]);
    TEST_ASSERT_EQUAL_DOUBLE(0, acc[1]);
    ASSERT_NEAR(force[0] / MASS_X, acc[2], 1000.0);
}

static void test_friction_feedforward_does_not_move_the_observer(void)
{
    cfg.plant.mass = mk2(1000, 1000); /* the law's own force is small against 45 N of friction over this mass */
    line_ring(&ring, 0, 0, 10, 0, 60);
    in.controller = CONTROLLER_CASCADE;
    at_um(500, 0, in.measured);
    servo_reset(&cfg, &state, in.measured);
    cfg.gains.cascade.k_v = mk(0);
    for (int k = 0; k < 3; k++) {
        in.path = path_at(&ring, 50);
        tick();
    }
    /* u = C r' + friction, and the observer gets C r' */
    ASSERT_NEAR(VISCOUS_X * 50 + 45.5, val(out.force.x), 60.0);
    ASSERT_NEAR(VISCOUS_X * 50 / 1000, val(state.observer[0].acc), 1.0);
}

/* The input of the model is the force demand of two periods ago without friction and compensation. */
static void test_reference_model_is_driven_by_the_linear_part_of_the_delayed_force(void)
{
    double linear[3];
    vec2 before;
    for (int k = 0; k < 3; k++) {
        before = state.compensator.q_bar_dot;
        step(20, 4);
        linear[k] = val(out.smc.u_linear.x);
    }
    step(20, 4);
    before = state.compensator.q_bar_dot;
    step(20, 4); /* the fifth step uses the demand of the third */
    const double v0 = val(before.x);
    ASSERT_NEAR(v0 + DT * (linear[2] - VISCOUS_X * v0) / MASS_X, val(state.compensator.q_bar_dot.x), 600.0);
}

static void test_reference_model_as_printed_sees_the_friction_term(void)
{
    cfg.gains.compensator.input_printed = true;
    step(20, 4);
    step(20, 4);
    const double total = val(out.smc.u_linear.x) + val(out.smc.u_friction.x);
    ASSERT_NEAR(total, val(demand()->model.x), 700.0);
    cfg.gains.compensator.input_printed = false;
    step(20, 4);
    ASSERT_NEAR(val(out.smc.u_linear.x), val(demand()->model.x), 700.0);
}

static void test_reference_model_sees_the_switching_offset(void)
{
    run(CONTROLLER_TRACK, 100);
    run(CONTROLLER_CCU, 3);
    TEST_ASSERT_TRUE(fabs(val(state.offset.x)) > 0.1);
    ASSERT_NEAR(val(out.smc.u_linear.x) + val(state.offset.x), val(demand()->model.x), 600.0);
}

static void test_reference_model_sees_that_the_force_is_limited(void)
{
    cfg.plant.force_max = mk2(50, 50);
    for (int i = 0; i < 3; i++) {
        step(-30, 10);
    }
    TEST_ASSERT_TRUE(out.saturated);
    const double limited = val(out.force.x) - val(out.smc.u_friction.x) - val(out.compensator.u.x);
    ASSERT_NEAR(limited, val(demand()->model.x), 600.0);
}

static void test_cc_has_no_compensation_and_ccu_has(void)
{
    run(CONTROLLER_CC, 50);
    vec2 u = v2_add(out.smc.u_linear, out.smc.u_friction);
    ASSERT_NEAR(val(u.x), val(out.force.x), 600.0);
    setUp();
    run(CONTROLLER_CCU, 50);
    u = v2_add(v2_add(out.smc.u_linear, out.smc.u_friction), out.compensator.u);
    ASSERT_NEAR(val(u.x), val(out.force.x), 600.0);
    ASSERT_NEAR(val(u.y), val(out.force.y), 600.0);
    TEST_ASSERT_TRUE(fabs(val(out.compensator.u.x)) > 0.1);
}

/* `out` is used again: what another controller has left there must not be taken for a gain or an error of this one. */
static void test_what_a_law_does_not_compute_is_reported_as_zero(void)
{
    for (int c = 0; c < CONTROLLERS; c++) {
        if (c == CONTROLLER_CCU) {
            continue;
        }
        setUp();
        run(CONTROLLER_CCU, 50);
        TEST_ASSERT_TRUE(val(out.compensator.mu.x) > 0 && val(out.smc.k_hat.x) > 0);
        run((enum controller)c, 1);
        const vec2 compensator[] = {out.compensator.z_n, out.compensator.s, out.compensator.v, out.compensator.mu,
                                    out.compensator.u};
        for (unsigned i = 0; i < sizeof compensator / sizeof compensator[0]; i++) {
            TEST_ASSERT_EQUAL_DOUBLE(0, val(compensator[i].x));
            TEST_ASSERT_EQUAL_DOUBLE(0, val(compensator[i].y));
        }
        const bool cascade = c == CONTROLLER_CASCADE || c == CONTROLLER_CCC;
        TEST_ASSERT_EQUAL(cascade, !(val(out.smc.k_hat.x) > 0));
        TEST_ASSERT_EQUAL(cascade, !(val(out.smc.k_hat.y) > 0));
    }
}

/* Adapt so fast that each period adds 1 % of the compensation. */
static void adapt_quickly(void)
{
    cfg.feedforward.friction_rate = mk(0.5);
    cfg.feedforward.mass_rate = mk(0.5);
}

static bool nothing_adapted(void)
{
    const double friction = acc_val(state.feedforward.friction[0]), mass = acc_val(state.feedforward.mass[0]);
    return !(friction < 0 || 0 < friction || mass < 0 || 0 < mass);
}

static void test_only_ccu_adapts_the_feedforward_and_only_ccu_uses_it(void)
{
    adapt_quickly();
    for (int c = 0; c < CONTROLLERS; c++) {
        setUp();
        adapt_quickly();
        run((enum controller)c, 20);
        TEST_ASSERT_EQUAL(c != CONTROLLER_CCU, nothing_adapted());
        const double x = val(out.force.x);
        setUp();
        state.feedforward.friction[0] = acc_from(mk(10));
        run((enum controller)c, 20);
        const double shift = val(out.force.x) - x;
        TEST_ASSERT_EQUAL(c == CONTROLLER_CCU, shift > 1 || shift < -1);
    }
}

static void test_the_feedforward_is_added_to_the_force_and_is_no_part_of_the_models_input(void)
{
    state.feedforward.friction[0] = acc_from(mk(10));
    state.feedforward.friction[1] = acc_from(mk(-10));
    state.feedforward.mass[0] = acc_from(mk(0.5));
    state.feedforward.mass[1] = acc_from(mk(0.25));
    step(20, 4);
    const vec2 feedforward = feedforward_force(
        &state.feedforward, smc_direction(cfg.gains.smc.friction_speed, out.contour.r_dot), out.contour.r_ddot);
    ASSERT_NEAR(val(out.smc.u_linear.x) + val(out.compensator.u.x), val(demand()->net.x), 1000);
    ASSERT_NEAR(val(out.smc.u_linear.y) + val(out.compensator.u.y), val(demand()->net.y), 1000);
    ASSERT_NEAR(val(out.smc.u_linear.x) + val(out.smc.u_friction.x) + val(out.compensator.u.x) + val(feedforward.x),
                val(out.force.x), 1000);
    ASSERT_NEAR(val(out.smc.u_linear.x), val(demand()->model.x), 1000);
    ASSERT_NEAR(val(out.smc.u_linear.y), val(demand()->model.y), 1000);
}

static void test_a_limited_force_does_not_adapt_the_feedforward(void)
{
    adapt_quickly();
    cfg.plant.force_max = mk2(1, 1);
    step(20, 4); /* the period before this one was not limited */
    const struct feedforward_state before = state.feedforward;
    run(CONTROLLER_CCU, 20);
    TEST_ASSERT_TRUE(out.saturated);
    TEST_ASSERT_EQUAL_DOUBLE(acc_val(before.friction[0]), acc_val(state.feedforward.friction[0]));
    TEST_ASSERT_EQUAL_DOUBLE(acc_val(before.mass[1]), acc_val(state.feedforward.mass[1]));
}

static void test_the_feedforward_persists_over_a_change_of_controller_and_a_loss_of_power(void)
{
    adapt_quickly();
    run(CONTROLLER_CCU, 20);
    const double friction = acc_val(state.feedforward.friction[0]);
    run(CONTROLLER_CASCADE, 5);
    in.enabled[0] = in.enabled[1] = false;
    run(CONTROLLER_CCU, 5);
    TEST_ASSERT_FALSE(nothing_adapted());
    TEST_ASSERT_EQUAL_DOUBLE(friction, acc_val(state.feedforward.friction[0]));
    servo_reset(&cfg, &state, in.measured);
    TEST_ASSERT_TRUE(nothing_adapted());
}

static void test_track_works_on_the_tracking_error_in_the_axis_frame(void)
{
    run(CONTROLLER_TRACK, 1);
    const struct contour_out *c = &out.contour;
    const double a = 1 + 6 * 0.006 / cosh(1e-3 * val(c->e_w.x));
    const double s = a * val(c->e_w.x) + val(c->e_w_dot.x);
    ASSERT_NEAR(s, val(out.smc.s_bar.x), 600.0);
    /* B e is below 1e-5 at 20 um */
    const double acceleration = val(c->r_ddot.x) - a * val(c->e_w_dot.x) - 0.5 * s;
    ASSERT_NEAR(MASS_X * acceleration + VISCOUS_X * val(out.velocity.x), val(out.smc.u_linear.x), 600.0);
}

static void test_cc_works_on_the_error_at_the_foot_point(void)
{
    run(CONTROLLER_CC, 1);
    const struct contour_out *c = &out.contour;
    const double a = 1 + 6 * 0.006 / cosh(1e-3 * val(c->e_n.y));
    ASSERT_NEAR(a * val(c->e_n.y) + val(c->e_n_dot.y), val(out.smc.s_bar.y), 600.0);
    TEST_ASSERT_DOUBLE_WITHIN(2e-3, -4,
                              val(c->e_n.y)); /* outside an anticlockwise circle is to the right of the path */
}

static void test_cascade_is_coupled_in_ccc_alone(void)
{
    run(CONTROLLER_CASCADE, 20);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.cascade.coupled));
    run(CONTROLLER_CCC, 20);
    TEST_ASSERT_TRUE(fabs(val(state.cascade.coupled)) > 0);
}

/* The axes swing at 160 Hz for `count` periods, or until the gains are lowered. Returns the largest step of the
 * force. */
static double shake(int count)
{
    double largest = 0;
    for (int i = 0; i < count && !state.gains_changed; i++) {
        const vec2 before = out.force;
        step(20 + 2 * sin(0.1 * periods), 4);
        largest = fmax(largest, fmax(fabs(val(out.force.x) - val(before.x)), fabs(val(out.force.y) - val(before.y))));
    }
    return largest;
}

static void watch_for_oscillation(bool lower)
{
    cfg.oscillation = (struct oscillation_cfg){.on = true,
                                               .lower = lower,
                                               .gain_step = mk(0.5),
                                               .slow = mk(0.025),
                                               .axis = {{.limit = mk(0.5)}, {.limit = mk(0.5)}},
                                               .mass = mk2(MASS_X / 4, MASS_Y / 4),
                                               .viscous = mk2(VISCOUS_X / 4, VISCOUS_Y / 4),
                                               .half_wave = 250,
                                               .lasts = 600,
                                               .control_hz = 10000};
}

static int32_t oscillations(void)
{
    return state.oscillation[0].count + state.oscillation[1].count;
}

static void test_oscillation_leaves_the_gains_alone_where_it_is_not_to_lower_them(void)
{
    shake(800);
    TEST_ASSERT_EQUAL_INT32(0, oscillations()); /* it is not watched */
    watch_for_oscillation(false);
    shake(1000); /* it begins with a step, which is larger */
    TEST_ASSERT_TRUE(oscillations() > 0);
    TEST_ASSERT_EQUAL_DOUBLE(1, val(state.gain));
    TEST_ASSERT_FALSE(state.gains_lowered || state.gains_changed);
}

static void test_axes_that_follow_their_path_do_not_oscillate(void)
{
    watch_for_oscillation(true);
    run(CONTROLLER_CCU, 2000);
    TEST_ASSERT_EQUAL_INT32(0, oscillations());
}

static void test_oscillation_ends_where_both_axes_lose_their_power(void)
{
    watch_for_oscillation(false);
    state.oscillation[0].half_waves = state.oscillation[1].half_waves = 20;
    in.enabled[0] = in.enabled[1] = false;
    step(0, 0);
    TEST_ASSERT_EQUAL_UINT16(0, state.oscillation[0].half_waves);
    TEST_ASSERT_EQUAL_UINT16(0, state.oscillation[1].half_waves);
}

static void test_oscillation_lowers_the_gains_of_every_law_without_a_step_of_the_force(void)
{
    for (int law = 0; law < CONTROLLERS; law++) {
        setUp();
        in.controller = (enum controller)law;
        shake(300);
        const double usual = shake(300);
        watch_for_oscillation(true);
        shake(1500);
        TEST_ASSERT_TRUE_MESSAGE(state.gains_lowered && state.gains_changed, "not lowered");
        TEST_ASSERT_EQUAL_DOUBLE(0.5, val(state.gain));
        const vec2 before = out.force;
        step(20 + 2 * sin(0.1 * periods), 4);
        TEST_ASSERT_FALSE(state.gains_changed);
        ASSERT_NEAR(val(before.x), val(out.force.x), 600.0);
        ASSERT_NEAR(val(before.y), val(out.force.y), 600.0);
        cfg.oscillation.on = false;
        shake(300); /* what is left of the change fades */
        TEST_ASSERT_TRUE(shake(300) < usual);
    }
}

static void test_lowered_gains_are_those_of_the_configuration_times_the_factor(void)
{
    watch_for_oscillation(true);
    cfg.gains.smc.stiffness = mk(0.25);
    shake(1500);
    const struct servo_gains *g = &state.gains;
    ASSERT_NEAR(0.5 * val(cfg.gains.smc.lambda), val(g->smc.lambda), 1.0);
    ASSERT_NEAR(0.5 * val(cfg.gains.smc.gamma), val(g->smc.gamma), 1.0);
    ASSERT_NEAR(0.25 * val(cfg.gains.smc.stiffness), val(g->smc.stiffness), 1.0);
    ASSERT_NEAR(0.5 * val(cfg.gains.smc.k_0), val(g->smc.k_0), 1.0);
    ASSERT_NEAR(0.5 * val(cfg.gains.smc.k_max), val(g->smc.k_max), 2.0);
    ASSERT_NEAR(0.5 * val(cfg.gains.smc.zeta), val(g->smc.zeta), 1.0);
    ASSERT_NEAR(0.5 * val(cfg.gains.compensator.alpha), val(g->compensator.alpha), 1.0);
    ASSERT_NEAR(0.5 * val(cfg.gains.compensator.mu_0), val(g->compensator.mu_0), 25.0);
    ASSERT_NEAR(0.5 * val(cfg.gains.compensator.mu_max), val(g->compensator.mu_max), 100.0);
    ASSERT_NEAR(0.5 * val(cfg.gains.cascade.k_p), val(g->cascade.k_p), 1.0);
    ASSERT_NEAR(0.5 * val(cfg.gains.cascade.k_v), val(g->cascade.k_v), 2.0);
    ASSERT_NEAR(0.5 * val(cfg.gains.cascade.k_i), val(g->cascade.k_i), 1.0);
    /* and the rest is that of the configuration */
    TEST_ASSERT_EQUAL_DOUBLE(val(cfg.gains.smc.beta), val(g->smc.beta));
    TEST_ASSERT_EQUAL_DOUBLE(val(cfg.gains.compensator.phi), val(g->compensator.phi));
    TEST_ASSERT_EQUAL_DOUBLE(val(cfg.gains.cascade.coupling), val(g->cascade.coupling));
}

static void test_gains_are_lowered_again_down_to_a_least_factor_and_come_back_without_a_step_of_the_force(void)
{
    watch_for_oscillation(true);
    cfg.oscillation.axis[0].limit = cfg.oscillation.axis[1].limit = mk(0.01);
    cfg.oscillation.gain_step = mk(0.1);
    cfg.blend = mk(0.9);
    for (int i = 0; i < 3; i++) {
        shake(1500);
        TEST_ASSERT_TRUE(state.gains_changed);
        ASSERT_NEAR(fmax(0.05, pow(0.1, i + 1)), val(state.gain), 1.0);
        step(20 + 2 * sin(0.1 * periods), 4);
    }
    servo_reset_oscillation(&cfg, &state);
    TEST_ASSERT_EQUAL_INT32(0, oscillations());
    TEST_ASSERT_EQUAL_DOUBLE(1, val(state.gain));
    const vec2 before = out.force;
    step(20 + 2 * sin(0.1 * periods), 4);
    ASSERT_NEAR(val(before.x), val(out.force.x), 600.0);
    ASSERT_NEAR(val(before.y), val(out.force.y), 600.0);
    ASSERT_NEAR(val(cfg.gains.smc.k_0), val(out.smc.k_hat.x), 1.0);
    servo_reset_oscillation(&cfg, &state); /* nothing to do */
    TEST_ASSERT_FALSE(state.gains_changed);
}

static void test_velocity_is_that_of_the_encoders(void)
{
    run(CONTROLLER_CC, 400);
    const double phi = (50 + 39.9) * 0.005 - 20.0 / 20000;
    /* curvature makes a third-order observer lag by v^3/(R^2 w^2): 500 (0.025/6.5)^2, and 20 um of noise-free start */
    TEST_ASSERT_DOUBLE_WITHIN(0.1, -500 * sin(phi), val(out.velocity.x));
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 500 * cos(phi), val(out.velocity.y));
}

static void test_gains_are_adapted_for_one_axis_in_a_period_for_the_time_of_all_slots(void)
{
    cfg.gains.smc.zeta = cfg.gains.smc.k_max; /* (16) is its constant rate */
    cfg.gains.compensator.law_printed = true;
    servo_reset(&cfg, &state, in.measured);
    double k[2] = {val(cfg.gains.smc.k_0), val(cfg.gains.smc.k_0)}, mu[2] = {0, 0};
    for (int i = 1; i <= 8; i++) {
        step(20, 4);
        for (int axis = 0; axis < 2; axis++) {
            const bool slot = i % 4 == axis;
            const double s = axis == 0 ? val(out.compensator.s.x) : val(out.compensator.s.y);
            k[axis] += slot ? val(cfg.gains.smc.zeta_rate) / ACC_GAIN * 4 * DT : 0;
            mu[axis] += slot ? val(cfg.gains.compensator.rho) / ACC_GAIN * fabs(s) * 4 * DT : 0;
            TEST_ASSERT_DOUBLE_WITHIN(1e-6, k[axis], acc_val(state.smc.k_hat[axis]));
            TEST_ASSERT_DOUBLE_WITHIN(1e-6, mu[axis], acc_val(state.compensator.mu[axis]));
        }
    }
    TEST_ASSERT_TRUE(k[0] > val(cfg.gains.smc.k_0) && k[1] > val(cfg.gains.smc.k_0) && mu[0] > 0 && mu[1] > 0);
}

static void test_energy_is_counted_for_both_axes(void)
{
    run(CONTROLLER_CC, 400);
    TEST_ASSERT_TRUE(state.energy[0].mJ > 10);
    TEST_ASSERT_TRUE(state.energy[1].mJ > 10);
    energy_reset(&state.energy[1]);
    state.observer[1].vel = state.observer[1].disturbance = mk(0);
    for (int i = 0; i < 50; i++) { /* y is at rest from now on, without a force */
        const pos_t y = in.measured[1];
        state.demand[0].net.y = state.demand[1].net.y = mk(0);
        place(20, 4);
        in.measured[1] = y;
        state.observer[1].pos = y;
        tick();
        periods++;
    }
    TEST_ASSERT_EQUAL_DOUBLE(0, state.energy[1].mJ + val(state.energy[1].fraction_mJ));
}

static void test_energy_of_each_axis_is_that_of_its_own_plant_motor_and_movement(void)
{
    struct energy_state expected[2] = {{.mJ = 0}};
    cfg.energy[1].impedance = mk(5);
    cfg.plant.coulomb = mk2(45.5, 90);
    cfg.plant.viscous = mk2(VISCOUS_X, 2 * VISCOUS_X);
    cfg.plant.mass = mk2(MASS_X, 2 * MASS_X);
    for (int i = 0; i < 200; i++) {
        step(20, 4);
        const unsigned slot = state.slot;
        if (slot < 2) {
            const struct plant_cfg *p = &cfg.plant;
            energy_step(&cfg.energy[slot], &expected[slot], slot == 0 ? p->mass.x : p->mass.y,
                        slot == 0 ? p->viscous.x : p->viscous.y, slot == 0 ? p->coulomb.x : p->coulomb.y,
                        state.observer[slot].vel, state.observer[slot].acc);
        }
    }
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_INT32(expected[i].mJ, state.energy[i].mJ);
        TEST_ASSERT_EQUAL_DOUBLE(val(expected[i].fraction_mJ), val(state.energy[i].fraction_mJ));
    }
    TEST_ASSERT_TRUE(expected[0].mJ > 0 && expected[1].mJ > 2 * expected[0].mJ);
}

/* ---- friction at reversal, cogging and ripple ---- */

static void friction_on(double presliding)
{
    const struct friction_axis_cfg axis = friction_design(mk(presliding), mk(1.5), mk(400));
    cfg.friction = (struct friction_cfg){.on = true, .axis = {axis, axis}};
}

static void cogging_on(int axis)
{
    cfg.screw.on = true;
    cfg.screw.axis[axis].turns = screw_turns(5000000);
    cfg.screw.axis[axis].harmonic[0] =
        (struct screw_harmonic){.order = 1, .cogging_cos = mk(5), .ripple_cos = mk(0.0625)};
}

static void test_without_friction_at_reversal_the_shape_is_the_sign_of_the_reference(void)
{
    run(CONTROLLER_CASCADE, 20);
    const vec2 sign = smc_direction(cfg.gains.smc.friction_speed, out.contour.r_dot);
    TEST_ASSERT_EQUAL_DOUBLE(val(sign.x), val(state.friction.shape.x));
    TEST_ASSERT_EQUAL_DOUBLE(val(sign.y), val(state.friction.shape.y));
    TEST_ASSERT_TRUE(val(sign.y) > 0);
}

static void test_every_controller_feeds_friction_at_reversal_forward(void)
{
    for (int c = 0; c < CONTROLLERS; c++) {
        setUp();
        friction_on(1000);
        run((enum controller)c, 20);
        const double x = val(state.friction.shape.x), y = val(state.friction.shape.y);
        run((enum controller)c, 1);
        TEST_ASSERT_TRUE(x < -0.01 && x > -0.9 && y > 0.05 && y < 0.9);
        ASSERT_NEAR(val(demand()->net.x) + 45.5 * x, val(out.force.x), 600.0);
        ASSERT_NEAR(val(demand()->net.y) + 54.8 * y, val(out.force.y), 600.0);
    }
}

static void test_friction_of_an_axis_begins_anew_where_it_gets_power(void)
{
    friction_on(60);
    run(CONTROLLER_CASCADE, 50);
    TEST_ASSERT_TRUE(val(state.friction.shape.x) < -1 && val(state.friction.shape.y) > 1);
    in.enabled[0] = false;
    run(CONTROLLER_CASCADE, 5);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.friction.shape.x));
    TEST_ASSERT_TRUE(val(state.friction.shape.y) > 1);
    in.enabled[0] = true;
    run(CONTROLLER_CASCADE, 4);
    TEST_ASSERT_TRUE(val(state.friction.shape.x) < 0 && val(state.friction.shape.x) > -1);
    TEST_ASSERT_TRUE(val(state.friction.shape.y) > 1);
    in.enabled[0] = in.enabled[1] = false;
    run(CONTROLLER_CASCADE, 4);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.friction.shape.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.friction.shape.y));
}

static void test_friction_is_that_of_when_the_force_acts(void)
{
    friction_on(0);
    run(CONTROLLER_CASCADE, 8); /* the turn of x */
    const struct contour_out *c = &out.contour;
    const double x = fabs(val(c->r_dot.x) + 5.5 * DT * val(c->r_ddot.x));
    run(CONTROLLER_CASCADE, 1); /* the turn of y */
    const double y = val(c->r_dot.y) + 5.5 * DT * val(c->r_ddot.y);
    run(CONTROLLER_CASCADE, 2); /* the last force before the turn of x */
    TEST_ASSERT_DOUBLE_WITHIN(5e-5, -1 - 0.5 * exp(-x / 400), val(state.friction.shape.x));
    run(CONTROLLER_CASCADE, 1);
    TEST_ASSERT_DOUBLE_WITHIN(5e-5, 1 + 0.5 * exp(-y / 400), val(state.friction.shape.y));
}

static void test_friction_persists_over_a_change_of_controller(void)
{
    friction_on(20);
    run(CONTROLLER_CASCADE, 50);
    run(CONTROLLER_CCU, 1);
    TEST_ASSERT_TRUE(val(state.friction.shape.x) < -1 && val(state.friction.shape.y) > 1);
}

static void test_friction_adapts_along_the_shape_and_not_while_the_reference_rests(void)
{
    friction_on(20);
    cfg.feedforward.friction_rate = mk(0.5);
    servo_reset(&cfg, &state, in.measured);
    in.path.rate = mk(0);
    for (int k = 0; k < FRICTION_ELEMENTS; k++) { /* y has slipped, and its reference stands where it is */
        state.friction.axis[1].stretch[k] = cfg.friction.axis[1].element[k].width;
    }
    state.friction.shape.y = mk(1.5);
    tick();
    for (int k = 0; k < 20; k++) {
        in.path.rate = mk(k < 9 ? 0 : 0.01);
        tick();
        TEST_ASSERT_TRUE(val(state.friction.shape.y) > 1);
        TEST_ASSERT_TRUE(k < 6 || fabs(val(out.compensator.u.y)) > 0.01);
        TEST_ASSERT_EQUAL(k >= 9, fabs(acc_val(state.feedforward.friction[1])) > 0); /* in every fourth period */
    }
}

/* The forces of two periods act 3 periods after the reading of the period before them. Their ripple is taken at the
 * force of that period. */
static void test_cogging_and_ripple_are_cancelled_and_move_neither_observer_nor_model(void)
{
    for (int c = 0; c < CONTROLLERS; c++) {
        setUp();
        run((enum controller)c, 19); /* the turn of y */
        const double before = val(out.force.y);
        const double ahead = (double)in.measured[1] / POS_PER_NM + 3e3 * DT * val(out.velocity.y);
        run((enum controller)c, 2);
        const vec2 net = demand()->net, model = demand()->model, force = out.force;
        setUp();
        cogging_on(1);
        run((enum controller)c, 21);
        TEST_ASSERT_EQUAL_DOUBLE(val(net.y), val(demand()->net.y));
        TEST_ASSERT_EQUAL_DOUBLE(val(model.y), val(demand()->model.y));
        const double angle = 2 * 3.14159265358979323846 * ahead / 5e6;
        const double u = (before - 5 * cos(angle)) / (1 + 0.0625 * cos(angle));
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, u - before, val(out.force.y) - val(force.y));
        TEST_ASSERT_EQUAL_DOUBLE(val(force.x), val(out.force.x));
        TEST_ASSERT_TRUE(fabs(u - before) > 1);
    }
}

static void test_an_axis_that_gets_power_starts_with_what_cancels_its_cogging(void)
{
    cogging_on(1);
    run(CONTROLLER_CASCADE, 1);
    TEST_ASSERT_TRUE(fabs(val(state.screw.y)) > 1);
    in.enabled[1] = false;
    run(CONTROLLER_CASCADE, 10);
    const double angle = 2 * 3.14159265358979323846 * (double)in.measured[1] / POS_PER_NM / 5e6;
    TEST_ASSERT_DOUBLE_WITHIN(0.01, -5 * cos(angle) / (1 + 0.0625 * cos(angle)), val(state.screw.y));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.force.y));
}

static void test_a_switch_of_controllers_keeps_the_force_with_friction_cogging_and_ripple_on(void)
{
    friction_on(20);
    cogging_on(1);
    run(CONTROLLER_CASCADE, 200);
    const vec2 before = out.force;
    run(CONTROLLER_CC, 1);
    ASSERT_NEAR(val(before.x), val(out.force.x), 600.0);
    ASSERT_NEAR(val(before.y), val(out.force.y), 600.0);
    TEST_ASSERT_TRUE(fabs(val(state.offset.y)) > 1);
}

/* ---- geometry ---- */

/* A map that adds 100 um to x, and a spring behind which y has 50 kg. */
static void with_geometry(void)
{
    cfg.geometry = (struct geometry_cfg){.on = true, .dt = cfg.dt};
    cfg.geometry.axis[0].lead[0] = NUM(100);
    cfg.geometry.axis[1].compliance = NUM(0.25);
    cfg.geometry.axis[1].mass = NUM(2);
}

static void test_first_period_takes_the_axes_at_rest_where_the_tool_is(void)
{
    with_geometry();
    in.enabled[0] = in.enabled[1] = false;
    servo_reset(&cfg, &state, in.measured);
    tick();
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.velocity.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(out.velocity.y));
    ASSERT_NEAR(100, val(pos_sub(state.observer[0].pos, in.measured[0])), 100.0);
    ASSERT_NEAR(0, val(pos_sub(state.observer[1].pos, in.measured[1])), 1.0);
    in.measured[0] = pos_add(in.measured[0], NUM(1));
    tick();
    TEST_ASSERT_TRUE(val(out.velocity.x) > 0); /* the second one does not */
}

static void test_error_of_the_path_is_that_of_the_tool(void)
{
    step(20, 4);
    const double without = val(out.contour.e_w.x);
    const pos_t encoder = state.observer[0].pos;
    setUp();
    with_geometry();
    step(20, 4); /* the first one resets the observers */
    ASSERT_NEAR(100, val(pos_sub(state.observer[0].pos, in.measured[0])), 100.0);
    ASSERT_NEAR(val(pos_sub(state.observer[0].pos, encoder)), val(out.contour.e_w.x) - without, 200.0);
}

static void test_deflection_is_that_of_the_reference_of_the_axes_with_power(void)
{
    with_geometry();
    cfg.geometry.axis[0].lead[0] = NUM(0);
    state.geometry.started = true;  /* the observers go on */
    for (int k = 0; k < 100; k++) { /* the deflection changes by 0.1 um in a period */
        step(20, 4);
    }
    TEST_ASSERT_TRUE(fabs(val(out.contour.r_ddot.y)) > 1);
    TEST_ASSERT_DOUBLE_WITHIN(0.02, -0.25 * 2 * val(out.contour.r_ddot.y),
                              val(state.geometry.force.y)); /* two periods old */
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.geometry.force.x));
    in.enabled[1] = false;
    for (int k = 0; k < 100; k++) {
        step(20, 4);
    }
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.geometry.force.y));
}

static void test_slow_position_is_that_of_the_second_encoder_and_fast_that_of_the_first(void)
{
    in.enabled[0] = in.enabled[1] = false;
    cfg.geometry = (struct geometry_cfg){.on = true, .dt = cfg.dt};
    cfg.dual_feedback[1] = (struct dual_feedback_cfg){.on = true, .gain = NUM(0.01), .tolerance = NUM(50)};
    at_um(0, 0, in.measured);
    at_um(0, 0, table.second);
    servo_reset(&cfg, &state, in.measured);
    tick();
    at_um(0, 20, in.measured); /* the motor steps, the table does not */
    tick();
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, -20 * 0.01, val(state.placed.y));
    for (int k = 0; k < 69; k++) {
        tick();
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.01, -20 * (1 - pow(0.99, 70)), val(state.placed.y));
    for (int k = 0; k < 2000; k++) {
        tick();
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0, val(pos_sub(state.observer[1].pos, table.second[1])));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.placed.x)); /* x has none */
}

static void test_encoders_further_apart_than_their_tolerance_disagree(void)
{
    in.enabled[0] = in.enabled[1] = false;
    cfg.geometry = (struct geometry_cfg){.on = true, .dt = cfg.dt};
    for (int i = 0; i < 2; i++) {
        cfg.dual_feedback[i] = (struct dual_feedback_cfg){.on = true, .gain = NUM(0.01), .tolerance = NUM(50)};
    }
    for (int k = 0; k < 8; k++) {
        const double off = (k % 2 ? 50.1 : 49.9) * (k / 2 % 2 ? 1 : -1);
        at_um(7, 9, in.measured);
        at_um(7 + (k < 4 ? off : 0), 9 + (k < 4 ? 0 : off), table.second);
        tick();
        TEST_ASSERT_EQUAL(k % 2, state.disagree);
    }
}

static void test_known_deflection_passes_no_crossover(void)
{
    with_geometry();
    cfg.dual_feedback[1] = (struct dual_feedback_cfg){.on = true, .gain = NUM(0.01), .tolerance = NUM(50)};
    in.enabled[0] = in.enabled[1] = false;
    at_um(0, 0, in.measured);
    at_um(0, -10, table.second);
    for (int k = 0; k < 1100; k++) {
        geometry_push(&cfg.geometry, &state.geometry, 1, NUM(0), NUM(20), NUM(0)); /* 40 N: 10 um */
        tick();
        TEST_ASSERT_TRUE(k != 100 || fabs(val(state.placed.y) + 10) < 3);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.01, -10, val(state.placed.y));
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0, val(state.dual_feedback[1].offset));
}

static void turning_in(int32_t lead_nm, double error_um)
{
    cfg.geometry = (struct geometry_cfg){.on = true, .dt = cfg.dt};
    for (int i = 0; i < 2; i++) {
        cfg.geometry.axis[i].turns = screw_turns((uint32_t)lead_nm);
        cfg.geometry.axis[i].error_cos = mk(error_um);
    }
    in.enabled[0] = in.enabled[1] = false;
    at_um(0, 0, in.measured);
}

/* So the home point is by the encoder, and the angle at it always the same. */
static void test_error_once_a_turn_belongs_to_what_goes_by_the_users_position(void)
{
    turning_in(5000000, 4);
    servo_reset(&cfg, &state, in.measured);
    tick();
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 4, val(state.correction.x));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 4, val(state.correction.y));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.placed.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(state.placed.y));
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 4, val(pos_sub(state.observer[0].pos, in.measured[0])));
}

static void test_error_once_a_turn_passes_no_crossover(void)
{
    turning_in(5000000, 4);
    cfg.dual_feedback[1] = (struct dual_feedback_cfg){.on = true, .gain = NUM(0.01), .tolerance = NUM(50)};
    at_um(0, 4, table.second);
    servo_reset(&cfg, &state, in.measured);
    for (int k = 0; k < 100; k++) {
        tick();
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, 4, val(state.placed.y));
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, val(state.dual_feedback[1].offset));
        TEST_ASSERT_EQUAL_DOUBLE(0, val(state.correction.y));
    }
}

static void test_copies_of_the_configuration_are_made_anew(void)
{
    state.extras = true;
    state.force_limit.limit = v2(mk(3000), mk(0));
    for (unsigned k = 0; k < SERVO_SLOTS; k++) {
        servo_step(&cfg, &state, &in, &out);
    }
    TEST_ASSERT_FALSE(state.extras);
    TEST_ASSERT_EQUAL_DOUBLE(val(cfg.plant.force_max.x), val(state.force_limit.limit.x));
    TEST_ASSERT_EQUAL_DOUBLE(val(cfg.plant.force_max.y), val(state.force_limit.limit.y));
}

static void test_gains_are_those_of_the_configuration_unless_they_are_lowered(void)
{
    run(CONTROLLER_CCU, 20);
    const vec2 expected = out.force;
    setUp();
    state.gains = (struct servo_gains){.smc = {.lambda = mk(3)}};
    run(CONTROLLER_CCU, 20);
    TEST_ASSERT_EQUAL_DOUBLE(val(expected.x), val(out.force.x));
    TEST_ASSERT_EQUAL_DOUBLE(val(expected.y), val(out.force.y));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_reset_is_at_rest_where_the_encoders_are);
    RUN_TEST(test_every_switch_of_controllers_keeps_the_force);
    RUN_TEST(test_after_a_switch_the_offset_fades_and_the_new_law_remains);
    RUN_TEST(test_a_switch_starts_the_new_law_with_fresh_gains_and_integrals);
    RUN_TEST(test_laws_start_anew_when_an_axis_is_enabled_or_disabled_and_not_while_one_is_enabled_alone);
    RUN_TEST(test_force_is_within_its_limits);
    RUN_TEST(test_force_within_its_limits_is_not_called_saturated);
    RUN_TEST(test_force_that_is_limited_in_either_axis_alone_is_called_saturated);
    RUN_TEST(test_force_half_a_newton_beyond_its_limit_is_called_saturated_and_half_a_newton_within_is_not);
    RUN_TEST(test_a_disabled_axis_gets_no_force);
    RUN_TEST(test_an_axis_that_is_disabled_and_rests_is_seen_at_rest);
    RUN_TEST(test_enabling_starts_without_an_offset_and_from_where_the_axes_are);
    RUN_TEST(test_observer_gets_the_force_that_has_just_acted);
    RUN_TEST(test_friction_feedforward_does_not_move_the_observer);
    RUN_TEST(test_reference_model_is_driven_by_the_linear_part_of_the_delayed_force);
    RUN_TEST(test_reference_model_as_printed_sees_the_friction_term);
    RUN_TEST(test_reference_model_sees_the_switching_offset);
    RUN_TEST(test_reference_model_sees_that_the_force_is_limited);
    RUN_TEST(test_cc_has_no_compensation_and_ccu_has);
    RUN_TEST(test_what_a_law_does_not_compute_is_reported_as_zero);
    RUN_TEST(test_only_ccu_adapts_the_feedforward_and_only_ccu_uses_it);
    RUN_TEST(test_the_feedforward_is_added_to_the_force_and_is_no_part_of_the_models_input);
    RUN_TEST(test_a_limited_force_does_not_adapt_the_feedforward);
    RUN_TEST(test_the_feedforward_persists_over_a_change_of_controller_and_a_loss_of_power);
    RUN_TEST(test_track_works_on_the_tracking_error_in_the_axis_frame);
    RUN_TEST(test_cc_works_on_the_error_at_the_foot_point);
    RUN_TEST(test_cascade_is_coupled_in_ccc_alone);
    RUN_TEST(test_oscillation_leaves_the_gains_alone_where_it_is_not_to_lower_them);
    RUN_TEST(test_axes_that_follow_their_path_do_not_oscillate);
    RUN_TEST(test_oscillation_ends_where_both_axes_lose_their_power);
    RUN_TEST(test_oscillation_lowers_the_gains_of_every_law_without_a_step_of_the_force);
    RUN_TEST(test_lowered_gains_are_those_of_the_configuration_times_the_factor);
    RUN_TEST(test_gains_are_lowered_again_down_to_a_least_factor_and_come_back_without_a_step_of_the_force);
    RUN_TEST(test_velocity_is_that_of_the_encoders);
    RUN_TEST(test_gains_are_adapted_for_one_axis_in_a_period_for_the_time_of_all_slots);
    RUN_TEST(test_energy_is_counted_for_both_axes);
    RUN_TEST(test_energy_of_each_axis_is_that_of_its_own_plant_motor_and_movement);
    RUN_TEST(test_without_friction_at_reversal_the_shape_is_the_sign_of_the_reference);
    RUN_TEST(test_every_controller_feeds_friction_at_reversal_forward);
    RUN_TEST(test_friction_of_an_axis_begins_anew_where_it_gets_power);
    RUN_TEST(test_friction_is_that_of_when_the_force_acts);
    RUN_TEST(test_friction_persists_over_a_change_of_controller);
    RUN_TEST(test_friction_adapts_along_the_shape_and_not_while_the_reference_rests);
    RUN_TEST(test_cogging_and_ripple_are_cancelled_and_move_neither_observer_nor_model);
    RUN_TEST(test_an_axis_that_gets_power_starts_with_what_cancels_its_cogging);
    RUN_TEST(test_a_switch_of_controllers_keeps_the_force_with_friction_cogging_and_ripple_on);
    RUN_TEST(test_first_period_takes_the_axes_at_rest_where_the_tool_is);
    RUN_TEST(test_error_of_the_path_is_that_of_the_tool);
    RUN_TEST(test_deflection_is_that_of_the_reference_of_the_axes_with_power);
    RUN_TEST(test_force_filters_start_with_the_force_of_the_law);
    RUN_TEST(test_models_get_the_force_that_the_filters_let_through);
    RUN_TEST(test_a_switch_keeps_the_force_that_goes_into_the_filters);
    RUN_TEST(test_heat_lowers_the_limit_of_its_axis);
    RUN_TEST(test_an_axis_cools_without_power);
    RUN_TEST(test_slow_position_is_that_of_the_second_encoder_and_fast_that_of_the_first);
    RUN_TEST(test_encoders_further_apart_than_their_tolerance_disagree);
    RUN_TEST(test_known_deflection_passes_no_crossover);
    RUN_TEST(test_error_once_a_turn_belongs_to_what_goes_by_the_users_position);
    RUN_TEST(test_error_once_a_turn_passes_no_crossover);
    RUN_TEST(test_copies_of_the_configuration_are_made_anew);
    RUN_TEST(test_gains_are_those_of_the_configuration_unless_they_are_lowered);
    return UNITY_END();
}
