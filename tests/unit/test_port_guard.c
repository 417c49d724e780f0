/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_guard.c: inputs, watchdog and flash sectors of the STM32F405. */
#include <string.h>

#include "chip.h"
#include "port/stm32f405/cycles.h"
#include "port/stm32f405/inputs.h"
#include "port/stm32f405/output.h"
#include "port/stm32f405/sectors.h"
#include "port/stm32f405/watchdog.h"
#include "unity.h"

void setUp(void)
{
    chip_reset();
    output_init();
}

void tearDown(void)
{
}

/* ---- cycles of a servo tick ---- */

static void tick_of(uint32_t cycles)
{
    cycles_begin();
    chip.dwt.CYCCNT += cycles;
    cycles_end();
}

static void expect_cycles(uint32_t last, uint32_t worst)
{
    struct hal_health h;
    cycles_read(&h);
    TEST_ASSERT_EQUAL_UINT32(last, h.tick_cycles);
    TEST_ASSERT_EQUAL_UINT32(worst, h.tick_cycles_worst);
}

static void test_the_cycles_of_the_last_tick_and_of_the_worst_since_the_start_are_kept(void)
{
    cycles_start();
    TEST_ASSERT_EQUAL_HEX32(DEBUG_DEMCR_TRCENA, chip.debug.DEMCR);
    TEST_ASSERT_EQUAL_HEX32(DWT_CTRL_CYCCNTENA, chip.dwt.CTRL);
    chip.dwt.CYCCNT = UINT32_MAX - 10; /* it wraps every 25 s */
    tick_of(3000);
    tick_of(4000);
    tick_of(2000);
    expect_cycles(2000, 4000);
    cycles_start();
    tick_of(1000);
    expect_cycles(1000, 1000);
}

/* ---- inputs ---- */

static uint8_t inputs_of(int axis)
{
    struct hal_drive_in in = {0};
    inputs_read(&in);
    return in.inputs[axis];
}

static void all_wires_intact(void)
{
    memset((void *)chip.gpio, 0, sizeof chip.gpio);
    inputs_init();
}

