/* SPDX-License-Identifier: Apache-2.0 */
/* Outputs that are tied to knots, over the wire: in the tick of their knot, once, and off at each stop. */
#include "test_device.h"

enum { RESUME = 3, RELEASE = 4 };
enum { SPINDLE = 1, COOLANT = 8, HOLD = 0x4000, BY_RATE = 0x8000 };
enum { REJECTED_SEQUENCE = 14, REJECTED_CRC, REJECTED_FULL, REJECTED_STATE };

struct change {
    unsigned knot;
    uint16_t digital, power;
};

static uint32_t sum; /* CRC-32 of the changes that were sent, without its final inversion */

static void add_to_sum(uint32_t value)
{
    for (unsigned bit = 0; bit < 32; bit++) {
        sum = sum >> 1 ^ (((sum ^ value >> bit) & 1u) != 0 ? 0xEDB88320u : 0u);
    }
}

static void enable(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1404, 1, 4, 0x501)); /* RPDO5 is off by default */
    rig_enable(&rig);
}

/* An outputs frame; returns what it changes the CRC of its knot by. */
static uint8_t send_outputs(uint8_t sequence, uint16_t digital, uint16_t power)
{
    const struct od_knot_outputs frame = {.sequence = sequence, .digital = digital, .power = power};
    uint8_t data[6] = {sequence, queue_outputs_crc8(&frame)};
    co_put(&data[2], digital, 2);
    co_put(&data[4], power, 2);
    rig_send(&rig, 0x501, 6, data);
    return data[1] | 1u;
}

static void send_knot(unsigned n, uint8_t chain)
{
    const struct knot now = rig_stream_knot(&stream, n);
    const struct knot before = n == 0 ? (struct knot){{stream.x, stream.y}} : rig_stream_knot(&stream, n - 1);
    const struct od_knot knot = {
        .sequence = (uint8_t)n, .dx = now.nm[0] - before.nm[0], .dy = now.nm[1] - before.nm[1]};
    uint8_t data[8] = {knot.sequence, queue_crc8(&knot) ^ chain};
    co_put(&data[2], (uint32_t)knot.dx, 3);
    co_put(&data[5], (uint32_t)knot.dy, 3);
    rig_send(&rig, 0x301, 8, data);
}

/* Begin a stream of 800 knots, and send all with these changes. */
static void fill(const struct change *changes, unsigned count)
{
    sum = 0xFFFFFFFFu;
    enable();
    stream = (struct rig_stream){.count = 800, .length_nm = 40e6};
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    for (unsigned n = 0, next = 0; n < stream.count; n++) {
        uint8_t chain = 0;
        if (next < count && changes[next].knot == n) {
            chain = send_outputs((uint8_t)n, changes[next].digital, changes[next].power);
            add_to_sum(n);
            add_to_sum((uint32_t)changes[next].power << 16 | changes[next].digital);
            next++;
        }
        send_knot(n, chain);
    }
    TEST_ASSERT_EQUAL_UINT32(800, rig_read(&rig, 0x2200, 7));
}

static void run(void)
{
    rig_controlwords(&rig, RUN, RUN);
}

static void expect_outputs(unsigned digital, unsigned power)
{
    TEST_ASSERT_EQUAL_HEX16(digital, rig.out.digital);
    TEST_ASSERT_EQUAL_UINT16(power, rig.out.power);
}

static void expect_all_done_once(unsigned changes)
{
    rig_ms(&rig, 1000);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_EQUAL_UINT32(changes, rig_read(&rig, 0x2180, 3));
    TEST_ASSERT_EQUAL_HEX32(~sum, rig_read(&rig, 0x2180, 4));
    expect_outputs(0, 0);
}

static const struct change laser[] = {
    {100, SPINDLE, 0},           {101, SPINDLE, 65535},           {103, SPINDLE | COOLANT, 1000},
    {104, SPINDLE | COOLANT, 0}, {600, SPINDLE | COOLANT, 40000}, {790, 0, 0}};
enum { CHANGES = sizeof laser / sizeof laser[0] };

static void test_each_output_changes_in_the_tick_of_its_knot(void)
{
    fill(laser, CHANGES);
    run();
    uint32_t seen = 0;
    unsigned next = 0, since = 0;
    for (unsigned period = 0; period < 8000; period++) {
        rig_run(&rig, 1);
        const uint32_t now = (uint32_t)rig.out.power << 16 | rig.out.digital;
        if (now != seen) {
            TEST_ASSERT_LESS_THAN_UINT(CHANGES, next);
            TEST_ASSERT_EQUAL_HEX32((uint32_t)laser[next].power << 16 | laser[next].digital, now);
            TEST_ASSERT_EQUAL_UINT(laser[next].knot, rig.device.drive.loop.path.at.knot);
            if (next > 0) {
                TEST_ASSERT_EQUAL_UINT(10u * (laser[next].knot - laser[next - 1].knot), period - since);
            }
            seen = now;
            since = period;
            next++;
        }
    }
    TEST_ASSERT_EQUAL_UINT(CHANGES, next);
    expect_all_done_once(CHANGES);
}

