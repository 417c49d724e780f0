/* SPDX-License-Identifier: Apache-2.0 */
/* test_contour.c: the contour error, the foot point and the rates of the frame.
 *
 * Expected values: the path is a circle of radius R about the origin, run anticlockwise at the rate W (rad/T0). The
 * axes are at the polar position (rho, phi_q) with the rates rho', phi_q', while the reference is at phi_r = phi_q + a.
 * The foot point is at phi_q, where t = e_t and n = -e_r. So e_n = (-R sin a, R - rho) and r_n = R e_r + R sin a e_t.
 */
#include "core/contour.h"

#include "nominal.h"
#include "unity.h"

#define R 4000.0
#define STEP 0.025 /* rad a knot: 100 mm/s */
#define W (5 * STEP)
#define KNOT_NOISE 2e-3 /* um; two knots rounded by 0.5 nm each, and the distance of the spline from its circle */

static struct spline_ring ring;
static struct contour_cfg cfg;

void setUp(void)
{
    cfg = nominal().contour;
    cfg.v_min = mk(1.0 / 64); /* against a speed of 500, its effect on t_d and nu is below 1e-9 */
    cfg.lag_max = mk(2);
    circle_ring(&ring, R, STEP, 200);
}
void tearDown(void)
{
}

struct polar {
    double rho, phi, rho_dot, phi_dot;
};

static struct contour_out axes_at(struct polar p, double knots)
{
    struct contour_out o;
    pos_t q[2];
    const struct path_state path = path_at(&ring, knots);
    const double c = cos(p.phi), s = sin(p.phi);
    at_um(p.rho * c, p.rho * s, q);
    contour_step(&cfg, &(struct spline_cache){0}, &ring, &path, q,
                 mk2(p.rho_dot * c - p.rho * p.phi_dot * s, p.rho_dot * s + p.rho * p.phi_dot * c), &o);
    return o;
}

/* The reference is at 80.3 knots. The axes are `lag` rad behind it and `out` um outside, and move with it. */
static struct contour_out behind(double lag, double out)
{
    const struct polar p = {.rho = R + out, .phi = 80.3 * STEP - lag, .phi_dot = W};
    return axes_at(p, 80.3);
}

static double tau_knots(const struct contour_out *o)
{
    return (double)contour_tau(o) / (double)PATH_ONE;
}

static void test_on_the_path_there_is_no_error_and_the_reference_stays(void)
{
    const struct contour_out o = behind(0, 0);
    TEST_ASSERT_DOUBLE_WITHIN(KNOT_NOISE, 0, val(o.e_n.x));
    TEST_ASSERT_DOUBLE_WITHIN(KNOT_NOISE, 0, val(o.e_n.y));
    TEST_ASSERT_DOUBLE_WITHIN(KNOT_NOISE, 0, val(o.e_wn.x));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 80.3, tau_knots(&o));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 1, val(o.nu));
}

static void test_contour_error_is_the_distance_to_the_circle_positive_to_the_left(void)
{
    for (double out = -300; out <= 300; out += 150) {
        const struct contour_out o = behind(0.02, out);
        TEST_ASSERT_DOUBLE_WITHIN(KNOT_NOISE, -out, val(o.e_n.y));
    }
}

static void test_foot_point_of_a_lagging_axis_is_exact_within_2_nm(void)
{
    for (double lag = -0.2; lag <= 0.201; lag += 0.05) {
        const struct contour_out o = behind(lag, 5);
        const double foot = (80.3 - tau_knots(&o)) * STEP * R; /* um along the path */
        TEST_ASSERT_DOUBLE_WITHIN(2e-3, lag * R, foot);
        TEST_ASSERT_DOUBLE_WITHIN(2e-3, -5, val(o.e_n.y));
    }
}

static void test_without_newton_the_foot_point_is_the_papers(void)
{
    cfg.newton = false;
    const struct contour_out o = behind(0.1, 5);
    /* t_d = -e_lt/|r'| and e_lt = -rho sin a. */
    const double t_d = (R + 5) * sin(0.1) / (R * W);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, t_d, val(o.t_d));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 80.3 - 5 * t_d, tau_knots(&o));
}

