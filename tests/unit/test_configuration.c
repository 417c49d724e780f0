/* SPDX-License-Identifier: Apache-2.0 */
/* Parameters in wire units to the core's units: each against its SI value, written here next to the integer. */
#include <math.h>

#include "drive/configuration.h"
#include "num_test.h"
#include "od/od.h"
#include "table1.h"
#include "unity.h"

/* The core's units in SI */
static const double UM = 1e-6, T0 = 5e-3;

static struct od_data od;

void setUp(void)
{
    od = table1();
}

void tearDown(void)
{
}

static void near(double expected, num actual)
{
    TEST_ASSERT_DOUBLE_WITHIN(NUM_FIXED ? 0x1.01p-20 : 0x1p-23 * fabs(expected), expected, val(actual));
}

static void test_plant_of_each_axis(void)
{
    od.axis[0].plant = (struct od_plant){.mass = 123456, .viscous = 456789, .coulomb = 12345, .force_limit = 654321};
    od.axis[1].plant = (struct od_plant){.mass = 234567, .viscous = 567891, .coulomb = 23456, .force_limit = 765432};
    const struct plant_cfg p = configuration_servo(&od).plant;
    near(123.456 * UM / (T0 * T0), p.mass.x); /* kg = N s2/m */
    near(234.567 * UM / (T0 * T0), p.mass.y);
    near(456.789 * UM / T0, p.viscous.x); /* N s/m */
    near(567.891 * UM / T0, p.viscous.y);
    near(12.345, p.coulomb.x);
    near(23.456, p.coulomb.y);
    near(654.321, p.force_max.x);
    near(765.432, p.force_max.y);
}

static void test_motor_of_each_axis(void)
{
    od.axis[0].motor =
        (struct od_motor){.force_constant = 71234, .impedance = 2345, .back_emf = 41234, .power_factor = 876};
    od.axis[1].motor =
        (struct od_motor){.force_constant = 81234, .impedance = 3456, .back_emf = 51234, .power_factor = 765};
    od.contour.friction_speed = 71234;
    const struct servo_cfg c = configuration_servo(&od);
    near(71.234, c.energy[0].force_constant);
    near(81.234, c.energy[1].force_constant);
    near(2.345, c.energy[0].impedance);
    near(3.456, c.energy[1].impedance);
    near(41.234 * UM / T0, c.energy[0].back_emf); /* V s/m */
    near(51.234 * UM / T0, c.energy[1].back_emf);
    near(0.876, c.energy[0].power_factor);
    near(0.765, c.energy[1].power_factor);
    near(71.234e-6 / UM * T0, c.energy[0].sign_speed);
    near(71.234e-6 / UM * T0, c.energy[1].sign_speed);
    near(0.4, c.energy[0].dt_ms);
    near(0.4, c.energy[1].dt_ms);
}

static void test_contouring_law(void)
{
    od.smc = (struct od_smc){.lambda = 173205,
                             .gamma = 1234,
                             .beta = 5678,
                             .k_bar = 987,
                             .e_max = 3210123,
                             .psi_printed = 1,
                             .k_0 = 91234,
                             .k_max = 412345,
                             .zeta = 98765,
                             .xi = 10203040,
                             .epsilon = 1234567,
                             .stiffness = 23456789};
    od.contour.friction_speed = 87654;
    const struct smc_cfg a = configuration_servo(&od).gains.smc;
    near(173.205 * T0, a.lambda); /* 1/s */
    near(1.234 * T0, a.gamma);
    near(5.678, a.beta);
    near(987.0 * UM, a.k_bar); /* 1/m */
    near(3210.123, a.e_max);   /* um */
    TEST_ASSERT_TRUE(a.psi_printed);
    near(91.234 * T0, a.k_0);
    near(412.345 * T0, a.k_max);
    near(98.765 * T0, a.zeta);
    near(98.765 * T0 * T0 * ACC_GAIN, a.zeta_rate); /* 1/s2 */
    near(10203.040 * UM * T0 * ACC_GAIN, a.xi);     /* 1/(m s) */
    near(1.234567e-3 / UM * T0, a.epsilon);
    near(234567.89 * T0 * T0, a.stiffness); /* 1/s2 */
    near(87.654e-6 / UM * T0, a.friction_speed);
    od.smc.psi_printed = 0;
    TEST_ASSERT_FALSE(configuration_servo(&od).gains.smc.psi_printed);
}

