/* SPDX-License-Identifier: Apache-2.0 */
/* supervision/integrity.h: checksums over the servo's configuration and over the parameters, which nobody changes while an
 * axis has power, but for a few parameters (OD_LIVE). They detect bits that flip in RAM (FAULT_MEMORY). docs/adr/0020-flipped-bits.md names what else is
 * checked. Background only; the caller is drive.c.
 */
#ifndef KONTUR_INTEGRITY_H
#define KONTUR_INTEGRITY_H
#include <stdbool.h>
#include <stddef.h>

#include "od/od.h"

/* Entries of the dictionary that are read in a millisecond: all of them in some 15 ms */
enum { INTEGRITY_ENTRIES_MS = 64 };

struct integrity {
    uint32_t cfg, parameters; /* checksums when they were set */
    uint32_t sum;             /* of the parameters before od_table[at] */
    uint16_t at;
    bool corrupt; /* a bit of a parameter has flipped; true until all parameters are set anew */
};

/* Whether no bit of a parameter has flipped since they were sealed: all at once, before a new seal would hide it. */
bool integrity_parameters_intact(const struct integrity *m, const struct od_data *od);
/* Configuration (cfg, `bytes` of it, a multiple of 4) and parameters have just been set. reset: every parameter has, by a
 * reset. */
void integrity_seal(struct integrity *m, const void *cfg, size_t bytes, const struct od_data *od, bool reset);
/* Check a part of the parameters, once a millisecond. Returns false if a bit has flipped. */
bool integrity_intact(struct integrity *m, const void *cfg, size_t bytes, const struct od_data *od);
#endif
