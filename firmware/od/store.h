/* SPDX-License-Identifier: Apache-2.0 */
/* od/store.h: values of the object dictionary in two flash sectors. Background only, and without power on an axis,
 * since the flash may stop the processor while it writes or erases.
 *
 * A set is written behind the last one; when a sector is full the other one is erased and goes on. Whenever the
 * power fails, the newest set that is whole is the old or the new one. Values are kept by object index and sub-
 * index: of a set written by another firmware, objects unknown here are skipped, and what is missing or out of
 * range stays as it is.
 *
 * A set, in words of 32 bits as the processor keeps them (docs/adr/0013):
 *   STORE_MAGIC (its low byte is the version of this layout)
 *   sequence number, one more than that of the set before
 *   pairs: index << 8 | sub, value (sign-extended); first 0, 0 where parameters were lost before, and not replaced
 *   STORE_END | number of pairs, CRC-32 (IEEE 802.3) of all words before
 */
#ifndef KONTUR_STORE_H
#define KONTUR_STORE_H
#include <stdbool.h>
#include <stdint.h>

#include "hal/hal.h"
#include "od/od.h"

#define STORE_MAGIC 0x4B4E5401u
#define STORE_END 0xED000000u

/* What is kept: all that can be read and written of 1000h..1FFFh but the error history; parameters; 2001h. */
enum store_area { STORE_COMMUNICATION = 1, STORE_APPLICATION = 2, STORE_NODE = 4 };

struct store {
    const struct hal *hal;
    bool found;   /* the newest set is at `begin`..`end` of `sector` */
    bool damaged; /* the flash is not empty, and no set in it is whole; or parameters are still lost of then */
    uint8_t sector;
    uint32_t begin, end; /* bytes */
    uint32_t sequence;
};

/* Find the newest set. */
void store_open(struct store *s, const struct hal *hal);
/* Put what the newest set has of `areas` into od, within the dictionary's ranges. false: a value is not. */
bool store_load(const struct store *s, struct od_data *od, unsigned areas);
/* Write a set: `take` these areas from od, `keep` those as they are stored, and nothing of the others. Of objects that
 * follow the node id, only those with another value than their default at node_id. false: the flash failed, the old set
 * holds. */
bool store_write(struct store *s, const struct od_data *od, uint8_t node_id, unsigned take, unsigned keep);
#endif
