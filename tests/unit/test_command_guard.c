/* SPDX-License-Identifier: Apache-2.0 */
/* Who may command, and which commands may enable: the whole firmware, frame by frame. */
#include <math.h>

#include "drive_rig.h"

enum { SHUTDOWN = 0x06, SWITCH_ON = 0x07, ENABLE = 0x0F, RUN = 0x1F, QUICK_STOP = 0x0B, FAULT_RESET = 0x80 };
enum { HOLDER = 1, CLAIM, TICKET, ARM, REFUSED }; /* subs of 2140h */

#define ABORT_STATE 0x08000022u

static struct rig rig;

void setUp(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    rig_nmt(&rig, 1);
    rig_ms(&rig, 10);
}

void tearDown(void)
{
}

static uint32_t claim_with(uint32_t key, uint8_t id)
{
    return rig_write(&rig, 0x2140, CLAIM, 4, key << 8 | id);
}

static uint32_t claim(uint8_t id)
{
    return claim_with(0, id);
}

static uint32_t read(uint8_t sub)
{
    return rig_read(&rig, 0x2140, sub);
}

static uint32_t arm(uint32_t ticket)
{
    return rig_write(&rig, 0x2140, ARM, 4, ticket);
}

static void both(uint16_t controlword)
{
    rig_controlwords_at_once(&rig, controlword, controlword);
}

static void expect_power(bool on)
{
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL(on, rig.out.enable[0]);
    TEST_ASSERT_EQUAL(on, rig.out.enable[1]);
}

/* Held by the master of the rig (127), whose heartbeat comes */
static void hold(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, claim(127));
    rig.heartbeat_every_ms = 50;
}

static void enable_held(void)
{
    both(SHUTDOWN);
    TEST_ASSERT_EQUAL_HEX32(0, arm(read(TICKET)));
    rig_ms(&rig, 2);
    both(ENABLE);
    expect_power(true);
}

/* ---- one master ---- */

static void test_claim_is_for_who_comes_first_and_for_nobody_else_not_even_with_the_same_id(void)
{
    TEST_ASSERT_EQUAL_UINT32(0, read(HOLDER));
    TEST_ASSERT_EQUAL_HEX32(0, claim(127));
    TEST_ASSERT_EQUAL_UINT32(127, read(HOLDER));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, claim(5));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, claim(127));
    TEST_ASSERT_EQUAL_UINT32(127, read(HOLDER));
    TEST_ASSERT_EQUAL_UINT32(2, read(REFUSED));
    TEST_ASSERT_EQUAL_HEX32(0, claim(0));
    TEST_ASSERT_EQUAL_UINT32(0, read(HOLDER));
    TEST_ASSERT_EQUAL_HEX32(0, claim(5));
    TEST_ASSERT_EQUAL_UINT32(5, read(HOLDER));
}

static void test_key_tells_a_holder_from_another_one_with_the_same_id(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, claim_with(0x123456, 127));
    rig_ms(&rig, 400);
    TEST_ASSERT_EQUAL_HEX32(0, claim_with(0x123456, 127)); /* the answer was lost */
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, claim_with(0x123457, 127));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, claim_with(0x123456, 126));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, claim_with(0, 0));
    TEST_ASSERT_EQUAL_UINT32(127, read(HOLDER));
    TEST_ASSERT_EQUAL_HEX32(0, claim_with(0x123456, 0));
    TEST_ASSERT_EQUAL_UINT32(0, read(HOLDER));
    TEST_ASSERT_EQUAL_HEX32(0, claim_with(0x123456, 0));
    TEST_ASSERT_EQUAL_HEX32(0x06090030, claim(128));
    TEST_ASSERT_EQUAL_HEX32(0, claim_with(5, 127));
    rig_ms(&rig, 400);
    TEST_ASSERT_EQUAL_HEX32(0, claim_with(5, 127)); /* no heartbeat for all that */
    rig_ms(&rig, 103);
    TEST_ASSERT_EQUAL_UINT32(0, read(HOLDER));
}

