/* SPDX-License-Identifier: Apache-2.0 */
/* test_slcan.c: slcan with the lines of the CAN232 manual, with lines that hosts send beyond it, and with random
 * bytes. */
#include <stdio.h>
#include <string.h>

#include "port/slcan.h"
#include "unity.h"

enum { FRAMES = 8 };

static struct slcan s;
static struct can_frame frames[FRAMES];
static unsigned frame_count;
static char answers[512];
static unsigned answer_count;

static void type(const char *text)
{
    frame_count = answer_count = 0;
    for (const char *c = text; *c != '\0'; c++) {
        struct slcan_answer answer;
        if (slcan_parse(&s, *c, &frames[frame_count], &answer) == SLCAN_HAS_FRAME) {
            frame_count++;
        }
        TEST_ASSERT_LESS_OR_EQUAL(SLCAN_ANSWER, answer.count);
        memcpy(&answers[answer_count], answer.text, answer.count);
        answer_count += answer.count;
    }
    answers[answer_count] = '\0';
}

static void answered(const char *text, const char *answer)
{
    type(text);
    TEST_ASSERT_EQUAL_STRING_MESSAGE(answer, answers, text);
}

void setUp(void)
{
    slcan_init(&s, 0x12AB);
    type("O\r");
}

void tearDown(void)
{
}

static void test_data_frame_is_received_and_not_answered(void)
{
    answered("t1238DEADbeef00017fff\r", "");
    TEST_ASSERT_EQUAL_UINT(1, frame_count);
    TEST_ASSERT_EQUAL_HEX16(0x123, frames[0].id);
    TEST_ASSERT_EQUAL_UINT8(8, frames[0].len);
    TEST_ASSERT_FALSE(frames[0].rtr);
    const uint8_t data[] = {0xDE, 0xAD, 0xBE, 0xEF, 0x00, 0x01, 0x7F, 0xFF};
    TEST_ASSERT_EQUAL_HEX8_ARRAY(data, frames[0].data, 8);
}

static void test_frames_of_every_length_back_to_back(void)
{
    answered("t7FF0\r", "");
    TEST_ASSERT_EQUAL_UINT(1, frame_count);
    answered("t0001A5\rt08020102\r", "");
    TEST_ASSERT_EQUAL_UINT(2, frame_count);
    TEST_ASSERT_EQUAL_HEX8(0xA5, frames[0].data[0]);
    TEST_ASSERT_EQUAL_HEX16(0x080, frames[1].id);
    TEST_ASSERT_EQUAL_UINT8(2, frames[1].len);
}

static void test_lines_end_in_cr_lf_or_both(void)
{
    static const char *const ends[] = {"\r", "\n", "\r\n"};
    for (unsigned i = 0; i < sizeof ends / sizeof *ends; i++) {
        char text[64];
        snprintf(text, sizeof text, "t0001A5%sO%st08020102%s\n", ends[i], ends[i], ends[i]);
        answered(text, "\r");
        TEST_ASSERT_EQUAL_UINT(2, frame_count);
        TEST_ASSERT_EQUAL_HEX8(0xA5, frames[0].data[0]);
        TEST_ASSERT_EQUAL_HEX16(0x080, frames[1].id);
    }
    TEST_ASSERT_EQUAL_UINT32(0, s.refused);
}

static void test_frames_that_classic_canopen_does_not_have_are_ignored_as_on_a_bus(void)
{
    static const char *const foreign[] = {
        "T000002018AAAAAAAAAAAAAAAA\r",
        "R000006018\r",
        "d2012AABB\r",
        "b2012AABB\r",
        "D000002012AABB\r",
        "B000002012AABB\r",
        "T\r",
        "d201F",
    };
    for (unsigned i = 0; i < sizeof foreign / sizeof *foreign; i++) {
        answered(foreign[i], "");
        TEST_ASSERT_EQUAL_UINT_MESSAGE(0, frame_count, foreign[i]);
    }
    for (unsigned i = 0; i < 64; i++) { /* more than the longest line of this parser */
        answered("00", "");
    }
    answered("\rt0010\r", "");
    TEST_ASSERT_EQUAL_UINT(1, frame_count);
    TEST_ASSERT_EQUAL_UINT32(0, s.refused);
    answered("C\rT000002010\r", "\r\a"); /* while closed nothing is a frame */
}

