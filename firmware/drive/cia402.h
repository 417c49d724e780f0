/* SPDX-License-Identifier: Apache-2.0 */
/* cia402.h: the power state machine of one axis (CiA 402-2, clause "Device control").
 *
 * Leaving operation enabled waits until the axis stands, except for "disable voltage", which cuts the power at once.
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

/* Controlword 6040h */
enum {
    CW_SWITCH_ON = 1u << 0,
    CW_ENABLE_VOLTAGE = 1u << 1,
    CW_QUICK_STOP = 1u << 2, /* 0: stop */
    CW_ENABLE_OPERATION = 1u << 3,
    CW_ENABLE_IP = 1u << 4, /* interpolated position; homing: start */
    CW_FAULT_RESET = 1u << 7,
    CW_HALT = 1u << 8
};

/* Statusword 6041h: what is added to the state's own bits */
enum {
    SW_STATE = 0x6F, /* the bits that tell it */
    SW_WARNING = 1u << 7,
    SW_TARGET_REACHED = 1u << 10,
    SW_INTERNAL_LIMIT = 1u << 11,
    SW_IP_ACTIVE = 1u << 12,
    SW_SPEED_0 = 1u << 12,
    SW_HOMING_ATTAINED = 1u << 12,
    SW_HOMING_ERROR = 1u << 13
};

struct cia402 {
    enum cia402_state state;
    uint32_t not_state;         /* ~state, and leave_to from bit 8 on: a bit that turns over is seen */
    enum cia402_state leave_to; /* of OPERATION_ENABLED, QUICK_STOP_ACTIVE: where to go once the axis stands */
    uint32_t changes;           /* of state, counted from 1 */
    uint16_t controlword;
    int16_t quick_stop; /* 605Ah: 0 power off at once, 1..4 once it stands, 5.. stay in quick stop active */
};

/* Power-on, of what is zero; or again: `changes` goes on. */
void cia402_init(struct cia402 *c);
/* It is what this module has put there; else it has no power, and cia402_fault() is the way on. */
bool cia402_intact(const struct cia402 *c);
/* A controlword has been written. may_enable: the axis may enter operation enabled. */
void cia402_command(struct cia402 *c, uint16_t controlword, bool may_enable);
/* Stop and then power off, whatever 605Ah says. */
void cia402_stop(struct cia402 *c);
/* Once a millisecond and after each command: transitions that wait for standstill. */
void cia402_poll(struct cia402 *c, bool standing);
/* A fault: stop on the path first, or cut the power at once. */
void cia402_fault(struct cia402 *c, bool stop_first);
/* The power stage is on: operation enabled, or stopping. */
bool cia402_powered(const struct cia402 *c);
/* Operation enabled and to stay so. */
bool cia402_enabled(const struct cia402 *c);
/* It is to be enabled, and is not yet. */
bool cia402_waits(const struct cia402 *c);
/* The state's bits of 6041h, with bits 4 (voltage enabled) and 9 (remote). */
uint16_t cia402_statusword(const struct cia402 *c);
#endif
