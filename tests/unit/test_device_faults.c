/* SPDX-License-Identifier: Apache-2.0 */
/* The whole firmware on a simulated machine. Faults on the way, and the way back. */
#include <math.h>

#include "test_device.h"

static void test_lost_heartbeat_stops_on_the_path_then_faults(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 500);
    rig.heartbeat_every_ms = 0;
    run_on_the_line(230); /* 200 ms from the last one on */
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x8130));
    rig_expect_states(&rig, RIG_REACTION, RIG_REACTION);
    expect_power(true, true);
    TEST_ASSERT_TRUE(rig_bit(&rig, IP_ACTIVE));
    run_on_the_line(STOP_MS);
    expect_fault(0x8130);
    expect_standing_on_the_line();
    TEST_ASSERT_EQUAL_HEX32(0x11, rig_read(&rig, 0x1001, 0));
    TEST_ASSERT_EQUAL_UINT(1, rig.emcy_count);
    rig_ms(&rig, 1000);
    TEST_ASSERT_EQUAL_UINT(1, rig.emcy_count);
    rig.heartbeat_every_ms = 50;
    rig_ms(&rig, 60);
    reset_faults_and_enable_again();
}

static void test_lost_heartbeat_without_power_is_latched_until_it_is_back(void)
{
    rig_enable(&rig);
    rig_ms(&rig, 100);
    rig_controlwords(&rig, 0, 0);
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 300);
    expect_fault(0x8130);
    for (int i = 0; i < 5; i++) {
        rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
        rig_ms(&rig, 5);
        rig_controlwords(&rig, ENABLE, ENABLE);
        rig_ms(&rig, 5);
        expect_fault(0x8130);
    }
    TEST_ASSERT_EQUAL_UINT(1, rig.emcy_count);
    rig.heartbeat_every_ms = 50;
    rig_ms(&rig, 60);
    expect_fault(0x8130);
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords(&rig, SWITCH_ON, SWITCH_ON);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    expect_power(true, true);
    rig.heartbeat_every_ms = 0; /* it is watched again */
    rig_ms(&rig, 400);
    expect_fault(0x8130);
}

static void test_watch_that_is_written_anew_waits_for_no_lost_heartbeat(void)
{
    rig_enable(&rig);
    rig_ms(&rig, 100);
    rig_controlwords(&rig, 0, 0);
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 300);
    expect_fault(0x8130);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1016, 1, 4, 0));
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_ms(&rig, 5);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
}

static void test_underrun_stops_on_the_path_then_faults(void)
{
    rig_enable(&rig);
    rig_begin(&rig, &stream);
    rig_feed(&rig, &stream, 800);
    rig_controlwords(&rig, RUN, RUN);
    run_on_the_line(900);
    expect_fault(0xFF10);
    expect_standing_on_the_line();
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, 18));
    TEST_ASSERT_UINT32_WITHIN(2, 797, rig_read(&rig, 0x2200, 8));
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    reset_faults_and_enable_again();
}

static void test_hiccup_of_the_stream_slows_the_path_without_a_fault(void)
{
    rig_enable(&rig);
    rig_begin(&rig, &stream);
    rig_feed(&rig, &stream, 800);
    rig_controlwords(&rig, RUN, RUN);
    run_on_the_line(800);
    TEST_ASSERT_UINT32_WITHIN(200, 400, rig_read(&rig, 0x2200, 13));
    TEST_ASSERT_TRUE(rig_bit(&rig, IP_ACTIVE));
    rig_feed(&rig, &stream, stream.count);
    run_on_the_line(800);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, 18));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_knot_outside_the_limits_stops_on_the_path_then_faults(void)
{
    rig_write(&rig, 0x607D, 2, 4, 20000000);
    rig_enable(&rig);
    rig_go(&rig, &stream, 400);
    TEST_ASSERT_TRUE(rig.accepted < stream.count);
    run_on_the_line(800);
    expect_fault(0xFF11);
    TEST_ASSERT_TRUE(rig.plant.pos_m[0] < 20e-3);
    stream.length_nm = -10e6;
    reset_faults_and_enable_again();
}

