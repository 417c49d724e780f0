/* SPDX-License-Identifier: Apache-2.0 */
/* motion/sync_clock.h: the master's time, in cycles of its SYNC, from SYNCs that come up to 30 % of a cycle early or late.
 *
 * A SYNC is that of the whole cycle which is nearest by the time estimated so far. So one that is lost is known by the
 * time of the next, and of a burst that a gateway held back all belong to the present cycle. Phase and frequency follow
 * the SYNCs by recursive least squares; from SYNC_MEMORY SYNCs on the gains stay (an alpha-beta filter, critically
 * damped).
 *
 * Pure, background only; cyclic.c uses it. Cycles are Q32.
 */
#ifndef KONTUR_SYNC_CLOCK_H
#define KONTUR_SYNC_CLOCK_H
#include <stdbool.h>
#include <stdint.h>

#define SYNC_CYCLE ((int64_t)1 << 32)

enum {
    SYNC_MEMORY = 128,  /* SYNCs by which phase and frequency are known at most */
    SYNC_LOCKED = 4,    /* SYNCs after which the time can be used */
    SYNC_DRIFT = 200,   /* the master's clock differs by less than 1 / SYNC_DRIFT */
    SYNC_GONE_AFTER = 8 /* cycles without SYNC after which the time is estimated anew */
};

struct sync_clock {
    uint32_t count;  /* SYNCs since there was none, at most SYNC_MEMORY; 0: none */
    uint32_t cycle;  /* number of the latest SYNC's cycle, modulo 2^32 */
    uint32_t period; /* nominal length of a cycle, control periods */
    uint32_t at;     /* control period of the latest SYNC */
    int64_t late;    /* time estimated at `at`, less `cycle` */
    int64_t drift;   /* of the estimated frequency from the nominal one, a part of it */
};

/* A SYNC comes in control period `now`; the nominal cycle has `period` of them, 1..400. */
void sync_clock_sync(struct sync_clock *c, uint32_t now, uint32_t period);
/* Cycles from c->cycle to the control period `now`, which is not before the latest SYNC. */
int64_t sync_clock_since(const struct sync_clock *c, uint32_t now);
/* Whether SYNCs come, and the time is known. */
bool sync_clock_locked(const struct sync_clock *c, uint32_t now);
#endif
