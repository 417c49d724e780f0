/* SPDX-License-Identifier: Apache-2.0 */
/* scope/scope.h: up to SCOPE_CHANNELS signals of the servo, each control period or each so many, around a trigger.
 *
 * scope_step() runs in the servo tick, everything else in the background, which the tick interrupts and never the other
 * way round. While `runs`, what is the tick's is its own; the background may end that at any time. A capture that is done
 * is not written again before the scope is armed.
 *
 * Frames go round in one half of the memory until the trigger, and then on until those before it are the share asked
 * for. A fault triggers always, whatever else is waited for, and a level only once the frames before it are there. When a
 * capture is done that has no fault in it, frames go round in the other half, for the fault that may still come: its
 * capture takes the place of the first one. Armed for faults at power-on (2300h, 2301h as they are by default: 500 ms
 * before, 130 ms after), and again when a fault whose capture it holds is reset, or the axes get power. docs/scope.md has
 * the layout of what is read.
 */
#ifndef KONTUR_SCOPE_H
#define KONTUR_SCOPE_H
#include <stdatomic.h>

#include "core/num.h"
#include "od/od.h"
#include "scope/signal_gen.h"

enum { SCOPE_SAMPLES = 4096, SCOPE_CHANNELS = 8, SCOPE_HEADER = 32, SCOPE_VERSION = 1 };

enum scope_state { SCOPE_OFF, SCOPE_WAITING, SCOPE_TRIGGERED, SCOPE_DONE };              /* 2300h:2 */
enum scope_trigger { SCOPE_NOW, SCOPE_FAULT, SCOPE_RISING, SCOPE_FALLING };              /* 2300h:4 */
enum scope_command { SCOPE_COMMAND_ARM = 1, SCOPE_COMMAND_DEFAULTS, SCOPE_COMMAND_OFF }; /* 2300h:1 */

/* Where a signal is in the tick, and what it is: one row of scope/signals.toml. */
enum scope_base {
    SCOPE_BASE_OUT,   /* struct servo_out */
    SCOPE_BASE_SERVO, /* struct servo_state */
    SCOPE_BASE_PATH,  /* struct path_state */
    SCOPE_BASE_IN,    /* struct hal_drive_in */
    SCOPE_BASE_SCOPE, /* struct scope */
    SCOPE_BASES
};
enum scope_kind { SCOPE_NONE, SCOPE_NUM, SCOPE_ACC, SCOPE_POS, SCOPE_REFERENCE, SCOPE_PATH, SCOPE_I32, SCOPE_U8 };
struct scope_signal {
    uint8_t kind, base, axis;
    uint16_t offset;
    int32_t scale; /* counts of one unit of the core: num, acc */
};
extern const struct scope_signal scope_signals[SIGNALS];

struct scope_capture {
    uint32_t next, filled;            /* frame to write, frames written: at most capacity */
    uint32_t after;                   /* frames since the trigger, its own one included */
    uint32_t last_tick, trigger_tick; /* control periods since power-on */
    uint32_t cause;                   /* faults and warnings that triggered; 0: something else */
    uint32_t sample[SCOPE_SAMPLES];
};

struct scope {
    _Atomic bool runs;
    _Atomic uint8_t state;
    _Atomic uint32_t told;   /* faults that the background has raised */
    _Atomic uint32_t warned; /* ... and warnings */
    uint32_t faults, raised; /* of the last period, and which of them are new in it: the tick's, running or not */

    /* set while it does not run */
    struct scope_signal signal[SCOPE_CHANNELS], source;
    uint8_t number[SCOPE_CHANNELS];
    uint8_t channels;
    uint16_t periods;      /* from frame to frame */
    uint32_t capacity;     /* frames in all */
    uint32_t before_fault; /* ... wanted before a fault that comes after a capture */
    uint32_t level;        /* as `source` is sampled */
    uint32_t serial;       /* captures so far */
    uint32_t reading;      /* ... the one that is being read, */
    uint8_t read_half;     /* which is here */

    /* the tick's */
    uint8_t trigger;
    uint32_t before;         /* frames wanted before the trigger */
    uint16_t wait;           /* periods until the next frame */
    bool primed, above;      /* a level has been compared, and how */
    bool of_fault;           /* there has been a fault since it was armed */
    uint8_t recording, done; /* halves: with the frames to come, with the capture that is done */
    struct scope_capture half[2];
};

/* In the servo tick, last: whether scope_step() has something to do. faults: FAULT_BIT()s. */
static inline bool scope_runs(struct scope *s, uint32_t faults)
{
    s->raised = faults & ~s->faults;
    s->faults = faults;
    return atomic_load_explicit(&s->runs, memory_order_relaxed);
}
/* base: struct loop, struct servo_out; tick: number of the control period. */
void scope_step(struct scope *s, const void *const base[SCOPE_BASES], uint32_t tick);

/* Start anew with what 2300h and 2301h say; what was captured is gone. origin_nm: 2300h level of a position less the
 * servo's. false: no channel, or no source of a level. */
bool scope_arm(struct scope *s, const struct od_data *od, const int32_t origin_nm[2]);
void scope_off(struct scope *s);
/* The background has raised these faults. */
void scope_fault(struct scope *s, uint32_t faults);
/* ... warns of these: no trigger for who waits for something else, or has triggered. */
void scope_warning(struct scope *s, uint32_t warnings);
/* It holds, or is about to hold, what led to a fault or a warning. */
bool scope_holds_fault(const struct scope *s);
/* What 2300h tells of it. */
void scope_report(const struct scope *s, struct od_data *od);
/* Bytes of 2302h; 0 while there is no capture. Reading begins. */
uint32_t scope_size(struct scope *s);
/* `count` of them from `at` on; false when the capture that scope_size() told of is gone. origin_nm: user's positions
 * less the servo's. */
bool scope_read(const struct scope *s, uint32_t at, uint8_t *to, uint32_t count, const int32_t origin_nm[2]);
#endif
