/* SPDX-License-Identifier: Apache-2.0 */
/* The second SDO channel (1201h): the holder's, beside which other masters read and stop only. */
#include "test_device.h"

enum { REQUEST = 0x6A0, RESPONSE = 0x6A1, HOLDER_ID = 127, SECOND_MASTER = 0xFF19 };
#define ABORT_LOCAL 0x08000021u

static struct can_frame answer;
static unsigned answers;

static bool keep_answer(void *ctx, const struct can_frame *frame)
{
    if (frame->id == RESPONSE) {
        answer = *frame;
        answers++;
    }
    return rig_can_send(ctx, frame);
}

/* By the second channel: the abort code, 0 for success */
static uint32_t write(uint16_t index, uint8_t sub, uint8_t size, uint32_t value)
{
    uint8_t data[8] = {(uint8_t)(0x23 | (4 - size) << 2), (uint8_t)index, (uint8_t)(index >> 8), sub};
    co_put(&data[4], value, size);
    rig.hal.can_send = keep_answer;
    answers = 0;
    rig_send(&rig, REQUEST, 8, data);
    TEST_ASSERT_EQUAL_UINT(1, answers);
    return answer.data[0] == 0x80 ? co_get(&answer.data[4], 4) : 0;
}

static void open_channel(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1201, 2, 4, RESPONSE));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1201, 1, 4, REQUEST));
}

static void show_ticket(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2140, 4, 4, rig_read(&rig, 0x2140, 3)));
}

static void hold(void)
{
    rig_nmt(&rig, 1);
    rig.heartbeat_every_ms = 50;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2140, 2, 4, HOLDER_ID));
    open_channel();
}

static void test_channel_serves_requests_once_both_identifiers_are_valid(void)
{
    const uint8_t upload[8] = {0x40, 0x00, 0x10};
    rig.hal.can_send = keep_answer;
    answers = 0;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1201, 1, 4, REQUEST));
    rig_send(&rig, REQUEST, 8, upload);
    TEST_ASSERT_EQUAL_UINT(0, answers);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1201, 2, 4, RESPONSE));
    rig_send(&rig, REQUEST, 8, upload);
    TEST_ASSERT_EQUAL_UINT(1, answers);
    TEST_ASSERT_EQUAL_HEX32(0xFFFF0192, co_get(&answer.data[4], 4));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2000, 1, 1, 1)); /* nobody holds: both may */
    TEST_ASSERT_EQUAL_HEX32(0, write(0x2000, 1, 1, 2));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1201, 3, 1, 5));
    TEST_ASSERT_EQUAL_HEX32(0x06090030, rig_write(&rig, 0x1201, 1, 4, 0x6A2)); /* in use */
    TEST_ASSERT_EQUAL_HEX32(0x06090030, rig_write(&rig, 0x1201, 2, 4, 0x581)); /* another service's */
    rig_nmt(&rig, 2);
    answers = 0;
    rig_send(&rig, REQUEST, 8, upload);
    TEST_ASSERT_EQUAL_UINT(0, answers);
    rig_nmt(&rig, 130);
    rig_send(&rig, REQUEST, 8, upload);
    TEST_ASSERT_EQUAL_UINT(0, answers);
}

static void test_channel_is_not_stored(void)
{
    open_channel();
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, 0x65766173));
    rig_nmt(&rig, 129);
    TEST_ASSERT_EQUAL_HEX32(0x80000000, rig_read(&rig, 0x1201, 1));
}

static void test_transfers_of_both_channels_do_not_disturb_each_other(void)
{
    const uint8_t upload[8] = {0x40, 0x08, 0x10}, segment[8] = {0x60};
    open_channel();
    rig.hal.can_send = keep_answer;
    rig_send(&rig, REQUEST, 8, upload); /* the name, in segments */
    rig_send(&rig, 0x601, 8, upload);
    rig_send(&rig, 0x601, 8, segment);
    rig_send(&rig, REQUEST, 8, segment);
    TEST_ASSERT_EQUAL_HEX8_ARRAY("Kontur", &answer.data[1], 6);
    TEST_ASSERT_EQUAL_HEX8_ARRAY("Kontur", &rig.sdo.data[1], 6);
}

