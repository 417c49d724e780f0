/* SPDX-License-Identifier: Apache-2.0 */
/* Faults of axes, encoders, amplifiers and inputs, one after the other (supervision/faults.toml). */
#include <math.h>
#include <stdlib.h>

#include "test_faults.h"

void setUp(void)
{
    power_on();
}

void tearDown(void)
{
}

static const struct ks_machine *nominal_machine(void)
{
    static struct ks_machine machine;
    machine = rig_machine();
    return &machine;
}

static void block(int axis, bool blocked)
{
    rig.plant.machine.coulomb_N[axis] = blocked ? 1e6 : nominal_machine()->coulomb_N[axis];
}

static void wait_for_force(int axis, int32_t dN)
{
    for (unsigned i = 0; i < 3000 && labs((long)servo_loop_snapshot(&rig.device.drive.loop)->force_dN[axis]) < dN;
         i++) {
        rig_run(&rig, 1);
    }
}

/* The true position of y is further from its reference than that. */
static double window_nm;

static bool off_its_reference(void)
{
    const pos_t reference = pos_add(rig.device.drive.loop.servo.observer[1].pos, n_neg(last_out()->contour.e_w.y));
    return fabs(rig.plant.pos_m[1] * 1e9 - pos_to_nm(reference)) > window_nm;
}

static void test_following_error_cuts_the_power(void)
{
    rig_write(&rig, 0x2121, 1, 2, 0);
    be_on_the_way();
    block(1, true);
    window_nm = 2e6;
    wait_for(ROW_FOLLOWING, off_its_reference, 0);
    expect_reaction(ROW_FOLLOWING);
    block(1, false);
    expect_clearing(ROW_FOLLOWING, 0);
}

static void test_following_error_may_last_as_long_as_6066h_says(void)
{
    rig_write(&rig, 0x6865, 0, 4, 100000);
    rig_write(&rig, 0x6866, 0, 2, 20);
    rig_write(&rig, 0x2121, 1, 2, 0);
    be_on_the_way();
    block(1, true);
    window_nm = 100000;
    wait_for(ROW_FOLLOWING, off_its_reference, 200);
    expect_reaction(ROW_FOLLOWING);
}

static bool too_fast(void)
{
    return n_to_scaled(last_out()->velocity.x, 200) >= 45000;
}

static void test_overspeed_cuts_the_power(void)
{
    rig_write(&rig, 0x2130, 1, 4, 45000); /* 45 mm/s */
    be_on_the_way();
    wait_for(ROW_OVERSPEED, too_fast, 0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 45e-3, rig.plant.vel_mps[0]);
    expect_reaction(ROW_OVERSPEED);
    expect_clearing(ROW_OVERSPEED, 0);
}

/* Pushed, 1 um in a period, until it is further out than the soft limit and the window */
static bool pushed_out(void)
{
    rig.plant.pos_m[0] += 1e-6;
    return rig.plant.pos_m[0] > 1.1e-3;
}

static void test_travel_beyond_the_limits_and_its_reference_cuts_the_power(void)
{
    rig_write(&rig, 0x607D, 2, 4, 1000000); /* 1 mm */
    rig_write(&rig, 0x6065, 0, 4, 100000);  /* 0.1 mm, */
    rig_write(&rig, 0x6066, 0, 2, 1000);    /* which may last */
    rig_enable(&rig);
    rig.emcy_count = 0;
    block(0, true);
    rig_run(&rig, 3); /* so that it is not in the last period of a millisecond, when the background helps */
    wait_for(ROW_TRAVEL, pushed_out, 0);
    expect_reaction(ROW_TRAVEL);
    block(0, false);
    expect_clearing(ROW_TRAVEL, 0);
}

static void test_amplifier_fault_cuts_the_power(void)
{
    be_on_the_way();
    rig.inputs[1] = HAL_AMPLIFIER_FAULT;
    expect_reaction(ROW_AMPLIFIER);
    rig.inputs[1] = 0;
    expect_clearing(ROW_AMPLIFIER, 0);
}

static void test_amplifier_and_stop_are_back_at_once_while_they_last(void)
{
    const struct {
        uint8_t input;
        enum row row;
    } inputs[] = {{HAL_AMPLIFIER_FAULT, ROW_AMPLIFIER}, {HAL_STOP, ROW_STOP}};
    for (unsigned i = 0; i < 2; i++) {
        power_on();
        be_on_the_way();
        rig.inputs[0] = inputs[i].input;
        expect_reaction(inputs[i].row);
        rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
        rig_ms(&rig, 2);
        rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
        TEST_ASSERT_EQUAL_HEX16(promises[inputs[i].row].emcy, rig_read(&rig, 0x603F, 0));
    }
}