static void test_error_along_the_path_is_that_to_the_reference(void)
{
    const struct contour_out o = behind(0.1, 5);
    TEST_ASSERT_DOUBLE_WITHIN(2 * KNOT_NOISE, -R * sin(0.1), val(o.e_n.x));
}

static void test_tracking_error_in_the_frame_at_the_reference(void)
{
    const struct contour_out o = behind(0.1, 5);
    /* Knots of 1 nm turn the tangent by 1 nm in 100 um, and the error of 400 um with it. */
    TEST_ASSERT_DOUBLE_WITHIN(KNOT_NOISE + 4e-3, -(R + 5) * sin(0.1), val(o.e_l.x));
    TEST_ASSERT_DOUBLE_WITHIN(KNOT_NOISE + 4e-3, R - (R + 5) * cos(0.1), val(o.e_l.y));
    const double a = 80.3 * STEP - 0.1, b = 80.3 * STEP;
    TEST_ASSERT_DOUBLE_WITHIN(KNOT_NOISE, (R + 5) * cos(a) - R * cos(b), val(o.e_w.x));
    TEST_ASSERT_DOUBLE_WITHIN(KNOT_NOISE, (R + 5) * sin(a) - R * sin(b), val(o.e_w.y));
}

static void test_errors_in_both_frames_are_one_vector(void)
{
    const struct contour_out o = behind(0.07, -20);
    const vec2 e = v2_from_frame(o.t, o.e_n);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, val(e.x), val(o.e_wn.x));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, val(e.y), val(o.e_wn.y));
}

static void test_the_frame_turns_at_speed_over_radius(void)
{
    const struct contour_out o = behind(0, 0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, -sin(80.3 * STEP), val(o.t.x));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, cos(80.3 * STEP), val(o.t.y));
    /* Knots of 1 nm round r'' by 25 um/T0^2 a um, which is 0.025/500. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, W, val(o.theta_dot));
    /* They round r''' by 125 um/T0^3 a um times 4 nm, 0.5/500,
     * and the spline's own steps in r''' are R step^3 125/2. */
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0, val(o.theta_ddot));
}

/* The rates for axes that move outwards and slip along the path. */
static void test_rates_are_those_of_the_geometry(void)
{
    const double a = 0.05, out = 30, slip = -0.01, rise = 8;
    const struct polar p = {.rho = R + out, .phi = 80.3 * STEP - a, .rho_dot = rise, .phi_dot = W + slip};
    const struct contour_out o = axes_at(p, 80.3);
    const double a_dot = -slip;
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, (W + slip) / W, val(o.nu));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, W + slip, val(o.theta_dot));
    /* theta' and t err by 1e-4, which turns 500 um/T0. */
    TEST_ASSERT_DOUBLE_WITHIN(0.05, -R * cos(a) * a_dot, val(o.e_n_dot.x));
    TEST_ASSERT_DOUBLE_WITHIN(0.05, -rise, val(o.e_n_dot.y));

    /* R^T q'' - e_n'' with a'' = rho'' = phi_q'' = 0. The spline's theta'' errs by 0.01, times n . e_w of 35. */
    TEST_ASSERT_DOUBLE_WITHIN(0.5, 2 * rise * p.phi_dot - R * sin(a) * a_dot * a_dot, val(o.a_n.x));
    TEST_ASSERT_DOUBLE_WITHIN(0.5, p.rho * p.phi_dot * p.phi_dot, val(o.a_n.y));
}

