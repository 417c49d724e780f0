/* SPDX-License-Identifier: Apache-2.0 */
/* path.h: path time. Servo tick only.
 *
 * Path time s runs over the knots at rate sigma; slowing it stops both axes *on the curve*. sigma falls and rises at
 * 1/stop_time, and never exceeds what can be stopped within the knots that are there (sigma^2 <= 2 remaining/stop_time)
 * unless the stream is complete: an underrun is a stop on the path by construction.
 */
#ifndef KONTUR_PATH_H
#define KONTUR_PATH_H
#include "contour.h"

struct path_in {
    uint32_t count;     /* knots there */
    bool complete;      /* no more will come: the path's own end is at rest */
    bool run;           /* false: slow down to a stop */
    num stop_time;      /* knots (ms) from rate 1 to 0, > 0 */
    path_t step;        /* path time of one control period at rate 1 */
    num dt;             /* control period, T0 */
};

enum path_event {
    PATH_NOTHING,
    PATH_STANDS,   /* sigma = 0: stopped or not started */
    PATH_STARVED,  /* slowed for want of knots */
    PATH_AT_END    /* the last knot of a complete stream has been reached */
};

void path_reset(struct path_state *p);
/* One control period on; p->s, rate, rate_dot and count are then what contour_step() takes. */
enum path_event path_step(struct path_state *p, const struct path_in *in);
/* Knots passed: those with an index <= s. */
uint32_t path_executed(const struct path_state *p);
#endif
