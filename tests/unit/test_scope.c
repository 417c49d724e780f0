/* SPDX-License-Identifier: Apache-2.0 */
/* The scope on a servo tick of numbers: what is recorded, where the trigger is, what stays until it is read. */
#include <string.h>

#include "drive/servo_loop.h"
#include "num_test.h"
#include "unity.h"

static struct servo_loop loop;
static struct servo_out out;
static struct hal_drive_in in;
static struct od_data od;
static uint32_t tick, faults;
static const int32_t no_origin[2];

/* What a reader gets. */
static struct {
    uint32_t channels, periods, frames, trigger_frame, first_tick, trigger_tick, cause;
    uint8_t number[SCOPE_CHANNELS];
    int32_t value[SCOPE_SAMPLES];
} read;

static uint32_t word(uint32_t i, const int32_t origin_nm[2])
{
    uint8_t b[4];
    TEST_ASSERT_TRUE(scope_read(&loop.scope, 4 * i, b, 4, origin_nm));
    return b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
}

static void read_capture(const int32_t origin_nm[2])
{
    const uint32_t size = scope_size(&loop.scope);
    TEST_ASSERT_GREATER_THAN_UINT32(SCOPE_HEADER, size);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_VERSION, word(0, origin_nm) & 0xFFu);
    read.channels = word(0, origin_nm) >> 8 & 0xFFu;
    read.periods = word(0, origin_nm) >> 16;
    read.frames = word(1, origin_nm);
    read.trigger_frame = word(2, origin_nm);
    read.first_tick = word(3, origin_nm);
    read.trigger_tick = word(4, origin_nm);
    read.cause = word(5, origin_nm);
    TEST_ASSERT_TRUE(scope_read(&loop.scope, 24, read.number, SCOPE_CHANNELS, origin_nm));
    TEST_ASSERT_EQUAL_UINT32(SCOPE_HEADER + 4 * read.frames * read.channels, size);
    for (uint32_t i = 0; i < read.frames * read.channels; i++) {
        read.value[i] = (int32_t)word(8 + i, origin_nm);
    }
}

static void step(void)
{
    const void *const base[SCOPE_BASES] = {&out, &loop.servo, &loop.path.at, &in, &loop.scope};
    in.count[0] = (int32_t)tick * 3;
    in.inputs[1] = (uint8_t)tick;
    if (scope_runs(&loop.scope, faults)) {
        scope_step(&loop.scope, base, tick);
    }
    tick++;
}

static void steps(unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        step();
    }
}

static void steps_until_done(void)
{
    for (unsigned i = 0; i < 200000 && atomic_load(&loop.scope.state) != SCOPE_DONE; i++) {
        step();
    }
    TEST_ASSERT_EQUAL(SCOPE_DONE, atomic_load(&loop.scope.state));
    read_capture(no_origin);
}

static void channels(uint8_t a, uint8_t b, uint8_t c)
{
    memset(od.scope_channels, 0, sizeof od.scope_channels);
    od.scope_channels[0] = a;
    od.scope_channels[1] = b;
    od.scope_channels[2] = c;
}

static void arm(enum scope_trigger trigger, uint32_t interval_us, uint16_t pre)
{
    od.scope.trigger = (uint8_t)trigger;
    od.scope.interval = interval_us;
    od.scope.pre = pre;
    TEST_ASSERT_TRUE(scope_arm(&loop.scope, &od, no_origin));
}

/* Frames hold count_x = 3 tick, each `periods` after the one before, and the first one at or after the trigger is known. */
static void expect_frames_in_order(void)
{
    for (uint32_t f = 0; f < read.frames; f++) {
        TEST_ASSERT_EQUAL_INT32(3 * (int32_t)(read.first_tick + f * read.periods), read.value[f * read.channels]);
    }
    const uint32_t at = read.first_tick + read.trigger_frame * read.periods;
    TEST_ASSERT_TRUE_MESSAGE(at - read.trigger_tick < read.periods, "trigger frame");
}

