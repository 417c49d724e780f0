/* SPDX-License-Identifier: Apache-2.0 */
/* Faults of the stream, the path and the law, one after the other (supervision/faults.toml). */
#include <stdlib.h>

#include "test_faults.h"

void setUp(void)
{
    power_on();
}

void tearDown(void)
{
}

/* Friction grows within a period: y is off its path for some milliseconds. */
static void disturb(bool on)
{
    rig.plant.machine.coulomb_N[1] = on ? 550 : 54.8;
}

static uint32_t last_heartbeat_ms;
static double radius; /* nm */

/* By the true position */
static bool outside(void)
{
    return rig_off_line(&rig, &stream) > radius;
}

static void tunnel(uint32_t radius_nm, uint16_t debounce_ms, uint8_t reaction)
{
    off_path_nm = 1e6;
    radius = radius_nm;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2120, 1, 4, radius_nm));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2120, 2, 2, debounce_ms));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2120, 3, 1, reaction));
}

static bool silent_for_its_time(void)
{
    return rig.ms >= last_heartbeat_ms + 200;
}

static void test_heartbeat_that_ceases_stops_on_the_path(void)
{
    be_on_the_way();
    last_heartbeat_ms = rig.ms - rig.ms % rig.heartbeat_every_ms;
    rig.heartbeat_every_ms = 0;
    wait_for(ROW_HEARTBEAT, silent_for_its_time, 0);
    expect_reaction(ROW_HEARTBEAT);
    rig.heartbeat_every_ms = 50;
    expect_clearing(ROW_HEARTBEAT, 0);
}

static void test_underrun_stops_on_the_path(void)
{
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    rig_feed(&rig, &stream, 700);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 600);
    rig.emcy_count = 0;
    for (unsigned i = 0; i < 2000 && !detected(ROW_UNDERRUN); i++) {
        rig_run(&rig, 1);
        TEST_ASSERT_TRUE(rig_off_line(&rig, &stream) < 1000);
    }
    expect_reaction(ROW_UNDERRUN);
    expect_clearing(ROW_UNDERRUN, 0);
}

/* The first 1000 knots, and 400 ms of the way */
static void go_with_a_part(void)
{
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    rig_feed(&rig, &stream, 1000);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 400);
    rig.emcy_count = 0;
}

static void test_knot_range_stops_on_the_path(void)
{
    rig_write(&rig, 0x607D, 2, 4, rig_line(1100, 1500, 50e6) / 5 * 4);
    go_with_a_part();
    rig_feed(&rig, &stream, 1200);
    expect_reaction(ROW_KNOT_RANGE);
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, 20));
    expect_clearing(ROW_KNOT_RANGE, 0);
}

static void test_knot_acceleration_beyond_its_limit_stops_on_the_path(void)
{
    go_with_a_part();
    const struct knot a = rig_stream_knot(&stream, stream.sent - 2), b = rig_stream_knot(&stream, stream.sent - 1);
    const uint32_t accepted = rig_read(&rig, 0x2200, 7);
    rig_knot(&rig, (uint8_t)stream.sent, b.nm[0] - a.nm[0], b.nm[1] - a.nm[1] + 20000); /* 20 m/s2: just within */
    TEST_ASSERT_EQUAL_UINT32(accepted + 1, rig_read(&rig, 0x2200, 7));
    rig_knot(&rig, (uint8_t)(stream.sent + 1), b.nm[0] - a.nm[0] - 20001, b.nm[1] - a.nm[1] + 20000);
    TEST_ASSERT_EQUAL_UINT32(accepted + 1, rig_read(&rig, 0x2200, 7));
    expect_reaction(ROW_KNOT_ACCELERATION);
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, 20));
    expect_clearing(ROW_KNOT_ACCELERATION, 0);
}