static void test_others_are_refused_and_counted_and_the_holder_is_told(void)
{
    hold();
    rig.emcy_count = 0;
    TEST_ASSERT_EQUAL_HEX32(ABORT_LOCAL, rig_write(&rig, 0x6060, 0, 1, 3));
    TEST_ASSERT_EQUAL_HEX32(ABORT_LOCAL, rig_write(&rig, 0x68FF, 0, 4, 370000));
    TEST_ASSERT_EQUAL_HEX32(ABORT_LOCAL, rig_write(&rig, 0x2110, 1, 4, 123456));
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT32(3, rig_read(&rig, 0x2140, 5));
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, SECOND_MASTER));
    TEST_ASSERT_EQUAL_HEX32(0, write(0x6060, 0, 1, 3));
    TEST_ASSERT_EQUAL_HEX32(0, write(0x2110, 1, 4, 123456));
    TEST_ASSERT_EQUAL_UINT32(3, rig_read(&rig, 0x2140, 5));
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x2140, 2, 4, 5)); /* a claim has its own answer */
}

static void test_stops_are_taken_from_anybody_and_nothing_else(void)
{
    static const struct {
        uint16_t word;
        bool taken;
    } words[] = {{0x00, true}, {SHUTDOWN, true},     {SWITCH_ON, true}, {QUICK_STOP, true},
                 {HALT, true}, {FAULT_RESET, false}, {ENABLE, false},   {RUN, false}};
    hold();
    for (unsigned i = 0; i < sizeof words / sizeof words[0]; i++) {
        const uint32_t code = rig_write(&rig, i % 2 == 0 ? 0x6040 : 0x6840, 0, 2, words[i].word);
        TEST_ASSERT_EQUAL_HEX32(words[i].taken ? 0 : ABORT_LOCAL, code);
    }
}

static void test_ticket_of_the_holder_is_not_made_void_by_a_read_of_another(void)
{
    hold();
    const uint8_t upload[8] = {0x40, 0x40, 0x21, 3};
    rig.hal.can_send = keep_answer;
    rig_send(&rig, REQUEST, 8, upload);
    const uint32_t ticket = co_get(&answer.data[4], 4);
    rig_ms(&rig, 3);
    TEST_ASSERT_EQUAL_UINT32(ticket, rig_read(&rig, 0x2140, 3));
    TEST_ASSERT_EQUAL_HEX32(ABORT_LOCAL, rig_write(&rig, 0x2140, 4, 4, ticket));
    TEST_ASSERT_EQUAL_HEX32(0, write(0x2140, 4, 4, ticket));
    TEST_ASSERT_EQUAL_HEX32(ABORT_LOCAL, rig_write(&rig, 0x2000, 1, 1, 1));
}

static void test_lss_configures_and_stores_nothing_of_a_held_drive(void)
{
    const uint8_t on[8] = {0x04, 1}, id[8] = {0x11, 9}, store[8] = {0x17};
    hold();
    rig_send(&rig, 0x7E5, 8, on);
    rig_send(&rig, 0x7E5, 8, id);
    rig_send(&rig, 0x7E5, 8, store);
    TEST_ASSERT_EQUAL_UINT8(1, rig.device.od.node.id);
    TEST_ASSERT_EQUAL_UINT(0, rig.flash.operations);
    TEST_ASSERT_TRUE(rig_read(&rig, 0x2140, 5) > 0);
}

static void test_channel_of_a_holder_that_is_gone_is_closed_by_the_next_one_and_not_by_itself(void)
{
    hold();
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 600);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2140, 1));
    TEST_ASSERT_EQUAL_HEX32(0, write(0x2140, 2, 4, HOLDER_ID)); /* back again */
    TEST_ASSERT_EQUAL_HEX32(ABORT_LOCAL, rig_write(&rig, 0x2000, 1, 1, 1));
    TEST_ASSERT_EQUAL_HEX32(0, write(0x2140, 2, 4, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2140, 2, 4, 5));
    TEST_ASSERT_EQUAL_HEX32(0x80000000, rig_read(&rig, 0x1201, 1));
    show_ticket();
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2000, 1, 1, 1));
}

/* Held by a master that opens no channel of its own, so it has the one that all have. */
static void hold_without_channel(void)
{
    rig_nmt(&rig, 1);
    rig.heartbeat_every_ms = 50;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2140, 2, 4, HOLDER_ID));
}

