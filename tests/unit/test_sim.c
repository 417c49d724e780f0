/* SPDX-License-Identifier: Apache-2.0 */
/* test_sim.c: libkontur's interface: independence, determinism, time, frames, and the check of the machine. */
#include <math.h>
#include <string.h>

#include "drive_rig.h"
#include "sim/kontur_sim.h"
#include "unity.h"
#include <stdbool.h>

static struct ks_machine machine;

void setUp(void)
{
    machine = rig_machine();
    machine.force_noise_N[0] = machine.force_noise_N[1] = 2;
    machine.schedule_count = 2;
    machine.schedule_time_s[1] = 0.05;
    machine.schedule_scale[0] = 1;
    machine.schedule_scale[1] = 1.5;
    machine.schedule_repeat_s = 0.1;
}

void tearDown(void)
{
}

static void send(ks *s, uint32_t id, uint8_t len, const char *data)
{
    TEST_ASSERT_EQUAL_INT(0, ks_send(s, id, 0, len, (const uint8_t *)data));
}

static void enable(ks *s)
{
    send(s, 0, 2, "\x01\x00");
    ks_run(s, 30);
    send(s, 0x201, 4, "\x06\x00\x06\x00");
    ks_run(s, 10); /* the master sees the state */
    send(s, 0x201, 4, "\x0F\x00\x0F\x00");
    send(s, 0x601, 8, "\x23\x01\x18\x01\x81\x02\x00\x00"); /* telemetry on */
    ks_run(s, 10);
    send(s, 0x601, 8, "\x23\x02\x18\x01\x81\x03\x00\x00");
}

/* Receive all frames that the drive has sent. Returns their number, of which `room` are stored. */
static unsigned receive_all(ks *s, struct ks_frame *frames, unsigned room)
{
    unsigned n = 0;
    struct ks_frame f;
    while (ks_recv(s, &f)) {
        if (n < room) {
            frames[n] = f;
        }
        n++;
    }
    return n;
}

static bool same_frame(const struct ks_frame *a, const struct ks_frame *b)
{
    return a->id == b->id && a->len == b->len && a->rtr == b->rtr && a->tick == b->tick &&
           memcmp(a->data, b->data, a->len) == 0;
}

/* 300 ms of an enabled drive. */
static ks *scenario(uint64_t seed)
{
    ks *s = ks_new(&machine, seed, 1);
    TEST_ASSERT_NOT_NULL(s);
    enable(s);
    ks_start_schedule(s);
    ks_record(s, 1);
    ks_run(s, 3000);
    return s;
}

enum { FRAMES = 2000 };

static void check_equal(ks *a, ks *b)
{
    static struct ks_frame fa[FRAMES], fb[FRAMES];
    const unsigned na = receive_all(a, fa, FRAMES), nb = receive_all(b, fb, FRAMES);
    TEST_ASSERT_TRUE(na > 600 && na < FRAMES);
    TEST_ASSERT_EQUAL_UINT(na, nb);
    for (unsigned i = 0; i < na; i++) {
        TEST_ASSERT_TRUE_MESSAGE(same_frame(&fa[i], &fb[i]), "frames differ");
    }
    TEST_ASSERT_EQUAL_UINT64(3000, ks_record_count(a));
    TEST_ASSERT_EQUAL_UINT64(3000, ks_record_count(b));
    TEST_ASSERT_EQUAL_MEMORY(ks_record_data(a), ks_record_data(b), 3000 * sizeof(struct ks_truth));
}

static void test_same_seed_gives_the_same_frames_and_truth_bit_for_bit(void)
{
    ks *a = scenario(7), *b = scenario(7);
    check_equal(a, b);
    ks_free(a);
    ks_free(b);
}

static void test_another_seed_gives_another_truth(void)
{
    ks *a = scenario(7), *b = scenario(8);
    TEST_ASSERT_NOT_EQUAL(0, memcmp(ks_record_data(a), ks_record_data(b), 3000 * sizeof(struct ks_truth)));
    ks_free(a);
    ks_free(b);
}

static void test_two_drives_side_by_side_do_not_know_of_each_other(void)
{
    ks *alone = scenario(7);
    struct ks_machine other = machine;
    other.mass_kg[0] = 20;
    ks *a = ks_new(&machine, 7, 1), *b = ks_new(&other, 99, 1);
    enable(a);
    enable(b);
    ks_start_schedule(a);
    ks_record(a, 1);
    for (int i = 0; i < 3000; i++) { /* alternately */
        ks_run(a, 1);
        ks_run(b, 3);
        if (i == 1000) {
            send(b, 0x201, 4, "\x00\x00\x00\x00");
        }
    }
    check_equal(alone, a);
    ks_free(alone);
    ks_free(a);
    ks_free(b);
}

