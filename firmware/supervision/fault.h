/* SPDX-License-Identifier: Apache-2.0 */
/* supervision/fault.h: what can go wrong, and what the drive does about it. The rows are those of supervision/faults.toml
 * (docs/faults.md). Pure. Any context may use it; the background configures the reactions of the servo tick with it.
 */
#ifndef KONTUR_FAULT_H
#define KONTUR_FAULT_H
#include <stdbool.h>
#include <stdint.h>

#include "od/od.h"
#include "supervision/fault_gen.h"

/* Values of 2120h:3 and 2122h:3 */
enum fault_reaction {
    REACT_WARN,       /* nothing stops: EMCY and the warning bit, while it lasts */
    REACT_PATH_STOP,  /* stop on the path, then power off */
    REACT_QUICK_STOP, /* as 605Ah says */
    REACT_DISABLE     /* power off now: the position cannot be trusted or held */
};

/* The value of 2122h:3 beyond these: the servo tick lowers the gains, and the drive warns. */
#define OSCILLATION_LOWER_GAINS 4u

struct fault_row {
    uint16_t emcy;    /* CiA 301/402 error code; also 603Fh */
    uint8_t reg;      /* CO_REG_ bits of the error register 1001h */
    uint8_t reaction; /* enum fault_reaction, unless set otherwise: fault_reaction() */
};

extern const struct fault_row fault_table[FAULTS];

#define FAULT_BIT(f) (1u << (f))

/* The reaction to a fault with the options that are set: REACT_WARN, REACT_PATH_STOP or REACT_DISABLE. */
enum fault_reaction fault_reaction(const struct od_data *od, enum fault f);
/* FAULT_BIT()s of all faults with this reaction. */
uint32_t fault_mask(const struct od_data *od, enum fault_reaction reaction);
#endif
