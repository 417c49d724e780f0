/* SPDX-License-Identifier: Apache-2.0 */
/* switches.c: the outputs beside the axes, switches.h. */
#include "port/stm32f405/switches.h"

#include "port/stm32f405/board.h"
#include "port/stm32f405/cpu.h"

#define PERIOD (CLOCK_HZ / 10000u)

static const uint8_t pins[] = BOARD_DIGITAL;
static uint32_t now; /* of the pins */

static void put(uint32_t digital)
{
    now = digital;
    for (unsigned i = 0; i < sizeof pins; i++) {
        pin_write(pins[i], (digital >> i & 1u) != 0);
    }
}

void switches_init(void)
{
    for (unsigned i = 0; i < sizeof pins; i++) {
        pin_setup_low(pins[i]);
    }
    now = 0;
    pin_setup(BOARD_POWER, PIN_ALTERNATE, PIN_PULL_DOWN, BOARD_POWER_AF);
    RCC->APB2ENR |= RCC_APB2ENR_TIM1;
    (void)RCC->APB2ENR;
    DBGMCU->APB2_FZ |= DBGMCU_APB2_FZ_TIM1;
    TIM1->ARR = PERIOD - 1u;
    TIM1->CCMR1 = TIM_CCMR_PWM1_AT_ONCE;
    TIM1->CCR[0] = 0;
    TIM1->CCER = TIM_CCER_E;
    TIM1->BDTR = TIM_BDTR_OSSI | TIM_BDTR_OSSR | TIM_BDTR_MOE;
    TIM1->EGR = TIM_EGR_UG;
    TIM1->CR1 = TIM_CR1_CEN;
}

void switches_write(const struct hal_drive_out *out)
{
    const uint32_t power = out->power;
    TIM1->CCR[0] = (power + (power >> 15)) * PERIOD >> 16; /* full power is 65535, and the whole period */
    if (out->digital != now) {
        put(out->digital);
    }
}

void switches_safe(void)
{
    TIM1->CCR[0] = 0;
    put(0);
}
