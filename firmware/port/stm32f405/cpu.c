/* SPDX-License-Identifier: Apache-2.0 */
#include "port/stm32f405/cpu.h"

static bool emulated;

void cpu_look(void)
{
    emulated = RCC->CR == 0;
}

bool cpu_emulated(void)
{
    return emulated;
}
