/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/path_clock.h"

/* Units here: sigma, and stop_time for time. The slope of sigma lies within +-SLOPE_MAX and changes by at most JERK in
 * a stop_time: a stop from sigma = 1 takes a quarter of stop_time to reach SLOPE_MAX, a half at it, a quarter to leave. */
#define SLOPE_MAX NUM(PATH_SLOPE_MAX)
#define JERK NUM(PATH_JERK_MAX)
#define RATE_SMALL NUM(5e-6)       /* sigma has reached its goal when it is so close to it */
#define SLOPE_SMALL NUM(1.0 / 128) /* and its slope is so small; the slope then becomes 0 */

#define CRAWL NUM(0.01) /* slower than this sigma goes on only if there are as many knots more than a stop needs: */
#define CRAWL_RESERVE NUM(0.25)

#define ROUNDING NUM(1e-5) /* error that five roundings in fixed point make in the length of a stop */

static struct motion steady(num rate)
{
    return (struct motion){acc_from(rate), acc_from(NUM(0))};
}

/* Whether sigma equals `rate` and does not change */
static bool is_steady(const struct motion *m, num rate)
{
    const num now = acc_to(m->rate);
    const num slope = acc_to(m->slope);
    return !n_lt(now, rate) && !n_lt(rate, now) && !n_lt(slope, NUM(0)) && !n_lt(NUM(0), slope);
}

/* Knots from a to b, at most 1000: that many limit nothing. */
static num knots(path_time_t a, path_time_t b)
{
    const path_time_t d = b - a;
    return d <= 0 ? NUM(0) : d > 1000 * PATH_ONE ? NUM(1000) : n_ratio(d >> 12, PATH_ONE >> 12);
}

/* Largest slope from which sigma can still land `distance` further on, if the slope falls by 2 `half` each period. */
static num landing(num distance, num half)
{
    const num root = n_sqrt(n_mad(n_mul(half, half), NUM(2 * PATH_JERK_MAX), distance));
    return n_min(SLOPE_MAX, n_max(n_sub(root, half), NUM(0)));
}

/* Change sigma towards its goal for one control period, whose length is given times ACC_GAIN. sigma never becomes 0 on its
 * way to a goal above 0. */
static struct motion moved(const struct motion *m, num goal, num period)
{
    if (is_steady(m, goal)) {
        return *m; /* the usual case */
    }
    const num gap = n_sub(goal, acc_to(m->rate));
    const num half = n_mul(NUM(PATH_JERK_MAX / 2 / ACC_GAIN), period);
    const num wanted = n_lt(gap, NUM(0)) ? n_neg(landing(n_neg(gap), half)) : landing(gap, half);
    const acc_t least = acc_mad(m->slope, n_neg(JERK), period);
    const acc_t most = acc_mad(m->slope, JERK, period);
    const acc_t slope = n_lt(wanted, acc_to(least)) ? least : n_lt(acc_to(most), wanted) ? most : acc_from(wanted);
    const acc_t rate = acc_mad(m->rate, acc_to(slope), period);
    const num left = n_sub(goal, acc_to(rate));
    const bool there = n_lt(n_abs(left), RATE_SMALL) || n_lt(gap, NUM(0)) != n_lt(left, NUM(0));
    if (there && n_lt(n_abs(acc_to(slope)), n_max(SLOPE_SMALL, n_add(half, half)))) {
        return steady(goal);
    }
    return (struct motion){acc_clamp(rate, n_min(goal, RATE_SMALL), NUM(PATH_RATE_MAX)), slope};
}

/* The distance that path time needs to stop from the motion m, in knots per stop_time. It is a little too large where the
 * slope does not reach SLOPE_MAX. `peak` is the sigma at slope 0: a stop that began there would pass through m, or sigma
 * still rises to it. */