/* ---- time ---- */

static void test_step_ends_after_the_period_in_which_a_frame_is_sent(void)
{
    struct ks_frame f;
    ks *s = ks_new(&machine, 1, 1);
    TEST_ASSERT_EQUAL_UINT32(0, ks_step(s, 100)); /* the boot-up message waits already */
    TEST_ASSERT_EQUAL_INT(1, ks_recv(s, &f));
    TEST_ASSERT_EQUAL_HEX32(0x701, f.id);
    TEST_ASSERT_EQUAL_UINT8(1, f.len);
    TEST_ASSERT_EQUAL_HEX8(0, f.data[0]);
    TEST_ASSERT_EQUAL_UINT64(0, f.tick);
    TEST_ASSERT_EQUAL_INT(0, ks_recv(s, &f));
    TEST_ASSERT_EQUAL_UINT32(50, ks_step(s, 50));
    TEST_ASSERT_EQUAL_UINT64(50, ks_tick(s));
    TEST_ASSERT_EQUAL_UINT32(950, ks_step(s, 100000)); /* the heartbeat after 100 ms */
    TEST_ASSERT_EQUAL_UINT64(1000, ks_tick(s));
    TEST_ASSERT_EQUAL_UINT32(0, ks_step(s, 100));
    TEST_ASSERT_EQUAL_INT(1, ks_recv(s, &f));
    TEST_ASSERT_EQUAL_HEX32(0x701, f.id);
    TEST_ASSERT_EQUAL_HEX8(127, f.data[0]);
    TEST_ASSERT_EQUAL_UINT64(1000, f.tick);
    ks_free(s);
}

static void test_run_goes_on_whether_or_not_frames_wait(void)
{
    ks *s = ks_new(&machine, 1, 1);
    ks_run(s, 12345);
    TEST_ASSERT_EQUAL_UINT64(12345, ks_tick(s));
    TEST_ASSERT_EQUAL_UINT32(10000, ks_control_hz(s));
    ks_free(s);
}

static void test_frame_is_answered_before_send_returns_and_no_time_passes(void)
{
    struct ks_frame f;
    ks *s = ks_new(&machine, 1, 9);
    receive_all(s, &f, 1);
    send(s, 0x609, 8, "\x40\x00\x10\x00\x00\x00\x00\x00"); /* 1000h */
    TEST_ASSERT_EQUAL_UINT64(0, ks_tick(s));
    TEST_ASSERT_EQUAL_INT(1, ks_recv(s, &f));
    TEST_ASSERT_EQUAL_HEX32(0x589, f.id);
    TEST_ASSERT_EQUAL_MEMORY("\x43\x00\x10\x00\x92\x01\xFF\xFF", f.data, 8);
    ks_free(s);
}

static void test_bad_frames_are_refused(void)
{
    const uint8_t data[9] = {0};
    ks *s = ks_new(&machine, 1, 1);
    TEST_ASSERT_EQUAL_INT(-1, ks_send(s, 0x800, 0, 0, data));
    TEST_ASSERT_EQUAL_INT(-1, ks_send(s, 0x100, 0, 9, data));
    TEST_ASSERT_EQUAL_INT(0, ks_send(s, 0x7FF, 0, 8, data));
    ks_free(s);
}

static void test_frames_that_nobody_receives_are_lost_and_counted(void)
{
    static struct ks_frame frames[5000];
    ks *s = ks_new(&machine, 1, 1);
    enable(s);
    ks_run(s, 10000); /* a second: some 2300 frames */
    TEST_ASSERT_EQUAL_UINT32(0, ks_overflows(s));
    ks_run(s, 15000);
    const uint32_t lost = ks_overflows(s);
    TEST_ASSERT_TRUE(lost > 1000 && lost < 2000);
    const unsigned received = receive_all(s, frames, 5000);
    TEST_ASSERT_EQUAL_UINT(4096, received);
    TEST_ASSERT_EQUAL_HEX32(0x701, frames[0].id); /* the oldest frames stay */
    ks_run(s, 100);
    TEST_ASSERT_TRUE(receive_all(s, frames, 5000) > 20);
    TEST_ASSERT_EQUAL_UINT32(lost, ks_overflows(s));
    ks_free(s);
}

static void test_drive_identifies_itself(void)
{
    ks *s = ks_new(&machine, 1, 1);
    TEST_ASSERT_EQUAL_STRING("f32", ks_num(s));
    TEST_ASSERT_TRUE(strlen(ks_build(s)) > 0);
    ks_free(s);
}

