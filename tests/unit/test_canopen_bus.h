/* SPDX-License-Identifier: Apache-2.0 */
/* A CANopen node (id 5) on a bus that keeps every frame it sends, for the test_canopen*.c files. */
#ifndef TEST_CANOPEN_BUS_H
#define TEST_CANOPEN_BUS_H
#include <stdio.h>
#include <string.h>

#include "canopen/node.h"
#include "unity.h"

enum { NODE = 5, SENT_MAX = 4096 };

struct bus {
    struct od_data od;
    struct co_node node;
    struct hal hal;
    struct can_frame sent[SENT_MAX]; /* by the node, since the last bus_clear() */
    unsigned count;
    unsigned room; /* frames that can_send still takes */
    /* what the hooks saw */
    unsigned writes, reads, rpdos[OD_RPDOS + 1], lost, resets, nmt_changes;
    struct {
        uint16_t index;
        uint8_t sub, flags;
        int64_t value;
    } checked, written;
    bool reset_communication_only;
    enum co_state state;
    uint32_t refuse;         /* what before_write answers */
    struct od_knot knots[8]; /* as stored at each RPDO2 */
    const char *domain;      /* contents of 2302h; NULL: none */
};

static inline bool bus_can_send(void *ctx, const struct can_frame *frame)
{
    struct bus *bus = ctx;
    if (bus->room == 0 || bus->count == SENT_MAX) {
        return false;
    }
    bus->room--;
    bus->sent[bus->count++] = *frame;
    return true;
}

static inline bool bus_can_bitrate(void *ctx, uint16_t kbitps, bool change)
{
    (void)ctx;
    (void)change;
    return kbitps == 1000;
}

static inline uint32_t bus_before_write(void *ctx, const struct od_entry *entry, int64_t value)
{
    struct bus *bus = ctx;
    bus->checked.index = entry->index;
    bus->checked.sub = entry->sub;
    bus->checked.value = value;
    bus->checked.flags = entry->flags;
    return bus->refuse;
}

static inline void bus_on_write(void *ctx, const struct od_entry *entry)
{
    struct bus *bus = ctx;
    bus->writes++;
    bus->written.index = entry->index;
    bus->written.sub = entry->sub;
    bus->written.value = od_read(&bus->od, entry);
}

static inline void bus_before_read(void *ctx, const struct od_entry *entry)
{
    struct bus *bus = ctx;
    bus->reads++;
    if (entry->index == 0x2020 && entry->sub == 3) {
        bus->od.clock.tick = 0x01020304;
    }
}

static inline uint32_t bus_domain_size(void *ctx, const struct od_entry *entry)
{
    const struct bus *bus = ctx;
    return bus->domain != NULL && entry->index == 0x2302 ? (uint32_t)strlen(bus->domain) : 0u;
}

static inline bool bus_domain_read(void *ctx, const struct od_entry *entry, uint32_t at, uint8_t *to, uint32_t count)
{
    const struct bus *bus = ctx;
    (void)entry;
    if (bus->domain != NULL) {
        memcpy(to, &bus->domain[at], count);
    }
    return bus->domain != NULL;
}

static inline void bus_on_rpdo(void *ctx, unsigned number)
{
    struct bus *bus = ctx;
    if (number == 2 && bus->rpdos[2] < 8) {
        bus->knots[bus->rpdos[2]] = bus->od.knot;
    }
    bus->rpdos[number]++;
}

static inline void bus_on_nmt(void *ctx, enum co_state state)
{
    struct bus *bus = ctx;
    bus->state = state;
    bus->nmt_changes++;
}

static inline void bus_on_heartbeat_lost(void *ctx)
{
    struct bus *bus = ctx;
    bus->lost++;
}

static inline void bus_on_reset(void *ctx, bool communication_only)
{
    struct bus *bus = ctx;
    bus->resets++;
    bus->reset_communication_only = communication_only;
}