static void test_encoder_transition_that_no_movement_makes_cuts_the_power(void)
{
    be_on_the_way();
    rig.inputs[0] = HAL_ENCODER_FAULT; /* of one period */
    rig_run(&rig, 1);
    rig.inputs[0] = 0;
    expect_reaction(ROW_ENCODER);
    expect_clearing(ROW_ENCODER, 0);
}

static void test_encoder_jump_cuts_the_power(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        power_on();
        be_on_the_way();
        rig.lost[1] = sign * 4000; /* 0.3 mm: 3 m/s */
        expect_reaction(ROW_ENCODER_JUMP);
        expect_clearing(ROW_ENCODER_JUMP, 0);
    }
}

static void test_second_encoder_that_disagrees_cuts_the_power(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        power_on();
        rig.plant.machine.scale_m[0] = 1e-8; /* as from power-on: it stands at 0 */
        rig_write(&rig, 0x210A, 1, 4, 1000000);
        rig_write(&rig, 0x210A, 3, 4, 200000); /* 200 um */
        rig_ms(&rig, 5);
        be_on_the_way();
        rig.second_lost[0] = sign * 21000;
        expect_reaction(ROW_SECOND_ENCODER);
        rig.second_lost[0] = 0;
        expect_clearing(ROW_SECOND_ENCODER, 0);
    }
}

static void test_encoder_frozen_while_the_axis_is_pushed_cuts_the_power(void)
{
    stream.length_nm = 4e6; /* up to 5 mm/s, 2 um in 0.5 ms */
    be_on_the_way();
    rig.frozen[0] = true;
    wait_for_force(0, 3000);
    const unsigned n = periods_to_detect(ROW_ENCODER_FROZEN, 210);
    TEST_ASSERT_TRUE_MESSAGE(n >= 200, "2121h:1");
    expect_reaction(ROW_ENCODER_FROZEN);
    rig.frozen[0] = false;
    rig_ms(&rig, 2000); /* it runs out */
    expect_clearing(ROW_ENCODER_FROZEN, 0);
}

static void test_encoder_frozen_at_rest_is_no_fault(void)
{
    rig_enable(&rig);
    rig.frozen[0] = rig.frozen[1] = true;
    rig_ms(&rig, 500);
    TEST_ASSERT_EQUAL_HEX32(0, rig.device.drive.faults | rig.device.drive.warnings);
}

static void test_stop_input_stops_on_the_path(void)
{
    be_on_the_way();
    rig.inputs[0] = rig.inputs[1] = HAL_STOP;
    expect_reaction(ROW_STOP);
    rig.inputs[0] = rig.inputs[1] = 0;
    expect_clearing(ROW_STOP, 0);
}

static void test_stop_input_cuts_the_power_where_605Ah_is_0(void)
{
    rig_write(&rig, 0x685A, 0, 2, 0);
    be_on_the_way();
    rig.inputs[0] = rig.inputs[1] = HAL_STOP;
    expect_reaction(ROW_STOP);
    rig.inputs[0] = rig.inputs[1] = 0;
    expect_clearing(ROW_STOP, 0);
}

static void test_limit_switch_stops_on_the_path(void)
{
    be_on_the_way();
    rig.inputs[0] = HAL_LIMIT_MAX;
    expect_reaction(ROW_LIMIT_SWITCH);
    rig.inputs[0] = 0;
    expect_clearing(ROW_LIMIT_SWITCH, 0);
}

static void test_limit_switch_of_either_end_of_either_axis_stops_on_the_path(void)
{
    for (int i = 0; i < 4; i++) {
        power_on();
        be_on_the_way();
        rig.inputs[i / 2] = i % 2 == 0 ? HAL_LIMIT_MIN : HAL_LIMIT_MAX;
        expect_reaction(ROW_LIMIT_SWITCH);
    }
}

static void test_saturation_that_lasts_stops_on_the_path(void)
{
    rig_write(&rig, 0x2121, 1, 2, 0);
    rig_write(&rig, 0x6865, 0, 4, 100000000); /* an axis may be as far from its reference as it likes */
    be_on_the_way();
    block(1, true);
    wait_for_force(1, 5999);
    const unsigned n = periods_to_detect(ROW_SATURATION, 2510);
    TEST_ASSERT_TRUE_MESSAGE(n >= 2500, "2121h:2");
    off_path_nm = 1e9;
    expect_reaction(ROW_SATURATION);
    block(1, false);
    expect_clearing(ROW_SATURATION, 0);
}

