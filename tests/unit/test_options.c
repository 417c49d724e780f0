/* SPDX-License-Identifier: Apache-2.0 */
/* What a master chooses about a shutdown (605Bh), disable operation (605Ch), a fault (605Eh) and its own loss (6007h). */
#include <math.h>

#include "test_axis_modes.h"

enum { SWITCH_ON = 0x07, AXES_AT_ONCE = 2 /* control periods */ };

static const uint16_t commands[] = {SHUTDOWN, SWITCH_ON};
static const uint16_t options[] = {0x605B, 0x605C};
static const unsigned then[] = {RIG_READY, RIG_SWITCHED_ON};

static void jog(void)
{
    start_jog_mode();
    velocity(0, 100000);
    rig_ms(&rig, 400);
    TEST_ASSERT_DOUBLE_WITHIN(1, 100, mmps(0));
}

static void lose_the_master(void)
{
    rig.heartbeat_every_ms = 0;
    for (unsigned i = 0; i < 400 && !rig_had_emcy(&rig, 0x8130); i++) {
        rig_ms(&rig, 1);
    }
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x8130));
}

static bool any_power(void)
{
    return rig.out.enable[0] || rig.out.enable[1];
}

/* The axes slow down with power, and lose it where they stand. */
static void expect_path_stop(void)
{
    TEST_ASSERT_TRUE(rig.out.enable[0] && rig.out.enable[1]);
    double speed = 0;
    for (unsigned i = 0; i < 500 && any_power(); i++) {
        speed = mmps(0);
        rig_ms(&rig, 1);
    }
    TEST_ASSERT_FALSE(any_power());
    TEST_ASSERT_DOUBLE_WITHIN(1, 0, speed); /* with the last power */
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
}

static void test_values_that_are_taken(void)
{
    static const struct {
        uint16_t index;
        int least, most;
    } rows[] = {{0x605B, 0, 1}, {0x605C, 0, 1}, {0x605E, 0, 1}, {0x6007, 1, 3}};
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        TEST_ASSERT_EQUAL_INT(1, rig_read(&rig, rows[i].index, 0));
        for (int axis = 0; axis < 2; axis++) {
            const uint16_t index = (uint16_t)(rows[i].index + 0x800 * axis);
            for (int value = rows[i].least; value <= rows[i].most; value++) {
                set(axis, rows[i].index, 0, 2, value);
                TEST_ASSERT_EQUAL_INT(value, rig_read(&rig, index, 0));
            }
            TEST_ASSERT_EQUAL_HEX32(0x06090032, rig_write(&rig, index, 0, 2, rows[i].least - 1));
            TEST_ASSERT_EQUAL_HEX32(0x06090031, rig_write(&rig, index, 0, 2, rows[i].most + 1));
        }
    }
}

static void test_option_0_of_a_command_cuts_the_power_of_its_axis_at_once(void)
{
    for (unsigned i = 0; i < 2; i++) {
        setUp();
        set(0, options[i], 0, 2, 0);
        jog();
        rig_controlwords(&rig, commands[i], ENABLE);
        rig_run(&rig, AXES_AT_ONCE);
        TEST_ASSERT_FALSE(rig.out.enable[0]);
        TEST_ASSERT_TRUE(rig.out.enable[1]);
        rig_ms(&rig, 5);
        rig_expect_states(&rig, then[i], RIG_ENABLED);
        TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    }
}

static void test_option_1_of_a_command_slows_down_and_the_option_of_the_other_command_is_not_its(void)
{
    for (unsigned i = 0; i < 2; i++) {
        setUp();
        set(0, options[1 - i], 0, 2, 0);
        jog();
        rig_controlwords(&rig, commands[i], ENABLE);
        rig_ms(&rig, 20);
        TEST_ASSERT_TRUE(rig.out.enable[0]);
        rig_ms(&rig, 500);
        TEST_ASSERT_FALSE(rig.out.enable[0]);
        TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
        rig_expect_states(&rig, then[i], RIG_ENABLED);
    }
}

static void test_option_written_while_the_axis_slows_down_is_that_of_the_next_command(void)
{
    for (unsigned i = 0; i < 2; i++) {
        setUp();
        jog();
        rig_controlwords(&rig, commands[i], ENABLE);
        rig_ms(&rig, 5);
        set(0, options[i], 0, 2, 0);
        rig_controlwords(&rig, commands[i], ENABLE);
        rig_ms(&rig, 20);
        TEST_ASSERT_TRUE(rig.out.enable[0]);
    }
}