static void test_errors_in_the_frame_change_as_their_rates_say(void)
{
    /* Positions 0.05 T0 before and after. The error is of third order in the step, 500 (0.1 W)^2 / 24. */
    const double h = 0.05, slip = 0.02;
    struct contour_out o[3];
    struct polar p = {.rho = R + 30, .phi_dot = W + slip};
    for (int i = 0; i < 3; i++) {
        const double dt = (i - 1) * h;
        p.phi = 80.3 * STEP - 0.05 + (W + slip) * dt;
        o[i] = axes_at(p, 80.3 + 5 * dt);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.06, (val(o[2].e_n.x) - val(o[0].e_n.x)) / (2 * h), val(o[1].e_n_dot.x));
    TEST_ASSERT_DOUBLE_WITHIN(0.06, (val(o[2].e_n.y) - val(o[0].e_n.y)) / (2 * h), val(o[1].e_n_dot.y));
    /* The rates err by 0.05, and R^T q'' = (0, rho phi'^2). */
    TEST_ASSERT_DOUBLE_WITHIN(1, -(val(o[2].e_n_dot.x) - val(o[0].e_n_dot.x)) / (2 * h), val(o[1].a_n.x));
    TEST_ASSERT_DOUBLE_WITHIN(1, p.rho * p.phi_dot * p.phi_dot - (val(o[2].e_n_dot.y) - val(o[0].e_n_dot.y)) / (2 * h),
                              val(o[1].a_n.y));
}

/* A parabola r = (V t, K t^2/2). A cubic spline represents it exactly, with knots K h^2/6 below it. */
#define V 400.0
#define K 800.0

static void parabola_ring(void)
{
    ring.count = 0;
    for (int i = 0; i < 60; i++) {
        const double t = 0.2 * i;
        add_knot(&ring, V * t, 0.5 * K * t * t - K * 0.04 / 6);
    }
}

/* r_n in double, with the foot point at path time tau and the reference at s. */
static void parabola_rn(double tau, double s, double rn[2])
{
    const double speed = hypot(V, K * tau), nx = -K * tau / speed, ny = V / speed;
    const double f = nx * V * (tau - s) + ny * 0.5 * K * (tau * tau - s * s);
    rn[0] = V * s + f * nx;
    rn[1] = 0.5 * K * s * s + f * ny;
}

/* e_n.x of axes that are on the path at tau. */
static double parabola_along(double tau, double s)
{
    const double speed = hypot(V, K * tau);
    return (V * V * (tau - s) + 0.5 * K * K * tau * (tau * tau - s * s)) / speed;
}

/* The axes move on the path, 0.1 T0 behind, at nu times its speed: tau'' is 0, and theta'' is not. */
static void test_rates_on_a_path_of_changing_speed_and_curvature(void)
{
    const double tau = 0.45, lag = 0.1, nu = 0.7, h = 1e-3;
    struct contour_out o;
    pos_t q[2];
    parabola_ring();
    const struct path_state path = path_at(&ring, 5 * (tau + lag));
    at_um(V * tau, 0.5 * K * tau * tau, q);
    contour_step(&cfg, &(struct spline_cache){0}, &ring, &path, q, mk2(nu * V, nu * K * tau), &o);

    /* One Newton step leaves 1e-4 T0 at such a lag. Knots of 1 nm move r'' by 0.05 and r''' by 0.5, of 540 um/T0. */
    const double speed2 = V * V + K * K * tau * tau;
    TEST_ASSERT_DOUBLE_WITHIN(5e-4, 5 * tau, tau_knots(&o));
    TEST_ASSERT_DOUBLE_WITHIN(3e-4, nu, val(o.nu));
    TEST_ASSERT_DOUBLE_WITHIN(3e-4, nu * V * K / speed2, val(o.theta_dot));
    TEST_ASSERT_DOUBLE_WITHIN(2e-3, nu * nu * -2 * V * K * K * K * tau / speed2 / speed2, val(o.theta_ddot));

    const double before = parabola_along(tau - nu * h, tau + lag - h),
                 after = parabola_along(tau + nu * h, tau + lag + h);
    const double e_ddot = (after - 2 * parabola_along(tau, tau + lag) + before) / (h * h), speed = sqrt(speed2);
    TEST_ASSERT_DOUBLE_WITHIN(0.05, (after - before) / (2 * h), val(o.e_n_dot.x));
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 0, val(o.e_n_dot.y));
    /* R^T q'' of q'' = (0, nu^2 K). The error of one Newton step is theta'' times |r_a - r| of 60 um. */
    TEST_ASSERT_DOUBLE_WITHIN(0.15, nu * nu * K * K * tau / speed - e_ddot, val(o.a_n.x));
    TEST_ASSERT_DOUBLE_WITHIN(0.15, nu * nu * K * V / speed, val(o.a_n.y));

    double now[2];
    parabola_rn(tau, tau + lag, now);
    /* theta' turns 60 um in 1e-4 T0. */
    TEST_ASSERT_DOUBLE_WITHIN(8e-3, V * tau - now[0], val(o.e_wn.x));
    TEST_ASSERT_DOUBLE_WITHIN(8e-3, 0.5 * K * tau * tau - now[1], val(o.e_wn.y));
}

