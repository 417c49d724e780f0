/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/cia402.h"

#include <stddef.h>

enum event {
    DISABLE_VOLTAGE, /* commands of the controlword */
    QUICK_STOP,
    SHUTDOWN,
    SWITCH_ON, /* in operation enabled: disable operation */
    ENABLE_OPERATION,
    FAULT_RESET, /* rising edge of bit 7 */
    STOP,        /* cia402_stop() */
    PATH_STOP    /* a fault with which the axes stop on the path first */
};

enum condition { ALWAYS, QUICK_STOP_AT_ONCE, SHUTDOWN_AT_ONCE, DISABLE_AT_ONCE, OPTION_STAYS, STAYS };

#define SOD CIA402_SWITCH_ON_DISABLED
#define RTSO CIA402_READY_TO_SWITCH_ON
#define SO CIA402_SWITCHED_ON
#define OE CIA402_OPERATION_ENABLED
#define QSA CIA402_QUICK_STOP_ACTIVE
#define FRA CIA402_FAULT_REACTION_ACTIVE
#define FLT CIA402_FAULT

/* The table of transitions. For an event, the first row applies that has the present state and whose condition holds: the
 * state becomes `next` at once, and `standing` when the axis stands. The numbers are those of the transitions in
 * CiA 402-2. */
static const struct transition {
    enum cia402_state state;
    enum event event;
    enum condition condition;
    enum cia402_state next, standing;
} transitions[] = {
    {SOD, SHUTDOWN, ALWAYS, RTSO, RTSO},            /* 2 */
    {RTSO, SWITCH_ON, ALWAYS, SO, SO},              /* 3 */
    {RTSO, ENABLE_OPERATION, ALWAYS, OE, OE},       /* 3, 4 */
    {SO, ENABLE_OPERATION, ALWAYS, OE, OE},         /* 4 */
    {OE, SWITCH_ON, DISABLE_AT_ONCE, SO, SO},       /* 5 */
    {OE, SWITCH_ON, ALWAYS, OE, SO},                /* 5 */
    {SO, SHUTDOWN, ALWAYS, RTSO, RTSO},             /* 6 */
    {RTSO, DISABLE_VOLTAGE, ALWAYS, SOD, SOD},      /* 7 */
    {RTSO, QUICK_STOP, ALWAYS, SOD, SOD},           /* 7 */
    {RTSO, STOP, ALWAYS, SOD, SOD},                 /* 7 */
    {OE, SHUTDOWN, SHUTDOWN_AT_ONCE, RTSO, RTSO},   /* 8 */
    {OE, SHUTDOWN, ALWAYS, OE, RTSO},               /* 8 */
    {OE, DISABLE_VOLTAGE, ALWAYS, SOD, SOD},        /* 9 */
    {OE, QUICK_STOP, QUICK_STOP_AT_ONCE, SOD, SOD}, /* 9 */
    {SO, DISABLE_VOLTAGE, ALWAYS, SOD, SOD},        /* 10 */
    {SO, QUICK_STOP, ALWAYS, SOD, SOD},             /* 10 */
    {SO, STOP, ALWAYS, SOD, SOD},                   /* 10 */
    {OE, QUICK_STOP, OPTION_STAYS, QSA, QSA},       /* 11 */
    {OE, QUICK_STOP, ALWAYS, QSA, SOD},             /* 11, 12 */
    {OE, STOP, ALWAYS, QSA, SOD},                   /* 11, 12 */
    {QSA, STOP, ALWAYS, QSA, SOD},                  /* 12 */
    {QSA, DISABLE_VOLTAGE, ALWAYS, SOD, SOD},       /* 12 */
    {OE, PATH_STOP, ALWAYS, FRA, FLT},              /* 13, 14 */
    {QSA, PATH_STOP, ALWAYS, FRA, FLT},             /* 13, 14 */
    {FRA, PATH_STOP, ALWAYS, FRA, FLT},             /* 14 */
    {FLT, FAULT_RESET, ALWAYS, SOD, SOD},           /* 15 */
    {QSA, ENABLE_OPERATION, STAYS, OE, OE},         /* 16 */
};

static uint32_t complement(const struct cia402 *c)
{
    return ~((uint32_t)c->state | (uint32_t)c->standing << 8);
}

