/* SPDX-License-Identifier: Apache-2.0 */
/* A million frames into the whole firmware: nonsense, valid requests of every service, and broken ones. */
#include <string.h>

#include "test_drive_rules.h"

enum { FRAMES = 1000000, FRAMES_A_PERIOD = 3, FRAMES_A_CHECK = 5000, FRAMES_A_STORY = 2000 };

static uint64_t state;
static unsigned seen[7], visited[256]; /* frames in each CiA 402 state, in each NMT state */

static uint32_t draw(uint32_t below)
{
    uint64_t z = (state += 0x9E3779B97F4A7C15u); /* splitmix64 */
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return (uint32_t)((z ^ (z >> 31)) >> 32) % below;
}

static bool watch(void *ctx, const struct can_frame *frame)
{
    see(frame);
    return draw(50) != 0 && rig_can_send(ctx, frame); /* the bus may be full */
}

void setUp(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    rig.hal.can_send = watch;
    state = 1;
    answers = 0;
}

void tearDown(void)
{
}

static struct can_frame frame_of(unsigned id, uint8_t len, uint8_t first)
{
    struct can_frame f = {.id = (uint16_t)(id & 0x7FFu), .len = len, .data = {first}};
    for (unsigned i = 1; i < 8; i++) {
        f.data[i] = (uint8_t)draw(256);
    }
    return f;
}

static struct can_frame nmt(void)
{
    static const uint8_t commands[] = {1, 1, 1, 1, 1, 1, 2, 128, 129, 130};
    struct can_frame f = frame_of(0, 2, commands[draw(sizeof commands)]);
    f.data[1] = (uint8_t)(draw(2) != 0 ? node_id() : 0u);
    return f;
}

/* What may follow in the transfer that is under way, or nearly. */
static uint8_t next_step(void)
{
    static const uint8_t steps[][4] = {
        [CO_SDO_DOWNLOAD] = {0x00, 0x10, 0x01, 0x17},           [CO_SDO_UPLOAD] = {0x60, 0x70, 0x60, 0x70},
        [CO_SDO_BLOCK_DOWNLOAD] = {0x81, 0x81, 1, 2},           [CO_SDO_BLOCK_DOWNLOAD_END] = {0xC1, 0xCD, 0xD5, 0xD9},
        [CO_SDO_BLOCK_UPLOAD_START] = {0xA3, 0xA3, 0xA3, 0xA2}, [CO_SDO_BLOCK_UPLOAD] = {0xA2, 0xA2, 0xA2, 0xA3},
        [CO_SDO_BLOCK_UPLOAD_END] = {0xA1, 0xA1, 0xA2, 0xA1},
    };
    return steps[rig.device.node.sdo.transfer.phase][draw(4)];
}

/* Any step of any transfer, of an object that there is. */
static struct can_frame sdo(void)
{
    static const uint8_t commands[] = {0x40, 0x40, 0x2F, 0x2B, 0x27, 0x23, 0x22, 0x21, 0x20,
                                       0x60, 0x70, 0x00, 0x10, 0x01, 0x80, 0xA0, 0xA4, 0xA3,
                                       0xA2, 0xA1, 0xC0, 0xC2, 0xC6, 0x81, 0xC1, 0xCD, 0xD5};
    const struct od_entry *e = &od_table[draw(od_table_len)];
    struct can_frame f = frame_of(0x600u + node_id(), 8, commands[draw(sizeof commands)]);
    co_put(&f.data[1], e->index, 2);
    f.data[3] = e->sub;
    if (rig.device.node.sdo.transfer.phase != CO_SDO_IDLE && draw(2) != 0) {
        f.data[0] = next_step();
    }
    if (f.data[0] == 0xA2) {
        f.data[1] = (uint8_t)draw(4);
    } else if ((f.data[0] >> 5) == CCS_BLOCK_UPLOAD) {
        f.data[4] = (uint8_t)draw(4);
        f.data[5] = (uint8_t)draw(3);
    } else if (draw(4) != 0) { /* in range, mostly */
        const uint64_t span = (uint64_t)(e->max - e->min) + 1;
        const uint64_t offset = ((uint64_t)draw(0x80000000) << 31 | draw(0x80000000)) % span;
        co_put(&f.data[4], (uint32_t)(e->min + (int64_t)offset), 4);
    }
    if (draw(30) == 0) {
        co_put(&f.data[4], 0x65766173, 4); /* save */
        co_put(&f.data[1], 0x1010, 2);
        f.data[0] = 0x23;
        f.data[3] = (uint8_t)draw(5);
    }
    return f;
}

