/* SPDX-License-Identifier: Apache-2.0 */
/* force_filter.c: the second-order filters of force_filter.h. */
#include "core/force_filter.h"

/* ---- Background ---- */

#define ONE ((int64_t)1 << 30)
#define PI 3373259426 /* pi ONE */

/* tan(pi f / rate) by its Pade approximant, whose error is below 1e-9 up to pi/4; above that it is 1 / tan(pi/2 - a).
 * All of it is in integers, so a num has but the error of its own rounding and that of the angle, 1e-9 rad. */
static num tangent(uint32_t f_mHz, uint32_t rate_Hz)
{
    const bool upper = f_mHz > 250u * rate_Hz;
    const int64_t a = (upper ? 500u * rate_Hz - f_mHz : f_mHz) * PI / (1000 * (int64_t)rate_Hz);
    const int64_t a2 = (a * a) >> 30;
    const int64_t a4 = (a2 * a2) >> 30;
    const int64_t numerator = (a * (ONE - a2 / 9 + a4 / 945)) >> 20;
    const int64_t denominator = (ONE - 4 * a2 / 9 + a4 / 63) << 10;
    return upper ? n_ratio(denominator, numerator) : n_ratio(numerator, denominator);
}

static bool usable(uint32_t f_mHz, uint32_t rate_Hz)
{
    return f_mHz >= 1000u && f_mHz <= 490u * rate_Hz;
}

static bool design(struct force_section_cfg *c, const struct force_section_spec *spec, uint32_t rate_Hz)
{
    if (!usable(spec->pole_mHz, rate_Hz) || (spec->zero_mHz != 0 && !usable(spec->zero_mHz, rate_Hz))) {
        return false;
    }
    const num g = tangent(spec->pole_mHz, rate_Hz);
    const num k = n_ratio(spec->pole_damping, 500);
    const num denominator = n_mad(NUM(1), g, n_add(g, k));
    *c = (struct force_section_cfg){
        .g = g, .a1 = n_div(NUM(1), denominator), .a2 = n_div(g, denominator), .c = NUM(0), .r2 = NUM(0)};
    if (spec->zero_mHz != 0) {
        const num w_z = tangent(spec->zero_mHz, rate_Hz);
        if (n_lt(n_mul(NUM(FORCE_SECTION_RATIO), w_z), g)) {
            return false;
        }
        const num r = n_div(g, w_z);
        c->c = n_mul(r, n_msub(n_ratio(spec->zero_damping, 500), k, r));
        c->r2 = n_mul(r, r);
    }
    return true;
}

bool force_filter_design(struct force_filter_cfg *cfg, int i, const struct force_section_spec spec[FORCE_SECTIONS],
                         uint32_t rate_Hz)
{
    uint8_t count = 0;
    for (unsigned n = 0; n < FORCE_SECTIONS; n++) {
        if (spec[n].pole_mHz != 0) {
            if (!design(&cfg->section[i][count], &spec[n], rate_Hz)) {
                return false;
            }
            count++;
        }
    }
    cfg->count[i] = count;
    cfg->on = cfg->on || count != 0;
    return true;
}

/* ---- Servo tick ---- */

void force_filter_reset(struct force_filter_state *state, vec2 force)
{
    for (unsigned n = 0; n < FORCE_SECTIONS; n++) {
        state->section[0][n] = (struct force_section_state){NUM(0), force.x};
        state->section[1][n] = (struct force_section_state){NUM(0), force.y};
    }
}

static inline num section(const struct force_section_cfg *c, struct force_section_state *s, num u)
{
    const num band = n_mad(n_mul(c->a1, s->s1), c->a2, n_sub(u, s->s2));
    const num low = n_mad(s->s2, c->g, band);
    s->s1 = n_state(n_mad(n_neg(s->s1), NUM(2), band));
    s->s2 = n_state(n_mad(n_neg(s->s2), NUM(2), low));
    return n_mad(n_mad(low, c->c, band), c->r2, n_sub(u, low));
}

static inline num filter(const struct force_section_cfg *c, struct force_section_state *s, unsigned count, num u)
{
    num out = u;
    for (unsigned n = 0; n < FORCE_SECTIONS && n < count; n++) { /* a bit of the count may flip */
        out = section(&c[n], &s[n], out);
    }
    return out;
}

vec2 force_filter_step(const struct force_filter_cfg *cfg, struct force_filter_state *state, vec2 force)
{
    return v2(filter(cfg->section[0], state->section[0], cfg->count[0], force.x),
              filter(cfg->section[1], state->section[1], cfg->count[1], force.y));
}