/* Far behind on a tight circle, 400 um at 1 rad/T0, the adjustment f = R (cos a - 1) is 32 um and matters in (8). */
static void test_acceleration_for_the_adjusted_reference_far_behind_on_a_tight_circle(void)
{
    const double r = 400, a = 0.4, a_dot = 0.2, w = 1 - a_dot;
    circle_ring(&ring, r, 0.2, 100);
    /* Reference and foot point are halfway between knots, where r''' is along the tangent and theta'' is 0. */
    const struct polar p = {.rho = r, .phi = 40.5 * 0.2 - a, .phi_dot = w};
    const struct contour_out o = axes_at(p, 40.5);
    /* There the second derivative of a cubic spline errs by step^2/24 of itself, 1.7e-3 of 400. */
    TEST_ASSERT_DOUBLE_WITHIN(1.5, -r * sin(a) * a_dot * a_dot, val(o.a_n.x));
    TEST_ASSERT_DOUBLE_WITHIN(1.5, r * w * w, val(o.a_n.y));
}

static void test_the_frames_rates_are_regularised_at_low_speed(void)
{
    cfg.v_min = mk(R * W); /* |r'|^2/(|r'|^2 + v_min^2) = 1/2 of theta' */
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, W / 2, val(behind(0, 0).theta_dot));
}

static void test_a_slower_path_time_scales_the_reference_by_the_chain_rule(void)
{
    struct contour_out o;
    pos_t q[2];
    struct path_state path = path_at(&ring, 40);
    path.rate = mk(0.5);
    path.rate_dot = mk(-0.25);
    at_um(0, R, q);
    contour_step(&cfg, &(struct spline_cache){0}, &ring, &path, q, mk2(-250, 0), &o);
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0.5 * -R * W * sin(1), val(o.r_dot.x));
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 0.5 * R * W * cos(1), val(o.r_dot.y));
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 0.25 * -R * W * W * cos(1) - 0.25 * -R * W * sin(1), val(o.r_ddot.x));
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 0.25 * -R * W * W * sin(1) - 0.25 * R * W * cos(1), val(o.r_ddot.y));
}

static void test_on_a_line_the_contour_error_is_the_distance_to_it_whatever_the_lag(void)
{
    line_ring(&ring, 0, 0, 30, 40, 100); /* t = (0.6, 0.8), 250 um/T0 */
    for (double lag = -200; lag <= 200; lag += 100) {
        struct contour_out o;
        pos_t q[2];
        const struct path_state path = path_at(&ring, 50);
        at_um(1500 - 0.6 * lag - 0.8 * 12, 2000 - 0.8 * lag + 0.6 * 12, q); /* 12 um to the left */
        contour_step(&cfg, &(struct spline_cache){0}, &ring, &path, q, mk2(0.6 * 200 - 0.8 * 7, 0.8 * 200 + 0.6 * 7),
                     &o);
        TEST_ASSERT_DOUBLE_WITHIN(1e-4, 12, val(o.e_n.y));
        TEST_ASSERT_DOUBLE_WITHIN(1e-4, -lag, val(o.e_n.x));
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, lag / 250, val(o.t_d));
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 200.0 / 250, val(o.nu));
        ASSERT_NEAR(200.0 - 250, val(o.e_n_dot.x), 500.0);
        ASSERT_NEAR(7, val(o.e_n_dot.y), 500.0);
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, val(o.theta_dot));
    }
}

