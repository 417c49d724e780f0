/* SPDX-License-Identifier: Apache-2.0 */
/* Frames, inputs and time into the whole firmware on a simulated machine, read from the input as steps (enum step).
 * After each: what test_drive_rules.h says. Some steps go a long way at once (an axis enabled, a stream begun), which
 * single bytes would hardly find. */
#include "bytes.h"
#include "test_drive_rules.h"

enum step {
    TIME, FRAME, SDO, CONTROLWORDS, KNOTS, RECORD, NMT, LSS, HEARTBEAT, SYNC, INPUTS, BUS_FULL, ENABLE, BEGIN, STORE, MODE, STEPS
};
enum { STEPS_MAX = 100, PERIODS_MAX = 400 };

static bool full;
static unsigned periods_left;

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
    let_pass(20);
    for (uint8_t i = 0; i < 3; i++) {
        static const uint8_t words[] = {0x06, 0x07, 0x0F};
        controlwords(words[i], words[i]);
        let_pass(10);
    }
}

/* A stream from where the axes are; the knots are to follow. */
static void begin(void)
{
    for (uint8_t axis = 0; axis < 2; axis++) {
        request(0x23, 0x2200, (uint8_t)(2 + axis), (uint32_t)rig.app.od.axis[axis].position_actual);
    }
    request(0x2F, 0x2200, 1, 1);
}

static void knots(struct bytes *in)
{
    const unsigned count = bytes_u8(in) % 128;
    const int32_t dx = (int8_t)bytes_u8(in) * 8, dy = (int8_t)bytes_u8(in) * 8;
    for (unsigned i = 0; i < count; i++) {
        const struct od_knot k = {.sequence = (uint8_t)(rig.app.od.stream.accepted16 & 0xFFu), .dx = dx, .dy = dy};
        struct can_frame f = {
            .id = (uint16_t)(0x300u + node_id()), .len = 8, .data = {k.sequence, queue_crc8(&k)}};
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
    struct can_frame f = {.id = (uint16_t)(head & 0x7FFu), .len = (uint8_t)((head >> 11) % 9), .rtr = (head >> 15) != 0};
    for (unsigned i = 0; i < f.len; i++) {
        f.data[i] = bytes_u8(in);
    }
    give(&f);
}

static void record(struct bytes *in)
{
    struct can_frame f = {.id = (uint16_t)(0x400u + node_id()), .len = 8};
    for (unsigned axis = 0; axis < 2; axis++) {
        const uint32_t near = (uint32_t)((int16_t)bytes_number(in, 2));
        co_put(&f.data[4 * axis], (uint32_t)rig.app.od.axis[axis].position_actual + near, 4);
    }
    give(&f);
}

static void mode(uint8_t what)
{
    static const int32_t writes[][3] = {
        {0x6060, 1, 7}, {0x6060, 1, 3}, {0x6060, 1, 6}, {0x60FF, 4, 20000}, {0x60FF, 4, -20000}, {0x6098, 1, 35}};
    const int32_t *w = writes[what / 4 % 6];
    const uint8_t size = (uint8_t)w[1];
    for (uint16_t axis = 0; axis < 2; axis++) {
        if ((what & 3) != 2 + axis) { /* one of them, or both */
            request((uint8_t)(0x23 | (4 - size) << 2), (uint16_t)((unsigned)w[0] + 0x800u * axis), 0, (uint32_t)w[2]);
        }
    }
}

static void take(struct bytes *in)
{
    switch (bytes_u8(in) % STEPS) {
    case TIME: let_pass(1u + bytes_u8(in) % 64); break;
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
        request(0x23, save ? 0x1010 : 0x1011, bytes_u8(in) % 4, save ? 0x65766173 : 0x64616F6C);
        break;
    }
    case MODE: mode(bytes_u8(in)); break;
    default: break;
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct bytes in = {data, size};
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    rig.hal.can_send = can_send;
    full = false;
    periods_left = PERIODS_MAX;
    for (unsigned i = 0; i < STEPS_MAX && in.left > 0; i++) {
        take(&in);
        expect_legal();
    }
    expect_ranges();
    full = false;
    expect_an_answer();
    TEST_ASSERT_EQUAL_UINT(0, rig.flash.misuse);
    return 0;
}
