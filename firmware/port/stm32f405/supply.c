/* SPDX-License-Identifier: Apache-2.0 */
/* supply.c: the voltage detector, supply.h. */
#include "port/stm32f405/supply.h"

#include "port/stm32f405/cpu.h"
#include "port/stm32f405/crash.h"

enum { POLLS = 1680000 }; /* 10 cycles or more each, which makes 100 ms */

bool supply_start(void)
{
    PWR->CR |= PWR_CR_PLS_2V8 | PWR_CR_PVDE;
    const bool good = wait_until(&PWR->CSR, PWR_CSR_PVDO, 0, POLLS);
    EXTI->RTSR |= EXTI_PVD; /* the output of the detector rises when the voltage falls */
    EXTI->PR = EXTI_PVD;
    EXTI->IMR |= EXTI_PVD;
    cpu_irq_enable(IRQ_PVD, PRIORITY_SUPPLY);
    return good;
}

bool supply_low(void)
{
    return (PWR->CSR & PWR_CSR_PVDO) != 0;
}

void supply_irq(void)
{
    clear_flags(&EXTI->PR, EXTI_PVD);
    crash_supply();
}