static struct can_frame controlwords(void)
{
    static const uint8_t words[] = {0x06, 0x07, 0x0F, 0x0F, 0x1F, 0x1F, 0x02, 0x80, 0x00, 0x0B};
    struct can_frame f = frame_of(0x200u + node_id(), 4, 0);
    for (unsigned axis = 0; axis < 2; axis++) {
        co_put(&f.data[2 * axis], (draw(20) == 0 ? 0x100u : 0u) | words[draw(sizeof words)], 2);
    }
    if (draw(2) != 0) { /* both the same */
        memcpy(&f.data[2], &f.data[0], 2);
    }
    return f;
}

static struct can_frame knot(void)
{
    const struct od_knot k = {.sequence = (uint8_t)(rig.device.od.stream.accepted16 & 0xFFu),
                              .dx = (int32_t)draw(2001) - 1000,
                              .dy = (int32_t)draw(2001) - 1000};
    struct can_frame f = frame_of(0x300u + node_id(), 8, k.sequence);
    f.data[1] = queue_crc8(&k);
    co_put(&f.data[2], (uint32_t)k.dx, 3);
    co_put(&f.data[5], (uint32_t)k.dy, 3);
    return f;
}

/* A record of 60C1h and 68C1h near where the axes are */
static struct can_frame record(void)
{
    struct can_frame f = frame_of(0x400u + node_id(), 8, 0);
    for (unsigned axis = 0; axis < 2; axis++) {
        const int32_t near = (int32_t)draw(20001) - 10000;
        co_put(&f.data[4 * axis], (uint32_t)rig.device.od.axis[axis].position_actual + (uint32_t)near, 4);
    }
    return f;
}

/* 6060h of both axes, one after the other, and what a jog or a homing needs */
static struct can_frame mode(void)
{
    static const struct {
        uint16_t index;
        uint8_t size;
        int32_t value;
    } writes[] = {{0x6060, 1, 7},     {0x6060, 1, 3},      {0x6060, 1, 6},
                  {0x60FF, 4, 20000}, {0x60FF, 4, -20000}, {0x6098, 1, 35}};
    const unsigned i = draw(sizeof writes / sizeof writes[0]);
    struct can_frame f = frame_of(0x600u + node_id(), 8, (uint8_t)(0x23 | (4 - writes[i].size) << 2));
    co_put(&f.data[1], writes[i].index + 0x800u * draw(2), 2);
    f.data[3] = 0;
    co_put(&f.data[4], (uint32_t)writes[i].value, 4);
    return f;
}

static struct can_frame lss(void)
{
    static const uint8_t commands[] = {0x04, 0x04, 0x11, 0x13, 0x15, 0x17, 0x40, 0x41, 0x42, 0x43, 0x46, 0x47,
                                       0x48, 0x49, 0x4A, 0x4B, 0x4C, 0x51, 0x51, 0x5A, 0x5B, 0x5C, 0x5D, 0x5E};
    struct can_frame f = frame_of(0x7E5, 8, commands[draw(sizeof commands)]);
    memset(&f.data[1], 0, 7);
    f.data[1] = (uint8_t)draw(4);
    f.data[5] = (uint8_t)(draw(2) != 0 ? 128 : draw(40));
    f.data[6] = f.data[7] = (uint8_t)draw(5);
    return f;
}

static struct can_frame sensible(void)
{
    switch (draw(12)) {
    case 0: return draw(20) == 0 ? nmt() : frame_of(0x77F, 1, 5);
    case 1: return draw(10) == 0 ? lss() : frame_of(0x80, 0, 0);
    case 2:
    case 3:
    case 4: return controlwords();
    case 5:
    case 6: return knot();
    case 7: return record();
    case 8: return mode();
    default: return sdo();
    }
}

