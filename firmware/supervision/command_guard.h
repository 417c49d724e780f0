/* SPDX-License-Identifier: Apache-2.0 */
/* supervision/command_guard.h: who may command (2140h, 2141h), and whether a command to enable may be an answer to what the drive is now.
 * Background only. Why: docs/adr/0019.
 *
 * One master holds the drive, by the node id of its heartbeat. CAN data frames have no sender, so what is protected is what can
 * be: nobody else can claim, and an axis is enabled only
 * - by a controlword that came COMMAND_GUARD_PERIODS after a statusword had told the axis' present state, and after the last one
 *   that did not enable it: what comes in one go is an answer to nothing, however long it is. The time counts from when
 *   all frames had been handled that had come before the statusword went;
 * - if the drive is held, after the ticket of the moment was written back: once, for COMMAND_GUARD_ARM_MS. A replay has an old one.
 * Nothing here keeps anybody from stopping or switching off.
 */
#ifndef KONTUR_GUARD_H
#define KONTUR_GUARD_H
#include <stdbool.h>
#include <stdint.h>

#include "hal/hal.h"

/* Less than a statusword and the answer to it take on the wire, at 1 Mbit/s, more than lies between the frames of a burst */
#define COMMAND_GUARD_PERIODS (2u * CONTROL_HZ / 10000u)
#define COMMAND_GUARD_ARM_MS 1000u

struct command_guard {
    uint8_t holder;    /* node id, 0 nobody */
    uint32_t key;      /* ... and what it claimed with: tells it from another one with the same id; 0: none */
    bool lost;         /* ... and its heartbeat has ceased: it holds on until no axis has power */
    bool drawn, armed; /* a ticket is out; was written back */
    uint32_t ticket;
    uint32_t armed_at; /* servo periods */
    struct command_guard_axis {
        uint32_t sent, told; /* cia402.changes that a statusword went out for; ... before the last frame came */
        uint32_t told_at;    /* servo periods */
    } axis[2];
};

/* Nobody holds it, no state has been told. */
void command_guard_reset(struct command_guard *g);
/* 2140h claim: 1..127 claims, 0 releases what has the same key; neither while an axis has power: false. The holder may say
 * it again, if it has a key: its answer may have been lost. */
bool command_guard_claim(struct command_guard *g, uint8_t id, uint32_t key, bool powered);
/* The holder's heartbeat has ceased. */
void command_guard_lost(struct command_guard *g);
/* Each millisecond: a ticket that was not used in its time is over. true: the claim of a holder that was lost has ended. `now`:
 * servo periods, as below. */
bool command_guard_ended(struct command_guard *g, bool powered, uint32_t now);
/* 2140h ticket is read, arm is written (false: another ticket, or nobody holds the drive). The same one may come again, since its
 * answer was lost, until it is used or over; a new one alone gives more time. */
uint32_t command_guard_draw(struct command_guard *g, uint32_t now);
bool command_guard_arm(struct command_guard *g, uint32_t ticket, uint32_t now);
/* An axis lost its power, or both have it: the next time takes another ticket. */
void command_guard_disarm(struct command_guard *g);
/* A statusword for the state after so many changes goes out. */
void command_guard_sent(struct command_guard *g, int axis, uint32_t changes);
/* All frames that had come have been handled. */
void command_guard_drained(struct command_guard *g, uint32_t now);
/* The axis, whose state is that after so many changes, may be enabled by a command that has just come. */
bool command_guard_permits(const struct command_guard *g, int axis, uint32_t changes, bool claim_required,
                           uint32_t now);
/* It did not enable, for whatever reason: the next one has to wait as long. */
void command_guard_refused(struct command_guard *g, int axis, uint32_t now);
#endif
