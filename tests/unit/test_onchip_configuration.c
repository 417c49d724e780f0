/* SPDX-License-Identifier: Apache-2.0 */
/* The machine on the chip from wire units to the core's: each value against its SI value, written here. */
#include "drive/onchip_configuration.h"

#include <math.h>

#include "drive/configuration.h"
#include "num_test.h"
#include "unity.h"

/* The core's units in SI */
static const double UM = 1e-6, T0 = 5e-3, PI = 3.14159265358979323846;

static struct od_data od;

void setUp(void)
{
    od_init(&od, 1);
}

void tearDown(void)
{
}

static void near(double expected, num actual)
{
    TEST_ASSERT_DOUBLE_WITHIN(NUM_FIXED ? 0x1.01p-20 : 0x1p-22 * fabs(expected), expected, val(actual));
}

static struct onchip_plant_cfg configured(void)
{
    struct onchip_plant_cfg c;
    onchip_configuration(&od, &c);
    return c;
}

static void test_friction_of_the_simulated_machine_lets_it_move_on_within_a_period(void)
{
    uint32_t *const viscous[] = {&od.onchip_plant.viscous_x, &od.onchip_plant.viscous_y};
    const uint32_t mass_g[] = {od.onchip_plant.mass_x, od.onchip_plant.mass_y};
    for (int i = 0; i < 2; i++) {
        const uint32_t kept = *viscous[i];
        *viscous[i] = (mass_g[i] + 1u) * CONTROL_HZ - 1u;
        TEST_ASSERT_TRUE(onchip_configuration_fits(&od));
        *viscous[i] += 1u;
        TEST_ASSERT_FALSE(onchip_configuration_fits(&od));
        *viscous[i] = kept;
    }
}

static void test_machine_that_is_simulated_on_the_chip(void)
{
    od.onchip_plant = (struct od_onchip_plant){.simulated = 1,
                                               .seed = 12345,
                                               .mass_x = 123456,
                                               .mass_y = 234567,
                                               .viscous_x = 456789,
                                               .viscous_y = 567891,
                                               .coulomb_x = 12345,
                                               .coulomb_y = 23456,
                                               .noise_x = 1234,
                                               .noise_y = 2345};
    od.axis[0].plant.encoder = 7629000;
    od.axis[1].plant.encoder = 9876000;
    const struct onchip_plant_cfg c = configured();
    TEST_ASSERT_TRUE(c.simulated);
    TEST_ASSERT_EQUAL_UINT32(12345, c.seed);
    near(1e-4 / T0, c.dt);
    near(123.456 * UM / (T0 * T0), c.axis[0].part[0].mass);
    near(234.567 * UM / (T0 * T0), c.axis[1].part[0].mass);
    near(456.789 * UM / T0, c.axis[0].part[0].viscous);
    near(567.891 * UM / T0, c.axis[1].part[0].viscous);
    near(12.345, c.axis[0].part[0].coulomb);
    near(23.456, c.axis[1].part[0].coulomb);
    near(1.234, c.axis[0].noise);
    near(2.345, c.axis[1].noise);
    near(1000 / 76.29, c.axis[0].counts);
    near(1000 / 98.76, c.axis[1].counts);
    od.onchip_plant.simulated = 0;
    TEST_ASSERT_FALSE(configured().simulated);
}

static void test_simulated_machine_starts_at_the_nearest_count(void)
{
    od.axis[0].plant.encoder = od.axis[1].plant.encoder = 10000000; /* 100 nm */
    od.onchip_plant.start_x = 1249;
    od.onchip_plant.start_y = -1251;
    TEST_ASSERT_EQUAL_INT32(12, configured().axis[0].start);
    TEST_ASSERT_EQUAL_INT32(-13, configured().axis[1].start);
    od.onchip_plant.start_x = 1250;
    od.onchip_plant.start_y = -1249;
    TEST_ASSERT_EQUAL_INT32(13, configured().axis[0].start);
    TEST_ASSERT_EQUAL_INT32(-12, configured().axis[1].start);
    od.axis[1].plant.encoder = 20000000; /* 200 nm */
    od.onchip_plant.start_y = -1301;
    TEST_ASSERT_EQUAL_INT32(13, configured().axis[0].start);
    TEST_ASSERT_EQUAL_INT32(-7, configured().axis[1].start);
    od.axis[0].plant.encoder = od.axis[1].plant.encoder = 100000; /* 1 nm */
    od.onchip_plant.start_x = -1;
    od.onchip_plant.start_y = 1;
    TEST_ASSERT_EQUAL_INT32(-1, configured().axis[0].start);
    TEST_ASSERT_EQUAL_INT32(1, configured().axis[1].start);
}

static void test_start_beyond_what_the_counter_holds_is_its_end(void)
{
    od.axis[0].plant.encoder = od.axis[1].plant.encoder = 25000; /* 0.25 nm */
    od.onchip_plant.start_x = 2000000000;
    od.onchip_plant.start_y = -2000000000;
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, configured().axis[0].start);
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, configured().axis[1].start);
}

static void test_axis_without_a_mode_is_one_mass_with_all_of_the_friction(void)
{
    od.axis[0].onchip_axis.motor_share = 3000;
    od.axis[0].onchip_axis.friction_share = 2000;
    const struct onchip_plant_cfg c = configured();
    near(88.08 * UM / (T0 * T0), c.axis[0].part[ONCHIP_TABLE].mass);
    near(45.5, c.axis[0].part[ONCHIP_TABLE].coulomb);
    near(0, c.axis[0].stiffness);
    TEST_ASSERT_FALSE(c.axis[0].encoder_at_motor);
}

