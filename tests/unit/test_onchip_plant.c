/* SPDX-License-Identifier: Apache-2.0 */
#include "onchip/onchip_plant.h"

#include <math.h>

#include "num_test.h"
#include "unity.h"

#define DT 0.02     /* T0 */
#define MASS 3.5232 /* 88.08 kg */
#define VISCOUS 0.09344
#define COULOMB 45.5

static struct onchip_plant_cfg cfg;
static struct onchip_plant machine;

void setUp(void)
{
    cfg = (struct onchip_plant_cfg){.simulated = true, .dt = mk(DT), .seed = 1};
    for (int i = 0; i < AXES; i++) {
        cfg.axis[i] =
            (struct onchip_axis_cfg){.part = {{.mass = mk(MASS), .viscous = mk(VISCOUS), .coulomb = mk(COULOMB)}},
                                     .friction.axis = {friction_design(mk(0), mk(1), mk(1))},
                                     .counts = mk(10),
                                     .travel = {INT32_MIN, INT32_MAX},
                                     .switches = {INT32_MIN, INT32_MAX},
                                     .delay = 1};
    }
    onchip_plant_design(&cfg);
    onchip_plant_reset(&cfg, &machine);
}
void tearDown(void)
{
}

static void step(int32_t x_mN)
{
    const struct hal_drive_out out = {.force_mN = {x_mN, 0}, .enable = {true, true}};
    onchip_plant_step(&cfg, &machine, &out);
}

static double um(void)
{
    return (double)machine.axis[0].part[0].pos / 4294967296.0 / 10.0;
}

static void test_force_acts_a_period_after_it_was_written(void)
{
    step(100000);
    TEST_ASSERT_EQUAL_DOUBLE(0, val(machine.axis[0].part[0].vel));
    step(0);
    TEST_ASSERT_TRUE(val(machine.axis[0].part[0].vel) > 0);
}

static void test_axis_at_rest_sticks_below_friction_and_goes_beyond_it(void)
{
    for (int i = 0; i < 100; i++) {
        step(45400);
    }
    TEST_ASSERT_EQUAL_DOUBLE(0, val(machine.axis[0].part[0].vel));
    TEST_ASSERT_TRUE(machine.axis[0].part[0].pos == 0);
    step(-46000);
    step(0);
    TEST_ASSERT_TRUE(val(machine.axis[0].part[0].vel) < 0);
}

/* v = w/C (1 - exp(-C t/M)), x its integral */
static void test_motion_under_a_constant_force_is_the_exact_one(void)
{
    step(145500);
    for (int i = 0; i < 1000; i++) {
        step(145500);
    }
    const double t = 1000 * DT;
    const double rate = VISCOUS / MASS;
    const double speed = (145.5 - COULOMB) / VISCOUS;
    const double v = speed * (1 - exp(-rate * t));
    const double x = speed * t - v / rate;
    TEST_ASSERT_DOUBLE_WITHIN(NUM_FIXED ? 0.05 : 1e-3, v, val(machine.axis[0].part[0].vel));
    TEST_ASSERT_DOUBLE_WITHIN(NUM_FIXED ? 0.5 : 2e-2, x, um());
}

/* z = C dt / M = 1: all of the series counts, and so does from where the axis starts. */
static void test_strongly_damped_motion_is_the_exact_one_from_rest_on_both_ways(void)
{
    const double c = MASS / DT;
    cfg.axis[0].part[0].viscous = mk(c);
    onchip_plant_design(&cfg);
    for (int sign = -1; sign <= 1; sign += 2) {
        onchip_plant_reset(&cfg, &machine);
        step(sign * 400000);
        double x = 0, v = 0;
        for (int i = 0; i < 3; i++) {
            const double end = (400 - COULOMB) / c;
            step(sign * 400000);
            x += end * DT - (end - v) * (1 - exp(-1)) * DT;
            v = end - (end - v) * exp(-1);
            /* fixed point: half a step of the gain, 2^-20, times force over mass, over e/(e - 1) periods */
            TEST_ASSERT_DOUBLE_WITHIN(NUM_FIXED ? 1.5e-4 : 1e-6, sign * v, val(machine.axis[0].part[0].vel));
            TEST_ASSERT_DOUBLE_WITHIN(NUM_FIXED ? 5e-6 : 1e-7, sign * x, um());
        }
    }
}

static void test_moving_axis_stops_within_a_period_and_stays(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        onchip_plant_reset(&cfg, &machine);
        machine.axis[0].part[0].vel = mk(sign * 0.1);
        step(0);
        TEST_ASSERT_EQUAL_DOUBLE(0, val(machine.axis[0].part[0].vel));
        const double stopped = um();
        /* v^2 / 2 a with a = (L + C v) / M */
        TEST_ASSERT_DOUBLE_WITHIN(1e-5, sign * 0.1 * 0.1 / 2 * MASS / COULOMB, stopped);
        step(0);
        TEST_ASSERT_EQUAL_DOUBLE(stopped, um());
    }
}

