/* SPDX-License-Identifier: Apache-2.0 */
/* drive/cia402.h: the state machine of one axis' power (CiA 402-2, clause "Device control"), as a table of transitions.
 *
 * A transition out of operation enabled waits until the axis stands, except for "disable voltage", which cuts the power at
 * once. Pure, background only; the caller is drive.c.
 */
#ifndef KONTUR_CIA402_H
#define KONTUR_CIA402_H
#include <stdbool.h>
#include <stdint.h>

enum cia402_state {
    CIA402_SWITCH_ON_DISABLED,
    CIA402_READY_TO_SWITCH_ON,
    CIA402_SWITCHED_ON,
    CIA402_OPERATION_ENABLED,
    CIA402_QUICK_STOP_ACTIVE,
    CIA402_FAULT_REACTION_ACTIVE,
    CIA402_FAULT
};

/* Bits of the controlword 6040h; motion/axis_modes.h has those whose meaning depends on the mode. */
enum {
    CW_SWITCH_ON = 1u << 0,
    CW_ENABLE_VOLTAGE = 1u << 1,
    CW_QUICK_STOP = 1u << 2, /* 0: stop */
    CW_ENABLE_OPERATION = 1u << 3,
    CW_FAULT_RESET = 1u << 7
};

/* Bits of the statusword 6041h */
enum {
    SW_STATE = 0x6F, /* the bits that encode the state */
    SW_WARNING = 1u << 7
};

struct cia402 {
    enum cia402_state state;
    uint32_t not_state;         /* ~state, and `standing` from bit 8 on: a bit that flips is detected */
    enum cia402_state standing; /* the state that follows once the axis stands; `state` itself: none */
    uint32_t changes;           /* of state, counted from 1 */
    uint16_t controlword;
    int16_t quick_stop; /* 605Ah: 0 power off at once, 1..4 once it stands, 5.. stay in quick stop active */
    int16_t shutdown;   /* 605Bh: 0 power off at once, 1 once it stands */
    int16_t disable;    /* 605Ch: the same */
};

/* Start in switch on disabled: at power-on, of a struct that is zero, or at a reset, which does not restart `changes`. */
void cia402_init(struct cia402 *c);
/* Whether the state and its complement agree. If they do not, a bit has flipped: then the axis has no power, and only
 * cia402_fault() changes the state. */
bool cia402_intact(const struct cia402 *c);
/* Act on the controlword, also on one that has not changed. may_enable: the axis may enter operation enabled. */
void cia402_command(struct cia402 *c, uint16_t controlword, bool may_enable);
/* Stop the axis and then switch its power off, whatever 605Ah says. */
void cia402_stop(struct cia402 *c);
/* The axis stands: carry out the transition that waits for it. */
void cia402_standstill(struct cia402 *c);
/* Enter the state fault: stop on the path first, or cut the power at once. */
void cia402_fault(struct cia402 *c, bool stop_first);
/* Whether the power stage is on: the axis is in operation enabled, or stops. */
bool cia402_powered(const struct cia402 *c);
/* Whether the axis is in operation enabled and no transition out of it waits. */
bool cia402_enabled(const struct cia402 *c);
/* Whether the axis loses its power once it stands. */
bool cia402_leaves(const struct cia402 *c);
/* Whether the controlword commands "enable operation" in a state from which it leads to operation enabled. */
bool cia402_enable_pending(const struct cia402 *c);
/* Bits of the statusword 6041h: those of the state, bit 4 (voltage enabled) and bit 9 (remote). Until the amplifier is
 * live, operation enabled is still told as switched on. */
uint16_t cia402_statusword(const struct cia402 *c, bool live);
#endif
