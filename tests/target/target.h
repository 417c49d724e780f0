/* SPDX-License-Identifier: Apache-2.0 */
/* target.h: what a test program in QEMU has besides standard C. */
#ifndef KONTUR_TARGET_H
#define KONTUR_TARGET_H
#include <stdint.h>

/* Instructions executed since count_start(), modulo 2^32, with qemu's -icount shift=0. Reading it costs a few itself. */
void count_start(void);
uint32_t count_now(void);
#endif
