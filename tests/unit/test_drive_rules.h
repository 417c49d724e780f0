/* SPDX-License-Identifier: Apache-2.0 */
/* What holds of the whole firmware whatever comes in, for test_fuzz.c and tests/fuzz/can.c: legal states, values in
 * their ranges, no force while off, and an answer to a valid SDO. One rig a program. */
#ifndef TEST_DRIVE_RULES_H
#define TEST_DRIVE_RULES_H
#include "drive/configuration.h"
#include "drive_rig.h"

static struct rig rig;
static struct can_frame answer; /* the last SDO response, of whatever node id */
static unsigned answers;

static uint16_t node_id(void)
{
    return rig.device.node.config.node_id;
}

/* To be called for every frame that the drive sends. */
static void see(const struct can_frame *frame)
{
    TEST_ASSERT_TRUE(frame->id <= 0x7FF && frame->len <= 8);
    if (frame->id > 0x580 && frame->id < 0x600) {
        answer = *frame;
        answers++;
    }
    rig.emcy_count = 0; /* the rig has room for some only */
}

static void give(const struct can_frame *f)
{
    rig.inbox[0] = *f;
    rig.inbox_count = 1;
    device_poll(&rig.device);
}

static void expect_legal(void)
{
    const enum co_state nmt_state = co_nmt_state(&rig.device.node);
    TEST_ASSERT_TRUE(nmt_state == CO_INITIALISING || nmt_state == CO_STOPPED || nmt_state == CO_OPERATIONAL ||
                     nmt_state == CO_PRE_OPERATIONAL);
    TEST_ASSERT_EQUAL(nmt_state == CO_INITIALISING, node_id() == OD_UNCONFIGURED);
    TEST_ASSERT_TRUE(node_id() == OD_UNCONFIGURED || (node_id() >= 1 && node_id() <= 31));
    for (unsigned i = 0; i < 2; i++) {
        TEST_ASSERT_TRUE(rig.device.drive.axis[i].state <= CIA402_FAULT);
    }
    TEST_ASSERT_TRUE(rig.device.od.stream.state <= STREAM_STOPPED);
    TEST_ASSERT_TRUE(configuration_fits(&rig.device.od));
    TEST_ASSERT_TRUE(rig.device.node.tx.count <= CO_TX_FRAMES);
    TEST_ASSERT_EQUAL_UINT32_MESSAGE(0, rig.device.drive.faults & FAULT_BIT(FAULT_MEMORY), "no bit has flipped");
}

/* Whoever wrote a parameter has renewed the checksum over all of them. */
static void expect_sealed(void)
{
    struct integrity m = rig.device.drive.integrity;
    m.cfg = m.sum = 0;
    m.at = 0;
    for (unsigned i = 0; i <= od_table_len / INTEGRITY_ENTRIES_MS; i++) {
        TEST_ASSERT_TRUE_MESSAGE(integrity_intact(&m, NULL, 0, &rig.device.od), "a parameter was written unsealed");
    }
}

/* One control period: force needs an enabled power stage, and that an axis that is on. */
static void expect_no_force_while_off(void)
{
    bool was_powered[2];
    for (unsigned i = 0; i < 2; i++) {
        was_powered[i] = cia402_powered(&rig.device.drive.axis[i]);
    }
    rig_run(&rig, 1);
    for (unsigned i = 0; i < 2; i++) {
        TEST_ASSERT_TRUE(rig.out.enable[i] || rig.out.force_mN[i] == 0);
        TEST_ASSERT_TRUE(was_powered[i] || !rig.out.enable[i]);
    }
}

static void command(uint16_t id, uint8_t len, uint8_t first, uint8_t second)
{
    const struct can_frame f = {.id = id, .len = len, .data = {first, second}};
    give(&f);
}

/* Every value that SDOs can write is in its range, and parameters are sealed; RPDOs write the others as they come. */
static void expect_ranges(void)
{
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *e = &od_table[i];
        const bool free = e->index == 0x2001 || (e->flags & OD_PDO) != 0;
        if ((e->flags & OD_WRITE) != 0 && (e->flags & OD_READ) != 0 && !free) {
            const int64_t value = od_read(&rig.device.od, e);
            const bool counted = e->index == 0x1003; /* how many there are */
            TEST_ASSERT_TRUE_MESSAGE(counted || od_check(e, value) == SDO_OK, "an object is out of its range");
        }
    }
    expect_sealed();
}

/* Whatever came before: a master gets the node to answer an SDO. */
static void expect_an_answer(void)
{
    for (unsigned i = 0; rig.device.node.lss.silent_ms != 0 && i < 2 * 0x10000; i++) {
        rig_ms(&rig, 1); /* a change of bit rate is under way */
    }
    if (node_id() == OD_UNCONFIGURED) {
        command(0x7E5, 8, 0x04, 1);
        command(0x7E5, 8, 0x11, 1);
        command(0x7E5, 8, 0x04, 0);
    }
    command(0, 2, 128, 0);
    for (int i = 0; i < 5 && co_nmt_state(&rig.device.node) != CO_PRE_OPERATIONAL; i++) {
        command(0, 2, 130, 0);
    }
    TEST_ASSERT_EQUAL(CO_PRE_OPERATIONAL, co_nmt_state(&rig.device.node));
    command((uint16_t)(0x600u + node_id()), 8, 0x80, 0);
    struct can_frame f = {.id = (uint16_t)(0x600u + node_id()), .len = 8, .data = {0x40, 0x00, 0x10}};
    answers = 0;
    give(&f);
    for (int i = 0; i < 10 && (answers == 0 || rig.device.node.tx.count != 0); i++) { /* the bus may be full */
        rig_ms(&rig, 5);
        give(&f);
    }
    TEST_ASSERT_TRUE_MESSAGE(answers > 0, "a valid SDO is not answered");
    TEST_ASSERT_EQUAL_HEX8(0x43, answer.data[0]);
    TEST_ASSERT_EQUAL_HEX32(0xFFFF0192, co_get(&answer.data[4], 4));
}
#endif
