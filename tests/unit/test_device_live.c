/* SPDX-License-Identifier: Apache-2.0 */
/* The whole firmware on a simulated machine, whose amplifiers are live some time after they are enabled (2104h:6, 7). */
#include "test_device.h"

enum { WIRING_X = 0x2104, WIRING_Y = 0x2904, DELAY = 6, READY = 7, DELAY_MS = 50 };

static void set_wiring(uint8_t sub, uint8_t len, uint32_t value)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, WIRING_X, sub, len, value));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, WIRING_Y, sub, len, value));
    rig_ms(&rig, 5);
}

/* Both axes are to be enabled from now on. */
static void command_enable(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 3);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords(&rig, SWITCH_ON, SWITCH_ON);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_run(&rig, 1);
}

static void expect_no_force(void)
{
    TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[0]);
    TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[1]);
}

static void amplifiers_not_ready(bool x, bool y)
{
    rig.inputs[0] = x ? HAL_AMPLIFIER_FAULT : 0;
    rig.inputs[1] = y ? HAL_AMPLIFIER_FAULT : 0;
}

static void test_until_an_amplifier_is_live_there_is_power_but_no_force_and_no_operation_enabled(void)
{
    set_wiring(DELAY, 2, DELAY_MS);
    command_enable();
    for (int i = 0; i < DELAY_MS - 2; i++) {
        expect_power(true, true);
        expect_no_force();
        rig_expect_states(&rig, RIG_SWITCHED_ON, RIG_SWITCHED_ON);
        rig.lost[0] = i % 50; /* the table is pushed: no error may wind up meanwhile */
        rig_ms(&rig, 1);
    }
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &stream));
    rig_ms(&rig, 5);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    for (int i = 0; i < 100; i++) {
        TEST_ASSERT_INT32_WITHIN(5000, 0, rig.out.force_mN[0]); /* it is held where it is now */
        rig_ms(&rig, 1);
    }
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
}

static void test_each_axis_has_a_time_of_its_own(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, WIRING_Y, DELAY, 2, DELAY_MS));
    rig_ms(&rig, 5);
    command_enable();
    rig_ms(&rig, 5);
    expect_power(true, true);
    rig_expect_states(&rig, RIG_ENABLED, RIG_SWITCHED_ON);
    rig_ms(&rig, DELAY_MS);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

static void test_an_amplifier_that_is_switched_off_before_it_is_live_takes_all_its_time_again(void)
{
    set_wiring(DELAY, 2, DELAY_MS);
    command_enable();
    rig_ms(&rig, DELAY_MS / 2);
    rig_controlwords(&rig, 0, 0);
    rig_run(&rig, 1);
    expect_power(false, false);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    rig_ms(&rig, 2 * DELAY_MS);
    command_enable();
    rig_ms(&rig, DELAY_MS - 5);
    rig_expect_states(&rig, RIG_SWITCHED_ON, RIG_SWITCHED_ON);
    rig_ms(&rig, 7);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

static void test_a_fault_before_it_is_live_cuts_the_power_in_the_same_tick(void)
{
    set_wiring(DELAY, 2, DELAY_MS);
    command_enable();
    rig_ms(&rig, 5);
    expect_power(true, true);
    amplifiers_not_ready(true, false);
    rig_run(&rig, 1);
    expect_power(false, false);
    rig_ms(&rig, 2);
    expect_fault(0x5400);
}

static void test_an_amplifier_that_says_ready_only_when_it_is_live_can_be_enabled(void)
{
    set_wiring(READY, 1, 1);
    set_wiring(DELAY, 2, DELAY_MS);
    amplifiers_not_ready(true, true);
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    command_enable();
    rig_ms(&rig, DELAY_MS / 2);
    rig_expect_states(&rig, RIG_SWITCHED_ON, RIG_SWITCHED_ON);
    amplifiers_not_ready(false, false);
    rig_ms(&rig, 4); /* it does not wait for the rest of the time */
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    rig_ms(&rig, 100);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    amplifiers_not_ready(false, true);
    rig_run(&rig, 1);
    expect_power(false, false);
    rig_ms(&rig, 2);
    expect_fault(0x5400);
}

static void test_an_amplifier_that_does_not_become_ready_in_time_is_a_fault(void)
{
    set_wiring(READY, 1, 1);
    set_wiring(DELAY, 2, DELAY_MS);
    amplifiers_not_ready(true, false);
    command_enable();
    for (int i = 0; i < DELAY_MS + 5; i++) {
        TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[0]);
        rig_ms(&rig, 1);
    }
    expect_power(false, false);
    expect_fault(0x5400);
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET); /* it has no power, so its input is no fault now */
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_until_an_amplifier_is_live_there_is_power_but_no_force_and_no_operation_enabled);
    RUN_TEST(test_each_axis_has_a_time_of_its_own);
    RUN_TEST(test_an_amplifier_that_is_switched_off_before_it_is_live_takes_all_its_time_again);
    RUN_TEST(test_a_fault_before_it_is_live_cuts_the_power_in_the_same_tick);
    RUN_TEST(test_an_amplifier_that_says_ready_only_when_it_is_live_can_be_enabled);
    RUN_TEST(test_an_amplifier_that_does_not_become_ready_in_time_is_a_fault);
    return UNITY_END();
}