static void test_last_knot_at_speed_stops_on_the_path(void)
{
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    rig_write(&rig, 0x2200, 4, 4, 750); /* the middle, where it is fastest */
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 1));
    rig_feed(&rig, &stream, 749);
    rig_controlwords(&rig, 0x1F, 0x1F);
    rig_ms(&rig, 400);
    rig.emcy_count = 0;
    rig_feed(&rig, &stream, 750);
    expect_reaction(ROW_KNOT_ACCELERATION);
    TEST_ASSERT_EQUAL_UINT32(749, rig_read(&rig, 0x2200, 7));
}

static void test_tunnel_stops_on_the_path(void)
{
    tunnel(10000, 5, 1);
    be_on_the_way();
    disturb(true);
    wait_for(ROW_TUNNEL, outside, 50);
    expect_reaction(ROW_TUNNEL);
    disturb(false);
    expect_clearing(ROW_TUNNEL, 0);
}

static void test_tunnel_may_be_left_as_long_as_its_debounce_says(void)
{
    tunnel(10000, 5, 1);
    be_on_the_way();
    disturb(true);
    unsigned outside = 0;
    for (unsigned i = 0; i < 100 && !detected(ROW_TUNNEL); i++) {
        rig_ms(&rig, 1);
        outside = labs((long)servo_loop_snapshot(&rig.device.drive.loop)->contour_error_nm) > 10000 ? outside + 1 : 0;
        TEST_ASSERT_EQUAL(outside > 5, detected(ROW_TUNNEL));
    }
    TEST_ASSERT_TRUE(detected(ROW_TUNNEL));
}

static void leave_a_tunnel_that_only_warns(void)
{
    tunnel(10000, 1, 0);
    be_on_the_way();
    disturb(true);
    wait_for(ROW_TUNNEL, outside, 10);
    expect_reaction_as(ROW_TUNNEL, PROMISED_WARN);
    disturb(false);
}

static void test_tunnel_that_only_warns_lets_the_path_run(void)
{
    leave_a_tunnel_that_only_warns();
    expect_end(ROW_TUNNEL, 200);
    expect_capture(ROW_TUNNEL);
    expect_path_runs();
}

static void test_tunnel_that_only_warns_is_captured_until_the_axes_get_power_again(void)
{
    leave_a_tunnel_that_only_warns();
    run_on(500);
    expect_capture(ROW_TUNNEL);
    disturb(true); /* a second time */
    run_on(100);
    disturb(false);
    run_on(800); /* to the end of the path */
    expect_capture(ROW_TUNNEL);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_ms(&rig, 300);
    expect_no_power();
    expect_capture(ROW_TUNNEL);
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_UINT32(SCOPE_WAITING, rig_read(&rig, 0x2300, 2));
}

static void test_fault_after_a_tunnel_that_only_warned_has_a_capture_of_its_own(void)
{
    leave_a_tunnel_that_only_warns();
    run_on(500);
    expect_capture(ROW_TUNNEL);
    run_on(300);
    rig.inputs[1] = HAL_AMPLIFIER_FAULT;
    expect_reaction(ROW_AMPLIFIER);
    rig.inputs[1] = 0;
    expect_clearing(ROW_AMPLIFIER, 0);
}

static void test_tunnel_that_only_warns_does_not_trigger_what_waits_for_something_else(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2300, 4, 1, SCOPE_RISING));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2300, 5, 1, SIGNAL_FORCE_X));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2300, 6, 4, INT32_MAX));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2300, 1, 1, SCOPE_COMMAND_ARM));
    tunnel(10000, 1, 0);
    be_on_the_way();
    disturb(true);
    rig_ms(&rig, 100);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, promises[ROW_TUNNEL].emcy));
    TEST_ASSERT_EQUAL_UINT32(SCOPE_WAITING, rig_read(&rig, 0x2300, 2));
}

