/* SPDX-License-Identifier: Apache-2.0 */
/* What the background makes of streams and jogs, test_drive.h. */
#include "test_drive.h"

static void test_discarded_stream_leaves_an_axis_with_power_at_its_reference_and_the_other_one_where_it_is(void)
{
    for (int axis = 0; axis < 2; axis++) {
        setUp();
        ms(3);
        command(0x06, 0x06);
        command(axis == 0 ? 0x0F : 0x06, axis == 1 ? 0x0F : 0x06);
        ms(2);
        wires.count[0] += 5; /* they yield to a force: 381 nm */
        wires.count[1] += 5;
        ms(300);
        TEST_ASSERT_EQUAL_HEX32(0, drive_stream_command(&drive, STREAM_COMMAND_DISCARD));
        TEST_ASSERT_EQUAL_INT32(0, knots.start.nm[axis]);
        TEST_ASSERT_INT32_WITHIN(1, 381, knots.start.nm[1 - axis]);
    }
}

static void test_stream_may_begin_in_the_millisecond_in_which_the_axes_were_enabled(void)
{
    ms(3);
    wires.count[0] = 1000000;
    wires.count[1] = -1000000;
    ms(300);
    command(0x06, 0x06);
    command(0x0F, 0x0F);
    od.stream.total = 10;
    od.stream.start_x = 76290000;
    od.stream.start_y = -76290000;
    TEST_ASSERT_EQUAL_HEX32(0, drive_stream_command(&drive, 1));
}

static void test_end_of_the_last_stream_is_not_taken_for_that_of_the_next(void)
{
    enable();
    begin(100, 100);
    command(0x1F, 0x1F);
    ms(110);
    TEST_ASSERT_EQUAL_UINT8(STREAM_DONE, od.stream.state);
    TEST_ASSERT_EQUAL_UINT32(100, od.stream.executed);
    command(0x0F, 0x0F);
    begin(100, 100);
    step(0); /* before the tick has seen it */
    TEST_ASSERT_EQUAL_UINT8(STREAM_FILLING, od.stream.state);
    TEST_ASSERT_EQUAL_UINT32(0, od.stream.executed);
    command(0x1F, 0x1F);
    ms(110);
    TEST_ASSERT_EQUAL_UINT8(STREAM_DONE, od.stream.state);
}

static void test_end_is_reported_with_all_knots_executed(void)
{
    enable();
    begin(100, 100);
    command(0x1F, 0x1F);
    while (od.stream.state != STREAM_DONE) {
        tick(1);
        step(0);
    }
    TEST_ASSERT_EQUAL_UINT32(100, od.stream.executed);
    TEST_ASSERT_EQUAL_HEX16(0x0400, od.axis[0].statusword & 0x1400);
    TEST_ASSERT_EQUAL_HEX16(0x0400, od.axis[1].statusword & 0x1400);
}

static void test_jog_begins_from_where_the_axes_are_held_and_runs_in_the_step_that_begins_it(void)
{
    od.axis[0].mode = od.axis[1].mode = MODE_PROFILE_VELOCITY;
    od.axis[0].target_velocity = 10000;
    enable();
    TEST_ASSERT_FALSE(drive.path.modes.generating); /* this step holds the axes, so that the tick starts a new path */
    while (!drive.path.modes.generating) {
        TEST_ASSERT_FALSE(atomic_load(&drive.loop.command.run));
        TEST_ASSERT_LESS_THAN(10, drive_now(&drive) / 10u);
        ms(1);
    }
    TEST_ASSERT_TRUE(atomic_load(&drive.loop.command.run));
}

static void test_underrun_counts_once_however_long_it_lasts(void)
{
    enable();
    begin(1000, 300);
    command(0x1F, 0x1F);
    ms(320);
    for (uint32_t i = 300; i < 900; i++) {
        path_push(&drive.path, (struct knot){{0, 0}});
        ms(1);
    }
    TEST_ASSERT_EQUAL_UINT32(1, od.stream.underruns);
    TEST_ASSERT_EQUAL_UINT8(STREAM_RUNNING, od.stream.state);
    ms(500);
    TEST_ASSERT_EQUAL_HEX16(0xFF10, od.axis[0].error_code);
}

/* A knot comes after the tick has seen an open-ended stream at rest, before the background asks for it. */
static void rest_and_then(int32_t nm, unsigned more)
{
    enable();
    begin(0, 100);
    command(0x1F, 0x1F);
    ms(1);
    for (int i = 0; i < 10000 && !atomic_load(&drive.loop.at_end); i++) {
        tick(1);
        queue_executed(&drive.path.queue, atomic_load(&drive.loop.executed));
    }
    TEST_ASSERT_TRUE(atomic_load(&drive.loop.at_end));
    for (unsigned i = 0; i < more; i++) {
        TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, path_push(&drive.path, (struct knot){{nm, 0}}));
    }
    step(0);
}

static void test_knot_that_comes_at_the_last_moment_keeps_an_open_ended_stream_from_ending(void)
{
    rest_and_then(5, 1);
    TEST_ASSERT_TRUE(od.stream.state != STREAM_DONE && drive.path.queue.open);
    TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, path_push(&drive.path, (struct knot){{5, 0}}));
}

static void test_last_knots_that_come_at_the_last_moment_are_gone_through_before_the_stream_ends(void)
{
    for (int32_t nm = 0; nm <= 5; nm += 5) { /* resting, and on to somewhere else */
        setUp();
        rest_and_then(nm, 5);
        TEST_ASSERT_TRUE(od.stream.state != STREAM_DONE && drive.path.queue.open);
        ms(200);
        TEST_ASSERT_EQUAL_UINT8(STREAM_DONE, od.stream.state);
        TEST_ASSERT_EQUAL_UINT32(105, od.stream.executed);
        TEST_ASSERT_EQUAL_INT32(nm, servo_loop_snapshot(&drive.loop)->reference_nm[0]);
        TEST_ASSERT_EQUAL_HEX32(0, drive.faults);
    }
}

static void test_new_stream_may_not_end_before_it_has_knots_as_the_last_one_did(void)
{
    rest_and_then(0, 0);
    TEST_ASSERT_EQUAL_UINT8(STREAM_DONE, od.stream.state);
    TEST_ASSERT_TRUE(atomic_load(&drive.loop.command.may_end));
    command(0x0F, 0x0F);
    begin(0, 0);
    TEST_ASSERT_FALSE(atomic_load(&drive.loop.command.may_end));
    TEST_ASSERT_FALSE(atomic_load(&drive.loop.command.complete));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_discarded_stream_leaves_an_axis_with_power_at_its_reference_and_the_other_one_where_it_is);
    RUN_TEST(test_stream_may_begin_in_the_millisecond_in_which_the_axes_were_enabled);
    RUN_TEST(test_end_of_the_last_stream_is_not_taken_for_that_of_the_next);
    RUN_TEST(test_end_is_reported_with_all_knots_executed);
    RUN_TEST(test_jog_begins_from_where_the_axes_are_held_and_runs_in_the_step_that_begins_it);
    RUN_TEST(test_underrun_counts_once_however_long_it_lasts);
    RUN_TEST(test_knot_that_comes_at_the_last_moment_keeps_an_open_ended_stream_from_ending);
    RUN_TEST(test_last_knots_that_come_at_the_last_moment_are_gone_through_before_the_stream_ends);
    RUN_TEST(test_new_stream_may_not_end_before_it_has_knots_as_the_last_one_did);
    return UNITY_END();
}