bool cia402_intact(const struct cia402 *c)
{
    return c->not_state == complement(c) && c->state <= FLT && c->standing <= FLT;
}

static void enter(struct cia402 *c, enum cia402_state state, enum cia402_state standing)
{
    c->changes += c->state != state ? 1u : 0u;
    c->state = state;
    c->standing = standing;
    c->not_state = complement(c);
}

void cia402_init(struct cia402 *c)
{
    const uint32_t changes = c->changes + 1u;
    *c = (struct cia402){.changes = changes, .quick_stop = 2, .shutdown = 1, .disable = 1};
    enter(c, SOD, SOD);
}

static bool holds(const struct cia402 *c, enum condition condition)
{
    switch (condition) {
    case QUICK_STOP_AT_ONCE: return c->quick_stop == 0;
    case SHUTDOWN_AT_ONCE: return c->shutdown == 0;
    case DISABLE_AT_ONCE: return c->disable == 0;
    case OPTION_STAYS: return c->quick_stop >= 5;
    case STAYS: return c->standing == c->state;
    default: return true;
    }
}

/* The row that applies to an event, or NULL if the event changes nothing. */
static const struct transition *find(const struct cia402 *c, enum event event)
{
    for (size_t i = 0; i < sizeof transitions / sizeof transitions[0]; i++) {
        const struct transition *t = &transitions[i];
        if (t->state == c->state && t->event == event && holds(c, t->condition)) {
            return t;
        }
    }
    return NULL;
}

/* Apply an event. Returns false if nothing has changed. */
static bool handle(struct cia402 *c, enum event event)
{
    const struct transition *t = cia402_intact(c) ? find(c, event) : NULL;
    if (t != NULL) {
        enter(c, t->next, t->standing);
    }
    return t != NULL;
}

static enum event command_of(uint16_t controlword)
{
    if ((controlword & CW_ENABLE_VOLTAGE) == 0) {
        return DISABLE_VOLTAGE;
    }
    if ((controlword & CW_QUICK_STOP) == 0) {
        return QUICK_STOP;
    }
    if ((controlword & CW_SWITCH_ON) == 0) {
        return SHUTDOWN;
    }
    return (controlword & CW_ENABLE_OPERATION) == 0 ? SWITCH_ON : ENABLE_OPERATION;
}

void cia402_command(struct cia402 *c, uint16_t controlword, bool may_enable)
{
    const bool reset_edge = (controlword & CW_FAULT_RESET) != 0 && (c->controlword & CW_FAULT_RESET) == 0;
    const enum event command = command_of(controlword);
    c->controlword = controlword;
    if (reset_edge && handle(c, FAULT_RESET)) {
        return;
    }
    if (command != ENABLE_OPERATION || may_enable) {
        (void)handle(c, command);
    }
}

void cia402_stop(struct cia402 *c)
{
    (void)handle(c, STOP);
}

void cia402_standstill(struct cia402 *c)
{
    if (cia402_intact(c)) {
        enter(c, c->standing, c->standing);
    }
}

void cia402_fault(struct cia402 *c, bool stop_first)
{
    if (!stop_first || !handle(c, PATH_STOP)) {
        enter(c, FLT, FLT);
    }
}

static bool has_power(enum cia402_state state)
{
    return state == OE || state == QSA || state == FRA;
}

bool cia402_powered(const struct cia402 *c)
{
    return cia402_intact(c) && has_power(c->state);
}

bool cia402_leaves(const struct cia402 *c)
{
    return cia402_powered(c) && !has_power(c->standing);
}

bool cia402_enabled(const struct cia402 *c)
{
    return cia402_intact(c) && c->state == OE && c->standing == OE;
}

bool cia402_enable_pending(const struct cia402 *c)
{
    return command_of(c->controlword) == ENABLE_OPERATION && find(c, ENABLE_OPERATION) != NULL;
}

uint16_t cia402_statusword(const struct cia402 *c, bool live)
{
    static const uint16_t bits[] = {
        [SOD] = 0x0040, [RTSO] = 0x0021, [SO] = 0x0023, [OE] = 0x0027, [QSA] = 0x0007, [FRA] = 0x000F, [FLT] = 0x0008,
    };
    const enum cia402_state state = c->state == OE && !live ? SO : c->state;
    return (uint16_t)(bits[cia402_intact(c) ? state : FLT] | 0x0210u);
}
