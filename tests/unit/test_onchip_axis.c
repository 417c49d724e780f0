/* SPDX-License-Identifier: Apache-2.0 */
/* What an axis of the machine on the chip has besides (210Eh), against closed forms. */
#include <math.h>
#include <stdlib.h>

#include "num_test.h"
#include "onchip/onchip_plant.h"
#include "unity.h"

#define DT 0.02 /* T0 */
#define COUNTS 10

static const double PI = 3.14159265358979323846;

static struct onchip_plant_cfg cfg;
static struct onchip_plant machine;
static struct onchip_axis_cfg *const c = &cfg.axis[0];
static struct onchip_mass *const table = &machine.axis[0].part[ONCHIP_TABLE];
static struct onchip_mass *const motor = &machine.axis[0].part[ONCHIP_MOTOR];

/* A free mass of 100 kg, 1 N for 4 um/T0^2 */
void setUp(void)
{
    cfg = (struct onchip_plant_cfg){.simulated = true, .dt = mk(DT), .seed = 1};
    for (int i = 0; i < AXES; i++) {
        cfg.axis[i] = (struct onchip_axis_cfg){.part = {{.mass = mk(4)}, {.mass = mk(1)}},
                                               .counts = mk(COUNTS),
                                               .travel = {INT32_MIN, INT32_MAX},
                                               .switches = {INT32_MIN, INT32_MAX},
                                               .delay = 1};
        for (int k = 0; k < ONCHIP_MASSES; k++) {
            cfg.axis[i].friction.axis[k] = friction_design(mk(0), mk(1), mk(1));
        }
    }
}

void tearDown(void)
{
}

static void start(void)
{
    onchip_plant_design(&cfg);
    onchip_plant_reset(&cfg, &machine);
}

static void step(int32_t x_mN)
{
    const struct hal_drive_out out = {.force_mN = {x_mN, 0}, .enable = {true, true}};
    onchip_plant_step(&cfg, &machine, &out);
}

static double um(const struct onchip_mass *m)
{
    return (double)m->pos / 4294967296.0 / COUNTS;
}

static void put(struct onchip_mass *m, double at_um)
{
    m->pos = (int64_t)(at_um * COUNTS * 4294967296.0);
}

static struct hal_drive_in seen(void)
{
    struct hal_drive_in in;
    onchip_plant_read(&cfg, &machine, &in);
    return in;
}

/* A motor of 25 kg, a table of 75 kg: a mode of `hz` */
static void join(double hz, double damping)
{
    const double omega = 2 * PI * hz * 5e-3;
    c->part[ONCHIP_TABLE].mass = mk(3);
    c->part[ONCHIP_MOTOR].mass = mk(1);
    c->stiffness = mk(0.75 * omega * omega);
    c->damping = mk(2 * damping * 0.75 * omega);
    c->encoder_at_motor = true;
}

/* ---- the spring ---- */

static void test_free_masses_swing_with_the_frequency_of_the_mode_and_its_damping(void)
{
    join(100, 0.02);
    start();
    put(motor, 300);
    put(table, -100);
    double before = 400, first = 0, last = 0, peak = 0;
    int crossings = 0;
    for (int k = 1; k <= 1000; k++) { /* ten periods of 10 ms */
        step(0);
        const double apart = um(motor) - um(table);
        if (before < 0 && apart >= 0) {
            last = k - 1 + before / (before - apart);
            first = crossings == 0 ? last : first;
            crossings++;
        }
        peak = k > 900 ? fmax(peak, apart) : 0;
        before = apart;
    }
    TEST_ASSERT_EQUAL_INT(10, crossings);
    const double hz = 9.0 / ((last - first) * 1e-4);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 100 * sqrt(1 - 0.02 * 0.02), hz);
    TEST_ASSERT_DOUBLE_WITHIN(2, 400 * exp(-0.02 * 2 * PI * 9), peak);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 0, 0.75 * um(table) + 0.25 * um(motor)); /* the centre of mass stays */
}

static void test_spring_adds_no_damping_of_its_own(void)
{
    join(100, 0);
    start();
    put(motor, 100);
    double peak = 0;
    for (int k = 1; k <= 2000; k++) {
        step(0);
        peak = k > 1900 ? fmax(peak, um(motor) - um(table)) : 0;
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.5, 100, peak);
}

static void test_table_that_is_held_by_friction_deflects_the_spring(void)
{
    join(100, 0.3);
    c->part[ONCHIP_TABLE].coulomb = mk(100);
    c->part[ONCHIP_MOTOR].viscous = mk(1); /* so that it comes to rest */
    start();
    for (int k = 0; k < 2000; k++) {
        step(50000);
    }
    TEST_ASSERT_TRUE(table->pos == 0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 50 / val(c->stiffness), um(motor));
}