static void test_remote_frame_has_a_length_and_no_data(void)
{
    answered("r7018\r", "");
    TEST_ASSERT_EQUAL_UINT(1, frame_count);
    TEST_ASSERT_TRUE(frames[0].rtr);
    TEST_ASSERT_EQUAL_UINT8(8, frames[0].len);
    answered("r701800\r", "\a");
}

static void test_bad_frames_are_refused_and_counted(void)
{
    const char *const bad[] = {
        "t\r",       "t123\r",     "t8000\r",    "t1239000000000000000000\r", "t12g0\r",     "t1231\r", "t1231A\r",
        "t1231AG\r", "t1231A5 \r", "t1231A5B\r", "t1231A5t1231A5\r",          "t12310\t0\r", "rFFFF\r",
    };
    for (unsigned i = 0; i < sizeof bad / sizeof *bad; i++) {
        answered(bad[i], "\a");
        TEST_ASSERT_EQUAL_UINT_MESSAGE(0, frame_count, bad[i]);
        TEST_ASSERT_EQUAL_UINT32(i + 1, s.refused);
    }
}

static void test_what_python_can_sends_on_opening_is_accepted(void)
{
    slcan_init(&s, 0);
    answered("C\rS8\r\rO\rO\r", "\r\r\r\r\r");
    TEST_ASSERT_TRUE(s.open);
    answered("\r", "\r");
}

static void test_closed_channel_receives_no_frames_and_sends_none(void)
{
    char out[SLCAN_FRAME];
    const struct can_frame frame = {.id = 1};
    answered("C\r", "\r");
    answered("t0010\r", "\a");
    TEST_ASSERT_EQUAL_UINT(0, frame_count);
    TEST_ASSERT_EQUAL_UINT(0, slcan_format(&s, &frame, 0, out));
}

static void test_listen_only_sends_frames_and_receives_none(void)
{
    char out[SLCAN_FRAME];
    const struct can_frame frame = {.id = 1};
    answered("L\r", "\r");
    answered("t0010\r", "\a");
    TEST_ASSERT_EQUAL_UINT(6, slcan_format(&s, &frame, 0, out));
    answered("O\rt0010\r", "\r");
    TEST_ASSERT_EQUAL_UINT(1, frame_count);
}

static void test_bit_rates_are_accepted_when_closed(void)
{
    answered("S8\rs1234\r", "\a\a");
    type("C\r");
    answered("S0\rS8\rs1C4a\r", "\r\r\r");
    answered("S9\rS/\rS\rS88\rs123\rs12G4\r", "\a\a\a\a\a\a");
}

static void test_version_serial_and_acceptance_filter(void)
{
    answered("V\r", "V1010\r");
    answered("N\r", "N12AB\r");
    answered("M00000000\rmFFFFFFFF\r", "\r\r");
    answered("M0000000\rmFFFFFFFG\rV1\rN1\r", "\a\a\a\a");
}

static void test_flags_are_reported_once(void)
{
    s.flags = SLCAN_OVERRUN | SLCAN_BUS_ERROR;
    answered("F0\r", "\a");
    answered("F\r", "F88\r");
    answered("F\r", "F00\r");
}

static void test_unknown_commands_change_nothing(void)
{
    answered("X\r o\rO1\rC1\rL1\rz\rA\rQ1\r", "\a\a\a\a\a\a\a\a");
    TEST_ASSERT_TRUE(s.open);
    TEST_ASSERT_FALSE(s.listen_only);
}

static void test_frame_sent_is_the_line_that_is_parsed_back(void)
{
    const struct can_frame frame = {.id = 0x5A1, .len = 8, .data = {0, 1, 0x7F, 0x80, 0xFF, 0xA5, 0x5A, 0x10}};
    char out[SLCAN_FRAME + 1];
    const unsigned count = slcan_format(&s, &frame, 59999, out);
    out[count] = '\0';
    TEST_ASSERT_EQUAL_STRING("t5A1800017F80FFA55A10\r", out);
    type(out);
    TEST_ASSERT_EQUAL_UINT(1, frame_count);
    TEST_ASSERT_EQUAL_MEMORY(frame.data, frames[0].data, 8);
    const struct can_frame remote = {.id = 0x701, .len = 1, .rtr = true};
    out[slcan_format(&s, &remote, 0, out)] = '\0';
    TEST_ASSERT_EQUAL_STRING("r7011\r", out);
}

