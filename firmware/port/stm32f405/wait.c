/* SPDX-License-Identifier: Apache-2.0 */
/* wait.c: wait_until() of cpu.h on the chip, in a file of its own because tests replace it. */
#include "port/stm32f405/cpu.h"

bool wait_until(const reg *r, uint32_t mask, uint32_t value, uint32_t polls)
{
    if (cpu_emulated()) {
        polls = 1;
    }
    for (; polls > 0; polls--) {
        if ((*r & mask) == value) {
            return true;
        }
    }
    return false;
}