static void test_holder_whose_heartbeat_never_comes_loses_the_drive(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, claim(127));
    rig_ms(&rig, 499);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, claim(5));
    rig_ms(&rig, 3);
    TEST_ASSERT_EQUAL_UINT32(0, read(HOLDER));
    TEST_ASSERT_EQUAL_HEX32(0, claim(5));
}

static void test_heartbeat_keeps_the_claim_and_others_do_not(void)
{
    hold();
    rig_ms(&rig, 2000);
    TEST_ASSERT_EQUAL_UINT32(127, read(HOLDER));
    TEST_ASSERT_EQUAL_HEX32(0, claim(0));
    TEST_ASSERT_EQUAL_HEX32(0, claim(5)); /* what comes is that of 127 */
    rig_ms(&rig, 502);
    TEST_ASSERT_EQUAL_UINT32(0, read(HOLDER));
}

static void test_time_of_1016h_is_that_of_its_node_alone(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1016, 1, 4, 5 << 16 | 100));
    TEST_ASSERT_EQUAL_HEX32(0, claim(5));
    rig_ms(&rig, 99);
    TEST_ASSERT_EQUAL_UINT32(5, read(HOLDER));
    rig_ms(&rig, 3);
    TEST_ASSERT_EQUAL_UINT32(0, read(HOLDER));
    TEST_ASSERT_EQUAL_HEX32(0, claim(6));
    rig_ms(&rig, 400);
    TEST_ASSERT_EQUAL_UINT32(6, read(HOLDER));
}

static void test_who_writes_1016h_does_not_take_the_guard_off_the_holder(void)
{
    hold();
    TEST_ASSERT_EQUAL_HEX32(0, arm(read(TICKET)));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1016, 1, 4, 0));
    enable_held();
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x1016, 1, 4, 127 << 16 | 60000));
    rig_ms(&rig, 10);
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 600);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x8130));
}

static void test_holder_that_falls_silent_holds_on_until_its_axes_have_stopped(void)
{
    hold();
    enable_held();
    struct rig_stream stream = {.count = 1500, .length_nm = 50e6};
    rig_go(&rig, &stream, 400);
    rig.heartbeat_every_ms = 0;
    while (!atomic_load(&rig.device.drive.loop.standing)) {
        TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, claim(5));
        rig_feed(&rig, &stream, stream.count);
        rig_ms(&rig, 1);
    }
    expect_power(false);
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_UINT32(0, read(HOLDER));
    TEST_ASSERT_EQUAL_HEX32(0, claim(5));
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x8130));
}

static void test_heartbeat_that_comes_back_too_late_keeps_nothing(void)
{
    hold();
    enable_held();
    struct rig_stream stream = {.count = 900, .length_nm = 20e6};
    rig_go(&rig, &stream, 300);
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 510);
    rig.heartbeat_every_ms = 10;
    rig_ms(&rig, 300);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_EQUAL_UINT32(0, read(HOLDER));
}

static void test_drive_with_power_is_neither_claimed_nor_released(void)
{
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, claim(5));
    both(0);
    rig_ms(&rig, 2);
    hold();
    enable_held();
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, claim(0));
    TEST_ASSERT_EQUAL_UINT32(127, read(HOLDER));
    both(0);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_HEX32(0, claim(0));
}

static void test_resets_end_a_claim(void)
{
    const uint8_t resets[] = {129, 130};
    for (unsigned i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_HEX32(0, claim(127));
        rig_nmt(&rig, resets[i]);
        TEST_ASSERT_EQUAL_UINT32(0, read(HOLDER));
    }
}

/* ---- fresh state ---- */

