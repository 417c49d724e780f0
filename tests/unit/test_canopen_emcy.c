/* SPDX-License-Identifier: Apache-2.0 */
/* EMCY (CiA 301, 7.2.7, 1001h, 1003h, 1014h, 1015h), also messages that cannot go at once. */
#include "test_canopen_bus.h"

static struct bus bus;

void setUp(void)
{
    bus_start(&bus);
    bus.od.heartbeat_producer = 0;
    bus_clear(&bus);
}

void tearDown(void)
{
}

static void test_error_sends_one_message_with_register_and_details(void)
{
    bus_clear(&bus);
    co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 0x12345678);
    co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 0x12345678);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x085, "11 86 21 78 56 34 12 00");
    TEST_ASSERT_EQUAL_HEX8(0x21, bus.od.error_register);
}

static void test_register_falls_to_what_is_left_as_errors_end(void)
{
    co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 0);
    co_emcy_set(&bus.node, 0x2310, CO_REG_CURRENT, 0);
    bus_clear(&bus);
    co_emcy_reset(&bus.node, 0x8611);
    co_emcy_reset(&bus.node, 0x2310);
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
    bus_expect(&bus, 0, 0x085, "00 00 03 00 00 00 00 00");
    bus_expect(&bus, 1, 0x085, "00 00 00 00 00 00 00 00");
}

static void test_error_that_is_not_in_effect_cannot_end(void)
{
    co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 0);
    bus_clear(&bus);
    co_emcy_reset(&bus.node, 0x8130);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    TEST_ASSERT_EQUAL_HEX8(0x21, bus.od.error_register);
}

static void test_error_that_ended_may_begin_again(void)
{
    co_emcy_set(&bus.node, 0x8130, CO_REG_COMMUNICATION, 0);
    co_emcy_reset(&bus.node, 0x8130);
    bus_clear(&bus);
    co_emcy_set(&bus.node, 0x8130, CO_REG_COMMUNICATION, 0);
    bus_expect(&bus, 0, 0x085, "30 81 11 00 00 00 00 00");
}

static void test_history_holds_the_newest_error_first_and_at_most_eight(void)
{
    for (uint16_t i = 1; i <= 10; i++) {
        co_emcy_set(&bus.node, (uint16_t)(0xFF00 + i), 0, i);
    }
    bus_sdo(&bus, "40 03 10 00 00 00 00 00", "4F 03 10 00 08 00 00 00");
    bus_sdo(&bus, "40 03 10 01 00 00 00 00", "43 03 10 01 0A FF 0A 00");
    bus_sdo(&bus, "40 03 10 08 00 00 00 00", "43 03 10 08 03 FF 03 00");
}

static void test_history_is_cleared_by_writing_0_and_nothing_else(void)
{
    co_emcy_set(&bus.node, 0x8130, CO_REG_COMMUNICATION, 0);
    bus_sdo(&bus, "2F 03 10 00 01 00 00 00", "80 03 10 00 30 00 09 06");
    bus_sdo(&bus, "2F 03 10 00 00 00 00 00", "60 03 10 00 00 00 00 00");
    bus_sdo(&bus, "40 03 10 00 00 00 00 00", "4F 03 10 00 00 00 00 00");
    bus_sdo(&bus, "40 03 10 01 00 00 00 00", "80 03 10 01 24 00 00 08"); /* no data available */
}

static void test_error_beyond_all_that_can_be_is_none(void)
{
    for (uint16_t i = 0; i < CO_ERRORS; i++) {
        co_emcy_set(&bus.node, (uint16_t)(0xFF00 + i), 0, 0);
    }
    TEST_ASSERT_EQUAL_UINT(CO_ERRORS, bus.count);
    co_emcy_set(&bus.node, 0x2310, CO_REG_CURRENT, 0);
    TEST_ASSERT_EQUAL_UINT(CO_ERRORS, bus.count);
    TEST_ASSERT_EQUAL_HEX8(0x01, bus.od.error_register);
}

static void test_stopped_node_sends_no_emcy(void)
{
    bus_give(&bus, 0, "02 05");
    bus_clear(&bus);
    co_emcy_set(&bus.node, 0x8130, CO_REG_COMMUNICATION, 0);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    TEST_ASSERT_EQUAL_HEX8(0x11, bus.od.error_register);
}

static void inhibit_for_10_ms(void)
{
    bus_sdo(&bus, "2B 15 10 00 64 00 00 00", "60 15 10 00 00 00 00 00");
    bus_clear(&bus);
}

static uint16_t code_of(unsigned i)
{
    TEST_ASSERT_TRUE(i < bus.count);
    TEST_ASSERT_EQUAL_HEX16(0x085, bus.sent[i].id);
    return (uint16_t)(bus.sent[i].data[0] | bus.sent[i].data[1] << 8);
}

