/* SPDX-License-Identifier: Apache-2.0 */
/* fault.h: what can go wrong, and what the drive does about it. One row each, in fault.c. */
#ifndef KONTUR_FAULT_H
#define KONTUR_FAULT_H
#include <stdint.h>

enum fault {
    FAULT_FOLLOWING,  /* an axis is further from its reference than 6065h */
    FAULT_OVERSPEED,  /* an axis is faster than 2130h velocity */
    FAULT_TRAVEL,     /* an axis is outside 607Dh */
    FAULT_INPUT,      /* amplifier or encoder reports a fault */
    FAULT_HEARTBEAT,  /* the master of 1016h is silent */
    FAULT_UNDERRUN,   /* knots ran out before the end of the stream */
    FAULT_KNOT_RANGE, /* a knot is outside 607Dh */
    FAULT_CLOCK,      /* the controller's crystal has not started, or has stopped */
    FAULT_RESTART,    /* the controller was reset by its watchdog, or by a crash (2030h) */
    FAULT_OVERRUN,    /* servo ticks have taken longer than their period */
    FAULT_LIMIT_SWITCH, /* a stream has run into a limit switch */
    FAULTS
};

enum fault_reaction {
    REACT_DISABLE,  /* power off now: position cannot be trusted or held */
    REACT_PATH_STOP /* stop on the path, then power off */
};

struct fault_row {
    uint16_t emcy; /* CiA 301/402 error code; also 603Fh */
    uint8_t reg;   /* error register bits, emcy.h */
    enum fault_reaction reaction;
};

extern const struct fault_row fault_table[FAULTS];

#define FAULT_BIT(f) (1u << (f))
/* Those of REACT_DISABLE, for the servo tick, which does not wait for the background. */
#define FAULTS_CUT_OFF \
    (FAULT_BIT(FAULT_FOLLOWING) | FAULT_BIT(FAULT_OVERSPEED) | FAULT_BIT(FAULT_TRAVEL) | FAULT_BIT(FAULT_INPUT) | \
     FAULT_BIT(FAULT_CLOCK) | FAULT_BIT(FAULT_RESTART) | FAULT_BIT(FAULT_OVERRUN))
#endif
