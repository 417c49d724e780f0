/* SPDX-License-Identifier: Apache-2.0 */
/* drive/servo_loop.h: the servo tick: read the drive, one servo_step(), write the drive. The only place where the step order stands.
 *
 * servo_loop_tick() runs in the servo interrupt (CONTROL_HZ), everything else in the background loop. They meet in
 * - struct servo_loop_command: single words, background writes;
 * - two configurations, of which the one in use is number `configured`, which counts, modulo 2;
 * - the ring of knots (one writer, one reader);
 * - four records, of which one is published each millisecond, which the background scales to a snapshot, while the tick
 *   fills the next one, three milliseconds before it comes to that one again; and `faults`, bits that the
 *   tick sets and the background clears, once it has taken them.
 */
#ifndef KONTUR_LOOP_H
#define KONTUR_LOOP_H
#include <stdatomic.h>

#include "drive/configuration.h"
#include "hal/hal.h"
#include "motion/path_clock.h"
#include "onchip/onchip_plant.h"
#include "scope/scope.h"
#include "supervision/fault.h"
#include "supervision/servo_snapshot.h"

struct servo_loop_cfg {
    struct servo_cfg servo;
    uint32_t encoder_10fm[2];     /* length of one encoder count, 10 fm */
    num following_max[2];         /* um */
    uint32_t following_ticks[2];  /* periods that it may be exceeded for */
    num speed_max;                /* um/T0 */
    int32_t min_nm[2], max_nm[2]; /* user's positions */
    num stop_time;                /* knots (ms) */
    uint32_t jump_counts[2];      /* of an encoder in one period: more are no movement */
    uint32_t cut, stop;           /* FAULT_BIT()s after which power is off at once, or path time slows to a stop */
    struct onchip_plant_cfg onchip_plant;
};

/* Each other's complement: no bit that turns over makes one of the other. */
#define SERVO_LOOP_ON 0x5AC369F0u
#define SERVO_LOOP_OFF 0xA53C960Fu

struct servo_loop_command {
    _Atomic uint32_t
        powered[2];   /* SERVO_LOOP_ON: power stage on, law active; anything but SERVO_LOOP_OFF beside it is an error */
    _Atomic bool run; /* path time may run */
    _Atomic uint16_t rate; /* ... at this rate, 1/1000, up to 1000 PATH_RATE_MAX; 0: it stands */
    _Atomic bool complete; /* all knots of the stream are in the ring */
    _Atomic bool rest;     /* not known to be complete, but it may end where its knots do: they stand */
    _Atomic uint8_t controller;
    _Atomic uint32_t begin; /* counts up: path time starts anew at 0 */
    _Atomic uint32_t configured;
    _Atomic bool energy_reset;
    _Atomic int32_t origin_nm[2]; /* user's position less the servo's: for the limits only */
};

/* The same as the tick leaves it, in core units: the newest in `published % SERVO_LOOP_RECORDS`. */
#define SERVO_LOOP_RECORDS 4u
struct servo_loop_record {
    uint32_t ms;
    struct servo_out out; /* where the servo puts it in each period */
    pos_t position[2];
    int32_t energy_mJ[2];
    num friction[2], mass[2];
    pos_t measured[2];
    int32_t since_index[2]; /* counts */
    int32_t edge_nm[2], count[2];
    uint8_t index_pulses[2], inputs[2];
    struct contour_statistics error;
    num rate;
    uint8_t controller;
};

struct servo_loop {
    const struct hal *hal;
    const struct spline_ring *ring;
    struct servo_loop_command command;
    _Atomic uint32_t faults;    /* FAULT_BIT()s */
    _Atomic uint8_t first;      /* ... the first one of them, enum fault */
    _Atomic uint32_t begun;     /* command.begin that the next four words belong to */
    _Atomic bool standing;      /* path time does not run */
    _Atomic bool at_end;        /* ... since it has reached the end of a complete stream, or of one that may rest */
    _Atomic bool starved;       /* path time is slowed for want of knots */
    _Atomic uint32_t executed;  /* knots passed */
    _Atomic uint32_t published; /* records so far: one a millisecond */

    /* the tick's own */
    uint32_t configured;              /* taken over so far */
    const struct servo_loop_cfg *use; /* that one */
    struct servo_loop_record *next;   /* to be published */
    _Atomic uint32_t ticks;           /* control periods since power-on */
    uint32_t late[2];                 /* periods since the following error is too large */
    uint8_t inputs[2];                /* of the last period */
    bool simulated;
    struct path_clock path;
    struct servo_loop_encoder {
        int32_t last;  /* as read */
        int32_t moved; /* in the last period */
        int64_t count; /* since power-on */
        pos_t pos;     /* count times the length of one, and 2^-32 of its unit */
        uint32_t rest;
        uint32_t length;     /* of one count, in the same way, */
        int32_t length_rest; /* to the nearest */
    } encoder[2];
    struct servo_state servo;
    num rate;                         /* command.rate when it was not 1 last, as a num */
    uint16_t permille;                /* ... as it was given */
    struct onchip_plant onchip_plant; /* in place of the real one while cfg.machine.simulated */
    pos_t lowest[2], highest[2]; /* user's positions beyond which an axis may trip: the soft limits and following_max */
    int32_t edge_nm[2];
    struct contour_statistics error;

    struct servo_loop_cfg cfg[2];
    struct servo_loop_record record[SERVO_LOOP_RECORDS];
    struct servo_snapshot snapshot; /* the background's own */
    struct scope scope;             /* last: the largest */
};

/* A configuration must be set up before the first tick. Positions are encoder counts times their length. */
void servo_loop_init(struct servo_loop *loop, const struct hal *hal, const struct spline_ring *ring);
void servo_loop_tick(struct servo_loop *loop);
/* A fault has been seen; until loop->faults is cleared. Any context. */
void servo_loop_raise(struct servo_loop *loop, enum fault f);
/* The newest snapshot. Background only. */
const struct servo_snapshot *servo_loop_snapshot(struct servo_loop *loop);
#endif
