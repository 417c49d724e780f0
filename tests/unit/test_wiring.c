/* SPDX-License-Identifier: Apache-2.0 */
/* The wiring of 2104h on the simulated machine: its polarity is rehearsed as on a table. */
#include "test_axis_modes.h"

enum { INVERT_FORCE = 3, INVERT_ENCODER = 4, INDEX_COUNTS = 5 };
enum { FOLLOWING = 0x8611, ENCODER = 0x7305, SECOND_ENCODER = 0x7306 };
#define COUNT_MM 76.29e-6

static void wire(int axis, uint8_t sub, uint8_t size, int64_t value)
{
    set(axis, 0x2104, sub, size, value);
    rig_ms(&rig, 5);
}

static void jog(int axis, int32_t umps, unsigned ms)
{
    start_jog_mode();
    velocity(axis, umps);
    rig_ms(&rig, ms);
}

/* Command axis x forwards: it loses its power by its following error. */
static void expect_runaway(void)
{
    jog(0, 20000, 500);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, FOLLOWING));
    TEST_ASSERT_FALSE(rig.out.enable[0] || rig.out.enable[1]);
    TEST_ASSERT_LESS_THAN_DOUBLE(-0.05, reported_mm(0));
}

static void test_inverted_force_runs_away_and_faults(void)
{
    wire(0, INVERT_FORCE, 1, 1);
    expect_runaway();
    TEST_ASSERT_LESS_THAN_DOUBLE(-0.05, mm(0)); /* it has gone the wrong way */
}

static void test_inverted_encoder_runs_away_and_faults(void)
{
    wire(0, INVERT_ENCODER, 1, 1);
    expect_runaway();
    TEST_ASSERT_GREATER_THAN_DOUBLE(0.05, mm(0)); /* the right way, and faster and faster */
}

static void test_both_inverted_move_the_axis_in_its_other_direction(void)
{
    wire(0, INVERT_FORCE, 1, 1);
    wire(0, INVERT_ENCODER, 1, 1);
    jog(0, 20000, 1000);
    velocity(0, 0);
    rig_ms(&rig, 500);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_DOUBLE_WITHIN(1.0, -20, mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(2 * COUNT_MM, -mm(0), reported_mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(2 * COUNT_MM, 0, mm(1)); /* the other axis has wiring of its own */
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_each_axis_has_its_own_wiring(void)
{
    wire(1, INVERT_FORCE, 1, 1);
    wire(1, INVERT_ENCODER, 1, 1);
    jog(1, 20000, 500);
    TEST_ASSERT_LESS_THAN_DOUBLE(-5, mm(1));
    TEST_ASSERT_DOUBLE_WITHIN(2 * COUNT_MM, 0, mm(0));
}

static void test_position_goes_on_from_where_it_is_when_the_wiring_changes(void)
{
    start_at(0.0123, 0);
    wire(0, INVERT_FORCE, 1, 1);
    wire(0, INVERT_ENCODER, 1, 1);
    TEST_ASSERT_DOUBLE_WITHIN(COUNT_MM, 12.3, reported_mm(0));
    jog(0, 20000, 500);
    velocity(0, 0);
    rig_ms(&rig, 500);
    TEST_ASSERT_DOUBLE_WITHIN(3 * COUNT_MM, 2 * 12.3 - mm(0), reported_mm(0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_index_of_an_inverted_encoder_is_a_home_point(void)
{
    start_at(0.0123, 0);
    wire(0, INVERT_FORCE, 1, 1);
    wire(0, INVERT_ENCODER, 1, 1);
    set(0, 0x6098, 0, 1, 34); /* the next pulse in positive direction: at 10 mm of the plant */
    rig_enable(&rig);
    mode(0, HOMING);
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 3000);
    TEST_ASSERT_TRUE(status(0, ATTAINED));
    TEST_ASSERT_DOUBLE_WITHIN(5 * COUNT_MM, 10 - mm(0), reported_mm(0));
}

static void pass_two_index_pulses(uint32_t counts)
{
    wire(0, INDEX_COUNTS, 4, counts);
    jog(0, 50000, 600); /* pulses at 10 and 20 mm */
}

static void test_index_pulses_at_another_distance_than_the_wiring_says_are_a_fault(void)
{
    pass_two_index_pulses(100000);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, ENCODER));
}

static void test_index_pulses_at_the_distance_that_the_wiring_says_are_none(void)
{
    pass_two_index_pulses(131079); /* 10 mm / 76.29 nm */
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_GREATER_THAN_DOUBLE(20, mm(0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

/* A scale of 10 nm at the table of both axes */
static void with_second_encoders(int inverted)
{
    start_at(0, 0);
    for (int i = 0; i < 2; i++) {
        rig.plant.machine.scale_m[i] = 1e-8;
        set(i, 0x210A, 1, 4, 1000000);
        set(i, 0x210A, 4, 1, i == inverted);
    }
    rig_ms(&rig, 5);
}

static void test_second_encoder_gives_the_position_of_the_table(void)
{
    with_second_encoders(-1);
    rig.plant.machine.lead_error[0] = 1e-3; /* of which the first encoder knows nothing */
    jog(0, 20000, 1000);
    velocity(0, 0);
    rig_ms(&rig, 500);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    TEST_ASSERT_GREATER_THAN_DOUBLE(15, mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(2 * COUNT_MM, mm(0) * 1.001, reported_mm(0));
}

static void test_inverted_second_encoder_disagrees(void)
{
    for (int axis = 0; axis < 2; axis++) {
        with_second_encoders(axis);
        jog(1 - axis, 20000, 200);
        velocity(1 - axis, 0);
        rig_ms(&rig, 500);
        TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
        velocity(axis, 20000);
        rig_ms(&rig, 200);
        rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
        TEST_ASSERT_TRUE(rig_had_emcy(&rig, SECOND_ENCODER));
        TEST_ASSERT_DOUBLE_WITHIN(10, 0, mm(axis)); /* tolerance 1 mm, which both reach at 0.5 mm, and it runs out */
    }
}

static void test_count_of_a_second_encoder_goes_on_when_it_is_inverted(void)
{
    with_second_encoders(-1);
    jog(0, 20000, 500);
    velocity(0, 0);
    rig_ms(&rig, 500);
    const double at_mm = reported_mm(0);
    rig_controlwords(&rig, 0, 0);
    rig_ms(&rig, 10);
    set(0, 0x210A, 4, 1, 1);
    rig_ms(&rig, 500);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    TEST_ASSERT_DOUBLE_WITHIN(5 * COUNT_MM, at_mm, reported_mm(0));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_inverted_force_runs_away_and_faults);
    RUN_TEST(test_inverted_encoder_runs_away_and_faults);
    RUN_TEST(test_both_inverted_move_the_axis_in_its_other_direction);
    RUN_TEST(test_each_axis_has_its_own_wiring);
    RUN_TEST(test_position_goes_on_from_where_it_is_when_the_wiring_changes);
    RUN_TEST(test_index_of_an_inverted_encoder_is_a_home_point);
    RUN_TEST(test_index_pulses_at_another_distance_than_the_wiring_says_are_a_fault);
    RUN_TEST(test_index_pulses_at_the_distance_that_the_wiring_says_are_none);
    RUN_TEST(test_second_encoder_gives_the_position_of_the_table);
    RUN_TEST(test_inverted_second_encoder_disagrees);
    RUN_TEST(test_count_of_a_second_encoder_goes_on_when_it_is_inverted);
    return UNITY_END();
}
