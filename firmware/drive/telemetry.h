/* SPDX-License-Identifier: Apache-2.0 */
/* drive/telemetry.h: what the servo publishes each millisecond, and its way into the object dictionary.
 *
 *   servo tick   a record in core units: servo_step() writes its output into it, telemetry_collect() and
 *                telemetry_complete() add the rest
 *   background   telemetry_scale() makes the snapshot of a record, telemetry_report() writes that to the dictionary
 *
 * Which signals these are, their units and their objects: scope/signals.toml, of which telemetry_gen.h is generated.
 */
#ifndef KONTUR_TELEMETRY_H
#define KONTUR_TELEMETRY_H
#include "drive/encoder.h"
#include "drive/telemetry_gen.h"

struct telemetry_record {
    uint32_t ms;                    /* since power-on */
    struct servo_out out;           /* of the last period */
    struct telemetry_copies copies; /* the other published signals */
    vec2 correction, placed;        /* of the geometry by position, um, and all other corrections */
    pos_t measured[2];              /* positions by the encoders, without them, */
    int32_t counts_since_index[2];  /* and how far they are beyond the latest index pulse */
    uint8_t index_pulses[2];
    int32_t edge_nm[2];
    struct contour_statistics contour_statistics;
    uint8_t controller;
};

/* Servo tick, half a millisecond before the record is published: write the signals that change slowly. In this way two
 * periods share the work of a record. */
void telemetry_collect(struct telemetry_record *r, const struct servo_state *servo, const struct encoder encoder[2],
                       const struct hal_drive_in *in);
/* Servo tick, at the end of millisecond `ms`: write all other signals. The statistics include the contour error of each
 * millisecond in which path time runs. */
void telemetry_complete(struct telemetry_record *r, uint32_t ms, const struct servo_state *servo,
                        const struct path_state *path, struct contour_statistics *statistics,
                        const struct contour_range *range, bool path_runs);

/* Background: make the snapshot of a record. `encoder` has the lengths of a count. */
void telemetry_scale(struct servo_snapshot *s, const struct telemetry_record *r, const struct encoder encoder[2]);
/* Background: write every object that reports signals of the servo. position_nm: as in the snapshot, but from the user's
 * zero. */
void telemetry_report(struct od_data *od, const struct servo_snapshot *s, const int32_t position_nm[2]);
#endif
