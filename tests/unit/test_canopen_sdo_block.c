/* SPDX-License-Identifier: Apache-2.0 */
/* SDO block upload, byte by byte as in CiA 301, 7.2.4.3.12 to .16, and with a client that loses segments. */
#include <stdio.h>

#include "canopen/sdo_block.h"
#include "test_canopen_block.h"

static char text[2001]; /* 285 segments and 5 bytes: more than two blocks of 127 */

void setUp(void)
{
    bus_start(&bus);
    bus.od.heartbeat_producer = 0;
    for (unsigned i = 0; i < sizeof text - 1; i++) {
        text[i] = (char)('!' + i * 7 % 90);
    }
    bus.od.build_id = text;
}

void tearDown(void)
{
}

static void test_upload_of_a_short_text_in_one_block(void)
{
    bus.od.build_id = "123456789";
    bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 09 00 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 5);
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
    bus_expect(&bus, 0, 0x585, "01 31 32 33 34 35 36 37");
    bus_expect(&bus, 1, 0x585, "82 38 39 00 00 00 00 00");
    bus_sdo(&bus, "A2 02 7F 00 00 00 00 00", "D5 C3 31 00 00 00 00 00"); /* 5 unused; 31C3h: the CRC's check value */
    give("A1 00 00 00 00 00 00 00");
    TEST_ASSERT_EQUAL(CO_SDO_IDLE, bus.node.sdo.transfer.phase);
}