/* ---- truth ---- */

static void test_truth_is_one_row_a_period_from_the_start_of_recording(void)
{
    ks *s = ks_new(&machine, 1, 1);
    ks_run(s, 10);
    TEST_ASSERT_EQUAL_UINT64(0, ks_record_count(s));
    ks_record(s, 1);
    ks_run(s, 25);
    TEST_ASSERT_EQUAL_UINT64(25, ks_record_count(s));
    ks_record(s, 0);
    ks_run(s, 25);
    TEST_ASSERT_EQUAL_UINT64(25, ks_record_count(s));
    ks_record(s, 1);
    TEST_ASSERT_EQUAL_UINT64(0, ks_record_count(s));
    ks_run(s, 70000); /* more than the first allocation */
    TEST_ASSERT_EQUAL_UINT64(70000, ks_record_count(s));
    ks_free(s);
}

static void test_truth_is_the_motion_of_the_machine_and_its_force_demand(void)
{
    machine.start_m[0] = 0.01;
    machine.start_m[1] = -0.02;
    ks *s = ks_new(&machine, 1, 1);
    send(s, 0x601, 8, "\x23\x10\x21\x01\x80\x84\x1E\x00"); /* lambda 2000 1/s: less than a count makes a force */
    ks_record(s, 1);
    enable(s);
    ks_run(s, 2000);
    const struct ks_truth *row = ks_record_data(s);
    TEST_ASSERT_EQUAL_DOUBLE(0.01, row[0].pos_m[0]);
    TEST_ASSERT_EQUAL_DOUBLE(-0.02, row[0].pos_m[1]);
    TEST_ASSERT_EQUAL_DOUBLE(0, row[0].force_N[0]);
    double most = 0;
    for (unsigned i = 0; i < 2000; i++) {
        most = fmax(most, fabs(row[i].force_N[0]));
        TEST_ASSERT_TRUE(fabs(row[i].force_N[0]) <= 600 && fabs(row[i].friction_N[0]) <= 45.5 * 1.5);
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0.01, row[i].pos_m[0]);
    }
    TEST_ASSERT_TRUE(most > 0);
    ks_free(s);
}

static void test_friction_schedule_starts_on_request(void)
{
    /* noise of 2 N moves an axis without power as soon as there is no friction */
    machine.schedule_scale[1] = 0; /* from 50 ms on */
    machine.schedule_repeat_s = 0;
    ks *s = ks_new(&machine, 1, 1);
    ks_run(s, 400);
    ks_start_schedule(s);
    ks_record(s, 1);
    ks_run(s, 1000);
    const struct ks_truth *row = ks_record_data(s);
    TEST_ASSERT_EQUAL_DOUBLE(0, row[500].pos_m[0]);
    TEST_ASSERT_EQUAL_DOUBLE(0, row[500].vel_mps[1]);
    TEST_ASSERT_TRUE(fabs(row[501].vel_mps[0]) > 0 && fabs(row[501].vel_mps[1]) > 0);
    ks_free(s);
}

/* ---- machine ---- */

static void expect_refused(const char *field)
{
    TEST_ASSERT_EQUAL_STRING(field, ks_check(&machine));
    TEST_ASSERT_NULL(ks_new(&machine, 1, 1));
    setUp();
    TEST_ASSERT_NULL(ks_check(&machine));
}

