/* SPDX-License-Identifier: Apache-2.0 */
/* watch.h: what is looked at once a millisecond, since it has to last before it matters, or is not the tick's to know.
 * Background only. What is too urgent for this is in loop.c. Rows and times: faults.toml. */
#ifndef KONTUR_WATCH_H
#define KONTUR_WATCH_H
#include <stdbool.h>

#include "fault.h"
#include "loop.h"

enum { WATCH_EVENT_MS = 1000 }; /* how long what happens in a moment is warned of */

struct watch {
    uint32_t ms;                     /* of the last snapshot */
    uint32_t passed_ms;              /* since the one before: more than 1 when the background is late */
    uint16_t lasts_ms[FAULTS];       /* how long a condition has held; of events: how long they still count */
    uint16_t frozen_ms[2], full_ms[2];
    int32_t count[2];                /* where an encoder stood when frozen_ms began */
    uint32_t rejected;
    uint32_t now;                    /* FAULT_BIT()s that hold */
};

struct watch_in {
    const struct od_data *od;
    const struct loop_snapshot *snapshot;
    const bool *powered;             /* [2] */
    bool refused;                    /* an axis that moves is to be enabled */
    bool store_lost;
};

/* With each snapshot; more often does nothing. Returns the FAULT_BIT()s that hold now. */
uint32_t watch_step(struct watch *w, const struct watch_in *in);
/* Something has happened that is warned of for a second: FAULT_STREAM, FAULT_CONFIG_ENABLED, FAULT_SECOND_MASTER, FAULT_STALE_COMMAND. */
void watch_event(struct watch *w, enum fault f);
#endif
