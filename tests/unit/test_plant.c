/* SPDX-License-Identifier: Apache-2.0 */
/* test_plant.c: the simulated machine: stiction, delay, end stops, inputs, noise and schedule. */
#include "sim/plant.h"

#include <math.h>
#include <string.h>

#include "unity.h"

#define PERIOD 1e-4

static struct ks_machine machine;
static struct plant p;

/* The machine of Table 1 without noise and schedule. */
void setUp(void)
{
    machine = (struct ks_machine){.mass_kg = {88.08, 97.90},
                                  .viscous_Nspm = {467.2, 631.0},
                                  .coulomb_N = {45.5, 54.8},
                                  .breakaway = {1, 1},
                                  .stribeck_mps = {1e-3, 1e-3},
                                  .force_limit_N = {600, 600},
                                  .encoder_m = {76.29e-9, 76.29e-9},
                                  .travel_min_m = {-0.15, -0.15},
                                  .travel_max_m = {0.15, 0.15},
                                  .delay_periods = 1,
                                  .substeps = 10};
    plant_init(&p, &machine, 1, PERIOD);
}
void tearDown(void)
{
}

static void restart(void)
{
    TEST_ASSERT_NULL(plant_check(&machine));
    plant_init(&p, &machine, 1, PERIOD);
}

static void run(double x_N, double y_N, int periods)
{
    const double force[2] = {x_N, y_N};
    for (int i = 0; i < periods; i++) {
        plant_step(&p, force);
    }
}

static void test_an_axis_below_breakaway_stays_exactly_at_rest(void)
{
    machine.start_m[0] = 0.0123;
    machine.breakaway[0] = 1.5;
    restart();
    run(1.5 * 45.5, -54.8, 1000);
    TEST_ASSERT_TRUE(p.pos_m[0] == 0.0123 && p.vel_mps[0] == 0);
    TEST_ASSERT_TRUE(p.pos_m[1] == 0 && p.vel_mps[1] == 0);
    TEST_ASSERT_EQUAL_DOUBLE(1.5 * 45.5, p.friction_N[0]);
    TEST_ASSERT_EQUAL_DOUBLE(-54.8, p.friction_N[1]);
}

static void test_an_axis_above_breakaway_moves_the_way_it_is_pushed(void)
{
    machine.breakaway[0] = 1.5;
    restart();
    run(1.5 * 45.5 + 0.1, -54.9, 100);
    TEST_ASSERT_TRUE(p.vel_mps[0] > 0);
    TEST_ASSERT_TRUE(p.vel_mps[1] < 0);
}

static void test_friction_above_coulomb_decays_with_the_stribeck_velocity(void)
{
    machine.breakaway[0] = 1.5;
    restart();
    p.vel_mps[0] = 2e-3;
    run(0, 0, 1);
    /* Friction is that before the last sub-step of 10 us, which is off by 5.5 um/s of 1 mm/s. */
    TEST_ASSERT_DOUBLE_WITHIN(22.75 * exp(-1.9) * 6e-3, 45.5 * (1 + 0.5 * exp(-p.vel_mps[0] / 1e-3)), p.friction_N[0]);
}

static void test_friction_stops_an_axis_and_does_not_turn_it_round(void)
{
    p.vel_mps[0] = 1e-3;
    p.vel_mps[1] = -1e-3;
    for (int i = 0; i < 200; i++) {
        run(-10, 10, 1);
        TEST_ASSERT_TRUE(p.vel_mps[0] >= 0 && p.vel_mps[1] <= 0);
    }
    TEST_ASSERT_TRUE(p.vel_mps[0] == 0 && p.vel_mps[1] == 0);
    TEST_ASSERT_TRUE(p.pos_m[0] > 0 && p.pos_m[1] < 0);
}

static void test_a_force_beyond_friction_turns_a_moving_axis_round(void)
{
    p.vel_mps[0] = 1e-3;
    run(-100, 0, 200);
    TEST_ASSERT_TRUE(p.vel_mps[0] < 0);
}

