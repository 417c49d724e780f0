/* SPDX-License-Identifier: Apache-2.0 */
/* pace.h: how much device time may pass, in control periods. Arithmetic alone: the clock is the caller's.
 *
 * By the wall clock, device time follows it without drift: what is due is counted from a start that stays. A process
 * that was not let run makes up for as much as PACE_CATCH_UP_MS; what goes beyond is lost to the device, and counted.
 */
#ifndef KONTUR_PACE_H
#define KONTUR_PACE_H
#include <stdint.h>

enum { PACE_CATCH_UP_MS = 200 };

struct pace {
    uint32_t hz;        /* control periods a second */
    uint64_t start_ns;  /* wall clock at the device's power-on, moved by what was lost */
    uint64_t lost_ms;   /* device time given up since the start, rounded up at each time */
    uint32_t rest;      /* SYNC: what its periods left over, in us * hz */
};

void pace_init(struct pace *pace, uint32_t hz, uint64_t now_ns);
/* Periods that are due at `now_ns` when `tick` have passed since power-on. */
uint32_t pace_due(struct pace *pace, uint64_t now_ns, uint64_t tick);
/* Periods in the next `us` microseconds; what is left of a period is carried over to the next call. */
uint32_t pace_sync(struct pace *pace, uint32_t us);
#endif
