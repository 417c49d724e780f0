/* SPDX-License-Identifier: Apache-2.0 */
/* drive/servo_loop.h: the servo tick: read the drive, call servo_step() once, write the drive. No other module knows
 * the order of these steps.
 *
 * Context: the port calls servo_loop_tick() in the servo interrupt (CONTROL_HZ), through device_tick(). All other
 * functions are the background's; servo_loop_raise() is everyone's. Tick and background share
 * - struct servo_loop_command: single words, which the background writes;
 * - flags: single words, which the tick writes. Of `faults` the tick sets bits, and the background clears them when it
 *   has handled them;
 * - two configurations: the one in use is number `command.configured` modulo 2, and the background fills the other one;
 * - the ring of knots, which has one writer and one reader;
 * - four records of telemetry. One is published each millisecond, and the background scales it to the snapshot while
 * the
 *   tick fills the next one. The tick comes back to it three milliseconds later.
 */
#ifndef KONTUR_SERVO_LOOP_H
#define KONTUR_SERVO_LOOP_H
#include <stdatomic.h>

#include "core/excitation.h"
#include "core/servo.h"
#include "drive/encoder.h"
#include "drive/telemetry.h"
#include "hal/hal.h"
#include "motion/path_clock.h"
#include "onchip/onchip_plant.h"
#include "scope/scope.h"
#include "supervision/fault.h"
#include "supervision/servo_snapshot.h"

struct servo_loop_cfg {
    uint32_t encoder_10fm[2];    /* length of one encoder count, 10 fm */
    uint32_t second_10fm[2];     /* of a second encoder; 0: none */
    uint32_t following_ticks[2]; /* periods for which following_max may be exceeded */
    num speed_max;               /* um/T0 */
    num stop_time;               /* knots (ms) */
    uint32_t jump_counts[2];     /* encoder counts in one period that are no movement if exceeded */
    uint8_t ready[2];            /* HAL_AMPLIFIER_FAULT if only a live amplifier has no fault, else 0 */
    /* These words the background may change in the configuration in use. Any mixture of old and new ones will do. */
    num following_max[2];         /* largest following error, um */
    int32_t min_nm[2], max_nm[2]; /* software position limits, of the user's zero */
    uint32_t cut, stop;           /* FAULT_BIT()s that cut the power at once, or that stop path time */
    struct onchip_plant_cfg onchip_plant;
    struct servo_cfg servo; /* last, since it is the largest */
};

/* Any two differ in 16 bits or more: no single flipped bit makes one of another. */
#define SERVO_LOOP_ON 0x5AC369F0u
#define SERVO_LOOP_OFF 0xA53C960Fu
#define SERVO_LOOP_STARTING 0x5AC3960Fu
#define SERVO_LOOP_BRAKED 0xA53C69F0u

/* An axis is excited; no single flipped bit makes it of 0. */
#define SERVO_LOOP_EXCITE 0x3CA50F96u

/* Axes whose force is command.force_mN; 0: none. Any two differ in 16 bits or more, and one with a bit that has flipped
 * is taken for none of the axis. */
#define SERVO_LOOP_FORCED_X 0x0000FFFFu
#define SERVO_LOOP_FORCED_Y 0xFFFF0000u

struct servo_loop_command {
    /* SERVO_LOOP_ON: power stage on, law active, brake released; BRAKED: the same with the brake engaged; STARTING:
     * power stage on, no force, brake engaged; else off. A value that is none of these and not OFF is an error. */
    _Atomic uint32_t powered[2];
    _Atomic bool run;               /* path time may run */
    _Atomic uint16_t rate;          /* rate of path time if it may run: 1/1000, 0 to 1000 PATH_RATE_MAX */
    _Atomic bool complete;          /* all knots of the stream are in the ring */
    _Atomic bool may_end;           /* the stream is open-ended, and its last knots are equal: it may end there */
    _Atomic uint8_t controller;     /* enum controller */
    _Atomic uint16_t kept;          /* digital outputs that stay as they are while the path does not run */
    _Atomic uint32_t released;      /* the knot, plus 1, at whose hold the path may go on; 0: none */
    _Atomic uint32_t stream;        /* number of the stream: path time starts from 0 when it changes */
    _Atomic uint32_t configured;    /* number of the configuration: the tick uses the new one when it changes */
    _Atomic bool range;             /* keep the range of the contour error */
    _Atomic bool energy_reset;      /* the tick clears it */
    _Atomic bool oscillation_reset; /* the tick clears it */
    _Atomic int32_t origin_nm[2];   /* user's position less the servo's: for the limits and the geometry */
    _Atomic uint32_t forced;        /* SERVO_LOOP_FORCED_X, _Y or both: the force is not the law's but */
    _Atomic int32_t force_mN[2];    /* this one, within the limits; not while a fault stops the axes */
    _Atomic uint32_t excite;        /* SERVO_LOOP_EXCITE, else not; the tick clears it at the end */
};

