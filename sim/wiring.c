/* SPDX-License-Identifier: Apache-2.0 */
#include "sim/wiring.h"

#include <stdlib.h>

enum { LINE = 4 }; /* counts by which an index pulse may be off */

void wiring_init(struct wiring *w)
{
    *w = (struct wiring){0};
}

void wiring_configure(struct wiring *w, const struct hal_axis_cfg cfg[AXES])
{
    for (int i = 0; i < AXES; i++) {
        w->axis[i].invert_force = cfg[i].invert_force;
        w->axis[i].invert_encoder = cfg[i].invert_encoder;
        w->axis[i].invert_second = cfg[i].invert_second;
        w->axis[i].index_counts = cfg[i].index_counts;
        w->axis[i].index_seen = false;
    }
}

/* Counts from `from` to `to` of the plant, as the drive counts them; both wrap as int32 does. */
static uint32_t counted(bool invert, int32_t from, int32_t to)
{
    const uint32_t moved = (uint32_t)to - (uint32_t)from;
    return invert ? 0u - moved : moved;
}

/* Take over an index pulse. Returns whether it is a multiple of index_counts from the last one. */
static bool index_plausible(struct wiring_axis *a, int32_t count)
{
    bool plausible = true;
    if (a->index_seen && a->index_counts != 0) {
        const int64_t off = llabs((int64_t)count - a->index_count) % a->index_counts;
        plausible = off <= LINE || a->index_counts - off <= LINE;
    }
    a->index_seen = true;
    a->index_count = count;
    return plausible;
}

void wiring_read(struct wiring *w, struct hal_drive_in *in)
{
    for (int i = 0; i < AXES; i++) {
        struct wiring_axis *a = &w->axis[i];
        const int32_t now = in->count[i];
        a->count += counted(a->invert_encoder, a->last, now);
        a->last = now;
        in->count[i] = (int32_t)a->count;
        a->second += counted(a->invert_second, a->last_second, in->second[i]);
        a->last_second = in->second[i];
        in->second[i] = (int32_t)a->second;
        in->index_count[i] = (int32_t)(a->count - counted(a->invert_encoder, in->index_count[i], now));
        if (in->index_pulses[i] != a->index_pulses && !index_plausible(a, in->index_count[i])) {
            in->inputs[i] |= HAL_ENCODER_FAULT;
        }
        a->index_pulses = in->index_pulses[i];
    }
}

double wiring_force_N(const struct wiring *w, const struct hal_drive_out *out, int axis)
{
    const int32_t force_mN = out->enable[axis] ? out->force_mN[axis] : 0;
    return (w->axis[axis].invert_force ? -force_mN : force_mN) * 1e-3;
}
