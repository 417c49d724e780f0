/* SPDX-License-Identifier: Apache-2.0 */
/* golden.c: the inputs of the golden vectors, golden.h. */
#include "golden.h"

#include <string.h>

#include "core/trig.h"
#include "motion/path_clock.h"
#include "nominal.h"

static golden_put put_word;
static void *put_ctx;
static const char *vector;
static uint32_t random_state;

/* ---- words ---- */

static void word(uint32_t w)
{
    put_word(put_ctx, vector, w);
}

static void put64(int64_t x)
{
    word((uint32_t)((uint64_t)x >> 32));
    word((uint32_t)((uint64_t)x & 0xFFFFFFFFu));
}

static void put(num x)
{
    uint32_t w;
    _Static_assert(sizeof x == sizeof w, "a num is one word");
    memcpy(&w, &x, sizeof w);
    word(w);
}

static void put_acc(acc_t a)
{
    int64_t x;
    _Static_assert(sizeof a == sizeof x, "an accumulator is two words");
    memcpy(&x, &a, sizeof x);
    put64(x);
}

static void put2(vec2 v)
{
    put(v.x);
    put(v.y);
}

/* ---- inputs ---- */

/* A random integer in -limit..limit - 1. */
static int32_t any(int32_t limit)
{
    random_state ^= random_state << 13;
    random_state ^= random_state >> 17;
    random_state ^= random_state << 5;
    return (int32_t)(random_state % (2u * (uint32_t)limit)) - limit;
}

/* A random input within +-limit / 1000, which is a word of the vector, too. */
static num in(int32_t limit)
{
    const num x = n_ratio(any(limit), 1000);
    put(x);
    return x;
}

static vec2 in2(int32_t limit)
{
    const num x = in(limit);
    return v2(x, in(limit));
}

static vec2 in_tangent(void)
{
    const vec2 t = any(2) < 0 ? v2(NUM(0.6), NUM(-0.8)) : v2(NUM(-0.28), NUM(0.96));
    put2(t);
    return t;
}

static pos_t in_pos(int32_t limit_nm)
{
    const pos_t p = pos_from_nm(any(limit_nm)) + any(30000);
    put64(p);
    return p;
}

static void in_pos2(int32_t limit_nm, pos_t q[2])
{
    q[0] = in_pos(limit_nm);
    q[1] = in_pos(limit_nm);
}

/* A circle of 4 mm at 3.9 mm/s in integers. Each step turns by 1/1024 rad. */
static void circle(struct spline_ring *ring, uint32_t count)
{
    int32_t x = 4000000, y = 0;
    ring->start = (struct knot){{x, y}};
    for (uint32_t i = 0; i < count; i++) {
        ring->knot[i] = (struct knot){{x, y}};
        x -= y / 1024;
        y += x / 1024;
    }
    ring->count = count;
}

/* ---- every module ---- */

static struct spline_ring ring;

