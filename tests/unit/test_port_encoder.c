/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_encoder.c: the encoder timers of the STM32F405: counts
 * of 32 bits, the index pulse, and the symptoms of a wrong count.
 */
#include "chip.h"
#include "port/stm32f405/encoder.h"
#include "unity.h"

/* x has TIM2, y has TIM5, and the index pulse is at channel 3 (board_kontur.h). */
enum { INDEX_FLAG = TIM_SR_CC1IF << 2, LINES = 1000, COUNTS = 4 * LINES };

static struct hal_drive_in in;

static void configure(bool invert_x)
{
    const struct hal_axis_cfg cfg[AXES] = {
        {.index_counts = COUNTS, .jump_counts = 500, .invert_encoder = invert_x},
        {.index_counts = 0, .jump_counts = 500},
    };
    encoder_configure(cfg);
}

void setUp(void)
{
    chip_reset();
    encoder_init();
    configure(false);
}

void tearDown(void)
{
}

static void read_at(uint32_t x, uint32_t y)
{
    chip.tim2.CNT = x;
    chip.tim5.CNT = y;
    in = (struct hal_drive_in){0};
    encoder_read(&in);
}

/* Move x to `to` in steps that are no jumps. */
static void move_to(int32_t to)
{
    int32_t at = (int32_t)chip.tim2.CNT;
    while (at != to) {
        const int32_t distance = to - at;
        at += distance > 400 ? 400 : distance < -400 ? -400 : distance;
        read_at((uint32_t)at, 0);
        TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X]);
    }
}

static void index_at(int32_t count)
{
    chip.tim2.SR = INDEX_FLAG;
    chip.tim2.CCR[2] = (uint32_t)count;
    read_at(chip.tim2.CNT, 0);
    chip.tim2.SR = 0; /* reading CCR clears it */
}

static void test_timers_count_all_edges_of_a_and_b_over_32_bits(void)
{
    TEST_ASSERT_EQUAL_HEX32(TIM_SMCR_ENCODER_BOTH, chip.tim2.SMCR);
    TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFF, chip.tim2.ARR);
    TEST_ASSERT_EQUAL_HEX32(1, chip.tim5.CR1 & TIM_CR1_CEN);
    TEST_ASSERT_EQUAL_HEX32(TIM_CCER_E << 8, chip.tim2.CCER);
}

static void test_counts_follow_both_ways_through_zero(void)
{
    read_at(100, (uint32_t)-100);
    TEST_ASSERT_EQUAL_INT32(100, in.count[AXIS_X]);
    TEST_ASSERT_EQUAL_INT32(-100, in.count[AXIS_Y]);
    read_at((uint32_t)-50, 30);
    TEST_ASSERT_EQUAL_INT32(-50, in.count[AXIS_X]);
    TEST_ASSERT_EQUAL_INT32(30, in.count[AXIS_Y]);
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X] | in.inputs[AXIS_Y]);
}

static void test_an_inverted_encoder_counts_down(void)
{
    configure(true);
    read_at(100, 0);
    TEST_ASSERT_EQUAL_INT32(-100, in.count[AXIS_X]);
}

static void test_an_encoder_that_jumps_is_a_fault_of_its_axis_and_of_that_read(void)
{
    read_at(501, 0);
    TEST_ASSERT_EQUAL_UINT8(HAL_ENCODER_FAULT, in.inputs[AXIS_X]);
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_Y]);
    read_at(501, 0);
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X]);
    read_at(1, (uint32_t)-501);
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X]);
    TEST_ASSERT_EQUAL_UINT8(HAL_ENCODER_FAULT, in.inputs[AXIS_Y]);
}

static void test_the_index_pulse_captures_its_count(void)
{
    move_to(350);
    index_at(340);
    TEST_ASSERT_EQUAL_UINT8(1, in.index_pulses[AXIS_X]);
    TEST_ASSERT_EQUAL_INT32(340, in.index_count[AXIS_X]);
    TEST_ASSERT_EQUAL_UINT8(0, in.index_pulses[AXIS_Y]);
    move_to(400);
    TEST_ASSERT_EQUAL_UINT8(1, in.index_pulses[AXIS_X]);
    TEST_ASSERT_EQUAL_INT32(340, in.index_count[AXIS_X]);
}

static void test_index_pulses_a_revolution_apart_fit_both_ways_within_a_line(void)
{
    move_to(340);
    index_at(340);
    move_to(340 + COUNTS);
    index_at(340 + COUNTS + 3);
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X]);
    move_to(340 - 2 * COUNTS);
    index_at(340 - 2 * COUNTS);
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X]);
    TEST_ASSERT_EQUAL_UINT8(3, in.index_pulses[AXIS_X]);
}

static void test_lost_counts_show_at_the_next_index_pulse(void)
{
    move_to(340);
    index_at(340);
    move_to(340 + COUNTS - 8); /* two lines of the encoder are not counted */
    index_at(340 + COUNTS - 8);
    TEST_ASSERT_EQUAL_UINT8(HAL_ENCODER_FAULT, in.inputs[AXIS_X]);
}

static void test_an_index_pulse_within_a_line_fits_on_either_side_and_beyond_it_does_not(void)
{
    static const struct {
        int32_t off;
        bool fits;
    } pulses[] = {{4, true}, {-4, true}, {5, false}, {-5, false}};
    for (unsigned i = 0; i < sizeof pulses / sizeof pulses[0]; i++) {
        configure(false);
        move_to(340);
        index_at(340);
        move_to(340 + COUNTS);
        index_at(340 + COUNTS + pulses[i].off);
        TEST_ASSERT_EQUAL_UINT8(pulses[i].fits ? 0 : HAL_ENCODER_FAULT, in.inputs[AXIS_X]);
    }
}

