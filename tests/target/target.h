/* SPDX-License-Identifier: Apache-2.0 */
/* target.h: the instruction counter of a test program in QEMU (semihost.c). */
#ifndef KONTUR_TARGET_H
#define KONTUR_TARGET_H
#include <stdint.h>

/* Start the counter at 0. */
void count_start(void);
/* Instructions executed since count_start(), modulo 2^32, with
 * QEMU's option -icount shift=0. The call itself takes a few. */
uint32_t count_now(void);
#endif