static void test_force_beyond_friction_turns_an_axis_round_within_a_period(void)
{
    machine.axis[0].part[0].vel = mk(0.5);
    step(-300000);
    step(0);
    TEST_ASSERT_TRUE(val(machine.axis[0].part[0].vel) < 0);
    /* from rest at 0.5 / 98.06 T0 on: (300 - 45.5) / M */
    const double deceleration = (300.0 + COULOMB) / MASS;
    const double first = 0.5 - COULOMB / MASS * DT; /* the first period has no force but friction */
    const double left = DT - first / deceleration;
    TEST_ASSERT_DOUBLE_WITHIN(2e-3, -left * (300.0 - COULOMB) / MASS, val(machine.axis[0].part[0].vel));
}

static void test_axis_without_power_gets_no_force_and_no_noise(void)
{
    cfg.axis[0].noise = mk(500);
    const struct hal_drive_out off = {.force_mN = {500000, 0}};
    onchip_plant_step(&cfg, &machine, &off);
    onchip_plant_step(&cfg, &machine, &off);
    TEST_ASSERT_TRUE(machine.axis[0].part[0].pos == 0);
    TEST_ASSERT_EQUAL_UINT32(1, machine.random);
    cfg.axis[0].part[0].coulomb = mk(0); /* nothing that would hold it */
    onchip_plant_step(&cfg, &machine, &off);
    TEST_ASSERT_TRUE(machine.axis[0].part[0].pos == 0);
}

static void test_noise_has_no_mean_and_the_deviation_requested(void)
{
    double sum = 0, squares = 0;
    cfg.axis[0].part[0].coulomb = cfg.axis[0].part[0].viscous = mk(0);
    cfg.axis[0].noise = mk(20);
    onchip_plant_design(&cfg);
    double before = 0;
    for (int i = 0; i < 20000; i++) {
        step(0);
        const double v = val(machine.axis[0].part[0].vel);
        const double force = (v - before) / DT * MASS;
        before = v;
        sum += force;
        squares += force * force;
    }
    TEST_ASSERT_DOUBLE_WITHIN(1, 0, sum / 20000);
    TEST_ASSERT_DOUBLE_WITHIN(0.5, 20, sqrt(squares / 20000));
}

static void test_the_same_seed_gives_the_same_motion_and_another_one_does_not(void)
{
    int64_t pos[3];
    cfg.axis[0].noise = mk(2);
    for (int run = 0; run < 3; run++) {
        cfg.seed = run == 2 ? 2 : 1;
        onchip_plant_reset(&cfg, &machine);
        for (int i = 0; i < 100; i++) {
            step(100000);
        }
        pos[run] = machine.axis[0].part[0].pos;
    }
    TEST_ASSERT_TRUE(pos[0] == pos[1]);
    TEST_ASSERT_TRUE(pos[0] != pos[2]);
}

static void test_encoder_tells_the_nearest_count_from_the_start_on(void)
{
    struct hal_drive_in in;
    cfg.axis[0].start = -1234;
    onchip_plant_reset(&cfg, &machine);
    onchip_plant_read(&cfg, &machine, &in);
    TEST_ASSERT_EQUAL_INT32(-1234, in.count[0]);
    machine.axis[0].part[0].pos += ((int64_t)1 << 31) - 1;
    onchip_plant_read(&cfg, &machine, &in);
    TEST_ASSERT_EQUAL_INT32(-1234, in.count[0]);
    machine.axis[0].part[0].pos += 1;
    onchip_plant_read(&cfg, &machine, &in);
    TEST_ASSERT_EQUAL_INT32(-1233, in.count[0]);
    TEST_ASSERT_EQUAL_UINT8(0, in.inputs[0]);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_force_acts_a_period_after_it_was_written);
    RUN_TEST(test_axis_at_rest_sticks_below_friction_and_goes_beyond_it);
    RUN_TEST(test_motion_under_a_constant_force_is_the_exact_one);
    RUN_TEST(test_strongly_damped_motion_is_the_exact_one_from_rest_on_both_ways);
    RUN_TEST(test_moving_axis_stops_within_a_period_and_stays);
    RUN_TEST(test_force_beyond_friction_turns_an_axis_round_within_a_period);
    RUN_TEST(test_axis_without_power_gets_no_force_and_no_noise);
    RUN_TEST(test_noise_has_no_mean_and_the_deviation_requested);
    RUN_TEST(test_the_same_seed_gives_the_same_motion_and_another_one_does_not);
    RUN_TEST(test_encoder_tells_the_nearest_count_from_the_start_on);
    return UNITY_END();
}
