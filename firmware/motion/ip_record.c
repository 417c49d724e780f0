/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/ip_record.h"

void ip_record_start(struct ip_record *r, uint8_t ms, struct knot start)
{
    r->ms = ms;
    for (int axis = 0; axis < 2; axis++) {
        int64_t value = start.nm[axis];
        for (int i = 0; i < 3; i++) {
            moving_average_fill(&r->average[axis][i], ms, value);
            value *= ms;
        }
    }
}

struct knot ip_record_step(struct ip_record *r, struct knot record)
{
    struct knot knot;
    const int64_t cube = (int64_t)r->ms * r->ms * r->ms;
    for (int axis = 0; axis < 2; axis++) {
        int64_t value = record.nm[axis];
        for (int i = 0; i < 3; i++) {
            value = moving_average_step(&r->average[axis][i], value);
        }
        knot.nm[axis] = (int32_t)moving_average_round(value, cube);
    }
    return knot;
}
