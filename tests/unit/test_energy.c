/* SPDX-License-Identifier: Apache-2.0 */
/* test_energy.c: the electrical energy of one axis. */
#include "core/energy.h"

#include "nominal.h"
#include "unity.h"

/* K_f 72 N/A, Z 2.5 ohm, K_E 41.6 V s/m, P_f 0.9; mass 88.08 kg, viscous friction 467.2 N s/m, Coulomb friction
 * 45.5 N. */
static struct energy_cfg cfg;
static struct energy_state state;

void setUp(void)
{
    cfg = nominal().energy[0];
    energy_reset(&state);
}
void tearDown(void)
{
}

static double step(double v_mps, double a_mps2)
{
    return val(energy_step(&cfg, &state, mk(MASS_X), mk(VISCOUS_X), mk(45.5), mk(v_mps / MPS), mk(a_mps2 / MPS2)));
}

/* The integrand of (30), multiplied out. */
static double by_30(double v, double a)
{
    const double m = 88.08, c = 467.2, l = 45.5, k = 72, z = 2.5, ke = 41.6;
    const double sign = v > 0 ? 1 : -1;
    const double c1 = m * m * z / (k * k), c2 = c * (z * c / (k * k) + ke / k), c3 = l * (2 * z * c / (k * k) + ke / k);
    const double c4 = l * l * z / (k * k), c5 = 2 * l * m * z / (k * k), c6 = m * (2 * z * c / (k * k) + ke / k);
    return sqrt(3.0) * 0.9 * (c1 * a * a + c2 * v * v + c3 * v * sign + c4 + c5 * a * sign + c6 * v * a);
}

/* 0.1 m/s is 500 um/T0, which amplifies the rounding of the inputs. */
#define TERMS (NUM_FIXED ? 500.0 : 10.0)

static void test_power_is_the_integrand_of_30(void)
{
    ASSERT_NEAR(by_30(0.1, 0), step(0.1, 0), TERMS);
    ASSERT_NEAR(by_30(-0.1, 0), step(-0.1, 0), TERMS);
    ASSERT_NEAR(by_30(0.3, 2), step(0.3, 2), 500.0);
    ASSERT_NEAR(by_30(-0.3, 2), step(-0.3, 2), 500.0);
}

static void test_at_constant_speed_power_is_voltage_times_current(void)
{
    const double current = (45.5 + 467.2 * 0.1) / 72, voltage = current * 2.5 + 41.6 * 0.1;
    ASSERT_NEAR(sqrt(3.0) * 0.9 * current * voltage, step(0.1, 0), TERMS);
}

static void test_braking_gives_energy_back(void)
{
    ASSERT_NEAR(by_30(0.3, -4), step(0.3, -4), 500.0);
    TEST_ASSERT_TRUE(step(0.3, -4) < 0);
    TEST_ASSERT_TRUE(state.mJ < 0 || val(state.fraction_mJ) < 0);
}

static void test_at_rest_no_power_flows(void)
{
    TEST_ASSERT_EQUAL_DOUBLE(0, step(0, 0));
}

static double energy_mJ(void)
{
    return state.mJ + val(state.fraction_mJ);
}

static void test_energy_is_power_times_time(void)
{
    for (int k = 0; k < 10000; k++) {
        step(0.1, 0);
    }
    /* In 1 s, each step of about 1 mJ is rounded by 2^-25 mJ, and the power has 16 roundings. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-3 + by_30(0.1, 0) * 1e3 * 16 * NUM_ROUNDING, by_30(0.1, 0) * 1e3, energy_mJ());
}

/* From rest to 0.2 m/s at 2 m/s^2 in 0.1 s; (30) in closed form with v = a t. */
static void test_energy_of_an_acceleration_is_the_closed_form_of_30(void)
{
    const double a = 2, t_end = 0.1, dt = 1e-4;
    for (int k = 0; k < 1000; k++) {
        step(a * (k + 0.5) * dt, a);
    }
    const double m = 88.08, c = 467.2, l = 45.5, kf = 72, z = 2.5, ke = 41.6;
    const double f0 = (l + m * a) / kf, f1 = c * a / kf; /* I = f0 + f1 t, V = I Z + K_E a t */
    const double integral = z * (f0 * f0 * t_end + f0 * f1 * t_end * t_end + f1 * f1 * t_end * t_end * t_end / 3) +
                            ke * a * (f0 * t_end * t_end / 2 + f1 * t_end * t_end * t_end / 3);
    /* The midpoint rule errs by dt^2/24 of the second derivative, below 1e-6 of the energy. The boundary layer of
     * the core's sign plays no part here. */
    TEST_ASSERT_DOUBLE_WITHIN(1e-5 * integral * 1559, sqrt(3.0) * 0.9 * integral * 1e3, energy_mJ());
}

static void test_energy_stays_at_the_end_of_its_counter(void)
{
    state.mJ = INT32_MAX;
    for (int k = 0; k < 100; k++) {
        step(0.3, 2);
    }
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, state.mJ);
}

static void test_reset_forgets_what_was_counted(void)
{
    step(0.3, 2);
    energy_reset(&state);
    TEST_ASSERT_EQUAL_DOUBLE(0, energy_mJ());
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_power_is_the_integrand_of_30);
    RUN_TEST(test_at_constant_speed_power_is_voltage_times_current);
    RUN_TEST(test_braking_gives_energy_back);
    RUN_TEST(test_at_rest_no_power_flows);
    RUN_TEST(test_energy_is_power_times_time);
    RUN_TEST(test_energy_of_an_acceleration_is_the_closed_form_of_30);
    RUN_TEST(test_energy_stays_at_the_end_of_its_counter);
    RUN_TEST(test_reset_forgets_what_was_counted);
    return UNITY_END();
}