void setUp(void)
{
    memset(&loop, 0, sizeof loop);
    out = (struct servo_out){0};
    od_init(&od, 1);
    tick = 1000;
    faults = 0;
    channels(SIGNAL_ENCODER_COUNT_X, 0, 0);
}

void tearDown(void)
{
}

/* ---- what is recorded ---- */

static void test_scope_records_each_period_from_now_on(void)
{
    arm(SCOPE_NOW, 0, 800);
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(SCOPE_SAMPLES, read.frames);
    TEST_ASSERT_EQUAL_UINT32(1, read.periods);
    TEST_ASSERT_EQUAL_UINT32(1000, read.first_tick);
    TEST_ASSERT_EQUAL_UINT32(1000, read.trigger_tick);
    TEST_ASSERT_EQUAL_UINT32(0, read.trigger_frame);
    expect_frames_in_order();
}

static void test_scope_holds_four_thousand_samples_of_eight_signals(void)
{
    for (uint8_t i = 0; i < SCOPE_CHANNELS; i++) {
        od.scope_channels[i] = SIGNAL_ENCODER_COUNT_X;
    }
    arm(SCOPE_NOW, 0, 0);
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(8, read.channels);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(4000, read.channels * read.frames);
    expect_frames_in_order();
}

static void test_interval_is_whole_control_periods(void)
{
    arm(SCOPE_NOW, 799, 0); /* 7.99 periods of 100 us */
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(7, read.periods);
    expect_frames_in_order();
}

static void test_each_kind_of_signal_comes_in_its_unit(void)
{
    static const uint8_t numbers[SCOPE_CHANNELS] = {
        SIGNAL_CONTOUR_ERROR, SIGNAL_FEEDFORWARD_FRICTION_Y, SIGNAL_POSITION_Y, SIGNAL_PATH_TIME, SIGNAL_INPUTS_Y,
        SIGNAL_FORCE_X,       SIGNAL_ADAPTIVE_GAIN_1,        SIGNAL_ENERGY_X};
    const int32_t origin[2] = {7, -40};
    memcpy(od.scope_channels, numbers, sizeof numbers);
    out.contour.e_n.y = NUM(-1.5);
    loop.servo.feedforward.friction[1] = acc_from(NUM(2.25));
    loop.servo.observer[1].pos = pos_from_nm(-123456789);
    path_set(&loop.path.at, 12 * PATH_ONE + PATH_ONE / 2);
    out.force.x = NUM(-600);
    out.smc.k_hat.x = NUM(0.5);
    loop.servo.energy[0].mJ = -17;
    arm(SCOPE_NOW, 0, 0);
    steps_until_done();
    read_capture(origin);
    TEST_ASSERT_EQUAL_UINT8_ARRAY(numbers, read.number, SCOPE_CHANNELS);
    TEST_ASSERT_INT32_WITHIN(100, -150000, read.value[0]); /* 0.01 nm; a count of fixed point is 2 pm */
    TEST_ASSERT_INT32_WITHIN(1, 22500, read.value[1]);     /* 0.1 mN */
    TEST_ASSERT_EQUAL_INT32(-123456789 - 40, read.value[2]);
    TEST_ASSERT_EQUAL_INT32(1250, read.value[3]);
    TEST_ASSERT_EQUAL_INT32(1000 & 0xFF, read.value[4]);
    TEST_ASSERT_EQUAL_INT32(-6000000, read.value[5]);
    TEST_ASSERT_EQUAL_INT32(100000, read.value[6]); /* 0.001 1/s */
    TEST_ASSERT_EQUAL_INT32(-17, read.value[7]);
}

/* Position less following error, in nm: core numbers are um. */
static void test_reference_of_each_axis_is_its_own(void)
{
    const int32_t origin[2] = {7, -40};
    const uint8_t numbers[SCOPE_CHANNELS] = {SIGNAL_REFERENCE_X, SIGNAL_REFERENCE_Y};
    memcpy(od.scope_channels, numbers, sizeof numbers);
    loop.servo.observer[0].pos = pos_from_nm(5000);
    loop.servo.observer[1].pos = pos_from_nm(-7000);
    out.contour.e_w = (vec2){NUM(0.25), NUM(-1.5)};
    arm(SCOPE_NOW, 0, 0);
    steps_until_done();
    read_capture(origin);
    TEST_ASSERT_EQUAL_INT32(5000 - 250 + 7, read.value[0]);
    TEST_ASSERT_EQUAL_INT32(-7000 + 1500 - 40, read.value[1]);
}