static void test_tunnel_with_a_quick_stop_does_as_605Ah_says(void)
{
    tunnel(10000, 1, 2);
    be_on_the_way();
    disturb(true);
    wait_for(ROW_TUNNEL, outside, 10);
    expect_reaction_as(ROW_TUNNEL, PROMISED_QUICK_STOP);
    disturb(false);
    expect_clearing(ROW_TUNNEL, 0);

    power_on();
    tunnel(10000, 1, 2);
    rig_write(&rig, 0x605A, 0, 2, 0);
    be_on_the_way();
    disturb(true);
    wait_for(ROW_TUNNEL, outside, 10);
    expect_reaction_as(ROW_TUNNEL, PROMISED_QUICK_STOP);
}

static void test_tunnel_may_cut_the_power(void)
{
    tunnel(10000, 1, 3);
    be_on_the_way();
    disturb(true);
    wait_for(ROW_TUNNEL, outside, 10);
    expect_reaction_as(ROW_TUNNEL, PROMISED_DISABLE);
    disturb(false);
    expect_clearing(ROW_TUNNEL, 0);
}

/* The axes are so much lighter than their parameters say that the gains are too high. */
static void make_gains_too_high(bool on)
{
    rig.plant.machine.mass_kg[0] = on ? 88.08 / 5 : 88.08;
    rig.plant.machine.mass_kg[1] = on ? 97.90 / 5 : 97.90;
}

static bool swings(void)
{
    const struct oscillation_state *s = rig.device.drive.loop.servo.oscillation;
    return s[0].half_waves > 0 || s[1].half_waves > 0;
}

static void oscillate(uint8_t reaction)
{
    off_path_nm = 1e6;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2122, 3, 1, reaction));
    be_on_the_way();
    TEST_ASSERT_FALSE(swings());
    make_gains_too_high(true);
    wait_for(ROW_OSCILLATION, swings, 0);
}

static void test_oscillation_stops_on_the_path_and_is_told(void)
{
    oscillate(1);
    expect_reaction(ROW_OSCILLATION);
    make_gains_too_high(false);
    TEST_ASSERT_TRUE(rig_read(&rig, 0x2123, 3) + rig_read(&rig, 0x2123, 4) > 0);
    const uint32_t mHz = rig_read(&rig, 0x2123, 5), mN = rig_read(&rig, 0x2123, 7);
    TEST_ASSERT_TRUE(mHz > 30000 && mHz < 1000000);
    TEST_ASSERT_TRUE(mN > 30000 && mN < 2000000);
    TEST_ASSERT_EQUAL_UINT32(1000, rig_read(&rig, 0x2123, 2));
    expect_clearing(ROW_OSCILLATION, 0);
}

static void test_oscillation_with_a_quick_stop_does_as_605Ah_says(void)
{
    oscillate(2);
    expect_reaction_as(ROW_OSCILLATION, PROMISED_QUICK_STOP);
}

static void test_oscillation_may_cut_the_power(void)
{
    oscillate(3);
    expect_reaction_as(ROW_OSCILLATION, PROMISED_DISABLE);
    make_gains_too_high(false);
    expect_clearing(ROW_OSCILLATION, 0);
}

static void test_oscillation_that_only_warns_lets_the_path_run(void)
{
    oscillate(0);
    expect_reaction_as(ROW_OSCILLATION, PROMISED_WARN);
    run_on(100);
    TEST_ASSERT_TRUE(swings());
    TEST_ASSERT_EQUAL_UINT32(1000, rig_read(&rig, 0x2123, 2));
    make_gains_too_high(false);
    run_on(50);
    expect_end(ROW_OSCILLATION, 1002);
}

static void test_oscillation_that_lowers_the_gains_ends_and_the_gains_come_back_on_request(void)
{
    oscillate(4);
    expect_reaction_as(ROW_OSCILLATION, PROMISED_WARN);
    run_on(300);
    TEST_ASSERT_FALSE(swings());
    const uint32_t gain = rig_read(&rig, 0x2123, 2);
    TEST_ASSERT_TRUE(gain == 500 || gain == 250);
    make_gains_too_high(false);
    expect_end(ROW_OSCILLATION, 1002);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2123, 1, 1, 1));
    run_on(3);
    TEST_ASSERT_EQUAL_UINT32(1000, rig_read(&rig, 0x2123, 2));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2123, 3) + rig_read(&rig, 0x2123, 4));
    TEST_ASSERT_FALSE(swings());
}