/* m v' = -c v - l gives v = (v0 + l/c) exp(-c t/m) - l/c, and the energy lost is the work of friction. */
static void test_a_coasting_axis_follows_the_closed_form(void)
{
    const double v0 = 0.2, c = 467.2, m = 88.08, l = 45.5, t = 0.1;
    p.vel_mps[0] = v0;
    run(0, 0, 1000);
    const double v = (v0 + l / c) * exp(-c * t / m) - l / c;
    const double x = (v0 + l / c) * m / c * (1 - exp(-c * t / m)) - l / c * t;
    /* Euler's rule with h = 10 us errs by h/2 c/m = 2.7e-5 of the change of 0.11 m/s. */
    TEST_ASSERT_DOUBLE_WITHIN(2.7e-5 * 0.11, v, p.vel_mps[0]);
    TEST_ASSERT_DOUBLE_WITHIN(2.7e-5 * 0.11 * t, x, p.pos_m[0]);
}

static void test_a_coasting_axis_loses_as_energy_what_friction_took(void)
{
    double work = 0;
    p.vel_mps[1] = 0.2;
    for (int i = 0; i < 1000; i++) {
        const double before = p.pos_m[1], v0 = p.vel_mps[1];
        run(0, 0, 1);
        work += (54.8 + 631.0 * 0.5 * (v0 + p.vel_mps[1])) * (p.pos_m[1] - before);
    }
    const double lost = 0.5 * 97.9 * (0.04 - p.vel_mps[1] * p.vel_mps[1]);
    TEST_ASSERT_TRUE(lost > 1);
    /* In a sub-step h, c v is that at its start, which adds the integral of c h/2 v' dx = c h/4 (v0^2 - v^2). */
    TEST_ASSERT_DOUBLE_WITHIN(631.0 * 1e-5 / 4 * 0.04, work, lost);
}

/* From rest with the force F: v = (F - l)/c (1 - exp(-c t/m)). */
static void test_a_constant_force_gives_the_closed_form(void)
{
    machine.delay_periods = 1;
    run(200, 0, 1001); /* the force acts from the second period on */
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, (200 - 45.5) / 467.2 * (1 - exp(-467.2 * 0.1 / 88.08)), p.vel_mps[0]);
}

static void test_force_acts_after_exactly_the_delay(void)
{
    for (int delay = 1; delay <= PLANT_DELAY_MAX; delay++) {
        machine.delay_periods = delay;
        restart();
        run(100, 0, delay);
        TEST_ASSERT_TRUE(p.vel_mps[0] == 0);
        run(0, 0, 1);
        const double v = p.vel_mps[0];
        TEST_ASSERT_DOUBLE_WITHIN(2e-8, (100 - 45.5) / 88.08 * PERIOD, v); /* viscous friction takes c v/2 */
        run(0, 0, delay);
        TEST_ASSERT_TRUE(delay == 1 || p.vel_mps[0] > v); /* the force acts for `delay` periods */
    }
}

static void test_a_push_of_one_period_acts_for_one_period(void)
{
    run(100, 0, 1);
    run(0, 0, 1);
    const double v = p.vel_mps[0];
    run(0, 0, 1);
    TEST_ASSERT_DOUBLE_WITHIN(2e-8, v - (45.5 + 467.2 * v) / 88.08 * PERIOD, p.vel_mps[0]);
}

static void test_force_is_clipped_at_the_amplifiers_limit(void)
{
    machine.force_limit_N[0] = 150;
    restart();
    run(1e9, 0, 2);
    TEST_ASSERT_DOUBLE_WITHIN(1e-7, (150 - 45.5) / 88.08 * PERIOD, p.vel_mps[0]);
}

static void test_a_lagging_amplifier_reaches_its_force_with_its_time_constant(void)
{
    machine.current_lag_s[0] = 1e-3;
    machine.coulomb_N[0] = 200;
    restart();
    run(100, 0, 11); /* 1 ms after the force starts to act */
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, 100 * (1 - exp(-1.0)), p.lagged_N[0]);
}

static void test_encoder_gives_the_nearest_count(void)
{
    int32_t count[2];
    machine.encoder_m[0] = machine.encoder_m[1] = 1e-6;
    machine.start_m[0] = 12.4e-6;
    machine.start_m[1] = -12.6e-6;
    restart();
    plant_encoders(&p, count);
    TEST_ASSERT_EQUAL_INT32(12, count[0]);
    TEST_ASSERT_EQUAL_INT32(-13, count[1]);
}