static void test_gap_has_no_force_and_its_ends_push_and_do_not_stick(void)
{
    join(100, 0.5);
    c->gap = mk(4);
    start();
    for (int sign = -1; sign <= 1; sign += 2) {
        start();
        motor->vel = mk(sign);
        step(0);
        TEST_ASSERT_EQUAL_DOUBLE(sign, val(motor->vel));
        TEST_ASSERT_EQUAL_DOUBLE(0, val(table->vel));
        start();
        put(motor, sign * 5);
        step(0);
        TEST_ASSERT_DOUBLE_WITHIN(1e-4, sign * val(c->stiffness) * DT / 3, val(table->vel)); /* 1 um beyond the gap */
        start();
        put(motor, sign * 4.1);
        motor->vel = mk(sign * -4); /* it leaves faster than the spring follows: the damper would pull */
        step(0);
        TEST_ASSERT_EQUAL_DOUBLE(0, val(table->vel));
    }
    c->gap = mk(0); /* without a gap it pulls */
    start();
    put(motor, 0.1);
    motor->vel = mk(-4);
    step(0);
    TEST_ASSERT_TRUE(val(table->vel) < 0);
}

static void test_encoder_is_at_the_motor_or_at_the_table(void)
{
    join(100, 0.02);
    start();
    put(motor, 30);
    put(table, 20);
    TEST_ASSERT_EQUAL_INT32(300, seen().count[0]);
    c->encoder_at_motor = false;
    TEST_ASSERT_EQUAL_INT32(200, seen().count[0]);
}

/* ---- friction ---- */

/* Of 80 N over 20 um: elements that slip with 10 N each; the others are springs of 10 N over 1.25 (k + 1) um */
static double presliding_at_40_N(void)
{
    double at = 0;
    for (double x = 0; x < 20; x += 1e-3) {
        double force = 0;
        for (int k = 0; k < 8; k++) {
            force += 10 * fmin(1, x / (1.25 * (k + 1)));
        }
        at = force < 40 ? x : at;
    }
    return at;
}

static void test_friction_builds_up_over_the_presliding_distance_and_has_a_loop(void)
{
    c->part[ONCHIP_TABLE].coulomb = mk(80);
    c->part[ONCHIP_TABLE].viscous = mk(2);
    c->friction.axis[ONCHIP_TABLE] = friction_design(mk(20), mk(1), mk(1));
    start();
    double up = 0;
    for (int k = 0; k < 6000; k++) { /* slowly to 40 N, half of the friction */
        step(k < 4000 ? 10 * k : 40000);
        up = um(table);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, val(table->vel));
    const double at = presliding_at_40_N();
    TEST_ASSERT_DOUBLE_WITHIN(0.05, at, up);
    for (int k = 4000; k >= 0; k--) {
        step(10 * k);
    }
    double slope = 0; /* back all are springs at first, from -1 to 1 of their force: Masing's rule */
    for (int k = 0; k < 8; k++) {
        slope += 10 / (1.25 * (k + 1));
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.05, at - 40 / slope, um(table));
}

static void test_motor_has_its_own_part_of_the_friction(void)
{
    join(100, 0.3);
    c->part[ONCHIP_MOTOR].coulomb = mk(80);
    c->friction.axis[ONCHIP_MOTOR] = friction_design(mk(20), mk(1), mk(1));
    start();
    for (int k = 0; k < 6000; k++) {
        step(k < 4000 ? 10 * k : 40000);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.05, presliding_at_40_N(), um(motor));
}

static void test_friction_that_does_not_slip_is_a_spring_without_damping(void)
{
    c->part[ONCHIP_TABLE].coulomb = mk(80);
    c->friction.axis[ONCHIP_TABLE] = friction_design(mk(20), mk(1), mk(1));
    start();
    table->vel = mk(1);
    double peak = 0;
    for (int k = 0; k < 2000; k++) {
        step(0);
        peak = k > 1800 ? fmax(peak, val(table->vel)) : 0;
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.02, 1, peak);
}

static void test_friction_is_coulombs_beyond_presliding_and_holds_below_it(void)
{
    c->part[ONCHIP_TABLE].coulomb = mk(80);
    c->friction.axis[ONCHIP_TABLE] = friction_design(mk(20), mk(1), mk(1));
    start();
    table->vel = mk(100);
    for (int k = 0; k < 20; k++) {
        step(0);
    }
    const double before = val(table->vel);
    for (int k = 0; k < 50; k++) {
        step(0);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, before - 50 * DT * 80 / 4, val(table->vel));
}

