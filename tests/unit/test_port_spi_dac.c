/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_spi_dac.c: the serial DAC as output of an axis: the frames that it gets, and when. */
#include "chip.h"
#include "port/stm32f405/output.h"
#include "port/stm32f405/pins.h"
#include "unity.h"

enum { FULL_mN = 600000, FRAMES = 16, WAITS = 4 };

static uint32_t frames[FRAMES];
static unsigned count, waits;
static bool selected;

/* Each frame waits for TXE four times: before each byte, when DR still has the byte before, and at its end. */
static bool take(const reg *r, uint32_t mask, uint32_t value)
{
    (void)value;
    if (r == &chip.spi3.SR && mask == SPI_SR_TXE && count < FRAMES) {
        frames[count] = frames[count] << 8 | (chip.spi3.DR & 0xFFu);
        selected = !chip_pin('C', 11);
        waits++;
        if (waits % WAITS == 0) {
            frames[count] &= 0xFFFFFFu;
            TEST_ASSERT_TRUE(selected);
            count++;
        }
    }
    return true;
}

static void listen(void)
{
    count = waits = 0;
    for (int i = 0; i < FRAMES; i++) {
        frames[i] = 0;
    }
}

static void expect_frames(const uint32_t *expected, unsigned n)
{
    TEST_ASSERT_EQUAL_UINT(n, count);
    TEST_ASSERT_EQUAL_HEX32_ARRAY(expected, frames, n);
    TEST_ASSERT_TRUE(chip_pin('C', 11));
}

/* Reset all, LDAC inactive, reference on with gain 2 */
static const uint32_t configuration[] = {0x280001, 0x300003, 0x380001};

void setUp(void)
{
    chip_reset();
    chip_waits = take;
    listen();
    output_init();
}

void tearDown(void)
{
}

static void configure(enum hal_output x, enum hal_output y)
{
    const struct hal_axis_cfg cfg[AXES] = {{.output = x, .full_scale_mN = FULL_mN, .pwm.hz = 40000},
                                           {.output = y, .full_scale_mN = FULL_mN, .pwm.hz = 40000}};
    listen();
    output_configure(cfg);
}

static void write_forces(int32_t x_mN, int32_t y_mN, bool enable)
{
    const struct hal_drive_out out = {.force_mN = {x_mN, y_mN}, .enable = {enable, enable}};
    listen();
    output_write(&out);
}

static void test_it_is_configured_at_the_start(void)
{
    expect_frames(configuration, 3);
    TEST_ASSERT_EQUAL_HEX32(SPI_CR1_MSTR | SPI_CR1_CPHA | SPI_CR1_SPE | SPI_CR1_SSM | SPI_CR1_SSI | SPI_CR1_BIDIMODE |
                                SPI_CR1_BIDIOE,
                            chip.spi3.CR1);
}

static void test_it_is_configured_and_written_when_an_axis_uses_it_and_else_not(void)
{
    write_forces(FULL_mN, FULL_mN, true);
    TEST_ASSERT_EQUAL_UINT(0, count);
    configure(HAL_OUTPUT_DAC, HAL_OUTPUT_PWM);
    TEST_ASSERT_EQUAL_UINT(0, count);
    configure(HAL_OUTPUT_DAC, HAL_OUTPUT_SPI_DAC);
    expect_frames(configuration, 3);
    write_forces(FULL_mN, FULL_mN / 4, true);
    expect_frames((const uint32_t[]){0x008000, 0x11A000}, 2);
    TEST_ASSERT_EQUAL_HEX32(0x08000FFF, chip.dac.DHR12RD);
}

static void test_force_is_a_share_of_full_scale_in_16_bits_and_saturates(void)
{
    configure(HAL_OUTPUT_SPI_DAC, HAL_OUTPUT_SPI_DAC);
    write_forces(FULL_mN / 2, -FULL_mN / 32768, true);
    expect_frames((const uint32_t[]){0x00C000, 0x117FFF}, 2);
    write_forces(2 * FULL_mN, -2 * FULL_mN, true);
    expect_frames((const uint32_t[]){0x00FFFF, 0x110000}, 2);
    write_forces(FULL_mN, FULL_mN, false);
    expect_frames((const uint32_t[]){0x008000, 0x118000}, 2);
}

static void test_safe_outputs_set_both_channels_to_no_force_by_one_frame(void)
{
    configure(HAL_OUTPUT_SPI_DAC, HAL_OUTPUT_DAC);
    write_forces(FULL_mN, FULL_mN, true);
    waits = 3; /* it first waits for what is being sent */
    count = 0;
    frames[0] = 0;
    selected = true;
    chip.gpio[2].ODR &= ~(1u << 11); /* a frame is broken off */
    output_safe();
    TEST_ASSERT_EQUAL_UINT(2, count);
    TEST_ASSERT_EQUAL_HEX32(0x178000, frames[1]);
    TEST_ASSERT_TRUE(chip_pin('C', 11));
}

static uint32_t tail; /* the latest bytes */

static bool keep_tail(const reg *r, uint32_t mask, uint32_t value)
{
    (void)value;
    tail = r == &chip.spi3.SR && mask == SPI_SR_TXE ? tail << 8 | (chip.spi3.DR & 0xFFu) : tail;
    return true;
}

static bool interrupt(const reg *r, uint32_t mask, uint32_t value)
{
    (void)r, (void)mask, (void)value;
    chip_waits = keep_tail;
    output_safe();
    return true;
}

/* A crystal that stops while a write is on its way: what follows of the write changes nothing. */
static void test_an_interrupt_that_makes_the_outputs_safe_has_the_last_word(void)
{
    configure(HAL_OUTPUT_SPI_DAC, HAL_OUTPUT_SPI_DAC);
    write_forces(0, 0, false);
    chip_waits = interrupt;
    write_forces(FULL_mN, FULL_mN, true);
    TEST_ASSERT_FALSE(chip_pin('B', 12) || chip_pin('C', 8));
    TEST_ASSERT_EQUAL_HEX32(0x178000, tail & 0xFFFFFF);
    const struct hal_drive_out y_alone = {.enable = {false, true}};
    output_write(&y_alone);
    TEST_ASSERT_FALSE(chip_pin('C', 8)); /* the safe state ends when neither axis is to be enabled */
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_it_is_configured_at_the_start);
    RUN_TEST(test_it_is_configured_and_written_when_an_axis_uses_it_and_else_not);
    RUN_TEST(test_force_is_a_share_of_full_scale_in_16_bits_and_saturates);
    RUN_TEST(test_safe_outputs_set_both_channels_to_no_force_by_one_frame);
    RUN_TEST(test_an_interrupt_that_makes_the_outputs_safe_has_the_last_word);
    return UNITY_END();
}