static num stopping(const struct motion *m)
{
    if (is_steady(m, NUM(1))) {
        return n_add(NUM(0.5), ROUNDING); /* the usual case */
    }
    const num slope = acc_to(m->slope);
    const num square = n_mul(slope, slope);
    const num peak = n_mad(acc_to(m->rate), NUM(3.0 / 32), square);
    const num from_peak = n_mul(n_mul(NUM(0.125), peak), n_mad(NUM(1), NUM(3), peak));
    const num passed = n_mul(slope, n_sub(n_mul(NUM(3.0 / 512), square), n_mul(NUM(3.0 / 16), peak)));
    return n_add(n_sub(from_peak, passed), ROUNDING);
}

void path_clock_reset(struct path_clock *p)
{
    *p = (struct path_clock){.motion = steady(NUM(0))};
}

uint32_t path_clock_executed(const struct path_clock *p)
{
    return p->at.knot == 0 && p->at.fraction == 0 ? 0 : p->at.knot + 1u;
}

/* Add to path time at any rate. Path time wraps, so that this is defined even if a flipped bit has changed the rate. */
static path_time_t way_at(num rate, path_time_t step)
{
    return (path_time_t)((uint64_t)(n_to_q32(rate) / 16) * (uint64_t)step) / (1 << 28);
}

enum path_clock_event path_clock_step(struct path_clock *p, const struct path_clock_in *in)
{
    const bool to_1 = !n_lt(in->rate, NUM(1)) && !n_lt(NUM(1), in->rate);
    if (to_1 && path_clock_run_on(p, in->count, in->complete, in->step)) {
        return PATH_NOTHING;
    }
    /* s may go to `last`: the last knot of a complete stream, else as far as all four knots of an interval are there */
    const uint32_t margin = in->complete ? 1u : 3u;
    const path_time_t last = in->count < margin ? 0 : (path_time_t)(in->count - margin) * PATH_ONE;
    const num period = n_div(n_ratio(in->step >> 19, (PATH_ONE >> 19) / ACC_GAIN), in->stop_time);

    const path_time_t way = is_steady(&p->motion, NUM(1)) ? in->step : way_at(p->at.rate, in->step);
    const path_time_t s = path_s(&p->at) + way;
    p->at.count = in->count;
    p->enough = 0;
    if (in->complete && s >= last) {
        p->motion = steady(NUM(0));
        p->at = (struct path_state){.rate = NUM(0), .rate_dot = NUM(0), .count = in->count};
        path_set(&p->at, last);
        return PATH_AT_END;
    }
    path_set(&p->at, s);
    const bool run = n_lt(NUM(0), in->rate);
    const bool start = s == 0; /* the path itself starts from standstill */
    const struct motion faster = start ? steady(in->rate) : moved(&p->motion, in->rate, period);
    const num step = n_mul(acc_to(faster.rate), n_ratio(in->step, PATH_ONE));
    const num reserve = n_lt(acc_to(faster.rate), CRAWL) ? n_add(step, CRAWL_RESERVE) : step;
    const num needed = n_mad(reserve, in->stop_time, stopping(&faster));
    const bool room = in->complete || !n_lt(knots(s, last), needed);
    const struct motion next = room ? faster : start ? steady(NUM(0)) : moved(&p->motion, NUM(0), period);
    p->motion = (struct motion){acc_state(next.rate), acc_state(next.slope)};
    if (room && is_steady(&p->motion, NUM(1))) {
        p->enough = (uint32_t)n_to_scaled(needed, 1) +
                    5u; /* 3 knots of the spline, the knot that path time is in, and rounding */
    }
    p->at.rate = acc_to(p->motion.rate);
    p->at.rate_dot = n_mul(acc_to(p->motion.slope), n_div(NUM(SPLINE_PER_T0), in->stop_time));
    if (!n_lt(NUM(0), p->at.rate)) {
        return run && !start ? PATH_UNDERRUN : PATH_STANDS; /* it would move if there were more knots */
    }
    return run && !room ? PATH_STARVED : PATH_NOTHING;
}
