/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_output.c: the force outputs of the STM32F405: analog command, PWM, and the mean of a coarse output.
 */
#include <stdlib.h>

#include "chip.h"
#include "port/stm32f405/output.h"
#include "port/stm32f405/pins.h"
#include "unity.h"

enum { FULL_mN = 600000 };

static struct hal_axis_cfg cfg[AXES];

void setUp(void)
{
    chip_reset();
    output_init();
    cfg[AXIS_X] = (struct hal_axis_cfg){.full_scale_mN = FULL_mN, .pwm = {.hz = 40000, .duty_max = 1000}};
    cfg[AXIS_Y] = cfg[AXIS_X];
    output_configure(cfg);
}

void tearDown(void)
{
}

static void write_forces(int32_t x_mN, int32_t y_mN, bool enable)
{
    const struct hal_drive_out out = {.force_mN = {x_mN, y_mN}, .enable = {enable, enable}};
    output_write(&out);
}

static int32_t dac_x(void)
{
    return (int32_t)(chip.dac.DHR12RD & 0xFFFFu) - 2048;
}

static int32_t dac_y(void)
{
    return (int32_t)(chip.dac.DHR12RD >> 16) - 2048;
}

static void test_power_on_is_zero_volts_and_not_enabled(void)
{
    TEST_ASSERT_EQUAL_HEX32(0x08000800, chip.dac.DHR12RD);
    TEST_ASSERT_EQUAL_HEX32(DAC_CR_EN1 | DAC_CR_EN2, chip.dac.CR & (DAC_CR_EN1 | DAC_CR_EN2));
    TEST_ASSERT_FALSE(chip_pin('B', 12));
    TEST_ASSERT_FALSE(chip_pin('C', 8));
    TEST_ASSERT_EQUAL_UINT32(0, chip.tim8.CCR[0] | chip.tim8.CCR[1]);
}

static void test_a_pin_that_a_board_does_not_have_is_not_set_up(void)
{
    const uint32_t clocks = chip.rcc.AHB1ENR;
    pin_setup_low(PIN_NONE);
    TEST_ASSERT_EQUAL_HEX32(clocks, chip.rcc.AHB1ENR);
}

static void test_force_is_a_share_of_full_scale_and_saturates(void)
{
    write_forces(FULL_mN / 2, -FULL_mN / 4, true);
    TEST_ASSERT_EQUAL_INT32(1024, dac_x());
    TEST_ASSERT_EQUAL_INT32(-512, dac_y());
    write_forces(2 * FULL_mN, -2 * FULL_mN, true);
    TEST_ASSERT_EQUAL_INT32(2047, dac_x());
    TEST_ASSERT_EQUAL_INT32(-2048, dac_y());
    write_forces(3000000, INT32_MIN + 1, true);
    TEST_ASSERT_EQUAL_INT32(2047, dac_x());
    TEST_ASSERT_EQUAL_INT32(-2048, dac_y());
}

static void test_an_axis_that_is_not_enabled_gets_no_force(void)
{
    write_forces(FULL_mN, FULL_mN, true);
    TEST_ASSERT_TRUE(chip_pin('B', 12));
    TEST_ASSERT_TRUE(chip_pin('C', 8));
    write_forces(FULL_mN, FULL_mN, false);
    TEST_ASSERT_EQUAL_HEX32(0x08000800, chip.dac.DHR12RD);
    TEST_ASSERT_FALSE(chip_pin('B', 12));
    TEST_ASSERT_FALSE(chip_pin('C', 8));
}

static void test_a_brake_is_released_by_command_and_engaged_by_everything_else(void)
{
    struct hal_drive_out released = {.enable = {true, true}, .release = {true, false}};
    TEST_ASSERT_FALSE(chip_pin('D', 2) || chip_pin('A', 3));
    output_write(&released);
    TEST_ASSERT_TRUE(chip_pin('D', 2));
    TEST_ASSERT_FALSE(chip_pin('A', 3));
    released.release[AXIS_Y] = true;
    output_write(&released);
    TEST_ASSERT_TRUE(chip_pin('D', 2) && chip_pin('A', 3));
    write_forces(0, 0, true);
    TEST_ASSERT_FALSE(chip_pin('D', 2) || chip_pin('A', 3));
    output_write(&released);
    output_safe();
    TEST_ASSERT_FALSE(chip_pin('D', 2) || chip_pin('A', 3));
}

