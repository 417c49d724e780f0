/* SPDX-License-Identifier: Apache-2.0 */
/* Gives frames, inputs of the drive and time to the whole firmware on a simulated machine. The input is read as steps
 * (enum step). After each step the rules of test_drive_rules.h hold. The first byte of the input chooses the state in
 * which the drive begins (enum start). Each state is reached once and copied for each input, so that a few control
 * periods are enough to get anywhere. */
#include <stddef.h>
#include <string.h>

#include "bytes.h"
#include "test_drive_rules.h"

enum step {
    TIME,
    FRAME,
    SDO,
    CONTROLWORDS,
    KNOTS,
    RECORD,
    NMT,
    LSS,
    HEARTBEAT,
    SYNC,
    INPUTS,
    BUS_FULL,
    ENABLE,
    BEGIN,
    STORE,
    MODE,
    STEPS
};
enum start {
    POWER_ON,
    OPERATIONAL,
    SWITCHED_ON,
    ENABLED,
    FILLED,
    RUNNING,
    SILENT_HOST,
    STOPPING,
    STOPPED,
    FAULT,
    JOG,
    HOMING,
    RECORDS,
    CONFIGURING,
    UNCONFIGURED,
    STORED,
    DOWNLOAD,
    UPLOAD,
    STARTS
};
enum { STEPS_MAX = 60, PERIODS = 24, PERIODS_LONG = 300, LONG = 0xF8, OPERATIONS = 10 };

static struct rig start[STARTS];
static bool full;
static unsigned periods_left;
static uint32_t operations_before; /* flash operations before the first step */

static bool can_send(void *ctx, const struct can_frame *frame)
{
    see(frame);
    return !full && rig_can_send(ctx, frame);
}

static void let_pass(unsigned periods)
{
    for (; periods > 0 && periods_left > 0; periods--, periods_left--) {
        expect_no_force_while_off();
    }
}

static void request(uint8_t command_byte, uint16_t index, uint8_t sub, uint32_t value)
{
    struct can_frame f = {.id = (uint16_t)(0x600u + node_id()), .len = 8, .data = {command_byte}};
    co_put(&f.data[1], index, 2);
    f.data[3] = sub;
    co_put(&f.data[4], value, 4);
    give(&f);
}

static void controlwords(uint16_t x, uint16_t y)
{
    struct can_frame f = {.id = (uint16_t)(0x200u + node_id()), .len = 4};
    co_put(&f.data[0], x, 2);
    co_put(&f.data[2], y, 2);
    give(&f);
}

static void enable(void)
{
    command(0, 2, 1, 0);
    command(0x77F, 1, 5, 0);
    for (uint8_t i = 0; i < 3; i++) {
        static const uint8_t words[] = {0x06, 0x07, 0x0F};
        controlwords(words[i], words[i]);
        let_pass(2);
    }
}

/* Begin a stream where the axes are. Its knots have to follow. */
static void begin(void)
{
    for (uint8_t axis = 0; axis < 2; axis++) {
        request(0x23, 0x2200, (uint8_t)(2 + axis), (uint32_t)rig.device.od.axis[axis].position_actual);
    }
    request(0x2F, 0x2200, 1, 1);
}

static void knots(struct bytes *in)
{
    const unsigned count = bytes_u8(in) % 16;
    const int32_t dx = (int8_t)bytes_u8(in) * 8, dy = (int8_t)bytes_u8(in) * 8;
    for (unsigned i = 0; i < count; i++) {
        const struct od_knot k = {.sequence = (uint8_t)(rig.device.od.stream.accepted16 & 0xFFu), .dx = dx, .dy = dy};
        struct can_frame f = {.id = (uint16_t)(0x300u + node_id()), .len = 8, .data = {k.sequence, queue_crc8(&k)}};
        co_put(&f.data[2], (uint32_t)dx, 3);
        co_put(&f.data[5], (uint32_t)dy, 3);
        give(&f);
    }
}

static void frame_to(struct bytes *in, unsigned id, unsigned len)
{
    struct can_frame f = {.id = (uint16_t)(id & 0x7FFu), .len = (uint8_t)len};
    for (unsigned i = 0; i < len; i++) {
        f.data[i] = bytes_u8(in);
    }
    give(&f);
}

static void any_frame(struct bytes *in)
{
    const uint32_t head = bytes_number(in, 2);
    struct can_frame f = {
        .id = (uint16_t)(head & 0x7FFu), .len = (uint8_t)((head >> 11) % 9), .rtr = (head >> 15) != 0};
    for (unsigned i = 0; i < f.len; i++) {
        f.data[i] = bytes_u8(in);
    }
    give(&f);
}

