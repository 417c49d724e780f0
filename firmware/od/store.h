/* SPDX-License-Identifier: Apache-2.0 */
/* od/store.h: values of the object dictionary in two sectors of flash, from power-off to power-on.
 *
 * A set holds all values that one call of store_write() stores. It is written behind the last one. When a sector is
 * full, the other one is erased and used next. Whenever the power fails, the newest intact set is either the old or the
 * new one. Values are stored by object index and sub-index, so that a set of another firmware can be loaded: objects
 * unknown to this one are skipped, and an object that is missing or out of range does not change.
 *
 * A set consists of words of 32 bits in the byte order of the processor (docs/adr/0013):
 *   STORE_MAGIC (its low byte is the version of this layout)
 *   sequence number, one more than that of the set before
 *   pairs: index << 8 | sub, value (sign-extended). A first pair 0, 0 marks that the parameters of an earlier set were
 *   lost and have not been replaced since
 *   STORE_END | number of pairs, CRC-32 (IEEE 802.3) of all words before
 *
 * Background only, and without power on an axis, since the flash may stop the processor while it writes or erases.
 * Called by settings.c.
 */
#ifndef KONTUR_STORE_H
#define KONTUR_STORE_H
#include <stdbool.h>
#include <stdint.h>

#include "hal/hal.h"
#include "od/od.h"

#define STORE_MAGIC 0x4B4E5401u
#define STORE_END 0xED000000u

/* Areas of values, to be combined with |. Of 1000h to 1FFFh all that can be read and written is stored, but for the
 * error history, the commands 1010h and 1011h, and 1201h. Of the other objects the parameters and 2001h are stored. STORE_WEAR is the number of
 * erasures (2170h:1), which is in every set. */
enum store_area { STORE_COMMUNICATION = 1, STORE_APPLICATION = 2, STORE_NODE = 4, STORE_WEAR = 8 };

struct store {
    const struct hal *hal; /* flash_read, flash_erase, flash_write */
    bool found;            /* there is an intact set; the newest one is at begin..end of `sector` */
    bool damaged;          /* the flash is not empty and has no intact set, or the newest set marks lost parameters */
    uint8_t sector;
    uint32_t begin, end; /* bytes */
    uint32_t sequence;
};

/* Find the newest set. */
void store_open(struct store *s, const struct hal *hal);
/* Load the values of `areas` that the newest set has into od. false: one of them is out of the dictionary's range, and
 * has not been loaded. */
bool store_load(const struct store *s, struct od_data *od, unsigned areas);
/* Whether the newest set is the one that store_write() would write, so that writing it would only wear the flash. */
bool store_holds(const struct store *s, const struct od_data *od, uint8_t node_id, unsigned saved, unsigned retained);
/* Write a set with the values of od for the areas `saved`, those of the newest set for the areas `retained`, and none
 * of the others. An erasure is counted in od (2170h:1). Of the objects that follow the node id, only those are stored whose value is not their default at
 * node_id. false: the flash failed, and the old set is still the newest one. */
bool store_write(struct store *s, struct od_data *od, uint8_t node_id, unsigned saved, unsigned retained);
#endif