/* ---- triggers ---- */

static void test_level_triggers_in_the_period_that_crosses_it(void)
{
    od.scope.source = SIGNAL_ENCODER_COUNT_X;
    od.scope.level = 3 * 9000; /* is passed in period 9001 */
    arm(SCOPE_RISING, 0, 500);
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(9001, read.trigger_tick);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_SAMPLES / 2, read.trigger_frame);
    TEST_ASSERT_EQUAL_UINT32(0, read.cause);
    expect_frames_in_order();
}

static void test_a_capture_that_is_all_before_its_trigger_has_the_frame_of_the_trigger(void)
{
    od.scope.source = SIGNAL_ENCODER_COUNT_X;
    od.scope.level = 3 * 9000;
    arm(SCOPE_RISING, 0, 1000);
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(9001, read.trigger_tick);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_SAMPLES - 1, read.trigger_frame);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_SAMPLES, read.frames);
    TEST_ASSERT_FALSE_MESSAGE(scope_holds_fault(&loop.scope), "a level is no fault");
    expect_frames_in_order();
}

static void test_trigger_between_two_frames_is_known_to_its_period(void)
{
    od.scope.source = SIGNAL_ENCODER_COUNT_X;
    od.scope.level = 3 * 90003;
    arm(SCOPE_RISING, 1000, 250);
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(90004, read.trigger_tick);
    TEST_ASSERT_EQUAL_UINT32(10, read.periods);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_SAMPLES / 4, read.trigger_frame);
    expect_frames_in_order();
}

static void test_falling_level_of_a_number_triggers(void)
{
    od.scope.source = SIGNAL_CONTOUR_ERROR;
    od.scope.level = -200000; /* -2 um */
    arm(SCOPE_FALLING, 0, 0);
    out.contour.e_n.y = NUM(-3); /* below from the start: no crossing */
    steps(50);
    out.contour.e_n.y = NUM(-1);
    steps(50);
    TEST_ASSERT_EQUAL(SCOPE_WAITING, atomic_load(&loop.scope.state));
    out.contour.e_n.y = NUM(-2.5);
    const uint32_t crossing = tick;
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(crossing, read.trigger_tick);
}

static void test_signal_that_is_above_the_level_from_the_start_does_not_rise_above_it(void)
{
    od.scope.source = SIGNAL_CONTOUR_ERROR;
    od.scope.level = 100;
    out.contour.e_n.y = NUM(1);
    arm(SCOPE_RISING, 0, 0);
    steps(50);
    TEST_ASSERT_EQUAL(SCOPE_WAITING, atomic_load(&loop.scope.state));
}

static void test_level_waits_for_the_frames_before_it(void)
{
    od.scope.source = SIGNAL_CONTOUR_ERROR;
    od.scope.level = 0;
    arm(SCOPE_RISING, 0, 500);
    for (unsigned i = 0; i < 4000; i++) { /* crosses each fourth period */
        out.contour.e_n.y = i % 4 < 2 ? NUM(-1) : NUM(1);
        step();
    }
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(SCOPE_SAMPLES / 2, read.trigger_frame);
    TEST_ASSERT_UINT32_WITHIN(4, 1000 + SCOPE_SAMPLES / 2, read.trigger_tick);
}

