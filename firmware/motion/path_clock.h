/* SPDX-License-Identifier: Apache-2.0 */
/* motion/path_clock.h: path time, and how it starts and stops. Servo tick only; servo_loop.c steps it each period.
 *
 * Path time s runs over the knots at rate sigma; slowing it stops both axes *on the curve*. sigma goes to where it is
 * wanted, 1 or the feed override, without a step in its slope: a stop from rate 1 takes stop_time and half as many knots
 * (slope 0 .. -4/3 .. 0 over stop_time), and so does a start. Slope and its change are limited whenever the wanted rate changes.
 * sigma is only ever raised if a stop from there still ends within the knots that are there, unless the stream is
 * complete: an underrun is a stop on the path by construction.
 *
 * Along the path at programmed speed v and acceleration a: sigma v, and sigma^2 a + v d sigma/dt, where
 * |d sigma/dt| <= PATH_SLOPE_MAX / stop_time. At sigma = 1.2 the programmed acceleration counts 1.44 times, the jerk 1.73.
 */
#ifndef KONTUR_PATH_CLOCK_H
#define KONTUR_PATH_CLOCK_H
#include "core/contour.h"

#define PATH_STOP_TIME_MAX 1000  /* ms: a stop from PATH_RATE_MAX needs 0.69 as many knots, which must fit the queue */
#define PATH_RATE_MAX 1.2        /* feed override 120 % */
#define PATH_SLOPE_MAX (4.0 / 3) /* of sigma, per stop_time */
#define PATH_JERK_MAX (16.0 / 3) /* change of the slope, per stop_time squared */

struct path_clock_in {
    uint32_t count;   /* knots in the ring */
    bool complete;    /* no more knots will come: the path stands at its end */
    num rate;         /* sigma to go to, 0..PATH_RATE_MAX; 0: slow down to a stop */
    num stop_time;    /* knots (ms) from rate 1 to 0, 1..PATH_STOP_TIME_MAX */
    path_time_t step; /* path time of one control period at rate 1 */
};

struct path_clock {
    struct path_state at;  /* what contour_step() takes */
    struct motion {        /* what a control period adds may be far below the resolution of a num */
        acc_t rate, slope; /* sigma, and its change in a stop_time */
    } motion;
    /* While sigma is 1: the number of knots from at.knot on with which sigma may stay 1 without a further check. Else 0. */
    uint32_t enough;
};

enum path_clock_event {
    PATH_NOTHING,
    PATH_STANDS,   /* sigma = 0: stopped or not started */
    PATH_STARVED,  /* sigma is limited because knots are missing */
    PATH_UNDERRUN, /* stands before the end because knots are missing */
    PATH_AT_END    /* the last knot of a complete stream has been reached */
};

/* What the servo tick reports of path time to the background. */
struct path_progress {
    bool current;      /* path time runs over the knots of the queue as it is; else `standing` alone counts */
    bool standing;     /* path time does not run */
    bool at_end;       /* it has reached the end of the knots, which may be the end of the path */
    bool starved;      /* path time is slowed because knots are missing */
    uint32_t executed; /* knots passed */
};

void path_clock_reset(struct path_clock *p);
/* Advance path time by one control period. */
enum path_clock_event path_clock_step(struct path_clock *p, const struct path_clock_in *in);
/* The short form of path_clock_step() for the usual case: sigma is 1, is to stay 1, and enough knots lie ahead. The event
 * is PATH_NOTHING then. Returns false in all other cases, and changes nothing. */
static inline bool path_clock_run_on(struct path_clock *p, uint32_t count, bool complete, path_time_t step)
{
    if (p->enough == 0 || p->at.knot + (complete ? 2u : p->enough) >= count) {
        return false;
    }
    p->at.count = count;
    p->at.fraction += (uint32_t)step;
    if (p->at.fraction >= (uint32_t)PATH_ONE) {
        p->at.fraction -= (uint32_t)PATH_ONE;
        p->at.knot++;
    }
    return true;
}
/* Number of knots that path time has passed: those with an index <= s. */
uint32_t path_clock_executed(const struct path_clock *p);
#endif
