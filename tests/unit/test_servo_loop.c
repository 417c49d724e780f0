/* SPDX-License-Identifier: Apache-2.0 */
/* The servo tick on a HAL of wires: order, encoder counters, and limits that cut the power in the period that sees them. */
#include <math.h>
#include <string.h>

#include "drive/configuration.h"
#include "drive/servo_loop.h"
#include "num_test.h"
#include "table1.h"
#include "unity.h"

static struct servo_loop loop;
static struct spline_ring ring;
static struct hal hal;

/* The wires */
static struct hal_drive_in wires;
static struct hal_drive_out out;
static char calls[64];
static unsigned call_count;

static void note(char what)
{
    if (call_count < sizeof calls - 1) {
        calls[call_count++] = what;
        calls[call_count] = '\0';
    }
}

static void drive_read(void *ctx, struct hal_drive_in *in)
{
    TEST_ASSERT_EQUAL_PTR(&wires, ctx);
    note('r');
    *in = wires;
}

static void drive_write(void *ctx, const struct hal_drive_out *written)
{
    TEST_ASSERT_EQUAL_PTR(&wires, ctx);
    note('w');
    out = *written;
}

static void tick(unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        servo_loop_tick(&loop);
    }
}

static void start(int32_t x_count, int32_t y_count)
{
    wires = (struct hal_drive_in){.count = {x_count, y_count}};
    const struct od_data od = table1();
    servo_loop_init(&loop, &hal, &ring);
    loop.cfg[0] = (struct servo_loop_cfg){
        .servo = configuration_servo(&od),
        .encoder_10fm = {10000000, 10000000}, /* 0.1 um */
        .following_max = {NUM(100), NUM(100)},
        .speed_max = NUM(500), /* um/T0: 0.1 m/s */
        .min_nm = {-1000000, -1000000},
        .max_nm = {1000000, 1000000},
        .stop_time = NUM(100),
        .jump_counts = {1000000, 1000000},
        .cut = fault_mask(&od, REACT_DISABLE),
        .stop = fault_mask(&od, REACT_PATH_STOP),
    };
    tick(20);
}

static void power(void)
{
    for (int i = 0; i < 2; i++) {
        ring.start.nm[i] = servo_loop_snapshot(&loop)->position_nm[i];
        atomic_store(&loop.command.powered[i], SERVO_LOOP_ON);
    }
    tick(1);
    TEST_ASSERT_TRUE(out.enable[0] && out.enable[1]);
    TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
}

void setUp(void)
{
    memset(&ring, 0, sizeof ring);
    hal = (struct hal){.ctx = &wires, .drive_read = drive_read, .drive_write = drive_write};
    out = (struct hal_drive_out){0};
    start(0, 0);
    call_count = 0;
}

void tearDown(void)
{
}

/* ---- order ---- */

static void test_each_tick_reads_once_then_writes_once(void)
{
    tick(3);
    TEST_ASSERT_EQUAL_STRING("rwrwrw", calls);
}

static void test_init_leaves_both_axes_without_power_at_their_encoders(void)
{
    wires = (struct hal_drive_in){.count = {12345, -54321}};
    memset(&loop, 0xA5, sizeof loop);
    servo_loop_init(&loop, &hal, &ring);
    TEST_ASSERT_TRUE(servo_loop_progress(&loop).standing);
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL_HEX32(SERVO_LOOP_OFF, atomic_load(&loop.command.powered[i]));
        (void)encoder_step(&loop.encoder[i], wires.count[i]);
        TEST_ASSERT_FALSE(encoder_jumped(&loop.encoder[i], 1));
    }
}

static void test_force_answers_the_encoders_of_the_same_tick(void)
{
    power();
    tick(100);
    const int32_t before = out.force_mN[0];
    wires.count[0] += 10; /* 1 um ahead of the reference */
    tick(1);
    TEST_ASSERT_TRUE_MESSAGE(out.force_mN[0] < before - 1000, "no force back in the tick that saw the step");
}

static void test_force_is_zero_without_power(void)
{
    wires.count[0] = wires.count[1] = 500;
    tick(50);
    TEST_ASSERT_FALSE(out.enable[0] || out.enable[1]);
    TEST_ASSERT_EQUAL_INT32(0, out.force_mN[0]);
    TEST_ASSERT_EQUAL_INT32(0, out.force_mN[1]);
}

static void test_brake_is_released_with_the_law_active_and_engaged_before_it_ends_or_with_a_cut(void)
{
    static const struct {
        uint32_t word;
        bool enable, force, release;
    } rows[] = {
        {SERVO_LOOP_OFF, false, false, false},
        {SERVO_LOOP_STARTING, true, false, false},
        {SERVO_LOOP_ON, true, true, true},
        {SERVO_LOOP_BRAKED, true, true, false},
    };
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        wires.count[0] = 0;
        start(0, 0);
        atomic_store(&loop.command.powered[0], rows[i].word);
        tick(1);
        wires.count[0] = 10;
        tick(1);
        TEST_ASSERT_EQUAL(rows[i].enable, out.enable[0]);
        TEST_ASSERT_EQUAL(rows[i].force, out.force_mN[0] != 0);
        TEST_ASSERT_EQUAL(rows[i].release, out.release[0]);
        TEST_ASSERT_FALSE(out.release[1]);
        wires.inputs[1] = HAL_AMPLIFIER_FAULT;
        tick(1);
        TEST_ASSERT_FALSE(out.enable[0] || out.release[0]);
        wires.inputs[1] = 0;
    }
}

static void test_axis_without_power_gets_no_force_while_the_other_one_is_held(void)
{
    atomic_store(&loop.command.powered[1], SERVO_LOOP_ON);
    wires.count[0] = wires.count[1] = 5;
    tick(2);
    TEST_ASSERT_FALSE(out.enable[0]);
    TEST_ASSERT_TRUE(out.enable[1]);
    TEST_ASSERT_EQUAL_INT32(0, out.force_mN[0]);
    TEST_ASSERT_NOT_EQUAL_INT32(0, out.force_mN[1]);
}

/* ---- encoders ---- */

