/* SPDX-License-Identifier: Apache-2.0 */
/* The whole firmware on a simulated machine. Ways to stop: out of operation enabled, NMT states and resets. */
#include "test_device.h"

static void check_leaving(uint16_t controlword, unsigned state)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_controlwords(&rig, controlword, controlword);
    run_on_the_line(STOP_MS - 10);
    expect_power(true, true);
    run_on_the_line(20);
    rig_expect_states(&rig, state, state);
    expect_power(false, false);
    expect_standing_on_the_line();
    rig_knot(&rig, (uint8_t)stream.sent, 0, 0);
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, 17)); /* closed */
}

static void test_disable_operation_stops_on_the_path_first(void)
{
    check_leaving(SWITCH_ON, RIG_SWITCHED_ON);
}

static void test_shutdown_stops_on_the_path_first(void)
{
    check_leaving(SHUTDOWN, RIG_READY);
}

static void test_quick_stop_stops_on_the_path_first(void)
{
    check_leaving(QUICK_STOP, RIG_DISABLED);
}

static void test_quick_stop_of_one_axis_stops_both_on_the_path(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_controlwords(&rig, QUICK_STOP, RUN);
    rig_expect_states(&rig, RIG_QUICK_STOP, RIG_ENABLED);
    run_on_the_line(STOP_MS + 20);
    rig_expect_states(&rig, RIG_DISABLED, RIG_ENABLED);
    expect_power(false, true);
    expect_standing_on_the_line();
}

static void test_disable_voltage_cuts_the_power_at_once(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_controlwords(&rig, 0, 0);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    rig_run(&rig, 1);
    expect_power(false, false);
    TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[0]);
    TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[1]);
}

static void check_nmt(uint8_t command)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_nmt(&rig, command);
    run_on_the_line(STOP_MS - 10);
    expect_power(true, true);
    run_on_the_line(20);
    expect_power(false, false);
    expect_standing_on_the_line();
    rig_nmt(&rig, 1);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    rig_enable(&rig);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
}

static void test_nmt_stop_during_motion_stops_on_the_path(void)
{
    check_nmt(2);
}

static void test_nmt_pre_operational_during_motion_stops_on_the_path(void)
{
    check_nmt(128);
}

static void test_reset_communication_during_motion_stops_on_the_path(void)
{
    check_nmt(130);
}

static void test_reset_node_during_motion_cuts_the_power_at_once(void)
{
    rig_write(&rig, 0x2110, 1, 4, 150000);
    rig_enable(&rig);
    rig_go(&rig, &stream, 300);
    const uint32_t tick = rig_read(&rig, 0x2020, 3);
    rig_nmt(&rig, 129);
    rig_run(&rig, 1);
    expect_power(false, false);
    TEST_ASSERT_EQUAL_UINT(2, rig.boot_ups);
    TEST_ASSERT_EQUAL_UINT32(od_defaults.smc.lambda, rig_read(&rig, 0x2110, 1));
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream_state());
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 13));
    rig_ms(&rig, 298);
    const double x = rig.plant.pos_m[0];
    rig_enable(&rig);
    TEST_ASSERT_UINT32_WITHIN(10, tick + 300, rig_read(&rig, 0x2020, 3)); /* time since power-on goes on */
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, x, rig.plant.pos_m[0]);
    TEST_ASSERT_EQUAL_UINT16(QUEUE_ROOM, rig.free);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_reset_node_clears_faults(void)
{
    rig_enable(&rig);
    rig.inputs[1] = HAL_AMPLIFIER_FAULT;
    rig_ms(&rig, 2);
    rig.inputs[1] = 0;
    expect_fault(0x5400);
    rig_nmt(&rig, 129);
    rig_ms(&rig, 3);
    TEST_ASSERT_EQUAL_HEX32(0, rig_read(&rig, 0x603F, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_read(&rig, 0x1001, 0));
    rig_enable(&rig);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_disable_operation_stops_on_the_path_first);
    RUN_TEST(test_shutdown_stops_on_the_path_first);
    RUN_TEST(test_quick_stop_stops_on_the_path_first);
    RUN_TEST(test_quick_stop_of_one_axis_stops_both_on_the_path);
    RUN_TEST(test_disable_voltage_cuts_the_power_at_once);
    RUN_TEST(test_nmt_stop_during_motion_stops_on_the_path);
    RUN_TEST(test_nmt_pre_operational_during_motion_stops_on_the_path);
    RUN_TEST(test_reset_communication_during_motion_stops_on_the_path);
    RUN_TEST(test_reset_node_during_motion_cuts_the_power_at_once);
    RUN_TEST(test_reset_node_clears_faults);
    return UNITY_END();
}
