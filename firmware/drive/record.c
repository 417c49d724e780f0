/* SPDX-License-Identifier: Apache-2.0 */
#include "record.h"

void record_start(struct record *r, uint8_t ms, struct knot start)
{
    r->ms = ms;
    for (int axis = 0; axis < 2; axis++) {
        int64_t value = start.nm[axis];
        for (int i = 0; i < 3; i++) {
            box_fill(&r->box[axis][i], ms, value);
            value *= ms;
        }
    }
}

struct knot record_step(struct record *r, struct knot record)
{
    struct knot knot;
    const int64_t cube = (int64_t)r->ms * r->ms * r->ms;
    for (int axis = 0; axis < 2; axis++) {
        int64_t value = record.nm[axis];
        for (int i = 0; i < 3; i++) {
            value = box_step(&r->box[axis][i], value);
        }
        knot.nm[axis] = (int32_t)box_round(value, cube);
    }
    return knot;
}