static void test_limit_switch_is_active_near_its_end_stop(void)
{
    static const struct {
        double at_m;
        uint8_t inputs;
    } rows[] = {{-0.1, 1}, {-0.0951, 1}, {-0.0949, 0}, {0, 0}, {0.0949, 0}, {0.0951, 2}, {0.1, 2}};
    for (int i = 0; i < 2; i++) {
        machine.travel_min_m[i] = -0.1;
        machine.travel_max_m[i] = 0.1;
    }
    for (unsigned k = 0; k < sizeof rows / sizeof rows[0]; k++) {
        uint8_t inputs[2];
        machine.switch_m[0] = 0.005; /* y has none */
        machine.start_m[0] = machine.start_m[1] = rows[k].at_m;
        restart();
        plant_switches(&p, inputs);
        TEST_ASSERT_EQUAL_UINT8(rows[k].inputs, inputs[0]);
        TEST_ASSERT_EQUAL_UINT8(0, inputs[1]);
    }
}

static void test_index_pulse_comes_where_the_axis_passes_it_in_either_direction(void)
{
    machine.encoder_m[0] = 1e-6;
    machine.index_m[0] = 0.001;
    machine.start_m[0] = 0.00199;
    restart();
    const double push[2] = {400, 400};
    while (p.pos_m[0] < 0.0035) {
        plant_step(&p, push);
        TEST_ASSERT_EQUAL_UINT8(p.pos_m[0] < 0.002 ? 0 : p.pos_m[0] < 0.003 ? 1 : 2, p.index_pulses[0]);
    }
    TEST_ASSERT_EQUAL_INT32(3000, p.index_count[0]);
    TEST_ASSERT_EQUAL_UINT8(0, p.index_pulses[1]);
    const double pull[2] = {-400, -400};
    while (p.vel_mps[0] > 0 || p.pos_m[0] > 0.0025) {
        plant_step(&p, pull);
    }
    TEST_ASSERT_EQUAL_INT32(3000, p.index_count[0]);
}

static void test_end_stops_hold_the_axes(void)
{
    p.vel_mps[0] = 5;
    p.vel_mps[1] = -5;
    run(300, -300, 1000);
    TEST_ASSERT_TRUE(p.pos_m[0] == 0.15 && p.pos_m[1] == -0.15);
    TEST_ASSERT_TRUE(p.vel_mps[0] == 0 && p.vel_mps[1] == 0);
    run(-300, 300, 100);
    TEST_ASSERT_TRUE(p.pos_m[0] < 0.15 && p.pos_m[1] > -0.15);
}

static void schedule_32(void)
{
    const double time[] = {0, 1.6, 3, 4.4}, scale[] = {1, 0, 0.5, 1.5};
    memcpy(machine.schedule_time_s, time, sizeof time);
    memcpy(machine.schedule_scale, scale, sizeof scale);
    machine.schedule_count = 4;
    machine.schedule_repeat_s = 5.6;
    machine.viscous_Nspm[0] = 0;
    restart();
}

/* Friction of a moving axis in the period `at_s` after the start, divided by 45.5 N. */
static double scale_at(double at_s)
{
    p.period = p.schedule_start + (uint64_t)llround(at_s / PERIOD);
    p.vel_mps[0] = 0.1;
    p.pos_m[0] = 0;
    run(0, 0, 1);
    return p.friction_N[0] / 45.5;
}

static void test_friction_follows_the_schedule_of_32_to_the_period(void)
{
    schedule_32();
    for (int turn = 0; turn < 20; turn++) {
        const double t0 = 5.6 * turn;
        TEST_ASSERT_EQUAL_DOUBLE(1, scale_at(t0));
        TEST_ASSERT_EQUAL_DOUBLE(1, scale_at(t0 + 1.6 - PERIOD));
        TEST_ASSERT_EQUAL_DOUBLE(0, scale_at(t0 + 1.6));
        TEST_ASSERT_EQUAL_DOUBLE(0, scale_at(t0 + 3 - PERIOD));
        TEST_ASSERT_EQUAL_DOUBLE(0.5, scale_at(t0 + 3));
        TEST_ASSERT_EQUAL_DOUBLE(0.5, scale_at(t0 + 4.4 - PERIOD));
        TEST_ASSERT_EQUAL_DOUBLE(1.5, scale_at(t0 + 4.4));
        TEST_ASSERT_EQUAL_DOUBLE(1.5, scale_at(t0 + 5.6 - PERIOD));
    }
}

