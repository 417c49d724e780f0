/* SPDX-License-Identifier: Apache-2.0 */
/* supervision/servo_snapshot.h: what the background knows of the servo: its signals in integers, of one millisecond.
 *
 * The servo tick publishes a record each millisecond. drive/telemetry.c scales the newest one to this snapshot, in the
 * background, when servo_loop_snapshot() is called. The fault monitor, the axis modes and the dictionary's telemetry
 * read it. A name ends in the unit of one count; force_dN is in 0.1 N, permille is 1/1000, per_10s is 0.1 1/s.
 */
#ifndef KONTUR_SERVO_SNAPSHOT_H
#define KONTUR_SERVO_SNAPSHOT_H
#include <stdint.h>

/* The size of the contour error in each millisecond in which path time ran, since the stream began. */
struct contour_statistics {
    uint64_t sum_nm;
    uint32_t max_nm, samples;
};

struct servo_snapshot {
    uint32_t ms; /* since power-on */
    int32_t tangential_error_nm;
    int32_t contour_error_nm;
    int32_t following_error_nm[2];
    int32_t position_nm[2]; /* observed */
    int32_t reference_nm[2];
    int32_t velocity_umps[2]; /* observed */
    int32_t force_dN[2];
    int32_t feedforward_friction_mN[2]; /* friction beyond the nominal */
    int32_t feedforward_mass_g[2];      /* mass beyond the nominal */
    int32_t adaptive_gain_per_10s[2];
    int32_t switching_gain_mmps2[2];
    int32_t energy_mJ[2];
    int32_t path_rate_permille;
    int32_t encoder_count[2];
    uint8_t inputs[2]; /* enum hal_input */
    struct contour_statistics contour_statistics;
    uint8_t controller;
    uint8_t index_pulses[2];
    int32_t index_nm[2]; /* position by the encoder at the latest index pulse */
    int32_t edge_nm[2];  /* position by the encoder when a limit switch opened or closed last */
};
#endif