static void test_position_goes_on_when_the_counter_wraps_upwards(void)
{
    start(INT32_MAX - 2, INT32_MIN + 2);
    loop.cfg[1] = loop.cfg[0];
    loop.cfg[1].encoder_10fm[0] = loop.cfg[1].encoder_10fm[1] = 100; /* so that 2^31 counts are 2.1 mm */
    atomic_store(&loop.command.configured, 1);
    for (int i = 0; i < 200; i++) {
        wires.count[0] = (int32_t)((uint32_t)wires.count[0] + 5000u);
        wires.count[1] = (int32_t)((uint32_t)wires.count[1] - 5000u);
        tick(1);
    }
    tick(300); /* the observer catches up */
    TEST_ASSERT_INT32_WITHIN(1, 2147484 + 1000, servo_loop_snapshot(&loop)->position_nm[0]);
    TEST_ASSERT_INT32_WITHIN(1, -2147484 - 1000, servo_loop_snapshot(&loop)->position_nm[1]);
}

static void test_position_is_count_times_length(void)
{
    wires.count[0] = 12345;
    wires.count[1] = -54321;
    tick(1000);
    TEST_ASSERT_INT32_WITHIN(1, 1234500, servo_loop_snapshot(&loop)->position_nm[0]);
    TEST_ASSERT_INT32_WITHIN(1, -5432100, servo_loop_snapshot(&loop)->position_nm[1]);
}

static void test_length_of_a_count_is_exact_to_ten_femtometres(void)
{
    loop.cfg[1] = loop.cfg[0];
    loop.cfg[1].encoder_10fm[0] = 7629395;
    loop.cfg[1].encoder_10fm[1] = 7629394;
    wires.count[0] = wires.count[1] = 2000000;
    atomic_store(&loop.command.configured, 1);
    tick(20);
    TEST_ASSERT_EQUAL_INT32(152587900, servo_loop_snapshot(&loop)->position_nm[0]);
    TEST_ASSERT_EQUAL_INT32(152587880, servo_loop_snapshot(&loop)->position_nm[1]);
}

/* To 2^-48 nm, so that nothing is lost when a length is set a second time. */
static void test_position_by_a_new_length_is_the_one_that_all_counts_would_have_led_to(void)
{
    static const int32_t counts[] = {1, -1, 0x7FFF, 0x8000, 0xFFFF, 0x10001, -0x8001, -0x10000, 123456789, -987654321};
    static const uint32_t lengths[] = {1, 7629394, 7629395, 10000000, 99999999};
    for (unsigned i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        for (unsigned k = 0; k < sizeof lengths / sizeof lengths[0]; k++) {
            struct encoder before, after;
            encoder_reset(&before, 0);
            encoder_scale(&before, lengths[k]);
            encoder_step(&before, counts[i] / 3);
            encoder_step(&before, counts[i]);
            encoder_reset(&after, counts[i]);
            encoder_scale(&after, lengths[k]);
            TEST_ASSERT_TRUE(before.pos == after.pos);
            TEST_ASSERT_EQUAL_HEX32(before.fraction, after.fraction);
        }
    }
}

static void test_position_some_counts_before_is_that_of_so_many_counts_less(void)
{
    static const int32_t counts[] = {1, -1, 40000, -70000, 2000000, -2000000, 123456789};
    static const uint32_t lengths[] = {1, 7629394, 7629395, 10000001, 99999999};
    for (unsigned i = 0; i < sizeof counts / sizeof counts[0]; i++) {
        for (unsigned k = 0; k < sizeof lengths / sizeof lengths[0]; k++) {
            struct encoder now, before;
            encoder_reset(&now, 123456789);
            encoder_scale(&now, lengths[k]);
            encoder_reset(&before, 123456789 - counts[i]);
            encoder_scale(&before, lengths[k]);
            const pos_t error = encoder_position_before(&now, now.pos, counts[i]) - before.pos;
            TEST_ASSERT_TRUE(error == 0 || error == 1); /* 2^-16 nm, by rounding down */
        }
    }
}

static void test_new_configuration_takes_the_axes_where_they_are_and_at_rest(void)
{
    wires.count[0] = 700000;
    loop.cfg[1] = loop.cfg[0];
    atomic_store(&loop.command.configured, 1);
    tick(10);
    TEST_ASSERT_EQUAL_INT32(70000000, servo_loop_snapshot(&loop)->position_nm[0]);
    TEST_ASSERT_EQUAL_INT32(0, servo_loop_snapshot(&loop)->velocity_umps[0]);
}

static void test_second_configuration_before_a_tick_is_taken_over_like_the_first(void)
{
    wires.count[0] = 1000;
    tick(10);
    loop.cfg[0].encoder_10fm[0] *= 2;
    atomic_store(&loop.command.configured, 2);
    tick(10);
    TEST_ASSERT_EQUAL_INT32(200000, servo_loop_snapshot(&loop)->position_nm[0]);
}

/* ---- limits ---- */

static void expect_cut(enum fault fault)
{
    TEST_ASSERT_EQUAL_HEX32(FAULT_BIT(fault), atomic_load(&loop.faults));
    TEST_ASSERT_FALSE(out.enable[0] || out.enable[1]);
    TEST_ASSERT_EQUAL_INT32(0, out.force_mN[0]);
    TEST_ASSERT_EQUAL_INT32(0, out.force_mN[1]);
    wires.count[0] += 3000; /* now the axes move as they like: no fault more */
    wires.count[1] -= 3000;
    tick(100);
    TEST_ASSERT_FALSE(out.enable[0] || out.enable[1]);
    TEST_ASSERT_EQUAL_INT32(0, out.force_mN[0]);
    TEST_ASSERT_EQUAL_HEX32(FAULT_BIT(fault), atomic_load(&loop.faults));
}

static void test_following_error_cuts_the_power_in_the_period_that_sees_it(void)
{
    for (int axis = 0; axis < 2; axis++) {
        for (int sign = -1; sign <= 1; sign += 2) {
            start(0, 0);
            atomic_store(&loop.command.powered[0], SERVO_LOOP_OFF);
            atomic_store(&loop.command.powered[1], SERVO_LOOP_OFF);
            ring.start.nm[0] = ring.start.nm[1] = 0;
            power();
            ring.start.nm[axis] = sign * 100010; /* reference 100.01 um away; window 100 um */
            call_count = 0;
            tick(1);
            TEST_ASSERT_EQUAL_STRING("rw", calls);
            expect_cut(FAULT_FOLLOWING);
        }
    }
}