static void test_tracking_error_rate_is_actual_less_programmed_velocity(void)
{
    line_ring(&ring, 0, 0, 30, 40, 100);
    struct contour_out o;
    pos_t q[2];
    const struct path_state path = path_at(&ring, 50);
    at_um(1500, 2000, q);
    contour_step(&cfg, &(struct spline_cache){0}, &ring, &path, q, mk2(160, 190), &o);
    ASSERT_NEAR(10, val(o.e_w_dot.x), 160.0);
    ASSERT_NEAR(-10, val(o.e_w_dot.y), 190.0);
}

static void test_the_delay_is_regularised_at_low_speed(void)
{
    line_ring(&ring, 0, 0, 0.1, 0, 100); /* 0.5 um/T0 */
    cfg.v_min = mk(0.5);
    cfg.newton = false;
    struct contour_out o;
    pos_t q[2];
    const struct path_state path = path_at(&ring, 50);
    at_um(5 - 0.25, 0, q);
    contour_step(&cfg, &(struct spline_cache){0}, &ring, &path, q, mk2(0.25, 0), &o);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 + HALF_STEPS(6), 0.25 / 0.5 / 2, val(o.t_d)); /* v^2/(v^2 + v_min^2) = 1/2 of (5) */
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 + HALF_STEPS(6), 0.5 * (0.25 / 0.5) + 0.5,
                              val(o.nu)); /* half of the actual rate and half of the path's */
}

static void test_at_standstill_the_law_is_given_plain_tracking(void)
{
    line_ring(&ring, 100, 200, 0, 0, 50);
    struct contour_out o;
    pos_t q[2];
    const struct path_state path = path_at(&ring, 30);
    at_um(103, 196, q);
    contour_step(&cfg, &(struct spline_cache){0}, &ring, &path, q, mk2(5, -6), &o);
    ASSERT_NEAR(3, val(o.e_n.x), 3.0);
    ASSERT_NEAR(-4, val(o.e_n.y), 4.0);
    ASSERT_NEAR(3, val(o.e_wn.x), 3.0);
    ASSERT_NEAR(-4, val(o.e_wn.y), 4.0);
    ASSERT_NEAR(5, val(o.e_n_dot.x), 5.0);
    ASSERT_NEAR(-6, val(o.e_n_dot.y), 6.0);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(o.t_d));
    TEST_ASSERT_EQUAL_DOUBLE(1, val(o.nu));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(o.theta_dot));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(o.theta_ddot));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(o.a_n.x));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(o.a_n.y));
}

/* The caller uses `out` again: what the period before has left there must not turn a frame that stands. */
static void test_at_standstill_nothing_of_the_period_before_is_left(void)
{
    struct contour_out o = behind(0.02, 100);
    TEST_ASSERT_TRUE(val(o.theta_dot) > 0.1 && val(o.nu) > 0.9);
    circle_ring(&ring, R, 0, 200); /* all knots are one point */
    struct path_state path = path_at(&ring, 80.3);
    path.rate = mk(0);
    pos_t q[2];
    at_um(R, 0, q);
    contour_step(&cfg, &(struct spline_cache){0}, &ring, &path, q, mk2(3, 4), &o);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(o.theta_dot));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(o.theta_ddot));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(o.nu));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 3, val(o.e_n_dot.x));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 4, val(o.e_n_dot.y));
}

static void test_leaving_standstill_the_law_is_given_the_acceleration_of_both_axes(void)
{
    line_ring(&ring, 0, 0, 0, 0, 20);
    add_knot(&ring, 0.12, 0.24); /* at path time 19: r' = (0.3, 0.6), r'' = (3, 6); at 18: rest */
    struct contour_out o;
    pos_t q[2];
    const struct path_state path = path_at(&ring, 18.03);
    at_um(0, 0, q);
    contour_step(&cfg, &(struct spline_cache){0}, &ring, &path, q, mk2(0, 0), &o);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 + HALF_STEPS(10), 0.03 * 0.03 * 0.3, val(o.r_dot.x));
    ASSERT_NEAR(0.03 * 3, val(o.a_n.x), 3.0);
    ASSERT_NEAR(0.03 * 6, val(o.a_n.y), 6.0);
    ASSERT_NEAR(-val(o.r_dot.x), val(o.e_n_dot.x), 1.0);
    ASSERT_NEAR(-val(o.r_dot.y), val(o.e_n_dot.y), 1.0);
}

