/* SPDX-License-Identifier: Apache-2.0 */
#include "path.h"

/* Knots from a to b as num; 1000 stands for more, where it limits nothing. */
static num knots(path_t a, path_t b)
{
    const path_t d = b - a;
    return d <= 0 ? NUM(0) : d > 1000 * PATH_ONE ? NUM(1000) : n_ratio(d, PATH_ONE);
}

void path_reset(struct path_state *p)
{
    *p = (struct path_state){.s = 0};
}

uint32_t path_executed(const struct path_state *p)
{
    return p->s == 0 ? 0 : (uint32_t)(p->s / PATH_ONE) + 1u;
}

static void advance(struct path_state *p, path_t step)
{
    const bool nominal = !n_lt(p->rate, NUM(1)) && !n_lt(NUM(1), p->rate);
    p->s += nominal ? step : n_to_q32(n_mul(p->rate, n_ratio(step, PATH_ONE))) / 8 * (PATH_ONE >> 29);
}

enum path_event path_step(struct path_state *p, const struct path_in *in)
{
    /* s may go to `last`: the last knot of a complete stream, else as far as all four knots of an interval are there */
    const uint32_t margin = in->complete ? 1u : 3u;
    const path_t last = in->count < margin ? 0 : (path_t)(in->count - margin) * PATH_ONE;
    const num slope = n_div(n_mul(NUM(SPLINE_PER_T0), in->dt), in->stop_time); /* change of sigma in a period */
    const num rate = p->rate;
    num target = in->run ? NUM(1) : NUM(0);
    bool starved = false;

    advance(p, in->step);
    p->count = in->count;
    if (in->complete && p->s >= last) {
        p->s = last;
        p->rate = p->rate_dot = NUM(0);
        return PATH_AT_END;
    }
    if (!in->complete) {
        const num allowed = n_sqrt(n_div(n_mul(NUM(2), knots(p->s, last)), in->stop_time));
        starved = n_lt(allowed, target);
        target = n_min(target, allowed);
    }
    if (p->s == 0) { /* the path itself starts from rest */
        p->rate = n_lt(target, NUM(1)) ? NUM(0) : NUM(1);
        p->rate_dot = NUM(0);
    } else {
        p->rate = n_max(n_sub(rate, slope), n_min(target, n_add(rate, slope)));
        p->rate_dot = n_div(n_sub(p->rate, rate), in->dt);
    }
    if (!n_lt(NUM(0), p->rate)) {
        p->rate = NUM(0);
        return PATH_STANDS;
    }
    return starved ? PATH_STARVED : PATH_NOTHING;
}
