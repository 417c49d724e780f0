/* SPDX-License-Identifier: Apache-2.0 */
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