static uint8_t fault_of(int axis)
{
    struct hal_drive_in in = {0};
    output_read(&in);
    return in.inputs[axis];
}

/* The hardware clears MOE and sets BIF. */
static void test_a_break_is_a_fault_of_the_axes_with_pwm_and_pwm_is_on_again_without_power_alone(void)
{
    cfg[AXIS_Y].output = HAL_OUTPUT_PWM;
    output_configure(cfg);
    TEST_ASSERT_EQUAL_HEX32(TIM_BDTR_BKE | TIM_BDTR_BKP, chip.tim8.BDTR & (TIM_BDTR_BKE | TIM_BDTR_BKP));
    TEST_ASSERT_EQUAL_HEX8(0, fault_of(AXIS_Y));
    chip.tim8.SR = TIM_SR_BIF;
    TEST_ASSERT_EQUAL_HEX8(HAL_AMPLIFIER_FAULT, fault_of(AXIS_Y));
    TEST_ASSERT_EQUAL_HEX32(0, chip.tim8.SR & TIM_SR_BIF);
    TEST_ASSERT_EQUAL_HEX8(0, fault_of(AXIS_X));
    chip.tim8.BDTR &= ~(uint32_t)TIM_BDTR_MOE;
    write_forces(FULL_mN, FULL_mN, true);
    TEST_ASSERT_EQUAL_HEX32(0, chip.tim8.BDTR & TIM_BDTR_MOE);
    TEST_ASSERT_EQUAL_HEX8(HAL_AMPLIFIER_FAULT, fault_of(AXIS_Y)); /* as long as PWM is off */
    write_forces(0, 0, false);
    TEST_ASSERT_EQUAL_HEX32(TIM_BDTR_MOE, chip.tim8.BDTR & TIM_BDTR_MOE);
    TEST_ASSERT_EQUAL_HEX8(0, fault_of(AXIS_Y));
}

/* One step of the output is 293 mN. */
static void test_the_mean_of_the_steps_is_the_force_to_a_thousandth_of_a_step(void)
{
    static const int32_t forces[] = {1, 100, -100, 146, 147, 12345, -98765, 300001};
    for (unsigned f = 0; f < sizeof forces / sizeof forces[0]; f++) {
        int64_t sum = 0;
        write_forces(0, 0, false);
        for (int i = 0; i < 10000; i++) {
            write_forces(forces[f], 0, true);
            TEST_ASSERT_LESS_OR_EQUAL_INT64(FULL_mN, llabs((int64_t)dac_x() * FULL_mN - (int64_t)forces[f] * 2048));
            sum += dac_x();
        }
        TEST_ASSERT_INT64_WITHIN(FULL_mN / 1000, forces[f] * 2048LL, sum * FULL_mN / 10000);
    }
}

static void test_saturation_leaves_no_rounding_error(void)
{
    for (int i = 0; i < 1000; i++) {
        write_forces(2 * FULL_mN, 0, true);
    }
    write_forces(0, 0, true);
    TEST_ASSERT_EQUAL_INT32(0, dac_x());
}

static void test_pwm_is_a_magnitude_and_a_direction_and_leaves_the_analog_command_at_zero(void)
{
    cfg[AXIS_X].output = HAL_OUTPUT_PWM;
    output_configure(cfg);
    write_forces(FULL_mN / 2, FULL_mN / 2, true);
    TEST_ASSERT_EQUAL_UINT32(2100, chip.tim8.CCR[0]);
    TEST_ASSERT_FALSE(chip_pin('B', 14));
    TEST_ASSERT_EQUAL_INT32(0, dac_x());
    TEST_ASSERT_EQUAL_INT32(1024, dac_y());
    TEST_ASSERT_EQUAL_UINT32(0, chip.tim8.CCR[1]);
    write_forces(-FULL_mN, 0, true);
    TEST_ASSERT_EQUAL_UINT32(4200, chip.tim8.CCR[0]); /* above ARR the output is always on */
    TEST_ASSERT_TRUE(chip_pin('B', 14));
    TEST_ASSERT_EQUAL_UINT32(4199, chip.tim8.ARR);
}