static void test_encoder_jump_counts_for_an_axis_with_power_alone_and_by_its_own_limit(void)
{
    for (int axis = 0; axis < 2; axis++) {
        for (int jumps = 0; jumps < 2; jumps++) {
            start(0, 0);
            loop.cfg[0].jump_counts[jumps] = 1000;
            loop.cfg[0].jump_counts[1 - jumps] = 100000;
            atomic_store(&loop.command.powered[axis], SERVO_LOOP_ON);
            tick(1);
            wires.count[jumps] += 1000;
            tick(1);
            TEST_ASSERT_FALSE((atomic_load(&loop.faults) & FAULT_BIT(FAULT_ENCODER_JUMP)) != 0);
            wires.count[jumps] += 1001;
            tick(1);
            TEST_ASSERT_EQUAL(axis == jumps, (atomic_load(&loop.faults) & FAULT_BIT(FAULT_ENCODER_JUMP)) != 0);
        }
    }
}

static void test_following_error_within_its_window_is_no_fault(void)
{
    power();
    ring.start.nm[0] = 99990;
    ring.start.nm[1] = -99990;
    tick(1);
    TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
    TEST_ASSERT_TRUE(out.enable[0] && out.enable[1]);
}

static void test_overspeed_cuts_the_power_in_the_period_that_sees_it(void)
{
    for (int axis = 0; axis < 2; axis++) {
        for (int sign = -1; sign <= 1; sign += 2) {
            start(0, 0);
            atomic_store(&loop.command.powered[0], SERVO_LOOP_OFF);
            atomic_store(&loop.command.powered[1], SERVO_LOOP_OFF);
            ring.start.nm[0] = ring.start.nm[1] = 0;
            power();
            loop.cfg[0].speed_max = NUM(5); /* 1 mm/s */
            for (int i = 0; i < 400 && atomic_load(&loop.faults) == 0; i++) {
                TEST_ASSERT_TRUE(out.enable[0] && out.enable[1]);
                wires.count[axis] += sign * (i % 8 == 0 ? 1 : 0); /* 0.125 mm/s, ... */
                wires.count[axis] += sign * (i > 200 ? 2 : 0);    /* then 2 mm/s more */
                tick(1);
                const double v = val(loop.servo.observer[axis].vel);
                TEST_ASSERT_EQUAL(fabs(v) > 5, (atomic_load(&loop.faults) & FAULT_BIT(FAULT_OVERSPEED)) != 0);
            }
            expect_cut(FAULT_OVERSPEED);
        }
    }
}

static void test_overspeed_counts_for_an_axis_with_power_alone(void)
{
    for (int axis = 0; axis < 2; axis++) {
        for (int moved = 0; moved < 2; moved++) {
            start(0, 0);
            loop.cfg[0].speed_max = NUM(5); /* 1 mm/s */
            ring.start.nm[0] = ring.start.nm[1] = 0;
            atomic_store(&loop.command.powered[axis], SERVO_LOOP_ON);
            for (int i = 0; i < 200; i++) {
                wires.count[moved] += 2; /* 2 mm/s */
                tick(1);
            }
            TEST_ASSERT_EQUAL_HEX32(axis == moved ? FAULT_BIT(FAULT_OVERSPEED) : 0, atomic_load(&loop.faults));
        }
    }
}

/* An axis that stands outside and is held there may be brought back. */
static void test_axis_outside_the_limits_is_no_fault_while_it_is_where_its_reference_is(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        start(sign * 30000, 0); /* 3 mm */
        for (int axis = 0; axis < 2; axis++) {
            ring.start.nm[axis] = servo_loop_snapshot(&loop)->position_nm[axis];
            atomic_store(&loop.command.powered[axis], SERVO_LOOP_ON);
        }
        tick(100);
        TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
        loop.cfg[0].following_ticks[0] = 1000000; /* which would see it first */
        ring.start.nm[0] -= sign * 200000;
        tick(1);
        expect_cut(FAULT_TRAVEL);
    }
}

static void test_limits_are_the_users_and_move_with_the_origin(void)
{
    for (int beyond = 0; beyond < 2; beyond++) {
        start(0, 0);
        atomic_store(&loop.command.origin_nm[0], beyond ? 1102000 : 1098000); /* limit and window: 1.1 mm */
        loop.cfg[0].following_ticks[0] = 1000000;
        atomic_store(&loop.command.powered[0], SERVO_LOOP_ON);
        ring.start.nm[0] = -200000;
        tick(1);
        TEST_ASSERT_EQUAL_HEX32(beyond ? FAULT_BIT(FAULT_TRAVEL) : 0, atomic_load(&loop.faults));
    }
}

static void test_following_error_may_last_as_long_as_its_timeout(void)
{
    start(0, 0);
    power();
    loop.cfg[0].following_ticks[0] = 50;
    ring.start.nm[0] = 200000; /* 0.2 mm: twice the window */
    tick(30);
    ring.start.nm[0] = 0;
    tick(1);
    ring.start.nm[0] = 200000;
    tick(50); /* anew */
    TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
    tick(1);
    expect_cut(FAULT_FOLLOWING);
}

static void test_following_error_of_an_axis_is_timed_whether_the_other_one_has_power_or_an_error(void)
{
    for (int i = 0; i < 4; i++) {
        const int axis = i % 2;
        const bool other_powered = i / 2 != 0;
        start(0, 0);
        ring.start.nm[0] = ring.start.nm[1] = 0;
        loop.cfg[0].following_ticks[axis] = 50;
        loop.cfg[0].following_ticks[1 - axis] = 1000000;
        atomic_store(&loop.command.powered[axis], SERVO_LOOP_ON);
        atomic_store(&loop.command.powered[1 - axis], other_powered ? SERVO_LOOP_ON : SERVO_LOOP_OFF);
        ring.start.nm[0] = ring.start.nm[1] = 200000; /* 0.2 mm: twice the window */
        tick(20);
        ring.start.nm[axis] = 0; /* it is within its window, and is timed anew */
        tick(30);
        ring.start.nm[axis] = 200000;
        tick(50);
        TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
        tick(1);
        expect_cut(FAULT_FOLLOWING);
    }
}

