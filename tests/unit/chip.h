/* SPDX-License-Identifier: Apache-2.0 */
/* chip.h: an STM32F405 of memory, for the port's code on a host: registers keep what is written to them (regs.h), and
 * each wait of the port asks the test what the hardware does. */
#ifndef KONTUR_TEST_CHIP_H
#define KONTUR_TEST_CHIP_H
#include <stdbool.h>

#include "hal/hal.h"
#include "port/stm32f405/regs.h"

/* Answers wait_until(): the hardware sets what is waited for, by default; `false` for a part that does not start. */
typedef bool chip_answer(const reg *r, uint32_t mask, uint32_t value);
extern chip_answer *chip_waits;
/* Waits so far. */
extern unsigned chip_waited;

extern uint32_t chip_store[HAL_FLASH_SECTORS * HAL_FLASH_BYTES / 4];

/* All registers zero but what an emulator is known by; an erased store; hardware that gets ready when it is waited for. */
void chip_reset(void);
/* From now on this is an emulator, for who asks. */
void chip_emulate(void);
/* The level that the port drives at a pin. */
bool chip_pin(char port, unsigned number);
/* The level at an input. */
void chip_drive_pin(char port, unsigned number, bool high);
#endif
