/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_switches.c: the outputs beside the axes of the STM32F405. */
#include "chip.h"
#include "port/stm32f405/output.h"
#include "unity.h"

enum { PERIOD = 16800 };

void setUp(void)
{
    chip_reset();
    output_init();
}

void tearDown(void)
{
}

static void write(uint16_t digital, uint16_t power, bool enable)
{
    const struct hal_drive_out out = {.enable = {enable, enable}, .digital = digital, .power = power};
    output_write(&out);
}

static unsigned pins(void)
{
    static const struct {
        char port;
        unsigned number, bit;
    } rows[] = {{'B', 11, 0}, {'B', 13, 1}, {'C', 14, 2}, {'C', 9, 3}, {'A', 7, 4}, {'C', 15, 5}, {'B', 2, 8}};
    unsigned on = 0;
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        on |= (chip_pin(rows[i].port, rows[i].number) ? 1u : 0u) << rows[i].bit;
    }
    return on;
}

static void test_all_is_off_at_power_on_and_the_pwm_runs(void)
{
    TEST_ASSERT_EQUAL_HEX(0, pins());
    TEST_ASSERT_EQUAL_UINT32(0, chip.tim1.CCR[0]);
    TEST_ASSERT_EQUAL_UINT32(PERIOD - 1, chip.tim1.ARR);
    TEST_ASSERT_EQUAL_HEX32(TIM_BDTR_MOE, chip.tim1.BDTR & TIM_BDTR_MOE);
    TEST_ASSERT_EQUAL_HEX32(TIM_CR1_CEN, chip.tim1.CR1 & TIM_CR1_CEN);
    TEST_ASSERT_EQUAL_HEX32(DBGMCU_APB2_FZ_TIM1, chip.dbgmcu.APB2_FZ & DBGMCU_APB2_FZ_TIM1);
    TEST_ASSERT_EQUAL_HEX32(1, chip.gpio[0].AFR[1] & 15u); /* PA8: AF1 */
}

static void test_each_bit_has_its_pin(void)
{
    for (unsigned bit = 0; bit < 12; bit++) {
        write((uint16_t)(1u << bit), 0, true);
        TEST_ASSERT_EQUAL_HEX(1u << bit & 0x13Fu, pins());
    }
    write(0x13F, 0, true);
    TEST_ASSERT_EQUAL_HEX(0x13F, pins());
    write(0, 0, true);
    TEST_ASSERT_EQUAL_HEX(0, pins());
}

static void test_power_is_the_duty_up_to_the_whole_period(void)
{
    static const uint16_t rows[][2] = {{0, 0},        {1, 0},         {4, 1},         {32767, 8399},
                                       {32768, 8400}, {65534, 16799}, {65535, PERIOD}};
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        write(0, rows[i][0], true);
        TEST_ASSERT_EQUAL_UINT32(rows[i][1], chip.tim1.CCR[0]);
    }
}

static void test_safe_state_switches_all_off_until_the_drive_has_noticed(void)
{
    write(0x13F, 65535, true);
    output_safe();
    TEST_ASSERT_EQUAL_HEX(0, pins());
    TEST_ASSERT_EQUAL_UINT32(0, chip.tim1.CCR[0]);
    write(0x13F, 65535, true);
    TEST_ASSERT_EQUAL_HEX(0, pins());
    TEST_ASSERT_EQUAL_UINT32(0, chip.tim1.CCR[0]);
    write(0, 0, false);
    write(0x13F, 65535, true);
    TEST_ASSERT_EQUAL_HEX(0x13F, pins());
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_all_is_off_at_power_on_and_the_pwm_runs);
    RUN_TEST(test_each_bit_has_its_pin);
    RUN_TEST(test_power_is_the_duty_up_to_the_whole_period);
    RUN_TEST(test_safe_state_switches_all_off_until_the_drive_has_noticed);
    return UNITY_END();
}
