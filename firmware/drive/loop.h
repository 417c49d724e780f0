/* SPDX-License-Identifier: Apache-2.0 */
/* loop.h: the servo tick: read the drive, one servo_step(), write the drive. The only place where the step order stands.
 *
 * loop_tick() runs in the servo interrupt (CONTROL_HZ), everything else in the background loop. They meet in
 * - struct loop_command: single words, background writes;
 * - two configurations, of which `cfg_index` names the one in use;
 * - the ring of knots (one writer, one reader);
 * - two snapshots, published once a millisecond; and `faults`, bits that the tick sets and the background clears.
 */
#ifndef KONTUR_LOOP_H
#define KONTUR_LOOP_H
#include <stdatomic.h>

#include "fault.h"
#include "hal.h"
#include "params.h"
#include "path.h"

struct loop_cfg {
    struct servo_cfg servo;
    uint32_t encoder_10fm[2];   /* length of one encoder count, 10 fm */
    num following_max[2];       /* um */
    uint32_t following_ticks[2]; /* periods that it may be exceeded for */
    num speed_max;              /* um/T0 */
    int32_t min_nm[2], max_nm[2]; /* user's positions */
    num stop_time;              /* knots (ms) */
};

struct loop_command {
    _Atomic bool powered[2];   /* power stage on, law active */
    _Atomic bool run;          /* path time may run */
    _Atomic bool complete;     /* all knots of the stream are in the ring */
    _Atomic bool rest;         /* not known to be complete, but it may end where its knots do: they stand */
    _Atomic uint8_t controller;
    _Atomic uint32_t begin;    /* counts up: path time starts anew at 0 */
    _Atomic uint8_t cfg_index;
    _Atomic bool energy_reset;
    _Atomic int32_t origin_nm[2]; /* user's position less the servo's: for the limits only */
};

/* |e_n2| of each millisecond in which path time ran, since it last began */
struct loop_error {
    uint64_t sum_nm;
    uint32_t max_nm, samples;
};

/* What the background and the telemetry see of the servo: consistent, one millisecond old at most. */
struct loop_snapshot {
    uint32_t ms;              /* since power-on */
    int32_t position_nm[2];   /* observed */
    int32_t reference_nm[2];
    int32_t velocity_umps[2];
    int32_t following_nm[2];
    int32_t e_n_nm[2];
    int32_t force_dN[2];      /* 0.1 N */
    int32_t k_hat[2];         /* 0.1 1/s */
    int32_t mu[2];            /* mm/s^2 */
    int32_t energy_mJ[2];
    int32_t learned_mN[2];    /* friction beyond the nominal */
    int32_t learned_g[2];     /* mass beyond the nominal */
    int32_t rate;             /* sigma, 1/1000 */
    struct loop_error error;
    uint8_t inputs[2];        /* enum hal_input */
    uint8_t index_pulses[2];
    int32_t index_nm[2];      /* encoder at the latest of them */
    int32_t edge_nm[2];       /* ... when a limit switch opened or closed last */
    uint8_t controller;
};

struct loop {
    const struct hal *hal;
    const struct spline_ring *ring;
    struct loop_command command;
    struct loop_cfg cfg[2];
    _Atomic uint32_t faults;    /* FAULT_BIT()s */
    _Atomic uint32_t begun;     /* command.begin that the next four words belong to */
    _Atomic bool standing;      /* path time does not run */
    _Atomic bool at_end;        /* ... since it has reached the end of a complete stream, or of one that may rest */
    _Atomic bool starved;       /* path time is slowed for want of knots */
    _Atomic uint32_t executed;  /* knots passed */
    _Atomic uint32_t published; /* snapshots so far: one a millisecond */
    struct loop_snapshot snapshot[2];

    /* the tick's own */
    struct servo_state servo;
    struct path path;
    int32_t last_count[2];
    int64_t count[2];
    uint32_t late[2];           /* periods since the following error is too large */
    uint8_t inputs[2];          /* of the last period */
    int32_t edge_nm[2];
    struct loop_error error;
    uint32_t ticks;
    uint8_t cfg_used;
};

/* A configuration must be set up before the first tick. Positions are encoder counts times their length. */
void loop_init(struct loop *loop, const struct hal *hal, const struct spline_ring *ring);
void loop_tick(struct loop *loop);
/* The newest snapshot. */
const struct loop_snapshot *loop_snapshot(const struct loop *loop);
#endif
