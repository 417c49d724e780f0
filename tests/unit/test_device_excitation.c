/* SPDX-License-Identifier: Apache-2.0 */
/* The excitation over the bus (2150h to 2154h): what it refuses, what it measures, and what ends it. */
#include <math.h>

#include "test_device.h"

#define PI 3.14159265358979323846
enum { NEVER, RUNS, ENDED_BY_ITSELF, ENDED, AT_LIMIT };
enum { WINDOW_MS = 100, WINDOW = 10 * WINDOW_MS, LINES = 3 };
static const uint16_t periods[LINES] = {4, 21, 60}; /* 40, 210 and 600 Hz */

static uint32_t set(uint8_t sub, uint8_t size, uint32_t value)
{
    return rig_write(&rig, 0x2150, sub, size, value);
}

static uint32_t state_of_it(void)
{
    return rig_read(&rig, 0x2150, 7);
}

static void describe(uint8_t axis, uint32_t amplitude_mN, uint8_t windows)
{
    TEST_ASSERT_EQUAL_HEX32(0, set(2, 1, axis));
    TEST_ASSERT_EQUAL_HEX32(0, set(3, 4, amplitude_mN));
    TEST_ASSERT_EQUAL_HEX32(0, set(4, 2, WINDOW_MS));
    TEST_ASSERT_EQUAL_HEX32(0, set(5, 2, 50));
    TEST_ASSERT_EQUAL_HEX32(0, set(6, 1, windows));
    for (uint8_t k = 0; k < LINES; k++) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2151, (uint8_t)(k + 1), 2, periods[k]));
    }
}

static uint32_t begin(void)
{
    return set(1, 1, 1);
}

static void be_excited(uint8_t axis, uint8_t windows)
{
    rig_enable(&rig);
    describe(axis, 3000, windows);
    TEST_ASSERT_EQUAL_HEX32(0, begin());
    rig_ms(&rig, 20);
    TEST_ASSERT_EQUAL_UINT32(RUNS, state_of_it());
}

/* From here on the force of the axis is the law's: at rest it is steady. */
static void expect_quiet(uint8_t axis)
{
    int32_t least = INT32_MAX, greatest = INT32_MIN;
    rig_ms(&rig, 200);
    for (int n = 0; n < 500; n++) {
        rig_run(&rig, 1);
        least = rig.out.force_mN[axis] < least ? rig.out.force_mN[axis] : least;
        greatest = rig.out.force_mN[axis] > greatest ? rig.out.force_mN[axis] : greatest;
    }
    TEST_ASSERT_TRUE(greatest - least < 20000); /* of 6 times 60 N */
}

static void test_axis_that_is_not_enabled_is_not_excited(void)
{
    describe(0, 3000, 1);
    TEST_ASSERT_EQUAL_UINT32(NEVER, state_of_it());
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, begin());
    rig_enable(&rig);
    rig_controlwords(&rig, SWITCH_ON, ENABLE);
    rig_ms(&rig, 5);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, begin());
    TEST_ASSERT_EQUAL_HEX32(0, set(2, 1, 1));
    TEST_ASSERT_EQUAL_HEX32(0, begin());
    TEST_ASSERT_EQUAL_UINT32(RUNS, state_of_it());
    TEST_ASSERT_EQUAL_HEX32(0, set(1, 1, 0));
    TEST_ASSERT_EQUAL_UINT32(ENDED, state_of_it());
    TEST_ASSERT_EQUAL_HEX32(0, set(1, 1, 0));
    TEST_ASSERT_EQUAL_UINT32(ENDED, state_of_it());
}

