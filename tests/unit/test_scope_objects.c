/* SPDX-License-Identifier: Apache-2.0 */
/* The scope over the bus: what 2300h and 2301h take, and what they tell. What it records: test_scope.c. */
#include "drive_rig.h"

enum { ARM = 1, DEFAULTS = 2, OFF = 3 };

static struct rig rig;

void setUp(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    rig_ms(&rig, 2);
}

void tearDown(void)
{
}

static uint32_t tells(uint8_t sub)
{
    return rig_read(&rig, 0x2300, sub);
}

static uint32_t command(uint8_t number)
{
    return rig_write(&rig, 0x2300, 1, 1, number);
}

static void test_scope_waits_from_power_on_and_tells_what_a_fault_has_left(void)
{
    TEST_ASSERT_EQUAL_UINT32(SCOPE_WAITING, tells(2));
    TEST_ASSERT_EQUAL_UINT32(0, tells(8));
    TEST_ASSERT_EQUAL_UINT32(0, tells(9));
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_run(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_TRIGGERED, tells(2));
    TEST_ASSERT_EQUAL_UINT32(0, tells(8));
    TEST_ASSERT_EQUAL_UINT32(20, tells(9)); /* periods since power-on */
    rig_ms(&rig, 1000);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_DONE, tells(2));
    TEST_ASSERT_EQUAL_UINT32(20, tells(9));
    TEST_ASSERT_GREATER_THAN_UINT32(100, tells(8));
}

static void test_armed_by_command_it_records_what_it_was_commanded_to(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2300, 3, 4, 100));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2300, 4, 1, SCOPE_NOW));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2301, 1, 1, SIGNAL_ENCODER_COUNT_Y));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2301, 2, 1, 0));
    TEST_ASSERT_EQUAL_HEX32(0, command(ARM));
    rig_ms(&rig, 1 + SCOPE_SAMPLES / 10);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_DONE, tells(2));
    TEST_ASSERT_EQUAL_UINT32(SCOPE_SAMPLES, tells(8));
    TEST_ASSERT_EQUAL_UINT32(20, tells(9));
    TEST_ASSERT_EQUAL_HEX32(0, command(DEFAULTS));
    TEST_ASSERT_EQUAL_UINT32_MESSAGE(0, tells(9), "of the capture before");
}

static void test_command_off_stops_it_whatever_comes(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, command(OFF));
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_ms(&rig, 1000);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_OFF, tells(2));
    TEST_ASSERT_EQUAL_UINT32(0, tells(8));
    TEST_ASSERT_EQUAL_UINT32(0, tells(9));
}

static void test_command_for_the_defaults_puts_them_back_and_arms(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, command(OFF));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2300, 3, 4, 100));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2301, 1, 1, SIGNAL_ENCODER_COUNT_Y));
    TEST_ASSERT_EQUAL_HEX32(0, command(DEFAULTS));
    TEST_ASSERT_EQUAL_UINT32(SCOPE_WAITING, tells(2));
    TEST_ASSERT_EQUAL_UINT32(od_defaults.scope.interval, tells(3));
    TEST_ASSERT_EQUAL_UINT32(SIGNAL_CONTOUR_ERROR, rig_read(&rig, 0x2301, 1));
}

/* ... whoever wants the scope for something else. */
static void test_capture_of_a_fault_is_kept_until_the_fault_is_reset(void)
{
    rig_nmt(&rig, 1);
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_ms(&rig, 2);
    for (unsigned i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_UINT32(i == 0 ? SCOPE_TRIGGERED : SCOPE_DONE, tells(2));
        for (uint8_t number = ARM; number <= OFF; number++) {
            TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STATE, command(number));
        }
        /* it would be armed so after the reset */
        TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STATE, rig_write(&rig, 0x2300, 3, 4, 100));
        TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STATE, rig_write(&rig, 0x2301, 1, 1, SIGNAL_ENCODER_COUNT_Y));
        TEST_ASSERT_EQUAL_UINT32(i == 0 ? SCOPE_TRIGGERED : SCOPE_DONE, tells(2));
        rig_ms(&rig, 1000);
    }
    TEST_ASSERT_EQUAL_UINT32(SIGNAL_CONTOUR_ERROR, rig_read(&rig, 0x2301, 1));
    rig.inputs[0] = 0;
    rig_ms(&rig, 2);
    rig_controlwords(&rig, 0x80, 0x80);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_WAITING, tells(2));
    TEST_ASSERT_EQUAL_HEX32(0, command(OFF));
}

static void test_fault_without_a_capture_keeps_nobody_from_the_scope(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, command(OFF));
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2300, 4, 1, SCOPE_NOW));
    TEST_ASSERT_EQUAL_HEX32(0, command(ARM));
    rig_ms(&rig, 1000);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_DONE, tells(2));
    TEST_ASSERT_EQUAL_HEX32(0, command(DEFAULTS));
}

static void test_scope_that_would_record_nothing_is_not_armed(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2301, 1, 1, 0));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_INCOMPATIBLE, command(ARM));
}

static void test_signal_that_there_is_not_is_refused_as_channel_and_as_source(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2301, 8, 1, SIGNALS - 1));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_VALUE, rig_write(&rig, 0x2301, 8, 1, SIGNALS));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2300, 5, 1, SIGNALS - 1));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_VALUE, rig_write(&rig, 0x2300, 5, 1, 255));
    TEST_ASSERT_EQUAL_UINT32(SIGNALS - 1, tells(5));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2300, 5, 1, 0));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_scope_waits_from_power_on_and_tells_what_a_fault_has_left);
    RUN_TEST(test_armed_by_command_it_records_what_it_was_commanded_to);
    RUN_TEST(test_command_off_stops_it_whatever_comes);
    RUN_TEST(test_command_for_the_defaults_puts_them_back_and_arms);
    RUN_TEST(test_capture_of_a_fault_is_kept_until_the_fault_is_reset);
    RUN_TEST(test_fault_without_a_capture_keeps_nobody_from_the_scope);
    RUN_TEST(test_scope_that_would_record_nothing_is_not_armed);
    RUN_TEST(test_signal_that_there_is_not_is_refused_as_channel_and_as_source);
    return UNITY_END();
}