enum excitation_status { EXCITATION_NEVER, EXCITATION_RUNS, EXCITATION_DONE, EXCITATION_ENDED, EXCITATION_AT_LIMIT };

/* The tick's while command.excite is set, else the background's. */
struct servo_loop_excitation {
    struct excitation_cfg cfg;
    struct excitation_state state;
    int32_t second_count;   /* of the second encoder, in the last period */
    _Atomic uint8_t status; /* enum excitation_status */
};

struct servo_loop {
    const struct hal *hal; /* the port's */
    const struct spline_ring *ring;
    struct servo_loop_command command;

    /* flags of the tick */
    _Atomic uint32_t faults;    /* FAULT_BIT()s */
    _Atomic uint8_t first;      /* enum fault: the first one of `faults` */
    _Atomic uint32_t stream;    /* number of the stream that the next four words describe */
    _Atomic bool standing;      /* path time does not run */
    _Atomic bool at_end;        /* path time has reached the end of a stream that is complete or may end there */
    _Atomic bool starved;       /* path time is slowed because knots are missing */
    _Atomic uint32_t executed;  /* knots passed */
    _Atomic uint32_t hold;      /* the knot, plus 1, at which path time is held; 0: it is not */
    _Atomic uint32_t outputs;   /* those beside the axes as they were written: digital, and 65536 power */
    _Atomic uint32_t published; /* records so far, modulo 2^32: one a millisecond */
    _Atomic uint32_t ticks;     /* control periods since power-on, modulo 2^32 */

    /* state of the tick */
    uint32_t configured; /* command.configured of the configuration in use */
    const struct servo_loop_cfg *cfg_in_use;
    const struct hal *io; /* what the tick reads and writes: the port's HAL, or the plant on the chip */
    struct onchip_hal onchip;
    struct encoder encoder[2];
    uint8_t inputs[2]; /* enum hal_input of the last period */
    uint8_t phase;     /* control periods since the last record was published */
    struct path_clock path;
    uint16_t rate_permille; /* the latest command.rate other than 1000 */
    num rate;               /* the same as a num */
    struct servo_state servo;
    uint32_t following_ticks[2];     /* periods since the following error is too large */
    struct telemetry_record *record; /* to be published next */
    struct contour_statistics contour_statistics;
    struct contour_range contour_range; /* of this millisecond */
    struct encoder second[2];           /* counts from 0 at power-on, where its position was the first one's */
    int32_t first_count[2];             /* that stood at this */
    struct servo_loop_excitation excitation;

    struct servo_loop_cfg cfg[2];
#define SERVO_LOOP_RECORDS 4u
    struct telemetry_record records[SERVO_LOOP_RECORDS]; /* the newest: `published % SERVO_LOOP_RECORDS` */
    struct servo_snapshot snapshot;                      /* the background's own */
    struct scope scope;                                  /* last, since it is the largest */
};

/* Power-on. A configuration must be in cfg[0] before the first tick. Positions are encoder counts times their
 * length. */
void servo_loop_init(struct servo_loop *loop, const struct hal *hal, const struct spline_ring *ring);
/* One control period. */
void servo_loop_tick(struct servo_loop *loop);
/* Raise a fault: it is in effect until its bit in loop->faults is cleared. Any context. */
void servo_loop_raise(struct servo_loop *loop, enum fault f);
/* The newest snapshot. Background only. */
const struct servo_snapshot *servo_loop_snapshot(struct servo_loop *loop);
/* How far path time has come. Background only. */
struct path_progress servo_loop_progress(const struct servo_loop *loop);
/* Whether the tick works on the plant on the chip. Any context. */
static inline bool servo_loop_simulated(const struct servo_loop *loop)
{
    return loop->io != loop->hal;
}
#endif