static void test_burst_of_controlwords_gives_no_power(void)
{
    static const uint8_t bursts[][4] = {
        {0x06, 0x07, 0x0F, 0x1F}, {0x06, 0x0F, 0x0F, 0x0F}, {0x0F, 0x0F, 0x0F, 0x0F}, {0x80, 0x06, 0x07, 0x0F}};
    for (unsigned i = 0; i < sizeof bursts / sizeof bursts[0]; i++) {
        for (unsigned gap = 0; gap < COMMAND_GUARD_PERIODS; gap++) {
            setUp();
            for (unsigned k = 0; k < 4; k++) {
                both(bursts[i][k]);
                rig_run(&rig, k < 3 ? gap / 3 + (gap % 3 > k ? 1 : 0) : 0);
            }
            expect_power(false);
            rig_ms(&rig, 100);
            expect_power(false);
        }
    }
}

/* The servo interrupt takes its time while the background handles what has come. */
static bool receive_slowly(void *ctx, struct can_frame *f)
{
    for (unsigned i = 0; i < 2 * COMMAND_GUARD_PERIODS; i++) {
        device_tick(&rig.device);
    }
    return rig_can_receive(ctx, f);
}

static void test_burst_gives_no_power_however_long_it_is(void)
{
    both(SHUTDOWN);
    for (unsigned i = 0; i < 100; i++) {
        rig_run(&rig, i % COMMAND_GUARD_PERIODS);
        both(ENABLE);
        TEST_ASSERT_FALSE(rig.out.enable[0] || rig.out.enable[1]);
    }
    expect_power(false);
    both(ENABLE);
    expect_power(true);
}

static void test_command_that_came_before_the_statusword_went_is_no_answer_however_late_it_is_handled(void)
{
    const uint8_t words[] = {SHUTDOWN, ENABLE};
    for (unsigned i = 0; i < 2; i++) {
        rig.inbox[i] = (struct can_frame){.id = 0x201, .len = 4, .data = {words[i], 0, words[i], 0}};
    }
    rig.inbox_count = 2;
    rig.hal.can_receive = receive_slowly;
    device_poll(&rig.device);
    rig.hal.can_receive = rig_can_receive;
    rig_expect_states(&rig, RIG_READY, RIG_READY);
    expect_power(false);
    both(ENABLE);
    expect_power(true);
}

static void test_one_stray_frame_after_power_on_a_stop_or_a_fault_gives_no_power(void)
{
    both(ENABLE);
    expect_power(false);
    rig_enable(&rig);
    both(0);
    rig_ms(&rig, 10);
    both(RUN);
    expect_power(false);
    rig_enable(&rig);
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_ms(&rig, 2);
    rig.inputs[0] = 0;
    both(FAULT_RESET);
    rig_ms(&rig, 10);
    both(ENABLE);
    expect_power(false);
}

static void test_master_that_waits_for_the_statusword_is_enabled_straight_from_ready(void)
{
    both(SHUTDOWN);
    rig_expect_states(&rig, RIG_READY, RIG_READY);
    rig_run(&rig, COMMAND_GUARD_PERIODS);
    both(ENABLE);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    expect_power(true);
}

static void test_state_that_was_reported_before_counts_for_its_next_time_no_more(void)
{
    both(SHUTDOWN);
    rig_ms(&rig, 50);
    both(0);
    both(SHUTDOWN);
    both(ENABLE);
    expect_power(false);
}

static void test_statusword_that_nobody_was_sent_enables_nothing(void)
{
    rig_nmt(&rig, 128); /* pre-operational: no TPDO */
    rig_ms(&rig, 10);
    rig_write(&rig, 0x6040, 0, 2, SHUTDOWN);
    rig_ms(&rig, 50);
    rig_write(&rig, 0x6040, 0, 2, ENABLE);
    rig_ms(&rig, 2);
    TEST_ASSERT_FALSE(rig.out.enable[0]);
    TEST_ASSERT_EQUAL_HEX32(RIG_READY, rig_read(&rig, 0x6041, 0) & 0x6F);
    rig_ms(&rig, 1);
    rig_write(&rig, 0x6040, 0, 2, ENABLE);
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(rig.out.enable[0]);
    TEST_ASSERT_FALSE(rig.out.enable[1]);
}

