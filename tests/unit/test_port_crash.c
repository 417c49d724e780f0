/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_crash.c: the saved crash of the STM32F405, which survives a reset, and the cause of a reset. The module
 * is part of this program, so that its saved crash can be damaged.
 */
#include "chip.h"
#include "port/stm32f405/crash.c"
#include "unity.h"

void setUp(void)
{
    chip_reset();
    output_init();
}

void tearDown(void)
{
}

static void write_forces(void)
{
    const struct hal_axis_cfg cfg[AXES] = {{.full_scale_mN = 100000, .pwm.hz = 40000},
                                           {.full_scale_mN = 100000, .pwm.hz = 40000}};
    const struct hal_drive_out out = {.force_mN = {90000, -90000}, .enable = {true, true}};
    output_configure(cfg);
    output_write(&out);
}

static void crash_at(uint32_t pc)
{
    uint32_t *frame = &kontur_stack_bottom[4];
    frame[5] = 0x08001235;
    frame[6] = pc;
    frame[7] = 0x0100000F;
    chip.scb.CFSR = 0x00008200;
    chip.scb.HFSR = 0x40000000;
    chip.scb.BFAR = 0x1FFF7A10;
    crash_record(frame);
}

/* Power on, which clears what an earlier test has saved. */
static void power_on(void)
{
    enum hal_reset reset;
    struct hal_crash crash;
    chip.rcc.CSR = RCC_CSR_PORRSTF | RCC_CSR_BORRSTF | RCC_CSR_PINRSTF;
    crash_read(&reset, &crash);
    TEST_ASSERT_EQUAL(HAL_RESET_POWER, reset);
    TEST_ASSERT_EQUAL_UINT32(0, crash.count);
    chip.rcc.CSR = 0;
}

static void test_a_hard_fault_makes_outputs_safe_and_resets(void)
{
    write_forces();
    TEST_ASSERT_TRUE(chip_pin('B', 12));
    crash_at(0x0800BEEE);
    TEST_ASSERT_FALSE(chip_pin('B', 12));
    TEST_ASSERT_FALSE(chip_pin('C', 8));
    TEST_ASSERT_EQUAL_HEX32(0x08000800, chip.dac.DHR12RD);
    TEST_ASSERT_EQUAL_UINT32(0, chip.tim8.BDTR & TIM_BDTR_MOE);
    TEST_ASSERT_EQUAL_HEX32(SCB_AIRCR_KEY | SCB_AIRCR_SYSRESETREQ, chip.scb.AIRCR);
}

static void test_a_saved_crash_survives_the_reset_and_is_reported_once(void)
{
    enum hal_reset reset;
    struct hal_crash crash;
    power_on();
    crash_at(0x0800BEEE);
    chip.rcc.CSR = RCC_CSR_SFTRSTF | RCC_CSR_PINRSTF;
    crash_read(&reset, &crash);
    TEST_ASSERT_EQUAL(HAL_RESET_CRASH, reset);
    TEST_ASSERT_EQUAL_HEX32(0x0800BEEE, crash.pc);
    TEST_ASSERT_EQUAL_HEX32(0x08001235, crash.lr);
    TEST_ASSERT_EQUAL_HEX32(0x0100000F, crash.psr);
    TEST_ASSERT_EQUAL_HEX32(0x00008200, crash.cfsr);
    TEST_ASSERT_EQUAL_HEX32(0x40000000, crash.hfsr);
    TEST_ASSERT_EQUAL_HEX32(0x1FFF7A10, crash.bfar);
    TEST_ASSERT_EQUAL_UINT32(1, crash.count);
    TEST_ASSERT_TRUE((chip.rcc.CSR & RCC_CSR_RMVF) != 0);

    chip.rcc.CSR = RCC_CSR_PINRSTF;
    crash_read(&reset, &crash);
    TEST_ASSERT_EQUAL(HAL_RESET_PIN, reset);
    TEST_ASSERT_EQUAL_UINT32(1, crash.count);

    crash_at(0x08010000);
    crash_read(&reset, &crash);
    TEST_ASSERT_EQUAL(HAL_RESET_CRASH, reset);
    TEST_ASSERT_EQUAL_UINT32(2, crash.count);
    power_on();
}

static void test_a_crash_with_an_invalid_stack_is_saved_without_its_address(void)
{
    enum hal_reset reset;
    struct hal_crash crash;
    power_on();
    const uint32_t *const elsewhere[] = {kontur_stack_top,
                                         (const uint32_t *)sizeof(uint32_t)}; /* above and below the stack */
    for (unsigned i = 0; i < 2; i++) {
        crash_record(elsewhere[i]);
        crash_read(&reset, &crash);
        TEST_ASSERT_EQUAL(HAL_RESET_CRASH, reset);
        TEST_ASSERT_EQUAL_HEX32(0, crash.pc);
        TEST_ASSERT_EQUAL_UINT32(i + 1, crash.count);
    }
}

static void test_a_watchdog_reset_is_reported(void)
{
    enum hal_reset reset;
    struct hal_crash crash;
    power_on();
    chip.rcc.CSR = RCC_CSR_IWDGRSTF | RCC_CSR_PINRSTF;
    crash_read(&reset, &crash);
    TEST_ASSERT_EQUAL(HAL_RESET_WATCHDOG, reset);
}

