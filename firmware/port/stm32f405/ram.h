/* SPDX-License-Identifier: Apache-2.0 */
/* ram.h: code that runs from RAM, while the flash is busy. */
#ifndef KONTUR_RAM_H
#define KONTUR_RAM_H
#ifdef __arm__
#define RAM_FUNCTION __attribute__((section(".ramfunc"), noinline, long_call))
#else
#define RAM_FUNCTION
#endif
#endif
