/* SPDX-License-Identifier: Apache-2.0 */
#include "supervision/fault_monitor.h"

enum { HEAT_WARNING = 900, HEAT_COOLED = 850 }; /* heat at which the warning of it begins, and ends, 1/1000 */

static uint32_t size(int32_t x)
{
    return x < 0 ? 0u - (uint32_t)x : (uint32_t)x;
}

/* Counts the time since a condition began to hold. true: it has held for more than limit_ms. */
static bool lasts(const struct fault_monitor *m, uint16_t *ms, bool holds, uint32_t limit_ms)
{
    const uint32_t more = *ms == 0 ? 1u : m->passed_ms;
    *ms = (uint16_t)(!holds ? 0u : more < UINT16_MAX - (uint32_t)*ms ? *ms + more : UINT16_MAX);
    return *ms > limit_ms;
}

/* The same; limit_ms 0: never. */
static bool lasts_if_wanted(const struct fault_monitor *m, uint16_t *ms, bool holds, uint32_t limit_ms)
{
    return lasts(m, ms, holds && limit_ms != 0, limit_ms);
}

/* Whether the encoder stands while the force is larger than friction can hold. */
static bool frozen(struct fault_monitor *m, const struct fault_monitor_in *in, int i)
{
    const struct od_plant *plant = &in->od->axis[i].plant;
    const uint32_t force_mN = size(in->snapshot->force_dN[i]) * 100u;
    const bool pushed = in->powered[i] && force_mN >= plant->force_limit / 2u && force_mN >= 3u * plant->coulomb;
    const uint32_t moved = size((int32_t)((uint32_t)in->snapshot->encoder_count[i] - (uint32_t)m->count[i]));
    if (!pushed || moved > 1u) {
        m->count[i] = in->snapshot->encoder_count[i];
        m->frozen_ms[i] = 0;
    }
    return lasts_if_wanted(m, &m->frozen_ms[i], pushed, in->od->fault_delay.frozen);
}

/* The snapshot resolves 0.1 N, so 0.1 N below the limit counts as the limit, of 2100h:4 and of what is in effect. */
static bool limit_lowered(const struct fault_monitor_in *in, int i)
{
    const uint32_t limit_mN = (uint32_t)in->snapshot->force_limit_dN[i] * 100u;
    return in->od->axis[i].force_continuous.force != 0 && limit_mN + 100u < in->od->axis[i].plant.force_limit;
}

static bool saturated(struct fault_monitor *m, const struct fault_monitor_in *in, int i)
{
    const uint32_t force_mN = size(in->snapshot->force_dN[i]) * 100u;
    const uint32_t limit_mN =
        limit_lowered(in, i) ? (uint32_t)in->snapshot->force_limit_dN[i] * 100u : in->od->axis[i].plant.force_limit;
    const bool full = in->powered[i] && force_mN + 100u >= limit_mN;
    return lasts_if_wanted(m, &m->saturated_ms[i], full, in->od->fault_delay.saturated);
}

static bool hot(struct fault_monitor *m, const struct fault_monitor_in *in, int i)
{
    const int32_t heat = in->snapshot->force_heat_permille[i];
    m->hot[i] = heat >= (m->hot[i] ? HEAT_COOLED : HEAT_WARNING);
    return m->hot[i];
}

/* Whether an adaptive gain has grown to its limit. Units of the snapshot are 0.1 1/s and mm/s2, those of the dictionary 1e-3 and
 * 1e-6 of the SI unit. */
static bool at_limit(const struct fault_monitor_in *in)
{
    const struct od_smc *k = &in->od->smc;
    const struct od_compensator *mu = &in->od->compensator;
    bool at = false;
    for (int i = 0; i < 2; i++) {
        at = at || (k->k_max > k->k_0 && size(in->snapshot->adaptive_gain_per_10s[i]) >= k->k_max / 100u);
        at = at || (mu->mu_max > mu->mu_0 && size(in->snapshot->switching_gain_mmps2[i]) >= mu->mu_max / 1000u);
    }
    return at && (in->powered[0] || in->powered[1]);
}

/* Whether a knot frame was refused and has to be sent again, which means that the bus is bad. A new stream counts from 0. */
static void fault_monitor_stream(struct fault_monitor *m, const struct od_stream *s)
{
    const uint32_t rejected = s->rejected_crc + s->rejected_sequence;
    if (rejected > m->rejected) {
        fault_monitor_event(m, FAULT_STREAM);
    }
    m->rejected = rejected;
}

static void set(struct fault_monitor *m, enum fault f, bool holds)
{
    m->now |= holds ? FAULT_BIT(f) : 0u;
}

static bool event_lasts(struct fault_monitor *m, enum fault f)
{
    const uint32_t left = m->lasts_ms[f];
    m->lasts_ms[f] = (uint16_t)(left > m->passed_ms ? left - m->passed_ms : 0u);
    return m->lasts_ms[f] > 0;
}

void fault_monitor_event(struct fault_monitor *m, enum fault f)
{
    m->lasts_ms[f] = FAULT_MONITOR_EVENT_MS + 1;
    m->now |= FAULT_BIT(f);
}

static const enum fault events[] = {FAULT_CONFIG_ENABLED, FAULT_OSCILLATION, FAULT_SECOND_MASTER, FAULT_STALE_COMMAND,
                                    FAULT_STREAM};

/* The servo tick has seen an oscillation, which it counts. Its warning outlasts the time to the next count. */
static void fault_monitor_oscillation(struct fault_monitor *m, const struct fault_monitor_in *in)
{
    bool seen = false;
    for (int i = 0; i < 2; i++) {
        seen = seen || in->snapshot->oscillations[i] > m->oscillations[i];
        m->oscillations[i] = in->snapshot->oscillations[i];
    }
    if (seen && fault_reaction(in->od, FAULT_OSCILLATION) == REACT_WARN) {
        fault_monitor_event(m, FAULT_OSCILLATION);
    }
    set(m, FAULT_OSCILLATION, seen);
}

uint32_t fault_monitor_step(struct fault_monitor *m, const struct fault_monitor_in *in)
{
    const struct od_tunnel *tunnel = &in->od->tunnel;
    if (in->snapshot->ms == m->ms) {
        return m->now;
    }
    m->passed_ms = in->snapshot->ms - m->ms;
    m->ms = in->snapshot->ms;
    m->now = 0;
    const bool outside = in->powered[0] && in->powered[1] && tunnel->radius != 0 &&
                         size(in->snapshot->contour_error_nm) > tunnel->radius;
    set(m, FAULT_TUNNEL, lasts(m, &m->lasts_ms[FAULT_TUNNEL], outside, tunnel->debounce));
    set(m, FAULT_GAIN, lasts_if_wanted(m, &m->lasts_ms[FAULT_GAIN], at_limit(in), in->od->fault_delay.gain));
    for (int i = 0; i < 2; i++) {
        set(m, FAULT_ENCODER_FROZEN, frozen(m, in, i));
        set(m, limit_lowered(in, i) ? FAULT_OVERLOAD : FAULT_SATURATION, saturated(m, in, i));
        set(m, FAULT_HEAT, hot(m, in, i));
    }
    set(m, FAULT_STORE, in->parameters_invalid);
    set(m, FAULT_ENABLE_MOVING, in->enable_refused);
    fault_monitor_stream(m, &in->od->stream);
    fault_monitor_oscillation(m, in);
    for (unsigned i = 0; i < sizeof events / sizeof events[0]; i++) {
        set(m, events[i], event_lasts(m, events[i]));
    }
    return m->now;
}