static void test_following_error_is_timed_anew_when_its_axis_gets_power_again(void)
{
    for (int axis = 0; axis < 2; axis++) {
        start(0, 0);
        ring.start.nm[0] = ring.start.nm[1] = 0;
        power();
        loop.cfg[0].following_ticks[axis] = 50;
        ring.start.nm[axis] = 200000;
        tick(30);
        atomic_store(&loop.command.powered[axis], SERVO_LOOP_OFF);
        tick(1);
        atomic_store(&loop.command.powered[axis], SERVO_LOOP_ON);
        tick(50);
        TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
        tick(1);
        expect_cut(FAULT_FOLLOWING);
    }
}

static void test_travel_ends_where_the_limits_and_the_window_do(void)
{
    static const int32_t inside[4][2] = {{10990, 0}, {-10990, 0}, {0, 10990}, {0, -10990}}; /* 1.099 mm; limit 1.1 */
    for (int i = 0; i < 4; i++) {
        for (int beyond = 0; beyond < 2; beyond++) {
            const int32_t k = beyond ? 20 : 0; /* 2 um more */
            start(inside[i][0] + (inside[i][0] > 0) * k - (inside[i][0] < 0) * k,
                  inside[i][1] + (inside[i][1] > 0) * k - (inside[i][1] < 0) * k);
            for (int axis = 0; axis < 2; axis++) {
                const int32_t nm = servo_loop_snapshot(&loop)->position_nm[axis];
                ring.start.nm[axis] = nm > 0 ? nm - 150000 : nm < 0 ? nm + 150000 : 0; /* inside, it has lost its way */
                loop.cfg[0].following_ticks[axis] = 1000000;
                atomic_store(&loop.command.powered[axis], SERVO_LOOP_ON);
            }
            tick(1);
            if (beyond) {
                expect_cut(FAULT_TRAVEL);
            } else {
                TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
            }
        }
    }
}

static void test_limits_and_window_of_each_axis_are_its_own(void)
{
    static const int32_t limit_um[2][2] = {{-1000, 1500}, {-2000, 2500}}, window_um[2] = {100, 200};
    for (int i = 0; i < 12; i++) {
        const int axis = i % 2, side = i / 2 % 2, beyond_um = i / 4 - 1;
        const int32_t out_um = window_um[axis] + beyond_um;
        const int32_t um = limit_um[axis][side] + (side != 0 ? out_um : -out_um);
        start(axis == 0 ? um * 10 : 0, axis == 1 ? um * 10 : 0);
        loop.cfg[1] = loop.cfg[0];
        for (int k = 0; k < 2; k++) {
            loop.cfg[1].min_nm[k] = limit_um[k][0] * 1000;
            loop.cfg[1].max_nm[k] = limit_um[k][1] * 1000;
            loop.cfg[1].following_max[k] = mk(window_um[k]);
            loop.cfg[1].following_ticks[k] = 1000000;
        }
        atomic_store(&loop.command.configured, 1);
        tick(20);
        ring.start.nm[1 - axis] = 0;
        ring.start.nm[axis] = um * 1000 + (side != 0 ? -250000 : 250000); /* inside: it moves out from there */
        atomic_store(&loop.command.powered[0], SERVO_LOOP_ON);
        atomic_store(&loop.command.powered[1], SERVO_LOOP_ON);
        tick(1);
        TEST_ASSERT_EQUAL_HEX32(beyond_um > 0 ? FAULT_BIT(FAULT_TRAVEL) : 0, atomic_load(&loop.faults));
    }
}

static void test_travel_ends_where_positions_of_32_bits_do(void)
{
    for (int axis = 0; axis < 2; axis++) {
        for (int side = 0; side < 2; side++) {
            const int32_t end = side != 0 ? INT32_MAX : INT32_MIN, outwards = side != 0 ? 1 : -1;
            start(axis == 0 ? end : 0, axis == 1 ? end : 0);
            loop.cfg[1] = loop.cfg[0];
            loop.cfg[1].encoder_10fm[axis] = 100000; /* 1 nm */
            loop.cfg[1].min_nm[axis] = INT32_MIN;
            loop.cfg[1].max_nm[axis] = INT32_MAX;
            loop.cfg[1].following_ticks[axis] = 1000000;
            for (int beyond = 0; beyond < 2; beyond++) {
                atomic_store(&loop.command.configured, 1 + 2u * (unsigned)beyond);
                tick(20);
                ring.start.nm[axis] = end - outwards * 200000;
                ring.start.nm[1 - axis] = 0;
                atomic_store(&loop.command.powered[axis], SERVO_LOOP_ON);
                tick(1);
                TEST_ASSERT_EQUAL_HEX32(beyond ? FAULT_BIT(FAULT_TRAVEL) : 0, atomic_load(&loop.faults));
                atomic_store(&loop.command.powered[axis], SERVO_LOOP_OFF);
                wires.count[axis] = (int32_t)((uint32_t)wires.count[axis] + (uint32_t)outwards); /* the counter wraps */
                tick(1);
            }
        }
    }
}

static void test_axis_without_power_has_no_limits(void)
{
    wires.count[0] = 100000; /* 10 mm, in a single period */
    tick(100);
    TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
}

static void test_fault_of_the_amplifier_or_encoder_cuts_both_axes_in_the_same_period(void)
{
    for (int axis = 0; axis < 2; axis++) {
        start(0, 0);
        ring.start.nm[0] = ring.start.nm[1] = 0;
        power();
        wires.inputs[axis] = HAL_AMPLIFIER_FAULT;
        tick(1);
        expect_cut(FAULT_AMPLIFIER);
        wires.inputs[axis] = 0;
        wires.count[0] = wires.count[1] = 0;
        tick(1000);
        TEST_ASSERT_EQUAL_HEX32(FAULT_BIT(FAULT_AMPLIFIER),
                                atomic_load(&loop.faults)); /* until the background clears it */
        TEST_ASSERT_FALSE(out.enable[0]);
        atomic_store(&loop.faults, 0);
        tick(1);
        TEST_ASSERT_TRUE(out.enable[0] && out.enable[1]);
    }
}