static void test_watch_for_oscillation(void)
{
    od.axis[0].plant =
        (struct od_plant){.mass = 123456, .viscous = 456789, .encoder = 123456789, .force_limit = 100000};
    od.axis[1].plant = (struct od_plant){.mass = 234567, .viscous = 567891, .encoder = 1000000, .force_limit = 80000};
    od.oscillation = (struct od_oscillation){.limit = 45000, .corner = 43210, .reaction = 1, .gain_step = 567};
    const struct oscillation_cfg o = configuration_servo(&od).oscillation;
    TEST_ASSERT_TRUE(o.on);
    TEST_ASSERT_FALSE(o.lower);
    near(0.567, o.gain_step);
    const double w = 2 * 3.14159265358979 * 43.210 / CONTROL_HZ;
    TEST_ASSERT_DOUBLE_WITHIN(w * w * w / 6 + 1e-6, 1 - exp(-w), val(o.slow)); /* it is a little off */
    near(45.0 / 4, o.axis[0].limit);
    near(40.0 / 4, o.axis[1].limit); /* half of the largest force */
    near(50.0 / 4, o.axis[0].force_max);
    near(40.0 / 4, o.axis[1].force_max);
    const double rate = 3.14159265358979 * 43.210; /* of a mass that swings by a count of 1.23 um and 10 nm */
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 123.456 * rate * rate * 1.23456789e-6 / 4, val(o.axis[0].count));
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 234.567 * rate * rate * 10e-9 / 4, val(o.axis[1].count));
    near(123.456 * UM / (T0 * T0) / 4, o.mass.x);
    near(234.567 * UM / (T0 * T0) / 4, o.mass.y);
    near(456.789 * UM / T0 / 4, o.viscous.x);
    near(567.891 * UM / T0 / 4, o.viscous.y);
    TEST_ASSERT_EQUAL_UINT16((uint16_t)(CONTROL_HZ / 43.210), o.half_wave);
    TEST_ASSERT_EQUAL_UINT16(CONTROL_HZ * 60 / 1000, o.lasts);
    TEST_ASSERT_EQUAL_UINT32(CONTROL_HZ, o.control_hz);
    od.oscillation.reaction = 4;
    TEST_ASSERT_TRUE(configuration_servo(&od).oscillation.lower);
    od.oscillation.limit = 0;
    TEST_ASSERT_FALSE(configuration_servo(&od).oscillation.on);
}

static void test_uncertainty_compensator(void)
{
    od.compensator = (struct od_compensator){.alpha = 61234,
                                             .mu_0 = 1234567,
                                             .mu_max = 4567890,
                                             .rho = 543,
                                             .phi = 1111111,
                                             .dead_zone = 2222222,
                                             .law_printed = 1,
                                             .input_printed = 0};
    const struct compensator_cfg u = configuration_servo(&od).gains.compensator;
    near(61.234 * T0, u.alpha);
    near(1.234567 / UM * T0 * T0, u.mu_0); /* m/s2 */
    near(4.567890 / UM * T0 * T0, u.mu_max);
    near(0.543 * T0 * T0 * ACC_GAIN, u.rho); /* 1/s2 */
    near(1.111111e-3 / UM * T0, u.phi);
    near(2.222222e-3 / UM * T0, u.dead_zone);
    TEST_ASSERT_TRUE(u.law_printed);
    TEST_ASSERT_FALSE(u.input_printed);
    near(1, u.turning);
    od.compensator.in_axes = 1;
    near(0, configuration_servo(&od).gains.compensator.turning);
    od.compensator.law_printed = 0;
    od.compensator.input_printed = 1;
    TEST_ASSERT_FALSE(configuration_servo(&od).gains.compensator.law_printed);
    TEST_ASSERT_TRUE(configuration_servo(&od).gains.compensator.input_printed);
}

static void test_cascade(void)
{
    od.cascade = (struct od_cascade){
        .position_gain = 67891, .velocity_gain = 301234, .integral_gain = 77123, .coupling_gain = 1234};
    const struct cascade_cfg c = configuration_servo(&od).gains.cascade;
    near(67.891 * T0, c.k_p);
    near(301.234 * T0, c.k_v);
    near(77.123 * T0, c.k_i);
    near(1.234, c.coupling);
}

