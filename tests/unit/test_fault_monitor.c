/* SPDX-License-Identifier: Apache-2.0 */
/* What has to last before it matters: the conditions of supervision/fault_monitor.c, each on both sides of its limit. */
#include "supervision/fault_monitor.h"

#include "table1.h"
#include "unity.h"

static struct fault_monitor watch;
static struct od_data od;
static struct servo_snapshot snapshot;
static bool powered[2];

void setUp(void)
{
    od = table1();
    watch = (struct fault_monitor){0};
    snapshot = (struct servo_snapshot){0};
    powered[0] = powered[1] = true;
}

void tearDown(void)
{
}

static bool holds_after(enum fault f, unsigned ms)
{
    const struct fault_monitor_in in = {.od = &od, .snapshot = &snapshot, .powered = powered};
    uint32_t now = 0;
    for (unsigned i = 0; i < ms; i++) {
        snapshot.ms++;
        now = fault_monitor_step(&watch, &in);
    }
    return (now & FAULT_BIT(f)) != 0;
}

static void test_what_lasts_for_more_than_a_minute_is_still_there(void)
{
    od.tunnel.radius = 1000;
    od.tunnel.debounce = 10000;
    snapshot.contour_error_nm = 1001;
    TEST_ASSERT_FALSE(holds_after(FAULT_TUNNEL, 10000));
    for (unsigned i = 0; i < 70000; i++) {
        TEST_ASSERT_TRUE(holds_after(FAULT_TUNNEL, 1));
    }
    snapshot.contour_error_nm = -1000;
    TEST_ASSERT_FALSE(holds_after(FAULT_TUNNEL, 1));
}

static void test_encoder_is_frozen_only_where_the_push_is_more_than_friction_can_hold(void)
{
    od.fault_delay.frozen = 20;
    for (int i = 0; i < 2; i++) {
        setUp();
        od.axis[i].plant.force_limit = 600000;
        od.axis[i].plant.coulomb = 100000;
        snapshot.force_dN[i] = -3000; /* half of the limit, and three times friction */
        TEST_ASSERT_FALSE(holds_after(FAULT_ENCODER_FROZEN, 20));
        TEST_ASSERT_TRUE(holds_after(FAULT_ENCODER_FROZEN, 1));
        od.axis[i].plant.coulomb = 100001;
        TEST_ASSERT_FALSE(holds_after(FAULT_ENCODER_FROZEN, 100));
        od.axis[i].plant.coulomb = 100000;
        od.axis[i].plant.force_limit = 600002;
        TEST_ASSERT_FALSE(holds_after(FAULT_ENCODER_FROZEN, 100));
    }
}

static void test_force_at_a_lowered_limit_is_overload_and_at_the_peak_saturation(void)
{
    od.fault_delay.saturated = 20;
    for (int i = 0; i < 2; i++) {
        setUp();
        od.fault_delay.saturated = 20;
        od.axis[i].plant.force_limit = 600000;
        od.axis[i].force_continuous.force = 300000;
        snapshot.force_limit_dN[i] = 5998;
        snapshot.force_dN[i] = -5997;
        TEST_ASSERT_FALSE(holds_after(FAULT_OVERLOAD, 20));
        TEST_ASSERT_TRUE(holds_after(FAULT_OVERLOAD, 1));
        TEST_ASSERT_FALSE(holds_after(FAULT_SATURATION, 1));
        snapshot.force_dN[i] = -5996;
        TEST_ASSERT_FALSE(holds_after(FAULT_OVERLOAD, 100));
        snapshot.force_limit_dN[i] = 5999;
        snapshot.force_dN[i] = 5999;
        TEST_ASSERT_TRUE(holds_after(FAULT_SATURATION, 21));
        TEST_ASSERT_FALSE(holds_after(FAULT_OVERLOAD, 1));
        snapshot.force_limit_dN[i] = 0; /* not known yet, or without a continuous limit */
        od.axis[i].force_continuous.force = 0;
        TEST_ASSERT_TRUE(holds_after(FAULT_SATURATION, 1));
    }
}

static void test_heat_is_warned_of_from_90_until_85_percent(void)
{
    for (int i = 0; i < 2; i++) {
        setUp();
        powered[0] = powered[1] = false; /* a motor is as hot without power */
        snapshot.force_heat_permille[i] = 899;
        TEST_ASSERT_FALSE(holds_after(FAULT_HEAT, 1));
        snapshot.force_heat_permille[i] = 900;
        TEST_ASSERT_TRUE(holds_after(FAULT_HEAT, 1));
        snapshot.force_heat_permille[i] = 850;
        TEST_ASSERT_TRUE(holds_after(FAULT_HEAT, 1));
        snapshot.force_heat_permille[i] = 849;
        TEST_ASSERT_FALSE(holds_after(FAULT_HEAT, 1));
    }
}

static void test_gain_at_its_limit_is_reported_of_each_gain_of_each_axis(void)
{
    for (int i = 0; i < 4; i++) {
        setUp();
        od.fault_delay.gain = 50;
        (i < 2 ? snapshot.adaptive_gain_per_10s : snapshot.switching_gain_mmps2)[i % 2] =
            (int32_t)(i < 2 ? od.smc.k_max / 100u : od.compensator.mu_max / 1000u);
        TEST_ASSERT_FALSE(holds_after(FAULT_GAIN, 50));
        TEST_ASSERT_TRUE(holds_after(FAULT_GAIN, 1));
        (i < 2 ? snapshot.adaptive_gain_per_10s : snapshot.switching_gain_mmps2)[i % 2]--;
        TEST_ASSERT_FALSE(holds_after(FAULT_GAIN, 100));
    }
}