static void test_fault_with_a_path_stop_keeps_the_power(void)
{
    power();
    atomic_store(&loop.faults, FAULT_BIT(FAULT_UNDERRUN) | FAULT_BIT(FAULT_HEARTBEAT) | FAULT_BIT(FAULT_KNOT_RANGE));
    tick(5);
    TEST_ASSERT_TRUE(out.enable[0] && out.enable[1]);
}

static void test_force_stays_within_its_limit(void)
{
    loop.cfg[0].following_max[0] = loop.cfg[0].following_max[1] = NUM(4000);
    loop.cfg[0].servo.plant.force_max.y = NUM(500);
    power();
    loop.servo.force_limit.limit.y = NUM(500);
    ring.start.nm[0] = 3000000;
    ring.start.nm[1] = -3000000;
    loop.cfg[0].max_nm[0] = 4000000;
    loop.cfg[0].min_nm[1] = -4000000;
    tick(1);
    TEST_ASSERT_TRUE(out.enable[0] && out.enable[1]);
    TEST_ASSERT_EQUAL_INT32(600000, out.force_mN[0]);
    TEST_ASSERT_EQUAL_INT32(-500000, out.force_mN[1]);
}

/* ---- snapshots ---- */

static void test_snapshot_is_published_once_a_millisecond(void)
{
    const uint32_t before = atomic_load(&loop.published);
    for (uint32_t i = 1; i <= 100; i++) {
        tick(9);
        TEST_ASSERT_EQUAL_UINT32(before + i - 1, atomic_load(&loop.published));
        tick(1);
        TEST_ASSERT_EQUAL_UINT32(before + i, atomic_load(&loop.published));
        TEST_ASSERT_EQUAL_UINT32(before + i, servo_loop_snapshot(&loop)->ms);
    }
}

static void test_snapshot_that_is_read_is_not_written_for_a_millisecond(void)
{
    const struct servo_snapshot *s = servo_loop_snapshot(&loop);
    const uint32_t ms = s->ms;
    tick(19);
    TEST_ASSERT_EQUAL_UINT32(ms, s->ms);
}

static void test_snapshot_is_in_units_of_the_wire(void)
{
    atomic_store(&loop.command.controller, CONTROLLER_CCU);
    power();
    tick(9);
    ring.start.nm[0] = 3000; /* reference 3 um ahead */
    tick(10 - loop.ticks % 10);
    const struct servo_snapshot *s = servo_loop_snapshot(&loop);
    TEST_ASSERT_EQUAL_INT32(3000, s->reference_nm[0]);
    TEST_ASSERT_INT32_WITHIN(1, s->position_nm[0] - 3000, s->following_error_nm[0]);
    TEST_ASSERT_INT32_WITHIN(1, s->position_nm[1], s->following_error_nm[1]);
    TEST_ASSERT_INT32_WITHIN(1, s->following_error_nm[0],
                             s->tangential_error_nm); /* at rest the path's direction is x */
    TEST_ASSERT_INT32_WITHIN(1, s->following_error_nm[1], s->contour_error_nm);
    TEST_ASSERT_INT32_WITHIN(1, out.force_mN[0] / 100, s->force_dN[0]);
    TEST_ASSERT_INT32_WITHIN(5, 1000, s->adaptive_gain_per_10s[0]); /* k_0 = 100 1/s */
    TEST_ASSERT_INT32_WITHIN(5, 1000, s->adaptive_gain_per_10s[1]);
    TEST_ASSERT_INT32_WITHIN(5, 6000, s->switching_gain_mmps2[0]); /* mu_0 = 6 m/s2 */
    TEST_ASSERT_EQUAL_INT32(0, s->path_rate_permille);
}

static void test_position_of_an_index_pulse_and_of_an_edge_is_counted_by_the_encoder_of_its_axis(void)
{
    loop.cfg[1] = loop.cfg[0];
    loop.cfg[1].encoder_10fm[1] = 30000000; /* 0.3 um; x has 0.1 um */
    atomic_store(&loop.command.configured, 1);
    wires.count[0] = 1000;
    wires.count[1] = 2000;
    tick(10);
    wires.inputs[0] = HAL_LIMIT_MIN;
    wires.inputs[1] = HAL_LIMIT_MAX;
    wires.index_count[0] = 400;
    wires.index_count[1] = 2500;
    wires.index_pulses[0] = 3;
    wires.index_pulses[1] = 5;
    tick(20);
    const struct servo_snapshot *s = servo_loop_snapshot(&loop);
    TEST_ASSERT_EQUAL_INT32(40000, s->index_nm[0]);
    TEST_ASSERT_EQUAL_INT32(750000, s->index_nm[1]);
    TEST_ASSERT_EQUAL_UINT8(3, s->index_pulses[0]);
    TEST_ASSERT_EQUAL_UINT8(5, s->index_pulses[1]);
    TEST_ASSERT_EQUAL_INT32(100000, s->edge_nm[0]);
    TEST_ASSERT_EQUAL_INT32(600000, s->edge_nm[1]);
    wires.count[0] += 100;
    wires.count[1] += 100;
    wires.inputs[0] |= HAL_STOP; /* another input is no edge of a limit switch */
    tick(20);
    s = servo_loop_snapshot(&loop);
    TEST_ASSERT_EQUAL_INT32(100000, s->edge_nm[0]);
    TEST_ASSERT_EQUAL_INT32(600000, s->edge_nm[1]);
    wires.inputs[1] = 0; /* it opens */
    tick(20);
    s = servo_loop_snapshot(&loop);
    TEST_ASSERT_EQUAL_INT32(100000, s->edge_nm[0]);
    TEST_ASSERT_EQUAL_INT32(630000, s->edge_nm[1]);
}