static void test_contour_estimator(void)
{
    od.contour = (struct od_contour){
        .newton = 0, .v_min = 123456, .friction_speed = 80000, .lag_max = 6789, .blend_time = 19900};
    const struct servo_cfg c = configuration_servo(&od);
    TEST_ASSERT_FALSE(c.contour.newton);
    near(123.456e-6 / UM * T0, c.contour.v_min);
    near(6.789e-3 / T0, c.contour.lag_max); /* ms */
    near(19.9 / 20.0, c.blend);             /* a share of 0.1 ms of 20 ms is left out each period */
    od.contour.newton = 1;
    TEST_ASSERT_TRUE(configuration_servo(&od).contour.newton);
}

static void test_geometry_of_each_axis(void)
{
    TEST_ASSERT_FALSE(configuration_servo(&od).geometry.on);
    for (int i = 0; i < 2; i++) {
        struct od_axis *a = &od.axis[i];
        a->plant.coulomb = 12345;
        a->plant.viscous = 456789;
        a->transmission =
            (struct od_transmission){.stiffness = 7654, .table_mass = 43210, .table_friction = 345, .backlash = 23456};
        a->lead_map = (struct od_lead_map){.points = 3, .start = -1234567, .step = 7654321};
        a->screw.lead = 5000000;
        a->screw.error_cos = -12345;
        a->screw.error_sin = 678;
        a->lead_error[0] = -1234567;
        a->lead_error[1] = 234;
        a->lead_error[2] = 345678;
        a->lead_error[3] = 99;
    }
    od.geometry = (struct od_geometry){.squareness_x = 234567, .squareness_y = -345678};
    const struct geometry_cfg g = configuration_servo(&od).geometry;
    TEST_ASSERT_TRUE(g.on);
    near(0.04, g.dt);                     /* the axes take turns */
    near(0.234567, g.axis[0].squareness); /* mrad: um/mm */
    near(-0.345678, g.axis[1].squareness);
    for (int i = 0; i < 2; i++) {
        near(1 / 7.654, g.axis[i].compliance);
        near(43.210 * UM / (T0 * T0), g.axis[i].mass);
        near(0.345 * 12.345, g.axis[i].coulomb);
        near(0.345 * 456.789 * UM / T0, g.axis[i].viscous);
        near(23.456 / 2, g.axis[i].half_gap);
        TEST_ASSERT_DOUBLE_WITHIN(1e-4, (od.axis[i].plant.mass / 1000.0 - 43.210) * UM / (T0 * T0) * 23.456 / 2,
                                  val(g.axis[i].gap_inertia));
        TEST_ASSERT_TRUE(g.axis[i].turns == screw_turns(5000000));
        near(-12.345, g.axis[i].error_cos);
        near(0.678, g.axis[i].error_sin);
        TEST_ASSERT_EQUAL_UINT32(3, g.axis[i].points);
        TEST_ASSERT_EQUAL_INT32(-1234567, g.axis[i].start_nm);
        TEST_ASSERT_EQUAL_UINT32(7654321, g.axis[i].step_nm);
        near(-1234.567, g.axis[i].lead[0]);
        near(0.234, g.axis[i].lead[1]);
        near(345.678, g.axis[i].lead[2]);
        near(0, g.axis[i].lead[3]); /* not a point */
    }
}

/* F = m_0 g b'', of which b'' is at most 2 w^2, is half of the force limit at most. */
static void test_force_across_a_gap_is_half_of_the_largest_at_most(void)
{
    for (int i = 0; i < 2; i++) {
        od.axis[i].plant.mass = 60000;
        od.axis[i].plant.force_limit = 80000;
        od.axis[i].transmission = (struct od_transmission){.table_mass = i == 0 ? 35000 : 0, .backlash = 60000};
    }
    struct geometry_cfg g = configuration_servo(&od).geometry;
    near(25 * UM / (T0 * T0) * 30, g.axis[0].gap_inertia);
    near(0, g.axis[1].gap_inertia); /* nothing is known of the table */
    const double w = val(g.axis[0].side_bandwidth);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 80.0 / 2, val(g.axis[0].gap_inertia) * 2 * w * w);
    od.axis[0].transmission.backlash = 1500;
    od.axis[1].transmission.table_mass = 60000;
    g = configuration_servo(&od).geometry;
    near(GEOMETRY_SIDE_BANDWIDTH, g.axis[0].side_bandwidth);
    near(0, g.axis[1].gap_inertia); /* nothing is left before the gap */
}