static void test_oscillation_is_seen_at_rest_too(void)
{
    off_path_nm = 1e6;
    rig_ms(&rig, 100);
    rig_enable(&rig);
    rig_ms(&rig, 100);
    rig.emcy_count = 0;
    make_gains_too_high(true);
    rig.plant.vel_mps[0] = 0.01; /* somebody knocks at it */
    wait_for(ROW_OSCILLATION, swings, 0);
    expect_reaction(ROW_OSCILLATION);
}

static void test_oscillation_is_not_watched_where_the_limit_is_0(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2122, 1, 4, 0));
    be_on_the_way();
    make_gains_too_high(true);
    run_on(200);
    TEST_ASSERT_FALSE(detected(ROW_OSCILLATION));
}

static void test_tunnel_is_off_by_default(void)
{
    be_on_the_way();
    disturb(true);
    rig_ms(&rig, 50);
    TEST_ASSERT_EQUAL_HEX32(0, rig.device.drive.faults | rig.device.drive.warnings);
}

static bool at_k_max(void)
{
    const vec2 k = last_out()->smc.k_hat;
    return n_to_scaled(k.x, 2000) >= 1001 || n_to_scaled(k.y, 2000) >= 1001;
}

static bool at_mu_max(void)
{
    const vec2 mu = last_out()->compensator.mu;
    return n_to_scaled(mu.x, 40) >= 6001 || n_to_scaled(mu.y, 40) >= 6001;
}

static void test_gain_at_its_limit_is_warned_of(void)
{
    for (int mu = 0; mu < 2; mu++) {
        power_on();
        if (mu == 0) {
            rig_write(&rig, 0x2110, 8, 4, 100100); /* k_max just above k_0 */
            rig_write(&rig, 0x2110, 11, 4, 1000);  /* epsilon: the gain grows from 1 um/s on */
        } else {
            rig_write(&rig, 0x2111, 3, 4, 6001000); /* mu_max just above mu_0 */
            rig_write(&rig, 0x2111, 4, 4, 1000000); /* rho */
            rig_write(&rig, 0x2111, 6, 4, 1000);    /* dead_zone */
        }
        rig_write(&rig, 0x2121, 3, 2, 20);
        rig_enable(&rig);
        rig_go(&rig, &stream, 5);
        wait_for(ROW_GAIN, mu == 0 ? at_k_max : at_mu_max, 200);
        expect_reaction(ROW_GAIN);
        expect_path_runs();
        rig_controlwords(&rig, 0, 0);
        expect_clearing(ROW_GAIN, 3);
    }
}

static void test_gain_that_cannot_grow_is_no_warning(void)
{
    rig_write(&rig, 0x2110, 8, 4, 100000);  /* k_max = k_0 */
    rig_write(&rig, 0x2111, 3, 4, 6000000); /* mu_max = mu_0 */
    rig_write(&rig, 0x2121, 3, 2, 20);
    be_on_the_way();
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL_HEX32(0, rig.device.drive.warnings);
}

#ifndef KONTUR_NUM_FIX /* which has numbers only */
static void test_law_that_gives_no_number_cuts_the_power(void)
{
    const float no_numbers[] = {(float)NAN, (float)INFINITY, -(float)INFINITY};
    for (unsigned i = 0; i < 3; i++) {
        for (unsigned where = 0; where < 6; where++) {
            power_on();
            be_on_the_way();
            struct servo_state *servo = &rig.device.drive.loop.servo;
            float *const places[] = {
                &servo->compensator.q_bar_dot.x, &servo->compensator.q_bar_dot.y, &servo->offset.x, &servo->offset.y,
                &servo->observer[0].vel,         &servo->observer[1].vel};
            servo->blending = true; /* so that the offset counts */
            *places[where] = no_numbers[i];
            rig_run(&rig, 1); /* in the tick that computes it */
            TEST_ASSERT_TRUE(detected(ROW_LAW));
            expect_no_power();
            expect_reaction(ROW_LAW);
            rig_ms(&rig, 1000);
            expect_clearing(ROW_LAW, 0); /* with numbers again */
            for (unsigned k = 0; k < 6; k++) {
                TEST_ASSERT_TRUE(isfinite(*places[k]));
            }
        }
    }
}

