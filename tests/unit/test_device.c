/* SPDX-License-Identifier: Apache-2.0 */
/* The whole firmware, frame by frame, on a simulated machine: enabling, streams, stops, faults and the way back. */
#include "test_drive_rig.h"

enum {
    SHUTDOWN = 0x06,
    SWITCH_ON = 0x07,
    ENABLE = 0x0F,
    RUN = 0x1F,
    HALT = 0x11F,
    QUICK_STOP = 0x0B,
    FAULT_RESET = 0x80
};
enum { TARGET_REACHED = 10, IP_ACTIVE = 12 };
enum { IDLE, FILLING, RUNNING, STOPPING, DONE, STOPPED }; /* 2200h:5 */

#define ABORT_STATE 0x08000022u
#define ABORT_INCOMPATIBLE 0x06040043u
#define STOP_MS 100u

static struct rig rig;
static struct rig_stream stream;

void setUp(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    stream = (struct rig_stream){.count = 1500, .length_nm = 50e6}; /* 50 mm in 1.5 s: up to 67 mm/s */
}

void tearDown(void)
{
}

static uint32_t stream_state(void)
{
    return rig_read(&rig, 0x2200, 5);
}

/* ... and still on its path */
static void expect_standing_on_the_line(void)
{
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, rig.plant.vel_mps[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, rig.plant.vel_mps[1]);
    TEST_ASSERT_TRUE_MESSAGE(rig_off_line(&rig, &stream) < 1000, "off the path by more than 1 um");
}

static void expect_power(bool x, bool y)
{
    TEST_ASSERT_EQUAL(x, rig.out.enable[0]);
    TEST_ASSERT_EQUAL(y, rig.out.enable[1]);
}

/* Stop on the path that goes on: never slower than a stop from rate 1 would be, and off the path never */
static void run_on_the_line(unsigned ms)
{
    for (unsigned i = 0; i < ms; i++) {
        rig_ms(&rig, 1);
        TEST_ASSERT_TRUE_MESSAGE(rig_off_line(&rig, &stream) < 1000, "off the path by more than 1 um");
    }
}

static void reset_faults_and_enable_again(void)
{
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    rig_ms(&rig, 20);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[rig.emcy_count - 1]);
    TEST_ASSERT_EQUAL_HEX32(0, rig_read(&rig, 0x1001, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_read(&rig, 0x603F, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_read(&rig, 0x683F, 0));
    rig_enable(&rig);
    expect_power(true, true);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
}

static void expect_fault(uint16_t code)
{
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, code));
    TEST_ASSERT_EQUAL_HEX32(code, rig_read(&rig, 0x603F, 0));
    TEST_ASSERT_EQUAL_HEX32(code, rig_read(&rig, 0x683F, 0));
    TEST_ASSERT_NOT_EQUAL_HEX32(0, rig_read(&rig, 0x1001, 0));
    expect_power(false, false);
}

/* ---- enabling ---- */

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

/* ---- parameters ---- */

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

/* ---- begin ---- */

static void test_begin_is_refused_before_the_axes_are_enabled(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 3);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &stream));
}

static void test_begin_is_refused_with_a_total_of_1_or_2(void)
{
    rig_enable(&rig);
    stream.count = 1;
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &stream));
    stream.count = 2;
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &stream));
    stream.count = 3;
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
}

static void test_begin_is_refused_outside_the_start_window_of_each_axis(void)
{
    rig_enable(&rig); /* held at 0, 0; window 10 um */
    rig_write(&rig, 0x2200, 4, 4, 100);
    for (uint8_t sub = 2; sub <= 3; sub++) {
        rig_write(&rig, 0x2200, sub, 4, 10001);
        TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 1));
        rig_write(&rig, 0x2200, sub, 4, -10001);
        TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 1));
        rig_write(&rig, 0x2200, sub, 4, INT32_MIN);
        TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 1));
        rig_write(&rig, 0x2200, sub, 4, -10000);
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 1));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 2));
        rig_write(&rig, 0x2200, sub, 4, -10000);
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 1));
        rig_write(&rig, 0x2200, sub, 4, 0);
        rig_write(&rig, 0x2200, 1, 1, 1);
    }
}

static void test_begin_and_abort_are_refused_while_the_path_runs(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 500);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 1));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 2));
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 10);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 1));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, 2));
    TEST_ASSERT_EQUAL_UINT32(STOPPING, stream_state());
}