static void test_messages_within_the_inhibit_time_come_later_one_by_one_as_they_were(void)
{
    inhibit_for_10_ms();
    co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 1);
    co_emcy_set(&bus.node, 0x2310, CO_REG_CURRENT, 2);
    co_emcy_reset(&bus.node, 0x8611);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_run_ms(&bus, 10);
    TEST_ASSERT_EQUAL_UINT(1, bus.count); /* the first tick may have come at once */
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
    bus_run_ms(&bus, 9);
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(3, bus.count);
    bus_expect(&bus, 0, 0x085, "11 86 21 01 00 00 00 00");
    bus_expect(&bus, 1, 0x085, "10 23 23 02 00 00 00 00");
    bus_expect(&bus, 2, 0x085, "00 00 03 00 00 00 00 00");
    bus_run_ms(&bus, 100);
    TEST_ASSERT_EQUAL_UINT(3, bus.count);
}

static void test_inhibit_time_set_to_0_sends_the_messages_that_wait(void)
{
    inhibit_for_10_ms();
    co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 0);
    co_emcy_set(&bus.node, 0x2310, CO_REG_CURRENT, 0);
    bus_sdo(&bus, "2B 15 10 00 00 00 00 00", "60 15 10 00 00 00 00 00");
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_HEX16(0x2310, code_of(1));
}

static void test_stopped_node_sends_its_messages_when_it_is_no_longer_stopped(void)
{
    bus_give(&bus, 0, "02 05");
    co_emcy_set(&bus.node, 0x8130, CO_REG_COMMUNICATION, 0);
    bus_run_ms(&bus, 50);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_give(&bus, 0, "80 05");
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    TEST_ASSERT_EQUAL_HEX16(0x8130, code_of(0));
}

static void test_full_bus_loses_no_message_and_leaves_room_for_answers(void)
{
    bus.room = 0;
    for (uint16_t i = 0; i < CO_ERRORS; i++) {
        co_emcy_set(&bus.node, (uint16_t)(0xFF00 + i), 0, 0);
    }
    for (unsigned i = 0; i < CO_TX_FRAMES; i++) {
        bus_give(&bus, 0x605, "40 03 10 00 00 00 00 00");
    }
    bus.room = SENT_MAX;
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(CO_ERRORS + CO_TX_FRAMES / 2, bus.count);
    unsigned sent_errors = 0;
    for (unsigned i = 0; i < bus.count; i++) {
        if (i >= CO_TX_FRAMES / 2 && i < CO_TX_FRAMES) { /* half of what waits is answers */
            TEST_ASSERT_EQUAL_HEX16(0x585, bus.sent[i].id);
        } else {
            TEST_ASSERT_EQUAL_HEX16(0xFF00 + sent_errors, code_of(i));
            sent_errors++;
        }
    }
}

/* One error comes and goes a thousand times while nothing can be sent, others stay. */
static void test_message_of_every_error_in_effect_is_sent_whatever_else_happens(void)
{
    bus_give(&bus, 0, "02 05");
    co_emcy_set(&bus.node, 0x2310, CO_REG_CURRENT, 0);
    for (unsigned i = 0; i < 1000; i++) {
        co_emcy_set(&bus.node, 0x8210, CO_REG_COMMUNICATION, i);
        co_emcy_reset(&bus.node, 0x8210);
        if (i == 500) {
            co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 0);
        }
    }
    co_emcy_set(&bus.node, 0x8210, CO_REG_COMMUNICATION, 1000);
    bus_give(&bus, 0, "80 05");
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(CO_EMCY_WAITING, bus.count);
    TEST_ASSERT_EQUAL_HEX16(0x2310, code_of(0));
    unsigned following = 0;
    for (unsigned i = 1; i < bus.count; i++) {
        following += code_of(i) == 0x8611;
    }
    TEST_ASSERT_EQUAL_UINT(1, following);
    bus_expect(&bus, bus.count - 2, 0x085, "00 00 23 00 00 00 00 00");
    bus_expect(&bus, bus.count - 1, 0x085, "10 82 33 E8 03 00 00 00");
}

/* Three messages each, for which there is no room. */
static void test_errors_that_all_came_twice_are_all_reported(void)
{
    bus_give(&bus, 0, "02 05");
    for (uint16_t i = 0; i < CO_ERRORS; i++) {
        const uint16_t code = (uint16_t)(0xFF00 + i);
        co_emcy_set(&bus.node, code, 0, 0);
        co_emcy_reset(&bus.node, code);
        co_emcy_set(&bus.node, code, 0, 1);
    }
    bus_give(&bus, 0, "80 05");
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(CO_EMCY_WAITING, bus.count);
    unsigned newest = 0;
    for (unsigned i = 0; i < bus.count; i++) {
        newest += code_of(i) == 0xFF00 + newest && bus.sent[i].data[3] == 1;
    }
    TEST_ASSERT_EQUAL_UINT(CO_ERRORS, newest);
}