static void record(struct bytes *in)
{
    struct can_frame f = {.id = (uint16_t)(0x400u + node_id()), .len = 8};
    for (unsigned axis = 0; axis < 2; axis++) {
        const uint32_t distance = (uint32_t)((int16_t)bytes_number(in, 2));
        co_put(&f.data[4 * axis], (uint32_t)rig.device.od.axis[axis].position_actual + distance, 4);
    }
    give(&f);
}

static void mode(uint8_t what)
{
    static const int32_t writes[][3] = {{0x6060, 1, 7},     {0x6060, 1, 3},      {0x6060, 1, 6},
                                        {0x60FF, 4, 20000}, {0x60FF, 4, -20000}, {0x6098, 1, 35}};
    const int32_t *w = writes[what / 4 % 6];
    const uint8_t size = (uint8_t)w[1];
    for (uint16_t axis = 0; axis < 2; axis++) {
        if ((what & 3) != 2 + axis) { /* one axis, or both */
            request((uint8_t)(0x23 | (4 - size) << 2), (uint16_t)((unsigned)w[0] + 0x800u * axis), 0, (uint32_t)w[2]);
        }
    }
}

static void run_step(struct bytes *in)
{
    switch (bytes_u8(in) % STEPS) {
    case TIME: let_pass(1u + bytes_u8(in) % 32); break;
    case FRAME: any_frame(in); break;
    case SDO: {
        const struct od_entry *e = &od_table[bytes_number(in, 2) % od_table_len];
        const uint8_t command_byte = bytes_u8(in);
        request(command_byte, e->index, e->sub, bytes_number(in, 4));
        break;
    }
    case CONTROLWORDS: {
        const uint32_t words = bytes_number(in, 4);
        controlwords((uint16_t)words, (uint16_t)(words >> 16));
        break;
    }
    case KNOTS: knots(in); break;
    case RECORD: record(in); break;
    case NMT: command(0, 2, bytes_u8(in), 0); break;
    case LSS: frame_to(in, 0x7E5, 8); break;
    case HEARTBEAT: command((uint16_t)(0x700u + bytes_u8(in) % 128), 1, 5, 0); break;
    case SYNC: command(0x80, 0, 0, 0); break;
    case INPUTS:
        rig.inputs[0] = bytes_u8(in);
        rig.inputs[1] = bytes_u8(in);
        break;
    case BUS_FULL: full = !full; break;
    case ENABLE: enable(); break;
    case BEGIN: begin(); break;
    case STORE: {
        const bool save = bytes_u8(in) % 2 == 0;
        if (rig.flash.operations - operations_before < OPERATIONS) { /* one save takes longer than all other steps */
            request(0x23, save ? 0x1010 : 0x1011, bytes_u8(in) % 4, save ? 0x65766173 : 0x64616F6C);
        }
        break;
    }
    case MODE: mode(bytes_u8(in)); break;
    default: break;
    }
}

static void expect_state(enum cia402_state state)
{
    TEST_ASSERT_EQUAL(state, rig.device.drive.axis[0].state);
    TEST_ASSERT_EQUAL(state, rig.device.drive.axis[1].state);
}

/* Enable both axes in a mode of operation. */
static void enable_in(uint8_t mode_of_operation)
{
    rig_nmt(&rig, 1);
    for (uint16_t axis = 0; axis < 2; axis++) {
        TEST_ASSERT_EQUAL(0, rig_write(&rig, (uint16_t)(0x6060u + 0x800u * axis), 0, 1, mode_of_operation));
    }
    rig_enable(&rig);
    expect_state(CIA402_OPERATION_ENABLED);
}

static void profile(void)
{
    enable_in(MODE_PROFILE_VELOCITY);
    TEST_ASSERT_EQUAL(0, rig_write(&rig, 0x60FF, 0, 4, 20000));
    rig_ms(&rig, 20);
}

static void homing(void)
{
    for (uint16_t axis = 0; axis < 2; axis++) {
        TEST_ASSERT_EQUAL(0, rig_write(&rig, (uint16_t)(0x6098u + 0x800u * axis), 0, 1, 17 + axis));
    }
    enable_in(MODE_HOMING);
    rig_controlwords(&rig, 0x1F, 0x1F);
    rig_ms(&rig, 20);
}

