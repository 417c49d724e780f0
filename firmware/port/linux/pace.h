/* SPDX-License-Identifier: Apache-2.0 */
/* pace.h: how much device time may pass, in control periods. Arithmetic alone: the clock is the caller's.
 *
 * By the wall clock, device time follows it without drift: what is due is counted from a start that stays. A process
 * that was not let run makes up for as much as PACE_CATCH_UP_MS; what goes beyond is lost to the device, and counted.
 */
#ifndef KONTUR_PACE_H
#define KONTUR_PACE_H
#include <stdbool.h>
#include <stdint.h>

enum { PACE_CATCH_UP_MS = 200 };
enum { PACE_WIRE_HZ = 5000 }; /* a frame, and one that it answers, take 1/5000 s at 1 Mbit/s */

struct pace {
    uint32_t hz;        /* control periods a second */
    uint64_t start_ns;  /* wall clock at the device's power-on, moved by what was lost */
    uint64_t lost_ms;   /* device time given up since the start, rounded up at each time */
    uint32_t rest;      /* SYNC: what its periods left over, in us * hz */
    uint64_t wire_free; /* tick from which the next frame can have come */
};

void pace_init(struct pace *pace, uint32_t hz, uint64_t now_ns);
/* Periods that are due at `now_ns` when `tick` have passed since power-on. */
uint32_t pace_due(struct pace *pace, uint64_t now_ns, uint64_t tick);
/* A frame to the device or from it at `tick`; whether another one can have come by `tick`. */
void pace_frame(struct pace *pace, uint64_t tick);
bool pace_wire_free(const struct pace *pace, uint64_t tick);
/* Nanoseconds from `now_ns` until it can have. */
uint64_t pace_wire_ns(const struct pace *pace, uint64_t now_ns);
/* Periods in the next `us` microseconds; what is left of a period is carried over to the next call. */
uint32_t pace_sync(struct pace *pace, uint32_t us);
#endif
