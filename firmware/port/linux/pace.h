/* SPDX-License-Identifier: Apache-2.0 */
/* pace.h: how many control periods of device time are due. It is arithmetic alone: the caller reads the clock.
 *
 * By the wall clock, device time follows without drift, because the periods due are
 * counted from a fixed start. A process that did not get the processor catches up
 * by PACE_CATCH_UP_MS at most; time beyond that is lost to the device, and counted.
 *
 * Context: the loop of the process kontur-sim (main.c) calls it.
 */
#ifndef KONTUR_PACE_H
#define KONTUR_PACE_H
#include <stdbool.h>
#include <stdint.h>

enum { PACE_CATCH_UP_MS = 200 };
enum { PACE_FRAME_HZ = 5000 }; /* a frame and the frame that it answers take 1/5000 s at 1 Mbit/s */

struct pace {
    uint32_t hz;        /* control periods a second */
    uint64_t start_ns;  /* wall clock at the device's power-on, moved on by the time lost */
    uint64_t lost_ms;   /* device time lost since the start, each loss rounded up */
    uint32_t remainder; /* paced by SYNC: the fraction of a period that has passed, in us * hz */
    uint64_t bus_free;  /* tick from which another frame can have come */
};

void pace_init(struct pace *pace, uint32_t hz, uint64_t now_ns);
/* Periods that are due at `now_ns` when `tick` periods have passed since power-on. */
uint32_t pace_due(struct pace *pace, uint64_t now_ns, uint64_t tick);
/* A frame has come to the device, or gone from it, at `tick`. */
void pace_frame(struct pace *pace, uint64_t tick);
/* Whether another frame can have come by `tick`. */
bool pace_bus_free(const struct pace *pace, uint64_t tick);
/* Nanoseconds from `now_ns` until another frame can have come. */
uint64_t pace_bus_wait_ns(const struct pace *pace, uint64_t now_ns);
/* Periods that pass in the next `us` microseconds. The fraction of a period is carried over to the next call. */
uint32_t pace_sync(struct pace *pace, uint32_t us);
#endif