static void test_positions_that_homing_takes_are_without_what_depends_on_the_origin(void)
{
    loop.cfg[1] = loop.cfg[0];
    loop.cfg[1].servo.geometry = (struct geometry_cfg){.on = true, .dt = loop.cfg[0].servo.dt};
    for (int i = 0; i < 2; i++) {
        struct geometry_axis_cfg *a = &loop.cfg[1].servo.geometry.axis[i];
        a->lead[0] = i == 0 ? NUM(30) : NUM(-40);
        a->half_gap = i == 0 ? NUM(6) : NUM(8);
        a->side_bandwidth = NUM(GEOMETRY_SIDE_BANDWIDTH);
    }
    atomic_store(&loop.command.configured, 1);
    tick(20);
    for (int i = 0; i < 2; i++) { /* both tables were pushed upwards last */
        loop.servo.geometry.axis[i].target = loop.servo.geometry.axis[i].side = NUM(1);
    }
    tick(500);
    wires.index_count[0] = wires.index_count[1] = -10;
    wires.inputs[0] = wires.inputs[1] = HAL_LIMIT_MIN;
    tick(20);
    const struct servo_snapshot *s = servo_loop_snapshot(&loop);
    TEST_ASSERT_INT32_WITHIN(20, 30000 - 6000, s->position_nm[0]);
    TEST_ASSERT_INT32_WITHIN(20, -40000 - 8000, s->position_nm[1]);
    TEST_ASSERT_INT32_WITHIN(1, 30000, s->correction_nm[0]);
    TEST_ASSERT_INT32_WITHIN(1, -40000, s->correction_nm[1]);
    TEST_ASSERT_INT32_WITHIN(1, -6000, s->edge_nm[0]);
    TEST_ASSERT_INT32_WITHIN(1, -8000, s->edge_nm[1]);
    TEST_ASSERT_INT32_WITHIN(1, -6000 - 1000, s->index_nm[0]);
    TEST_ASSERT_INT32_WITHIN(1, -8000 - 1000, s->index_nm[1]);
}

static void test_map_of_the_screw_is_by_the_users_position(void)
{
    loop.cfg[1] = loop.cfg[0];
    struct geometry_cfg *g = &loop.cfg[1].servo.geometry;
    *g = (struct geometry_cfg){.on = true, .dt = loop.cfg[0].servo.dt};
    for (int i = 0; i < 2; i++) {
        g->axis[i] =
            (struct geometry_axis_cfg){.points = 2, .step_nm = 1000000000, .lead = {NUM(0), NUM(1000)}}; /* 1 um/mm */
    }
    atomic_store(&loop.command.origin_nm[0], 5000000);
    atomic_store(&loop.command.origin_nm[1], 7000000);
    atomic_store(&loop.command.configured, 1);
    tick(20);
    const struct servo_snapshot *s = servo_loop_snapshot(&loop);
    TEST_ASSERT_INT32_WITHIN(1, 5000, s->position_nm[0]);
    TEST_ASSERT_INT32_WITHIN(1, 7000, s->position_nm[1]);
    TEST_ASSERT_EQUAL_INT32(0, s->contour_error_greatest_nm);
    atomic_store(&loop.command.range, true);
    power();
    tick(20);
    s = servo_loop_snapshot(&loop); /* of the tool, not of the screw */
    TEST_ASSERT_INT32_WITHIN(52, s->contour_error_nm, s->contour_error_greatest_nm);
    TEST_ASSERT_INT32_WITHIN(52, s->contour_error_nm, s->contour_error_least_nm);
}

/* Both ranges hold what one period of ten has shown, within half a count of 0.1 um, and not longer than a millisecond. */
static void test_range_of_the_contour_error_has_each_period_of_the_millisecond(void)
{
    power(); /* the path stands, so along x is along it */
    tick(10u - loop.phase);
    wires.count[1] = 7;
    tick(10);
    TEST_ASSERT_EQUAL_INT32(0, servo_loop_snapshot(&loop)->contour_error_greatest_nm); /* nobody asks for it */
    wires.count[1] = 0;
    atomic_store(&loop.command.range, true);
    tick(20);
    tick(3);
    wires.count[1] = 7;
    tick(1);
    wires.count[1] = 0;
    tick(2);
    wires.count[1] = -4;
    tick(1);
    wires.count[1] = 0;
    tick(3);
    const struct servo_snapshot *s = servo_loop_snapshot(&loop);
    TEST_ASSERT_INT32_WITHIN(2, 650, s->contour_error_greatest_nm);
    TEST_ASSERT_INT32_WITHIN(2, -350, s->contour_error_least_nm);
    TEST_ASSERT_INT32_WITHIN(300, 0, s->contour_error_nm);
    tick(10);
    s = servo_loop_snapshot(&loop);
    TEST_ASSERT_INT32_WITHIN(52, 0, s->contour_error_greatest_nm);
    TEST_ASSERT_INT32_WITHIN(52, 0, s->contour_error_least_nm);
}

/* x is at the motor's 12.3 mm when it is switched on, and the second encoder counts from any number. */
static void start_with_second(int32_t second_count)
{
    wires.second[0] = second_count;
    wires.count[0] = 123000;
    servo_loop_init(&loop, &hal, &ring);
    loop.cfg[0].servo = configuration_servo(&od_defaults);
    loop.cfg[0].servo.geometry = (struct geometry_cfg){.on = true, .dt = loop.cfg[0].servo.dt};
    loop.cfg[0].servo.dual_feedback[0] =
        (struct dual_feedback_cfg){.on = true, .gain = NUM(0.5), .tolerance = NUM(500)};
    loop.cfg[0].encoder_10fm[0] = loop.cfg[0].encoder_10fm[1] = 10000000;
    loop.cfg[0].second_10fm[0] = 1000000; /* 10 nm */
    loop.cfg[0].stop_time = NUM(100);
    loop.cfg[0].jump_counts[0] = loop.cfg[0].jump_counts[1] = 1000000;
    loop.cfg[0].speed_max = NUM(500);
    tick(500);
}

