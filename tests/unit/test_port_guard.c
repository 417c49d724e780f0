/* SPDX-License-Identifier: Apache-2.0 */
/* What guards the STM32F405: inputs, watchdog, crash record, flash sectors. */
#include <string.h>

#include "chip.h"
#include "crash.h"
#include "inputs.h"
#include "output.h"
#include "sectors.h"
#include "unity.h"
#include "watchdog.h"

extern uint32_t kontur_stack_bottom[16]; /* tests/unit/chip.c */

void setUp(void)
{
    chip_reset();
    output_init();
}

void tearDown(void)
{
}

/* ---- inputs ---- */

static uint8_t inputs_of(int axis)
{
    struct hal_drive_in in = {0};
    inputs_read(&in);
    return in.inputs[axis];
}

static void all_wires_whole(void)
{
    memset((void *)chip.gpio, 0, sizeof chip.gpio);
    inputs_init();
}

static void test_an_input_is_active_when_its_wire_is_open_for_three_reads(void)
{
    all_wires_whole();
    TEST_ASSERT_EQUAL_UINT8(0, inputs_of(AXIS_X));
    chip_drive_pin('C', 5, true);
    TEST_ASSERT_EQUAL_UINT8(0, inputs_of(AXIS_X));
    TEST_ASSERT_EQUAL_UINT8(0, inputs_of(AXIS_X));
    TEST_ASSERT_EQUAL_UINT8(HAL_AMPLIFIER_FAULT, inputs_of(AXIS_X));
    chip_drive_pin('C', 5, false);
    TEST_ASSERT_EQUAL_UINT8(0, inputs_of(AXIS_X));
}

static void test_a_spike_on_a_wire_is_no_input(void)
{
    all_wires_whole();
    for (int i = 0; i < 30; i++) {
        chip_drive_pin('C', 4, i % 3 != 0);
        TEST_ASSERT_EQUAL_UINT8(0, inputs_of(AXIS_Y));
    }
}

static void test_each_wire_is_the_input_of_the_pin_table(void)
{
    static const struct {
        char port;
        unsigned pin;
        uint8_t x, y;
    } rows[] = {
        {'C', 0, HAL_LIMIT_MIN, 0},   {'C', 1, HAL_LIMIT_MAX, 0}, {'C', 5, HAL_AMPLIFIER_FAULT, 0},
        {'C', 2, 0, HAL_LIMIT_MIN},   {'C', 3, 0, HAL_LIMIT_MAX}, {'B', 1, 0, HAL_AMPLIFIER_FAULT},
        {'C', 4, HAL_STOP, HAL_STOP},
    };
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        struct hal_drive_in in = {0};
        all_wires_whole();
        chip_drive_pin(rows[i].port, rows[i].pin, true);
        inputs_read(&in);
        inputs_read(&in);
        inputs_read(&in);
        TEST_ASSERT_EQUAL_HEX8(rows[i].x, in.inputs[AXIS_X]);
        TEST_ASSERT_EQUAL_HEX8(rows[i].y, in.inputs[AXIS_Y]);
    }
}

/* ---- watchdog ---- */

static bool was_fed(void)
{
    const bool fed = chip.iwdg.KR == IWDG_KEY_FEED;
    chip.iwdg.KR = 0;
    return fed;
}

static void test_the_watchdog_runs_at_50_ms_and_stands_still_in_a_debugger(void)
{
    watchdog_start();
    TEST_ASSERT_EQUAL_UINT32(50, 1000u * (4u << chip.iwdg.PR) * (chip.iwdg.RLR + 1u) / 32000u);
    TEST_ASSERT_EQUAL_HEX32(DBGMCU_APB1_FZ_IWDG, chip.dbgmcu.APB1_FZ);
    TEST_ASSERT_TRUE(was_fed());
}

static void test_the_watchdog_is_fed_when_tick_and_background_are_well(void)
{
    for (uint32_t tick = 1; tick < 100; tick++) {
        watchdog_pass(tick, true);
        TEST_ASSERT_TRUE(was_fed());
    }
}

static void test_the_watchdog_starves_when_the_servo_tick_stands(void)
{
    watchdog_pass(1000, true);
    (void)was_fed();
    for (int i = 0; i < 1000; i++) {
        watchdog_pass(1000, true);
        TEST_ASSERT_FALSE(was_fed());
    }
}

static void test_the_watchdog_starves_when_the_background_does_not_keep_up(void)
{
    (void)was_fed();
    for (uint32_t tick = 2000; tick < 3000; tick++) {
        watchdog_pass(tick, false);
        TEST_ASSERT_FALSE(was_fed());
    }
}

/* ---- crash ---- */

static void push(void)
{
    const struct hal_axis_cfg cfg[AXES] = {{.full_scale_mN = 100000}, {.full_scale_mN = 100000}};
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

/* As at power-on: whatever an earlier test has left is gone. */
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
    push();
    TEST_ASSERT_TRUE(chip_pin('B', 12));
    crash_at(0x0800BEEE);
    TEST_ASSERT_FALSE(chip_pin('B', 12));
    TEST_ASSERT_FALSE(chip_pin('B', 13));
    TEST_ASSERT_EQUAL_HEX32(0x08000800, chip.dac.DHR12RD);
    TEST_ASSERT_EQUAL_UINT32(0, chip.tim8.BDTR & TIM_BDTR_MOE);
    TEST_ASSERT_EQUAL_HEX32(SCB_AIRCR_KEY | SCB_AIRCR_SYSRESETREQ, chip.scb.AIRCR);
}

