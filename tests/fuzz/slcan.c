/* SPDX-License-Identifier: Apache-2.0 */
/* Feeds any bytes to the slcan codec. Frames are valid and answers fit. A frame that was understood is the same after
 * it was sent as a line and read back. */
#include <string.h>

#include "bytes.h"
#include "port/slcan.h"
#include "unity.h"

/* A frame is the same after it was sent as a line and read back. */
static void expect_round_trip(const struct slcan *sender, const struct can_frame *frame, uint32_t ms)
{
    char line[SLCAN_FRAME];
    struct slcan open = *sender, receiver;
    open.open = true;
    const unsigned count = slcan_format(&open, frame, ms, line);
    TEST_ASSERT_TRUE(count > 0 && count <= SLCAN_FRAME && line[count - 1] == '\r');
    slcan_init(&receiver, 0);
    receiver.open = true;
    const unsigned without_stamp = count - 1 - (open.stamps ? 4 : 0);
    struct can_frame back = {0};
    struct slcan_answer answer;
    for (unsigned i = 0; i < without_stamp; i++) {
        TEST_ASSERT_EQUAL(SLCAN_NOTHING, slcan_parse(&receiver, line[i], &back, &answer));
    }
    TEST_ASSERT_EQUAL(SLCAN_HAS_FRAME, slcan_parse(&receiver, ms % 2 != 0 ? '\r' : '\n', &back, &answer));
    TEST_ASSERT_TRUE(back.id == frame->id && back.len == frame->len && back.rtr == frame->rtr);
    TEST_ASSERT_TRUE(frame->rtr || memcmp(back.data, frame->data, frame->len) == 0);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct slcan s;
    slcan_init(&s, 0x12AB);
    if (size > 0 && data[0] >= 0x80) { /* most lines have a meaning only while the channel is open */
        s.open = true;
    }
    for (size_t i = 0; i < size; i++) {
        struct can_frame frame = {0};
        struct slcan_answer answer;
        const bool could_hear = s.open && !s.listen_only;
        const uint32_t refused = s.refused;
        const enum slcan_event event = slcan_parse(&s, (char)data[i], &frame, &answer);
        TEST_ASSERT_TRUE(answer.count <= SLCAN_ANSWER && s.count <= SLCAN_LINE + 1 && event <= SLCAN_CLOSED);
        TEST_ASSERT_TRUE(event == SLCAN_NOTHING || s.count == 0);
        const bool bell = answer.count > 0 && answer.text[answer.count - 1] == '\a';
        TEST_ASSERT_EQUAL(refused + (bell ? 1u : 0u), s.refused);
        TEST_ASSERT_TRUE(data[i] == '\r' || data[i] == '\n' || (event == SLCAN_NOTHING && answer.count == 0));
        if (event == SLCAN_HAS_FRAME) {
            TEST_ASSERT_TRUE(could_hear && frame.id <= 0x7FF && frame.len <= 8);
            expect_round_trip(&s, &frame, (uint32_t)i);
        }
    }
    /* After any input the next line is understood. */
    struct can_frame frame;
    struct slcan_answer answer;
    for (const char *c = "\rO\rt1230\r"; *c != '\0'; c++) {
        if (slcan_parse(&s, *c, &frame, &answer) == SLCAN_HAS_FRAME && c[1] == '\0') {
            TEST_ASSERT_EQUAL_HEX16(0x123, frame.id);
            return 0;
        }
    }
    TEST_ASSERT_TRUE_MESSAGE(false, "a good frame is not accepted");
    return 0;
}
