/* SPDX-License-Identifier: Apache-2.0 */
/* scope/scope.h: the scope records up to SCOPE_CHANNELS signals of the servo around a trigger.
 *
 * Contexts: scope_runs() and scope_step() are called by the servo tick, all other functions by the background (drive.c and
 * device_objects.c). While `runs` is set, the members of the tick belong to the tick. The background may clear `runs` at
 * any time; the tick is never interrupted by it.
 *
 * A frame has one sample of each signal. Frames go round in one half of the memory until the trigger comes. After it,
 * frames are recorded until the share of the memory that is not reserved for the time before the trigger is full.
 * A fault triggers in every mode. A level triggers only when the frames before it are there.
 * A capture that is done stays until the scope is armed again, with one exception: a capture without a fault in it is
 * followed by frames in the other half of the memory, and the capture of a later fault replaces it.
 *
 * The scope is armed for faults at power-on (with the defaults of 2300h and 2301h: 500 ms before, 130 ms after). It is
 * armed again when the fault of its capture is reset, and when the axes get power. docs/scope.md has the layout of 2302h.
 */
#ifndef KONTUR_SCOPE_H
#define KONTUR_SCOPE_H
#include <stdatomic.h>

#include "core/num.h"
#include "od/od.h"
#include "scope/signal_gen.h"

enum { SCOPE_SAMPLES = 6144, SCOPE_CHANNELS = 8, SCOPE_HEADER = 32, SCOPE_VERSION = 1 };

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
    _Atomic uint32_t background_faults;   /* FAULT_BIT()s that the background has raised since the scope was armed */
    _Atomic uint32_t background_warnings; /* the same of warnings */
    uint32_t faults; /* FAULT_BIT()s of the last period; the tick writes them even if `runs` is 0 */
    uint32_t raised; /* FAULT_BIT()s that are new in this period */

    /* Settings, written by the background while `runs` is 0. */
    struct scope_signal signal[SCOPE_CHANNELS], source;
    uint8_t number[SCOPE_CHANNELS];
    uint8_t channels;
    uint16_t periods;      /* control periods from frame to frame */
    uint32_t capacity;     /* frames in a half */
    uint32_t before_fault; /* frames wanted before a fault that follows a capture */
    uint32_t level;        /* trigger level, in the form of a sample of `source` */
    uint32_t serial;       /* number of the capture; it changes when the scope is armed */
    uint32_t reading;      /* `serial` of the capture that is being read */
    uint8_t read_half;     /* the half that it is in */

    /* Members of the tick. */
    uint8_t trigger;
    uint32_t before;         /* frames wanted before the trigger */
    uint16_t wait;           /* periods until the next frame */
    bool primed, above;      /* a level has been compared once; it was above then */
    bool of_fault;           /* a fault has come since the scope was armed */
    uint8_t recording, done; /* the half that frames go to; the half of the capture that is done */
    struct scope_capture half[2];
};

/* Servo tick, at its end: store the faults (FAULT_BIT()s). Returns whether scope_step() is to be called. */
static inline bool scope_runs(struct scope *s, uint32_t faults)
{
    s->raised = faults & ~s->faults;
    s->faults = faults;
    return atomic_load_explicit(&s->runs, memory_order_relaxed);
}
/* Servo tick: record and trigger. base: the structs of enum scope_base; tick: number of the control period. */
void scope_step(struct scope *s, const void *const base[SCOPE_BASES], uint32_t tick);

/* Arm with the settings of 2300h and 2301h; an earlier capture is discarded. origin_nm: the user's position less the
 * servo's, for a level of a position. Returns false when 2301h has no channel, or a level has no source. */
bool scope_arm(struct scope *s, const struct od_data *od, const int32_t origin_nm[2]);
/* Stop recording and discard the capture. */
void scope_off(struct scope *s);
/* Report faults that the background has raised. */
void scope_fault(struct scope *s, uint32_t faults);
/* Report warnings of the background. A warning triggers only a scope that waits for a fault. */
void scope_warning(struct scope *s, uint32_t warnings);
/* Whether a fault or a warning triggered the capture (done or under way), or a fault occurred during it. */
bool scope_holds_fault(const struct scope *s);
/* Write state, frames and time of the trigger to 2300h. */
void scope_report(const struct scope *s, struct od_data *od);
/* Select the capture to read as 2302h. Returns its size in bytes, 0 while no capture is done. */
uint32_t scope_size(struct scope *s);
/* Copy `count` bytes of 2302h from `at` on. Returns false when the scope was armed since scope_size(). origin_nm: the
 * user's positions less the servo's. */
bool scope_read(const struct scope *s, uint32_t at, uint8_t *to, uint32_t count, const int32_t origin_nm[2]);
#endif