static void test_begin_is_refused_while_bit_4_is_still_set(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_begin(&rig, &stream));
    rig_controlwords(&rig, ENABLE, RUN);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
}

static void test_knots_without_a_stream_are_counted_and_change_nothing(void)
{
    rig_enable(&rig);
    rig_knot(&rig, 0, 5, 5);
    rig_knot(&rig, 7, 5, 5);
    TEST_ASSERT_EQUAL_UINT32(2, rig_read(&rig, 0x2200, 17));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 7));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 14));
}

static void test_refused_knot_is_answered_at_once_with_what_is_expected(void)
{
    rig_enable(&rig);
    rig_begin(&rig, &stream);
    rig_knot(&rig, 0, 0, 0);
    const unsigned before = rig.status_count;
    rig_knot(&rig, 2, 0, 0);
    TEST_ASSERT_EQUAL_UINT(before + 1, rig.status_count);
    TEST_ASSERT_EQUAL_UINT16(1, rig.accepted);
    TEST_ASSERT_EQUAL_UINT16(991, rig.free);
}

/* ---- a run ---- */

static void test_path_runs_to_its_end_and_is_held_there(void)
{
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream_state());
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    rig_feed(&rig, &stream, stream.count);
    rig_ms(&rig, 50);
    TEST_ASSERT_EQUAL_UINT32(FILLING, stream_state());
    TEST_ASSERT_FALSE(rig_bit(&rig, IP_ACTIVE));
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_UINT32(RUNNING, stream_state());
    TEST_ASSERT_TRUE(rig_bit(&rig, IP_ACTIVE));
    for (int i = 0; i < 15; i++) {
        run_on_the_line(99);
        TEST_ASSERT_FALSE(rig_bit(&rig, TARGET_REACHED));
        rig_feed(&rig, &stream, stream.count);
    }
    run_on_the_line(100);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_TRUE(rig_bit(&rig, TARGET_REACHED));
    TEST_ASSERT_FALSE(rig_bit(&rig, IP_ACTIVE));
    TEST_ASSERT_EQUAL_UINT32(1500, rig_read(&rig, 0x2200, 8));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 18));
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 40e-3, rig.plant.pos_m[0]);
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 30e-3, rig.plant.pos_m[1]);
    expect_standing_on_the_line();
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    expect_power(true, true);
}

static void check_feed_hold(uint16_t x, uint16_t y)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_controlwords(&rig, x, y);
    run_on_the_line(10);
    TEST_ASSERT_EQUAL_UINT32(STOPPING, stream_state());
    TEST_ASSERT_TRUE(rig_bit(&rig, IP_ACTIVE));
    run_on_the_line(STOP_MS + 190);
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    TEST_ASSERT_FALSE(rig_bit(&rig, IP_ACTIVE));
    TEST_ASSERT_FALSE(rig_bit(&rig, TARGET_REACHED));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 13));
    expect_standing_on_the_line();
    TEST_ASSERT_UINT32_WITHIN(2, 700 + STOP_MS / 2, rig_read(&rig, 0x2200, 8));
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);

    rig_controlwords(&rig, RUN, RUN);
    for (int i = 0; i < 10; i++) {
        rig_feed(&rig, &stream, stream.count);
        run_on_the_line(100);
    }
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 40e-3, rig.plant.pos_m[0]);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_clearing_bit_4_holds_the_path_and_setting_it_goes_on(void)
{
    check_feed_hold(ENABLE, ENABLE);
}

static void test_halt_holds_the_path_and_clearing_it_goes_on(void)
{
    check_feed_hold(HALT | 0x10, HALT | 0x10);
}

static void test_halt_of_one_axis_stops_both(void)
{
    check_feed_hold(RUN, HALT);
}

static void test_second_stream_follows_the_first(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    rig_controlwords(&rig, ENABLE, ENABLE);
    stream.length_nm = -20e6;
    rig_go(&rig, &stream, 1);
    TEST_ASSERT_FALSE(rig_bit(&rig, TARGET_REACHED));
    TEST_ASSERT_EQUAL_UINT32(RUNNING, stream_state());
    for (int i = 0; i < 16; i++) {
        rig_feed(&rig, &stream, stream.count);
        run_on_the_line(100);
    }
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 24e-3, rig.plant.pos_m[0]);
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, 18e-3, rig.plant.pos_m[1]);
}

