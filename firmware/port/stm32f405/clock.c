/* SPDX-License-Identifier: Apache-2.0 */
/* clock.c: the clock tree, clock.h. */
#include "port/stm32f405/clock.h"

#include "port/stm32f405/board.h"
#include "port/stm32f405/cpu.h"
#include "port/stm32f405/crash.h"
#include "port/stm32f405/output.h"

_Static_assert(BOARD_HSE_MHZ >= 4 && BOARD_HSE_MHZ <= 26 && BOARD_HSE_MHZ % 2 == 0,
               "the PLL needs 2 MHz (RM0090 7.3.2)");

/* Polls at 16 MHz take some 10 cycles each: HSE start-up is 2 ms typically, the PLL locks within 300 us (DS8626,
 * oscillator and PLL characteristics). 150,000 polls are about 100 ms, 10,000 about 6 ms. */
enum { POLLS_HSE = 150000, POLLS = 10000, HSI_MHZ = 16 };

static volatile bool degraded;

static void use_hsi(void)
{
    RCC->CR |= RCC_CR_HSION;
    (void)wait_until(&RCC->CR, RCC_CR_HSIRDY, RCC_CR_HSIRDY, POLLS);
    RCC->CFGR = (RCC->CFGR & ~(uint32_t)RCC_CFGR_SW) | RCC_CFGR_SW_HSI;
    (void)wait_until(&RCC->CFGR, RCC_CFGR_SWS, RCC_CFGR_SWS_HSI, POLLS);
    RCC->CR &= ~(uint32_t)RCC_CR_PLLON; /* the PLL can be configured only while it is off */
    (void)wait_until(&RCC->CR, RCC_CR_PLLRDY, 0, POLLS);
}

/* Revision A of the chip does not support prefetch (ES0182, 2.1.2). */
static uint32_t prefetch(void)
{
    return (DBGMCU->IDCODE & DBGMCU_IDCODE_REV) == DBGMCU_IDCODE_REV_A ? 0u : FLASH_ACR_PRFTEN;
}

/* 168 MHz from a source of `mhz`. false: the PLL does not lock, and the chip stays on the HSI, at 16 MHz. */
static bool use_pll(uint32_t mhz, uint32_t source)
{
    RCC->PLLCFGR = mhz / 2u | 168u << RCC_PLLCFGR_N | 0u << RCC_PLLCFGR_P | source | 7u << RCC_PLLCFGR_Q;
    RCC->CR |= RCC_CR_PLLON;
    if (!wait_until(&RCC->CR, RCC_CR_PLLRDY, RCC_CR_PLLRDY, POLLS)) {
        return false;
    }
    /* Five wait states at 2.7 to 3.6 V must be set before the clock becomes fast (RM0090 3.5.1). */
    FLASH->ACR = 5u | prefetch() | FLASH_ACR_ICEN | FLASH_ACR_DCEN;
    if (!wait_until(&FLASH->ACR, FLASH_ACR_LATENCY, 5u, POLLS)) {
        return false;
    }
    /* A prescaler acts up to 16 clocks after it is written (RM0090 7.3.3), so both are set while the clock is slow. */
    RCC->CFGR = RCC_CFGR_PPRE1_DIV4 | RCC_CFGR_PPRE2_DIV2;
    cpu_barrier();
    RCC->CFGR = RCC_CFGR_PPRE1_DIV4 | RCC_CFGR_PPRE2_DIV2 | RCC_CFGR_SW_PLL;
    return wait_until(&RCC->CFGR, RCC_CFGR_SWS, RCC_CFGR_SWS_PLL, POLLS);
}

/* 168 MHz from the HSI, or a reset. */
static void use_hsi_pll(void)
{
    use_hsi();
    if (!use_pll(HSI_MHZ, 0) && !cpu_emulated()) {
        crash_record(NULL);
    }
}

bool clock_start(void)
{
    RCC->APB1ENR |= RCC_APB1ENR_PWR;
    (void)RCC->APB1ENR;
    PWR->CR |= PWR_CR_VOS;
    use_hsi();
    RCC->CR |= RCC_CR_HSEON;
    bool crystal =
        wait_until(&RCC->CR, RCC_CR_HSERDY, RCC_CR_HSERDY, POLLS_HSE) && use_pll(BOARD_HSE_MHZ, RCC_PLLCFGR_HSE);
    if (crystal) {
        RCC->CR |= RCC_CR_CSSON;
    } else {
        RCC->CR &= ~(uint32_t)RCC_CR_HSEON;
        use_hsi_pll();
    }
    degraded = !crystal && !cpu_emulated();
    return crystal;
}

void clock_failed_irq(void)
{
    output_safe();
    if ((RCC->CIR & RCC_CIR_CSSF) != 0) {
        RCC->CIR |= RCC_CIR_CSSC;
        degraded = true;
        RCC->CR &= ~(uint32_t)(RCC_CR_CSSON | RCC_CR_HSEON);
        use_hsi_pll();
    }
}

bool clock_degraded(void)
{
    return degraded;
}
