/* SPDX-License-Identifier: Apache-2.0 */
/* supervision/command_guard.h: who may command (2140h, 2141h), and whether a command to enable can be an answer to the
 * present state of the drive. docs/adr/0019-who-may-command.md has the reasons.
 *
 * One master holds the drive, by the node id of its heartbeat. CAN data frames have no sender, so this protects what can be
 * protected. Nobody else can claim the drive, and an axis is enabled only
 * - by a controlword that came COMMAND_GUARD_PERIODS or more after a statusword with the present state of the axis, and as
 *   long after the last controlword that did not enable it. Frames that come in one burst answer nothing, however long the
 *   burst is. The time counts from when all frames had been handled that had come before the statusword was sent;
 * - if the drive is held: after the present ticket has been written back, once, for COMMAND_GUARD_ARM_MS. A replay has an
 *   old ticket.
 * For as long the ticket also tells the holder from others by SDO, if it has no channel of its own (device_objects.c).
 * Nothing here keeps anybody from stopping the axes or switching them off.
 *
 * Pure, background only. drive.c asks it for permission, device.c reports statuswords and the holder's heartbeat to it.
 * `now` is in servo periods.
 */
#ifndef KONTUR_COMMAND_GUARD_H
#define KONTUR_COMMAND_GUARD_H
#include <stdbool.h>
#include <stdint.h>

#include "hal/hal.h"

/* Shorter than a statusword and the answer to it take on the bus at 1 Mbit/s; longer than a gap between frames of a burst */
#define COMMAND_GUARD_PERIODS (2u * CONTROL_HZ / 10000u)
#define COMMAND_GUARD_ARM_MS 1000u

struct command_guard {
    uint8_t holder; /* node id, 0 nobody */
    uint32_t key;   /* that the holder claimed with: tells it from another one with the same id; 0: none */
    bool silent;    /* its heartbeat has ceased: it holds the drive until no axis has power */
    bool drawn;     /* a ticket has been read, */
    bool told;      /* and written back in the last COMMAND_GUARD_ARM_MS, */
    bool armed;     /* and has not been used to enable since */
    uint32_t ticket;
    uint32_t noise;    /* all that tickets were drawn with, also before a reset */
    uint32_t armed_at; /* servo periods */
    struct command_guard_axis {
        uint32_t sent;     /* cia402.changes of the statusword sent last, */
        uint32_t known;    /* and of the one that a master can have answered */
        uint32_t known_at; /* servo periods */
    } axis[2];
};

/* Initialise all but `noise`: nobody holds the drive, and no statusword has been sent. */
void command_guard_reset(struct command_guard *g);
/* 2140h claim: 1..127 claims the drive, 0 releases it with the same key. false: refused; always so while an axis has power.
 * The holder may repeat its claim if it has a key, since an answer may have been lost. */
bool command_guard_claim(struct command_guard *g, uint8_t id, uint32_t key, bool powered);
/* The holder's heartbeat has ceased: its claim ends when no axis has power. */
void command_guard_holder_silent(struct command_guard *g);
/* Once a millisecond: end a ticket whose time is over. Returns true if the claim of a silent holder has ended. */
bool command_guard_expire(struct command_guard *g, bool powered, uint32_t now);
/* The tickets from now on depend on `noise`, too, which nobody can foretell. */
void command_guard_stir(struct command_guard *g, uint32_t noise);
/* Draw a new ticket, for a read of 2140h ticket. */
uint32_t command_guard_draw(struct command_guard *g, uint32_t now);
/* A ticket has been written to 2140h arm. Returns false if it is another one, or if nobody holds the drive. The same ticket may come again until it is used or
 * its time is over, since an answer may have been lost; only a new one gives more time. */
bool command_guard_arm(struct command_guard *g, uint32_t ticket, uint32_t now);
/* Whether a ticket has been written back in the last COMMAND_GUARD_ARM_MS. */
bool command_guard_told(const struct command_guard *g);
/* An axis has lost its power, or both have it: the next command to enable needs another ticket. */
void command_guard_disarm(struct command_guard *g);
/* A statusword has been sent for the state after so many changes. */
void command_guard_sent(struct command_guard *g, int axis, uint32_t changes);
/* All frames that had come so far have been handled. */
void command_guard_drained(struct command_guard *g, uint32_t now);
/* Whether a command that has just come may enable the axis. Its state is the one after so many changes. */
bool command_guard_permits(const struct command_guard *g, int axis, uint32_t changes, bool claim_required,
                           uint32_t now);
/* The command did not enable the axis, for whatever reason: the next one has to wait as long. */
void command_guard_refused(struct command_guard *g, int axis, uint32_t now);
#endif
