/* SPDX-License-Identifier: Apache-2.0 */
/* ram.h: marks a function that runs from RAM, because the
 * flash cannot be read while it erases or writes (sectors.c). */
#ifndef KONTUR_RAM_H
#define KONTUR_RAM_H
#ifdef __arm__
#define RAM_FUNCTION __attribute__((section(".ramfunc"), noinline, long_call))
#else
#define RAM_FUNCTION
#endif
#endif
