/* SPDX-License-Identifier: Apache-2.0 */
/* Sends SDO requests in any order to the node alone. Every answer is legal, no value leaves its range, and what was
 * accepted can be read back. Afterwards the server answers. The input is read as steps (enum step). */
#include <string.h>

#include "bytes.h"
#include "test_canopen_bus.h"

enum step { RAW, REQUEST, WRITE, READ, TIME, FULL, STEPS };
enum { STEPS_MAX = 200 };

static struct bus bus, started;

static void give(uint8_t command, uint16_t index, uint8_t sub, uint32_t value, uint8_t len)
{
    struct can_frame f = {.id = 0x600 + NODE, .len = len, .data = {command}};
    co_put(&f.data[1], index, 2);
    f.data[3] = sub;
    co_put(&f.data[4], value, 4);
    bus_clear(&bus);
    co_receive(&bus.node, &f);
    for (unsigned i = 0; i < bus.count; i++) {
        TEST_ASSERT_TRUE(bus.sent[i].len <= 8 && bus.sent[i].id <= 0x7FF);
    }
}

/* End a transfer and send the frames that wait. */
static void settle(void)
{
    bus.room = SENT_MAX;
    give(0x80, 0, 0, 0, 8);
    co_tick_ms(&bus.node);
}

static const struct od_entry *any_entry(struct bytes *in)
{
    return &od_table[bytes_number(in, 2) % od_table_len];
}

/* A valid request: a value that the server accepts can be read back. */
static void write_and_read(const struct od_entry *e, uint32_t raw)
{
    const uint8_t size = od_size(e);
    settle();
    give((uint8_t)(0x23 | (4 - size) << 2), e->index, e->sub, raw, 8);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    const bool accepted = bus.sent[0].data[0] == 0x60;
    TEST_ASSERT_TRUE(accepted || bus.sent[0].data[0] == 0x80);
    if (!accepted || (e->flags & OD_READ) == 0 || e->index == 0x1010 || e->index == 0x1011) {
        return;
    }
    uint8_t bytes[4];
    co_put(bytes, raw, 4);
    const int64_t value = od_decode(e, bytes);
    TEST_ASSERT_TRUE(e->index == 0x2001 || od_check(e, value) == SDO_OK);
    give(0x40, e->index, e->sub, 0, 8);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    TEST_ASSERT_EQUAL_HEX8(0x43 | (4 - size) << 2, bus.sent[0].data[0]);
    TEST_ASSERT_TRUE(value == od_decode(e, &bus.sent[0].data[4]));
}

static void read_one(const struct od_entry *e)
{
    settle();
    give(0x40, e->index, e->sub, 0, 8);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    const bool refused = bus.sent[0].data[0] == 0x80;
    TEST_ASSERT_TRUE(refused || (e->flags & OD_READ) != 0);
    TEST_ASSERT_TRUE(!refused || (e->flags & OD_READ) == 0 || co_get(&bus.sent[0].data[4], 4) == SDO_ABORT_NO_DATA);
}

/* Let some milliseconds pass, or enough for the server to abort a transfer that waits. */
static void let_pass(uint8_t how_long)
{
    for (unsigned ms = how_long == 0xFF ? CO_SDO_TIMEOUT_MS + 1 : 1 + how_long % 16; ms > 0; ms--) {
        bus_clear(&bus);
        co_tick_ms(&bus.node);
    }
}

static void run_step(struct bytes *in)
{
    const struct od_entry *e;
    uint8_t data[8];
    switch (bytes_u8(in) % STEPS) {
    case RAW: {
        for (unsigned i = 0; i < 8; i++) {
            data[i] = bytes_u8(in);
        }
        const uint8_t len = bytes_u8(in);
        give(data[0], (uint16_t)co_get(&data[1], 2), data[3], co_get(&data[4], 4), len < 0xF8 ? 8 : len & 7);
        break;
    }
    case REQUEST:
        e = any_entry(in);
        data[0] = bytes_u8(in);
        give(data[0], e->index, e->sub, bytes_number(in, 4), 8);
        break;
    case WRITE:
        e = any_entry(in);
        if (e->type != OD_STRING) {
            write_and_read(e, bytes_number(in, 4));
        }
        break;
    case READ: read_one(any_entry(in)); break;
    case TIME: let_pass(bytes_u8(in)); break;
    case FULL: bus.room = bytes_u8(in); return;
    default: break;
    }
    bus.room = SENT_MAX;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct bytes in = {data, size};
    if (started.room == 0) { /* only once, because a start takes longer than an input */
        bus_start(&bus);
        bus_clear(&bus);
        started = bus;
    }
    memcpy(&bus.od, &started.od, sizeof bus.od);
    memcpy(&bus.node, &started.node, sizeof bus.node);
    bus.room = SENT_MAX;
    for (unsigned i = 0; i < STEPS_MAX && in.left > 0; i++) {
        run_step(&in);
        TEST_ASSERT_TRUE(bus.node.sdo.transfer.phase <= CO_SDO_BLOCK_UPLOAD_END && bus.node.tx.count <= CO_TX_FRAMES);
    }
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *e = &od_table[i];
        if ((e->flags & OD_WRITE) != 0 && (e->flags & OD_READ) != 0 && e->index != 0x2001 && e->index != 0x1003) {
            TEST_ASSERT_TRUE_MESSAGE(od_check(e, od_read(&bus.od, e)) == SDO_OK, "an object is out of its range");
        }
    }
    settle();
    give(0x40, 0x1000, 0, 0, 8);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    TEST_ASSERT_TRUE(bus.sent[0].data[0] == 0x43 && co_get(&bus.sent[0].data[4], 4) == 0xFFFF0192);
    return 0;
}
