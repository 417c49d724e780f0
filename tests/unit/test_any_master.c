/* SPDX-License-Identifier: Apache-2.0 */
/* What any master may send, which knows nothing of this drive: the whole firmware on a simulated machine. */
#include <string.h>

#include "test_device.h"

enum { CONFIG_ENABLED = 0xFF18, MEMORY = 0x5510 };

static struct can_frame lss_answer;

static bool keep_lss(void *ctx, const struct can_frame *frame)
{
    if (frame->id == 0x7E4) {
        lss_answer = *frame;
    }
    return rig_can_send(ctx, frame);
}

/* ---- LSS writes 2001h, over which there is a checksum ---- */

/* A request of LSS, and the first bytes of its answer: command, error, specific error */
static void lss(uint8_t command, uint8_t a, uint8_t b, const uint8_t answer[3])
{
    const uint8_t data[8] = {command, a, b};
    rig.hal.can_send = keep_lss;
    lss_answer = (struct can_frame){0};
    rig_send(&rig, 0x7E5, 8, data);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(answer, lss_answer.data, 3);
}

static const uint8_t no_answer[3];

static void test_lss_configuration_without_power_is_no_memory_fault(void)
{
    rig_nmt(&rig, 1);
    lss(0x04, 1, 0, no_answer);
    lss(0x11, 9, 0, (const uint8_t[]){0x11, 0, 0});
    rig_ms(&rig, 100);
    lss(0x13, 0, 2, (const uint8_t[]){0x13, 0, 0});
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    TEST_ASSERT_EQUAL_UINT32(9, rig_read(&rig, 0x2001, 1));
    TEST_ASSERT_EQUAL_UINT32(500, rig_read(&rig, 0x2001, 2));
    rig_enable(&rig);
}

static void test_lss_configuration_is_refused_while_an_axis_has_power(void)
{
    static const uint8_t refused[] = {0x11, 0xFF, 1}, refused_rate[] = {0x13, 0xFF, 1};
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2001, 2, 2, 500));
    rig_enable(&rig);
    rig_go(&rig, &stream, 300);
    lss(0x04, 1, 0, no_answer);
    lss(0x11, 9, 0, refused);
    lss(0x13, 0, 4, refused_rate);
    lss(0x15, 10, 0, no_answer); /* activate bit timing */
    const unsigned told = rig.status_count;
    rig_ms(&rig, 100);
    TEST_ASSERT_TRUE_MESSAGE(rig.status_count > told, "it is silent");
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2001, 1));
    TEST_ASSERT_EQUAL_UINT32(500, rig_read(&rig, 0x2001, 2));
    TEST_ASSERT_EQUAL_UINT(1000, rig.bitrate);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, CONFIG_ENABLED));
    TEST_ASSERT_FALSE(rig_had_emcy(&rig, MEMORY));
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_EQUAL_UINT32(RUNNING, stream_state());
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_lss_configuration_without_power_is_no_memory_fault);
    RUN_TEST(test_lss_configuration_is_refused_while_an_axis_has_power);
    return UNITY_END();
}
