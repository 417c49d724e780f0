/* SPDX-License-Identifier: Apache-2.0 */
/* The whole firmware on a simulated machine. Enabling the axes, parameters, the controlword by SDO and the statusword by TPDO 1. */
#include <math.h>

#include "test_device.h"

static void test_controlwords_lead_both_axes_to_operation_enabled(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 3);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_expect_states(&rig, RIG_READY, RIG_READY);
    rig_controlwords(&rig, SWITCH_ON, SWITCH_ON);
    rig_expect_states(&rig, RIG_SWITCHED_ON, RIG_SWITCHED_ON);
    rig_run(&rig, 1);
    expect_power(false, false);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    rig_run(&rig, 1);
    expect_power(true, true);
}

static void test_enabled_axes_hold_their_position(void)
{
    rig_enable(&rig);
    rig_ms(&rig, 500);
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 0, rig.plant.pos_m[0]);
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 0, rig.plant.pos_m[1]);
}

static void test_axes_are_enabled_where_they_stand(void)
{
    struct ks_machine machine = rig_machine();
    machine.start_m[0] = 0.0123;
    machine.start_m[1] = -0.0456;
    rig_start(&rig, &machine);
    rig_enable(&rig);
    for (int i = 0; i < 100; i++) {
        rig_ms(&rig, 1);
        TEST_ASSERT_DOUBLE_WITHIN(200e-9, 0.0123, rig.plant.pos_m[0]);
        TEST_ASSERT_DOUBLE_WITHIN(200e-9, -0.0456, rig.plant.pos_m[1]);
    }
}

static void test_one_axis_alone_can_be_enabled_but_begins_no_stream(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 3);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords(&rig, ENABLE, SHUTDOWN);
    rig_ms(&rig, 5);
    rig_expect_states(&rig, RIG_ENABLED, RIG_READY);
    expect_power(true, false);
    TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[1]);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &stream));
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 5);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
}

static void test_an_axis_cannot_be_enabled_while_the_other_one_is_faulty(void)
{
    rig_enable(&rig);
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_ms(&rig, 2);
    rig.inputs[0] = 0;
    expect_fault(0x5400);
    rig_controlwords(&rig, FAULT_RESET, 0);
    rig_expect_states(&rig, RIG_DISABLED, RIG_FAULT);
    rig_controlwords(&rig, SHUTDOWN, 0);
    rig_controlwords(&rig, ENABLE, 0);
    rig_ms(&rig, 5);
    TEST_ASSERT_NOT_EQUAL(RIG_ENABLED, rig_state(&rig, 0));
    rig_controlwords(&rig, SHUTDOWN, FAULT_RESET);
    reset_faults_and_enable_again();
}

static void test_disabled_axis_is_not_enabled_again_while_the_other_one_moves(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_controlwords(&rig, 0, RUN); /* x loses its power, y stops on its path */
    rig_controlwords(&rig, SHUTDOWN, RUN);
    rig_controlwords(&rig, ENABLE, RUN);
    for (int i = 0; i < 200; i++) {
        const double v = rig.plant.vel_mps[1];
        rig_ms(&rig, 1);
        TEST_ASSERT_TRUE_MESSAGE(fabs(rig.plant.vel_mps[1] - v) < 2e-3, "y is jerked: more than 2 m/s2");
    }
    rig_expect_states(&rig, RIG_READY, RIG_ENABLED); /* an old command enables nothing */
    rig_controlwords(&rig, ENABLE, RUN);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream_state());
}

static void test_parameters_are_refused_while_an_axis_has_power(void)
{
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2110, 1, 4, 150000));
    TEST_ASSERT_EQUAL_UINT32(200000, rig_read(&rig, 0x2110, 1));
    rig_controlwords(&rig, ENABLE, SWITCH_ON);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2110, 1, 4, 150000));
    rig_controlwords(&rig, SWITCH_ON, SWITCH_ON);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 1, 4, 150000));
    TEST_ASSERT_EQUAL_UINT32(150000, rig_read(&rig, 0x2110, 1));
}

