/* SPDX-License-Identifier: Apache-2.0 */
/* flash.h: the flash of hal.h in memory, whose power can fail in the middle of any operation.
 *
 * An operation writes one word or erases one sector. The operation in which the power fails does a random part of its
 * work: of a word some bits are written; of a sector each word is old, erased or in between. Later operations do
 * nothing until sim_flash_power_on().
 *
 * Context: a host process. libkontur.c and tests of the parameter store call it.
 */
#ifndef SIM_FLASH_H
#define SIM_FLASH_H
#include "hal/hal.h"

struct sim_flash {
    uint32_t word[HAL_FLASH_SECTORS][HAL_FLASH_BYTES / 4];
    uint64_t random;
    uint32_t operations; /* since power-on */
    uint32_t cut_at;     /* number of the operation in which the power fails, counted from 1; 0: none */
    bool off;
    bool broken;     /* every operation reports an error */
    uint32_t erases; /* since sim_flash_init() */
    uint32_t misuse; /* number of words written that were not erased */
};

/* A new flash, which is erased. The seed is for the random part of an operation in which the power fails. */
void sim_flash_init(struct sim_flash *f, uint64_t seed);
/* Power on, with cut_at 0. */
void sim_flash_power_on(struct sim_flash *f);
/* The functions of hal.h. */
void sim_flash_read(const struct sim_flash *f, unsigned sector, uint32_t offset, void *data, uint32_t bytes);
bool sim_flash_erase(struct sim_flash *f, unsigned sector);
bool sim_flash_write(struct sim_flash *f, unsigned sector, uint32_t offset, const void *data, uint32_t bytes);
#endif
