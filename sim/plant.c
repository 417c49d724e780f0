/* SPDX-License-Identifier: Apache-2.0 */
/* plant.c: the simulated machine, plant.h. */
#include "sim/plant.h"

#include <math.h>
#include <string.h>

#include "hal/hal.h"

static const double PI = 3.14159265358979323846;

/* xoshiro256++ (Blackman, Vigna), seeded by splitmix64. */
static uint64_t rotl(uint64_t x, int k)
{
    return (x << k) | (x >> (64 - k));
}

static uint64_t next(uint64_t s[4])
{
    const uint64_t result = rotl(s[0] + s[3], 23) + s[0];
    const uint64_t t = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= t;
    s[3] = rotl(s[3], 45);
    return result;
}

static void seed_rng(uint64_t s[4], uint64_t seed)
{
    for (int i = 0; i < 4; i++) {
        seed += 0x9E3779B97F4A7C15u;
        uint64_t z = seed;
        z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
        z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
        s[i] = z ^ (z >> 31);
    }
}

/* Uniform in [-1, 1). */
static double uniform(uint64_t s[4])
{
    return (double)(next(s) >> 11) * 0x1.0p-52 - 1.0;
}

/* By Marsaglia's polar method, which gives two values at a time. */
static double gaussian(struct plant *p)
{
    if (p->has_next_gaussian) {
        p->has_next_gaussian = 0;
        return p->next_gaussian;
    }
    double a, b, r2;
    do {
        a = uniform(p->rng);
        b = uniform(p->rng);
        r2 = a * a + b * b;
    } while (r2 >= 1.0 || r2 == 0.0);
    const double k = sqrt(-2.0 * log(r2) / r2);
    p->next_gaussian = b * k;
    p->has_next_gaussian = 1;
    return a * k;
}

static int positive(double x)
{
    return isfinite(x) && x > 0.0;
}

static int not_negative(double x)
{
    return isfinite(x) && x >= 0.0;
}

static int within(double x, double least, double greatest)
{
    return x >= least && x <= greatest;
}

static int flag(int32_t x)
{
    return x == 0 || x == 1;
}

/* Whether the counts of an encoder over the whole travel fit into its counter. */
static int fits(const struct ks_machine *m, int i, double count_m)
{
    return fmax(fabs(m->travel_min_m[i]), fabs(m->travel_max_m[i])) / count_m < 2147483647.0;
}

static int elastic(const struct ks_machine *m, int i)
{
    return m->resonance_Hz[i] > 0.0;
}

/* Whether something goes by the angle of the screw. */
static int by_angle(const struct ks_machine *m, int i)
{
    return m->cogging_N[i] > 0.0 || m->ripple[i] > 0.0 || m->encoder_once_m[i] > 0.0 || m->lead_once_m[i] > 0.0;
}

