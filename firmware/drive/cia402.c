/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/cia402.h"

static uint32_t complement(const struct cia402 *c)
{
    return ~((uint32_t)c->state | (uint32_t)c->leave_to << 8);
}

bool cia402_intact(const struct cia402 *c)
{
    return c->not_state == complement(c) && c->state <= CIA402_FAULT && c->leave_to <= CIA402_FAULT;
}

static void enter(struct cia402 *c, enum cia402_state state, enum cia402_state leave_to)
{
    c->changes += c->state != state ? 1u : 0u;
    c->state = state;
    c->leave_to = leave_to;
    c->not_state = complement(c);
}

static void go(struct cia402 *c, enum cia402_state state)
{
    enter(c, state, CIA402_OPERATION_ENABLED);
}

void cia402_init(struct cia402 *c)
{
    const uint32_t changes = c->changes + 1u;
    *c = (struct cia402){.changes = changes, .quick_stop = 2};
    go(c, CIA402_SWITCH_ON_DISABLED);
}

/* From operation enabled, once the path stands; otherwise now. */
static void leave(struct cia402 *c, enum cia402_state state)
{
    if (c->state == CIA402_OPERATION_ENABLED) {
        enter(c, c->state, state);
    } else if (c->state == CIA402_READY_TO_SWITCH_ON || c->state == CIA402_SWITCHED_ON) {
        go(c, state);
    }
}

/* What "enable operation" is taken in */
static bool leads_to_enabled(const struct cia402 *c)
{
    return c->state == CIA402_READY_TO_SWITCH_ON || c->state == CIA402_SWITCHED_ON ||
           (c->state == CIA402_QUICK_STOP_ACTIVE && c->leave_to == CIA402_QUICK_STOP_ACTIVE);
}

void cia402_stop(struct cia402 *c)
{
    if (!cia402_intact(c)) {
        return;
    }
    if (c->state == CIA402_OPERATION_ENABLED || c->state == CIA402_QUICK_STOP_ACTIVE) {
        enter(c, CIA402_QUICK_STOP_ACTIVE, CIA402_SWITCH_ON_DISABLED);
    } else {
        leave(c, CIA402_SWITCH_ON_DISABLED);
    }
}

void cia402_command(struct cia402 *c, uint16_t controlword, bool may_enable)
{
    const bool reset_edge = (controlword & CW_FAULT_RESET) != 0 && (c->controlword & CW_FAULT_RESET) == 0;
    c->controlword = controlword;

    if (!cia402_intact(c)) {
        return;
    }
    if (c->state == CIA402_FAULT) {
        if (reset_edge) {
            go(c, CIA402_SWITCH_ON_DISABLED);
        }
        return;
    }
    if (c->state == CIA402_FAULT_REACTION_ACTIVE) {
        return;
    }
    if ((controlword & CW_ENABLE_VOLTAGE) == 0) {
        go(c, CIA402_SWITCH_ON_DISABLED); /* transitions 7, 9, 10, 12 */
    } else if ((controlword & CW_QUICK_STOP) == 0) {
        if (c->state == CIA402_OPERATION_ENABLED && c->quick_stop == 0) {
            go(c, CIA402_SWITCH_ON_DISABLED); /* 9 */
        } else if (c->state == CIA402_OPERATION_ENABLED) {
            enter(c, CIA402_QUICK_STOP_ACTIVE, /* 11 */
                  c->quick_stop < 5 ? CIA402_SWITCH_ON_DISABLED : CIA402_QUICK_STOP_ACTIVE);
        } else {
            leave(c, CIA402_SWITCH_ON_DISABLED); /* 7, 10 */
        }
    } else if ((controlword & CW_SWITCH_ON) == 0) {
        if (c->state == CIA402_SWITCH_ON_DISABLED) {
            go(c, CIA402_READY_TO_SWITCH_ON); /* 2 */
        } else {
            leave(c, CIA402_READY_TO_SWITCH_ON); /* 6, 8 */
        }
    } else if ((controlword & CW_ENABLE_OPERATION) == 0) {
        if (c->state == CIA402_READY_TO_SWITCH_ON) {
            go(c, CIA402_SWITCHED_ON); /* 3 */
        } else {
            leave(c, CIA402_SWITCHED_ON); /* 5 */
        }
    } else if (may_enable && leads_to_enabled(c)) {
        go(c, CIA402_OPERATION_ENABLED); /* 3 and 4, 16 */
    }
}

void cia402_poll(struct cia402 *c, bool standing)
{
    if (!standing || !cia402_intact(c)) {
        return;
    }
    if (c->state == CIA402_QUICK_STOP_ACTIVE && c->leave_to != CIA402_QUICK_STOP_ACTIVE) {
        go(c, c->leave_to); /* 12 */
    } else if (c->state == CIA402_FAULT_REACTION_ACTIVE) {
        go(c, CIA402_FAULT); /* 14 */
    } else if (c->state == CIA402_OPERATION_ENABLED && c->leave_to != CIA402_OPERATION_ENABLED) {
        go(c, c->leave_to); /* 5, 8 */
    }
}

void cia402_fault(struct cia402 *c, bool stop_first)
{
    if (cia402_intact(c) && c->state == CIA402_FAULT) {
        return;
    }
    go(c, stop_first && cia402_powered(c) ? CIA402_FAULT_REACTION_ACTIVE : CIA402_FAULT);
}

bool cia402_powered(const struct cia402 *c)
{
    return cia402_intact(c) && (c->state == CIA402_OPERATION_ENABLED || c->state == CIA402_QUICK_STOP_ACTIVE ||
                                c->state == CIA402_FAULT_REACTION_ACTIVE);
}

bool cia402_enabled(const struct cia402 *c)
{
    return cia402_intact(c) && c->state == CIA402_OPERATION_ENABLED && c->leave_to == CIA402_OPERATION_ENABLED;
}

bool cia402_waits(const struct cia402 *c)
{
    const unsigned enable = CW_SWITCH_ON | CW_ENABLE_VOLTAGE | CW_QUICK_STOP | CW_ENABLE_OPERATION;
    return (c->controlword & enable) == enable && leads_to_enabled(c);
}

uint16_t cia402_statusword(const struct cia402 *c)
{
    static const uint16_t bits[] = {
        [CIA402_SWITCH_ON_DISABLED] = 0x0040,
        [CIA402_READY_TO_SWITCH_ON] = 0x0021,
        [CIA402_SWITCHED_ON] = 0x0023,
        [CIA402_OPERATION_ENABLED] = 0x0027,
        [CIA402_QUICK_STOP_ACTIVE] = 0x0007,
        [CIA402_FAULT_REACTION_ACTIVE] = 0x000F,
        [CIA402_FAULT] = 0x0008,
    };
    return (uint16_t)(bits[cia402_intact(c) ? c->state : CIA402_FAULT] | 0x0210u);
}