static void test_what_would_exceed_a_limit_is_refused(void)
{
    rig_enable(&rig);
    describe(0, 100000, 1); /* 3 times 100 N: half of 600 N */
    TEST_ASSERT_EQUAL_HEX32(0, begin());
    TEST_ASSERT_EQUAL_HEX32(0, set(1, 1, 0));
    TEST_ASSERT_EQUAL_HEX32(0, set(3, 4, 100001));
    TEST_ASSERT_EQUAL_HEX32(ABORT_INCOMPATIBLE, begin());
    describe(0, 3000, 1);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2151, 2, 2, WINDOW / 2 - 1));
    TEST_ASSERT_EQUAL_HEX32(0, begin());
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2151, 2, 2, WINDOW / 2));
    TEST_ASSERT_EQUAL_HEX32(ABORT_INCOMPATIBLE, begin());
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2151, 1, 2, 0)); /* no line */
    TEST_ASSERT_EQUAL_HEX32(ABORT_INCOMPATIBLE, begin());
    describe(0, 3000, 10);
    TEST_ASSERT_EQUAL_HEX32(0, set(4, 2, 1995));
    TEST_ASSERT_EQUAL_HEX32(0, begin());
    TEST_ASSERT_EQUAL_HEX32(0, set(4, 2, 1996)); /* 20.01 s */
    TEST_ASSERT_EQUAL_HEX32(ABORT_INCOMPATIBLE, begin());
    describe(0, 3000, 1);
    for (uint8_t k = 1; k <= 8; k++) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2151, k, 2, 5u * k));
    }
    TEST_ASSERT_EQUAL_HEX32(0, begin());
    TEST_ASSERT_EQUAL_UINT32(RUNS, state_of_it());
}

/* What the drive tells is the transform of the forces that went out and the counts that came in. */
static void expect_transform_of_wires(uint8_t axis)
{
    double re[2][LINES] = {{0}}, im[2][LINES] = {{0}};
    rig_enable(&rig);
    describe(axis, 60000, 1); /* more than friction holds; the answer to it is no oscillation */
    TEST_ASSERT_EQUAL_HEX32(0, begin());
    rig_run(&rig, 500);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2150, 8));
    int32_t before = rig.device.drive.loop.encoder[axis].last;
    for (int n = 0; n < WINDOW; n++) {
        rig_run(&rig, 1);
        const int32_t count = rig.device.drive.loop.encoder[axis].last;
        const double x[2] = {1e-3 * rig.out.force_mN[axis], count - before};
        before = count;
        for (int k = 0; k < LINES; k++) {
            const double phase = 2 * PI * periods[k] * (n + 500) / WINDOW + PI * k * (k + 1) / LINES;
            for (int i = 0; i < 2; i++) {
                re[i][k] += 2.0 / WINDOW * x[i] * cos(phase);
                im[i][k] -= 2.0 / WINDOW * x[i] * sin(phase);
            }
        }
    }
    TEST_ASSERT_EQUAL_UINT32(ENDED_BY_ITSELF, state_of_it());
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2150, 8));
    for (uint16_t i = 0; i < 2; i++) {
        for (uint8_t k = 0; k < LINES; k++) {
            const uint8_t sub = (uint8_t)(2 * k + 1);
            TEST_ASSERT_TRUE(hypot(re[i][k], im[i][k]) > (i == 0 ? 1.0 : 1e-3));
            TEST_ASSERT_DOUBLE_WITHIN(1e-4, re[i][k], 1e-6 * (int32_t)rig_read(&rig, 0x2152 + i, sub));
            TEST_ASSERT_DOUBLE_WITHIN(1e-4, im[i][k], 1e-6 * (int32_t)rig_read(&rig, 0x2152 + i, sub + 1));
        }
        TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2152 + i, 2 * LINES + 1));
    }
    expect_quiet(axis);
}

static void test_force_and_counts_of_x_are_correlated_on_the_drive(void)
{
    expect_transform_of_wires(0);
}

static void test_force_and_counts_of_y_are_correlated_on_the_drive(void)
{
    expect_transform_of_wires(1);
}