static void test_an_index_pulse_of_an_inverted_encoder_is_where_it_was(void)
{
    configure(true);
    read_at(0, 0);
    const int32_t start = in.count[AXIS_X];
    chip.tim2.CNT += 300;
    chip.tim2.SR = INDEX_FLAG;
    chip.tim2.CCR[2] = chip.tim2.CNT - 10;
    read_at(chip.tim2.CNT, 0);
    TEST_ASSERT_EQUAL_INT32(start - 300, in.count[AXIS_X]);
    TEST_ASSERT_EQUAL_INT32(start - 290, in.index_count[AXIS_X]);
}

static void test_index_pulses_are_counted_also_where_their_distance_is_not_checked(void)
{
    for (unsigned i = 1; i <= 3; i++) {
        chip.tim5.SR = INDEX_FLAG;
        chip.tim5.CCR[2] = 111 * i;
        read_at(0, 111 * i + 5);
        TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_Y]);
        TEST_ASSERT_EQUAL_UINT8(i, in.index_pulses[AXIS_Y]);
        TEST_ASSERT_EQUAL_INT32(111 * (int32_t)i, in.index_count[AXIS_Y]);
    }
}

static void test_a_jump_is_a_fault_also_with_an_index_pulse_that_fits(void)
{
    move_to(340);
    index_at(340);
    move_to(340 + COUNTS - 600);
    chip.tim2.CNT += 600;
    index_at(340 + COUNTS);
    TEST_ASSERT_EQUAL_UINT8(HAL_ENCODER_FAULT, in.inputs[AXIS_X]);
}

static void test_new_wiring_starts_the_index_check_anew(void)
{
    move_to(340);
    index_at(340);
    configure(false);
    move_to(1000);
    index_at(1000);
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X]);
}

static void test_in_an_emulator_whose_timers_count_time_the_axes_stand(void)
{
    chip_emulate();
    encoder_init();
    read_at(12345, 67890);
    TEST_ASSERT_EQUAL_INT32(0, in.count[AXIS_X]);
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X]);
}

/* The encoders are not read while the flash is erased. */
static void test_movement_between_distant_reads_is_counted_and_is_no_jump(void)
{
    read_at(0, 0);
    encoder_paused();
    read_at(100000, (uint32_t)-100000);
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X] | in.inputs[AXIS_Y]);
    TEST_ASSERT_EQUAL_INT32(100000, in.count[AXIS_X]);
    read_at(200000, (uint32_t)-100000);
    TEST_ASSERT_EQUAL_UINT8(HAL_ENCODER_FAULT, in.inputs[AXIS_X]);
}

static void test_second_encoders_count_beyond_16_bits_in_both_directions(void)
{
    int32_t x = 0, y = 0;
    for (int k = 0; k < 10; k++) {
        x += 20000;
        y -= 30000;
        chip.tim3.CNT = (uint16_t)x;
        chip.tim4.CNT = (uint16_t)y;
        read_at(0, 0);
        TEST_ASSERT_EQUAL_INT32(x, in.second[AXIS_X]);
        TEST_ASSERT_EQUAL_INT32(y, in.second[AXIS_Y]);
        TEST_ASSERT_EQUAL_UINT8(0, in.inputs[AXIS_X] | in.inputs[AXIS_Y]);
    }
}

static void test_inverted_second_encoder_counts_down_from_where_it_is(void)
{
    chip.tim3.CNT = chip.tim4.CNT = 100;
    read_at(0, 0);
    const struct hal_axis_cfg cfg[AXES] = {{.jump_counts = 500}, {.jump_counts = 500, .invert_second = true}};
    encoder_configure(cfg);
    chip.tim3.CNT = chip.tim4.CNT = 130;
    read_at(0, 0);
    TEST_ASSERT_EQUAL_INT32(130, in.second[AXIS_X]);
    TEST_ASSERT_EQUAL_INT32(70, in.second[AXIS_Y]);
    TEST_ASSERT_EQUAL_INT32(0, in.count[AXIS_Y]);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_timers_count_all_edges_of_a_and_b_over_32_bits);
    RUN_TEST(test_counts_follow_both_ways_through_zero);
    RUN_TEST(test_an_inverted_encoder_counts_down);
    RUN_TEST(test_an_encoder_that_jumps_is_a_fault_of_its_axis_and_of_that_read);
    RUN_TEST(test_the_index_pulse_captures_its_count);
    RUN_TEST(test_index_pulses_a_revolution_apart_fit_both_ways_within_a_line);
    RUN_TEST(test_lost_counts_show_at_the_next_index_pulse);
    RUN_TEST(test_a_jump_is_a_fault_also_with_an_index_pulse_that_fits);
    RUN_TEST(test_an_index_pulse_within_a_line_fits_on_either_side_and_beyond_it_does_not);
    RUN_TEST(test_an_index_pulse_of_an_inverted_encoder_is_where_it_was);
    RUN_TEST(test_index_pulses_are_counted_also_where_their_distance_is_not_checked);
    RUN_TEST(test_new_wiring_starts_the_index_check_anew);
    RUN_TEST(test_in_an_emulator_whose_timers_count_time_the_axes_stand);
    RUN_TEST(test_movement_between_distant_reads_is_counted_and_is_no_jump);
    RUN_TEST(test_second_encoders_count_beyond_16_bits_in_both_directions);
    RUN_TEST(test_inverted_second_encoder_counts_down_from_where_it_is);
    return UNITY_END();
}
