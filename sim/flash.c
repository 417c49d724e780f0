/* SPDX-License-Identifier: Apache-2.0 */
/* flash.c: the simulated flash, flash.h. */
#include "sim/flash.h"

#include <string.h>

enum { WORDS = HAL_FLASH_BYTES / 4 };
#define ERASED 0xFFFFFFFFu

/* A random number, by splitmix64. */
static uint32_t next_random(struct sim_flash *f)
{
    uint64_t z = (f->random += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return (uint32_t)((z ^ (z >> 31)) >> 32);
}

void sim_flash_init(struct sim_flash *f, uint64_t seed)
{
    *f = (struct sim_flash){.random = seed};
    memset(f->word, 0xFF, sizeof f->word);
}

void sim_flash_power_on(struct sim_flash *f)
{
    f->off = false;
    f->operations = f->cut_at = 0;
}

void sim_flash_read(const struct sim_flash *f, unsigned sector, uint32_t offset, void *data, uint32_t bytes)
{
    memcpy(data, &f->word[sector][offset / 4], bytes);
}

/* Count an operation. Returns whether the power fails in it. */
static bool power_fails(struct sim_flash *f)
{
    f->off = ++f->operations == f->cut_at;
    return f->off;
}

bool sim_flash_erase(struct sim_flash *f, unsigned sector)
{
    if (f->off || f->broken) {
        return false;
    }
    f->erases++;
    if (!power_fails(f)) {
        memset(f->word[sector], 0xFF, sizeof f->word[sector]);
        return true;
    }
    for (unsigned i = 0; i < WORDS; i++) {
        const uint32_t choice = next_random(f);
        if (choice % 3 == 0) {
            f->word[sector][i] = ERASED;
        } else if (choice % 3 == 1) {
            f->word[sector][i] |= next_random(f);
        }
    }
    return false;
}

bool sim_flash_write(struct sim_flash *f, unsigned sector, uint32_t offset, const void *data, uint32_t bytes)
{
    for (uint32_t i = 0; i < bytes / 4; i++) {
        uint32_t *word = &f->word[sector][offset / 4 + i];
        uint32_t value;
        memcpy(&value, (const uint8_t *)data + 4 * i, 4);
        if (f->off || f->broken) {
            return false;
        }
        f->misuse += *word != ERASED ? 1u : 0u;
        if (power_fails(f)) {
            *word &= value | next_random(f);
            return false;
        }
        *word &= value;
    }
    return true;
}
