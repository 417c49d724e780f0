/* SPDX-License-Identifier: Apache-2.0 */
/* sectors.c: the flash of the parameter store, sectors.h. */
#include "port/stm32f405/sectors.h"

#include <string.h>

#include "hal/hal.h"
#include "port/stm32f405/cpu.h"
#include "port/stm32f405/ram.h"
#include "port/stm32f405/supply.h"
#include "port/stm32f405/watchdog.h"

enum { FIRST_SECTOR = 1 };
#define ERRORS (FLASH_SR_OPERR | FLASH_SR_WRPERR | FLASH_SR_PGAERR | FLASH_SR_PGPERR | FLASH_SR_PGSERR)
/* A poll takes 10 cycles or more, so 168e6 polls are 10 s or more, ten times the longest erasure. */
#define POLLS 168000000u

#define STORE_WORDS (HAL_FLASH_SECTORS * HAL_FLASH_BYTES / 4)
#ifdef __arm__
#define STORE ((volatile uint32_t *)0x08004000u)
#else
extern uint32_t chip_store[STORE_WORDS];
#define STORE ((volatile uint32_t *)chip_store)
#endif
/* QEMU's flash is read only, so in QEMU the store lies in RAM that the image does not use (kontur.ld). It is inverted,
 * so that RAM at power-on reads as erased. It survives resets of the processor as long as QEMU runs. */
extern volatile uint32_t kontur_emulated_store[STORE_WORDS];

static bool inside(unsigned sector, uint32_t offset, uint32_t bytes)
{
    return sector < HAL_FLASH_SECTORS && offset <= HAL_FLASH_BYTES && bytes <= HAL_FLASH_BYTES - offset &&
           offset % 4 == 0 && bytes % 4 == 0;
}

static volatile uint32_t *at(unsigned sector, uint32_t offset)
{
    return (cpu_emulated() ? kontur_emulated_store : STORE) + (sector * HAL_FLASH_BYTES + offset) / 4;
}

static uint32_t read_word(unsigned sector, uint32_t offset)
{
    const uint32_t word = *at(sector, offset);
    return cpu_emulated() ? ~word : word;
}

/* Start the operation of CR, where there is a word to write by writing it, and wait for its end. Interrupts are
 * disabled, because their vectors lie in the flash. */
RAM_FUNCTION static bool flash_operation(uint32_t command, volatile uint32_t *to, uint32_t word)
{
    uint32_t polls = POLLS;
    clear_flags(&FLASH->SR, FLASH_SR_EOP | ERRORS);
    FLASH->CR = command;
    if (to != NULL) {
        *to = word;
    } else {
        FLASH->CR = command | FLASH_CR_STRT;
    }
    cpu_barrier();
    while ((FLASH->SR & FLASH_SR_BSY) != 0 && --polls != 0) {
        watchdog_feed();
    }
    FLASH->CR = 0;
    return polls != 0 && (FLASH->SR & ERRORS) == 0;
}

static bool flash_command(uint32_t command, volatile uint32_t *to, uint32_t word)
{
    if (supply_low()) {
        return false;
    }
    const uint32_t lock = cpu_lock();
    if ((FLASH->CR & FLASH_CR_LOCK) != 0) { /* keys that it does not wait for lock it until a reset (RM0090 3.6.1) */
        FLASH->KEYR = FLASH_KEY1;
        FLASH->KEYR = FLASH_KEY2;
    }
    const bool good = flash_operation(command, to, word);
    FLASH->CR = FLASH_CR_LOCK;
    cpu_unlock(lock);
    return good;
}

void sectors_read(unsigned sector, uint32_t offset, void *data, uint32_t bytes)
{
    if (inside(sector, offset, bytes)) {
        for (uint32_t i = 0; i < bytes; i += 4) {
            const uint32_t word = read_word(sector, offset + i);
            memcpy((uint8_t *)data + i, &word, 4);
        }
    }
}

static bool reads_as(unsigned sector, uint32_t word, uint32_t offset, uint32_t bytes)
{
    for (uint32_t i = 0; i < bytes; i += 4) {
        if (read_word(sector, offset + i) != word) {
            return false;
        }
    }
    return true;
}

static void emulate_erase(unsigned sector)
{
    for (uint32_t i = 0; cpu_emulated() && i < HAL_FLASH_BYTES; i += 4) {
        *at(sector, i) = 0;
    }
}

bool sectors_erase(unsigned sector)
{
    if (!inside(sector, 0, 0)) {
        return false;
    }
    emulate_erase(sector);
    const bool good =
        flash_command(FLASH_CR_PSIZE_32 | FLASH_CR_SER | (FIRST_SECTOR + sector) << FLASH_CR_SNB, NULL, 0);
    /* The data cache may hold the old contents. It is reset while it is off (RM0090 3.5.2). */
    FLASH->ACR &= ~(uint32_t)FLASH_ACR_DCEN;
    FLASH->ACR |= FLASH_ACR_DCRST;
    FLASH->ACR &= ~(uint32_t)FLASH_ACR_DCRST;
    FLASH->ACR |= FLASH_ACR_DCEN;
    return good && reads_as(sector, 0xFFFFFFFFu, 0, HAL_FLASH_BYTES);
}

bool sectors_write(unsigned sector, uint32_t offset, const void *data, uint32_t bytes)
{
    if (!inside(sector, offset, bytes)) {
        return false;
    }
    for (uint32_t i = 0; i < bytes; i += 4) {
        uint32_t word;
        memcpy(&word, (const uint8_t *)data + i, 4);
        bool good = true;
        if (cpu_emulated()) {
            *at(sector, offset + i) |= ~word;
        } else {
            good = flash_command(FLASH_CR_PSIZE_32 | FLASH_CR_PG, at(sector, offset + i), word);
        }
        if (!good || !reads_as(sector, word, offset + i, 4)) {
            return false;
        }
    }
    return true;
}
