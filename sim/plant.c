/* SPDX-License-Identifier: Apache-2.0 */
/* plant.c: the simulated machine, plant.h. */
#include "sim/plant.h"

#include <math.h>
#include <string.h>

#include "hal/hal.h"

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
            {fmax(fabs(m->travel_min_m[i]), fabs(m->travel_max_m[i])) / m->encoder_m[i] < 2147483647.0, "encoder_m"},
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

void plant_init(struct plant *p, const struct ks_machine *m, uint64_t seed, double period_s)
{
    memset(p, 0, sizeof *p);
    p->machine = *m;
    p->period_s = period_s;
    seed_rng(p->rng, seed);
    for (int i = 0; i < 2; i++) {
        p->pos_m[i] = m->start_m[i];
    }
}

void plant_encoders(const struct plant *p, int32_t count[2])
{
    for (int i = 0; i < 2; i++) {
        count[i] = (int32_t)lround(p->pos_m[i] / p->machine.encoder_m[i]);
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

/* Count the index pulse between two positions, if there is one. Of several, the last one counts. */
static void pass_index(struct plant *p, int i, double before_m)
{
    const double pitch = p->machine.index_m[i];
    if (pitch <= 0.0) {
        return;
    }
    const double from = floor(before_m / pitch);
    const double to = floor(p->pos_m[i] / pitch);
    if (from != to) {
        const double at = to > from ? to * pitch : (to + 1.0) * pitch;
        p->index_pulses[i]++;
        p->index_count[i] = (int32_t)lround(at / p->machine.encoder_m[i]);
    }
}

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

static void axis_step(struct plant *p, int i, double force_N, double coulomb_N, double h)
{
    const struct ks_machine *m = &p->machine;
    const double v = p->vel_mps[i];
    const double stribeck = exp(-fabs(v) / m->stribeck_mps[i]);
    const double level = coulomb_N * (1.0 + (m->breakaway[i] - 1.0) * stribeck);
    const double dir = v != 0.0 ? copysign(1.0, v) : copysign(1.0, force_N);

    if (v == 0.0 && fabs(force_N) <= level) {
        p->friction_N[i] = force_N; /* stuck */
        return;
    }
    p->friction_N[i] = dir * level;
    const double a = (force_N - m->viscous_Nspm[i] * v - dir * level) / m->mass_kg[i];
    double v1 = v + a * h;
    if (v1 * dir < 0.0) {
        v1 = 0.0; /* friction stops an axis but does not reverse it */
    }
    p->pos_m[i] += 0.5 * (v + v1) * h;
    p->vel_mps[i] = v1;
    if (p->pos_m[i] <= m->travel_min_m[i] || p->pos_m[i] >= m->travel_max_m[i]) {
        p->pos_m[i] = fmin(fmax(p->pos_m[i], m->travel_min_m[i]), m->travel_max_m[i]);
        p->vel_mps[i] = 0.0;
    }
}

void plant_step(struct plant *p, const double force_N[2])
{
    const struct ks_machine *m = &p->machine;
    const double h = p->period_s / m->substeps;
    const double scale = friction_scale(p);

    memmove(p->demand_N[1], p->demand_N[0], sizeof p->demand_N[0] * PLANT_DELAY_MAX);
    for (int i = 0; i < 2; i++) {
        p->demand_N[0][i] = fmin(fmax(force_N[i], -m->force_limit_N[i]), m->force_limit_N[i]);
    }
    for (int i = 0; i < 2; i++) {
        const double demand = p->demand_N[m->delay_periods][i];
        const double noise = m->force_noise_N[i] * gaussian(p);
        const double gain = m->current_lag_s[i] > 0.0 ? 1.0 - exp(-h / m->current_lag_s[i]) : 1.0;
        const double before_m = p->pos_m[i];
        for (int k = 0; k < m->substeps; k++) {
            p->lagged_N[i] += gain * (demand - p->lagged_N[i]);
            axis_step(p, i, p->lagged_N[i] + noise, m->coulomb_N[i] * scale, h);
        }
        pass_index(p, i, before_m);
    }
    p->period++;
}