static void test_second_stream_waits_for_its_own_knots(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 1600);
    rig_controlwords(&rig, ENABLE, ENABLE);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    rig_ms(&rig, 5);
    TEST_ASSERT_EQUAL_UINT32(FILLING, stream_state());
    rig_feed(&rig, &stream, 20);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 8));
    rig_feed(&rig, &stream, stream.count);
    run_on_the_line(100);
    TEST_ASSERT_EQUAL_UINT32(RUNNING, stream_state());
}

static void test_stream_that_never_started_is_stopped_when_the_axes_are_disabled(void)
{
    rig_enable(&rig);
    rig_begin(&rig, &stream);
    rig_feed(&rig, &stream, 10);
    rig_controlwords(&rig, SWITCH_ON, SWITCH_ON);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    rig_knot(&rig, 10, 0, 0);
    TEST_ASSERT_EQUAL_UINT32(10, rig_read(&rig, 0x2200, 7));
}

static void test_stopped_stream_is_given_up_by_command_2(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, STOP_MS + 200);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 2));
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream_state());
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 7));
    const double x = rig.plant.pos_m[0];
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 100);
    TEST_ASSERT_DOUBLE_WITHIN(300e-9, x, rig.plant.pos_m[0]);
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream_state());
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
}

static void test_open_ended_stream_ends_with_an_underrun_on_its_path(void)
{
    rig_enable(&rig);
    const unsigned count = stream.count;
    stream.count = 0;
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    stream.count = count;
    rig_feed(&rig, &stream, 900);
    rig_controlwords(&rig, RUN, RUN);
    run_on_the_line(1000);
    expect_fault(0xFF10);
    TEST_ASSERT_UINT32_WITHIN(2, 897, rig_read(&rig, 0x2200, 8));
    expect_standing_on_the_line();
}

static void test_energy_is_counted_from_the_reset_on(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 1600);
    const uint32_t both = rig_read(&rig, 0x2220, 2) + rig_read(&rig, 0x2220, 3);
    TEST_ASSERT_TRUE(both > 500); /* 50 mm against 70 N of friction alone: 3.5 J; heat besides */
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2220, 1, 1, 1));
    rig_ms(&rig, 1);
    TEST_ASSERT_UINT32_WITHIN(10, 0, rig_read(&rig, 0x2220, 2));
    TEST_ASSERT_UINT32_WITHIN(10, 0, rig_read(&rig, 0x2220, 3));
}

static void test_change_of_controller_during_motion_does_not_step_the_force(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 500);
    for (int controller = 0; controller < 5; controller++) {
        const int next = (controller + 1) % 5;
        double usual = 0, at = 0;
        rig_write(&rig, 0x2000, 1, 1, controller);
        rig_ms(&rig, 100);
        for (int i = 0; i < 200; i++) {
            const struct hal_drive_out before = rig.out;
            if (i == 100) {
                rig_write(&rig, 0x2000, 1, 1, next);
            }
            rig_run(&rig, 1);
            const double step = fmax(fabs((double)rig.out.force_mN[0] - before.force_mN[0]),
                                     fabs((double)rig.out.force_mN[1] - before.force_mN[1]));
            usual = i < 100 ? fmax(usual, step) : usual;
            at = i == 100 ? step : at;
        }
        TEST_ASSERT_TRUE_MESSAGE(at <= usual + 100, "more than 0.1 N above the largest step of the 10 ms before");
        run_on_the_line(20);
        rig_feed(&rig, &stream, stream.count);
    }
}

/* ---- leaving ---- */

static void check_leaving(uint16_t controlword, unsigned state)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_controlwords(&rig, controlword, controlword);
    run_on_the_line(STOP_MS - 10);
    expect_power(true, true);
    run_on_the_line(20);
    rig_expect_states(&rig, state, state);
    expect_power(false, false);
    expect_standing_on_the_line();
    rig_knot(&rig, (uint8_t)stream.sent, 0, 0);
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, 17)); /* closed */
}

static void test_disable_operation_stops_on_the_path_first(void)
{
    check_leaving(SWITCH_ON, RIG_SWITCHED_ON);
}

static void test_shutdown_stops_on_the_path_first(void)
{
    check_leaving(SHUTDOWN, RIG_READY);
}

static void test_quick_stop_stops_on_the_path_first(void)
{
    check_leaving(QUICK_STOP, RIG_DISABLED);
}

