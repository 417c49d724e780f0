/* SPDX-License-Identifier: Apache-2.0 */
/* test_can_errors.c: the state of a CAN controller from SocketCAN's error frames. */
#include <linux/can/error.h>

#include "port/linux/can_errors.h"
#include "unity.h"

enum { COUNTERS = 0x200 }; /* CAN_ERR_CNT, which older headers lack */

static struct ks_can_status status;

static bool apply(canid_t what, uint8_t control, uint8_t tx, uint8_t rx)
{
    const struct can_frame frame = {
        .can_id = CAN_ERR_FLAG | what, .can_dlc = 8, .data = {0, control, 0, 0, 0, 0, tx, rx}};
    return can_errors_apply(&frame, &status);
}

void setUp(void)
{
    status = (struct ks_can_status){0};
}

void tearDown(void)
{
}

static void test_warning_passive_and_active_again(void)
{
    TEST_ASSERT_TRUE(apply(CAN_ERR_CRTL, CAN_ERR_CRTL_TX_WARNING, 0, 0));
    TEST_ASSERT_EQUAL_UINT32(KS_CAN_WARNING, status.state);
    TEST_ASSERT_TRUE(apply(CAN_ERR_CRTL | COUNTERS, CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_RX_PASSIVE, 12, 130));
    TEST_ASSERT_EQUAL_UINT32(KS_CAN_PASSIVE, status.state);
    TEST_ASSERT_EQUAL_UINT32(12, status.tx_errors);
    TEST_ASSERT_EQUAL_UINT32(130, status.rx_errors);
    TEST_ASSERT_TRUE(apply(CAN_ERR_CRTL, CAN_ERR_CRTL_ACTIVE, 0, 0));
    TEST_ASSERT_EQUAL_UINT32(KS_CAN_ACTIVE, status.state);
    TEST_ASSERT_EQUAL_UINT32(130, status.rx_errors); /* a frame without counters leaves them */
}

static void test_bus_off_is_counted_once_until_the_restart(void)
{
    TEST_ASSERT_TRUE(apply(CAN_ERR_BUSOFF, 0, 0, 0));
    TEST_ASSERT_FALSE(apply(CAN_ERR_BUSOFF, 0, 0, 0));
    TEST_ASSERT_EQUAL_UINT32(KS_CAN_OFF, status.state);
    TEST_ASSERT_EQUAL_UINT32(1, status.bus_offs);
    TEST_ASSERT_TRUE(apply(CAN_ERR_RESTARTED, 0, 0, 0));
    TEST_ASSERT_EQUAL_UINT32(KS_CAN_ACTIVE, status.state);
    TEST_ASSERT_TRUE(apply(CAN_ERR_BUSOFF, 0, 0, 0));
    TEST_ASSERT_EQUAL_UINT32(2, status.bus_offs);
}

static void test_overflow_of_the_controller_counts_as_lost(void)
{
    TEST_ASSERT_TRUE(apply(CAN_ERR_CRTL, CAN_ERR_CRTL_RX_OVERFLOW, 0, 0));
    TEST_ASSERT_EQUAL_UINT32(1, status.rx_lost);
    TEST_ASSERT_EQUAL_UINT32(KS_CAN_ACTIVE, status.state);
}

static void test_errors_of_single_frames_change_nothing(void)
{
    TEST_ASSERT_FALSE(apply(CAN_ERR_PROT | CAN_ERR_ACK | CAN_ERR_LOSTARB, CAN_ERR_CRTL_TX_PASSIVE, 255, 255));
    TEST_ASSERT_EQUAL_UINT32(KS_CAN_ACTIVE, status.state);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_warning_passive_and_active_again);
    RUN_TEST(test_bus_off_is_counted_once_until_the_restart);
    RUN_TEST(test_overflow_of_the_controller_counts_as_lost);
    RUN_TEST(test_errors_of_single_frames_change_nothing);
    return UNITY_END();
}