static void test_geometry_is_on_where_there_is_any(void)
{
    for (int i = 0; i < 12; i++) {
        od_init(&od, 1);
        struct od_axis *a = &od.axis[i % 2];
        a->screw.lead = i >= 8 ? 5000000 : 0;
        a->screw.error_cos = i / 2 == 4 ? 1 : 0;
        a->screw.error_sin = i / 2 == 5 ? -1 : 0;
        a->transmission.stiffness = i / 2 == 0 ? 1 : 0;
        a->transmission.backlash = i / 2 == 1 ? 1 : 0;
        a->lead_map.points = i / 2 == 2 ? 2 : 0;
        od.geometry.squareness_x = i == 6 ? 1 : 0;
        od.geometry.squareness_y = i == 7 ? -1 : 0;
        TEST_ASSERT_TRUE(configuration_servo(&od).geometry.on);
    }
    TEST_ASSERT_EQUAL_DOUBLE(0, val(configuration_servo(&od).geometry.axis[0].compliance)); /* rigid */
    TEST_ASSERT_TRUE(configuration_servo(&od).geometry.axis[0].turns == 0);
    od.axis[1].screw.error_sin = 0; /* only a lead */
    TEST_ASSERT_FALSE(configuration_servo(&od).geometry.on);
    od.axis[1].screw.lead = 0; /* no lead */
    od.axis[1].screw.error_cos = 1;
    TEST_ASSERT_FALSE(configuration_servo(&od).geometry.on);
}

static void test_second_encoder_of_each_axis(void)
{
    TEST_ASSERT_FALSE(configuration_servo(&od).dual_feedback[0].on);
    for (int i = 0; i < 2; i++) {
        od_init(&od, 1);
        od.axis[i].second_encoder =
            (struct od_second_encoder){.length = 1234567, .crossover = 34567, .tolerance = 456789, .invert = 1};
        const struct servo_cfg c = configuration_servo(&od);
        TEST_ASSERT_TRUE(c.geometry.on);
        TEST_ASSERT_TRUE(c.dual_feedback[i].on);
        TEST_ASSERT_FALSE(c.dual_feedback[1 - i].on);
        near(2 * 3.14159265358979 * 34.567 * 1e-4, c.dual_feedback[i].gain);
        near(456.789, c.dual_feedback[i].tolerance);
        struct servo_loop_cfg loop;
        configuration_servo_loop(&od, &loop);
        TEST_ASSERT_EQUAL_UINT32(1234567, loop.second_10fm[i]);
        TEST_ASSERT_EQUAL_UINT32(0, loop.second_10fm[1 - i]);
        struct hal_axis_cfg hal[AXES];
        configuration_hal(&od, hal);
        TEST_ASSERT_TRUE(hal[i].invert_second);
        TEST_ASSERT_FALSE(hal[1 - i].invert_second);
        od.onchip_plant.simulated = 1; /* it has no second encoder */
        TEST_ASSERT_FALSE(configuration_servo(&od).dual_feedback[i].on);
        TEST_ASSERT_FALSE(configuration_servo(&od).geometry.on);
    }
}

static void test_control_period(void)
{
    near(100e-6 / T0, configuration_servo(&od).dt);
}

static void test_learned_feedforward(void)
{
    od.feedforward = (struct od_feedforward){.friction_rate = 43210, .mass_rate = 21098, .acceleration = 765432};
    const struct feedforward_cfg l = configuration_servo(&od).feedforward;
    near(43.210 * T0, l.friction_rate); /* 1/s */
    near(21.098 * T0, l.mass_rate);
    near(0.765432 / UM * T0 * T0, l.acceleration); /* m/s2 */
}

static void test_delay_of_each_axis_is_on_where_there_is_one(void)
{
    TEST_ASSERT_FALSE(configuration_servo(&od).delay.on);
    for (int i = 0; i < 2; i++) {
        od_init(&od, 1);
        od.axis[i].plant.force_delay = 1234;
        const struct servo_delay_cfg c = configuration_servo(&od).delay;
        TEST_ASSERT_TRUE(c.on);
        near(1.234e-3 / T0, c.time[i]);
        near(0, c.time[1 - i]);
    }
}