static void configure_pwm(uint32_t hz, bool antiphase, uint16_t duty_min, uint16_t duty_max)
{
    for (int i = 0; i < AXES; i++) {
        cfg[i].output = HAL_OUTPUT_PWM;
        cfg[i].pwm = (struct hal_pwm_cfg){hz, antiphase, duty_min, duty_max};
    }
    output_configure(cfg);
}

static void test_pwm_has_the_frequency_and_the_duties_of_its_parameters(void)
{
    configure_pwm(20000, false, 100, 950); /* of 8400 steps */
    TEST_ASSERT_EQUAL_UINT32(8399, chip.tim8.ARR);
    write_forces(FULL_mN, -FULL_mN / 2, true);
    TEST_ASSERT_EQUAL_UINT32(7980, chip.tim8.CCR[0]);
    TEST_ASSERT_EQUAL_UINT32(840 + 3570, chip.tim8.CCR[1]);
    TEST_ASSERT_FALSE(chip_pin('B', 14));
    TEST_ASSERT_TRUE(chip_pin('B', 15));
    write_forces(0, 0, false);
    TEST_ASSERT_EQUAL_UINT32(840, chip.tim8.CCR[0]);
    TEST_ASSERT_NOT_EQUAL_HEX32(0, chip.dbgmcu.APB2_FZ & DBGMCU_APB2_FZ_TIM8);
}

static void test_pwm_in_antiphase_has_no_force_in_its_middle_and_no_direction(void)
{
    configure_pwm(40000, true, 0, 1000);
    write_forces(0, 0, false);
    TEST_ASSERT_EQUAL_UINT32(2100, chip.tim8.CCR[0]);
    write_forces(FULL_mN, -FULL_mN, true);
    TEST_ASSERT_EQUAL_UINT32(4200, chip.tim8.CCR[0]);
    TEST_ASSERT_EQUAL_UINT32(0, chip.tim8.CCR[1]);
    TEST_ASSERT_FALSE(chip_pin('B', 14) || chip_pin('B', 15));
    configure_pwm(40000, true, 100, 900);
    write_forces(2 * FULL_mN, -2 * FULL_mN, true);
    TEST_ASSERT_EQUAL_UINT32(3780, chip.tim8.CCR[0]);
    TEST_ASSERT_EQUAL_UINT32(420, chip.tim8.CCR[1]);
    TEST_ASSERT_EQUAL_HEX32(0, chip.dbgmcu.APB2_FZ & DBGMCU_APB2_FZ_TIM8); /* pins that are low would be a force */
}

/* 100 mV of 10 V are 20.48 of 2048 codes. */
static void test_the_offset_of_the_analog_command_is_there_with_and_without_power(void)
{
    cfg[AXIS_X].offset = 1000;
    cfg[AXIS_Y].offset = -1000;
    output_configure(cfg);
    write_forces(0, 0, false);
    TEST_ASSERT_EQUAL_INT32(20, dac_x());
    TEST_ASSERT_EQUAL_INT32(-20, dac_y());
    int32_t sum = 0;
    for (int i = 0; i < 100; i++) {
        write_forces(0, 0, true);
        sum += dac_x();
    }
    TEST_ASSERT_EQUAL_INT32(2048, sum);
    write_forces(FULL_mN, -FULL_mN, true);
    TEST_ASSERT_EQUAL_INT32(2047, dac_x());
    TEST_ASSERT_EQUAL_INT32(-2048, dac_y());
    output_safe();
    TEST_ASSERT_EQUAL_HEX32(0x08000800, chip.dac.DHR12RD);
}

