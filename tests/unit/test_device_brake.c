/* SPDX-License-Identifier: Apache-2.0 */
/* The whole firmware on a simulated machine, whose axes have brakes that take a time (2160h). */
#include "test_device.h"

enum { BRAKE_X = 0x2160, BRAKE_Y = 0x2960, WIRING_X = 0x2104, RELEASE = 1, ENGAGE = 2, OUTPUTS_X = 0x60FE };
enum { RELEASE_MS = 40, ENGAGE_MS = 60 };

static void set_brakes(void)
{
    for (uint16_t at = BRAKE_X; at <= BRAKE_Y; at += BRAKE_Y - BRAKE_X) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, at, RELEASE, 2, RELEASE_MS));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, at, ENGAGE, 2, ENGAGE_MS));
    }
    rig_ms(&rig, 5);
}

static void expect_released(bool x, bool y)
{
    TEST_ASSERT_EQUAL(x, rig.out.release[0]);
    TEST_ASSERT_EQUAL(y, rig.out.release[1]);
}

static void command_enable(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 3);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords(&rig, SWITCH_ON, SWITCH_ON);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_run(&rig, 1);
}

static void be_enabled(void)
{
    set_brakes();
    command_enable();
    rig_ms(&rig, RELEASE_MS + 3);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

/* The axes stand, and are to lose their power: the law holds them until the brakes have engaged. */
static void expect_to_lose_power_after_the_brakes(void)
{
    for (int i = 0; i < ENGAGE_MS - 5; i++) {
        expect_power(true, true);
        expect_released(false, false);
        rig_ms(&rig, 1);
    }
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, OUTPUTS_X, 1));
    rig.lost[0] = 3; /* something pushes x: it is still held */
    rig_ms(&rig, 2);
    TEST_ASSERT_NOT_EQUAL_INT32(0, rig.out.force_mN[0]);
    rig_ms(&rig, 6);
    expect_power(false, false);
}

static void test_an_axis_may_move_when_its_brake_has_been_released(void)
{
    set_brakes();
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, WIRING_X, 6, 2, 20));
    rig_ms(&rig, 5);
    command_enable();
    rig_ms(&rig, 10);
    expect_power(true, true);
    expect_released(false, true); /* y is live at once */
    rig_ms(&rig, 15);
    expect_released(true, true);
    rig_expect_states(&rig, RIG_SWITCHED_ON, RIG_SWITCHED_ON);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &stream));
    rig_ms(&rig, 20);
    rig_expect_states(&rig, RIG_SWITCHED_ON, RIG_ENABLED);
    rig_ms(&rig, 20);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, OUTPUTS_X, 1));
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
}

static void test_each_way_out_that_stops_first_engages_the_brake_before_the_power_ends(void)
{
    static const uint16_t words[] = {SWITCH_ON, SHUTDOWN, QUICK_STOP};
    for (unsigned i = 0; i < 3; i++) {
        setUp();
        be_enabled();
        rig_controlwords(&rig, words[i], words[i]);
        rig_run(&rig, 2);
        expect_to_lose_power_after_the_brakes();
    }
}

static void test_a_path_is_stopped_before_the_brakes_engage(void)
{
    be_enabled();
    rig_go(&rig, &stream, 700);
    rig_nmt(&rig, 2);
    for (unsigned i = 0; i < STOP_MS - 10; i++) {
        expect_released(true, true);
        run_on_the_line(1);
    }
    rig_ms(&rig, 20);
    expect_released(false, false);
    expect_power(true, true);
    expect_standing_on_the_line();
    rig_ms(&rig, ENGAGE_MS);
    expect_power(false, false);
}

static void test_a_fault_that_stops_on_the_path_does_the_same_and_one_that_cuts_does_not_wait(void)
{
    be_enabled();
    rig.heartbeat_every_ms = 10;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1017, 0, 2, 0));
    rig.inputs[0] = HAL_STOP;
    rig_run(&rig, 1);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_REACTION, RIG_REACTION);
    expect_to_lose_power_after_the_brakes();
    expect_fault(0x9000);
    setUp();
    be_enabled();
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_run(&rig, 1);
    expect_power(false, false);
    expect_released(false, false);
}

static void test_disable_voltage_cuts_force_and_releases_nothing(void)
{
    be_enabled();
    rig_controlwords(&rig, 0, 0);
    rig_run(&rig, 1);
    expect_power(false, false);
    expect_released(false, false);
}

static void test_an_axis_that_keeps_its_power_after_all_is_released_again(void)
{
    be_enabled();
    for (uint16_t at = 0x605A; at <= 0x685A; at += 0x800) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, at, 0, 2, 6)); /* stay in quick stop active */
    }
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_ms(&rig, ENGAGE_MS / 2);
    expect_released(false, false);
    rig_controlwords(&rig, QUICK_STOP, QUICK_STOP);
    rig_ms(&rig, 1);
    expect_released(true, true);
    rig_ms(&rig, 2 * ENGAGE_MS);
    rig_expect_states(&rig, RIG_QUICK_STOP, RIG_QUICK_STOP);
    expect_power(true, true);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_an_axis_may_move_when_its_brake_has_been_released);
    RUN_TEST(test_each_way_out_that_stops_first_engages_the_brake_before_the_power_ends);
    RUN_TEST(test_a_path_is_stopped_before_the_brakes_engage);
    RUN_TEST(test_a_fault_that_stops_on_the_path_does_the_same_and_one_that_cuts_does_not_wait);
    RUN_TEST(test_disable_voltage_cuts_force_and_releases_nothing);
    RUN_TEST(test_an_axis_that_keeps_its_power_after_all_is_released_again);
    return UNITY_END();
}