static void test_quick_stop_active_is_left_by_an_answer_to_it_only(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x605A, 0, 2, 6));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x685A, 0, 2, 6));
    rig_ms(&rig, 3);
    rig_enable(&rig);
    both(QUICK_STOP);
    both(ENABLE);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_QUICK_STOP, RIG_QUICK_STOP);
    both(ENABLE);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

/* Both ways in which a burst met an axis that could not be enabled at once */
static void test_burst_does_not_lead_out_of_quick_stop_active(void)
{
    for (int option = 5; option <= 6; option++) {
        setUp();
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x605A, 0, 2, option));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x685A, 0, 2, option));
        rig_ms(&rig, 3);
        rig_enable(&rig);
        both(QUICK_STOP);
        for (unsigned i = 0; i < 20; i++) {
            rig_run(&rig, 1);
            both(RUN);
            rig_expect_states(&rig, RIG_QUICK_STOP, RIG_QUICK_STOP);
        }
        rig_ms(&rig, 2);
        TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF1A));
        both(RUN);
        rig_ms(&rig, 2);
        rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    }
}

static void test_burst_does_not_enable_an_axis_that_comes_to_stand_in_it(void)
{
    both(SHUTDOWN);
    rig_ms(&rig, 5);
    rig.plant.vel_mps[0] = 0.02;
    rig_ms(&rig, 2);
    for (unsigned i = 0; i < 1000; i++) {
        rig_run(&rig, 1);
        both(ENABLE);
        TEST_ASSERT_FALSE(rig.out.enable[0] || rig.out.enable[1]);
    }
    TEST_ASSERT_TRUE(fabs(rig.plant.vel_mps[0]) < 1e-3);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF17));
    expect_power(false);
    both(ENABLE);
    expect_power(true);
}

static void test_command_to_an_axis_that_moves_is_reported_as_such_only(void)
{
    both(SHUTDOWN);
    rig_ms(&rig, 5);
    rig.plant.vel_mps[0] = 0.1;
    rig_ms(&rig, 2);
    both(ENABLE);
    both(ENABLE);
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF17));
    TEST_ASSERT_FALSE(rig_had_emcy(&rig, 0xFF1A));
}

/* ---- the ticket ---- */

static void test_held_drive_is_enabled_with_its_ticket_and_not_without(void)
{
    hold();
    both(SHUTDOWN);
    rig_ms(&rig, 10);
    both(ENABLE);
    expect_power(false);
    const uint32_t ticket = read(TICKET);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, arm(ticket + 1));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, arm(ticket)); /* one trial a ticket */
    both(ENABLE);
    expect_power(false);
    const uint32_t next = read(TICKET);
    TEST_ASSERT_EQUAL_HEX32(0, arm(next));
    TEST_ASSERT_EQUAL_HEX32(0, arm(next)); /* the answer was lost */
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, arm(next + 1));
    both(ENABLE);
    expect_power(true);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, arm(next));
}

static void test_ticket_is_good_for_one_enabling_and_for_a_second(void)
{
    hold();
    enable_held();
    both(0);
    rig_ms(&rig, 5);
    both(SHUTDOWN);
    rig_ms(&rig, 5);
    both(ENABLE); /* a replay */
    expect_power(false);
    TEST_ASSERT_EQUAL_HEX32(0, arm(read(TICKET)));
    rig_ms(&rig, COMMAND_GUARD_ARM_MS);
    both(ENABLE);
    expect_power(false);
}

static void test_second_that_is_over_begins_anew_with_a_new_ticket(void)
{
    hold();
    both(SHUTDOWN);
    TEST_ASSERT_EQUAL_HEX32(0, arm(read(TICKET)));
    rig_ms(&rig, COMMAND_GUARD_ARM_MS + 1);
    TEST_ASSERT_FALSE(rig.device.drive.command_guard.armed); /* nor again when its clock has come round */
    both(ENABLE);
    expect_power(false);
    const uint32_t ticket = read(TICKET);
    TEST_ASSERT_EQUAL_HEX32(0, arm(ticket));
    rig_ms(&rig, COMMAND_GUARD_ARM_MS - 10);
    TEST_ASSERT_EQUAL_HEX32(0, arm(read(TICKET))); /* before it is over, too */
    rig_ms(&rig, COMMAND_GUARD_ARM_MS - 10);
    both(ENABLE);
    expect_power(true);
}