const char *plant_check(const struct ks_machine *m)
{
    for (int i = 0; i < 2; i++) {
        const struct {
            int ok;
            const char *name;
        } rules[] = {
            {positive(m->mass_kg[i]), "mass_kg"},
            {not_negative(m->viscous_Nspm[i]), "viscous_Nspm"},
            {not_negative(m->coulomb_N[i]), "coulomb_N"},
            {isfinite(m->breakaway[i]) && m->breakaway[i] >= 1.0, "breakaway"},
            {positive(m->stribeck_mps[i]), "stribeck_mps"},
            {positive(m->force_limit_N[i]), "force_limit_N"},
            {not_negative(m->force_noise_N[i]), "force_noise_N"},
            {not_negative(m->current_lag_s[i]), "current_lag_s"},
            {positive(m->encoder_m[i]), "encoder_m"},
            {isfinite(m->travel_min_m[i]) && fabs(m->travel_min_m[i]) <= 2.0, "travel_min_m"},
            {m->travel_max_m[i] > m->travel_min_m[i] && m->travel_max_m[i] <= 2.0, "travel_max_m"},
            {not_negative(m->switch_m[i]) && 2.0 * m->switch_m[i] < m->travel_max_m[i] - m->travel_min_m[i],
             "switch_m"},
            {not_negative(m->index_m[i]), "index_m"},
            {m->start_m[i] >= m->travel_min_m[i] && m->start_m[i] <= m->travel_max_m[i], "start_m"},
            {fits(m, i, m->encoder_m[i]), "encoder_m"},
            {within(m->resonance_Hz[i], 0, 2000), "resonance_Hz"},
            {within(m->resonance_damping[i], 0, 1), "resonance_damping"},
            {elastic(m, i) ? m->motor_share[i] > 0 && m->motor_share[i] < 1 : within(m->motor_share[i], 0, 1),
             "motor_share"},
            {flag(m->encoder_at_table[i]), "encoder_at_table"},
            {flag(m->encoder_inverted[i]), "encoder_inverted"},
            {flag(m->force_inverted[i]), "force_inverted"},
            {m->scale_m[i] == 0.0 || (positive(m->scale_m[i]) && fits(m, i, m->scale_m[i])), "scale_m"},
            {not_negative(m->backlash_m[i]), "backlash_m"},
            {not_negative(m->presliding_m[i]), "presliding_m"},
            {within(m->friction_share[i], 0, 1), "friction_share"},
            {within(m->friction_wave[i], 0, 1), "friction_wave"},
            {not_negative(m->screw_m[i]) && (m->screw_m[i] > 0.0 || !by_angle(m, i)), "screw_m"},
            {not_negative(m->cogging_N[i]), "cogging_N"},
            {within(m->ripple[i], 0, 1), "ripple"},
            {not_negative(m->encoder_once_m[i]), "encoder_once_m"},
            {not_negative(m->interpolation_m[i]), "interpolation_m"},
            {not_negative(m->interpolation_period_m[i]) &&
                 (m->interpolation_period_m[i] > 0.0 || m->interpolation_m[i] == 0.0),
             "interpolation_period_m"},
            {within(m->force_bits[i], 0, 32) && floor(m->force_bits[i]) == m->force_bits[i], "force_bits"},
            {not_negative(m->continuous_force_N[i]), "continuous_force_N"},
            {not_negative(m->thermal_s[i]) && (m->thermal_s[i] > 0.0 || m->continuous_force_N[i] == 0.0), "thermal_s"},
            {within(m->lead_error[i], -0.1, 0.1), "lead_error"},
            {not_negative(m->lead_once_m[i]), "lead_once_m"},
            {within(m->squareness_rad[i], -0.1, 0.1), "squareness_rad"},
            {isfinite(m->crosstalk_s2[i]), "crosstalk_s2"},
            {not_negative(m->cutting_force_N[i]), "cutting_force_N"},
            {not_negative(m->cutting_Hz[i]), "cutting_Hz"},
        };
        for (size_t k = 0; k < sizeof rules / sizeof rules[0]; k++) {
            if (!rules[k].ok) {
                return rules[k].name;
            }
        }
    }
    if (m->delay_periods < 1 || m->delay_periods > PLANT_DELAY_MAX) {
        return "delay_periods";
    }
    if (m->substeps < 10 || m->substeps > 1000) {
        return "substeps";
    }
    if (m->schedule_count < 0 || m->schedule_count > 16) {
        return "schedule_count";
    }
    for (int i = 0; i < m->schedule_count; i++) {
        if (!not_negative(m->schedule_time_s[i]) || (i > 0 && m->schedule_time_s[i] <= m->schedule_time_s[i - 1])) {
            return "schedule_time_s";
        }
        if (!not_negative(m->schedule_scale[i])) {
            return "schedule_scale";
        }
    }
    return not_negative(m->schedule_repeat_s) ? NULL : "schedule_repeat_s";
}

/* ---- what is measured ---- */

static double sine(double amplitude, double position_m, double period_m)
{
    return amplitude > 0.0 ? amplitude * sin(2.0 * PI * position_m / period_m) : 0.0;
}

/* Where the table of axis i is, with the errors of its screw. */
static double table_m(const struct plant *p, int i)
{
    const struct ks_machine *m = &p->machine;
    return p->pos_m[i] + m->lead_error[i] * p->pos_m[i] + sine(m->lead_once_m[i], p->pos_m[i], m->screw_m[i]) -
           p->home_m[i];
}