static void test_outputs_are_told_by_their_objects(void)
{
    fill(laser, CHANGES);
    run();
    rig_ms(&rig, 650);
    TEST_ASSERT_EQUAL_HEX32(SPINDLE | COOLANT, rig_read(&rig, 0x2180, 1));
    TEST_ASSERT_EQUAL_UINT32(40000, rig_read(&rig, 0x2180, 2));
    TEST_ASSERT_EQUAL_UINT32(5, rig_read(&rig, 0x2180, 3));
    TEST_ASSERT_EQUAL_HEX32((SPINDLE | COOLANT) << 16, rig_read(&rig, 0x60FE, 1)); /* and the brakes are released */
    TEST_ASSERT_EQUAL_HEX32((SPINDLE | COOLANT) << 16, rig_read(&rig, 0x68FE, 1));
}

static void check_stop(uint16_t controlword)
{
    fill(laser, CHANGES);
    run();
    rig_ms(&rig, 650);
    rig_controlwords(&rig, controlword, controlword);
    rig_run(&rig, 1);
    expect_outputs(0, 0);
    rig_ms(&rig, 300);
    expect_outputs(0, 0);
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    run();
    rig_run(&rig, 1);
    expect_outputs(SPINDLE | COOLANT, 40000);
    expect_all_done_once(CHANGES);
}

static void test_halt_switches_all_off_in_one_tick_and_what_was_on_comes_back(void)
{
    check_stop(HALT);
}

static void test_clearing_bit_4_switches_all_off_in_one_tick(void)
{
    check_stop(ENABLE);
}

static void test_what_is_kept_stays_on_at_a_halt_but_not_at_a_fault(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2181, 0, 2, COOLANT | 0x10));
    fill(laser, CHANGES);
    run();
    rig_ms(&rig, 650);
    rig_controlwords(&rig, HALT, HALT);
    rig_ms(&rig, 300);
    expect_outputs(COOLANT, 0);
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_run(&rig, 1);
    expect_outputs(0, 0);
}

static void test_what_is_kept_goes_off_with_the_power_and_with_the_next_stream(void)
{
    static const struct change on[] = {{50, COOLANT, 500}};
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2181, 0, 2, COOLANT));
    fill(on, 1);
    run();
    rig_ms(&rig, 900);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    expect_outputs(COOLANT, 0);
    rig_controlwords(&rig, ENABLE, ENABLE);
    stream.length_nm = -20e6;
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    rig_run(&rig, 1);
    expect_outputs(0, 0);
    rig_feed(&rig, &stream, stream.count);
    run();
    rig_ms(&rig, 100);
    expect_outputs(0, 0);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2180, 3));
}

static void test_power_off_of_an_axis_switches_what_is_kept_off(void)
{
    static const struct change on[] = {{50, COOLANT, 500}};
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2181, 0, 2, COOLANT));
    for (unsigned axis = 0; axis < 2; axis++) {
        setUp();
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2181, 0, 2, COOLANT));
        fill(on, 1);
        run();
        rig_ms(&rig, 300);
        rig_controlwords(&rig, ENABLE, ENABLE);
        rig_ms(&rig, 300);
        expect_outputs(COOLANT, 0);
        rig_controlwords(&rig, axis == 0 ? SWITCH_ON : ENABLE, axis == 1 ? SWITCH_ON : ENABLE);
        rig_run(&rig, 1);
        expect_outputs(0, 0);
    }
}

static void test_fault_switches_off_in_the_tick_that_sees_it(void)
{
    fill(laser, CHANGES);
    run();
    rig_ms(&rig, 650);
    expect_outputs(SPINDLE | COOLANT, 40000);
    rig.inputs[1] = HAL_AMPLIFIER_FAULT;
    rig_run(&rig, 1);
    expect_outputs(0, 0);
    expect_power(false, false);
}

