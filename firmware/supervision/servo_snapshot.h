/* SPDX-License-Identifier: Apache-2.0 */
/* supervision/servo_snapshot.h: what the background knows of the servo: its signals in integers, of one millisecond.
 *
 * The servo tick publishes a record each millisecond. drive/telemetry.c scales the newest one to this snapshot, in the
 * background, when servo_loop_snapshot() is called. The fault monitor, the axis modes and the dictionary's telemetry
 * read it. Its signals are those of scope/signals.toml that are published: the generated snapshot_gen.h lists them. A
 * name ends in the unit of one count; dN is 0.1 N, permille is 1/1000, per_10s is 0.1 1/s, mmps2 is mm/s^2.
 */
#ifndef KONTUR_SERVO_SNAPSHOT_H
#define KONTUR_SERVO_SNAPSHOT_H
#include <stdint.h>

#include "supervision/snapshot_gen.h"

/* The size of the contour error in each millisecond in which path time ran, since the stream began. */
struct contour_statistics {
    uint64_t sum_nm;
    uint32_t max_nm, samples;
};

struct servo_snapshot {
    uint32_t ms;      /* since power-on */
    SNAPSHOT_SIGNALS; /* int32_t, but `inputs`: uint8_t, bits of enum hal_input */
    struct contour_statistics contour_statistics;
    uint8_t controller; /* enum controller */
    uint8_t index_pulses[2];
    int32_t index_nm[2];      /* position by the encoder at the latest index pulse, */
    int32_t edge_nm[2];       /* and when a limit switch opened or closed last */
    int32_t correction_nm[2]; /* what the geometry has added by position (core/geometry.h): not a part of these two */
};
#endif
