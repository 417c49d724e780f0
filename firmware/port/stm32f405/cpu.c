/* SPDX-License-Identifier: Apache-2.0 */
/* cpu.c: the detection of an emulator, cpu.h. */
#include "port/stm32f405/cpu.h"

static bool emulated;

void cpu_detect_emulator(void)
{
    emulated = RCC->CR == 0;
}

bool cpu_emulated(void)
{
    return emulated;
}
