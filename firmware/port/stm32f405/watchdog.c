/* SPDX-License-Identifier: Apache-2.0 */
/* watchdog.c: both watchdogs, watchdog.h. */
#include "port/stm32f405/watchdog.h"

#include "port/stm32f405/cpu.h"
#include "port/stm32f405/ram.h"

enum { DIVIDE_BY_16 = 2, PERIOD = 99 }; /* 32 kHz / 16 / 100 = 20 Hz */
/* 32 counts of 4096 clocks of APB1 (42 MHz) until T6 becomes 0: 3.02 to 3.12 ms (RM0090 22.4) */
enum { WINDOW_COUNTS = 32, WINDOW_FEED = WWDG_CR_WDGA | (WWDG_CR_T6 + WINDOW_COUNTS - 1) };

#define FREEZE ((uint32_t)(DBGMCU_APB1_FZ_IWDG | DBGMCU_APB1_FZ_WWDG))

static uint32_t fed_at;

void watchdog_start(void)
{
    IWDG->KR = IWDG_KEY_START;
    IWDG->KR = IWDG_KEY_ACCESS;
    IWDG->PR = DIVIDE_BY_16;
    IWDG->RLR = PERIOD;
    (void)wait_until(&IWDG->SR, IWDG_SR_PVU | IWDG_SR_RVU, 0, 100000); /* it takes five LSI periods, 300 us */
    IWDG->KR = IWDG_KEY_FEED;
    RCC->APB1ENR |= RCC_APB1ENR_WWDG;
    (void)RCC->APB1ENR;
    WWDG->CFR = WWDG_CFR_W; /* the whole period is its window: it may be fed at any time */
    WWDG->CR = WINDOW_FEED;
}

RAM_FUNCTION void watchdog_feed(void)
{
    IWDG->KR = IWDG_KEY_FEED;
    WWDG->CR = WINDOW_FEED;
}

void watchdog_tick(void)
{
    WWDG->CR = WINDOW_FEED;
}

void watchdog_in_halt(bool runs)
{
    DBGMCU->APB1_FZ = runs ? DBGMCU->APB1_FZ & ~FREEZE : DBGMCU->APB1_FZ | FREEZE;
}

void watchdog_pass(uint32_t ticks, bool healthy)
{
    if (healthy && ticks != fed_at) {
        fed_at = ticks;
        IWDG->KR = IWDG_KEY_FEED;
    }
}