static void test_level_of_a_position_is_the_users(void)
{
    const int32_t origin[2] = {0, 500};
    od.scope.trigger = SCOPE_RISING;
    od.scope.source = SIGNAL_REFERENCE_Y;
    od.scope.level = 1500;
    od.scope.pre = 0;
    TEST_ASSERT_TRUE(scope_arm(&loop.scope, &od, origin));
    loop.servo.observer[1].pos = pos_from_nm(1010);
    out.contour.e_w.y = NUM(0.010);
    steps(2);
    TEST_ASSERT_EQUAL(SCOPE_WAITING, atomic_load(&loop.scope.state));
    loop.servo.observer[1].pos = pos_from_nm(1011);
    steps(1);
    TEST_ASSERT_EQUAL(SCOPE_TRIGGERED, atomic_load(&loop.scope.state));
}

/* ---- faults ---- */

static void test_by_default_a_fault_leaves_the_500_ms_before_it(void)
{
    od_init(&od, 1);
    TEST_ASSERT_TRUE(scope_arm(&loop.scope, &od, no_origin));
    steps(100000);
    faults = 1u << 4;
    const uint32_t raised = tick;
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(raised, read.trigger_tick);
    TEST_ASSERT_EQUAL_HEX32(1u << 4, read.cause);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(CONTROL_HZ / 2, read.trigger_tick - read.first_tick);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(CONTROL_HZ / 10, (read.frames - read.trigger_frame) * read.periods);
    TEST_ASSERT_EQUAL_UINT8(SIGNAL_CONTOUR_ERROR, read.number[0]);
}

static void test_fault_soon_after_arming_leaves_what_there_is(void)
{
    arm(SCOPE_FAULT, 0, 900);
    steps(30);
    faults = 1;
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(30, read.trigger_frame);
    TEST_ASSERT_EQUAL_UINT32(1000, read.first_tick);
    expect_frames_in_order();
}

static void test_fault_triggers_though_a_level_is_waited_for(void)
{
    od.scope.source = SIGNAL_CONTOUR_ERROR;
    od.scope.level = 100;
    arm(SCOPE_RISING, 0, 900);
    steps(30);
    faults = 1;
    steps_until_done();
    TEST_ASSERT_EQUAL_HEX32(1, read.cause);
    TEST_ASSERT_TRUE(scope_holds_fault(&loop.scope));
}

static void test_fault_of_the_background_triggers_in_the_next_period(void)
{
    arm(SCOPE_FAULT, 0, 500);
    steps(5000);
    scope_fault(&loop.scope, 1u << 9);
    const uint32_t next = tick;
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(next, read.trigger_tick);
    TEST_ASSERT_EQUAL_HEX32(1u << 9, read.cause);
}

static void test_fault_that_is_there_triggers_nothing_and_another_one_does(void)
{
    faults = 1;
    steps(1);
    arm(SCOPE_FAULT, 0, 500);
    steps(10);
    TEST_ASSERT_EQUAL(SCOPE_WAITING, atomic_load(&loop.scope.state));
    faults = 3;
    steps_until_done();
    TEST_ASSERT_EQUAL_HEX32(2, read.cause);
}

static void test_capture_stays_whatever_comes_after_it(void)
{
    arm(SCOPE_FAULT, 0, 500);
    steps(5000);
    faults = 1;
    steps_until_done();
    const uint32_t triggered = read.trigger_tick;
    faults = 0;
    steps(100);
    faults = 6;
    scope_fault(&loop.scope, 8);
    steps(5000);
    read_capture(no_origin);
    TEST_ASSERT_EQUAL_UINT32(triggered, read.trigger_tick);
    TEST_ASSERT_EQUAL_HEX32(1, read.cause);
    expect_frames_in_order();
}

/* ... with as much before it as there is by default, whatever share the first one had. */
static void test_fault_after_a_capture_takes_its_place(void)
{
    arm(SCOPE_NOW, 0, 0);
    steps_until_done();
    TEST_ASSERT_EQUAL_HEX32(0, read.cause);
    TEST_ASSERT_FALSE(scope_holds_fault(&loop.scope));
    steps(5000);
    faults = 1;
    const uint32_t raised = tick;
    step();
    TEST_ASSERT_EQUAL(SCOPE_TRIGGERED, atomic_load(&loop.scope.state));
    TEST_ASSERT_TRUE(scope_holds_fault(&loop.scope));
    TEST_ASSERT_EQUAL_UINT32(0, scope_size(&loop.scope));
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(raised, read.trigger_tick);
    TEST_ASSERT_EQUAL_HEX32(1, read.cause);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_SAMPLES, read.frames);
    TEST_ASSERT_EQUAL_UINT32((uint32_t)SCOPE_SAMPLES * od_defaults.scope.pre / 1000u, read.trigger_frame);
    expect_frames_in_order();
    faults = 3; /* of several the first one is kept */
    steps(10000);
    read_capture(no_origin);
    TEST_ASSERT_EQUAL_UINT32(raised, read.trigger_tick);
}