static void test_quick_stop_of_one_axis_stops_both_on_the_path(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_controlwords(&rig, QUICK_STOP, RUN);
    rig_expect_states(&rig, RIG_QUICK_STOP, RIG_ENABLED);
    run_on_the_line(STOP_MS + 20);
    rig_expect_states(&rig, RIG_DISABLED, RIG_ENABLED);
    expect_power(false, true);
    expect_standing_on_the_line();
}

static void test_disable_voltage_cuts_the_power_at_once(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_controlwords(&rig, 0, 0);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    rig_run(&rig, 1);
    expect_power(false, false);
    TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[0]);
    TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[1]);
}

static void check_nmt(uint8_t command)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig_nmt(&rig, command);
    run_on_the_line(STOP_MS - 10);
    expect_power(true, true);
    run_on_the_line(20);
    expect_power(false, false);
    expect_standing_on_the_line();
    rig_nmt(&rig, 1);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    rig_enable(&rig);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
}

static void test_nmt_stop_during_motion_stops_on_the_path(void)
{
    check_nmt(2);
}

static void test_nmt_pre_operational_during_motion_stops_on_the_path(void)
{
    check_nmt(128);
}

static void test_reset_communication_during_motion_stops_on_the_path(void)
{
    check_nmt(130);
}

static void test_reset_node_during_motion_cuts_the_power_at_once(void)
{
    rig_write(&rig, 0x2110, 1, 4, 150000);
    rig_enable(&rig);
    rig_go(&rig, &stream, 300);
    const uint16_t tick = rig.tick;
    rig_nmt(&rig, 129);
    rig_run(&rig, 1);
    expect_power(false, false);
    TEST_ASSERT_EQUAL_UINT(2, rig.boot_ups);
    TEST_ASSERT_EQUAL_UINT32(200000, rig_read(&rig, 0x2110, 1)); /* default again */
    TEST_ASSERT_EQUAL_UINT32(IDLE, stream_state());
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2200, 13));
    rig_ms(&rig, 298);
    const double x = rig.plant.pos_m[0];
    rig_enable(&rig);
    TEST_ASSERT_UINT16_WITHIN(10, tick + 300, rig.tick); /* time since power-on goes on */
    TEST_ASSERT_DOUBLE_WITHIN(200e-9, x, rig.plant.pos_m[0]);
    TEST_ASSERT_EQUAL_UINT16(992, rig.free);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_reset_node_clears_faults(void)
{
    rig_enable(&rig);
    rig.inputs[1] = HAL_AMPLIFIER_FAULT;
    rig_ms(&rig, 2);
    rig.inputs[1] = 0;
    expect_fault(0x5400);
    rig_nmt(&rig, 129);
    rig_ms(&rig, 3);
    TEST_ASSERT_EQUAL_HEX32(0, rig_read(&rig, 0x603F, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_read(&rig, 0x1001, 0));
    rig_enable(&rig);
}

/* ---- faults ---- */

static void test_lost_heartbeat_stops_on_the_path_then_faults(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 500);
    rig.heartbeat_every_ms = 0;
    run_on_the_line(230); /* 200 ms from the last one on */
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x8130));
    rig_expect_states(&rig, RIG_REACTION, RIG_REACTION);
    expect_power(true, true);
    TEST_ASSERT_TRUE(rig_bit(&rig, IP_ACTIVE));
    run_on_the_line(STOP_MS);
    expect_fault(0x8130);
    expect_standing_on_the_line();
    TEST_ASSERT_EQUAL_HEX32(0x11, rig_read(&rig, 0x1001, 0));
    TEST_ASSERT_EQUAL_UINT(1, rig.emcy_count);
    rig_ms(&rig, 1000);
    TEST_ASSERT_EQUAL_UINT(1, rig.emcy_count);
    reset_faults_and_enable_again();
}

static void test_lost_heartbeat_without_power_does_nothing(void)
{
    rig_enable(&rig);
    rig_ms(&rig, 100);
    rig_controlwords(&rig, 0, 0);
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 1000);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    rig_enable(&rig);
}

static void test_underrun_stops_on_the_path_then_faults(void)
{
    rig_enable(&rig);
    rig_begin(&rig, &stream);
    rig_feed(&rig, &stream, 800);
    rig_controlwords(&rig, RUN, RUN);
    run_on_the_line(900);
    expect_fault(0xFF10);
    expect_standing_on_the_line();
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, 18));
    TEST_ASSERT_UINT32_WITHIN(2, 797, rig_read(&rig, 0x2200, 8));
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    reset_faults_and_enable_again();
}

