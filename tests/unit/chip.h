/* SPDX-License-Identifier: Apache-2.0 */
/* chip.h: an STM32F405 in memory, for tests of the port on a host. Registers keep the values written to them
 * (regs.h), and each wait of the port asks the test what the hardware does. The tests test_port_* call it.
 */
#ifndef KONTUR_TEST_CHIP_H
#define KONTUR_TEST_CHIP_H
#include <stdbool.h>

#include "core/spline.h"
#include "hal/hal.h"
#include "port/stm32f405/regs.h"

/* The answer to wait_until(). The default sets the bits that
 * the port waits for. false: the hardware does not set them. */
typedef bool chip_answer(const reg *r, uint32_t mask, uint32_t value);
extern chip_answer *chip_waits;
/* Number of waits since chip_reset(). */
extern unsigned chip_waited;

extern uint32_t chip_store[HAL_FLASH_SECTORS * HAL_FLASH_BYTES / 4];
/* The knots of an emulator (kontur.ld). */
extern struct spline_ring kontur_emulated_knots;

/* Set all registers to 0, except RCC_CR, which tells a chip
 * from an emulator; erase the store; let every wait succeed. */
void chip_reset(void);
/* Become an emulator for cpu_emulated(). */
void chip_emulate(void);
/* The level of an output pin. */
bool chip_pin(char port, unsigned number);
/* Set the level of an input pin. */
void chip_drive_pin(char port, unsigned number, bool high);
#endif