static void test_gain_at_its_limit_is_reported_while_an_axis_has_power(void)
{
    od.fault_delay.gain = 50;
    snapshot.switching_gain_mmps2[0] = (int32_t)(od.compensator.mu_max / 1000u);
    powered[0] = false;
    TEST_ASSERT_TRUE(holds_after(FAULT_GAIN, 51));
    powered[1] = false;
    TEST_ASSERT_FALSE(holds_after(FAULT_GAIN, 100));
}

static void test_oscillation_that_only_warns_lasts_for_a_second_after_each_count_of_either_axis(void)
{
    const uint8_t warns[] = {REACT_WARN, OSCILLATION_LOWER_GAINS};
    for (int i = 0; i < 4; i++) {
        setUp();
        od.oscillation.reaction = warns[i / 2];
        TEST_ASSERT_FALSE(holds_after(FAULT_OSCILLATION, 10));
        snapshot.oscillations[i % 2] = 3;
        TEST_ASSERT_TRUE(holds_after(FAULT_OSCILLATION, 600));
        snapshot.oscillations[i % 2]++;
        TEST_ASSERT_TRUE(holds_after(FAULT_OSCILLATION, 1000));
        TEST_ASSERT_FALSE(holds_after(FAULT_OSCILLATION, 1));
        snapshot.oscillations[i % 2] = 0; /* the watch has been reset */
        TEST_ASSERT_FALSE(holds_after(FAULT_OSCILLATION, 1));
    }
}

static void test_oscillation_that_stops_the_axes_can_be_reset_at_once(void)
{
    const uint8_t stops[] = {REACT_PATH_STOP, REACT_QUICK_STOP, REACT_DISABLE};
    for (int i = 0; i < 3; i++) {
        setUp();
        od.oscillation.reaction = stops[i];
        snapshot.oscillations[0] = 1;
        TEST_ASSERT_TRUE(holds_after(FAULT_OSCILLATION, 1));
        TEST_ASSERT_FALSE(holds_after(FAULT_OSCILLATION, 1));
    }
}

/* The snapshot of `ms` milliseconds after the last one, of which those between were not seen */
static bool holds_late(enum fault f, unsigned ms)
{
    snapshot.ms += ms - 1;
    return holds_after(f, 1);
}

static void test_time_counts_however_seldom_the_background_looks(void)
{
    od.tunnel.radius = 1000;
    od.tunnel.debounce = 50;
    od.fault_delay.frozen = 50;
    snapshot.contour_error_nm = 1001;
    snapshot.force_dN[0] = 6000;
    TEST_ASSERT_FALSE(holds_late(FAULT_TUNNEL, 500)); /* since when is not known */
    for (unsigned i = 0; i < 7; i++) {
        TEST_ASSERT_FALSE(holds_late(FAULT_TUNNEL, 7));
        TEST_ASSERT_FALSE((watch.now & FAULT_BIT(FAULT_ENCODER_FROZEN)) != 0);
    }
    TEST_ASSERT_TRUE(holds_late(FAULT_TUNNEL, 7));
    TEST_ASSERT_TRUE((watch.now & FAULT_BIT(FAULT_ENCODER_FROZEN)) != 0);
    snapshot.encoder_count[0] += 2;
    TEST_ASSERT_FALSE(holds_late(FAULT_ENCODER_FROZEN, 500));
    TEST_ASSERT_TRUE(holds_late(FAULT_TUNNEL, 70000));
}

static void test_event_is_warned_of_for_a_second_however_seldom_the_background_looks(void)
{
    fault_monitor_event(&watch, FAULT_STALE_COMMAND);
    TEST_ASSERT_TRUE(holds_late(FAULT_STALE_COMMAND, 300));
    TEST_ASSERT_TRUE(holds_late(FAULT_STALE_COMMAND, 700));
    TEST_ASSERT_FALSE(holds_late(FAULT_STALE_COMMAND, 300));
    TEST_ASSERT_FALSE(holds_late(FAULT_STALE_COMMAND, 1));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_oscillation_that_only_warns_lasts_for_a_second_after_each_count_of_either_axis);
    RUN_TEST(test_oscillation_that_stops_the_axes_can_be_reset_at_once);
    RUN_TEST(test_time_counts_however_seldom_the_background_looks);
    RUN_TEST(test_event_is_warned_of_for_a_second_however_seldom_the_background_looks);
    RUN_TEST(test_what_lasts_for_more_than_a_minute_is_still_there);
    RUN_TEST(test_encoder_is_frozen_only_where_the_push_is_more_than_friction_can_hold);
    RUN_TEST(test_force_at_a_lowered_limit_is_overload_and_at_the_peak_saturation);
    RUN_TEST(test_heat_is_warned_of_from_90_until_85_percent);
    RUN_TEST(test_gain_at_its_limit_is_reported_of_each_gain_of_each_axis);
    RUN_TEST(test_gain_at_its_limit_is_reported_while_an_axis_has_power);
    return UNITY_END();
}