static void test_hiccup_of_the_stream_slows_the_path_without_a_fault(void)
{
    rig_enable(&rig);
    rig_begin(&rig, &stream);
    rig_feed(&rig, &stream, 800);
    rig_controlwords(&rig, RUN, RUN);
    run_on_the_line(800);
    TEST_ASSERT_UINT32_WITHIN(200, 400, rig_read(&rig, 0x2200, 13));
    TEST_ASSERT_TRUE(rig_bit(&rig, IP_ACTIVE));
    rig_feed(&rig, &stream, stream.count);
    run_on_the_line(800);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, 18));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_knot_outside_the_limits_stops_on_the_path_then_faults(void)
{
    rig_write(&rig, 0x607D, 2, 4, 20000000);
    rig_enable(&rig);
    rig_go(&rig, &stream, 400);
    TEST_ASSERT_TRUE(rig.accepted < stream.count);
    run_on_the_line(800);
    expect_fault(0xFF11);
    TEST_ASSERT_TRUE(rig.plant.pos_m[0] < 20e-3);
    stream.length_nm = -10e6;
    reset_faults_and_enable_again();
}

static void test_knot_outside_the_limits_before_the_start_faults_at_once(void)
{
    rig_write(&rig, 0x2130, 4, 4, 1000000); /* 1000 m/s2 */
    rig_enable(&rig);
    rig_begin(&rig, &stream);
    for (int i = 0; i < 30; i++) {
        rig_knot(&rig, (uint8_t)i, 900000 * (i < 9 ? i : 9), 0);
    }
    rig_ms(&rig, 2);
    expect_fault(0xFF11);
    reset_faults_and_enable_again();
}

static void test_blocked_axis_trips_by_its_following_error(void)
{
    rig_write(&rig, 0x2121, 1, 2, 0); /* nor by an encoder that stands */
    rig_enable(&rig);
    rig_go(&rig, &stream, 400);
    rig.plant.machine.coulomb_N[1] = 1e6;
    unsigned ms = 0;
    while (rig.out.enable[0] && ms++ < 500) {
        rig_ms(&rig, 1);
        TEST_ASSERT_INT32_WITHIN(2100000, 0, (int32_t)rig_read(&rig, 0x68F4, 0)); /* window 2 mm, 67 um a ms */
    }
    rig_ms(&rig, 1);
    expect_fault(0x8611);
    rig.plant.machine.coulomb_N[1] = 54.8;
    rig_ms(&rig, 200);
    reset_faults_and_enable_again();
}

static void test_axis_faster_than_its_limit_trips(void)
{
    rig_write(&rig, 0x2130, 1, 4, 30000); /* 30 mm/s; the line asks x for 53 mm/s */
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    expect_fault(0x8400);
    TEST_ASSERT_TRUE(hypot(rig.plant.vel_mps[0], rig.plant.vel_mps[1]) < 0.06);
}

static void test_axis_outside_its_limits_is_enabled_and_held_but_no_stream_leads_further_out(void)
{
    static const struct {
        uint16_t index;
        uint8_t sub;
        int32_t limit; /* it stands at 0; the following window of 2 mm is on top */
    } limits[] = {{0x607D, 1, 2100000}, {0x607D, 2, -2100000}, {0x687D, 1, 2100000}, {0x687D, 2, -2100000}};
    for (unsigned i = 0; i < 4; i++) {
        setUp();
        rig_write(&rig, limits[i].index, limits[i].sub, 4, limits[i].limit);
        rig_nmt(&rig, 1);
        rig_ms(&rig, 3);
        rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
        rig_controlwords(&rig, ENABLE, ENABLE);
        rig_ms(&rig, 2);
        rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
        stream.length_nm = limits[i].sub == 1 ? -50e6 : 50e6;
        TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
        rig_feed(&rig, &stream, 1000);
        rig_ms(&rig, 2);
        expect_fault(0xFF11);
        TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, 20));
    }
}

/* ---- telemetry ---- */

static int32_t i24(const uint8_t *data)
{
    const uint32_t u = co_get(data, 3);
    return (int32_t)(u ^ 0x800000u) - 0x800000;
}

