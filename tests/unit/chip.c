/* SPDX-License-Identifier: Apache-2.0 */
/* chip.c: the registers of chip.h. */
#include "chip.h"

#include <string.h>

#include "port/stm32f405/cpu.h"

struct chip chip;
uint32_t chip_store[HAL_FLASH_SECTORS * HAL_FLASH_BYTES / 4];
volatile uint32_t kontur_emulated_store[HAL_FLASH_SECTORS * HAL_FLASH_BYTES / 4];
uint32_t kontur_stack_bottom[16];
struct spline_ring kontur_emulated_knots;
chip_answer *chip_waits;
unsigned chip_waited;

static bool succeed(const reg *r, uint32_t mask, uint32_t value)
{
    (void)r, (void)mask, (void)value;
    return true;
}

bool wait_until(const reg *r, uint32_t mask, uint32_t value, uint32_t polls)
{
    chip_waited++;
    if (polls == 0 || !chip_waits(r, mask, value)) {
        return false;
    }
    reg *bits = (reg *)(uintptr_t)r;
    *bits = (*bits & ~mask) | value;
    return true;
}

void chip_reset(void)
{
    memset((void *)&chip, 0, sizeof chip);
    chip.rcc.CR = RCC_CR_HSION | RCC_CR_HSIRDY;
    cpu_detect_emulator();
    memset(chip_store, 0xFF, sizeof chip_store);
    memset((void *)kontur_emulated_store, 0, sizeof kontur_emulated_store);
    chip_waits = succeed;
    chip_waited = 0;
}

void chip_emulate(void)
{
    chip.rcc.CR = 0;
    cpu_detect_emulator();
}

bool chip_pin(char port, unsigned number)
{
    return (chip.gpio[port - 'A'].ODR >> number & 1u) != 0;
}

void chip_drive_pin(char port, unsigned number, bool high)
{
    const uint32_t bit = 1u << number;
    chip.gpio[port - 'A'].IDR = high ? chip.gpio[port - 'A'].IDR | bit : chip.gpio[port - 'A'].IDR & ~bit;
}