static void test_the_schedule_counts_from_where_it_was_started(void)
{
    schedule_32();
    p.schedule_start = 12345;
    TEST_ASSERT_EQUAL_DOUBLE(1, scale_at(1.6 - PERIOD));
    TEST_ASSERT_EQUAL_DOUBLE(0, scale_at(1.6));
}

static void test_a_schedule_that_does_not_repeat_keeps_its_last_row(void)
{
    schedule_32();
    machine.schedule_repeat_s = 0;
    restart();
    TEST_ASSERT_EQUAL_DOUBLE(1.5, scale_at(1000));
}

static void test_before_its_first_row_the_schedule_scales_nothing(void)
{
    schedule_32();
    machine.schedule_time_s[0] = 0.5;
    machine.schedule_scale[0] = 7;
    restart();
    TEST_ASSERT_EQUAL_DOUBLE(1, scale_at(0.1));
    TEST_ASSERT_EQUAL_DOUBLE(7, scale_at(0.6));
}

/* The noise is measured by the velocity steps of an axis of 1 kg without friction: v+ - v = noise/m h substeps. */
static void test_noise_has_the_specified_mean_and_deviation_and_is_independent_between_axes(void)
{
    machine.mass_kg[0] = machine.mass_kg[1] = 1;
    for (int i = 0; i < 2; i++) {
        machine.viscous_Nspm[i] = machine.coulomb_N[i] = 0;
        machine.force_noise_N[i] = 2;
        machine.travel_min_m[i] = -2;
        machine.travel_max_m[i] = 2;
    }
    restart();
    enum { N = 20000 };
    double sum[2] = {0, 0}, square[2] = {0, 0}, product = 0, beyond = 0;
    for (int k = 0; k < N; k++) {
        double noise[2];
        p.vel_mps[0] = p.vel_mps[1] = 0;
        p.pos_m[0] = p.pos_m[1] = 0;
        run(0, 0, 1);
        for (int i = 0; i < 2; i++) {
            noise[i] = p.vel_mps[i] / PERIOD;
            sum[i] += noise[i];
            square[i] += noise[i] * noise[i];
            beyond += fabs(noise[i]) > 4;
        }
        product += noise[0] * noise[1];
    }
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_DOUBLE_WITHIN(4 * 2 / sqrt(N), 0, sum[i] / N); /* 4 standard errors */
        TEST_ASSERT_DOUBLE_WITHIN(4 * 4 * sqrt(2.0 / N), 4, square[i] / N);
    }
    TEST_ASSERT_DOUBLE_WITHIN(4 * 4 / sqrt(N), 0, product / N);
    TEST_ASSERT_DOUBLE_WITHIN(4 * sqrt(0.0455 / (2 * N)), 0.0455, beyond / (2 * N)); /* beyond 2 sigma: 4.55 % */
}

static void test_noise_depends_on_the_seed_alone(void)
{
    struct plant a, b, other;
    const double force[2] = {100, -100};
    machine.force_noise_N[0] = machine.force_noise_N[1] = 2;
    plant_init(&a, &machine, 7, PERIOD);
    plant_init(&b, &machine, 7, PERIOD);
    plant_init(&other, &machine, 8, PERIOD);
    for (int k = 0; k < 100; k++) {
        plant_step(&a, force);
        plant_step(&b, force);
        plant_step(&other, force);
    }
    TEST_ASSERT_TRUE(a.pos_m[0] == b.pos_m[0] && a.vel_mps[1] == b.vel_mps[1]);
    TEST_ASSERT_TRUE(a.pos_m[0] != other.pos_m[0] && a.pos_m[1] != other.pos_m[1]);
}

/* The first output of splitmix64 from 0, as published with it. */
static void test_the_seed_is_spread_by_splitmix64(void)
{
    plant_init(&p, &machine, 0, PERIOD);
    TEST_ASSERT_TRUE(p.rng[0] == 0xE220A8397B1DCDAFu);
}