static struct can_frame any_frame(void)
{
    struct can_frame f = sensible();
    const unsigned how = draw(8);
    if (how == 0) { /* nonsense */
        f = frame_of(draw(0x800), (uint8_t)draw(9), (uint8_t)draw(256));
        f.rtr = draw(20) == 0;
    } else if (how <= 2) { /* one bit, or the length */
        f.data[draw(8)] ^= (uint8_t)(1u << draw(8));
        f.len = (uint8_t)(draw(4) == 0 ? draw(9) : f.len);
    }
    return f;
}

/* A stream whose host falls silent; or the way to be without node id. Random frames lead to neither. */
static void tell_a_story(void)
{
    const uint16_t request = (uint16_t)(0x600u + node_id());
    if (draw(4) == 0) {
        command(0x7E5, 8, 0x04, 1);
        command(0x7E5, 8, 0x11, 255);
        command(0, 2, 130, 0);
        return;
    }
    command(0, 2, 129, 0);
    const struct can_frame restore = {.id = request, .len = 8, .data = {0x23, 0x11, 0x10, 1, 'l', 'o', 'a', 'd'}};
    give(&restore); /* what has been stored here moves no machine */
    command(0, 2, 129, 0);
    rig_ms(&rig, 5);
    command(0, 2, 1, 0);
    const struct can_frame fault_monitor_host = {.id = request, .len = 8, .data = {0x23, 0x16, 0x10, 1, 20, 0, 127, 0}};
    give(&fault_monitor_host);
    for (unsigned i = 0; i < 3; i++) {
        static const uint8_t words[] = {0x06, 0x07, 0x0F};
        const struct can_frame f = {.id = (uint16_t)(0x200u + node_id()), .len = 4, .data = {words[i], 0, words[i]}};
        give(&f);
        rig_ms(&rig, 2);
    }
    for (uint8_t sub = 2; sub <= 3; sub++) {
        struct can_frame f = {.id = request, .len = 8, .data = {0x23, 0x00, 0x22, sub}};
        co_put(&f.data[4], (uint32_t)rig.device.od.axis[sub - 2].position_actual, 4);
        give(&f);
    }
    const struct can_frame begin = {.id = request, .len = 8, .data = {0x2F, 0x00, 0x22, 1, 1}};
    give(&begin);
    for (unsigned i = 0; i < 100; i++) {
        const struct can_frame f = knot();
        give(&f);
    }
    const struct can_frame run = {.id = (uint16_t)(0x200u + node_id()), .len = 4, .data = {0x1F, 0, 0x1F}};
    give(&run);
    command(0x77F, 1, 5, 0); /* the only heartbeat */
    if (draw(4) == 0) {
        rig_ms(&rig, 30);
        const struct can_frame quick_stop = {.id = run.id, .len = 4, .data = {0x0B, 0, 0x0B}};
        give(&quick_stop);
    }
    for (uint32_t ms = draw(300); ms > 0; ms--) {
        expect_no_force_while_off();
        rig_ms(&rig, 1);
        expect_legal();
        seen[rig.device.drive.axis[0].state]++;
    }
}

static void test_million_frames_do_no_harm(void)
{
    for (unsigned n = 1; n <= FRAMES; n++) {
        const struct can_frame f = any_frame();
        give(&f);
        expect_legal();
        visited[co_nmt_state(&rig.device.node)]++;
        seen[rig.device.drive.axis[0].state]++;
        seen[rig.device.drive.axis[1].state]++;
        if (n % FRAMES_A_PERIOD == 0) {
            expect_no_force_while_off();
        }
        if (n % FRAMES_A_STORY == 0 && node_id() != OD_UNCONFIGURED) {
            tell_a_story();
        }
        if (n % FRAMES_A_CHECK == 0) {
            expect_ranges();
            expect_an_answer();
        }
    }
    /* the frames have been everywhere */
    for (unsigned i = 0; i < 7; i++) {
        TEST_ASSERT_TRUE_MESSAGE(seen[i] > 100, "a CiA 402 state was hardly reached");
    }
    TEST_ASSERT_TRUE(visited[CO_INITIALISING] > 0 && visited[CO_STOPPED] > 0 && visited[CO_OPERATIONAL] > FRAMES / 4 &&
                     visited[CO_PRE_OPERATIONAL] > 0);
    TEST_ASSERT_TRUE(rig.flash.operations > 0);
    TEST_ASSERT_EQUAL_UINT(0, rig.flash.misuse);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_million_frames_do_no_harm);
    return UNITY_END();
}
