/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_feather.c: the second board (board_feather.h), with 16-bit encoder timers, no index pulse, and no pins
 * for some switches. The modules are part of this program, compiled for that board.
 */
#define BOARD_HEADER "port/stm32f405/board_feather.h"
#include "port/stm32f405/encoder.c"

#define axes input_axes
#include "port/stm32f405/inputs.c"
#undef axes

#include "chip.h"
#include "unity.h"

void setUp(void)
{
    chip_reset();
    encoder_init();
    inputs_init();
}

void tearDown(void)
{
}

static struct hal_drive_in read_at(uint32_t x, uint32_t y)
{
    struct hal_drive_in in = {0};
    chip.tim3.CNT = x;
    chip.tim4.CNT = y;
    encoder_read(&in);
    return in;
}

static void test_timers_are_of_16_bits_and_capture_no_index(void)
{
    TEST_ASSERT_EQUAL_HEX32(0xFFFF, chip.tim3.ARR);
    TEST_ASSERT_EQUAL_HEX32(0xFFFF, chip.tim4.ARR);
    TEST_ASSERT_EQUAL_HEX32(0, chip.tim3.CCER);
    TEST_ASSERT_EQUAL_HEX32(0, chip.tim4.CCER);
}

static void test_counts_go_on_over_32_bits_both_ways(void)
{
    uint32_t x = 0, y = 0;
    for (int i = 0; i < 10; i++) {
        x = (x + 30000) & 0xFFFFu;
        y = (y - 30000) & 0xFFFFu;
        const struct hal_drive_in in = read_at(x, y);
        TEST_ASSERT_EQUAL_INT32(30000 * (i + 1), in.count[AXIS_X]);
        TEST_ASSERT_EQUAL_INT32(-30000 * (i + 1), in.count[AXIS_Y]);
        TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X] | in.inputs[AXIS_Y]);
    }
}

static void test_jump_is_the_short_way_round(void)
{
    const struct hal_axis_cfg cfg[AXES] = {{.jump_counts = 500}, {.jump_counts = 500}};
    encoder_configure(cfg);
    struct hal_drive_in in = read_at(0x10000 - 500, 501);
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X]);
    TEST_ASSERT_EQUAL_INT32(-500, in.count[AXIS_X]);
    TEST_ASSERT_EQUAL_UINT8(HAL_ENCODER_FAULT, in.inputs[AXIS_Y]);
    in = read_at(1, 501);
    TEST_ASSERT_EQUAL_UINT8(HAL_ENCODER_FAULT, in.inputs[AXIS_X]); /* 501 */
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_Y]);
}

static void test_there_are_no_index_pulses_whatever_the_timer_says(void)
{
    chip.tim3.SR = chip.tim4.SR = 0xFFFFFFFF;
    const struct hal_drive_in in = read_at(100, 100);
    TEST_ASSERT_EQUAL_UINT8(0, in.index_pulses[AXIS_X] | in.index_pulses[AXIS_Y]);
}

static void test_a_switch_without_a_pin_is_never_active_and_the_others_are(void)
{
    struct hal_drive_in in = {0};
    for (unsigned i = 0; i < GPIO_PORTS; i++) {
        chip.gpio[i].IDR = 0xFFFF; /* every contact is open */
    }
    for (int i = 0; i < 3; i++) {
        inputs_read(&in);
    }
    TEST_ASSERT_EQUAL_HEX8(HAL_STOP | HAL_AMPLIFIER_FAULT, in.inputs[AXIS_X]);
    TEST_ASSERT_EQUAL_HEX8(HAL_STOP | HAL_AMPLIFIER_FAULT, in.inputs[AXIS_Y]);
}

static void test_no_pin_is_neither_set_up_nor_driven_nor_read(void)
{
    chip_reset();
    struct gpio before[GPIO_PORTS];
    for (unsigned i = 0; i < GPIO_PORTS; i++) {
        before[i] = chip.gpio[i];
    }
    pin_setup(PIN_NONE, PIN_OUTPUT, PIN_PULL_UP, 0);
    pin_write(PIN_NONE, true);
    TEST_ASSERT_EQUAL_MEMORY(before, (const void *)chip.gpio, sizeof before);
    TEST_ASSERT_EQUAL_HEX32(0, chip.rcc.AHB1ENR);
    TEST_ASSERT_FALSE(pin_read(PIN_NONE));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_timers_are_of_16_bits_and_capture_no_index);
    RUN_TEST(test_counts_go_on_over_32_bits_both_ways);
    RUN_TEST(test_jump_is_the_short_way_round);
    RUN_TEST(test_there_are_no_index_pulses_whatever_the_timer_says);
    RUN_TEST(test_a_switch_without_a_pin_is_never_active_and_the_others_are);
    RUN_TEST(test_no_pin_is_neither_set_up_nor_driven_nor_read);
    return UNITY_END();
}
