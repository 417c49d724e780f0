/* SPDX-License-Identifier: Apache-2.0 */
#include "path.h"

/* Units here: sigma, and stop_time for time. The slope of sigma lies within +-SLOPE_MAX and changes by at most JERK in
 * a stop_time: a stop from sigma = 1 takes a quarter of stop_time to reach SLOPE_MAX, a half at it, a quarter to leave. */
#define SLOPE_MAX NUM(4.0 / 3)
#define JERK NUM(16.0 / 3)
#define RATE_SMALL NUM(2e-5) /* so close to 0 or 1 sigma is there */

struct motion {
    num rate, slope;
};

/* Knots from a to b; 1000 stands for more, where it limits nothing. */
static num knots(path_t a, path_t b)
{
    const path_t d = b - a;
    return d <= 0 ? NUM(0) : d > 1000 * PATH_ONE ? NUM(1000) : n_ratio(d, PATH_ONE);
}

/* Largest slope from which sigma can still land `distance` further on. */
static num landing(num distance)
{
    return n_min(SLOPE_MAX, n_sqrt(n_mul(NUM(32.0 / 3), n_max(distance, NUM(0)))));
}

/* One control period on, towards sigma = 1, which never stands, or 0. */
static struct motion moved(const struct motion *m, bool up, num period)
{
    const num change = n_mul(JERK, period);
    const num slope = n_clamp(up ? n_add(m->slope, change) : n_sub(m->slope, change), n_neg(landing(m->rate)),
                              landing(n_sub(NUM(1), m->rate)));
    const num rate = n_mad(m->rate, slope, period);
    if (up && n_lt(n_sub(NUM(1), RATE_SMALL), rate)) {
        return (struct motion){NUM(1), NUM(0)};
    }
    if (!up && n_lt(rate, RATE_SMALL)) {
        return (struct motion){NUM(0), NUM(0)};
    }
    return (struct motion){n_clamp(rate, up ? RATE_SMALL : NUM(0), NUM(1)), slope};
}

/* Way of a stop from m, in knots times stop_time; a little more than that where the slope does not get as far as
 * SLOPE_MAX. peak: the sigma from which a stop that began at slope 0 would pass through m. */
static num stopping(const struct motion *m)
{
    const num square = n_mul(m->slope, m->slope);
    const num peak = n_mad(m->rate, NUM(3.0 / 32), square);
    const num whole = n_mul(n_mul(NUM(0.125), peak), n_mad(NUM(1), NUM(3), peak));
    const num passed = n_mul(m->slope, n_sub(n_mul(NUM(3.0 / 512), square), n_mul(NUM(3.0 / 16), peak)));
    return n_sub(whole, passed);
}

void path_reset(struct path *p)
{
    *p = (struct path){.slope = NUM(0)};
}

uint32_t path_executed(const struct path *p)
{
    return p->at.s == 0 ? 0 : (uint32_t)(p->at.s / PATH_ONE) + 1u;
}

static void advance(struct path_state *p, path_t step)
{
    const bool nominal = !n_lt(p->rate, NUM(1)) && !n_lt(NUM(1), p->rate);
    p->s += nominal ? step : n_to_q32(n_mul(p->rate, n_ratio(step, PATH_ONE))) / 8 * (PATH_ONE >> 29);
}

enum path_event path_step(struct path *p, const struct path_in *in)
{
    /* s may go to `last`: the last knot of a complete stream, else as far as all four knots of an interval are there */
    const uint32_t margin = in->complete ? 1u : 3u;
    const path_t last = in->count < margin ? 0 : (path_t)(in->count - margin) * PATH_ONE;
    const num per_T0 = n_div(NUM(SPLINE_PER_T0), in->stop_time); /* stop_times in T0 */
    const num period = n_mul(per_T0, in->dt);
    const struct motion now = {p->at.rate, p->slope};

    advance(&p->at, in->step);
    p->at.count = in->count;
    if (in->complete && p->at.s >= last) {
        p->at.s = last;
        p->at.rate = p->at.rate_dot = p->slope = NUM(0);
        return PATH_AT_END;
    }
    const bool start = p->at.s == 0; /* the path itself starts from rest */
    const struct motion faster = start ? (struct motion){NUM(1), NUM(0)} : moved(&now, true, period);
    const num way = n_mad(n_mul(faster.rate, n_ratio(in->step, PATH_ONE)), in->stop_time, stopping(&faster));
    const bool room = in->complete || !n_lt(knots(p->at.s, last), way);
    const struct motion slower = start ? (struct motion){NUM(0), NUM(0)} : moved(&now, false, period);
    const struct motion next = in->run && room ? faster : slower;

    p->at.rate = next.rate;
    p->slope = next.slope;
    p->at.rate_dot = n_mul(next.slope, per_T0);
    if (!n_lt(NUM(0), next.rate)) {
        return in->run && !room && !start ? PATH_UNDERRUN : PATH_STANDS;
    }
    return in->run && !room ? PATH_STARVED : PATH_NOTHING;
}