static void test_the_delay_is_limited(void)
{
    cfg.lag_max = mk(0.4);
    cfg.newton = false;
    const struct contour_out late = behind(0.3, 0), early = behind(-0.3, 0);
    ASSERT_NEAR(0.4, val(late.t_d), 1.0);
    ASSERT_NEAR(-0.4, val(early.t_d), 1.0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 80.3 - 2, tau_knots(&late));
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 80.3 + 2, tau_knots(&early));
}

static void test_newtons_step_is_limited_as_well(void)
{
    cfg.lag_max = mk(0.1);
    const struct contour_out late = behind(0.3, 0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 80.3 - 1, tau_knots(&late));
}

/* It is as far behind as it may be, whatever the axes do. */
static void test_a_limited_foot_point_goes_on_at_the_rate_of_the_path(void)
{
    cfg.lag_max = mk(0.1);
    for (int newton = 0; newton < 2; newton++) {
        cfg.newton = newton == 1;
        for (int i = -1; i <= 1; i += 2) {
            const struct polar p = {.rho = R, .phi = 80.3 * STEP - i * 0.3, .phi_dot = 3 * W};
            const struct contour_out o = axes_at(p, 80.3);
            TEST_ASSERT_EQUAL_DOUBLE(1, val(o.nu));
            TEST_ASSERT_DOUBLE_WITHIN(1e-4, W, val(o.theta_dot));
        }
    }
}

/* At 500 um/T0 a lag of 0.25 T0 is 125 um. The axes are 300 um inside, where v_t = 462.5, nu = 1 and w = W. */
static void test_the_frame_turns_with_a_share_of_a_large_error(void)
{
    cfg.lag_max = mk(0.25);
    const struct polar p = {.rho = R - 300, .phi = 80.3 * STEP, .rho_dot = -8, .phi_dot = W};
    const struct contour_out o = axes_at(p, 80.3);
    TEST_ASSERT_DOUBLE_WITHIN(KNOT_NOISE, 300, val(o.e_n.y));
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 462.5 - 500 + W * 125, val(o.e_n_dot.x));
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 8, val(o.e_n_dot.y));
    TEST_ASSERT_DOUBLE_WITHIN(1.3, -W * 2 * 8, val(o.a_n.x)); /* theta'' errs by 0.01 */
    TEST_ASSERT_DOUBLE_WITHIN(0.5, W * (2 * 462.5 - 500 + W * 125), val(o.a_n.y));
}

/* Knots of 1 nm on a line at 0.1 mm/s turn it by 7 rad/s and 6500 rad/s2, which times 0.5 mm would be 3 m/s2. */
static void test_the_rounding_of_a_slow_path_does_not_shake_axes_that_are_far_off(void)
{
    cfg = nominal().contour;
    ring.count = 0;
    for (int i = 0; i < 60; i++) {
        add_knot(&ring, 0.1 * i, 1e-3 * (i * i / 3 % 2));
    }
    for (double knots = 20; knots < 40; knots += 0.3) {
        struct contour_out o;
        pos_t q[2];
        const struct path_state path = path_at(&ring, knots);
        at_um(0.1 * knots - 500, 500, q);
        contour_step(&cfg, &(struct spline_cache){0}, &ring, &path, q, mk2(0.5, 0), &o);
        TEST_ASSERT_TRUE(fabs(val(o.a_n.x)) < 0.05 / MPS2 && fabs(val(o.a_n.y)) < 0.05 / MPS2);
    }
}

static void test_path_time_of_the_foot_point_is_never_negative(void)
{
    const struct polar p = {.rho = R, .phi = -0.1, .phi_dot = W};
    const struct contour_out o = axes_at(p, 0.2);
    TEST_ASSERT_TRUE(contour_tau(&o) == 0);
}