static void test_check_names_the_first_field_that_is_not_usable(void)
{
    struct ks_machine good = machine;
    TEST_ASSERT_NULL(plant_check(&good));
#define BAD(change, name)                                                                                              \
    do {                                                                                                               \
        machine = good;                                                                                                \
        change;                                                                                                        \
        TEST_ASSERT_EQUAL_STRING(name, plant_check(&machine));                                                         \
    } while (0)
    BAD(machine.mass_kg[1] = 0, "mass_kg");
    BAD(machine.mass_kg[0] = NAN, "mass_kg");
    BAD(machine.viscous_Nspm[0] = -1, "viscous_Nspm");
    BAD(machine.coulomb_N[0] = INFINITY, "coulomb_N");
    BAD(machine.breakaway[0] = 0.9, "breakaway");
    BAD(machine.stribeck_mps[0] = 0, "stribeck_mps");
    BAD(machine.force_limit_N[0] = 0, "force_limit_N");
    BAD(machine.force_noise_N[0] = -1, "force_noise_N");
    BAD(machine.current_lag_s[0] = -1, "current_lag_s");
    BAD(machine.switch_m[1] = -1, "switch_m");
    BAD(machine.switch_m[0] = (machine.travel_max_m[0] - machine.travel_min_m[0]) / 2, "switch_m");
    BAD(machine.index_m[0] = -1, "index_m");
    BAD(machine.encoder_m[0] = 0, "encoder_m");
    BAD(machine.encoder_m[0] = 1e-12, "encoder_m");
    BAD(machine.travel_min_m[0] = -3, "travel_min_m");
    BAD(machine.travel_max_m[0] = -0.2, "travel_max_m");
    BAD(machine.travel_max_m[0] = NAN, "travel_max_m");
    BAD(machine.start_m[0] = 0.2, "start_m");
    BAD(machine.delay_periods = 0, "delay_periods");
    BAD(machine.delay_periods = PLANT_DELAY_MAX + 1, "delay_periods");
    BAD(machine.substeps = 9, "substeps");
    BAD(machine.schedule_count = 17, "schedule_count");
    BAD((machine.schedule_count = 2, machine.schedule_time_s[1] = 0), "schedule_time_s");
    BAD((machine.schedule_count = 1, machine.schedule_scale[0] = -1), "schedule_scale");
    BAD(machine.schedule_repeat_s = -1, "schedule_repeat_s");
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_an_axis_below_breakaway_stays_exactly_at_rest);
    RUN_TEST(test_an_axis_above_breakaway_moves_the_way_it_is_pushed);
    RUN_TEST(test_friction_above_coulomb_decays_with_the_stribeck_velocity);
    RUN_TEST(test_friction_stops_an_axis_and_does_not_turn_it_round);
    RUN_TEST(test_a_force_beyond_friction_turns_a_moving_axis_round);
    RUN_TEST(test_a_coasting_axis_follows_the_closed_form);
    RUN_TEST(test_a_coasting_axis_loses_as_energy_what_friction_took);
    RUN_TEST(test_a_constant_force_gives_the_closed_form);
    RUN_TEST(test_force_acts_after_exactly_the_delay);
    RUN_TEST(test_a_push_of_one_period_acts_for_one_period);
    RUN_TEST(test_force_is_clipped_at_the_amplifiers_limit);
    RUN_TEST(test_a_lagging_amplifier_reaches_its_force_with_its_time_constant);
    RUN_TEST(test_encoder_gives_the_nearest_count);
    RUN_TEST(test_limit_switch_is_active_near_its_end_stop);
    RUN_TEST(test_index_pulse_comes_where_the_axis_passes_it_in_either_direction);
    RUN_TEST(test_end_stops_hold_the_axes);
    RUN_TEST(test_friction_follows_the_schedule_of_32_to_the_period);
    RUN_TEST(test_the_schedule_counts_from_where_it_was_started);
    RUN_TEST(test_a_schedule_that_does_not_repeat_keeps_its_last_row);
    RUN_TEST(test_before_its_first_row_the_schedule_scales_nothing);
    RUN_TEST(test_noise_has_the_specified_mean_and_deviation_and_is_independent_between_axes);
    RUN_TEST(test_noise_depends_on_the_seed_alone);
    RUN_TEST(test_the_seed_is_spread_by_splitmix64);
    RUN_TEST(test_check_names_the_first_field_that_is_not_usable);
    return UNITY_END();
}
