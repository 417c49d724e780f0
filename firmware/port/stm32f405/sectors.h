/* SPDX-License-Identifier: Apache-2.0 */
/* sectors.h: the flash sectors of the parameter store. They are sectors 1 and 2, 16 KiB each at 0x08004000 and
 * 0x08008000 (RM0090 3.3), which the image leaves free (kontur.ld).
 *
 * The F405 has one bank of flash, so nothing can be read from it while it erases (250 ms, at most 800: DS8626) or
 * writes (16 us a word, at most 100). The code that waits runs from RAM with interrupts disabled and feeds the
 * watchdog. There is no servo tick meanwhile, and CAN frames beyond the three that bxCAN holds are lost.
 *
 * Context: the background loop, without power on an axis.
 */
#ifndef KONTUR_SECTORS_H
#define KONTUR_SECTORS_H
#include <stdbool.h>
#include <stdint.h>

/* The functions of hal.h. A sector, offset or length outside the store is refused. */
void sectors_read(unsigned sector, uint32_t offset, void *data, uint32_t bytes);
bool sectors_erase(unsigned sector);
bool sectors_write(unsigned sector, uint32_t offset, const void *data, uint32_t bytes);
#endif