static void test_stamps_are_milliseconds_of_a_minute(void)
{
    const struct can_frame frame = {.id = 0x181, .len = 8, .data = {1, 2, 3, 4, 5, 6, 7, 8}};
    char out[SLCAN_FRAME + 1];
    answered("Z2\rZ\rZ1\r", "\a\a\r");
    TEST_ASSERT_EQUAL_UINT(SLCAN_FRAME, slcan_format(&s, &frame, 59999, out));
    out[SLCAN_FRAME] = '\0';
    TEST_ASSERT_EQUAL_STRING("t18180102030405060708EA5F\r", out);
    TEST_ASSERT_EQUAL_UINT(SLCAN_FRAME, slcan_format(&s, &frame, 60001, out));
    TEST_ASSERT_EQUAL_STRING("t181801020304050607080001\r", out);
    answered("Z0\r", "\r");
    TEST_ASSERT_EQUAL_UINT(SLCAN_FRAME - 4, slcan_format(&s, &frame, 0, out));
}

static void test_overlong_line_is_refused_once(void)
{
    for (unsigned i = 0; i < 1000; i++) {
        type("t00101");
        TEST_ASSERT_EQUAL_STRING("", answers);
    }
    answered("\r", "\a");
    TEST_ASSERT_EQUAL_UINT(0, frame_count);
    answered("t0010\r", "");
    TEST_ASSERT_EQUAL_UINT(1, frame_count);
}

/* Every line gets one answer or is a valid frame, and the next good line is understood. */
static void test_random_bytes_are_survived(void)
{
    static const char *const lines[] = {"t1232A5B4\r",  "r7011\r", "O\r", "C\r", "L\r",
                                        "T000001230\r", "Z1\r",    "F\r", "\r\n"};
    uint32_t seed = 12345;
    unsigned received = 0;
    const char *at = "";
    for (unsigned i = 0; i < 2000000; i++) {
        seed = seed * 1664525u + 1013904223u;
        if (*at == '\0') {
            at = lines[(seed >> 16) % (sizeof lines / sizeof *lines)];
        }
        const bool hit = (seed >> 12) % 16 == 0;
        const char byte = hit ? (char)(seed >> 24) : *at;
        at++;
        struct can_frame frame;
        struct slcan_answer answer;
        const enum slcan_event event = slcan_parse(&s, byte, &frame, &answer);
        TEST_ASSERT_LESS_OR_EQUAL(SLCAN_ANSWER, answer.count);
        TEST_ASSERT_LESS_OR_EQUAL(SLCAN_LINE + 1, s.count);
        TEST_ASSERT_TRUE(byte == '\r' || byte == '\n' ? answer.count == 0 || event != SLCAN_HAS_FRAME
                                                      : answer.count == 0);
        if (event == SLCAN_HAS_FRAME) {
            TEST_ASSERT_TRUE(frame.id <= 0x7FF && frame.len <= 8);
            received++;
        }
    }
    TEST_ASSERT_GREATER_THAN(0, received);
    type("\rO\r");
    answered("t1230\n", "");
    TEST_ASSERT_EQUAL_UINT(1, frame_count);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_data_frame_is_received_and_not_answered);
    RUN_TEST(test_frames_of_every_length_back_to_back);
    RUN_TEST(test_lines_end_in_cr_lf_or_both);
    RUN_TEST(test_frames_that_classic_canopen_does_not_have_are_ignored_as_on_a_bus);
    RUN_TEST(test_remote_frame_has_a_length_and_no_data);
    RUN_TEST(test_bad_frames_are_refused_and_counted);
    RUN_TEST(test_what_python_can_sends_on_opening_is_accepted);
    RUN_TEST(test_closed_channel_receives_no_frames_and_sends_none);
    RUN_TEST(test_listen_only_sends_frames_and_receives_none);
    RUN_TEST(test_bit_rates_are_accepted_when_closed);
    RUN_TEST(test_version_serial_and_acceptance_filter);
    RUN_TEST(test_flags_are_reported_once);
    RUN_TEST(test_unknown_commands_change_nothing);
    RUN_TEST(test_frame_sent_is_the_line_that_is_parsed_back);
    RUN_TEST(test_stamps_are_milliseconds_of_a_minute);
    RUN_TEST(test_overlong_line_is_refused_once);
    RUN_TEST(test_random_bytes_are_survived);
    return UNITY_END();
}