static void test_same_ticket_again_is_right_and_prolongs_nothing(void)
{
    hold();
    both(SHUTDOWN);
    const uint32_t ticket = read(TICKET);
    TEST_ASSERT_EQUAL_HEX32(0, arm(ticket));
    rig_ms(&rig, COMMAND_GUARD_ARM_MS - 10);
    TEST_ASSERT_EQUAL_HEX32(0, arm(ticket));
    rig_ms(&rig, 10);
    both(ENABLE);
    expect_power(false);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, arm(ticket));
}

static void test_ticket_is_good_for_nothing_from_the_moment_in_which_its_holder_is_lost(void)
{
    struct command_guard command_guard = {0};
    command_guard_reset(&command_guard);
    TEST_ASSERT_TRUE(command_guard_claim(&command_guard, 127, 0, false));
    TEST_ASSERT_TRUE(command_guard_arm(&command_guard, command_guard_draw(&command_guard, 1000), 1000));
    command_guard_sent(&command_guard, AXIS_Y, 3);
    command_guard_drained(&command_guard, 1000);
    TEST_ASSERT_TRUE(command_guard_permits(&command_guard, AXIS_Y, 3, false, 1000 + COMMAND_GUARD_PERIODS));
    const uint32_t second =
        COMMAND_GUARD_ARM_MS * (CONTROL_HZ / 1000u); /* over, and the background has not seen it yet */
    TEST_ASSERT_FALSE(command_guard_permits(&command_guard, AXIS_Y, 3, false, 1000 + second));
    command_guard_holder_silent(&command_guard);
    TEST_ASSERT_FALSE(command_guard_permits(&command_guard, AXIS_Y, 3, false, 1000 + COMMAND_GUARD_PERIODS));
}

static void test_recording_of_a_whole_session_does_not_enable_a_held_drive_again(void)
{
    hold();
    both(SHUTDOWN);
    const uint32_t ticket = read(TICKET);
    TEST_ASSERT_EQUAL_HEX32(0, arm(ticket));
    rig_ms(&rig, 2);
    both(ENABLE);
    expect_power(true);
    both(0);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_HEX32(0, claim(0));
    for (unsigned i = 0; i < 20; i++) { /* the same frames, each in its time */
        rig_ms(&rig, 7);
        TEST_ASSERT_EQUAL_HEX32(0, claim(127));
        both(SHUTDOWN);
        (void)read(TICKET);
        TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, arm(ticket));
        rig_ms(&rig, 2);
        both(ENABLE);
        expect_power(false);
        both(0);
        rig_ms(&rig, 2);
        TEST_ASSERT_EQUAL_HEX32(0, claim(0));
    }
}

static void test_drive_can_be_set_to_serve_only_who_holds_it(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2141, 0, 1, 1));
    rig_ms(&rig, 5);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, arm(read(TICKET)));
    both(SHUTDOWN);
    rig_ms(&rig, 5);
    both(ENABLE);
    expect_power(false);
    both(0);
    hold();
    enable_held();
}

static void test_anybody_may_stop_a_held_drive(void)
{
    hold();
    enable_held();
    both(QUICK_STOP);
    expect_power(false);
}

static uint32_t noise_is;

static uint32_t noise(void *ctx)
{
    (void)ctx;
    return noise_is;
}

/* The tickets of a drive since power-on, read at the same times */
static void draw_tickets(uint32_t ticket[3])
{
    setUp();
    rig.hal.entropy = noise;
    hold();
    for (unsigned i = 0; i < 3; i++) {
        ticket[i] = read(TICKET);
        rig_ms(&rig, i);
    }
}