static void test_friction_of_each_axis_is_on_where_it_is_more_than_a_sign(void)
{
    TEST_ASSERT_FALSE(configuration_servo(&od).friction.on);
    for (int i = 0; i < 2; i++) {
        od_init(&od, 1);
        od.axis[i].friction.breakaway = 1250;
        TEST_ASSERT_TRUE(configuration_servo(&od).friction.on);
        od.axis[i].friction = (struct od_friction){.presliding = 20123, .breakaway = 1000, .stribeck = 4123456};
        const struct servo_cfg c = configuration_servo(&od);
        TEST_ASSERT_TRUE(c.friction.on);
        near(20.123, c.friction.axis[i].presliding); /* um */
        near(0, c.friction.axis[i].excess);
        near(4.123456e-3 / UM * T0, c.friction.axis[i].stribeck); /* m/s */
        near(0, c.friction.axis[1 - i].presliding);
        near(20.123 / 16, c.friction.axis[i].element[0].width);
        near(2 / 20.123, c.friction.axis[i].element[0].share);
        near(20.123 / 2, c.friction.axis[i].element[7].width);
        near(0.25 / 20.123, c.friction.axis[i].element[7].share);
    }
    od.axis[1].friction.breakaway = 1250;
    near(0.25, configuration_servo(&od).friction.axis[1].excess);
}

static void test_screw_of_each_axis_is_on_where_it_has_a_lead(void)
{
    TEST_ASSERT_FALSE(configuration_servo(&od).screw.on);
    for (int i = 0; i < 2; i++) {
        od_init(&od, 1);
        od.axis[i].screw = (struct od_screw){.lead = 10000000,
                                             .cogging_cos_1 = -1001,
                                             .cogging_sin_1 = 1002,
                                             .cogging_cos_2 = 1003,
                                             .cogging_sin_2 = 1004,
                                             .cogging_cos_3 = 1005,
                                             .cogging_sin_3 = 1006,
                                             .ripple_cos_1 = -10001,
                                             .ripple_sin_1 = 10002,
                                             .ripple_cos_2 = 10003,
                                             .ripple_sin_2 = 10004,
                                             .ripple_cos_3 = 10005,
                                             .ripple_sin_3 = 10006,
                                             .order_1 = 1,
                                             .order_2 = 4,
                                             .order_3 = 9};
        const struct screw_cfg c = configuration_servo(&od).screw;
        TEST_ASSERT_TRUE(c.on);
        TEST_ASSERT_TRUE(c.axis[1 - i].turns == 0);
        const uint32_t phase = pos_phase(pos_from_nm(15000000), c.axis[i].turns); /* 1.5 turns */
        TEST_ASSERT_UINT32_WITHIN(1024, 1u << 31, phase);
        for (int n = 0; n < SCREW_HARMONICS; n++) {
            const struct screw_harmonic *h = &c.axis[i].harmonic[n];
            const double sign = n == 0 ? -1 : 1;
            TEST_ASSERT_EQUAL_UINT32(n == 0 ? 1 : n == 1 ? 4 : 9, h->order);
            near(sign * (1.001 + 0.002 * n), h->cogging_cos); /* N */
            near(1.002 + 0.002 * n, h->cogging_sin);
            near(sign * (0.010001 + 2e-6 * n), h->ripple_cos);
            near(0.010002 + 2e-6 * n, h->ripple_sin);
        }
    }
}

static void test_observer_is_slower_for_coarse_encoders_by_the_fourth_root(void)
{
    const struct observer_cfg nominal = configuration_servo(&od).observer;
    od.axis[0].plant.encoder = 1000000; /* 10 nm: no faster */
    TEST_ASSERT_EQUAL_DOUBLE(val(nominal.gain_pos), val(configuration_servo(&od).observer.gain_pos));
    od.axis[1].plant.encoder = 16 * 7629000; /* the coarser axis counts */
    const struct observer_cfg coarse = configuration_servo(&od).observer;
    od.axis[1].plant.encoder = 7629000;
    od.observer.bandwidth /= 2;
    const struct observer_cfg half = configuration_servo(&od).observer;
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, val(half.gain_pos), val(coarse.gain_pos));
    TEST_ASSERT_TRUE(val(coarse.gain_pos) < 0.6 * val(nominal.gain_pos));
}

static void test_observer_has_its_poles_where_the_bandwidth_says(void)
{
    od.observer.bandwidth = 1200000;
    const struct observer_cfg o = configuration_servo(&od).observer;
    const double dt = val(o.dt), x = 1200.0 * T0 * dt / 2, p = (1 - x) / (1 + x), q = 1 - p;
    TEST_ASSERT_DOUBLE_WITHIN(1e-6 + HALF_STEPS(8), 1 - p * p * p, val(o.gain_pos));
    TEST_ASSERT_DOUBLE_WITHIN(1e-5 * 3 + HALF_STEPS(6 * q / dt), 1.5 * q * q * (1 + p) / dt, val(o.gain_vel));
    TEST_ASSERT_DOUBLE_WITHIN(1e-5 * 5 + HALF_STEPS(3 * q * q / dt / dt), q * q * q / dt / dt, val(o.gain_acc));
    near(0.02, o.dt);
}

