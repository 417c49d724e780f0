/* SPDX-License-Identifier: Apache-2.0 */
#include "path.h"

/* Units here: sigma, and stop_time for time. The slope of sigma lies within +-SLOPE_MAX and changes by at most JERK in
 * a stop_time: a stop from sigma = 1 takes a quarter of stop_time to reach SLOPE_MAX, a half at it, a quarter to leave. */
#define SLOPE_MAX NUM(4.0 / 3)
#define JERK NUM(16.0 / 3)
#define RATE_SMALL NUM(2e-5) /* so close to 0 or 1 sigma is there */

#define ROUNDING NUM(1e-5) /* what five roundings make of the way of a stop, in fixed point */

static struct motion steady(num rate)
{
    return (struct motion){acc_from(rate), acc_from(NUM(0))};
}

/* Knots from a to b; 1000 stands for more, where it limits nothing. */
static num knots(path_t a, path_t b)
{
    const path_t d = b - a;
    return d <= 0 ? NUM(0) : d > 1000 * PATH_ONE ? NUM(1000) : n_ratio(d >> 12, PATH_ONE >> 12);
}

/* Largest slope from which sigma can still land `distance` further on. */
static num landing(num distance)
{
    return n_min(SLOPE_MAX, n_sqrt(n_mul(NUM(32.0 / 3), n_max(distance, NUM(0)))));
}

/* One control period, ACC_GAIN times given, on, towards sigma = 1, which never stands, or 0. */
static struct motion moved(const struct motion *m, bool up, num period)
{
    const num before = acc_to(m->rate);
    if (up && !n_lt(before, NUM(1))) {
        return *m; /* as it mostly is */
    }
    const acc_t slope = acc_clamp(acc_mad(m->slope, up ? JERK : n_neg(JERK), period), n_neg(landing(before)),
                                  landing(n_sub(NUM(1), before)));
    const acc_t rate = acc_mad(m->rate, acc_to(slope), period);
    if (up && n_lt(n_sub(NUM(1), RATE_SMALL), acc_to(rate))) {
        return steady(NUM(1));
    }
    if (!up && n_lt(acc_to(rate), RATE_SMALL)) {
        return steady(NUM(0));
    }
    return (struct motion){acc_clamp(rate, up ? RATE_SMALL : NUM(0), NUM(1)), slope};
}

/* Way of a stop from m, in knots times stop_time; a little more than that where the slope does not get as far as
 * SLOPE_MAX. peak: the sigma from which a stop that began at slope 0 would pass through m. */
static num stopping(const struct motion *m)
{
    if (!n_lt(acc_to(m->rate), NUM(1))) {
        return n_add(NUM(0.5), ROUNDING); /* as it mostly is */
    }
    const num slope = acc_to(m->slope);
    const num square = n_mul(slope, slope);
    const num peak = n_mad(acc_to(m->rate), NUM(3.0 / 32), square);
    const num whole = n_mul(n_mul(NUM(0.125), peak), n_mad(NUM(1), NUM(3), peak));
    const num passed = n_mul(slope, n_sub(n_mul(NUM(3.0 / 512), square), n_mul(NUM(3.0 / 16), peak)));
    return n_add(n_sub(whole, passed), ROUNDING);
}

void path_reset(struct path *p)
{
    *p = (struct path){.motion = steady(NUM(0))};
}

uint32_t path_executed(const struct path *p)
{
    uint32_t rest;
    return p->at.s == 0 ? 0 : path_knots(p->at.s, &rest) + 1u;
}

enum path_event path_step(struct path *p, const struct path_in *in)
{
    /* s may go to `last`: the last knot of a complete stream, else as far as all four knots of an interval are there */
    const uint32_t margin = in->complete ? 1u : 3u;
    const path_t last = in->count < margin ? 0 : (path_t)(in->count - margin) * PATH_ONE;
    const num period = n_div(n_ratio(in->step >> 19, (PATH_ONE >> 19) / ACC_GAIN), in->stop_time);

    p->at.s += n_lt(p->at.rate, NUM(1)) ? n_to_q32(p->at.rate) / 16 * in->step / (1 << 28) : in->step;
    p->at.count = in->count;
    if (in->complete && p->at.s >= last) {
        p->motion = steady(NUM(0));
        p->at = (struct path_state){.s = last, .rate = NUM(0), .rate_dot = NUM(0), .count = in->count};
        return PATH_AT_END;
    }
    const bool start = p->at.s == 0; /* the path itself starts from rest */
    const struct motion faster = start ? steady(NUM(1)) : moved(&p->motion, true, period);
    const num step = n_mul(acc_to(faster.rate), n_ratio(in->step, PATH_ONE));
    const bool room = in->complete || !n_lt(knots(p->at.s, last), n_mad(step, in->stop_time, stopping(&faster)));
    const struct motion next = in->run && room ? faster : start ? steady(NUM(0)) : moved(&p->motion, false, period);
    p->motion = (struct motion){acc_state(next.rate), acc_state(next.slope)};
    p->at.rate = acc_to(p->motion.rate);
    p->at.rate_dot = n_mul(acc_to(p->motion.slope), n_div(NUM(SPLINE_PER_T0), in->stop_time));
    if (!n_lt(NUM(0), p->at.rate)) {
        return in->run && !room && !start ? PATH_UNDERRUN : PATH_STANDS;
    }
    return in->run && !room ? PATH_STARVED : PATH_NOTHING;
}
