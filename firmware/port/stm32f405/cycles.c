/* SPDX-License-Identifier: Apache-2.0 */
/* cycles.c: the cycles of servo ticks, cycles.h. */
#include "port/stm32f405/cycles.h"

#include <stdatomic.h>

#include "port/stm32f405/regs.h"

static uint32_t begun;
static _Atomic uint32_t last, worst;

void cycles_start(void)
{
    DEBUG->DEMCR |= DEBUG_DEMCR_TRCENA;
    DWT->CTRL |= DWT_CTRL_CYCCNTENA;
    atomic_store(&worst, 0u);
}

void cycles_begin(void)
{
    begun = DWT->CYCCNT;
}

void cycles_end(void)
{
    const uint32_t cycles = DWT->CYCCNT - begun;
    atomic_store_explicit(&last, cycles, memory_order_relaxed);
    if (cycles > atomic_load_explicit(&worst, memory_order_relaxed)) {
        atomic_store_explicit(&worst, cycles, memory_order_relaxed);
    }
}

void cycles_read(struct hal_health *health)
{
    health->tick_cycles = atomic_load(&last);
    health->tick_cycles_worst = atomic_load(&worst);
}
