/* SPDX-License-Identifier: Apache-2.0 */
/* ram.h: marks what has a place of its own in RAM. RAM_FUNCTION is a function that runs from RAM, because the flash cannot
 * be read while it erases or writes (sectors.c). CCM_DATA is a variable in the core-coupled memory (kontur.ld). */
#ifndef KONTUR_RAM_H
#define KONTUR_RAM_H
#ifdef __arm__
#define RAM_FUNCTION __attribute__((section(".ramfunc"), noinline, long_call))
#define CCM_DATA __attribute__((section(".ccm")))
#else
#define RAM_FUNCTION
#define CCM_DATA
#endif
#endif