static inline void bus_clear(struct bus *bus)
{
    bus->count = 0;
}

/* Power on. The boot-up message is in sent[]. */
static inline void bus_start(struct bus *bus)
{
    memset(bus, 0, sizeof *bus);
    bus->room = SENT_MAX;
    bus->hal = (struct hal){.ctx = bus, .can_send = bus_can_send, .can_bitrate = bus_can_bitrate};
    od_init(&bus->od, NODE);
    const struct co_config config = {.od = &bus->od,
                                     .hal = &bus->hal,
                                     .node_id = NODE,
                                     .hooks = {.ctx = bus,
                                               .before_write = bus_before_write,
                                               .on_write = bus_on_write,
                                               .before_read = bus_before_read,
                                               .domain_size = bus_domain_size,
                                               .domain_read = bus_domain_read,
                                               .on_rpdo = bus_on_rpdo,
                                               .on_nmt = bus_on_nmt,
                                               .on_heartbeat_lost = bus_on_heartbeat_lost,
                                               .on_reset = bus_on_reset}};
    co_init(&bus->node, &config);
}

/* Give the node one frame: `text` is its bytes in hex, "40 00 10 00". */
static inline void bus_give(struct bus *bus, uint16_t id, const char *text)
{
    struct can_frame frame = {.id = id};
    for (const char *at = text; *at != '\0'; at++) {
        const int digit = *at >= '0' && *at <= '9' ? *at - '0' : *at >= 'A' && *at <= 'F' ? *at - 'A' + 10 : -1;
        if (digit >= 0) {
            uint8_t *byte = &frame.data[frame.len / 2];
            *byte = (uint8_t)(*byte << 4 | digit);
            frame.len++;
        }
    }
    frame.len /= 2;
    co_receive(&bus->node, &frame);
}

static inline void bus_run_ms(struct bus *bus, unsigned ms)
{
    for (unsigned i = 0; i < ms; i++) {
        co_tick_ms(&bus->node);
    }
}

/* sent[i] has this identifier and these bytes (hex, as above). */
static inline void bus_expect(const struct bus *bus, unsigned i, uint16_t id, const char *text)
{
    char got[32] = "";
    TEST_ASSERT_TRUE_MESSAGE(i < bus->count, "the node sent too few frames");
    const struct can_frame *frame = &bus->sent[i];
    for (unsigned k = 0; k < frame->len; k++) {
        static const char digits[] = "0123456789ABCDEF";
        char *at = &got[3 * k];
        at[0] = digits[frame->data[k] >> 4];
        at[1] = digits[frame->data[k] & 15];
        at[2] = k + 1 < frame->len ? ' ' : '\0';
    }
    TEST_ASSERT_EQUAL_HEX16(id, frame->id);
    TEST_ASSERT_FALSE(frame->rtr);
    TEST_ASSERT_EQUAL_STRING(text, got);
}

/* One SDO request and the only frame the node answers with. */
static inline void bus_sdo(struct bus *bus, const char *request, const char *answer)
{
    bus_clear(bus);
    bus_give(bus, 0x600 + NODE, request);
    TEST_ASSERT_EQUAL_UINT(1, bus->count);
    bus_expect(bus, 0, 0x580 + NODE, answer);
}

/* Switch TPDO2 to TPDO5 on. They are due at once. */
static inline void bus_telemetry_on(struct bus *bus)
{
    bus_sdo(bus, "23 01 18 01 85 02 00 40", "60 01 18 01 00 00 00 00");
    bus_sdo(bus, "23 02 18 01 85 03 00 40", "60 02 18 01 00 00 00 00");
    bus_sdo(bus, "23 03 18 01 85 04 00 40", "60 03 18 01 00 00 00 00");
    bus_sdo(bus, "23 04 18 01 85 06 00 40", "60 04 18 01 00 00 00 00");
    bus_clear(bus);
}
#endif