static void test_check_names_the_first_field_that_is_out_of_range(void)
{
    TEST_ASSERT_NULL(ks_check(&machine));
    for (int i = 0; i < 2; i++) {
        machine.mass_kg[i] = 0;
        expect_refused("mass_kg");
        machine.mass_kg[i] = (double)NAN;
        expect_refused("mass_kg");
        machine.mass_kg[i] = (double)INFINITY;
        expect_refused("mass_kg");
        machine.viscous_Nspm[i] = -1;
        expect_refused("viscous_Nspm");
        machine.coulomb_N[i] = -1;
        expect_refused("coulomb_N");
        machine.breakaway[i] = 0.99;
        expect_refused("breakaway");
        machine.stribeck_mps[i] = 0;
        expect_refused("stribeck_mps");
        machine.force_limit_N[i] = 0;
        expect_refused("force_limit_N");
        machine.force_noise_N[i] = -1;
        expect_refused("force_noise_N");
        machine.current_lag_s[i] = -1;
        expect_refused("current_lag_s");
        machine.encoder_m[i] = 0;
        expect_refused("encoder_m");
        machine.encoder_m[i] = 1e-11; /* 0.2 m would be 2e10 counts */
        expect_refused("encoder_m");
        machine.travel_min_m[i] = -2.1;
        expect_refused("travel_min_m");
        machine.travel_max_m[i] = -0.3;
        expect_refused("travel_max_m");
        machine.travel_max_m[i] = 2.1;
        expect_refused("travel_max_m");
        machine.start_m[i] = 0.3;
        expect_refused("start_m");
        machine.start_m[i] = (double)NAN;
        expect_refused("start_m");
    }
    machine.delay_periods = 0;
    expect_refused("delay_periods");
    machine.delay_periods = 5;
    expect_refused("delay_periods");
    machine.substeps = 9;
    expect_refused("substeps");
    machine.substeps = 1001;
    expect_refused("substeps");
    machine.schedule_count = 17;
    expect_refused("schedule_count");
    machine.schedule_count = -1;
    expect_refused("schedule_count");
    machine.schedule_time_s[1] = 0;
    expect_refused("schedule_time_s");
    machine.schedule_scale[1] = -1;
    expect_refused("schedule_scale");
    machine.schedule_repeat_s = -1;
    expect_refused("schedule_repeat_s");
    machine.mass_kg[0] = machine.viscous_Nspm[1] = -1;
    expect_refused("mass_kg");
}

static void test_node_id_is_1_to_31(void)
{
    TEST_ASSERT_NULL(ks_new(&machine, 1, 0));
    TEST_ASSERT_NULL(ks_new(&machine, 1, 32));
    ks *s = ks_new(&machine, 1, 31);
    struct ks_frame f;
    TEST_ASSERT_EQUAL_INT(1, ks_recv(s, &f));
    TEST_ASSERT_EQUAL_HEX32(0x71F, f.id);
    ks_free(s);
    ks_free(NULL);
}

/* ---- knots without CAN frames ---- */

static void test_pushed_knots_are_executed_like_those_of_frames(void)
{
    struct ks_frame f;
    static int32_t xy[2 * 800];
    ks *s = ks_new(&machine, 1, 1);
    TEST_ASSERT_EQUAL_UINT32(0, ks_push_knots(s, xy, 5)); /* no stream */
    enable(s);
    ks_run(s, 30);
    for (int i = 0; i < 800; i++) {
        xy[2 * i] = i < 300 ? 0 : 100;
        xy[2 * i + 1] = 0;
    }
    receive_all(s, &f, 1);
    send(s, 0x601, 8, "\x23\x00\x22\x04\x58\x02\x00\x00"); /* total 600 */
    send(s, 0x601, 8, "\x2F\x00\x22\x01\x01\x00\x00\x00"); /* start */
    TEST_ASSERT_EQUAL_UINT32(400, ks_push_knots(s, xy, 400));
    TEST_ASSERT_EQUAL_UINT32(200, ks_push_knots(s, xy + 800, 400)); /* complete */
    send(s, 0x201, 4, "\x1F\x00\x1F\x00");
    ks_run(s, 6200);
    receive_all(s, &f, 1);
    send(s, 0x601, 8, "\x40\x00\x22\x05\x00\x00\x00\x00");
    bool answered = false;
    while (ks_recv(s, &f)) {
        if (f.id == 0x581) {
            TEST_ASSERT_EQUAL_HEX8(4, f.data[4]); /* done */
            answered = true;
        }
    }
    TEST_ASSERT_TRUE(answered);
    ks_free(s);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_same_seed_gives_the_same_frames_and_truth_bit_for_bit);
    RUN_TEST(test_another_seed_gives_another_truth);
    RUN_TEST(test_two_drives_side_by_side_do_not_know_of_each_other);
    RUN_TEST(test_step_ends_after_the_period_in_which_a_frame_is_sent);
    RUN_TEST(test_run_goes_on_whether_or_not_frames_wait);
    RUN_TEST(test_frame_is_answered_before_send_returns_and_no_time_passes);
    RUN_TEST(test_bad_frames_are_refused);
    RUN_TEST(test_frames_that_nobody_receives_are_lost_and_counted);
    RUN_TEST(test_drive_identifies_itself);
    RUN_TEST(test_truth_is_one_row_a_period_from_the_start_of_recording);
    RUN_TEST(test_truth_is_the_motion_of_the_machine_and_its_force_demand);
    RUN_TEST(test_friction_schedule_starts_on_request);
    RUN_TEST(test_check_names_the_first_field_that_is_out_of_range);
    RUN_TEST(test_node_id_is_1_to_31);
    RUN_TEST(test_pushed_knots_are_executed_like_those_of_frames);
    return UNITY_END();
}
