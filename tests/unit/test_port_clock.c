/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_clock.c: the clock tree of the STM32F405: 168 MHz
 * with and without the crystal, and a crystal that stops. */
#include "chip.h"
#include "port/stm32f405/clock.h"
#include "port/stm32f405/output.h"
#include "unity.h"

void setUp(void)
{
    chip_reset();
}

void tearDown(void)
{
}

static bool no_crystal(const reg *r, uint32_t mask, uint32_t value)
{
    (void)value;
    return !(r == &chip.rcc.CR && mask == RCC_CR_HSERDY);
}

static bool nothing_starts(const reg *r, uint32_t mask, uint32_t value)
{
    (void)r, (void)mask, (void)value;
    return false;
}

static void assert_168_mhz_from(uint32_t source_mhz)
{
    const uint32_t p = chip.rcc.PLLCFGR;
    TEST_ASSERT_EQUAL_UINT32(2, source_mhz / (p & 63u));
    TEST_ASSERT_EQUAL_UINT32(336, 2u * (p >> RCC_PLLCFGR_N & 511u));
    TEST_ASSERT_EQUAL_UINT32(0, p >> RCC_PLLCFGR_P & 3u); /* divided by 2 */
    TEST_ASSERT_EQUAL_UINT32(48, 336u / (p >> RCC_PLLCFGR_Q & 15u));
    TEST_ASSERT_EQUAL_UINT32(5, chip.flash.ACR & FLASH_ACR_LATENCY);
    TEST_ASSERT_EQUAL_UINT32(RCC_CFGR_SWS_PLL, chip.rcc.CFGR & RCC_CFGR_SWS);
    TEST_ASSERT_EQUAL_UINT32(RCC_CFGR_PPRE1_DIV4 | RCC_CFGR_PPRE2_DIV2, chip.rcc.CFGR & (7u << 10 | 7u << 13));
}

static void test_with_a_crystal_it_runs_at_168_mhz_and_watches_the_crystal(void)
{
    TEST_ASSERT_TRUE(clock_start());
    TEST_ASSERT_FALSE(clock_degraded());
    assert_168_mhz_from(8);
    TEST_ASSERT_TRUE((chip.rcc.PLLCFGR & RCC_PLLCFGR_HSE) != 0);
    TEST_ASSERT_TRUE((chip.rcc.CR & RCC_CR_CSSON) != 0);
}

static void test_revision_a_of_the_chip_gets_no_prefetch(void)
{
    chip.dbgmcu.IDCODE = 0x10070413;
    TEST_ASSERT_TRUE(clock_start());
    TEST_ASSERT_EQUAL_HEX32(FLASH_ACR_PRFTEN, chip.flash.ACR & FLASH_ACR_PRFTEN);
    chip.dbgmcu.IDCODE = 0x10000413;
    TEST_ASSERT_TRUE(clock_start());
    TEST_ASSERT_EQUAL_HEX32(0, chip.flash.ACR & FLASH_ACR_PRFTEN);
}

static void test_a_crystal_that_does_not_start_is_reported_and_replaced(void)
{
    chip_waits = no_crystal;
    TEST_ASSERT_FALSE(clock_start());
    TEST_ASSERT_TRUE(clock_degraded());
    assert_168_mhz_from(16);
    TEST_ASSERT_EQUAL_UINT32(0, chip.rcc.PLLCFGR & RCC_PLLCFGR_HSE);
    TEST_ASSERT_EQUAL_UINT32(0, chip.rcc.CR & (RCC_CR_HSEON | RCC_CR_CSSON));
}

static bool was_reset(void)
{
    return chip.scb.AIRCR == (SCB_AIRCR_KEY | SCB_AIRCR_SYSRESETREQ);
}

/* At 16 MHz neither control period nor bit rate would be right. */
static void test_a_chip_without_168_mhz_is_reset(void)
{
    chip_waits = nothing_starts;
    TEST_ASSERT_FALSE(clock_start());
    TEST_ASSERT_LESS_THAN_UINT(20, chip_waited);
    TEST_ASSERT_TRUE(was_reset());
}

static void test_an_emulator_has_no_clock_to_wait_for(void)
{
    chip_emulate();
    chip_waits = nothing_starts;
    TEST_ASSERT_FALSE(clock_start());
    TEST_ASSERT_FALSE(clock_degraded());
    TEST_ASSERT_FALSE(was_reset());
}

