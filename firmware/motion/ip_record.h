/* SPDX-License-Identifier: Apache-2.0 */
/* motion/ip_record.h: from interpolation data records (60C1h), one each 1 to 20 ms, to knots, one a millisecond.
 *
 * Records are the control points of a uniform cubic B-spline over their own time, as knots are over a millisecond. To
 * get the knots of the same curve, repeat each record m times and apply three moving averages over m values (Lane and
 * Riesenfeld, 1980).
 * The arithmetic is in integers and rounds once. It is exact wherever the path stands.
 *
 * Pure, background only. axis_modes.c starts it, path.c steps it for each record.
 */
#ifndef KONTUR_IP_RECORD_H
#define KONTUR_IP_RECORD_H
#include "core/spline.h"
#include "motion/moving_average.h"

enum { RECORD_MS_MAX = 20 /* at most MOVING_AVERAGE_MAX */, RECORD_JITTER = 16 /* ms */ };

struct ip_record {
    uint8_t ms; /* m */
    struct moving_average average[2][3];
};

/* Begin a path that stands at `start`. ms: 1..RECORD_MS_MAX. */
void ip_record_start(struct ip_record *r, uint8_t ms, struct knot start);
/* The next knot. To be called `ms` times with each record. */
struct knot ip_record_step(struct ip_record *r, struct knot record);
#endif