static void test_a_direction_turned_round_by_parameter_is_turned_round(void)
{
    cfg[AXIS_X].invert_force = true;
    output_configure(cfg);
    write_forces(FULL_mN / 2, FULL_mN / 2, true);
    TEST_ASSERT_EQUAL_INT32(-1024, dac_x());
    TEST_ASSERT_EQUAL_INT32(1024, dac_y());
}

static void test_safe_outputs_are_safe_after_any_output(void)
{
    cfg[AXIS_Y].output = HAL_OUTPUT_PWM;
    output_configure(cfg);
    write_forces(FULL_mN, FULL_mN, true);
    output_safe();
    TEST_ASSERT_EQUAL_HEX32(0x08000800, chip.dac.DHR12RD);
    TEST_ASSERT_FALSE(chip_pin('B', 12));
    TEST_ASSERT_FALSE(chip_pin('C', 8));
    TEST_ASSERT_EQUAL_UINT32(0, chip.tim8.CCR[1]);
    TEST_ASSERT_EQUAL_UINT32(0, chip.tim8.BDTR & TIM_BDTR_MOE);
}

/* An NMI makes the outputs safe, and the servo tick goes on until it notices. */
static void test_safe_outputs_stay_so_until_no_axis_is_to_be_enabled(void)
{
    cfg[AXIS_Y].output = HAL_OUTPUT_PWM;
    output_configure(cfg);
    write_forces(FULL_mN, FULL_mN, true);
    output_safe();
    for (int i = 0; i < 3; i++) {
        write_forces(FULL_mN, FULL_mN, true);
        TEST_ASSERT_EQUAL_HEX32(0x08000800, chip.dac.DHR12RD);
        TEST_ASSERT_FALSE(chip_pin('B', 12) || chip_pin('C', 8));
        TEST_ASSERT_EQUAL_UINT32(0, chip.tim8.CCR[1]);
        TEST_ASSERT_EQUAL_UINT32(0, chip.tim8.BDTR & TIM_BDTR_MOE);
    }
    write_forces(0, 0, false);
    write_forces(FULL_mN / 2, FULL_mN / 2, true);
    TEST_ASSERT_TRUE(chip_pin('B', 12) && chip_pin('C', 8));
    TEST_ASSERT_EQUAL_INT32(1024, dac_x());
    TEST_ASSERT_EQUAL_UINT32(2100, chip.tim8.CCR[1]);
    TEST_ASSERT_NOT_EQUAL_UINT32(0, chip.tim8.BDTR & TIM_BDTR_MOE); /* its pins are driven again */
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_power_on_is_zero_volts_and_not_enabled);
    RUN_TEST(test_a_pin_that_a_board_does_not_have_is_not_set_up);
    RUN_TEST(test_force_is_a_share_of_full_scale_and_saturates);
    RUN_TEST(test_an_axis_that_is_not_enabled_gets_no_force);
    RUN_TEST(test_a_brake_is_released_by_command_and_engaged_by_everything_else);
    RUN_TEST(test_a_break_is_a_fault_of_the_axes_with_pwm_and_pwm_is_on_again_without_power_alone);
    RUN_TEST(test_the_mean_of_the_steps_is_the_force_to_a_thousandth_of_a_step);
    RUN_TEST(test_saturation_leaves_no_rounding_error);
    RUN_TEST(test_pwm_is_a_magnitude_and_a_direction_and_leaves_the_analog_command_at_zero);
    RUN_TEST(test_pwm_has_the_frequency_and_the_duties_of_its_parameters);
    RUN_TEST(test_pwm_in_antiphase_has_no_force_in_its_middle_and_no_direction);
    RUN_TEST(test_the_offset_of_the_analog_command_is_there_with_and_without_power);
    RUN_TEST(test_a_direction_turned_round_by_parameter_is_turned_round);
    RUN_TEST(test_safe_outputs_are_safe_after_any_output);
    RUN_TEST(test_safe_outputs_stay_so_until_no_axis_is_to_be_enabled);
    return UNITY_END();
}