static void test_a_lost_master_stops_on_the_path_by_default(void)
{
    jog();
    lose_the_master();
    expect_path_stop();
}

static void test_fault_reaction_0_of_either_axis_cuts_the_power_of_both(void)
{
    for (int axis = 0; axis < 2; axis++) {
        setUp();
        set(axis, 0x605E, 0, 2, 0);
        jog();
        lose_the_master();
        rig_run(&rig, AXES_AT_ONCE);
        TEST_ASSERT_FALSE(any_power());
        setUp(); /* what the tick finds, too: the stop input */
        set(axis, 0x605E, 0, 2, 0);
        jog();
        rig.inputs[0] = HAL_STOP;
        rig_run(&rig, AXES_AT_ONCE);
        TEST_ASSERT_FALSE(any_power());
    }
}

static void test_fault_reaction_0_makes_no_stop_of_a_warning(void)
{
    set(0, 0x605E, 0, 2, 0);
    for (unsigned f = 0; f < FAULTS; f++) {
        if (fault_table[f].reaction == REACT_WARN) {
            TEST_ASSERT_EQUAL(REACT_WARN, fault_reaction(&rig.device.od, (enum fault)f));
        }
    }
}

static void test_lost_master_may_cut_the_power(void)
{
    for (int axis = 0; axis < 2; axis++) {
        setUp();
        set(axis, 0x6007, 0, 2, 2);
        set(1 - axis, 0x6007, 0, 2, 3);
        jog();
        lose_the_master();
        rig_run(&rig, AXES_AT_ONCE);
        TEST_ASSERT_FALSE(any_power());
        rig_ms(&rig, 5);
        rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    }
}

static void test_lost_master_with_a_quick_stop_does_as_605Ah_says(void)
{
    for (int axis = 0; axis < 2; axis++) {
        setUp();
        set(axis, 0x6007, 0, 2, 3);
        jog();
        lose_the_master();
        expect_path_stop();
        setUp();
        set(axis, 0x6007, 0, 2, 3);
        set(0, 0x605A, 0, 2, 0);
        jog();
        lose_the_master();
        rig_run(&rig, AXES_AT_ONCE);
        TEST_ASSERT_FALSE(any_power());
    }
}

static void test_option_of_a_lost_master_is_that_of_no_other_fault(void)
{
    set(0, 0x6007, 0, 2, 2);
    jog();
    rig.inputs[0] = HAL_STOP;
    rig_ms(&rig, 5);
    TEST_ASSERT_TRUE(rig.out.enable[0]); /* y stands, so it is off */
}

static void test_flipped_bit_of_a_parameter_is_not_hidden_by_a_write(void)
{
    static const uint16_t of_faults[] = {0x605E, 0x6007};
    for (unsigned i = 0; i < 2; i++) {
        setUp();
        rig_enable(&rig);
        set(0, of_faults[i], 0, 2, 1);
        rig_ms(&rig, 100);
        rig.device.od.axis[1].plant.mass ^= 1u;
        TEST_ASSERT_EQUAL_HEX32(0x06060000, rig_write(&rig, of_faults[i], 0, 2, 1));
        rig_ms(&rig, 40);
        TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x5510));
        TEST_ASSERT_FALSE(any_power());
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_values_that_are_taken);
    RUN_TEST(test_option_0_of_a_command_cuts_the_power_of_its_axis_at_once);
    RUN_TEST(test_option_1_of_a_command_slows_down_and_the_option_of_the_other_command_is_not_its);
    RUN_TEST(test_option_written_while_the_axis_slows_down_is_that_of_the_next_command);
    RUN_TEST(test_a_lost_master_stops_on_the_path_by_default);
    RUN_TEST(test_fault_reaction_0_of_either_axis_cuts_the_power_of_both);
    RUN_TEST(test_fault_reaction_0_makes_no_stop_of_a_warning);
    RUN_TEST(test_lost_master_may_cut_the_power);
    RUN_TEST(test_lost_master_with_a_quick_stop_does_as_605Ah_says);
    RUN_TEST(test_option_of_a_lost_master_is_that_of_no_other_fault);
    RUN_TEST(test_flipped_bit_of_a_parameter_is_not_hidden_by_a_write);
    return UNITY_END();
}