static void test_parameter_that_does_not_fit_another_one_is_refused_when_it_is_written(void)
{
    TEST_ASSERT_EQUAL_HEX32(ABORT_INCOMPATIBLE, rig_write(&rig, 0x2110, 7, 4, 401000)); /* k_0 above k_max */
    TEST_ASSERT_EQUAL_UINT32(100000, rig_read(&rig, 0x2110, 7));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 8, 4, 500000));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 7, 4, 401000));
    TEST_ASSERT_EQUAL_HEX32(ABORT_INCOMPATIBLE, rig_write(&rig, 0x2110, 8, 4, 400000));
    TEST_ASSERT_EQUAL_HEX32(ABORT_INCOMPATIBLE, rig_write(&rig, 0x2110, 4, 4, 1001));   /* k_bar e_max above 4 */
    TEST_ASSERT_EQUAL_HEX32(ABORT_INCOMPATIBLE, rig_write(&rig, 0x2111, 3, 4, 999999)); /* mu_max below mu_0 */
    rig_enable(&rig);
}

static void test_parameters_are_in_use_after_the_next_enabling(void)
{
    rig_write(&rig, 0x2100, 5, 4, 15258000); /* x: twice the length of a count */
    rig_ms(&rig, 1);
    rig.plant.pos_m[0] = 10e-3;
    rig_ms(&rig, 100);
    TEST_ASSERT_INT32_WITHIN(100, 20000000, (int32_t)rig_read(&rig, 0x6064, 0));
}

static void test_controller_is_the_one_selected(void)
{
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(2, rig_read(&rig, 0x2000, 2));
    for (int i = 0; i < 5; i++) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2000, 1, 1, i));
        rig_ms(&rig, 2);
        TEST_ASSERT_EQUAL_UINT32((uint32_t)i, rig_read(&rig, 0x2000, 2));
    }
}

static void test_statusword_goes_out_at_once_when_it_changes(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 5);
    const unsigned before = rig.status_count;
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    TEST_ASSERT_EQUAL_UINT(before + 1, rig.status_count);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    TEST_ASSERT_EQUAL_UINT(before + 1, rig.status_count);
}

static void test_controlword_by_sdo_is_as_good_as_by_pdo(void)
{
    rig_ms(&rig, 3);
    rig_write(&rig, 0x6040, 0, 2, SHUTDOWN);
    rig_write(&rig, 0x6840, 0, 2, SHUTDOWN);
    for (unsigned axis = 0; axis < 2; axis++) {
        const uint16_t at = (uint16_t)(0x800 * axis);
        TEST_ASSERT_EQUAL_HEX32(RIG_READY, rig_read(&rig, 0x6041 + at, 0) & 0x6F);
        rig_ms(&rig, 1);
        rig_write(&rig, 0x6040 + at, 0, 2, ENABLE);
    }
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_HEX32(RIG_ENABLED, rig_read(&rig, 0x6041, 0) & 0x6F);
    TEST_ASSERT_EQUAL_HEX32(RIG_ENABLED, rig_read(&rig, 0x6841, 0) & 0x6F);
    expect_power(true, true);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_controlwords_lead_both_axes_to_operation_enabled);
    RUN_TEST(test_enabled_axes_hold_their_position);
    RUN_TEST(test_axes_are_enabled_where_they_stand);
    RUN_TEST(test_one_axis_alone_can_be_enabled_but_begins_no_stream);
    RUN_TEST(test_an_axis_cannot_be_enabled_while_the_other_one_is_faulty);
    RUN_TEST(test_disabled_axis_is_not_enabled_again_while_the_other_one_moves);
    RUN_TEST(test_parameters_are_refused_while_an_axis_has_power);
    RUN_TEST(test_parameter_that_does_not_fit_another_one_is_refused_when_it_is_written);
    RUN_TEST(test_parameters_are_in_use_after_the_next_enabling);
    RUN_TEST(test_controller_is_the_one_selected);
    RUN_TEST(test_statusword_goes_out_at_once_when_it_changes);
    RUN_TEST(test_controlword_by_sdo_is_as_good_as_by_pdo);
    return UNITY_END();
}
