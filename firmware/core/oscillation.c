/* SPDX-License-Identifier: Apache-2.0 */
/* oscillation.c: the watch for oscillation of oscillation.h. Runs in the servo tick. */
#include "core/oscillation.h"

#define QUARTER 0.25
#define LASTING 0.7 /* an amplitude below this share of the largest one ends an oscillation */
/* What is told at most */
#define FORCE_MAX 1000     /* N/4 */
#define FREQUENCY_MAX 4000 /* Hz */

static void begin(struct oscillation_state *s, num largest)
{
    s->half_waves = 1;
    s->ticks = 0;
    s->largest = largest;
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
__attribute__((noinline)) static bool beyond(const struct oscillation_cfg *cfg, struct oscillation_state *s, num h)
{
    const bool positive = n_lt(NUM(0), h);
    const num size = n_abs(h);
    if (s->half_waves != 0 && positive == s->positive) {
        s->peak = n_max(s->peak, size);
        return false;
    }
    /* of the half wave that has ended and the one before: a constant part of h is not in it */
    const num amplitude = n_mad(n_mul(NUM(0.5), s->before), NUM(0.5), s->peak);
    if (s->half_waves == 0) {
        begin(s, NUM(0));
    } else if (s->half_waves > 1 && n_lt(amplitude, n_mul(NUM(LASTING), s->largest))) {
        begin(s, amplitude);
    } else {
        s->ticks = (uint16_t)(s->ticks + s->age);
        s->largest = s->half_waves > 1 ? n_max(s->largest, amplitude) : s->largest;
        s->half_waves++;
    }
    s->before = s->peak;
    s->positive = positive;
    s->peak = size;
    s->age = 0;
    if (s->half_waves < OSCILLATION_HALF_WAVES || s->ticks < cfg->lasts) {
        return false;
    }
    count(cfg, s);
    return true;
}

/* One control period of an axis. */
static inline bool step(const struct oscillation_cfg *cfg, struct oscillation_state *s, num limit, num x)
{
    const num h = n_sub(x, s->slow);
    s->slow = n_state(n_mad(s->slow, cfg->slow, h));
    if (s->half_waves != 0) {
        s->age++;
        if (s->age > cfg->half_wave) {
            s->half_waves = 0;
        }
    }
    return n_lt(limit, n_abs(h)) && beyond(cfg, s, h);
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
        seen = step(cfg, &state[0], cfg->limit.x, beyond_path(net.x, cfg->mass.x, r_ddot.x, cfg->viscous.x, r_dot.x));
    } else {
        state[0].half_waves = 0;
    }
    if (enabled[1]) {
        seen |= step(cfg, &state[1], cfg->limit.y, beyond_path(net.y, cfg->mass.y, r_ddot.y, cfg->viscous.y, r_dot.y));
    } else {
        state[1].half_waves = 0;
    }
    return seen;
}