static void test_position_goes_with_the_second_encoder_from_where_the_first_was_at_power_on(void)
{
    start_with_second(INT32_MAX - 100);
    TEST_ASSERT_INT32_WITHIN(1, 12300000, servo_loop_snapshot(&loop)->position_nm[0]);
    wires.count[0] += 1000;                                          /* 100 um */
    wires.second[0] = (int32_t)((uint32_t)wires.second[0] + 10200u); /* 102 um, and it wraps */
    tick(2000);
    TEST_ASSERT_INT32_WITHIN(2, 12402000, servo_loop_snapshot(&loop)->position_nm[0]);
    TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
    loop.cfg[1] = loop.cfg[0]; /* new parameters leave it where it is */
    atomic_store(&loop.command.configured, 1);
    tick(2000);
    TEST_ASSERT_INT32_WITHIN(2, 12402000, servo_loop_snapshot(&loop)->position_nm[0]);
}

static void test_encoders_that_disagree_are_a_fault_with_and_without_power(void)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        start_with_second(0);
        wires.second[0] = sign * 49990; /* 499.9 um */
        tick(1);
        TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
        wires.second[0] = sign * 50010;
        tick(1);
        TEST_ASSERT_EQUAL_HEX32(FAULT_BIT(FAULT_SECOND_ENCODER), atomic_load(&loop.faults));
    }
}

static void test_velocity_of_the_snapshot_is_in_um_per_s(void)
{
    for (int i = 0; i < 2000; i++) {
        wires.count[0] += 1; /* 0.1 um in 0.1 ms: 1 mm/s */
        wires.count[1] -= 2;
        tick(1);
    }
    TEST_ASSERT_INT32_WITHIN(2, 1000, servo_loop_snapshot(&loop)->velocity_umps[0]);
    TEST_ASSERT_INT32_WITHIN(4, -2000, servo_loop_snapshot(&loop)->velocity_umps[1]);
}

static void test_energy_is_reset_once_for_each_request(void)
{
    power();
    for (int i = 0; i < 3000; i++) {
        ring.start.nm[0] = ring.start.nm[1] = (i / 100) % 2 == 0 ? 50000 : -50000;
        tick(1);
    }
    for (int i = 0; i < 2000; i++) { /* the axes are moved: friction takes energy */
        for (int axis = 0; axis < 2; axis++) {
            wires.count[axis] += 1;
            ring.start.nm[axis] = wires.count[axis] * 100;
        }
        tick(1);
    }
    int32_t before[2];
    memcpy(before, servo_loop_snapshot(&loop)->energy_mJ, sizeof before);
    atomic_store(&loop.command.energy_reset, true);
    tick(10);
    for (int axis = 0; axis < 2; axis++) {
        TEST_ASSERT_TRUE(before[axis] > 0);
        TEST_ASSERT_TRUE(servo_loop_snapshot(&loop)->energy_mJ[axis] < before[axis] / 2);
    }
    TEST_ASSERT_FALSE(atomic_load(&loop.command.energy_reset));
}

/* ---- path ---- */

static void test_begin_starts_path_time_anew(void)
{
    ring.count = 1000;
    atomic_store(&loop.command.run, true);
    atomic_fetch_add(&loop.command.stream, 1u);
    tick(1001);
    TEST_ASSERT_EQUAL_UINT32(101, atomic_load(&loop.executed));
    TEST_ASSERT_FALSE(atomic_load(&loop.standing));
    TEST_ASSERT_EQUAL_INT32(1000, servo_loop_snapshot(&loop)->path_rate_permille);
    TEST_ASSERT_EQUAL_UINT32(1, atomic_load(&loop.stream));
    atomic_store(&loop.command.run, false);
    atomic_fetch_add(&loop.command.stream, 1u);
    tick(1);
    TEST_ASSERT_EQUAL_UINT32(0, atomic_load(&loop.executed));
    TEST_ASSERT_TRUE(atomic_load(&loop.standing));
    TEST_ASSERT_EQUAL_UINT32(2, atomic_load(&loop.stream));
}

static void configure_stop_time(double ms)
{
    const uint32_t next = atomic_load(&loop.command.configured) + 1u;
    loop.cfg[next % 2u] = *loop.cfg_in_use;
    loop.cfg[next % 2u].stop_time = mk(ms);
    atomic_store(&loop.command.configured, next);
}

static void test_path_that_stands_while_it_is_configured_starts_smoothly(void)
{
    ring.count = 1000;
    tick(10);
    configure_stop_time(100);
    atomic_store(&loop.command.run, true);
    tick(10);
    configure_stop_time(200);
    atomic_store(&loop.command.run, false);
    tick(3000);
    TEST_ASSERT_TRUE(atomic_load(&loop.standing));
    const uint32_t executed = atomic_load(&loop.executed);
    configure_stop_time(100);
    atomic_store(&loop.command.run, true);
    tick(50);
    TEST_ASSERT_UINT32_WITHIN(1, executed, atomic_load(&loop.executed)); /* from rest in 100 ms */
}

static void test_path_slows_down_when_a_stop_takes_longer_by_a_new_configuration(void)
{
    ring.count = 1000;
    atomic_store(&loop.command.run, true);
    tick(9000); /* 100 knots are left, twice as many as a stop takes */
    TEST_ASSERT_FALSE(atomic_load(&loop.starved));
    configure_stop_time(400);
    tick(1);
    TEST_ASSERT_TRUE(atomic_load(&loop.starved));
}

static void test_reference_of_a_stream_is_its_own_from_the_first_period_on(void)
{
    power();
    ring.count = 200;
    for (uint32_t i = 0; i < ring.count; i++) {
        ring.knot[i].nm[0] = ring.start.nm[0];
        ring.knot[i].nm[1] = ring.start.nm[1];
    }
    atomic_store(&loop.command.run, true);
    atomic_fetch_add(&loop.command.stream, 1u);
    tick(35); /* knots 0 to 3 have been used */
    for (uint32_t i = 0; i < ring.count; i++) {
        ring.knot[i].nm[0] += 10000;
    }
    ring.start.nm[0] += 10000;
    atomic_fetch_add(&loop.command.stream, 1u);
    for (int ms = 0; ms < 4; ms++) {
        tick(10);
        TEST_ASSERT_EQUAL_INT32(ring.start.nm[0], servo_loop_snapshot(&loop)->reference_nm[0]);
    }
}