static void test_axis_with_a_mode_is_two_masses_with_a_spring(void)
{
    od.onchip_plant.mass_y = 100000;
    od.onchip_plant.viscous_y = 600000;
    od.onchip_plant.coulomb_y = 60000;
    struct od_onchip_axis *a = &od.axis[1].onchip_axis;
    a->resonance = 90000;
    a->damping = 300;
    a->motor_share = 3000;
    a->friction_share = 2000;
    a->backlash = 8000;
    const struct onchip_axis_cfg y = configured().axis[1];
    const double omega = 2 * PI * 90, reduced_kg = 100 * 0.3 * 0.7;
    near(70 * UM / (T0 * T0), y.part[ONCHIP_TABLE].mass);
    near(30 * UM / (T0 * T0), y.part[ONCHIP_MOTOR].mass);
    near(120 * UM / T0, y.part[ONCHIP_TABLE].viscous);
    near(480 * UM / T0, y.part[ONCHIP_MOTOR].viscous);
    near(12, y.part[ONCHIP_TABLE].coulomb);
    near(48, y.part[ONCHIP_MOTOR].coulomb);
    TEST_ASSERT_DOUBLE_WITHIN(2e-5, reduced_kg * omega * omega * UM, val(y.stiffness));
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 2 * 0.03 * reduced_kg * omega * UM / T0, val(y.damping));
    near(4, y.gap);
    TEST_ASSERT_TRUE(y.encoder_at_motor);
    a->encoder_at_table = 1;
    TEST_ASSERT_FALSE(configured().axis[1].encoder_at_motor);
}

static void test_friction_lag_and_delay_are_those_of_the_axis(void)
{
    struct od_onchip_axis *a = &od.axis[0].onchip_axis;
    a->presliding = 20000;
    a->breakaway = 1250;
    a->stribeck = 4000000;
    a->lag = 300;
    a->delay = 2;
    const struct onchip_plant_cfg c = configured();
    for (int k = 0; k < ONCHIP_MASSES; k++) {
        near(20, c.axis[0].friction.axis[k].presliding);
        near(0.25, c.axis[0].friction.axis[k].excess);
        near(4e-3 * T0 / UM, c.axis[0].friction.axis[k].stribeck);
        near(0, c.axis[1].friction.axis[k].presliding);
    }
    near(3e-4 / T0, c.axis[0].lag);
    TEST_ASSERT_EQUAL_UINT8(2, c.axis[0].delay);
    TEST_ASSERT_EQUAL_UINT8(1, c.axis[1].delay);
}

static void test_ends_switches_and_index_are_in_counts_of_their_own_length(void)
{
    od.axis[0].plant.encoder = 10000000;
    struct od_onchip_axis *a = &od.axis[0].onchip_axis;
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, configured().axis[0].travel[0]);
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, configured().axis[0].travel[1]);
    TEST_ASSERT_EQUAL_INT32(0, configured().axis[0].index);
    a->encoder = 20000000; /* 200 nm, whatever the drive believes */
    a->travel_min = -100000000;
    a->travel_max = 150000000;
    a->index = 10000099;
    const struct onchip_axis_cfg none = configured().axis[0];
    TEST_ASSERT_EQUAL_INT32(-500000, none.travel[0]);
    TEST_ASSERT_EQUAL_INT32(750000, none.travel[1]);
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, none.switches[0]);
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, none.switches[1]);
    TEST_ASSERT_EQUAL_INT32(50000, none.index);
    near(5, none.counts);
    a->limit_switch = 2000000;
    TEST_ASSERT_EQUAL_INT32(-490000, configured().axis[0].switches[0]);
    TEST_ASSERT_EQUAL_INT32(740000, configured().axis[0].switches[1]);
    od.onchip_plant.start_x = 1000;
    TEST_ASSERT_EQUAL_INT32(5, configured().axis[0].start);
}

static void test_what_cannot_be_is_refused(void)
{
    struct od_onchip_axis *a = &od.axis[1].onchip_axis;
    a->travel_min = 1;
    TEST_ASSERT_FALSE(configuration_fits(&od));
    a->travel_max = 1;
    TEST_ASSERT_TRUE(configuration_fits(&od));
    a->lag = 1000000u / CONTROL_HZ - 1u;
    TEST_ASSERT_FALSE(configuration_fits(&od));
    a->lag += 1u;
    TEST_ASSERT_TRUE(configuration_fits(&od));
    od.onchip_plant.mass_y = 10000; /* 1 kg of it at the motor */
    od.onchip_plant.viscous_y = 2 * 1000 * CONTROL_HZ;
    a->motor_share = 1000;
    a->friction_share = 5000;
    TEST_ASSERT_TRUE(configuration_fits(&od));
    a->resonance = 90000;
    TEST_ASSERT_TRUE(configuration_fits(&od));
    a->friction_share = 4990;
    TEST_ASSERT_FALSE(configuration_fits(&od));
    a->motor_share = 9000;
    TEST_ASSERT_TRUE(configuration_fits(&od));
    a->friction_share = 5010;
    TEST_ASSERT_FALSE(configuration_fits(&od));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_friction_of_the_simulated_machine_lets_it_move_on_within_a_period);
    RUN_TEST(test_machine_that_is_simulated_on_the_chip);
    RUN_TEST(test_simulated_machine_starts_at_the_nearest_count);
    RUN_TEST(test_start_beyond_what_the_counter_holds_is_its_end);
    RUN_TEST(test_axis_without_a_mode_is_one_mass_with_all_of_the_friction);
    RUN_TEST(test_axis_with_a_mode_is_two_masses_with_a_spring);
    RUN_TEST(test_friction_lag_and_delay_are_those_of_the_axis);
    RUN_TEST(test_ends_switches_and_index_are_in_counts_of_their_own_length);
    RUN_TEST(test_what_cannot_be_is_refused);
    return UNITY_END();
}