static void test_law_without_power_that_has_no_number_starts_anew(void)
{
    for (int axis = 0; axis < 2; axis++) {
        power_on();
        rig_nmt(&rig, 1);
        rig_ms(&rig, 5);
        struct servo_state *servo = &rig.device.drive.loop.servo;
        servo->observer[axis].vel = (float)NAN; /* which no force of the law shows */
        rig_run(&rig, 1);
        TEST_ASSERT_TRUE(detected(ROW_LAW));
        rig_ms(&rig, 10);
        TEST_ASSERT_TRUE(isfinite(servo->observer[axis].vel));
        rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
        rig_ms(&rig, 2);
        rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    }
}
#endif

static void test_stream_of_damaged_frames_is_warned_of(void)
{
    be_on_the_way();
    rig_knot(&rig, (uint8_t)(stream.sent + 3), 0, 0); /* out of sequence */
    expect_reaction(ROW_STREAM);
    run_on(500);
    const uint8_t damaged[8] = {(uint8_t)stream.sent, 1, 2, 3, 4, 5, 6, 7}; /* CRC */
    rig_send(&rig, 0x301, 8, damaged);
    run_on(900);
    TEST_ASSERT_TRUE(rig_bit(&rig, WARNING));
    expect_clearing(ROW_STREAM, 110);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_heartbeat_that_ceases_stops_on_the_path);
    RUN_TEST(test_underrun_stops_on_the_path);
    RUN_TEST(test_knot_range_stops_on_the_path);
    RUN_TEST(test_knot_acceleration_beyond_its_limit_stops_on_the_path);
    RUN_TEST(test_last_knot_at_speed_stops_on_the_path);
    RUN_TEST(test_tunnel_stops_on_the_path);
    RUN_TEST(test_tunnel_may_be_left_as_long_as_its_debounce_says);
    RUN_TEST(test_tunnel_that_only_warns_lets_the_path_run);
    RUN_TEST(test_tunnel_that_only_warns_is_captured_until_the_axes_get_power_again);
    RUN_TEST(test_fault_after_a_tunnel_that_only_warned_has_a_capture_of_its_own);
    RUN_TEST(test_tunnel_that_only_warns_does_not_trigger_what_waits_for_something_else);
    RUN_TEST(test_tunnel_with_a_quick_stop_does_as_605Ah_says);
    RUN_TEST(test_tunnel_may_cut_the_power);
    RUN_TEST(test_tunnel_is_off_by_default);
    RUN_TEST(test_oscillation_stops_on_the_path_and_is_told);
    RUN_TEST(test_oscillation_with_a_quick_stop_does_as_605Ah_says);
    RUN_TEST(test_oscillation_may_cut_the_power);
    RUN_TEST(test_oscillation_that_only_warns_lets_the_path_run);
    RUN_TEST(test_oscillation_that_lowers_the_gains_ends_and_the_gains_come_back_on_request);
    RUN_TEST(test_oscillation_is_seen_at_rest_too);
    RUN_TEST(test_oscillation_is_not_watched_where_the_limit_is_0);
    RUN_TEST(test_gain_at_its_limit_is_warned_of);
    RUN_TEST(test_gain_that_cannot_grow_is_no_warning);
#ifndef KONTUR_NUM_FIX
    RUN_TEST(test_law_that_gives_no_number_cuts_the_power);
    RUN_TEST(test_law_without_power_that_has_no_number_starts_anew);
#endif
    RUN_TEST(test_stream_of_damaged_frames_is_warned_of);
    return UNITY_END();
}