static double motor_m(const struct plant *p, int i)
{
    return elastic(&p->machine, i) || p->machine.backlash_m[i] > 0.0 ? p->motor_pos_m[i] : p->pos_m[i];
}

/* Where the encoder of axis i is. */
static double encoder_m(const struct plant *p, int i)
{
    return p->machine.encoder_at_table[i] ? table_m(p, i) : motor_m(p, i);
}

/* What the encoder of axis i measures, with its own errors. */
static double measured_m(const struct plant *p, int i)
{
    const struct ks_machine *m = &p->machine;
    const double at_m = encoder_m(p, i);
    return at_m + sine(m->encoder_once_m[i], at_m, m->screw_m[i]) +
           sine(m->interpolation_m[i], at_m, m->interpolation_period_m[i]);
}

static int32_t counts(const struct plant *p, int i, double position_m, double count_m)
{
    const int32_t count = (int32_t)lround(position_m / count_m);
    return p->machine.encoder_inverted[i] ? -count : count;
}

void plant_encoders(const struct plant *p, int32_t count[2])
{
    const struct ks_machine *m = &p->machine;
    for (int i = 0; i < 2; i++) {
        count[i] = counts(p, i, measured_m(p, i), m->encoder_m[i]);
    }
}

void plant_init(struct plant *p, const struct ks_machine *m, uint64_t seed, double period_s)
{
    memset(p, 0, sizeof *p);
    p->machine = *m;
    p->period_s = period_s;
    seed_rng(p->rng, seed);
    for (int i = 0; i < 2; i++) {
        p->pos_m[i] = p->motor_pos_m[i] = m->start_m[i];
        if (m->scale_m[i] > 0.0) { /* homed: the scale says what the first encoder says */
            p->home_m[i] = table_m(p, i) - round(measured_m(p, i) / m->encoder_m[i]) * m->encoder_m[i];
        }
    }
}

void plant_scales(const struct plant *p, int32_t count[2])
{
    for (int i = 0; i < 2; i++) {
        const double scale_m = p->machine.scale_m[i];
        count[i] = scale_m > 0.0 ? counts(p, i, table_m(p, i), scale_m) : 0;
    }
}

void plant_tool(const struct plant *p, double pos_m[2])
{
    const struct ks_machine *m = &p->machine;
    for (int i = 0; i < 2; i++) {
        const int other = 1 - i;
        pos_m[i] = table_m(p, i);
        if (m->squareness_rad[other] != 0.0) {
            pos_m[i] += m->squareness_rad[other] * p->pos_m[other];
        }
        if (m->crosstalk_s2[other] != 0.0) {
            pos_m[i] += m->crosstalk_s2[other] * p->accel_mps2[other];
        }
    }
}

void plant_switches(const struct plant *p, uint8_t inputs[2])
{
    const struct ks_machine *m = &p->machine;
    for (int i = 0; i < 2; i++) {
        const int at_min = m->switch_m[i] > 0.0 && p->pos_m[i] <= m->travel_min_m[i] + m->switch_m[i];
        const int at_max = m->switch_m[i] > 0.0 && p->pos_m[i] >= m->travel_max_m[i] - m->switch_m[i];
        inputs[i] = (uint8_t)((at_min ? HAL_LIMIT_MIN : 0) | (at_max ? HAL_LIMIT_MAX : 0));
    }
}

/* Count the index pulse between two positions of the encoder, if there is one. Of several, the last one counts. */
static void pass_index(struct plant *p, int i, double before_m)
{
    const double pitch = p->machine.index_m[i];
    if (pitch <= 0.0) {
        return;
    }
    const double from = floor(before_m / pitch);
    const double to = floor(encoder_m(p, i) / pitch);
    if (from != to) {
        const double at = to > from ? to * pitch : (to + 1.0) * pitch;
        p->index_pulses[i]++;
        p->index_count[i] = counts(p, i, at, p->machine.encoder_m[i]);
    }
}