static void test_domain_comes_by_block_until_it_is_gone(void)
{
    bus.domain = "123456789";
    bus_sdo(&bus, "A4 02 23 00 7F 00 00 00", "C6 02 23 00 09 00 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 5);
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
    bus_expect(&bus, 1, 0x585, "82 38 39 00 00 00 00 00");
    bus_sdo(&bus, "A2 02 7F 00 00 00 00 00", "D5 C3 31 00 00 00 00 00");
    give("A1 00 00 00 00 00 00 00");

    bus_sdo(&bus, "A4 02 23 00 7F 00 00 00", "C6 02 23 00 09 00 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus.domain = NULL;
    bus_run_ms(&bus, 5);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x585, "80 02 23 00 22 00 00 08");
    TEST_ASSERT_EQUAL(CO_SDO_IDLE, bus.node.sdo.transfer.phase);
}

static void test_upload_without_crc_has_none(void)
{
    bus.od.build_id = "123456789";
    bus_sdo(&bus, "A0 10 20 00 7F 00 00 00", "C2 10 20 00 09 00 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 5);
    bus_sdo(&bus, "A2 02 7F 00 00 00 00 00", "D5 00 00 00 00 00 00 00");
}

static void test_number_and_empty_text_go_by_block_too(void)
{
    bus_sdo(&bus, "A4 00 10 00 7F 00 00 00", "C6 00 10 00 04 00 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 1);
    bus_expect(&bus, 0, 0x585, "81 92 01 FF FF 00 00 00");
    bus_sdo(&bus, "A2 01 7F 00 00 00 00 00", "CD C8 01 00 00 00 00 00");
    bus.od.build_id = "";
    bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 00 00 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x585, "81 00 00 00 00 00 00 00");
    bus_sdo(&bus, "A2 01 7F 00 00 00 00 00", "DD 00 00 00 00 00 00 00");
}

/* Segments full or not, one or more: numbers from 1 on, the last one marked, its unused bytes in the end. */
static void test_text_of_each_length_has_the_segments_it_needs(void)
{
    for (unsigned n = 1; n <= 22; n++) {
        char answer[32];
        const unsigned segments = (n + 6) / 7;
        bus.od.build_id = &text[sizeof text - 1 - n];
        (void)snprintf(answer, sizeof answer, "C2 10 20 00 %02X 00 00 00", n);
        bus_sdo(&bus, "A0 10 20 00 7F 00 00 00", answer);
        give("A3 00 00 00 00 00 00 00");
        bus_run_ms(&bus, 10);
        TEST_ASSERT_EQUAL_UINT(segments, bus.count);
        for (unsigned i = 0; i < segments; i++) {
            TEST_ASSERT_EQUAL_HEX8((i + 1) | (i + 1 == segments ? 0x80u : 0u), bus.sent[i].data[0]);
        }
        char acknowledge[32];
        (void)snprintf(acknowledge, sizeof acknowledge, "A2 %02X 7F 00 00 00 00 00", segments);
        (void)snprintf(answer, sizeof answer, "%02X 00 00 00 00 00 00 00", 0xC1u | (7 * segments - n) << 2);
        bus_sdo(&bus, acknowledge, answer);
        give("A1 00 00 00 00 00 00 00");
    }
}

static void test_segments_are_paced_and_wait_for_room(void)
{
    bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 D0 07 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(CO_SDO_SEGMENTS_PER_MS, bus.count);
    bus.room = 1;
    bus_run_ms(&bus, 10);
    TEST_ASSERT_EQUAL_UINT(CO_SDO_SEGMENTS_PER_MS + 1, bus.count);
    bus.room = SENT_MAX;
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_HEX8(CO_SDO_SEGMENTS_PER_MS + 4, bus.sent[CO_SDO_SEGMENTS_PER_MS + 3].data[0]);
    bus_run_ms(&bus, 127);
    TEST_ASSERT_EQUAL_UINT(127, bus.count); /* a block, then it waits */
}

static unsigned refusals; /* of can_send, still to come */

static bool refuse_at_first(void *ctx, const struct can_frame *frame)
{
    if (refusals > 0) {
        refusals--;
        return false;
    }
    return bus_can_send(ctx, frame);
}

static void test_segments_let_pass_what_waits(void)
{
    bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 D0 07 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus.hal.can_send = refuse_at_first;
    refusals = 2; /* at once, and in the next millisecond, in which there is room again for what comes after it */
    co_emcy_set(&bus.node, 0x8611, CO_REG_PROFILE, 0);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1 + CO_SDO_SEGMENTS_PER_MS, bus.count);
    bus_expect(&bus, 0, 0x085, "11 86 21 00 00 00 00 00");
}

static void test_block_goes_at_once_where_time_does_not_pass_by_itself(void)
{
    bus.od.clock.pace = 1;
    bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 D0 07 00 00");
    bus_clear(&bus);
    bus_give(&bus, 0x605, "A3 00 00 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(127, bus.count);
    bus_clear(&bus);
    bus_give(&bus, 0x605, "A2 7F 05 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(5, bus.count);
}

/* A client that takes segments in order and acknowledges at the end of a block. */
struct client {
    char data[sizeof text + 7];
    unsigned size;
    unsigned expected; /* sequence number */
    bool done;
};

static void acknowledge(struct client *c, uint8_t block)
{
    struct can_frame ack = {.id = 0x605, .len = 8, .data = {0xA2, (uint8_t)(c->expected - 1), block}};
    c->expected = 1;
    bus_clear(&bus);
    co_receive(&bus.node, &ack);
}

/* Run until the server has nothing more to send; one segment of `lose` is lost, at random. */
static void receive_all(struct client *c, unsigned block, unsigned lose, uint32_t *random)
{
    bus.room = SENT_MAX;
    bus_run_ms(&bus, block);
    for (unsigned i = 0; i < bus.count; i++) {
        const struct can_frame *f = &bus.sent[i];
        *random = *random * 1664525u + 1013904223u;
        if (lose != 0 && (*random >> 16) % lose == 0) {
            continue;
        }
        if ((f->data[0] & 0x7Fu) == c->expected) {
            memcpy(&c->data[c->size], &f->data[1], 7);
            c->size += 7;
            c->expected++;
            c->done = (f->data[0] & 0x80) != 0;
        }
    }
}

static void upload(struct client *c, unsigned block, unsigned lose)
{
    char request[32];
    uint32_t random = 1;
    *c = (struct client){.expected = 1};
    bus_clear(&bus);
    snprintf(request, sizeof request, "A4 10 20 00 %02X 00 00 00", block);
    bus_sdo(&bus, request, "C6 10 20 00 D0 07 00 00");
    give("A3 00 00 00 00 00 00 00");
    for (int rounds = 0; !c->done; rounds++) {
        TEST_ASSERT_TRUE_MESSAGE(rounds < 4000, "the upload does not end");
        receive_all(c, block, lose, &random);
        acknowledge(c, (uint8_t)block);
    }
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    const struct can_frame *end = &bus.sent[0];
    c->size -= end->data[0] >> 2 & 7u;
    TEST_ASSERT_EQUAL_HEX8(0xC1, end->data[0] & 0xE3);
    TEST_ASSERT_EQUAL_UINT(sizeof text - 1, c->size);
    TEST_ASSERT_EQUAL_MEMORY(text, c->data, c->size);
    TEST_ASSERT_EQUAL_HEX16(crc16(text, sizeof text - 1), co_get(&end->data[1], 2));
    give("A1 00 00 00 00 00 00 00");
}

static void test_long_text_arrives_completely_with_every_block_size(void)
{
    for (unsigned block = 1; block <= 127; block++) {
        struct client c;
        upload(&c, block, 0);
    }
}

static void test_lost_segments_are_sent_again_with_every_block_size(void)
{
    for (unsigned block = 1; block <= 127; block++) {
        for (unsigned lose = 2; lose < 12; lose++) {
            struct client c;
            upload(&c, block, lose);
        }
    }
}

static void test_acknowledgement_within_a_block_goes_back_to_the_missing_segment(void)
{
    bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 D0 07 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 3);
    TEST_ASSERT_EQUAL_UINT(9, bus.count);
    const struct can_frame fifth = bus.sent[4];
    give("A2 04 02 00 00 00 00 00"); /* only four have come; blocks of two from here on */
    bus_run_ms(&bus, 3);
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
    TEST_ASSERT_EQUAL_HEX8(1, bus.sent[0].data[0]);
    TEST_ASSERT_EQUAL_MEMORY(&fifth.data[1], &bus.sent[0].data[1], 7);
}

static void test_block_size_and_sequence_number_out_of_range_end_an_upload(void)
{
    bus_sdo(&bus, "A4 10 20 00 00 00 00 00", "80 10 20 00 02 00 04 05");
    bus_sdo(&bus, "A4 10 20 00 80 00 00 00", "80 10 20 00 02 00 04 05");
    bus_sdo(&bus, "A4 10 20 00 05 00 00 00", "C6 10 20 00 D0 07 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 3);
    bus_sdo(&bus, "A2 06 05 00 00 00 00 00", "80 10 20 00 03 00 04 05");
    bus_sdo(&bus, "A4 10 20 00 05 00 00 00", "C6 10 20 00 D0 07 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 3);
    bus_sdo(&bus, "A2 05 00 00 00 00 00 00", "80 10 20 00 02 00 04 05");
    bus_clear(&bus);
    bus_run_ms(&bus, 10);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

/* What would be right for the last segment, if it had been sent, and if the block size were one */
static void test_acknowledgement_out_of_range_at_the_end_ends_an_upload(void)
{
    bus.od.build_id = "123456789";
    bus_sdo(&bus, "A0 10 20 00 7F 00 00 00", "C2 10 20 00 09 00 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus.room = 1;
    bus_run_ms(&bus, 1);
    bus.room = SENT_MAX;
    bus_sdo(&bus, "A2 02 7F 00 00 00 00 00", "80 10 20 00 03 00 04 05");
    bus_sdo(&bus, "A0 10 20 00 7F 00 00 00", "C2 10 20 00 09 00 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 1);
    bus_sdo(&bus, "A2 02 00 00 00 00 00 00", "80 10 20 00 02 00 04 05");
}

static void test_value_up_to_the_protocol_switch_threshold_goes_the_simple_way(void)
{
    bus.od.build_id = "123456789";
    bus_sdo(&bus, "A4 10 20 00 7F 08 00 00", "C6 10 20 00 09 00 00 00");
    bus_sdo(&bus, "A4 10 20 00 7F 09 00 00", "41 10 20 00 09 00 00 00");
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "00 31 32 33 34 35 36 37");
    bus_sdo(&bus, "70 00 00 00 00 00 00 00", "1B 38 39 00 00 00 00 00");
    bus_sdo(&bus, "A4 17 10 00 7F 04 00 00", "4B 17 10 00 00 00 00 00");
}

static void test_client_may_end_an_upload_at_any_time(void)
{
    const char *const steps[] = {"", "A3 00 00 00 00 00 00 00"};
    for (unsigned i = 0; i < 2; i++) {
        bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 D0 07 00 00");
        if (i > 0) {
            give(steps[i]);
            bus_run_ms(&bus, 2);
        }
        give("80 10 20 00 00 00 00 08");
        bus_run_ms(&bus, 10);
        TEST_ASSERT_EQUAL_UINT(0, bus.count);
    }
}

static void test_new_request_ends_an_upload(void)
{
    bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 D0 07 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 2);
    bus_sdo(&bus, "40 00 10 00 00 00 00 00", "43 00 10 00 92 01 FF FF");
    bus_clear(&bus);
    bus_run_ms(&bus, 10);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

static void test_silent_client_ends_an_upload(void)
{
    bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 D0 07 00 00");
    bus_clear(&bus);
    bus_run_ms(&bus, CO_SDO_TIMEOUT_MS + 1);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x585, "80 10 20 00 00 00 04 05");
}

/* It is the drive's turn: the client waits for segments, which the bus lets pass now and then only. */
static void test_upload_over_a_busy_bus_is_no_silence_of_the_client(void)
{
    bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 D0 07 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus.room = 0;
    for (unsigned i = 0; i < 3; i++) {
        bus_run_ms(&bus, CO_SDO_TIMEOUT_MS - 1);
        bus.room = 1;
        bus_run_ms(&bus, 1);
        TEST_ASSERT_EQUAL_UINT(i + 1, bus.count);
        TEST_ASSERT_EQUAL_HEX8(i + 1, bus.sent[i].data[0]);
    }
}

static void test_steps_that_the_bus_repeats_do_no_harm(void)
{
    bus.od.build_id = "123456789";
    bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 09 00 00 00");
    give("A3 00 00 00 00 00 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_run_ms(&bus, 2);
    give("A2 01 7F 00 00 00 00 00");
    give("A2 01 7F 00 00 00 00 00");
    bus_run_ms(&bus, 2);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x585, "81 38 39 00 00 00 00 00");
    bus_sdo(&bus, "A2 01 7F 00 00 00 00 00", "D5 C3 31 00 00 00 00 00");
    give("A2 01 7F 00 00 00 00 00");
    give("A1 00 00 00 00 00 00 00");
    give("A1 00 00 00 00 00 00 00");
}

static void test_step_of_an_upload_within_another_transfer_ends_that(void)
{
    static const char *const steps[] = {"A1 00 00 00 00 00 00 00", "A2 01 7F 00 00 00 00 00",
                                        "A3 00 00 00 00 00 00 00"};
    for (unsigned i = 0; i < sizeof steps / sizeof steps[0]; i++) {
        bus_sdo(&bus, "40 08 10 00 00 00 00 00", "41 08 10 00 06 00 00 00");
        bus_sdo(&bus, steps[i], "80 08 10 00 01 00 04 05");
        bus_sdo(&bus, "60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05");
    }
}

static void test_what_cannot_be_read_cannot_be_read_by_block(void)
{
    bus_sdo(&bus, "A4 00 22 01 7F 00 00 00", "80 00 22 01 01 00 01 06");
    bus_sdo(&bus, "A4 FF 5F 00 7F 00 00 00", "80 FF 5F 00 00 00 02 06");
    bus_sdo(&bus, "A3 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05");
    bus_sdo(&bus, "A2 01 7F 00 00 00 00 00", "80 00 00 00 01 00 04 05");
}

static void test_reset_and_stop_end_a_transfer(void)
{
    bus_sdo(&bus, "A4 10 20 00 7F 00 00 00", "C6 10 20 00 D0 07 00 00");
    give("A3 00 00 00 00 00 00 00");
    bus_give(&bus, 0, "02 05");
    bus_clear(&bus);
    bus_run_ms(&bus, 10);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_give(&bus, 0, "80 05");
    bus_run_ms(&bus, 10);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_upload_of_a_short_text_in_one_block);
    RUN_TEST(test_domain_comes_by_block_until_it_is_gone);
    RUN_TEST(test_upload_without_crc_has_none);
    RUN_TEST(test_number_and_empty_text_go_by_block_too);
    RUN_TEST(test_text_of_each_length_has_the_segments_it_needs);
    RUN_TEST(test_segments_are_paced_and_wait_for_room);
    RUN_TEST(test_segments_let_pass_what_waits);
    RUN_TEST(test_block_goes_at_once_where_time_does_not_pass_by_itself);
    RUN_TEST(test_long_text_arrives_completely_with_every_block_size);
    RUN_TEST(test_lost_segments_are_sent_again_with_every_block_size);
    RUN_TEST(test_acknowledgement_within_a_block_goes_back_to_the_missing_segment);
    RUN_TEST(test_block_size_and_sequence_number_out_of_range_end_an_upload);
    RUN_TEST(test_acknowledgement_out_of_range_at_the_end_ends_an_upload);
    RUN_TEST(test_value_up_to_the_protocol_switch_threshold_goes_the_simple_way);
    RUN_TEST(test_client_may_end_an_upload_at_any_time);
    RUN_TEST(test_new_request_ends_an_upload);
    RUN_TEST(test_silent_client_ends_an_upload);
    RUN_TEST(test_upload_over_a_busy_bus_is_no_silence_of_the_client);
    RUN_TEST(test_steps_that_the_bus_repeats_do_no_harm);
    RUN_TEST(test_step_of_an_upload_within_another_transfer_ends_that);
    RUN_TEST(test_what_cannot_be_read_cannot_be_read_by_block);
    RUN_TEST(test_reset_and_stop_end_a_transfer);
    return UNITY_END();
}
