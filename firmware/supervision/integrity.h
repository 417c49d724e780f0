/* SPDX-License-Identifier: Apache-2.0 */
/* supervision/integrity.h: what the drive was told, it still knows: sums over the servo's configuration and the parameters, which nobody
 * changes while an axis has power. A bit that turns over there is seen and makes FAULT_MEMORY. Background only.
 * What else decides on power, limits and stops: docs/adr/0020.
 */
#ifndef KONTUR_MEMORY_H
#define KONTUR_MEMORY_H
#include "drive/servo_loop.h"

enum {
    INTEGRITY_ENTRIES_MS = 40
}; /* entries of the dictionary looked at in a millisecond: all of them in some 15 ms */

struct integrity {
    uint32_t cfg, parameters; /* as they are to be */
    uint32_t sum;             /* of the parameters before od_table[at] */
    uint16_t at;
    bool lost; /* a parameter has changed by itself: until they are set anew, all of them */
};

/* They have just been set. anew: all parameters have, by a reset. */
void integrity_seal(struct integrity *m, const struct servo_loop_cfg *cfg, const struct od_data *od, bool anew);
/* Each millisecond. */
bool integrity_intact(struct integrity *m, const struct servo_loop_cfg *cfg, const struct od_data *od);
#endif