static void test_at_the_centre_of_the_circle_every_output_is_finite(void)
{
    const struct polar p = {.rho = 0, .phi = 0, .phi_dot = 0, .rho_dot = 500};
    const struct contour_out o = axes_at(p, 80.3);
    TEST_ASSERT_DOUBLE_WITHIN(KNOT_NOISE, R, val(o.e_n.y));
    TEST_ASSERT_TRUE(fabs(val(o.nu)) <= 4);
    TEST_ASSERT_TRUE(fabs(val(o.e_n_dot.y)) < 4096);
    TEST_ASSERT_TRUE(fabs(val(o.a_n.x)) < 4096);
}

/* The slope of the foot-point condition is 0 at the centre, and a quarter of |r'|^2 replaces it. */
static void test_at_the_centre_of_the_circle_the_foot_point_does_not_run_away(void)
{
    const struct polar along = {.rho = 0, .phi = 80.3 * STEP + acos(0), .rho_dot = 50};
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 50 / (0.25 * 500), val(axes_at(along, 80.3).nu));
}

static void test_rate_of_the_foot_point_is_limited(void)
{
    const struct polar fast = {.rho = R, .phi = 80.3 * STEP, .phi_dot = 5 * W};
    const struct polar back = {.rho = R, .phi = 80.3 * STEP, .phi_dot = -5 * W};
    TEST_ASSERT_EQUAL_DOUBLE(4, val(axes_at(fast, 80.3).nu));
    TEST_ASSERT_EQUAL_DOUBLE(-4, val(axes_at(back, 80.3).nu));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_on_the_path_there_is_no_error_and_the_reference_stays);
    RUN_TEST(test_contour_error_is_the_distance_to_the_circle_positive_to_the_left);
    RUN_TEST(test_foot_point_of_a_lagging_axis_is_exact_within_2_nm);
    RUN_TEST(test_without_newton_the_foot_point_is_the_papers);
    RUN_TEST(test_error_along_the_path_is_that_to_the_reference);
    RUN_TEST(test_tracking_error_in_the_frame_at_the_reference);
    RUN_TEST(test_errors_in_both_frames_are_one_vector);
    RUN_TEST(test_the_frame_turns_at_speed_over_radius);
    RUN_TEST(test_rates_are_those_of_the_geometry);
    RUN_TEST(test_errors_in_the_frame_change_as_their_rates_say);
    RUN_TEST(test_rates_on_a_path_of_changing_speed_and_curvature);
    RUN_TEST(test_acceleration_for_the_adjusted_reference_far_behind_on_a_tight_circle);
    RUN_TEST(test_the_frames_rates_are_regularised_at_low_speed);
    RUN_TEST(test_a_slower_path_time_scales_the_reference_by_the_chain_rule);
    RUN_TEST(test_on_a_line_the_contour_error_is_the_distance_to_it_whatever_the_lag);
    RUN_TEST(test_tracking_error_rate_is_actual_less_programmed_velocity);
    RUN_TEST(test_the_delay_is_regularised_at_low_speed);
    RUN_TEST(test_at_standstill_the_law_is_given_plain_tracking);
    RUN_TEST(test_at_standstill_nothing_of_the_period_before_is_left);
    RUN_TEST(test_leaving_standstill_the_law_is_given_the_acceleration_of_both_axes);
    RUN_TEST(test_the_delay_is_limited);
    RUN_TEST(test_newtons_step_is_limited_as_well);
    RUN_TEST(test_a_limited_foot_point_goes_on_at_the_rate_of_the_path);
    RUN_TEST(test_the_frame_turns_with_a_share_of_a_large_error);
    RUN_TEST(test_the_rounding_of_a_slow_path_does_not_shake_axes_that_are_far_off);
    RUN_TEST(test_path_time_of_the_foot_point_is_never_negative);
    RUN_TEST(test_at_the_centre_of_the_circle_every_output_is_finite);
    RUN_TEST(test_at_the_centre_of_the_circle_the_foot_point_does_not_run_away);
    RUN_TEST(test_rate_of_the_foot_point_is_limited);
    return UNITY_END();
}