static void test_limit_switch_switches_off_what_is_kept_too_in_the_tick_that_sees_it(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2181, 0, 2, COOLANT));
    for (unsigned axis = 0; axis < 2; axis++) {
        setUp();
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2181, 0, 2, COOLANT));
        fill(laser, CHANGES);
        run();
        rig_ms(&rig, 650);
        rig.inputs[axis] = axis == 0 ? HAL_LIMIT_MAX : HAL_LIMIT_MIN;
        rig_run(&rig, 1);
        expect_outputs(0, 0);
        rig_ms(&rig, 400);
        expect_fault(0xFF12);
        expect_outputs(0, 0);
    }
}

/* The heartbeat is there again; the fault is reset, the axes are enabled, and the stream is resumed. */
static void come_back(void)
{
    rig.heartbeat_every_ms = 50;
    rig_ms(&rig, 100);
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords(&rig, SWITCH_ON, SWITCH_ON);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, RESUME));
}

static void test_fault_that_stops_on_the_path_switches_off_and_resuming_brings_the_outputs_back(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2181, 0, 2, COOLANT));
    fill(laser, CHANGES);
    run();
    rig_ms(&rig, 460);
    rig.heartbeat_every_ms = 0;
    unsigned period = 0;
    while (rig.device.drive.faults == 0) {
        rig_run(&rig, 1);
        TEST_ASSERT_LESS_THAN_UINT(4000, ++period);
    }
    rig_run(&rig, 1);
    expect_outputs(0, 0);
    expect_power(true, true); /* they stop on the path first */
    rig_ms(&rig, 400);
    come_back();
    expect_outputs(0, 0);
    run();
    rig_run(&rig, 1);
    expect_outputs(SPINDLE | COOLANT, 40000);
    expect_all_done_once(CHANGES);
}

static void test_override_of_0_switches_off_and_a_lower_one_does_not(void)
{
    fill(laser, CHANGES);
    run();
    rig_ms(&rig, 620);
    rig_write(&rig, 0x2131, 0, 2, 500);
    rig_ms(&rig, 100);
    expect_outputs(SPINDLE | COOLANT, 40000);
    rig_write(&rig, 0x2131, 0, 2, 0);
    rig_run(&rig, 1);
    expect_outputs(0, 0);
    rig_ms(&rig, 300);
    rig_write(&rig, 0x2131, 0, 2, 1200);
    rig_run(&rig, 1);
    expect_outputs(SPINDLE | COOLANT, 40000);
    expect_all_done_once(CHANGES);
}

static void test_power_by_rate_goes_with_the_override_and_ends_at_its_range(void)
{
    static const struct change on[] = {{50, SPINDLE | BY_RATE, 40000}, {400, SPINDLE | BY_RATE, 60000}, {700, 0, 0}};
    fill(on, 3);
    run();
    rig_ms(&rig, 100);
    expect_outputs(SPINDLE, 40000);
    rig_write(&rig, 0x2131, 0, 2, 500);
    rig_ms(&rig, 200);
    expect_outputs(SPINDLE, 20000);
    rig_write(&rig, 0x2131, 0, 2, 1200);
    rig_ms(&rig, 100);
    expect_outputs(SPINDLE, 48000);
    rig_ms(&rig, 150);
    expect_outputs(SPINDLE, 65535);
    expect_all_done_once(3);
}

/* ---- holds ---- */

static const struct change hold[] = {{50, SPINDLE, 700}, {300, SPINDLE | HOLD, 900}, {700, 0, 0}};

static void test_path_is_held_at_its_knot_until_it_is_released(void)
{
    fill(hold, 3);
    run();
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, RELEASE));
    rig_ms(&rig, 290);
    while (rig.device.drive.loop.path.at.knot < 300) {
        expect_outputs(SPINDLE, 700);
        rig_run(&rig, 1);
    }
    expect_outputs(0, 0);
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_UINT32(301, rig_read(&rig, 0x2180, 5));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, RELEASE)); /* it does not stand yet */
    rig_ms(&rig, 200);
    expect_standing_on_the_line();
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    TEST_ASSERT_UINT32_WITHIN(3, 351, rig_read(&rig, 0x2200, 8)); /* half of the stop time further on */
    rig_ms(&rig, 1000);
    rig_controlwords(&rig, ENABLE, ENABLE);
    run();
    rig_ms(&rig, 100);
    expect_standing_on_the_line();
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, RELEASE));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, RELEASE));
    rig_run(&rig, 2);
    expect_outputs(SPINDLE, 900);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2180, 5));
    expect_all_done_once(3);
}

static void test_hold_lasts_over_a_fault(void)
{
    fill(hold, 3);
    run();
    rig_ms(&rig, 500);
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 400);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    come_back();
    run();
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL_UINT32(301, rig_read(&rig, 0x2180, 5));
    TEST_ASSERT_EQUAL_UINT32(STOPPED, stream_state());
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, RELEASE));
    expect_all_done_once(3);
}

