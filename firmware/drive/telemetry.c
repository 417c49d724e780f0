/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/telemetry.h"

/* ---- servo tick: functions of their own, since a period in ten needs each ---- */

__attribute__((noinline)) void telemetry_collect(struct telemetry_record *r, const struct servo_state *servo,
                                                 const struct encoder encoder[2], const struct hal_drive_in *in)
{
    telemetry_copy_slow(&r->copies, servo, in);
    r->correction = servo->correction;
    r->placed = servo->placed;
    for (int i = 0; i < 2; i++) {
        r->measured[i] = encoder[i].pos;
        r->counts_since_index[i] = (int32_t)((uint32_t)in->count[i] - (uint32_t)in->index_count[i]);
        r->index_pulses[i] = in->index_pulses[i];
        r->edge_nm[i] = encoder[i].edge_nm;
    }
}

static void add_contour_error(struct contour_statistics *statistics, int32_t error_nm)
{
    const uint32_t size = error_nm < 0 ? 0u - (uint32_t)error_nm : (uint32_t)error_nm;
    statistics->max_nm = size > statistics->max_nm ? size : statistics->max_nm;
    if (statistics->samples < UINT32_MAX) {
        statistics->sum_nm += size;
        statistics->samples++;
    }
}

__attribute__((noinline)) void telemetry_complete(struct telemetry_record *r, uint32_t ms,
                                                  const struct servo_state *servo, const struct path_state *path,
                                                  struct contour_statistics *statistics,
                                                  const struct contour_range *range, bool path_runs)
{
    r->ms = ms;
    telemetry_copy(&r->copies, servo, path, range);
    if (path_runs) {
        add_contour_error(statistics, n_to_scaled(r->out.contour.e_n.y, 1000));
    }
    r->contour_statistics = *statistics;
    r->controller = (uint8_t)servo->controller;
}

/* ---- background ---- */

void telemetry_scale(struct servo_snapshot *s, const struct telemetry_record *r, const struct encoder encoder[2])
{
    s->ms = r->ms;
    telemetry_scale_signals(s, &r->out, &r->copies);
    s->correction_nm[0] = n_to_scaled(r->correction.x, 1000);
    s->correction_nm[1] = n_to_scaled(r->correction.y, 1000);
    for (int i = 0; i < 2; i++) {
        const pos_t index = encoder_position_before(&encoder[i], r->measured[i], r->counts_since_index[i]);
        s->index_nm[i] = pos_to_nm(pos_add(index, i == 0 ? r->placed.x : r->placed.y));
        s->index_pulses[i] = r->index_pulses[i];
        s->edge_nm[i] = r->edge_nm[i];
    }
    s->contour_statistics = r->contour_statistics;
    s->controller = r->controller;
}

static uint32_t mean_pm(const struct contour_statistics *statistics)
{
    const uint64_t whole = statistics->sum_nm / statistics->samples;
    const uint64_t rest = statistics->sum_nm % statistics->samples;
    const uint64_t pm = whole * 1000u + rest * 1000u / statistics->samples;
    return pm > UINT32_MAX ? UINT32_MAX : (uint32_t)pm;
}

/* 60FDh: the limit switches from bit 0, the manufacturer's inputs from bit 16. */
static uint32_t digital_inputs(uint8_t inputs)
{
    return (inputs & 0x0Fu) | (uint32_t)(inputs >> 4) << 16;
}

/* 6077h: 0.1 N in 1/1000 of the force limit, mN, which no force exceeds */
static int16_t permille(int32_t force_dN, uint32_t limit_mN)
{
    return (int16_t)((int64_t)force_dN * 100000 / limit_mN);
}

void telemetry_report(struct od_data *od, const struct servo_snapshot *s, const int32_t position_nm[2])
{
    telemetry_report_signals(od, s, position_nm);
    od->clock.tick = s->ms;
    od->telemetry.tick = (uint16_t)s->ms;
    od->controller.active = s->controller;
    od->estimated_contour_error.samples = s->contour_statistics.samples;
    od->estimated_contour_error.max = s->contour_statistics.max_nm;
    od->estimated_contour_error.mean = s->contour_statistics.samples == 0 ? 0u : mean_pm(&s->contour_statistics);
    for (int i = 0; i < 2; i++) {
        od->axis[i].digital_inputs = digital_inputs(s->inputs[i]);
        od->axis[i].torque_actual = permille(s->force_dN[i], od->axis[i].plant.force_limit);
    }
}