/* A rigid table with a scale: what the second encoder tells is what the first one does, by the lengths of their counts. */
static void test_second_encoder_is_correlated_too(void)
{
    struct ks_machine machine = rig_machine();
    machine.scale_m[0] = 10e-9;
    rig_start(&rig, &machine);
    rig_enable(&rig);
    describe(0, 60000, 2);
    TEST_ASSERT_EQUAL_HEX32(0, begin());
    rig_ms(&rig, 50 + 2 * WINDOW_MS + 2);
    TEST_ASSERT_EQUAL_UINT32(2, rig_read(&rig, 0x2150, 8));
    for (uint8_t sub = 1; sub <= 2; sub++) {
        const double first_m = 76.29e-9 * 1e-6 * (int32_t)rig_read(&rig, 0x2153, sub);
        const double second_m = 10e-9 * 1e-6 * (int32_t)rig_read(&rig, 0x2154, sub);
        TEST_ASSERT_TRUE(fabs(first_m) > 1e-10);
        TEST_ASSERT_DOUBLE_WITHIN(0.2 * fabs(first_m), first_m, second_m);
    }
}

static void test_lost_master_ends_it(void)
{
    be_excited(0, 50);
    rig_ms(&rig, 200);
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 300);
    TEST_ASSERT_EQUAL_UINT32(ENDED, state_of_it());
    expect_power(false, false);
}

static void test_quick_stop_and_halt_end_it(void)
{
    be_excited(0, 50);
    rig_controlwords(&rig, HALT, HALT);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(ENDED, state_of_it());
    rig_controlwords(&rig, ENABLE, ENABLE);
    TEST_ASSERT_EQUAL_HEX32(0, begin());
    rig_ms(&rig, 20);
    TEST_ASSERT_EQUAL_UINT32(RUNS, state_of_it());
    rig_controlwords(&rig, QUICK_STOP, QUICK_STOP);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(ENDED, state_of_it());
}

static void test_fault_ends_it_in_the_same_tick(void)
{
    be_excited(0, 50);
    rig.busy = true; /* the background does not help */
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_run(&rig, 1);
    TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[0]);
    TEST_ASSERT_EQUAL_UINT8(EXCITATION_ENDED, rig.device.drive.loop.excitation.status);
    TEST_ASSERT_EQUAL_HEX32(0, rig.device.drive.loop.command.excite);
}

static void test_without_power_it_ends_in_the_same_tick(void)
{
    be_excited(0, 50);
    rig.busy = true;
    rig.device.drive.loop.command.powered[0] = SERVO_LOOP_OFF;
    rig_run(&rig, 1);
    TEST_ASSERT_EQUAL_UINT8(EXCITATION_ENDED, rig.device.drive.loop.excitation.status);
}

/* Somebody pushes y. */
static void test_force_at_its_limit_ends_it_and_is_limited(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2900, 4, 4, 100000));
    be_excited(1, 50);
    rig.lost[1] = 2000; /* 0.15 mm */
    for (int n = 0; n < 1000 && state_of_it() == RUNS; n++) {
        rig_run(&rig, 1);
        TEST_ASSERT_TRUE(rig.out.force_mN[1] <= 100000 && rig.out.force_mN[1] >= -100000);
    }
    TEST_ASSERT_EQUAL_UINT32(AT_LIMIT, state_of_it());
    expect_power(true, true);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_axis_that_is_not_enabled_is_not_excited);
    RUN_TEST(test_what_would_exceed_a_limit_is_refused);
    RUN_TEST(test_force_and_counts_of_x_are_correlated_on_the_drive);
    RUN_TEST(test_force_and_counts_of_y_are_correlated_on_the_drive);
    RUN_TEST(test_second_encoder_is_correlated_too);
    RUN_TEST(test_lost_master_ends_it);
    RUN_TEST(test_quick_stop_and_halt_end_it);
    RUN_TEST(test_fault_ends_it_in_the_same_tick);
    RUN_TEST(test_without_power_it_ends_in_the_same_tick);
    RUN_TEST(test_force_at_its_limit_ends_it_and_is_limited);
    return UNITY_END();
}