static void test_force_filters_of_each_axis(void)
{
    od.axis[1].force_filter.zero_2 = od.axis[1].force_filter.pole_2 = 170000;
    od.axis[1].force_filter.zero_damping_2 = 70;
    od.axis[1].force_filter.pole_damping_2 = 650;
    od.axis[1].force_filter.pole_4 = 800000;
    od.axis[0].force_filter.pole_1 = 900000;
    od.axis[0].force_filter.pole_3 = 700000;
    const struct force_filter_cfg c = configuration_servo(&od).force_filter;
    TEST_ASSERT_TRUE(c.on);
    TEST_ASSERT_EQUAL_UINT8(2, c.count[0]);
    TEST_ASSERT_EQUAL_UINT8(2, c.count[1]);
    const double pi = 3.14159265358979323846;
    near(tan(pi * 900 / CONTROL_HZ), c.section[0][0].g);
    near(tan(pi * 700 / CONTROL_HZ), c.section[0][1].g);
    near(tan(pi * 170 / CONTROL_HZ), c.section[1][0].g);
    near(tan(pi * 800 / CONTROL_HZ), c.section[1][1].g);
    near(1, c.section[1][0].r2);
    TEST_ASSERT_DOUBLE_WITHIN(1e-5, 2 * 0.07 - 2 * 0.65, val(c.section[1][0].c));
    TEST_ASSERT_EQUAL_DOUBLE(0, val(c.section[1][1].r2));
    od_init(&od, 1);
    TEST_ASSERT_FALSE(configuration_servo(&od).force_filter.on);
}

static void test_continuous_force_of_each_axis(void)
{
    TEST_ASSERT_FALSE(configuration_servo(&od).force_limit.on);
    od.axis[1].force_continuous = (struct od_force_continuous){.force = 123456, .time = 8765};
    struct force_limit_cfg c = configuration_servo(&od).force_limit;
    TEST_ASSERT_TRUE(c.on);
    near(0, c.inverse.x);
    near(600, c.continuous.x); /* its peak */
    near(123.456, c.continuous.y);
    near(1 / 123.456, c.inverse.y);
    near(ACC_GAIN * 4 / 10.0 / CONTROL_HZ, c.rate[0]); /* in turns of four periods */
    near(ACC_GAIN * 4 / 8.765 / CONTROL_HZ, c.rate[1]);
    od.axis[1].force_continuous.force = 0;
    od.axis[0].force_continuous.force = 234567;
    c = configuration_servo(&od).force_limit;
    TEST_ASSERT_TRUE(c.on);
    near(234.567, c.continuous.x);
    near(1 / 234.567, c.inverse.x);
    near(0, c.inverse.y);
}

/* ---- what must fit together ---- */

static void test_force_filters_have_frequencies_below_half_the_control_rate(void)
{
    for (int i = 0; i < 2; i++) {
        struct od_force_filter *f = &od.axis[i].force_filter;
        uint32_t *const zeros[] = {&f->zero_1, &f->zero_2, &f->zero_3, &f->zero_4};
        uint32_t *const poles[] = {&f->pole_1, &f->pole_2, &f->pole_3, &f->pole_4};
        for (int n = 0; n < 4; n++) {
            *poles[n] = 490 * CONTROL_HZ;
            TEST_ASSERT_TRUE(configuration_fits(&od));
            *poles[n] += 1;
            TEST_ASSERT_FALSE(configuration_fits(&od));
            *poles[n] = 100000;
            *zeros[n] = 490 * CONTROL_HZ + 1;
            TEST_ASSERT_FALSE(configuration_fits(&od));
            *zeros[n] = 0;
            *poles[n] = 0;
        }
    }
}

static void test_continuous_force_is_at_least_a_fiftieth_of_the_force_limit(void)
{
    for (int i = 0; i < 2; i++) {
        od_init(&od, 1);
        od.axis[i].plant.force_limit = 3000000;
        od.axis[i].force_continuous.force = 60000;
        TEST_ASSERT_TRUE(configuration_fits(&od));
        od.axis[i].force_continuous.force = 59999;
        TEST_ASSERT_FALSE(configuration_fits(&od));
        od.axis[i].force_continuous.force = 0;
        TEST_ASSERT_TRUE(configuration_fits(&od));
    }
}

static void test_defaults_fit(void)
{
    TEST_ASSERT_TRUE(configuration_fits(&od));
}

