/* SPDX-License-Identifier: Apache-2.0 */
/* core_api.h: the control core for Python, with SI doubles in and out and one call for each module. The tests call
 * it through cffi (binding.py) to compare the core with the NumPy model, in a host process.
 *
 * The lines between CDEF-BEGIN and CDEF-END are plain C declarations that cffi reads as they are. */
#ifndef KONTUR_CORE_API_H
#define KONTUR_CORE_API_H
#include <stdint.h>

/* CDEF-BEGIN */
/* The parameters of the NumPy model (class Params), with the same names without units. */
struct api_params {
    double dt, mass[2], viscous[2], coulomb[2], force_max[2], observer;
    double v_min, lag_max;
    double lambda, gamma, beta, stiffness, k_bar, e_max, k_0, k_max, zeta, zeta_rate, xi, epsilon, friction_speed;
    double alpha, mu_0, mu_max, rho, phi, dead_zone;
    double friction_rate, mass_rate, feedforward_acceleration;
    double k_p, k_v, k_i, coupling, integral_max;
    double sections[2][4][4], continuous[2], thermal[2];
    double presliding[2], breakaway[2], stribeck[2], force_delay[2], lead[2];
    double cogging_cos[2][3], cogging_sin[2][3], ripple_cos[2][3], ripple_sin[2][3];
    double force_constant[2], impedance[2], back_emf[2], power_factor, blend;
    int newton, psi_printed, mu_printed, input_printed, in_axes;
};

struct api_point {
    double r[2], d1[2], d2[2], d3[2];
};

struct api_path {
    int64_t s; /* path time, knots times api_path_one() */
    double rate, rate_dot;
};

struct api_contour {
    double r_dot[2], r_ddot[2], e_w[2], e_w_dot[2], e_l[2], t_d, tau, nu, t[2], theta_dot, theta_ddot;
    double e_wn[2], e_n[2], e_n_dot[2], a_n[2];
};

struct api_frame {
    double t[2], theta_dot;
};

struct api_law_in {
    double t[2], e[2], e_dot[2], a_n[2], q_dot[2], r_dot[2];
};

struct api_law_out {
    double s_bar[2], u_linear[2], u_friction[2];
};

struct api_compensation {
    double z_n[2], s[2], v[2], u[2];
};

struct api_geometry_axis {
    uint32_t points, step_nm;
    int32_t start_nm, origin_nm;
    double lead[64], screw, error_cos, error_sin, squareness, compliance, mass, coulomb, viscous, backlash;
    double side_bandwidth, mass_before;
    double r_dot, r_ddot, direction;
    double placed, bridge, turn, turn_bridge, deflection, target, side, side_rate; /* the state, which is changed */
    int32_t last_origin_nm;
    double by_position, by_angle, by_force, gap_force; /* the result */
};

/* One drive: knots, parameters and states. Positions are int64 in 2^-16 nm, as in the core. */
typedef struct api_drive api_drive;

int64_t api_path_one(void);
/* NULL where the force filters cannot be had. */
api_drive *api_new(const struct api_params *p, const int32_t *knots_nm, uint32_t count, const int32_t *start_nm);
void api_free(api_drive *d);

void api_trig_cosh(double x, double out[2]);
double api_trig_decay(double x);
void api_trig_circle(uint32_t phase, double out[2]);
void api_spline(const api_drive *d, int64_t s, struct api_point *out);
void api_contour(const api_drive *d, const struct api_path *path, const int64_t *q, const double *q_dot,
                 struct api_contour *out);
void api_law(const api_drive *d, const struct api_law_in *in, double *k_hat, struct api_law_out *out);
/* q_bar, q_bar_dot and mu are the state; q_bar and mu are changed. */
void api_compensation(const api_drive *d, const struct api_frame *frame, const int64_t *q, const double *q_dot,
                      int64_t *q_bar, const double *q_bar_dot, double *mu, struct api_compensation *out);
void api_model(const api_drive *d, const double *u_bar, int64_t *q_bar, double *q_bar_dot);
/* state is velocity, unexplained acceleration and predicted acceleration of axis i; it and pos are changed. */
void api_observe(const api_drive *d, int i, int64_t measured, double force, int64_t *pos, double *state);
/* `periods` of the watch for oscillation of axis i, with net force, velocity and acceleration of the reference (n,). Returns
 * how many were seen; at, frequency and amplitude of each, at most `room`. */
int api_oscillations(const api_drive *d, int i, double limit, double count, double force_max, double share,
                     int half_wave, int lasts, int periods, const double *net, const double *r_dot,
                     const double *r_ddot, int room, int *at, double *frequency, double *amplitude);
/* Both axes, a period after the first one. */
void api_geometry(const api_drive *d, struct api_geometry_axis axis[2], const int64_t *encoder);
/* First and second encoder; returns the new offset. */
double api_dual_feedback(const api_drive *d, double crossover, double tolerance, double offset, const int64_t *encoder,
                         int *agree);
/* The errors are those of api_contour(). integral is x, y and coupled; it is changed. */
void api_cascade(const api_drive *d, const struct api_contour *c, int coupled, double *integral, double *force);
/* state are s1, s2 of each section of axis i, N; it is changed. Returns the filtered force. */
double api_force_filter(const api_drive *d, int i, double (*state)[2], double force);
/* heat is changed. */
void api_force_limit(const api_drive *d, double *heat, const double *force, double *limit);
/* One period of friction with power on both axes; its state is the drive's. */
void api_friction(api_drive *d, const double *r_dot, double *shape);
void api_screw(const api_drive *d, const int64_t *at, const double *demand, double *u);
double api_power(const api_drive *d, int i, double velocity, double acceleration);

void api_servo_reset(api_drive *d, const int64_t *measured);
/* velocity is that of the observer; energy_J is the energy of both axes so far. */
void api_servo_step(api_drive *d, const struct api_path *path, const int64_t *measured, int controller, int enabled,
                    double *force, double *velocity, double *e_n, double *energy_J);
/* CDEF-END */
#endif