static void test_an_input_is_active_when_its_wire_is_open_for_three_reads(void)
{
    all_wires_intact();
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
    all_wires_intact();
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
        all_wires_intact();
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

static void test_the_watchdog_runs_at_50_ms(void)
{
    watchdog_start();
    TEST_ASSERT_EQUAL_UINT32(50, 1000u * (4u << chip.iwdg.PR) * (chip.iwdg.RLR + 1u) / 32000u);
    TEST_ASSERT_TRUE(was_fed());
}

static void test_the_window_watchdog_runs_at_3_ms_and_the_servo_tick_feeds_it(void)
{
    watchdog_start();
    TEST_ASSERT_EQUAL_HEX32(RCC_APB1ENR_WWDG, chip.rcc.APB1ENR & RCC_APB1ENR_WWDG);
    TEST_ASSERT_EQUAL_HEX32(0x7F, chip.wwdg.CFR);
    TEST_ASSERT_EQUAL_UINT32(31207, 10ull * 4096 * ((chip.wwdg.CR & 0x3F) + 1) / 42); /* 0.1 us */
    const uint32_t fed = chip.wwdg.CR;
    TEST_ASSERT_EQUAL_HEX32(WWDG_CR_WDGA | WWDG_CR_T6, fed & (WWDG_CR_WDGA | WWDG_CR_T6));
    chip.wwdg.CR = 0;
    watchdog_pass(7, true);
    TEST_ASSERT_EQUAL_HEX32(0, chip.wwdg.CR);
    watchdog_tick();
    TEST_ASSERT_EQUAL_HEX32(fed, chip.wwdg.CR);
}

static void test_the_watchdog_runs_on_in_a_debugger_when_it_must(void)
{
    chip.dbgmcu.APB1_FZ = 1; /* a bit of the debugger's own */
    watchdog_in_halt(false);
    TEST_ASSERT_EQUAL_HEX32(1u | DBGMCU_APB1_FZ_IWDG | DBGMCU_APB1_FZ_WWDG, chip.dbgmcu.APB1_FZ);
    watchdog_in_halt(true);
    TEST_ASSERT_EQUAL_HEX32(1, chip.dbgmcu.APB1_FZ);
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

static void test_the_flash_is_unlocked_when_it_is_locked(void)
{
    const uint32_t word = 0x01234567;
    TEST_ASSERT_TRUE(sectors_write(0, 0, &word, 4)); /* as a boot loader leaves it */
    TEST_ASSERT_EQUAL_HEX32(0, chip.flash.KEYR);
    TEST_ASSERT_TRUE(sectors_write(0, 4, &word, 4));
    TEST_ASSERT_EQUAL_HEX32(FLASH_KEY2, chip.flash.KEYR);
}

static void test_memory_outside_the_store_is_not_touched(void)
{
    const uint32_t words[2] = {0, 0};
    TEST_ASSERT_FALSE(sectors_write(2, 0, words, 8));
    TEST_ASSERT_FALSE(sectors_write(0, 16380, words, 8));
    TEST_ASSERT_FALSE(sectors_write(0, 2, words, 4));
    TEST_ASSERT_FALSE(sectors_write(0, 0, words, 6));
    TEST_ASSERT_FALSE(sectors_write(0, 16388, words, 0));
    TEST_ASSERT_FALSE(sectors_write(0, UINT32_MAX - 3, words, 8)); /* the end wraps */
    uint32_t back = 7;
    sectors_read(2, 0, &back, 4);
    sectors_read(0, 16384, &back, 4);
    TEST_ASSERT_EQUAL_UINT32(7, back);
    TEST_ASSERT_FALSE(sectors_erase(2));
    TEST_ASSERT_EQUAL_HEX32(0, chip.flash.KEYR);
}

static void test_in_an_emulator_the_store_is_in_ram_and_behaves_the_same(void)
{
    const uint32_t words[2] = {0x01234567, 0xFFFFFFFF}, more = 0;
    uint32_t back[3];
    chip_emulate();
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

static void test_a_flash_that_stays_busy_is_an_error_after_a_bounded_wait(void)
{
    const uint32_t word = 0x12345678;
    chip.flash.SR = FLASH_SR_BSY;
    TEST_ASSERT_FALSE(sectors_write(0, 0, &word, 4));
    TEST_ASSERT_TRUE(was_fed()); /* an erasure takes longer than the periods of the watchdogs */
    TEST_ASSERT_EQUAL_HEX32(WWDG_CR_WDGA, chip.wwdg.CR & WWDG_CR_WDGA);
    TEST_ASSERT_EQUAL_HEX32(FLASH_CR_LOCK, chip.flash.CR);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_the_cycles_of_the_last_tick_and_of_the_worst_since_the_start_are_kept);
    RUN_TEST(test_an_input_is_active_when_its_wire_is_open_for_three_reads);
    RUN_TEST(test_a_spike_on_a_wire_is_no_input);
    RUN_TEST(test_each_wire_is_the_input_of_the_pin_table);
    RUN_TEST(test_the_watchdog_runs_at_50_ms);
    RUN_TEST(test_the_window_watchdog_runs_at_3_ms_and_the_servo_tick_feeds_it);
    RUN_TEST(test_the_watchdog_runs_on_in_a_debugger_when_it_must);
    RUN_TEST(test_the_watchdog_is_fed_when_tick_and_background_are_well);
    RUN_TEST(test_the_watchdog_starves_when_the_servo_tick_stands);
    RUN_TEST(test_the_watchdog_starves_when_the_background_does_not_keep_up);
    RUN_TEST(test_words_written_are_read_back_and_the_flash_is_locked_again);
    RUN_TEST(test_the_flash_is_unlocked_when_it_is_locked);
    RUN_TEST(test_memory_outside_the_store_is_not_touched);
    RUN_TEST(test_in_an_emulator_the_store_is_in_ram_and_behaves_the_same);
    RUN_TEST(test_a_sector_that_does_not_erase_is_an_error);
    RUN_TEST(test_a_flash_that_stays_busy_is_an_error_after_a_bounded_wait);
    return UNITY_END();
}