static void test_knot_outside_the_limits_before_the_start_faults_at_once(void)
{
    rig_write(&rig, 0x2130, 4, 4, 1000000); /* 1000 m/s2 */
    rig_enable(&rig);
    rig_begin(&rig, &stream);
    for (int i = 0; i < 30; i++) {
        rig_knot(&rig, (uint8_t)i, 900000 * (i < 9 ? i : 9), 0);
    }
    rig_ms(&rig, 2);
    expect_fault(0xFF11);
    reset_faults_and_enable_again();
}

static void test_blocked_axis_trips_by_its_following_error(void)
{
    rig_write(&rig, 0x2121, 1, 2, 0); /* nor by an encoder that stands */
    rig_enable(&rig);
    rig_go(&rig, &stream, 400);
    rig.plant.machine.coulomb_N[1] = 1e6;
    unsigned ms = 0;
    while (rig.out.enable[0] && ms++ < 500) {
        rig_ms(&rig, 1);
        TEST_ASSERT_INT32_WITHIN(2100000, 0, (int32_t)rig_read(&rig, 0x68F4, 0)); /* window 2 mm, 67 um a ms */
    }
    rig_ms(&rig, 1);
    expect_fault(0x8611);
    rig.plant.machine.coulomb_N[1] = 54.8;
    rig_ms(&rig, 200);
    reset_faults_and_enable_again();
}

static void test_axis_faster_than_its_limit_trips(void)
{
    rig_write(&rig, 0x2130, 1, 4, 30000); /* 30 mm/s; the line asks x for 53 mm/s */
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    expect_fault(0x8400);
    TEST_ASSERT_TRUE(hypot(rig.plant.vel_mps[0], rig.plant.vel_mps[1]) < 0.06);
}

static void test_axis_outside_its_limits_is_enabled_and_held_but_no_stream_leads_further_out(void)
{
    static const struct {
        uint16_t index;
        uint8_t sub;
        int32_t limit; /* it stands at 0; the following window of 2 mm is on top */
    } limits[] = {{0x607D, 1, 2100000}, {0x607D, 2, -2100000}, {0x687D, 1, 2100000}, {0x687D, 2, -2100000}};
    for (unsigned i = 0; i < 4; i++) {
        setUp();
        rig_write(&rig, limits[i].index, limits[i].sub, 4, limits[i].limit);
        rig_nmt(&rig, 1);
        rig_ms(&rig, 3);
        rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
        rig_controlwords(&rig, ENABLE, ENABLE);
        rig_ms(&rig, 2);
        rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
        stream.length_nm = limits[i].sub == 1 ? -50e6 : 50e6;
        TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
        rig_feed(&rig, &stream, 1000);
        rig_ms(&rig, 2);
        expect_fault(0xFF11);
        TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, 20));
    }
}

static void test_fault_input_cuts_the_power_in_the_same_period(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig.inputs[1] = HAL_AMPLIFIER_FAULT;
    rig_run(&rig, 1);
    expect_power(false, false);
    TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[0]);
    rig_ms(&rig, 200);
    expect_fault(0x5400);
}

static void test_fault_cannot_be_reset_while_its_cause_is_there(void)
{
    rig_enable(&rig);
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_ms(&rig, 2);
    expect_fault(0x5400);
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_ms(&rig, 5);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    rig_controlwords(&rig, 0, 0);
    rig.inputs[0] = 0;
    reset_faults_and_enable_again();
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_lost_heartbeat_stops_on_the_path_then_faults);
    RUN_TEST(test_lost_heartbeat_without_power_is_latched_until_it_is_back);
    RUN_TEST(test_watch_that_is_written_anew_waits_for_no_lost_heartbeat);
    RUN_TEST(test_underrun_stops_on_the_path_then_faults);
    RUN_TEST(test_hiccup_of_the_stream_slows_the_path_without_a_fault);
    RUN_TEST(test_knot_outside_the_limits_stops_on_the_path_then_faults);
    RUN_TEST(test_knot_outside_the_limits_before_the_start_faults_at_once);
    RUN_TEST(test_blocked_axis_trips_by_its_following_error);
    RUN_TEST(test_axis_faster_than_its_limit_trips);
    RUN_TEST(test_axis_outside_its_limits_is_enabled_and_held_but_no_stream_leads_further_out);
    RUN_TEST(test_fault_input_cuts_the_power_in_the_same_period);
    RUN_TEST(test_fault_cannot_be_reset_while_its_cause_is_there);
    return UNITY_END();
}