/* ---- how it moves ---- */

static double friction_scale(const struct plant *p)
{
    const struct ks_machine *m = &p->machine;
    double t = (double)(p->period - p->schedule_start) * p->period_s;
    if (m->schedule_repeat_s > 0.0) {
        t = fmod(t, m->schedule_repeat_s);
    }
    double scale = 1.0;
    for (int i = 0; i < m->schedule_count && t >= m->schedule_time_s[i]; i++) {
        scale = m->schedule_scale[i];
    }
    return scale;
}

/* Three harmonics a turn, whose sum is within -1..1; `phase` tells cogging from ripple. */
static double harmonics(double position_m, double screw_m, double phase)
{
    const double turn = 2.0 * PI * position_m / screw_m;
    return 0.5 * sin(turn + phase) + 0.3 * sin(2.0 * turn + 2.0) + 0.2 * sin(6.0 * turn + 1.0);
}

/* The friction of one mass: `coulomb_N` at present, and what it changes with. */
struct friction {
    double coulomb_N, viscous_Nspm, breakaway, stribeck_mps;
    double presliding_m; /* 0: stiction */
};

/* Share of the friction, -1..1, of the slip elements in the middle of a step of `dx_m`; they are moved by the whole
 * step. Element k slips after k / PLANT_BRISTLES of the presliding distance. */
static double slip(double bristle[PLANT_BRISTLES], double presliding_m, double dx_m)
{
    double sum = 0.0;
    for (int k = 0; k < PLANT_BRISTLES; k++) {
        const double stretch = 2.0 * PLANT_BRISTLES / (presliding_m * (k + 1)) * dx_m;
        sum += fmin(fmax(bristle[k] + 0.5 * stretch, -1.0), 1.0);
        bristle[k] = fmin(fmax(bristle[k] + stretch, -1.0), 1.0);
    }
    return sum / PLANT_BRISTLES;
}

/* Move one mass by a sub-step of `h` seconds under `force_N` and its friction; returns the friction. */
static double move(const struct friction *f, double mass_kg, double force_N, double h, double bristle[PLANT_BRISTLES],
                   double *pos_m, double *vel_mps)
{
    const double v = *vel_mps;
    const double stribeck = exp(-fabs(v) / f->stribeck_mps);
    const double level = f->coulomb_N * (1.0 + (f->breakaway - 1.0) * stribeck);
    double friction_N, v1;
    if (f->presliding_m > 0.0) {
        friction_N = level * slip(bristle, f->presliding_m, v * h);
        v1 = v + (force_N - f->viscous_Nspm * v - friction_N) / mass_kg * h;
    } else {
        const double dir = v != 0.0 ? copysign(1.0, v) : copysign(1.0, force_N);
        if (v == 0.0 && fabs(force_N) <= level) {
            return force_N; /* stuck */
        }
        friction_N = dir * level;
        v1 = v + (force_N - f->viscous_Nspm * v - dir * level) / mass_kg * h;
        if (v1 * dir < 0.0) {
            v1 = 0.0; /* friction stops an axis but does not reverse it */
        }
    }
    *pos_m += 0.5 * (v + v1) * h;
    *vel_mps = v1;
    return friction_N;
}

/* The force with which the motor pushes the table, in the middle of a sub-step. */
static double spring_force(const struct plant *p, int i, double h)
{
    const struct ks_machine *m = &p->machine;
    const double reduced_kg = m->mass_kg[i] * m->motor_share[i] * (1.0 - m->motor_share[i]);
    const double omega = 2.0 * PI * m->resonance_Hz[i];
    const double speed = p->motor_vel_mps[i] - p->vel_mps[i];
    const double apart = p->motor_pos_m[i] - p->pos_m[i] + 0.5 * h * speed;
    const double gap = 0.5 * m->backlash_m[i];
    const double stretch = apart > gap ? apart - gap : apart < -gap ? apart + gap : 0.0;
    if (gap > 0.0 && stretch == 0.0) {
        return 0.0;
    }
    const double force = reduced_kg * (omega * omega * stretch + 2.0 * m->resonance_damping[i] * omega * speed);
    return gap > 0.0 && force * stretch < 0.0 ? 0.0 : force; /* nothing sticks at the end of the gap */
}