static void modules(const struct servo_cfg *c)
{
    vector = "trig";
    for (int i = 0; i < 8; i++) {
        const struct trig_cosh h = trig_cosh(in(4100));
        put(h.cosh_x);
        put(h.sinh_x);
    }
    vector = "spline";
    for (int i = 0; i < 8; i++) {
        const path_time_t s = (path_time_t)(any(1 << 30) + (1 << 30)) * 600; /* 0..480 knots */
        struct spline_point p;
        spline_at(&ring, ring.count, s, &p);
        put64(s);
        put64(p.pos[0]);
        put64(p.pos[1]);
        put2(p.d1);
        put2(p.d2);
        put2(p.d3);
    }
    vector = "contour";
    for (int i = 0; i < 16; i++) {
        struct path_state path = {.count = ring.count};
        path_set(&path, (path_time_t)(any(1 << 30) + (1 << 30)) * 600);
        put64(path_s(&path));
        path.rate = n_abs(in(1000));
        path.rate_dot = in(100);
        struct spline_point p;
        spline_at(&ring, ring.count, path_s(&path), &p);
        pos_t q[2];
        in_pos2(20000, q);
        q[0] += p.pos[0];
        q[1] += p.pos[1];
        struct contour_out o;
        contour_step(&c->contour, &(struct spline_cache){0}, &ring, &path, q, v2_add(p.d1, in2(5000)), &o);
        put2(o.e_w);
        put2(o.e_w_dot);
        put2(o.e_l);
        put(o.t_d);
        put64(contour_tau(&o));
        put(o.nu);
        put2(o.t);
        put(o.theta_dot);
        put(o.theta_ddot);
        put2(o.e_wn);
        put2(o.e_n);
        put2(o.e_n_dot);
        put2(o.a_n);
    }
    vector = "smc";
    struct smc_state law;
    smc_reset(&c->gains.smc, &law);
    for (int i = 0; i < 16; i++) {
        struct smc_in a;
        a.t = in_tangent();
        a.e = in2(20000);
        a.e_dot = in2(50000);
        a.a_n = in2(60000);
        a.q_dot = in2(500000);
        a.direction = smc_direction(c->gains.smc.friction_speed, in2(400));
        struct smc_out o;
        smc_step(&c->gains.smc, &c->plant, &law, &a, &o);
        smc_adapt(&c->gains.smc, &law, 0, o.s_bar, c->dt);
        smc_adapt(&c->gains.smc, &law, 1, o.s_bar, c->dt);
        put2(o.s_bar);
        put2(o.u_linear);
        put2(o.u_friction);
        put_acc(law.k_hat[0]);
        put_acc(law.k_hat[1]);
    }
    vector = "compensator";
    struct compensator_state u;
    const pos_t origin[2] = {0, 0};
    compensator_reset(&c->gains.compensator, &u, origin, v2(NUM(0), NUM(0)));
    for (int i = 0; i < 16; i++) {
        pos_t q[2];
        in_pos2(12000, q);
        struct compensator_out o;
        const vec2 t = in_tangent();
        const vec2 q_dot = in2(8000);
        compensator_step(&c->gains.compensator, &c->plant, &u, q, q_dot, t, in(200), &o);
        compensator_adapt(&c->gains.compensator, &u, 0, o.s, c->dt);
        compensator_adapt(&c->gains.compensator, &u, 1, o.s, c->dt);
        compensator_model(&c->plant, &u, in2(100000), c->dt);
        put2(o.z_n);
        put2(o.s);
        put2(o.v);
        put2(o.u);
        put2(u.q_bar_dot);
        for (int k = 0; k < 2; k++) {
            put64(u.q_bar[k]);
            put_acc(u.mu[k]);
        }
    }
    vector = "feedforward";
    struct feedforward_state l;
    feedforward_reset(&l);
    for (int i = 0; i < 8; i++) {
        const vec2 r_dot = in2(400);
        const vec2 r_ddot = in2(60000);
        const vec2 direction = smc_direction(c->gains.smc.friction_speed, r_dot);
        const vec2 added = in2(50000);
        feedforward_step(&c->feedforward, &c->plant, &l, 0, direction, r_ddot, added, c->dt);
        feedforward_step(&c->feedforward, &c->plant, &l, 1, direction, r_ddot, added, c->dt);
        put2(feedforward_force(&l, direction, r_ddot));
    }
    vector = "cascade";
    struct cascade_state pi;
    cascade_reset(&pi);
    for (int i = 0; i < 8; i++) {
        struct contour_out o = {.nu = NUM(1)};
        o.t = in_tangent();
        o.r_dot = in2(500000);
        o.r_ddot = in2(60000);
        o.e_w = in2(20000);
        o.e_w_dot = in2(50000);
        o.e_n = in2(20000);
        o.e_n_dot = in2(50000);
        put2(cascade_step(&c->gains.cascade, &c->plant, &pi, &o, i % 2 == 0, c->dt));
    }
    vector = "observer";
    struct observer_state ob;
    observer_reset(&ob, 0);
    for (int i = 0; i < 16; i++) {
        const pos_t measured = in_pos(50000);
        observer_step(&c->observer, &ob, measured, in(300000), c->plant.mass.x, c->plant.viscous.x);
        put64(ob.pos);
        put(ob.vel);
        put(ob.disturbance);
    }
    vector = "energy";
    struct energy_state e;
    energy_reset(&e);
    for (int i = 0; i < 8; i++) {
        const num v = in(400000);
        put(energy_step(&c->energy[1], &e, c->plant.mass.y, c->plant.viscous.y, c->plant.coulomb.y, v, in(50000)));
        word((uint32_t)e.mJ);
        put(e.fraction_mJ);
    }
    vector = "path";
    struct path_clock path;
    path_clock_reset(&path);
    struct path_clock_in p = {.count = 500, .rate = NUM(1), .stop_time = NUM(20), .step = PATH_ONE / 10};
    for (int i = 0; i < 600; i++) {
        p.rate = i < 100 ? NUM(1) : i < 350 ? NUM(0) : i < 500 ? NUM(1.2) : NUM(0.7);
        path_clock_step(&path, &p);
        if (i % 25 == 0) {
            put64(path_s(&path.at));
            put(path.at.rate);
            put(path.at.rate_dot);
        }
    }
}