static bool limit_of_y_is_lowered(void)
{
    return servo_loop_snapshot(&rig.device.drive.loop)->force_limit_dN[1] < 5999;
}

static void test_overload_that_lasts_stops_on_the_path(void)
{
    rig_write(&rig, 0x2121, 1, 2, 0);
    rig_write(&rig, 0x6865, 0, 4, 100000000);
    rig_write(&rig, 0x290C, 1, 4, 300000);
    rig_write(&rig, 0x290C, 2, 4, 100);
    be_on_the_way();
    block(1, true);
    for (unsigned i = 0; i < 3000 && !limit_of_y_is_lowered(); i++) {
        rig_run(&rig, 1);
    }
    const unsigned n = periods_to_detect(ROW_OVERLOAD, 2510);
    TEST_ASSERT_TRUE_MESSAGE(n >= 1500, "2121h:2, less the time at the peak");
    TEST_ASSERT_INT32_WITHIN(150, 3000, abs((int)servo_loop_snapshot(&rig.device.drive.loop)->force_dN[1]));
    off_path_nm = 1e9;
    expect_reaction(ROW_OVERLOAD);
    block(1, false);
    expect_clearing(ROW_OVERLOAD, 0);
}

static bool y_is_hot(void)
{
    return servo_loop_snapshot(&rig.device.drive.loop)->force_heat_permille[1] >= 900;
}

static void test_heat_is_warned_of_until_it_is_less(void)
{
    rig_write(&rig, 0x290C, 1, 4, 500000);
    rig_write(&rig, 0x290C, 2, 4, 1000);
    be_on_the_way();
    rig.device.drive.loop.servo.force_limit.heat[1] = acc_from(NUM(0.93));
    wait_for(ROW_HEAT, y_is_hot, 0);
    expect_reaction(ROW_HEAT);
    expect_path_runs();
    rig_ms(&rig, 100);
    TEST_ASSERT_INT32_WITHIN(12, (int32_t)(930 * exp(-0.1)),
                             servo_loop_snapshot(&rig.device.drive.loop)->force_heat_permille[1]);
    expect_clearing(ROW_HEAT, 0);
}

static void test_heat_survives_a_change_of_parameters(void)
{
    rig_write(&rig, 0x210C, 1, 4, 500000);
    rig_ms(&rig, 2);
    rig.device.drive.loop.servo.force_limit.heat[0] = acc_from(NUM(0.5));
    rig_write(&rig, 0x2110, 1, 4, 180000);
    rig_ms(&rig, 2);
    TEST_ASSERT_INT32_WITHIN(1, 500, (int32_t)rig_read(&rig, 0x210D, 1));
    TEST_ASSERT_EQUAL_UINT32(6000, rig_read(&rig, 0x210D, 2));
    rig_write(&rig, 0x210C, 1, 4, 0);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x210D, 1));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_following_error_cuts_the_power);
    RUN_TEST(test_following_error_may_last_as_long_as_6066h_says);
    RUN_TEST(test_overspeed_cuts_the_power);
    RUN_TEST(test_travel_beyond_the_limits_and_its_reference_cuts_the_power);
    RUN_TEST(test_amplifier_fault_cuts_the_power);
    RUN_TEST(test_amplifier_and_stop_are_back_at_once_while_they_last);
    RUN_TEST(test_encoder_transition_that_no_movement_makes_cuts_the_power);
    RUN_TEST(test_encoder_jump_cuts_the_power);
    RUN_TEST(test_second_encoder_that_disagrees_cuts_the_power);
    RUN_TEST(test_encoder_frozen_while_the_axis_is_pushed_cuts_the_power);
    RUN_TEST(test_encoder_frozen_at_rest_is_no_fault);
    RUN_TEST(test_stop_input_stops_on_the_path);
    RUN_TEST(test_stop_input_cuts_the_power_where_605Ah_is_0);
    RUN_TEST(test_limit_switch_stops_on_the_path);
    RUN_TEST(test_limit_switch_of_either_end_of_either_axis_stops_on_the_path);
    RUN_TEST(test_saturation_that_lasts_stops_on_the_path);
    RUN_TEST(test_overload_that_lasts_stops_on_the_path);
    RUN_TEST(test_heat_is_warned_of_until_it_is_less);
    RUN_TEST(test_heat_survives_a_change_of_parameters);
    return UNITY_END();
}