/* A share of the friction of an axis. Where there is none, nothing stops a mass that turns round. */
static struct friction part(const struct friction *whole, double share)
{
    struct friction f = *whole;
    f.coulomb_N *= share;
    f.viscous_Nspm *= share;
    f.presliding_m = f.coulomb_N > 0.0 ? f.presliding_m : 1.0;
    return f;
}

/* One sub-step of axis i: the motor's force, the force on the table besides, and the friction of the whole axis. */
static void axis_step(struct plant *p, int i, double force_N, double table_N, const struct friction *whole, double h)
{
    const struct ks_machine *m = &p->machine;
    if (elastic(m, i)) {
        const double spring_N = spring_force(p, i, h);
        const struct friction at_motor = part(whole, 1.0 - m->friction_share[i]);
        const struct friction at_table = part(whole, m->friction_share[i]);
        p->friction_N[i] = move(&at_motor, m->motor_share[i] * m->mass_kg[i], force_N - spring_N, h, p->bristle[i][1],
                                &p->motor_pos_m[i], &p->motor_vel_mps[i]);
        p->friction_N[i] += move(&at_table, (1.0 - m->motor_share[i]) * m->mass_kg[i], spring_N + table_N, h,
                                 p->bristle[i][0], &p->pos_m[i], &p->vel_mps[i]);
    } else if (m->backlash_m[i] > 0.0) { /* a light table behind a gap */
        const double before_m = p->pos_m[i];
        const double gap = 0.5 * m->backlash_m[i];
        p->friction_N[i] = move(whole, m->mass_kg[i], force_N + table_N, h, p->bristle[i][1], &p->motor_pos_m[i],
                                &p->motor_vel_mps[i]);
        if (p->motor_pos_m[i] < m->travel_min_m[i] - gap || p->motor_pos_m[i] > m->travel_max_m[i] + gap) {
            p->motor_pos_m[i] = fmin(fmax(p->motor_pos_m[i], m->travel_min_m[i] - gap), m->travel_max_m[i] + gap);
            p->motor_vel_mps[i] = 0.0;
        }
        p->pos_m[i] = fmin(fmax(p->pos_m[i], p->motor_pos_m[i] - gap), p->motor_pos_m[i] + gap);
        p->vel_mps[i] = (p->pos_m[i] - before_m) / h;
    } else {
        const double sum_N = table_N == 0.0 ? force_N : force_N + table_N; /* -0 stays -0 */
        p->friction_N[i] = move(whole, m->mass_kg[i], sum_N, h, p->bristle[i][0], &p->pos_m[i], &p->vel_mps[i]);
    }
    if (p->pos_m[i] <= m->travel_min_m[i] || p->pos_m[i] >= m->travel_max_m[i]) {
        p->pos_m[i] = fmin(fmax(p->pos_m[i], m->travel_min_m[i]), m->travel_max_m[i]);
        p->vel_mps[i] = 0.0;
    }
}

/* The force demand of axis i that the amplifier takes over in this period. */
static double amplified(struct plant *p, int i, double force_N)
{
    const struct ks_machine *m = &p->machine;
    double limit = m->force_limit_N[i];
    if (m->continuous_force_N[i] > 0.0) {
        const double force = p->lagged_N[i];
        p->heat_N2[i] += (force * force - p->heat_N2[i]) * (1.0 - exp(-p->period_s / m->thermal_s[i]));
        if (p->heat_N2[i] >= m->continuous_force_N[i] * m->continuous_force_N[i]) {
            limit = fmin(limit, m->continuous_force_N[i]);
        }
    }
    double demand = fmin(fmax(force_N, -limit), limit);
    if (m->force_bits[i] > 0.0) {
        const double step = ldexp(m->force_limit_N[i], 1 - (int)m->force_bits[i]);
        demand = round(demand / step) * step;
    }
    return m->force_inverted[i] ? -demand : demand;
}