static void expect_cause(uint32_t flags, enum hal_reset expected)
{
    enum hal_reset reset;
    struct hal_crash crash;
    power_on();
    chip.rcc.CSR = flags | RCC_CSR_PINRSTF; /* the pin is low in every reset (RM0090 7.1) */
    crash_read(&reset, &crash);
    TEST_ASSERT_EQUAL(expected, reset);
    TEST_ASSERT_EQUAL_UINT32(0, crash.count);
}

static void test_each_cause_of_a_reset_has_its_name(void)
{
    expect_cause(RCC_CSR_BORRSTF, HAL_RESET_BROWN_OUT);
    expect_cause(RCC_CSR_IWDGRSTF, HAL_RESET_WATCHDOG);
    expect_cause(RCC_CSR_WWDGRSTF, HAL_RESET_WATCHDOG);
    expect_cause(RCC_CSR_SFTRSTF, HAL_RESET_SOFTWARE);
    expect_cause(0, HAL_RESET_PIN);
    enum hal_reset reset;
    struct hal_crash crash;
    chip.rcc.CSR = 0;
    crash_read(&reset, &crash);
    TEST_ASSERT_EQUAL(HAL_RESET_UNKNOWN, reset);
}

/* After a brown-out the contents of RAM are not reliable. */
static void test_a_brown_out_forgets_crashes(void)
{
    enum hal_reset reset;
    struct hal_crash crash;
    crash_at(0x0800BEEE);
    chip.rcc.CSR = RCC_CSR_BORRSTF;
    crash_read(&reset, &crash);
    TEST_ASSERT_EQUAL(HAL_RESET_BROWN_OUT, reset);
    TEST_ASSERT_EQUAL_UINT32(0, crash.count);
}

static void test_a_supply_that_fails_makes_outputs_safe_and_is_a_brown_out_of_the_next_run(void)
{
    enum hal_reset reset_cause;
    struct hal_crash crash;
    power_on();
    crash_at(0x0800BEEE);
    chip.rcc.CSR = RCC_CSR_SFTRSTF;
    crash_read(&reset_cause, &crash);
    write_forces();
    chip.scb.AIRCR = 0;
    crash_supply();
    TEST_ASSERT_FALSE(chip_pin('B', 12) || chip_pin('C', 8));
    TEST_ASSERT_EQUAL_HEX32(SCB_AIRCR_KEY | SCB_AIRCR_SYSRESETREQ, chip.scb.AIRCR);
    crash_read(&reset_cause, &crash);
    TEST_ASSERT_EQUAL(HAL_RESET_BROWN_OUT, reset_cause);
    TEST_ASSERT_EQUAL_HEX32(0x0800BEEE, crash.pc); /* it is still the last crash */
    crash_read(&reset_cause, &crash);
    TEST_ASSERT_EQUAL(HAL_RESET_SOFTWARE, reset_cause);
    power_on();
    crash_supply();
    crash_read(&reset_cause, &crash);
    TEST_ASSERT_EQUAL_UINT32(0, crash.count);
}

static void test_a_saved_crash_with_any_bit_flipped_is_invalid(void)
{
    for (size_t bit = 0; bit < 8 * sizeof saved; bit++) {
        enum hal_reset reset;
        struct hal_crash crash;
        power_on();
        crash_at(0x0800BEEE);
        ((uint8_t *)&saved)[bit / 8] ^= (uint8_t)(1u << bit % 8);
        chip.rcc.CSR = RCC_CSR_SFTRSTF;
        crash_read(&reset, &crash);
        TEST_ASSERT_EQUAL(HAL_RESET_SOFTWARE, reset);
        TEST_ASSERT_EQUAL_UINT32(0, crash.count);
    }
}

static void test_a_frame_at_the_very_end_of_the_stack_is_not_read_beyond_it(void)
{
    enum hal_reset reset;
    struct hal_crash crash;
    kontur_stack_bottom[15] = 0x0800BEEE; /* where pc would be read */
    for (unsigned i = 8; i <= 9; i++) {
        power_on();
        crash_record(&kontur_stack_bottom[i]);
        crash_read(&reset, &crash);
        TEST_ASSERT_EQUAL_HEX32(i == 8 ? kontur_stack_bottom[14] : 0, crash.pc);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_a_hard_fault_makes_outputs_safe_and_resets);
    RUN_TEST(test_a_saved_crash_survives_the_reset_and_is_reported_once);
    RUN_TEST(test_a_crash_with_an_invalid_stack_is_saved_without_its_address);
    RUN_TEST(test_a_watchdog_reset_is_reported);
    RUN_TEST(test_each_cause_of_a_reset_has_its_name);
    RUN_TEST(test_a_brown_out_forgets_crashes);
    RUN_TEST(test_a_supply_that_fails_makes_outputs_safe_and_is_a_brown_out_of_the_next_run);
    RUN_TEST(test_a_saved_crash_with_any_bit_flipped_is_invalid);
    RUN_TEST(test_a_frame_at_the_very_end_of_the_stack_is_not_read_beyond_it);
    return UNITY_END();
}
