/* SPDX-License-Identifier: Apache-2.0 */
/* sectors.h: the two sectors of the parameter store: sectors 1 and 2, 16 KiB each at 0x08004000 and 0x08008000
 * (RM0090 3.3), which the image leaves out (kontur.ld). Background only, without power on an axis.
 *
 * The F405 has one bank of flash: while it erases (250 ms, at most 800: DS8626) or writes (16 us a word, at
 * most 100) nothing can be fetched from it. The wait runs from RAM with interrupts off and feeds the watchdog: no servo
 * tick, and no CAN frame beyond the three that bxCAN holds.
 */
#ifndef KONTUR_SECTORS_H
#define KONTUR_SECTORS_H
#include <stdbool.h>
#include <stdint.h>

/* As in hal.h; false as well when the sector, the offset or the length is not one of the store's. */
void sectors_read(unsigned sector, uint32_t offset, void *data, uint32_t bytes);
bool sectors_erase(unsigned sector);
bool sectors_write(unsigned sector, uint32_t offset, const void *data, uint32_t bytes);
#endif
