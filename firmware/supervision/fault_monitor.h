/* SPDX-License-Identifier: Apache-2.0 */
/* supervision/fault_monitor.h: what is looked at once a millisecond, since it has to last before it matters, or is not the tick's to know.
 * Background only. What is too urgent for this is in drive/servo_loop.c. Rows and times: supervision/faults.toml. */
#ifndef KONTUR_WATCH_H
#define KONTUR_WATCH_H
#include <stdbool.h>

#include "supervision/fault.h"
#include "supervision/servo_snapshot.h"

enum { FAULT_MONITOR_EVENT_MS = 1000 }; /* how long what happens in a moment is warned of */

struct fault_monitor {
    uint32_t ms;               /* of the last snapshot */
    uint32_t passed_ms;        /* since the one before: more than 1 when the background is late */
    uint16_t lasts_ms[FAULTS]; /* how long a condition has held; of events: how long they still count */
    uint16_t frozen_ms[2], full_ms[2];
    int32_t count[2]; /* where an encoder stood when frozen_ms began */
    uint32_t rejected;
    uint32_t now; /* FAULT_BIT()s that hold */
};

struct fault_monitor_in {
    const struct od_data *od;
    const struct servo_snapshot *snapshot;
    const bool *powered; /* [2] */
    bool refused;        /* an axis that moves is to be enabled */
    bool store_lost;
};

/* With each snapshot; more often does nothing. Returns the FAULT_BIT()s that hold now. */
uint32_t fault_monitor_step(struct fault_monitor *w, const struct fault_monitor_in *in);
/* Something has happened that is warned of for a second: FAULT_STREAM, FAULT_CONFIG_ENABLED, FAULT_SECOND_MASTER, FAULT_STALE_COMMAND. */
void fault_monitor_event(struct fault_monitor *w, enum fault f);
#endif