static void test_tickets_of_a_replay_in_its_own_time_are_others(void)
{
    uint32_t first[3], same[3], other[3];
    draw_tickets(first);
    draw_tickets(same);
    TEST_ASSERT_EQUAL_UINT32_ARRAY(first, same, 3);                 /* a simulation that is the same each time */
    TEST_ASSERT_TRUE(first[0] != first[1] && first[1] != first[2]); /* the first two in the same period */
    noise_is = 1;
    draw_tickets(other);
    noise_is = 0;
    for (unsigned i = 0; i < 3; i++) {
        TEST_ASSERT_NOT_EQUAL_UINT32(first[i], other[i]);
    }
    setUp();
    hold();
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, arm(first[0]));
}

static void test_tickets_after_a_reset_are_no_earlier_ones(void)
{
    hold();
    const uint32_t before = read(TICKET);
    rig_nmt(&rig, 129);
    const uint32_t state = rig.device.drive.command_guard.noise;
    TEST_ASSERT_EQUAL_HEX32(before, state);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_claim_is_for_who_comes_first_and_for_nobody_else_not_even_with_the_same_id);
    RUN_TEST(test_key_tells_a_holder_from_another_one_with_the_same_id);
    RUN_TEST(test_holder_whose_heartbeat_never_comes_loses_the_drive);
    RUN_TEST(test_heartbeat_keeps_the_claim_and_others_do_not);
    RUN_TEST(test_time_of_1016h_is_that_of_its_node_alone);
    RUN_TEST(test_who_writes_1016h_does_not_take_the_guard_off_the_holder);
    RUN_TEST(test_holder_that_falls_silent_holds_on_until_its_axes_have_stopped);
    RUN_TEST(test_heartbeat_that_comes_back_too_late_keeps_nothing);
    RUN_TEST(test_drive_with_power_is_neither_claimed_nor_released);
    RUN_TEST(test_resets_end_a_claim);
    RUN_TEST(test_burst_of_controlwords_gives_no_power);
    RUN_TEST(test_burst_gives_no_power_however_long_it_is);
    RUN_TEST(test_command_that_came_before_the_statusword_went_is_no_answer_however_late_it_is_handled);
    RUN_TEST(test_one_stray_frame_after_power_on_a_stop_or_a_fault_gives_no_power);
    RUN_TEST(test_master_that_waits_for_the_statusword_is_enabled_straight_from_ready);
    RUN_TEST(test_state_that_was_reported_before_counts_for_its_next_time_no_more);
    RUN_TEST(test_statusword_that_nobody_was_sent_enables_nothing);
    RUN_TEST(test_quick_stop_active_is_left_by_an_answer_to_it_only);
    RUN_TEST(test_burst_does_not_lead_out_of_quick_stop_active);
    RUN_TEST(test_burst_does_not_enable_an_axis_that_comes_to_stand_in_it);
    RUN_TEST(test_command_to_an_axis_that_moves_is_reported_as_such_only);
    RUN_TEST(test_held_drive_is_enabled_with_its_ticket_and_not_without);
    RUN_TEST(test_ticket_is_good_for_one_enabling_and_for_a_second);
    RUN_TEST(test_second_that_is_over_begins_anew_with_a_new_ticket);
    RUN_TEST(test_same_ticket_again_is_right_and_prolongs_nothing);
    RUN_TEST(test_recording_of_a_whole_session_does_not_enable_a_held_drive_again);
    RUN_TEST(test_drive_can_be_set_to_serve_only_who_holds_it);
    RUN_TEST(test_anybody_may_stop_a_held_drive);
    RUN_TEST(test_ticket_is_good_for_nothing_from_the_moment_in_which_its_holder_is_lost);
    RUN_TEST(test_tickets_of_a_replay_in_its_own_time_are_others);
    RUN_TEST(test_tickets_after_a_reset_are_no_earlier_ones);
    return UNITY_END();
}
