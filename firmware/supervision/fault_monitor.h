/* SPDX-License-Identifier: Apache-2.0 */
/* supervision/fault_monitor.h: the checks that run once a millisecond. They detect conditions that must last before they are
 * a fault, and those that the servo tick does not know. drive/servo_loop.c checks what is more urgent. Rows and times are
 * those of supervision/faults.toml.
 *
 * Pure, background only. drive.c steps it; events come from drive.c and device_objects.c.
 */
#ifndef KONTUR_FAULT_MONITOR_H
#define KONTUR_FAULT_MONITOR_H
#include <stdbool.h>

#include "supervision/fault.h"
#include "supervision/servo_snapshot.h"

enum { FAULT_MONITOR_EVENT_MS = 1000 }; /* duration of the warning of an event */

struct fault_monitor {
    uint32_t ms;               /* of the last snapshot */
    uint32_t passed_ms;        /* since the one before: more than 1 when the background is late */
    uint16_t lasts_ms[FAULTS]; /* how long a condition has held; of an event: how long its warning still lasts */
    uint16_t frozen_ms[2], saturated_ms[2];
    bool hot[2];             /* the heat has been at HEAT_WARNING, and is not below HEAT_COOLED yet */
    int32_t count[2];        /* of the encoder when frozen_ms began */
    int32_t oscillations[2]; /* of each axis so far */
    uint32_t rejected;       /* knot frames of the stream so far */
    uint32_t now;            /* FAULT_BIT()s that hold */
};

struct fault_monitor_in {
    const struct od_data *od;
    const struct servo_snapshot *snapshot;
    const bool *powered;     /* [2] */
    bool enable_refused;     /* an axis is to be enabled while one without power moves */
    bool parameters_invalid; /* stored parameters could not be used */
};

/* Check one snapshot; a second call with the same one changes nothing. Returns the FAULT_BIT()s that hold now. */
uint32_t fault_monitor_step(struct fault_monitor *m, const struct fault_monitor_in *in);
/* Report an event, which causes a warning of one second: FAULT_STREAM, FAULT_CONFIG_ENABLED, FAULT_SECOND_MASTER,
 * FAULT_STALE_COMMAND, or FAULT_OSCILLATION where it is a warning. */
void fault_monitor_event(struct fault_monitor *m, enum fault f);
#endif