/* ---- the servo in closed loop, with a plant in integers ---- */

struct axis {
    int64_t pos, vel; /* 2^-16 nm, 2^-16 nm in a period */
};

/* About the machine of Table 1. A force of 1 mN for one period gives a speed of 7.4 units. Viscous friction takes
 * 53e-5 of the speed in a period, and Coulomb friction is 45.5 N. */
static void move(struct axis *a, int32_t force_mN)
{
    const int64_t friction = 45500 * 74 / 10;
    a->vel += (int64_t)force_mN * 74 / 10 - a->vel * 53 / 100000;
    a->vel = a->vel > friction ? a->vel - friction : a->vel < -friction ? a->vel + friction : 0;
    a->pos += a->vel;
}

/* The hash FNV-1a of data without padding, least significant byte first. */
static void mix(uint32_t *hash, const void *data, uint32_t size)
{
    const uint8_t *bytes = data;
    for (uint32_t i = 0; i < size; i++) {
        *hash = (*hash ^ bytes[i]) * 16777619u;
    }
}

static void closed_loop(const struct servo_cfg *c)
{
    static const pos_t count = 4999741; /* 76.29 nm */
    struct axis axis[2] = {{.pos = pos_from_nm(4000000)}, {.pos = 0}};
    struct servo_in servo = {.enabled = {true, true}, .path = {.count = ring.count}, .ring = &ring};
    struct servo_state state;
    struct servo_out out;
    struct path_clock path;
    uint32_t hash = 2166136261u;
    path_clock_reset(&path);
    for (int i = 0; i < 4000; i++) {
        const struct path_clock_in in = {.count = ring.count,
                                         .rate = i < 2500 || i > 3200 ? NUM(1) : NUM(0),
                                         .stop_time = NUM(50),
                                         .step = PATH_ONE / 10};
        path_clock_step(&path, &in);
        for (int k = 0; k < 2; k++) {
            servo.measured[k] = axis[k].pos / count * count;
        }
        servo.path = path.at;
        servo.controller = (enum controller)(i / 500 % CONTROLLERS);
        if (i == 0) {
            servo_reset(c, &state, servo.measured);
        }
        servo_step(c, &state, &servo, &out);
        for (int k = 0; k < 2; k++) {
            move(&axis[k], n_to_scaled(k == 0 ? out.force.x : out.force.y, 1000));
        }
        mix(&hash, &out.force, sizeof out.force);
        mix(&hash, &out.contour.e_n, sizeof out.contour.e_n);
        for (int k = 0; k < 2; k++) {
            mix(&hash, &state.observer[k].pos, sizeof state.observer[k].pos);
            mix(&hash, &state.observer[k].vel, sizeof state.observer[k].vel);
            mix(&hash, &state.observer[k].disturbance, sizeof state.observer[k].disturbance);
        }
        mix(&hash, state.smc.k_hat, sizeof state.smc.k_hat);
        mix(&hash, &state.compensator, sizeof state.compensator);
        mix(&hash, &state.feedforward, sizeof state.feedforward);
        mix(&hash, &state.cascade, sizeof state.cascade);
        if (i % 100 == 99) {
            put64(servo.measured[0]);
            put64(servo.measured[1]);
            put2(out.force);
            word(hash);
        }
    }
}

void golden_run(golden_put put_words, void *ctx)
{
    put_word = put_words;
    put_ctx = ctx;
    random_state = 2463534242u;
    struct servo_cfg c = nominal();
    c.feedforward.friction_rate = NUM(0.2);
    c.feedforward.mass_rate = NUM(0.1);
    circle(&ring, 500);
    modules(&c);
    vector = "closed loop";
    closed_loop(&c);
}