/* The path comes to a stop around the hold, which is 10 knots ahead and so passed on the way. */
static void check_hold_passed_at_a_stop(void (*stop)(void), void (*go_on)(void))
{
    setUp();
    fill(hold, 3);
    run();
    while (rig.device.drive.loop.path.at.knot < 290) {
        rig_run(&rig, 1);
    }
    stop();
    rig_ms(&rig, 300);
    TEST_ASSERT_GREATER_THAN_UINT32(301, rig_read(&rig, 0x2200, 8));
    TEST_ASSERT_EQUAL_UINT32(301, rig_read(&rig, 0x2180, 5));
    const uint32_t at = rig_read(&rig, 0x2200, 8);
    go_on();
    rig_ms(&rig, 200);
    TEST_ASSERT_EQUAL_UINT32(at, rig_read(&rig, 0x2200, 8));
    expect_outputs(0, 0);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, RELEASE));
    rig_run(&rig, 2);
    expect_outputs(SPINDLE, 900);
    expect_all_done_once(3);
}

static void clear_bit_4(void)
{
    rig_controlwords(&rig, ENABLE, ENABLE);
}

static void override_0(void)
{
    rig_write(&rig, 0x2131, 0, 2, 0);
}

static void override_1(void)
{
    rig_write(&rig, 0x2131, 0, 2, 1000);
}

static void underrun(void)
{
    servo_loop_raise(&rig.device.drive.loop, FAULT_UNDERRUN);
}

static void come_back_and_run(void)
{
    come_back();
    run();
}

static void test_hold_that_is_passed_on_the_way_to_a_stop_holds_what_goes_on(void)
{
    check_hold_passed_at_a_stop(clear_bit_4, run);
    check_hold_passed_at_a_stop(override_0, override_1);
    check_hold_passed_at_a_stop(underrun, come_back_and_run);
}

static void check_new_stream(bool released)
{
    setUp();
    fill(hold, 3);
    run();
    rig_ms(&rig, 500);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    if (released) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, RELEASE));
    }
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 2));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2200, 1, 1, RELEASE));
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    rig_feed(&rig, &stream, stream.count);
    run();
    rig_ms(&rig, 900);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2180, 5));
}

static void test_new_stream_ends_a_hold(void)
{
    check_new_stream(false);
    check_new_stream(true);
}

/* The path stands a tenth of a knot before the hold, goes on slowly, and so is held at that very knot. */
static void test_path_goes_on_from_the_knot_of_the_hold_itself(void)
{
    fill(hold, 3);
    run();
    while (rig.device.drive.loop.path.at.knot < 249) {
        rig_run(&rig, 1);
    }
    rig_run(&rig, 9);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 200);
    TEST_ASSERT_EQUAL_UINT32(299, rig.device.drive.loop.path.at.knot);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2180, 5));
    rig_write(&rig, 0x2131, 0, 2, 1); /* 0.1 % */
    run();
    rig_ms(&rig, 300);
    TEST_ASSERT_EQUAL_UINT32(300, rig.device.drive.loop.path.at.knot);
    TEST_ASSERT_EQUAL_UINT32(301, rig_read(&rig, 0x2180, 5));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, RELEASE));
    rig_write(&rig, 0x2131, 0, 2, 1000);
    expect_all_done_once(3);
}

/* An underrun is found by the tick, and only stops the axes on the path. */
static void test_fault_of_the_tick_that_stops_on_the_path_switches_off_in_its_tick(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2181, 0, 2, COOLANT));
    fill(laser, CHANGES);
    run();
    rig_ms(&rig, 650);
    servo_loop_raise(&rig.device.drive.loop, FAULT_UNDERRUN);
    device_tick(&rig.device);
    expect_outputs(0, 0);
}

/* ---- frames ---- */

static void begin_only(void)
{
    enable();
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
}

static void expect_accepted(unsigned knots)
{
    TEST_ASSERT_EQUAL_UINT32(knots, rig_read(&rig, 0x2200, 7));
}

static void test_knot_is_refused_without_its_outputs_whatever_these_are(void)
{
    begin_only();
    for (unsigned power = 0; power < 300; power++) {
        const struct od_knot_outputs lost = {.digital = SPINDLE, .power = (uint16_t)power};
        send_knot(0, queue_outputs_crc8(&lost) | 1u);
    }
    expect_accepted(0);
    TEST_ASSERT_EQUAL_UINT32(300, rig_read(&rig, 0x2200, REJECTED_CRC));
    send_knot(0, send_outputs(0, SPINDLE, 5));
    expect_accepted(1);
}