static void test_fault_after_the_capture_of_a_warning_has_its_own_500_ms(void)
{
    od_init(&od, 1);
    TEST_ASSERT_TRUE(scope_arm(&loop.scope, &od, no_origin));
    steps(10000);
    scope_warning(&loop.scope, 4);
    steps_until_done();
    TEST_ASSERT_EQUAL_HEX32(4, read.cause);
    TEST_ASSERT_TRUE(scope_holds_fault(&loop.scope));
    const uint32_t warned = read.trigger_tick;
    scope_warning(&loop.scope, 8); /* of several the first one is kept */
    steps(10000);
    read_capture(no_origin);
    TEST_ASSERT_EQUAL_UINT32(warned, read.trigger_tick);
    scope_fault(&loop.scope, 16);
    const uint32_t raised = tick;
    step();
    steps_until_done();
    TEST_ASSERT_EQUAL_UINT32(raised, read.trigger_tick);
    TEST_ASSERT_EQUAL_HEX32(16, read.cause);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(CONTROL_HZ / 2, read.trigger_tick - read.first_tick);
}

static void test_fault_in_the_frames_after_a_trigger_is_in_that_capture_which_then_stays(void)
{
    arm(SCOPE_NOW, 0, 0);
    steps(100);
    faults = 1;
    steps_until_done();
    TEST_ASSERT_TRUE(scope_holds_fault(&loop.scope));
    TEST_ASSERT_EQUAL_UINT32(1000, read.trigger_tick);
    faults = 3;
    steps(10000);
    read_capture(no_origin);
    TEST_ASSERT_EQUAL_UINT32(1000, read.trigger_tick);
    expect_frames_in_order();
}

static void test_capture_that_is_being_read_stays_whole_when_a_fault_comes(void)
{
    arm(SCOPE_NOW, 0, 0);
    steps_until_done();
    steps(5000);
    const uint32_t size = scope_size(&loop.scope), first = word(8, no_origin);
    faults = 1;
    step();
    TEST_ASSERT_EQUAL_UINT32(1000, word(4, no_origin));
    steps(5000);
    TEST_ASSERT_EQUAL(SCOPE_DONE, atomic_load(&loop.scope.state));
    TEST_ASSERT_EQUAL_UINT32(1000, word(4, no_origin));
    TEST_ASSERT_EQUAL_UINT32(first, word(8, no_origin));
    TEST_ASSERT_EQUAL_UINT32(first + 3 * (SCOPE_SAMPLES - 1), word(size / 4 - 1, no_origin));
    read_capture(no_origin);
    TEST_ASSERT_EQUAL_HEX32(1, read.cause);
}

static void test_what_was_reported_before_arming_triggers_nothing(void)
{
    scope_fault(&loop.scope, 1);
    arm(SCOPE_FAULT, 0, 500);
    steps(10);
    TEST_ASSERT_EQUAL(SCOPE_WAITING, atomic_load(&loop.scope.state));
}

/* ---- reading ---- */

static void test_there_is_nothing_to_read_before_it_is_done(void)
{
    TEST_ASSERT_EQUAL_UINT32(0, scope_size(&loop.scope));
    arm(SCOPE_FAULT, 0, 500);
    steps(100);
    TEST_ASSERT_EQUAL_UINT32(0, scope_size(&loop.scope));
    faults = 1;
    steps(1);
    TEST_ASSERT_EQUAL_UINT32(0, scope_size(&loop.scope));
}