static void test_holder_without_a_channel_writes_within_a_second_after_its_ticket(void)
{
    static const struct {
        uint16_t index;
        uint8_t sub, size;
        uint32_t value;
    } writes[] = {{0x6060, 0, 1, 3},    {0x60FF, 0, 4, 370000}, {0x2000, 1, 1, 1},
                  {0x2131, 0, 2, 500},  {0x2110, 1, 4, 123456}, {0x1016, 1, 4, 0},
                  {0x1014, 0, 4, 0x81}, {0x2001, 1, 1, 9},      {0x1010, 1, 4, 0x65766173}};
    hold_without_channel();
    for (unsigned k = 0; k < 3; k++) {
        for (unsigned i = 0; i < sizeof writes / sizeof writes[0]; i++) {
            const uint32_t code = rig_write(&rig, writes[i].index, writes[i].sub, writes[i].size, writes[i].value);
            TEST_ASSERT_EQUAL_HEX32(k == 1 ? 0 : ABORT_LOCAL, code);
        }
        if (k == 0) {
            show_ticket();
        } else {
            rig_ms(&rig, 1000);
        }
    }
    TEST_ASSERT_EQUAL_UINT32(2 * sizeof writes / sizeof writes[0], rig_read(&rig, 0x2140, 5));
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, SECOND_MASTER));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6040, 0, 2, 0)); /* a stop needs none */
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2140, 2, 4, 0)); /* nor does its end */
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2000, 1, 1, 2));
}

static void test_ticket_of_one_holder_is_not_that_of_the_next(void)
{
    hold_without_channel();
    show_ticket();
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2140, 2, 4, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2140, 2, 4, 5));
    TEST_ASSERT_EQUAL_HEX32(ABORT_LOCAL, rig_write(&rig, 0x2000, 1, 1, 1));
}

static void test_ticket_that_has_enabled_the_axes_still_tells_the_holder(void)
{
    hold_without_channel();
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    show_ticket();
    rig_ms(&rig, 2);
    rig_controlwords_at_once(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2131, 0, 2, 500));
    rig_ms(&rig, 1000);
    TEST_ASSERT_EQUAL_HEX32(ABORT_LOCAL, rig_write(&rig, 0x2131, 0, 2, 1000));
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

static void test_lss_of_a_holder_without_a_channel_needs_its_ticket(void)
{
    const uint8_t on[8] = {0x04, 1}, id[8] = {0x11, 9};
    hold_without_channel();
    rig_send(&rig, 0x7E5, 8, on);
    rig_send(&rig, 0x7E5, 8, id);
    TEST_ASSERT_EQUAL_UINT8(1, rig.device.od.node.id);
    show_ticket();
    rig_send(&rig, 0x7E5, 8, id);
    TEST_ASSERT_EQUAL_UINT8(9, rig.device.od.node.id);
}

/* Whoever held the drive before, the one that opens the channel first after the claim has it. */
static void test_channel_is_opened_without_a_ticket_and_only_while_it_is_closed(void)
{
    hold_without_channel();
    open_channel();
    TEST_ASSERT_EQUAL_HEX32(ABORT_LOCAL, rig_write(&rig, 0x1201, 1, 4, 0x80000000));
    TEST_ASSERT_EQUAL_HEX32(0, write(0x2000, 1, 1, 1));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_channel_serves_requests_once_both_identifiers_are_valid);
    RUN_TEST(test_channel_is_not_stored);
    RUN_TEST(test_transfers_of_both_channels_do_not_disturb_each_other);
    RUN_TEST(test_others_are_refused_and_counted_and_the_holder_is_told);
    RUN_TEST(test_stops_are_taken_from_anybody_and_nothing_else);
    RUN_TEST(test_ticket_of_the_holder_is_not_made_void_by_a_read_of_another);
    RUN_TEST(test_lss_configures_and_stores_nothing_of_a_held_drive);
    RUN_TEST(test_channel_of_a_holder_that_is_gone_is_closed_by_the_next_one_and_not_by_itself);
    RUN_TEST(test_holder_without_a_channel_writes_within_a_second_after_its_ticket);
    RUN_TEST(test_ticket_of_one_holder_is_not_that_of_the_next);
    RUN_TEST(test_ticket_that_has_enabled_the_axes_still_tells_the_holder);
    RUN_TEST(test_lss_of_a_holder_without_a_channel_needs_its_ticket);
    RUN_TEST(test_channel_is_opened_without_a_ticket_and_only_while_it_is_closed);
    return UNITY_END();
}