static void test_of_messages_about_errors_that_are_over_the_oldest_is_left_out_first(void)
{
    bus_give(&bus, 0, "02 05");
    for (uint16_t i = 0; i <= CO_EMCY_WAITING / 2; i++) { /* the last two messages have no room of their own */
        co_emcy_set(&bus.node, (uint16_t)(0xFF00 + i), 0, 0);
        co_emcy_reset(&bus.node, (uint16_t)(0xFF00 + i));
    }
    bus_give(&bus, 0, "80 05");
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(CO_EMCY_WAITING, bus.count);
    for (unsigned i = 0; i < bus.count; i++) {
        TEST_ASSERT_EQUAL_HEX16(i % 2 == 0 ? 0xFF01 + i / 2 : 0, code_of(i));
    }
}

static void test_register_is_that_of_the_errors_left_whichever_ends_first(void)
{
    co_emcy_set(&bus.node, 0x2310, CO_REG_CURRENT, 0);
    co_emcy_set(&bus.node, 0x8130, CO_REG_COMMUNICATION, 0);
    co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 0);
    co_emcy_reset(&bus.node, 0x2310);
    TEST_ASSERT_EQUAL_HEX8(0x31, bus.od.error_register);
    co_emcy_reset(&bus.node, 0x8130);
    TEST_ASSERT_EQUAL_HEX8(0x21, bus.od.error_register);
    co_emcy_reset(&bus.node, 0x8611);
    TEST_ASSERT_EQUAL_HEX8(0, bus.od.error_register);
}

static void test_message_identifier_changes_only_while_it_is_not_in_use(void)
{
    bus_sdo(&bus, "23 14 10 00 90 00 00 00", "80 14 10 00 30 00 09 06");
    bus_sdo(&bus, "23 14 10 00 85 00 00 80", "60 14 10 00 00 00 00 00");
    bus_sdo(&bus, "23 14 10 00 05 06 00 00", "80 14 10 00 30 00 09 06"); /* restricted: an SDO has it */
    bus_sdo(&bus, "23 14 10 00 90 00 00 40", "80 14 10 00 30 00 09 06"); /* reserved bit */
    bus_sdo(&bus, "23 14 10 00 90 00 00 20", "80 14 10 00 30 00 09 06"); /* 29 bits */
    bus_sdo(&bus, "23 14 10 00 90 00 00 00", "60 14 10 00 00 00 00 00");
    bus_clear(&bus);
    co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 0);
    bus_expect(&bus, 0, 0x090, "11 86 21 00 00 00 00 00");
}

static void test_node_without_message_identifier_keeps_register_and_history(void)
{
    inhibit_for_10_ms();
    co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 0);
    co_emcy_set(&bus.node, 0x2310, CO_REG_CURRENT, 0);
    bus_sdo(&bus, "23 14 10 00 85 00 00 80", "60 14 10 00 00 00 00 00");
    bus_clear(&bus);
    co_emcy_set(&bus.node, 0x8130, CO_REG_COMMUNICATION, 0);
    bus_run_ms(&bus, 100);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_sdo(&bus, "40 01 10 00 00 00 00 00", "4F 01 10 00 33 00 00 00");
    bus_sdo(&bus, "40 03 10 00 00 00 00 00", "4F 03 10 00 03 00 00 00");
}

static void test_reset_communication_forgets_no_message(void)
{
    inhibit_for_10_ms();
    co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 0);
    co_emcy_set(&bus.node, 0x2310, CO_REG_CURRENT, 0);
    bus_clear(&bus);
    bus_give(&bus, 0, "82 05");
    bus_run_ms(&bus, 1);
    bus_expect(&bus, 0, 0x705, "00");
    TEST_ASSERT_EQUAL_HEX16(0x2310, code_of(1));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_error_sends_one_message_with_register_and_details);
    RUN_TEST(test_register_falls_to_what_is_left_as_errors_end);
    RUN_TEST(test_error_that_is_not_in_effect_cannot_end);
    RUN_TEST(test_error_that_ended_may_begin_again);
    RUN_TEST(test_history_holds_the_newest_error_first_and_at_most_eight);
    RUN_TEST(test_history_is_cleared_by_writing_0_and_nothing_else);
    RUN_TEST(test_error_beyond_all_that_can_be_is_none);
    RUN_TEST(test_stopped_node_sends_no_emcy);
    RUN_TEST(test_messages_within_the_inhibit_time_come_later_one_by_one_as_they_were);
    RUN_TEST(test_inhibit_time_set_to_0_sends_the_messages_that_wait);
    RUN_TEST(test_stopped_node_sends_its_messages_when_it_is_no_longer_stopped);
    RUN_TEST(test_full_bus_loses_no_message_and_leaves_room_for_answers);
    RUN_TEST(test_message_of_every_error_in_effect_is_sent_whatever_else_happens);
    RUN_TEST(test_errors_that_all_came_twice_are_all_reported);
    RUN_TEST(test_of_messages_about_errors_that_are_over_the_oldest_is_left_out_first);
    RUN_TEST(test_register_is_that_of_the_errors_left_whichever_ends_first);
    RUN_TEST(test_message_identifier_changes_only_while_it_is_not_in_use);
    RUN_TEST(test_node_without_message_identifier_keeps_register_and_history);
    RUN_TEST(test_reset_communication_forgets_no_message);
    return UNITY_END();
}