static void test_reading_ends_when_the_scope_is_armed_again(void)
{
    uint8_t byte;
    arm(SCOPE_NOW, 0, 0);
    steps_until_done();
    TEST_ASSERT_TRUE(scope_read(&loop.scope, 40, &byte, 1, no_origin));
    arm(SCOPE_NOW, 0, 0);
    for (unsigned i = 0; i < SCOPE_SAMPLES; i++) {
        step();
    }
    TEST_ASSERT_EQUAL(SCOPE_DONE, atomic_load(&loop.scope.state)); /* with another capture */
    TEST_ASSERT_FALSE(scope_read(&loop.scope, 41, &byte, 1, no_origin));
}

static void test_scope_that_is_off_records_nothing(void)
{
    arm(SCOPE_FAULT, 0, 500);
    scope_off(&loop.scope);
    faults = 1;
    steps(5000);
    TEST_ASSERT_EQUAL(SCOPE_OFF, atomic_load(&loop.scope.state));
    TEST_ASSERT_EQUAL_UINT32(0, loop.scope.half[0].filled);
}

static void test_scope_without_channel_or_source_is_not_armed(void)
{
    arm(SCOPE_FAULT, 0, 500);
    od.scope.trigger = SCOPE_RISING;
    TEST_ASSERT_FALSE(scope_arm(&loop.scope, &od, no_origin));
    channels(0, SIGNAL_TANGENTIAL_ERROR, 0);
    od.scope.trigger = SCOPE_FAULT;
    TEST_ASSERT_FALSE(scope_arm(&loop.scope, &od, no_origin));
    TEST_ASSERT_EQUAL_MESSAGE(SCOPE_WAITING, atomic_load(&loop.scope.state), "and goes on as it was");
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_scope_records_each_period_from_now_on);
    RUN_TEST(test_scope_holds_four_thousand_samples_of_eight_signals);
    RUN_TEST(test_interval_is_whole_control_periods);
    RUN_TEST(test_each_kind_of_signal_comes_in_its_unit);
    RUN_TEST(test_reference_of_each_axis_is_its_own);
    RUN_TEST(test_level_triggers_in_the_period_that_crosses_it);
    RUN_TEST(test_trigger_between_two_frames_is_known_to_its_period);
    RUN_TEST(test_falling_level_of_a_number_triggers);
    RUN_TEST(test_signal_that_is_above_the_level_from_the_start_does_not_rise_above_it);
    RUN_TEST(test_level_waits_for_the_frames_before_it);
    RUN_TEST(test_level_of_a_position_is_the_users);
    RUN_TEST(test_by_default_a_fault_leaves_the_500_ms_before_it);
    RUN_TEST(test_fault_soon_after_arming_leaves_what_there_is);
    RUN_TEST(test_fault_triggers_though_a_level_is_waited_for);
    RUN_TEST(test_fault_of_the_background_triggers_in_the_next_period);
    RUN_TEST(test_fault_that_is_there_triggers_nothing_and_another_one_does);
    RUN_TEST(test_capture_stays_whatever_comes_after_it);
    RUN_TEST(test_fault_after_a_capture_takes_its_place);
    RUN_TEST(test_fault_after_the_capture_of_a_warning_has_its_own_500_ms);
    RUN_TEST(test_fault_in_the_frames_after_a_trigger_is_in_that_capture_which_then_stays);
    RUN_TEST(test_capture_that_is_being_read_stays_whole_when_a_fault_comes);
    RUN_TEST(test_what_was_reported_before_arming_triggers_nothing);
    RUN_TEST(test_there_is_nothing_to_read_before_it_is_done);
    RUN_TEST(test_reading_ends_when_the_scope_is_armed_again);
    RUN_TEST(test_scope_that_is_off_records_nothing);
    RUN_TEST(test_scope_without_channel_or_source_is_not_armed);
    RUN_TEST(test_a_capture_that_is_all_before_its_trigger_has_the_frame_of_the_trigger);
    return UNITY_END();
}
