/* SPDX-License-Identifier: Apache-2.0 */
/* drive/contour_range.h: the least and the greatest contour error of the control periods of a millisecond.
 *
 * Telemetry has the contour error of one period in ten, by the observed position. So it lacks the tips of errors that last
 * a few periods, such as the spike at a reversal. Here each period counts, and the observed position is moved to where
 * the encoder allows the axis to be: to within half a count of what it reads.
 *
 * Context: the servo tick.
 */
#ifndef KONTUR_CONTOUR_RANGE_H
#define KONTUR_CONTOUR_RANGE_H
#include "core/contour.h"

struct contour_range {
    num bound[2]; /* least and greatest, um */
};

/* How far an axis that is observed at `observed` is from there at least, um, as the encoder reads `measured`. */
static inline num contour_range_apart(pos_t measured, pos_t observed, num half_count)
{
    const num difference = pos_sub(measured, observed);
    return n_sub(difference, n_within(difference, half_count));
}

/* One control period, the `first` of a millisecond or not, with the contour error of the observed position, from which the
 * axes are `apart`. */
void contour_range_step(struct contour_range *range, bool first, const struct contour_out *c, vec2 apart);
#endif