static void test_end_of_a_complete_stream_is_distinguished_from_a_stop(void)
{
    ring.count = 100;
    atomic_store(&loop.command.run, true);
    atomic_store(&loop.command.complete, true);
    tick(500);
    TEST_ASSERT_FALSE(atomic_load(&loop.at_end));
    atomic_store(&loop.command.run, false);
    tick(400);
    TEST_ASSERT_FALSE(atomic_load(&loop.at_end)); /* a stop takes 50 knots: at 99 it would be at its end */
    start(0, 0);
    atomic_store(&loop.command.run, true);
    atomic_store(&loop.command.complete, true);
    tick(1100);
    TEST_ASSERT_TRUE(atomic_load(&loop.at_end));
    TEST_ASSERT_TRUE(atomic_load(&loop.standing));
    TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
}

static void test_want_of_knots_is_reported_until_the_path_is_at_full_rate_again(void)
{
    ring.count = 200;
    atomic_store(&loop.command.run, true);
    tick(1400);
    TEST_ASSERT_FALSE(atomic_load(&loop.starved));
    tick(400);
    TEST_ASSERT_TRUE(atomic_load(&loop.starved));
    ring.count = 900;
    unsigned changes = 0;
    for (int i = 0; i < 2000; i++) {
        const bool before = atomic_load(&loop.starved);
        tick(1);
        changes += before != atomic_load(&loop.starved) ? 1 : 0;
    }
    TEST_ASSERT_FALSE(atomic_load(&loop.starved));
    TEST_ASSERT_EQUAL_UINT(1, changes);
    TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&loop.faults));
    tick(10000);
    TEST_ASSERT_EQUAL_HEX32(FAULT_BIT(FAULT_UNDERRUN), atomic_load(&loop.faults));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_each_tick_reads_once_then_writes_once);
    RUN_TEST(test_init_leaves_both_axes_without_power_at_their_encoders);
    RUN_TEST(test_force_answers_the_encoders_of_the_same_tick);
    RUN_TEST(test_force_is_zero_without_power);
    RUN_TEST(test_brake_is_released_with_the_law_active_and_engaged_before_it_ends_or_with_a_cut);
    RUN_TEST(test_axis_without_power_gets_no_force_while_the_other_one_is_held);
    RUN_TEST(test_position_goes_on_when_the_counter_wraps_upwards);
    RUN_TEST(test_position_is_count_times_length);
    RUN_TEST(test_length_of_a_count_is_exact_to_ten_femtometres);
    RUN_TEST(test_position_by_a_new_length_is_the_one_that_all_counts_would_have_led_to);
    RUN_TEST(test_position_some_counts_before_is_that_of_so_many_counts_less);
    RUN_TEST(test_new_configuration_takes_the_axes_where_they_are_and_at_rest);
    RUN_TEST(test_second_configuration_before_a_tick_is_taken_over_like_the_first);
    RUN_TEST(test_following_error_cuts_the_power_in_the_period_that_sees_it);
    RUN_TEST(test_encoder_jump_counts_for_an_axis_with_power_alone_and_by_its_own_limit);
    RUN_TEST(test_following_error_within_its_window_is_no_fault);
    RUN_TEST(test_overspeed_cuts_the_power_in_the_period_that_sees_it);
    RUN_TEST(test_overspeed_counts_for_an_axis_with_power_alone);
    RUN_TEST(test_axis_outside_the_limits_is_no_fault_while_it_is_where_its_reference_is);
    RUN_TEST(test_limits_are_the_users_and_move_with_the_origin);
    RUN_TEST(test_following_error_may_last_as_long_as_its_timeout);
    RUN_TEST(test_following_error_of_an_axis_is_timed_whether_the_other_one_has_power_or_an_error);
    RUN_TEST(test_following_error_is_timed_anew_when_its_axis_gets_power_again);
    RUN_TEST(test_travel_ends_where_the_limits_and_the_window_do);
    RUN_TEST(test_limits_and_window_of_each_axis_are_its_own);
    RUN_TEST(test_travel_ends_where_positions_of_32_bits_do);
    RUN_TEST(test_axis_without_power_has_no_limits);
    RUN_TEST(test_fault_of_the_amplifier_or_encoder_cuts_both_axes_in_the_same_period);
    RUN_TEST(test_fault_with_a_path_stop_keeps_the_power);
    RUN_TEST(test_force_stays_within_its_limit);
    RUN_TEST(test_snapshot_is_published_once_a_millisecond);
    RUN_TEST(test_snapshot_that_is_read_is_not_written_for_a_millisecond);
    RUN_TEST(test_snapshot_is_in_units_of_the_wire);
    RUN_TEST(test_position_of_an_index_pulse_and_of_an_edge_is_counted_by_the_encoder_of_its_axis);
    RUN_TEST(test_positions_that_homing_takes_are_without_what_depends_on_the_origin);
    RUN_TEST(test_map_of_the_screw_is_by_the_users_position);
    RUN_TEST(test_position_goes_with_the_second_encoder_from_where_the_first_was_at_power_on);
    RUN_TEST(test_encoders_that_disagree_are_a_fault_with_and_without_power);
    RUN_TEST(test_velocity_of_the_snapshot_is_in_um_per_s);
    RUN_TEST(test_energy_is_reset_once_for_each_request);
    RUN_TEST(test_begin_starts_path_time_anew);
    RUN_TEST(test_path_that_stands_while_it_is_configured_starts_smoothly);
    RUN_TEST(test_path_slows_down_when_a_stop_takes_longer_by_a_new_configuration);
    RUN_TEST(test_reference_of_a_stream_is_its_own_from_the_first_period_on);
    RUN_TEST(test_end_of_a_complete_stream_is_distinguished_from_a_stop);
    RUN_TEST(test_want_of_knots_is_reported_until_the_path_is_at_full_rate_again);
    RUN_TEST(test_range_of_the_contour_error_has_each_period_of_the_millisecond);
    return UNITY_END();
}