static void test_knot_without_outputs_is_refused_behind_an_outputs_frame(void)
{
    begin_only();
    send_outputs(0, SPINDLE, 5);
    send_knot(0, 0);
    expect_accepted(0);
    send_knot(0, send_outputs(0, SPINDLE, 5)); /* the host goes back, and sends both again */
    send_knot(1, 0);
    expect_accepted(2);
}

static void test_outputs_of_another_knot_are_refused_and_told_at_once(void)
{
    begin_only();
    send_knot(0, 0);
    const unsigned before = rig.status_count;
    send_outputs(0, SPINDLE, 5);
    send_outputs(2, SPINDLE, 5);
    TEST_ASSERT_EQUAL_UINT32(2, rig_read(&rig, 0x2200, REJECTED_SEQUENCE));
    TEST_ASSERT_EQUAL_UINT(before + 2, rig.status_count);
    send_knot(1, 0);
    expect_accepted(2);
}

static void test_every_bit_error_of_an_outputs_frame_is_refused(void)
{
    const struct od_knot_outputs good = {.digital = SPINDLE | COOLANT, .power = 12345};
    begin_only();
    for (unsigned bit = 0; bit < 48; bit++) {
        uint8_t data[6] = {0, queue_outputs_crc8(&good), SPINDLE | COOLANT, 0, 12345 & 0xFF, 12345 >> 8};
        data[bit / 8] ^= (uint8_t)(1u << bit % 8);
        rig_send(&rig, 0x501, 6, data);
        rig_ms(&rig, 1);
    }
    TEST_ASSERT_EQUAL_UINT32(48, rig_read(&rig, 0x2200, REJECTED_CRC));
    send_knot(0, 0);
    expect_accepted(1);
}

static void test_outputs_are_refused_without_a_stream_and_while_an_axis_jogs(void)
{
    enable();
    send_outputs(0, SPINDLE, 5);
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, REJECTED_STATE));
    rig_write(&rig, 0x60FF, 0, 4, 10000);
    rig_write(&rig, 0x6060, 0, 1, 3);
    rig_ms(&rig, 50);
    TEST_ASSERT_TRUE(rig.device.drive.path.modes.generating);
    send_outputs((uint8_t)rig_read(&rig, 0x2200, 7), SPINDLE, 5);
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2200, REJECTED_STATE)); /* counted anew with the jog */
    rig_ms(&rig, 50);
    expect_outputs(0, 0);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_each_output_changes_in_the_tick_of_its_knot);
    RUN_TEST(test_outputs_are_told_by_their_objects);
    RUN_TEST(test_halt_switches_all_off_in_one_tick_and_what_was_on_comes_back);
    RUN_TEST(test_clearing_bit_4_switches_all_off_in_one_tick);
    RUN_TEST(test_what_is_kept_stays_on_at_a_halt_but_not_at_a_fault);
    RUN_TEST(test_what_is_kept_goes_off_with_the_power_and_with_the_next_stream);
    RUN_TEST(test_power_off_of_an_axis_switches_what_is_kept_off);
    RUN_TEST(test_fault_switches_off_in_the_tick_that_sees_it);
    RUN_TEST(test_limit_switch_switches_off_what_is_kept_too_in_the_tick_that_sees_it);
    RUN_TEST(test_fault_that_stops_on_the_path_switches_off_and_resuming_brings_the_outputs_back);
    RUN_TEST(test_override_of_0_switches_off_and_a_lower_one_does_not);
    RUN_TEST(test_power_by_rate_goes_with_the_override_and_ends_at_its_range);
    RUN_TEST(test_path_is_held_at_its_knot_until_it_is_released);
    RUN_TEST(test_hold_lasts_over_a_fault);
    RUN_TEST(test_hold_that_is_passed_on_the_way_to_a_stop_holds_what_goes_on);
    RUN_TEST(test_new_stream_ends_a_hold);
    RUN_TEST(test_path_goes_on_from_the_knot_of_the_hold_itself);
    RUN_TEST(test_fault_of_the_tick_that_stops_on_the_path_switches_off_in_its_tick);
    RUN_TEST(test_knot_is_refused_without_its_outputs_whatever_these_are);
    RUN_TEST(test_knot_without_outputs_is_refused_behind_an_outputs_frame);
    RUN_TEST(test_outputs_of_another_knot_are_refused_and_told_at_once);
    RUN_TEST(test_every_bit_error_of_an_outputs_frame_is_refused);
    RUN_TEST(test_outputs_are_refused_without_a_stream_and_while_an_axis_jogs);
    return UNITY_END();
}
