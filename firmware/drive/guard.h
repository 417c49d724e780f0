/* SPDX-License-Identifier: Apache-2.0 */
/* guard.h: who may command (2140h, 2141h), and whether a command to enable may be an answer to what the drive is now.
 * Background only. Why: docs/adr/0019.
 *
 * One master holds the drive, by the node id of its heartbeat. CAN data frames have no sender, so what is protected is what can
 * be: nobody else can claim, and an axis is enabled only
 * - by a controlword that came GUARD_PERIODS after a statusword had told the axis' present state, and after the last one
 *   that did not enable it: what comes in one go is an answer to nothing, however long it is. The time counts from when
 *   all frames had been handled that had come before the statusword went;
 * - if the drive is held, after the ticket of the moment was written back: once, for GUARD_ARM_MS. A replay has an old one.
 * Nothing here keeps anybody from stopping or switching off.
 */
#ifndef KONTUR_GUARD_H
#define KONTUR_GUARD_H
#include <stdbool.h>
#include <stdint.h>

#include "params.h"

/* Less than a statusword and the answer to it take on the wire, at 1 Mbit/s, more than lies between the frames of a burst */
#define GUARD_PERIODS (2u * CONTROL_HZ / 10000u)
#define GUARD_ARM_MS 1000u

struct guard {
    uint8_t holder;       /* node id, 0 nobody */
    uint32_t key;         /* ... and what it claimed with: tells it from another one with the same id; 0: none */
    bool lost;            /* ... and its heartbeat has ceased: it holds on until no axis has power */
    bool drawn, armed;    /* a ticket is out; was written back */
    uint32_t ticket;
    uint32_t armed_at;    /* servo periods */
    struct guard_axis {
        uint32_t sent, told; /* cia402.changes that a statusword went out for; ... before the last frame came */
        uint32_t told_at;    /* servo periods */
    } axis[2];
};

/* Nobody holds it, no state has been told. */
void guard_reset(struct guard *g);
/* 2140h claim: 1..127 claims, 0 releases what has the same key; neither while an axis has power: false. The holder may say
 * it again, if it has a key: its answer may have been lost. */
bool guard_claim(struct guard *g, uint8_t id, uint32_t key, bool powered);
/* The holder's heartbeat has ceased. */
void guard_lost(struct guard *g);
/* Each millisecond: a ticket that was not used in its time is over. true: the claim of a holder that was lost has ended. `now`:
 * servo periods, as below. */
bool guard_ended(struct guard *g, bool powered, uint32_t now);
/* 2140h ticket is read, arm is written (false: another ticket, or nobody holds the drive). The same one may come again, since its
 * answer was lost, until it is used or over; a new one alone gives more time. */
uint32_t guard_draw(struct guard *g, uint32_t now);
bool guard_arm(struct guard *g, uint32_t ticket, uint32_t now);
/* An axis lost its power, or both have it: the next time takes another ticket. */
void guard_disarm(struct guard *g);
/* A statusword for the state after so many changes goes out. */
void guard_sent(struct guard *g, int axis, uint32_t changes);
/* All frames that had come have been handled. */
void guard_drained(struct guard *g, uint32_t now);
/* The axis, whose state is that after so many changes, may be enabled by a command that has just come. */
bool guard_permits(const struct guard *g, int axis, uint32_t changes, bool claim_required, uint32_t now);
/* It did not enable, for whatever reason: the next one has to wait as long. */
void guard_refused(struct guard *g, int axis, uint32_t now);
#endif