static void test_soft_limits_are_no_empty_range(void)
{
    for (int i = 0; i < 2; i++) {
        od_init(&od, 1);
        od.axis[i].position_limit.min = od.axis[i].position_limit.max;
        TEST_ASSERT_TRUE(configuration_fits(&od));
        od.axis[i].position_limit.min++;
        TEST_ASSERT_FALSE(configuration_fits(&od));
    }
}

static void test_map_of_a_screw_has_two_points_or_more(void)
{
    for (int i = 0; i < 2; i++) {
        od_init(&od, 1);
        od.axis[i].lead_map.points = 1;
        TEST_ASSERT_FALSE(configuration_fits(&od));
        od.axis[i].lead_map.points = 2;
        TEST_ASSERT_TRUE(configuration_fits(&od));
    }
}

/* 2 pi 500 um / lead is half a um per um at a lead of 6.2832 mm. */
static void test_error_once_a_turn_is_flatter_than_half_the_travel(void)
{
    for (int i = 0; i < 2; i++) {
        od_init(&od, 1);
        struct od_screw *s = &od.axis[i].screw;
        s->error_cos = 300000;
        s->error_sin = -400000;
        TEST_ASSERT_TRUE(configuration_fits(&od)); /* no lead, no error */
        s->lead = 6290000;
        TEST_ASSERT_TRUE(configuration_fits(&od));
        s->lead = 6280000;
        TEST_ASSERT_FALSE(configuration_fits(&od));
    }
}

static void test_map_of_a_screw_is_monotonic(void)
{
    for (int i = 0; i < 2; i++) {
        od_init(&od, 1);
        struct od_axis *a = &od.axis[i];
        a->lead_map = (struct od_lead_map){.points = 64, .step = 200000};
        a->lead_error[0] = 100000; /* half a step less at the next point: the table still moves on */
        a->lead_error[62] = -100000;
        TEST_ASSERT_TRUE(configuration_fits(&od));
        a->lead_error[63] = 1;
        TEST_ASSERT_FALSE(configuration_fits(&od));
        a->lead_error[63] = -200001;
        TEST_ASSERT_FALSE(configuration_fits(&od));
        a->lead_map.points = 63;
        TEST_ASSERT_TRUE(configuration_fits(&od));
    }
}

static void test_k_bar_times_e_max_is_at_most_4(void)
{
    od.smc.k_bar = 1000;    /* 1/m */
    od.smc.e_max = 4000000; /* 4 mm */
    TEST_ASSERT_TRUE(configuration_fits(&od));
    od.smc.e_max = 4000001;
    TEST_ASSERT_FALSE(configuration_fits(&od));
    od.smc.e_max = 4000000;
    od.smc.k_bar = 1001;
    TEST_ASSERT_FALSE(configuration_fits(&od));
    od.smc.k_bar = 1000000; /* both at their greatest: 1e14, which no 32 bits hold */
    od.smc.e_max = 100000000;
    TEST_ASSERT_FALSE(configuration_fits(&od));
    od.smc.k_bar = 0;
    TEST_ASSERT_TRUE(configuration_fits(&od));
}

static void test_k_0_is_at_most_k_max(void)
{
    od.smc.k_0 = od.smc.k_max = 300000;
    TEST_ASSERT_TRUE(configuration_fits(&od));
    od.smc.k_0 = 300001;
    TEST_ASSERT_FALSE(configuration_fits(&od));
}

static void test_mu_0_is_at_most_mu_max(void)
{
    od.compensator.mu_0 = od.compensator.mu_max = 3000000;
    TEST_ASSERT_TRUE(configuration_fits(&od));
    od.compensator.mu_max = 2999999;
    TEST_ASSERT_FALSE(configuration_fits(&od));
}

