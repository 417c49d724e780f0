/* SPDX-License-Identifier: Apache-2.0 */
/* oscillation.c: the watch for oscillation of oscillation.h. Runs in the servo tick. */
#include "core/oscillation.h"

#define QUARTER 0.25
#define LASTING 0.7 /* an amplitude below this share of the largest one ends an oscillation */
#define SMALL 0.5   /* a swing back by less than this share of the peak is part of the half wave */
#define DECAYED 0.9 /* a peak below this share of the one a period before is of something that decays */
#define REGULAR 5   /* half waves that differ by more than one part in so many of a period are not periodic */
#define TICKS_MAX 30000
/* What is told at most */
#define FORCE_MAX 1000     /* N/4 */
#define FREQUENCY_MAX 4000 /* Hz */

static void begin(struct oscillation_state *s, num largest)
{
    s->half_waves = 1;
    s->steady = 0;
    s->ticks = 0;
    s->largest = largest;
}

/* Whether the half wave that has ended is as large and as long as the one a period before. */
static bool repeats(const struct oscillation_state *s)
{
    const int32_t change = (int32_t)s->age - (int32_t)s->lasted[1];
    const int32_t most = ((int32_t)s->age + (int32_t)s->lasted[0]) / REGULAR;
    return s->half_waves > 2 && !n_lt(s->peak, n_mul(NUM(DECAYED), s->before[1])) && change <= most && -change <= most;
}

/* Whether a free mass would swing by a count of the encoder or more under this amplitude. Less, the encoder cannot tell
 * from rest, and the force is only the answer to its counts. */
static bool moves(const struct oscillation_cfg *cfg, const struct oscillation_state *s,
                  const struct oscillation_axis *a, num amplitude)
{
    const num period = n_ratio((int32_t)s->lasted[0] + (int32_t)s->lasted[1], 2 * (int32_t)cfg->half_wave);
    return !n_lt(n_mul(n_mul(amplitude, period), period), a->count) || !n_lt(amplitude, a->force_max);
}

static void count(const struct oscillation_cfg *cfg, struct oscillation_state *s)
{
    const int64_t waves = ((int64_t)s->half_waves - 1) * (int64_t)cfg->control_hz;
    const int64_t most = 2 * (int64_t)FREQUENCY_MAX * s->ticks;
    s->frequency = n_ratio(waves < most ? waves : most, 2 * (int64_t)s->ticks);
    s->force = n_mul(NUM(4), n_min(s->largest, NUM(FORCE_MAX)));
    s->count++;
    s->half_waves = 0;
}

/* |h| exceeds the limit. Returns whether this is an oscillation. */
__attribute__((noinline)) static bool beyond(const struct oscillation_cfg *cfg, struct oscillation_state *s,
                                             const struct oscillation_axis *a, num h)
{
    const bool positive = n_lt(NUM(0), h);
    const num size = n_abs(h);
    if (s->half_waves != 0 && positive == s->positive) {
        s->peak = n_max(s->peak, size);
        return false;
    }
    if (s->half_waves > 1 && n_lt(size, n_mul(NUM(SMALL), s->peak))) {
        return false;
    }
    /* of the half wave that has ended and the one before: a constant part of h is not in it */
    const num amplitude = n_mad(n_mul(NUM(0.5), s->before[0]), NUM(0.5), s->peak);
    if (s->half_waves == 0) {
        begin(s, NUM(0));
    } else if (s->half_waves > 1 && (n_lt(amplitude, n_mul(NUM(LASTING), s->largest)) || s->ticks > TICKS_MAX)) {
        begin(s, amplitude);
    } else {
        s->steady = repeats(s) ? (uint16_t)(s->steady + 1u) : 0u;
        s->ticks = (uint16_t)(s->ticks + s->age);
        s->largest = s->half_waves > 1 ? n_max(s->largest, amplitude) : s->largest;
        s->half_waves++;
    }
    s->before[1] = s->before[0];
    s->before[0] = s->peak;
    s->lasted[1] = s->lasted[0];
    s->lasted[0] = s->age;
    s->positive = positive;
    s->peak = size;
    s->age = 0;
    if (s->steady < OSCILLATION_STEADY || s->ticks < cfg->lasts || !moves(cfg, s, a, amplitude)) {
        return false;
    }
    count(cfg, s);
    return true;
}

/* One control period of an axis. */
static inline bool step(const struct oscillation_cfg *cfg, struct oscillation_state *s,
                        const struct oscillation_axis *a, num x)
{
    const num h = n_sub(x, s->slow);
    s->slow = n_state(n_mad(s->slow, cfg->slow, h));
    if (s->half_waves != 0) {
        s->age++;
        if (s->age > cfg->half_wave) {
            s->half_waves = 0;
        }
    }
    return rarely(n_lt(a->limit, n_abs(h))) && beyond(cfg, s, a, h);
}

/* x of an axis, N/4 */
static inline num beyond_path(num net, num mass, num r_ddot, num viscous, num r_dot)
{
    return n_msub(n_msub(n_mul(NUM(QUARTER), net), mass, r_ddot), viscous, r_dot);
}

bool oscillation_step(const struct oscillation_cfg *cfg, struct oscillation_state state[2], const bool enabled[2],
                      vec2 net, vec2 r_dot, vec2 r_ddot)
{
    bool seen = false;
    if (enabled[0]) {
        seen = step(cfg, &state[0], &cfg->axis[0], beyond_path(net.x, cfg->mass.x, r_ddot.x, cfg->viscous.x, r_dot.x));
    } else {
        state[0].half_waves = 0;
    }
    if (enabled[1]) {
        seen |= step(cfg, &state[1], &cfg->axis[1], beyond_path(net.y, cfg->mass.y, r_ddot.y, cfg->viscous.y, r_dot.y));
    } else {
        state[1].half_waves = 0;
    }
    return seen;
}