static void reach(enum start to, struct rig_stream *s)
{
    switch (to) {
    case POWER_ON: break;
    case OPERATIONAL: rig_nmt(&rig, 1); break;
    case SWITCHED_ON:
        enable_in(MODE_INTERPOLATED_POSITION);
        rig_controlwords(&rig, 0x07, 0x07);
        rig_ms(&rig, 2);
        expect_state(CIA402_SWITCHED_ON);
        break;
    case ENABLED:
    case RECORDS: enable_in(MODE_INTERPOLATED_POSITION); break;
    case FILLED:
        enable_in(MODE_INTERPOLATED_POSITION);
        TEST_ASSERT_EQUAL(0, rig_begin(&rig, s));
        rig_feed(&rig, s, s->count);
        break;
    case RUNNING:
    case SILENT_HOST:
    case STOPPING:
    case STOPPED:
    case FAULT:
        enable_in(MODE_INTERPOLATED_POSITION);
        rig_go(&rig, s, 150);
        TEST_ASSERT_EQUAL(STREAM_RUNNING, rig.device.od.stream.state);
        break;
    case JOG: profile(); break;
    case HOMING: homing(); break;
    case CONFIGURING:
    case UNCONFIGURED: command(0x7E5, 8, 0x04, 1); break;
    case STORED:
        TEST_ASSERT_EQUAL(0, rig_write(&rig, 0x2110, 1, 4, 30000));
        TEST_ASSERT_EQUAL(0, rig_write(&rig, 0x1010, 1, 4, 0x65766173));
        TEST_ASSERT_EQUAL(0, rig_write(&rig, 0x2110, 1, 4, 40000));
        break;
    case DOWNLOAD: request(0x21, 0x2110, 1, 4); break;
    default: request(0xA4, 0x1008, 0, 127); break;
    }
}

/* The second half of the way to a state, for those that begin with a motion or a request. */
static void reach_after_start(enum start to)
{
    if (to == SILENT_HOST) {
        rig.heartbeat_every_ms = 0;
        for (unsigned ms = 0; ms < 1000 && rig.device.node.nmt.consumer_left_ms > 2; ms++) {
            rig_ms(&rig, 1);
        }
        TEST_ASSERT_EQUAL(2, rig.device.node.nmt.consumer_left_ms);
        expect_state(CIA402_OPERATION_ENABLED);
    } else if (to == STOPPING || to == STOPPED) {
        rig_controlwords(&rig, 0x0B, 0x0B);
        rig_ms(&rig, to == STOPPING ? 5 : 500);
        TEST_ASSERT_TRUE(rig.device.drive.axis[0].state != CIA402_OPERATION_ENABLED);
    } else if (to == FAULT) {
        rig.inputs[0] = HAL_AMPLIFIER_FAULT;
        rig_ms(&rig, 2);
        rig.inputs[0] = 0;
        rig_ms(&rig, 200);
        expect_state(CIA402_FAULT);
    } else if (to == UNCONFIGURED) {
        command(0x7E5, 8, 0x11, 255);
        command(0, 2, 130, 0);
        TEST_ASSERT_EQUAL(OD_UNCONFIGURED, node_id());
    } else if (to == UPLOAD) {
        const struct can_frame f = {.id = 0x601, .len = 8, .data = {0xA3}};
        give(&f);
    }
}

static void make_starts(void)
{
    struct ks_machine machine = rig_machine();
    machine.switch_m[0] = machine.switch_m[1] = 1e-3;
    for (unsigned i = 0; i < STARTS; i++) {
        struct rig_stream s = {.count = 400, .length_nm = 20e6};
        rig_start(&rig, &machine);
        rig.plant.machine.substeps = 1; /* The machine is less exact then, but only the firmware is tested here. */
        rig.hal.can_send = can_send;
        rig_ms(&rig, 5);
        reach((enum start)i, &s);
        reach_after_start((enum start)i);
        rig.heartbeat_every_ms = 0;
        start[i] = rig;
    }
}

/* Copy the state. The flash is copied only when an input has written it, which few do. */
static void restore(const struct rig *from)
{
    static const struct rig *flash_of;
    const size_t flash = offsetof(struct rig, flash), behind = flash + sizeof from->flash;
    if (flash_of != from ||
        memcmp(&rig.flash.random, &from->flash.random, sizeof rig.flash - offsetof(struct sim_flash, random)) != 0) {
        rig.flash = from->flash;
        flash_of = from;
    }
    memcpy(&rig, from, flash);
    memcpy((unsigned char *)&rig + behind, (const unsigned char *)from + behind, sizeof rig - behind);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct bytes in = {data, size};
    if (start[0].hal.ctx == NULL) {
        make_starts();
    }
    const uint8_t head = bytes_u8(&in);
    restore(&start[(head & 0x1Fu) % STARTS]);
    full = false;
    operations_before = rig.flash.operations;
    periods_left = head >= LONG ? PERIODS_LONG : PERIODS;
    for (unsigned i = 0; i < STEPS_MAX && in.left > 0; i++) {
        run_step(&in);
        expect_legal();
    }
    expect_ranges();
    full = false;
    /* LSS can silence the node for long before a new bit timing takes effect: shorten that. */
    rig.device.node.lss.silent_ms = rig.device.node.lss.silent_ms > 3 ? 3 : rig.device.node.lss.silent_ms;
    expect_an_answer();
    TEST_ASSERT_EQUAL_UINT(0, rig.flash.misuse);
    return 0;
}