static void test_wiring_of_each_axis_for_the_hal(void)
{
    struct hal_axis_cfg c[AXES];
    od.limits.velocity = 500000; /* um/s */
    for (int i = 0; i < 2; i++) {
        od.axis[i].plant.encoder = i == 0 ? 1000000 : 2000000; /* 10 fm: 10 and 20 nm */
        od.axis[i].wiring.full_scale = 123456 + (uint32_t)i;
        od.axis[i].wiring.index_counts = 4321 + (uint32_t)i;
    }
    for (int i = 0; i < 2; i++) { /* each flag of each axis by itself */
        for (int flag = 0; flag < 3; flag++) {
            struct od_wiring *w = &od.axis[i].wiring;
            w->output = flag == 0;
            w->invert_force = flag == 1;
            w->invert_encoder = flag == 2;
            configuration_hal(&od, c);
            TEST_ASSERT_EQUAL(flag == 0 ? HAL_OUTPUT_PWM : HAL_OUTPUT_DAC, c[i].output);
            TEST_ASSERT_EQUAL(flag == 1, c[i].invert_force);
            TEST_ASSERT_EQUAL(flag == 2, c[i].invert_encoder);
            w->invert_encoder = false;
            configuration_hal(&od, c);
            TEST_ASSERT_FALSE(c[i].invert_encoder);
        }
    }
    od.axis[0].wiring.output = 2;
    od.axis[1].wiring.offset = -1234;
    od.pwm.frequency = 20000;
    od.pwm.duty_min = 100;
    od.pwm.duty_max = 900;
    for (int mode = 0; mode < 2; mode++) {
        od.pwm.mode = (uint8_t)mode;
        configuration_hal(&od, c);
        for (int i = 0; i < 2; i++) {
            TEST_ASSERT_EQUAL(i == 0 ? HAL_OUTPUT_SPI_DAC : HAL_OUTPUT_DAC, c[i].output);
            TEST_ASSERT_EQUAL_INT16(i == 0 ? 0 : -1234, c[i].offset);
            TEST_ASSERT_EQUAL_UINT32(20000, c[i].pwm.hz);
            TEST_ASSERT_EQUAL(mode == 1, c[i].pwm.antiphase);
            TEST_ASSERT_EQUAL_UINT16(100, c[i].pwm.duty_min);
            TEST_ASSERT_EQUAL_UINT16(900, c[i].pwm.duty_max);
        }
    }
    TEST_ASSERT_EQUAL_UINT32(123456, c[0].full_scale_mN);
    TEST_ASSERT_EQUAL_UINT32(123457, c[1].full_scale_mN);
    TEST_ASSERT_EQUAL_UINT32(4321, c[0].index_counts);
    TEST_ASSERT_EQUAL_UINT32(4322, c[1].index_counts);
    TEST_ASSERT_EQUAL_UINT32(4 * 5000 + 100, c[0].jump_counts); /* 50 um in 0.1 ms */
    TEST_ASSERT_EQUAL_UINT32(4 * 2500 + 100, c[1].jump_counts);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_plant_of_each_axis);
    RUN_TEST(test_motor_of_each_axis);
    RUN_TEST(test_contouring_law);
    RUN_TEST(test_watch_for_oscillation);
    RUN_TEST(test_uncertainty_compensator);
    RUN_TEST(test_cascade);
    RUN_TEST(test_contour_estimator);
    RUN_TEST(test_geometry_of_each_axis);
    RUN_TEST(test_force_across_a_gap_is_half_of_the_largest_at_most);
    RUN_TEST(test_geometry_is_on_where_there_is_any);
    RUN_TEST(test_second_encoder_of_each_axis);
    RUN_TEST(test_control_period);
    RUN_TEST(test_observer_has_its_poles_where_the_bandwidth_says);
    RUN_TEST(test_learned_feedforward);
    RUN_TEST(test_delay_of_each_axis_is_on_where_there_is_one);
    RUN_TEST(test_friction_of_each_axis_is_on_where_it_is_more_than_a_sign);
    RUN_TEST(test_screw_of_each_axis_is_on_where_it_has_a_lead);
    RUN_TEST(test_observer_is_slower_for_coarse_encoders_by_the_fourth_root);
    RUN_TEST(test_force_filters_of_each_axis);
    RUN_TEST(test_continuous_force_of_each_axis);
    RUN_TEST(test_force_filters_have_frequencies_below_half_the_control_rate);
    RUN_TEST(test_continuous_force_is_at_least_a_fiftieth_of_the_force_limit);
    RUN_TEST(test_defaults_fit);
    RUN_TEST(test_soft_limits_are_no_empty_range);
    RUN_TEST(test_map_of_a_screw_has_two_points_or_more);
    RUN_TEST(test_error_once_a_turn_is_flatter_than_half_the_travel);
    RUN_TEST(test_map_of_a_screw_is_monotonic);
    RUN_TEST(test_k_bar_times_e_max_is_at_most_4);
    RUN_TEST(test_k_0_is_at_most_k_max);
    RUN_TEST(test_mu_0_is_at_most_mu_max);
    RUN_TEST(test_wiring_of_each_axis_for_the_hal);
    return UNITY_END();
}