static void test_breakaway_is_above_coulomb_friction_and_decays_with_speed(void)
{
    c->part[ONCHIP_TABLE].coulomb = mk(80);
    c->friction.axis[ONCHIP_TABLE] = friction_design(mk(0), mk(1.5), mk(2));
    start();
    step(119000);
    step(119000);
    TEST_ASSERT_TRUE(table->pos == 0);
    step(121000);
    step(121000);
    TEST_ASSERT_TRUE(table->pos > 0);
    start();
    step(200000);
    table->vel = mk(2);
    step(0);
    const double level = 80 * (1 + 0.5 * exp(-1));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 2 + DT * (200 - level) / 4, val(table->vel));
}

/* ---- the force ---- */

static void test_force_lags_behind_with_its_time_constant(void)
{
    c->lag = mk(0.06); /* 0.3 ms */
    start();
    step(100000);
    for (int k = 0; k < 10; k++) {
        step(100000);
    }
    const double t = 10 * DT;
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 100 / 4 * (t - 0.06 * (1 - exp(-t / 0.06))), val(table->vel));
}

static void test_force_acts_after_the_delay(void)
{
    for (uint8_t delay = 1; delay <= ONCHIP_DELAY_MAX; delay++) {
        c->delay = delay;
        start();
        int periods = -1;
        do {
            step(100000);
            periods++;
        } while (val(table->vel) <= 0 && periods < 10);
        TEST_ASSERT_EQUAL_INT(delay, periods);
    }
}

/* ---- ends, switches, index ---- */

static void test_end_stops_hold_the_table(void)
{
    c->travel[0] = -500;
    c->travel[1] = 800;
    for (int sign = -1; sign <= 1; sign += 2) {
        start();
        for (int k = 0; k < 500; k++) {
            step(sign * 100000);
        }
        TEST_ASSERT_EQUAL_DOUBLE(sign < 0 ? -50 : 80, um(table));
        TEST_ASSERT_EQUAL_DOUBLE(0, val(table->vel));
    }
}

static void test_limit_switches_are_active_at_their_place_and_beyond(void)
{
    c->switches[0] = -480;
    c->switches[1] = 780;
    start();
    put(table, -47.9);
    TEST_ASSERT_EQUAL_UINT8(0, seen().inputs[0]);
    put(table, -48.0);
    TEST_ASSERT_EQUAL_UINT8(HAL_LIMIT_MIN, seen().inputs[0]);
    put(table, 77.9);
    TEST_ASSERT_EQUAL_UINT8(0, seen().inputs[0]);
    put(table, 78.0);
    TEST_ASSERT_EQUAL_UINT8(HAL_LIMIT_MAX, seen().inputs[0]);
    TEST_ASSERT_EQUAL_UINT8(0, seen().inputs[1]);
}

static void test_index_pulses_come_at_equal_distances_in_both_directions(void)
{
    static const int32_t up[] = {-100, 0, 100}, down[] = {100, 0, -100};
    c->index = 100;
    for (int sign = -1; sign <= 1; sign += 2) {
        start();
        put(table, sign * -15.0);
        uint8_t pulses = 0;
        table->vel = mk(sign * 20); /* 4 counts a period */
        for (int k = 0; k < 75; k++) {
            step(0);
            const struct hal_drive_in in = seen();
            if (in.index_pulses[0] != pulses) {
                TEST_ASSERT_TRUE(pulses < 3);
                TEST_ASSERT_EQUAL_INT32(sign > 0 ? up[pulses] : down[pulses], in.index_count[0]);
                TEST_ASSERT_TRUE(abs(in.count[0] - in.index_count[0]) <= 4);
                pulses++;
            }
        }
        TEST_ASSERT_EQUAL_UINT8(3, pulses);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_free_masses_swing_with_the_frequency_of_the_mode_and_its_damping);
    RUN_TEST(test_spring_adds_no_damping_of_its_own);
    RUN_TEST(test_table_that_is_held_by_friction_deflects_the_spring);
    RUN_TEST(test_gap_has_no_force_and_its_ends_push_and_do_not_stick);
    RUN_TEST(test_encoder_is_at_the_motor_or_at_the_table);
    RUN_TEST(test_friction_builds_up_over_the_presliding_distance_and_has_a_loop);
    RUN_TEST(test_motor_has_its_own_part_of_the_friction);
    RUN_TEST(test_friction_that_does_not_slip_is_a_spring_without_damping);
    RUN_TEST(test_friction_is_coulombs_beyond_presliding_and_holds_below_it);
    RUN_TEST(test_breakaway_is_above_coulomb_friction_and_decays_with_speed);
    RUN_TEST(test_force_lags_behind_with_its_time_constant);
    RUN_TEST(test_force_acts_after_the_delay);
    RUN_TEST(test_end_stops_hold_the_table);
    RUN_TEST(test_limit_switches_are_active_at_their_place_and_beyond);
    RUN_TEST(test_index_pulses_come_at_equal_distances_in_both_directions);
    return UNITY_END();
}