static void test_the_record_of_a_crash_outlives_the_reset_and_is_told_once(void)
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

static void test_a_crash_with_the_stack_lost_is_recorded_without_its_place(void)
{
    enum hal_reset reset;
    struct hal_crash crash;
    power_on();
    uint32_t elsewhere[8] = {0};
    crash_record(elsewhere);
    crash_read(&reset, &crash);
    TEST_ASSERT_EQUAL(HAL_RESET_CRASH, reset);
    TEST_ASSERT_EQUAL_HEX32(0, crash.pc);
    TEST_ASSERT_EQUAL_UINT32(1, crash.count);
}

static void test_a_watchdog_reset_is_told(void)
{
    enum hal_reset reset;
    struct hal_crash crash;
    power_on();
    chip.rcc.CSR = RCC_CSR_IWDGRSTF | RCC_CSR_PINRSTF;
    crash_read(&reset, &crash);
    TEST_ASSERT_EQUAL(HAL_RESET_WATCHDOG, reset);
}

/* ---- flash sectors ---- */

static void test_words_written_are_read_back_and_the_flash_is_locked_again(void)
{
    const uint32_t words[3] = {0x01234567, 0x89ABCDEF, 0};
    uint32_t back[3];
    TEST_ASSERT_TRUE(sectors_write(1, 16380 - 8, words, sizeof words));
    sectors_read(1, 16380 - 8, back, sizeof back);
    TEST_ASSERT_EQUAL_HEX32_ARRAY(words, back, 3);
    TEST_ASSERT_EQUAL_HEX32(words[2], chip_store[8191]);
    TEST_ASSERT_EQUAL_HEX32(FLASH_CR_LOCK, chip.flash.CR);
}

static void test_what_is_outside_the_store_is_not_touched(void)
{
    const uint32_t words[2] = {0, 0};
    TEST_ASSERT_FALSE(sectors_write(2, 0, words, 8));
    TEST_ASSERT_FALSE(sectors_write(0, 16380, words, 8));
    TEST_ASSERT_FALSE(sectors_write(0, 2, words, 4));
    TEST_ASSERT_FALSE(sectors_write(0, 0, words, 6));
    TEST_ASSERT_FALSE(sectors_erase(2));
    TEST_ASSERT_EQUAL_HEX32(0, chip.flash.KEYR);
}

static void test_in_an_emulator_the_store_is_in_ram_and_behaves_the_same(void)
{
    const uint32_t words[2] = {0x01234567, 0xFFFFFFFF}, more = 0;
    uint32_t back[3];
    chip.rcc.CR = 0;
    sectors_read(0, 0, back, 4);
    TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFF, back[0]);
    TEST_ASSERT_TRUE(sectors_write(0, 0, words, 8));
    TEST_ASSERT_TRUE(sectors_write(0, 4, &more, 4));
    TEST_ASSERT_FALSE(sectors_write(0, 4, &words[1], 4)); /* a word is written once */
    sectors_read(0, 0, back, 12);
    TEST_ASSERT_EQUAL_HEX32(0x01234567, back[0]);
    TEST_ASSERT_EQUAL_HEX32(0, back[1]);
    TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFF, back[2]);
    TEST_ASSERT_TRUE(sectors_erase(0));
    sectors_read(0, 0, back, 4);
    TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFF, back[0]);
}

static void test_a_sector_that_does_not_erase_is_an_error(void)
{
    TEST_ASSERT_TRUE(sectors_erase(0));
    chip_store[100] = 0xFFFFFFFE;
    TEST_ASSERT_FALSE(sectors_erase(0));
    TEST_ASSERT_TRUE(sectors_erase(1));
    TEST_ASSERT_EQUAL_HEX32(FLASH_ACR_DCEN, chip.flash.ACR & (FLASH_ACR_DCEN | FLASH_ACR_DCRST));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_an_input_is_active_when_its_wire_is_open_for_three_reads);
    RUN_TEST(test_a_spike_on_a_wire_is_no_input);
    RUN_TEST(test_each_wire_is_the_input_of_the_pin_table);
    RUN_TEST(test_the_watchdog_runs_at_50_ms_and_stands_still_in_a_debugger);
    RUN_TEST(test_the_watchdog_is_fed_when_tick_and_background_are_well);
    RUN_TEST(test_the_watchdog_starves_when_the_servo_tick_stands);
    RUN_TEST(test_the_watchdog_starves_when_the_background_does_not_keep_up);
    RUN_TEST(test_a_hard_fault_makes_outputs_safe_and_resets);
    RUN_TEST(test_the_record_of_a_crash_outlives_the_reset_and_is_told_once);
    RUN_TEST(test_a_crash_with_the_stack_lost_is_recorded_without_its_place);
    RUN_TEST(test_a_watchdog_reset_is_told);
    RUN_TEST(test_words_written_are_read_back_and_the_flash_is_locked_again);
    RUN_TEST(test_what_is_outside_the_store_is_not_touched);
    RUN_TEST(test_in_an_emulator_the_store_is_in_ram_and_behaves_the_same);
    RUN_TEST(test_a_sector_that_does_not_erase_is_an_error);
    return UNITY_END();
}