static int16_t i16(const uint8_t *data)
{
    return (int16_t)(uint16_t)co_get(data, 2);
}

static void test_telemetry_carries_the_low_24_bits_of_a_position_and_no_error_without_power(void)
{
    struct ks_machine machine = rig_machine();
    machine.start_m[0] = 20.0e-3;
    machine.start_m[1] = -1.5e-3;
    rig_start(&rig, &machine);
    rig_nmt(&rig, 1);
    rig_ms(&rig, 100);
    const uint8_t *error = rig.telemetry[0].data, *position = rig.telemetry[1].data;
    const int32_t x = (int32_t)rig_read(&rig, 0x6064, 0), y = (int32_t)rig_read(&rig, 0x6864, 0);
    TEST_ASSERT_INT32_WITHIN(39, 20000000, x);
    TEST_ASSERT_INT32_WITHIN(39, -1500000, y);
    TEST_ASSERT_EQUAL_INT32(x - 0x1000000, i24(&position[2]));
    TEST_ASSERT_EQUAL_INT32(y, i24(&position[5]));
    TEST_ASSERT_EQUAL_INT32(0, i24(&error[2]));
    TEST_ASSERT_EQUAL_INT32(0, i24(&error[5]));
    TEST_ASSERT_EQUAL_UINT16(100, co_get(&error[0], 2));
    TEST_ASSERT_EQUAL_UINT16(100, co_get(&position[0], 2));
    TEST_ASSERT_EQUAL_UINT32(100, rig_read(&rig, 0x2020, 3));
    TEST_ASSERT_EQUAL_INT32(0, (int32_t)rig_read(&rig, 0x60F4, 0));
    TEST_ASSERT_EQUAL_INT32(0, (int32_t)rig_read(&rig, 0x68F4, 0));
}

static void test_telemetry_carries_forces_gains_and_energy_in_their_units(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 695);
    do { /* TPDO4 comes every 10 ms, TPDO5 every 20 */
        rig_ms(&rig, 1);
    } while (rig.telemetry_ms[2] != rig.ms - 1 || rig.telemetry_ms[3] != rig.ms - 1);
    const uint8_t *force = rig.telemetry[2].data, *energy = rig.telemetry[3].data;
    TEST_ASSERT_TRUE(rig.out.force_mN[0] != rig.out.force_mN[1]);
    TEST_ASSERT_INT16_WITHIN(1, rig.out.force_mN[0] / 100, i16(&force[0]));
    TEST_ASSERT_INT16_WITHIN(1, rig.out.force_mN[1] / 100, i16(&force[2]));
    const struct servo_snapshot *s = servo_loop_snapshot(&rig.device.drive.loop);
    TEST_ASSERT_EQUAL_UINT16(s->adaptive_gain_per_10s[0], co_get(&force[4], 2));
    TEST_ASSERT_EQUAL_UINT16(s->adaptive_gain_per_10s[1], co_get(&force[6], 2));
    TEST_ASSERT_EQUAL_UINT16(s->switching_gain_mmps2[0], co_get(&energy[0], 2));
    TEST_ASSERT_EQUAL_UINT16(s->switching_gain_mmps2[1], co_get(&energy[2], 2));
    TEST_ASSERT_UINT32_WITHIN(200, rig_read(&rig, 0x2220, 2) + rig_read(&rig, 0x2220, 3), co_get(&energy[4], 4));
    TEST_ASSERT_TRUE(co_get(&energy[4], 4) > 1000);
    TEST_ASSERT_INT32_WITHIN(3000, (int32_t)lround(rig.plant.vel_mps[0] * 1e6), (int32_t)rig_read(&rig, 0x606C, 0));
    TEST_ASSERT_INT32_WITHIN(3000, (int32_t)lround(rig.plant.vel_mps[1] * 1e6), (int32_t)rig_read(&rig, 0x686C, 0));
}

static void test_fault_input_cuts_the_power_in_the_same_period(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 700);
    rig.inputs[1] = HAL_AMPLIFIER_FAULT;
    rig_run(&rig, 1);
    expect_power(false, false);
    TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[0]);
    rig_ms(&rig, 200);
    expect_fault(0x5400);
}

static void test_fault_cannot_be_reset_while_its_cause_is_there(void)
{
    rig_enable(&rig);
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_ms(&rig, 2);
    expect_fault(0x5400);
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_ms(&rig, 5);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    rig_controlwords(&rig, 0, 0);
    rig.inputs[0] = 0;
    reset_faults_and_enable_again();
}