/* The force of axis i at the motor: what the amplifier gives, with what comes with the angle. */
static double motor_force(const struct plant *p, int i)
{
    const struct ks_machine *m = &p->machine;
    double force = p->lagged_N[i];
    if (m->ripple[i] > 0.0) {
        force *= 1.0 + m->ripple[i] * harmonics(motor_m(p, i), m->screw_m[i], 0.5);
    }
    if (m->cogging_N[i] > 0.0) {
        force += m->cogging_N[i] * harmonics(motor_m(p, i), m->screw_m[i], 0.0);
    }
    return force;
}

static struct friction friction_now(const struct plant *p, int i, double scale)
{
    const struct ks_machine *m = &p->machine;
    double coulomb_N = m->coulomb_N[i] * scale;
    if (m->friction_wave[i] > 0.0) {
        const double travel_m = m->travel_max_m[i] - m->travel_min_m[i];
        coulomb_N *= 1.0 + sine(m->friction_wave[i], p->pos_m[i] - m->travel_min_m[i], travel_m);
    }
    return (struct friction){.coulomb_N = coulomb_N,
                             .viscous_Nspm = m->viscous_Nspm[i],
                             .breakaway = m->breakaway[i],
                             .stribeck_mps = m->stribeck_mps[i],
                             .presliding_m = m->presliding_m[i]};
}

/* The cutting force on the table of axis i at `time_s` since the schedule was started. */
static double cutting_force(const struct plant *p, int i, double time_s)
{
    const struct ks_machine *m = &p->machine;
    if (!p->cutting || m->cutting_force_N[i] == 0.0) {
        return 0.0;
    }
    return m->cutting_force_N[i] * (m->cutting_Hz[i] > 0.0 ? sin(2.0 * PI * m->cutting_Hz[i] * time_s) : 1.0);
}

void plant_step(struct plant *p, const double force_N[2])
{
    const struct ks_machine *m = &p->machine;
    const double scale = friction_scale(p);
    const double time_s = (double)(p->period - p->schedule_start) * p->period_s;

    memmove(p->demand_N[1], p->demand_N[0], sizeof p->demand_N[0] * PLANT_DELAY_MAX);
    for (int i = 0; i < 2; i++) {
        p->demand_N[0][i] = amplified(p, i, force_N[i]);
    }
    for (int i = 0; i < 2; i++) {
        const int fine = elastic(m, i) || m->presliding_m[i] > 0.0;
        const int substeps = fine && m->substeps < PLANT_SUBSTEPS_MIN ? PLANT_SUBSTEPS_MIN : m->substeps;
        const double h = p->period_s / substeps;
        const double demand = p->demand_N[m->delay_periods][i];
        const double noise = m->force_noise_N[i] * gaussian(p);
        const double gain = m->current_lag_s[i] > 0.0 ? 1.0 - exp(-h / m->current_lag_s[i]) : 1.0;
        const double before_m = encoder_m(p, i), before_mps = p->vel_mps[i];
        const double table_N = cutting_force(p, i, time_s);
        const struct friction friction = friction_now(p, i, scale);
        for (int k = 0; k < substeps; k++) {
            p->lagged_N[i] += gain * (demand - p->lagged_N[i]);
            axis_step(p, i, motor_force(p, i) + noise, table_N, &friction, h);
        }
        p->accel_mps2[i] = (p->vel_mps[i] - before_mps) / p->period_s;
        pass_index(p, i, before_m);
    }
    p->period++;
}

void plant_follow(struct plant *p, const double pos_m[2])
{
    for (int i = 0; i < 2; i++) {
        const double before_m = encoder_m(p, i), before_mps = p->vel_mps[i];
        p->vel_mps[i] = p->motor_vel_mps[i] = (pos_m[i] - p->pos_m[i]) / p->period_s;
        p->pos_m[i] = p->motor_pos_m[i] = pos_m[i];
        p->accel_mps2[i] = (p->vel_mps[i] - before_mps) / p->period_s;
        pass_index(p, i, before_m);
    }
    p->period++;
}