static bool no_lock_on_the_crystal(const reg *r, uint32_t mask, uint32_t value)
{
    (void)value;
    return !(r == &chip.rcc.CR && mask == RCC_CR_PLLRDY && (chip.rcc.PLLCFGR & RCC_PLLCFGR_HSE) != 0);
}

static void test_a_crystal_that_the_pll_does_not_lock_on_is_reported_and_replaced(void)
{
    chip_waits = no_lock_on_the_crystal;
    TEST_ASSERT_FALSE(clock_start());
    TEST_ASSERT_TRUE(clock_degraded());
    assert_168_mhz_from(16);
}

static bool no_wait_states(const reg *r, uint32_t mask, uint32_t value)
{
    (void)mask, (void)value;
    return r != &chip.flash.ACR;
}

static void test_the_clock_is_never_faster_than_the_flash_is_set_for(void)
{
    chip_waits = no_wait_states;
    TEST_ASSERT_FALSE(clock_start());
    TEST_ASSERT_TRUE(clock_degraded());
    TEST_ASSERT_EQUAL_UINT32(RCC_CFGR_SW_HSI, chip.rcc.CFGR & RCC_CFGR_SW);
    TEST_ASSERT_TRUE(was_reset());
}

static void start_and_push(void)
{
    const struct hal_axis_cfg cfg[AXES] = {{.full_scale_mN = 100000, .pwm.hz = 40000},
                                           {.full_scale_mN = 100000, .pwm.hz = 40000}};
    const struct hal_drive_out pushing = {.force_mN = {50000, 50000}, .enable = {true, true}};
    clock_start();
    output_init();
    output_configure(cfg);
    output_write(&pushing);
    TEST_ASSERT_TRUE(chip_pin('B', 12));
}

static void test_an_nmi_without_a_failed_crystal_makes_outputs_safe_alone(void)
{
    start_and_push();
    clock_failed_irq();
    TEST_ASSERT_FALSE(chip_pin('B', 12));
    TEST_ASSERT_FALSE(clock_degraded());
    assert_168_mhz_from(8);
}

static void test_a_crystal_that_stops_makes_outputs_safe_and_is_reported(void)
{
    start_and_push();
    chip.rcc.CIR = RCC_CIR_CSSF;
    clock_failed_irq();
    TEST_ASSERT_FALSE(chip_pin('B', 12));
    TEST_ASSERT_FALSE(chip_pin('C', 8));
    TEST_ASSERT_EQUAL_HEX32(0x08000800, chip.dac.DHR12RD);
    TEST_ASSERT_TRUE(clock_degraded());
    TEST_ASSERT_TRUE((chip.rcc.CIR & RCC_CIR_CSSC) != 0);
    assert_168_mhz_from(16);
    TEST_ASSERT_FALSE(was_reset());
}

static void test_a_crystal_that_stops_and_no_other_168_mhz_is_a_reset(void)
{
    start_and_push();
    chip.rcc.CIR = RCC_CIR_CSSF;
    chip_waits = nothing_starts;
    clock_failed_irq();
    TEST_ASSERT_FALSE(chip_pin('B', 12));
    TEST_ASSERT_TRUE(was_reset());
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_with_a_crystal_it_runs_at_168_mhz_and_watches_the_crystal);
    RUN_TEST(test_revision_a_of_the_chip_gets_no_prefetch);
    RUN_TEST(test_a_crystal_that_does_not_start_is_reported_and_replaced);
    RUN_TEST(test_a_chip_without_168_mhz_is_reset);
    RUN_TEST(test_an_emulator_has_no_clock_to_wait_for);
    RUN_TEST(test_a_crystal_that_the_pll_does_not_lock_on_is_reported_and_replaced);
    RUN_TEST(test_the_clock_is_never_faster_than_the_flash_is_set_for);
    RUN_TEST(test_an_nmi_without_a_failed_crystal_makes_outputs_safe_alone);
    RUN_TEST(test_a_crystal_that_stops_makes_outputs_safe_and_is_reported);
    RUN_TEST(test_a_crystal_that_stops_and_no_other_168_mhz_is_a_reset);
    return UNITY_END();
}
