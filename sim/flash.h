/* SPDX-License-Identifier: Apache-2.0 */
/* flash.h: the flash of hal.h in memory, whose power can be cut in the middle of any operation.
 *
 * An operation is one word written or one sector erased. The one in which the power fails leaves a random part
 * of its work (a word: some of its bits; a sector: each word old, erased or neither), and nothing is done after
 * it until sim_flash_power_on().
 */
#ifndef SIM_FLASH_H
#define SIM_FLASH_H
#include "hal/hal.h"

struct sim_flash {
    uint32_t word[HAL_FLASH_SECTORS][HAL_FLASH_BYTES / 4];
    uint64_t random;
    uint32_t operations; /* since power-on */
    uint32_t cut_at;     /* the power fails in this operation, counted from 1; 0: never */
    bool off;
    bool broken;     /* every operation reports an error */
    uint32_t erases; /* since it was made */
    uint32_t misuse; /* words written that were not erased */
};

/* New: erased. The seed is for what a power cut leaves. */
void sim_flash_init(struct sim_flash *f, uint64_t seed);
void sim_flash_power_on(struct sim_flash *f);
void sim_flash_read(const struct sim_flash *f, unsigned sector, uint32_t offset, void *data, uint32_t bytes);
bool sim_flash_erase(struct sim_flash *f, unsigned sector);
bool sim_flash_write(struct sim_flash *f, unsigned sector, uint32_t offset, const void *data, uint32_t bytes);
#endif