static void test_background_that_was_late_makes_up_for_the_milliseconds_it_missed(void)
{
    for (int i = 0; i < 3000; i++) {
        device_tick(&rig.device);
    }
    TEST_ASSERT_EQUAL_UINT(0, rig.heartbeats);
    device_poll(&rig.device);
    TEST_ASSERT_EQUAL_UINT(3, rig.heartbeats); /* one each 100 ms */
    TEST_ASSERT_EQUAL_UINT32(300, rig_read(&rig, 0x2020, 3));
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
    RUN_TEST(test_begin_is_refused_before_the_axes_are_enabled);
    RUN_TEST(test_begin_is_refused_with_a_total_of_1_or_2);
    RUN_TEST(test_begin_is_refused_outside_the_start_window_of_each_axis);
    RUN_TEST(test_begin_and_abort_are_refused_while_the_path_runs);
    RUN_TEST(test_begin_is_refused_while_bit_4_is_still_set);
    RUN_TEST(test_knots_without_a_stream_are_counted_and_change_nothing);
    RUN_TEST(test_refused_knot_is_answered_at_once_with_what_is_expected);
    RUN_TEST(test_path_runs_to_its_end_and_is_held_there);
    RUN_TEST(test_clearing_bit_4_holds_the_path_and_setting_it_goes_on);
    RUN_TEST(test_halt_holds_the_path_and_clearing_it_goes_on);
    RUN_TEST(test_halt_of_one_axis_stops_both);
    RUN_TEST(test_second_stream_follows_the_first);
    RUN_TEST(test_second_stream_waits_for_its_own_knots);
    RUN_TEST(test_stream_that_never_started_is_stopped_when_the_axes_are_disabled);
    RUN_TEST(test_stopped_stream_is_given_up_by_command_2);
    RUN_TEST(test_open_ended_stream_ends_with_an_underrun_on_its_path);
    RUN_TEST(test_energy_is_counted_from_the_reset_on);
    RUN_TEST(test_change_of_controller_during_motion_does_not_step_the_force);
    RUN_TEST(test_disable_operation_stops_on_the_path_first);
    RUN_TEST(test_shutdown_stops_on_the_path_first);
    RUN_TEST(test_quick_stop_stops_on_the_path_first);
    RUN_TEST(test_quick_stop_of_one_axis_stops_both_on_the_path);
    RUN_TEST(test_disable_voltage_cuts_the_power_at_once);
    RUN_TEST(test_nmt_stop_during_motion_stops_on_the_path);
    RUN_TEST(test_nmt_pre_operational_during_motion_stops_on_the_path);
    RUN_TEST(test_reset_communication_during_motion_stops_on_the_path);
    RUN_TEST(test_lost_heartbeat_stops_on_the_path_then_faults);
    RUN_TEST(test_lost_heartbeat_without_power_does_nothing);
    RUN_TEST(test_underrun_stops_on_the_path_then_faults);
    RUN_TEST(test_hiccup_of_the_stream_slows_the_path_without_a_fault);
    RUN_TEST(test_knot_outside_the_limits_stops_on_the_path_then_faults);
    RUN_TEST(test_knot_outside_the_limits_before_the_start_faults_at_once);
    RUN_TEST(test_blocked_axis_trips_by_its_following_error);
    RUN_TEST(test_axis_faster_than_its_limit_trips);
    RUN_TEST(test_axis_outside_its_limits_is_enabled_and_held_but_no_stream_leads_further_out);
    RUN_TEST(test_telemetry_carries_the_low_24_bits_of_a_position_and_no_error_without_power);
    RUN_TEST(test_telemetry_carries_forces_gains_and_energy_in_their_units);
    RUN_TEST(test_fault_input_cuts_the_power_in_the_same_period);
    RUN_TEST(test_fault_cannot_be_reset_while_its_cause_is_there);
    RUN_TEST(test_background_that_was_late_makes_up_for_the_milliseconds_it_missed);
    RUN_TEST(test_statusword_goes_out_at_once_when_it_changes);
    RUN_TEST(test_controlword_by_sdo_is_as_good_as_by_pdo);
    RUN_TEST(test_reset_node_during_motion_cuts_the_power_at_once);
    RUN_TEST(test_reset_node_clears_faults);
    return UNITY_END();
}
