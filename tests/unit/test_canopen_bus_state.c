/* SPDX-License-Identifier: Apache-2.0 */
/* What the CAN controller reports of its bus: object 2032h, EMCY, error register. */
#include "supervision/fault_gen.h"
#include "test_canopen_bus.h"

static struct bus bus;
static struct hal_can_status controller;

static void can_status(void *ctx, struct hal_can_status *status)
{
    (void)ctx;
    *status = controller;
}

void setUp(void)
{
    controller = (struct hal_can_status){0};
    bus_start(&bus);
    bus.hal.can_status = can_status;
    bus_clear(&bus);
}

void tearDown(void)
{
}

static void ms(unsigned n)
{
    while (n-- > 0) {
        co_tick_ms(&bus.node);
    }
}

/* EMCY messages with this code since the last bus_clear() */
static unsigned reported(uint16_t code)
{
    unsigned n = 0;
    for (unsigned i = 0; i < bus.count; i++) {
        const struct can_frame *f = &bus.sent[i];
        n += f->id == 0x80 + NODE && (f->data[0] | f->data[1] << 8) == code ? 1u : 0u;
    }
    return n;
}

static void test_a_bus_that_is_well_is_no_error(void)
{
    controller.state = HAL_CAN_WARNING;
    controller.tx_errors = 100;
    ms(10);
    TEST_ASSERT_EQUAL_UINT8(1, bus.od.can.state);
    TEST_ASSERT_EQUAL_UINT8(100, bus.od.can.tx_errors);
    TEST_ASSERT_EQUAL_HEX8(0, bus.od.error_register);
}

static void test_nobody_acknowledges_is_reported_once_and_ends(void)
{
    controller.state = HAL_CAN_PASSIVE;
    controller.tx_errors = 128;
    ms(100);
    TEST_ASSERT_EQUAL_HEX8(0x11, bus.od.error_register);
    TEST_ASSERT_EQUAL_HEX16(0x8120, bus.od.error_history[0] & 0xFFFF);
    TEST_ASSERT_EQUAL_UINT8(128, bus.od.error_history[0] >> 16);
    TEST_ASSERT_EQUAL_UINT(1, reported(0x8120));
    controller.state = HAL_CAN_ACTIVE;
    ms(1);
    TEST_ASSERT_EQUAL_HEX8(0, bus.od.error_register);
    TEST_ASSERT_EQUAL_UINT(1, reported(0));
}

static void test_bus_off_is_reported_when_it_is_over(void)
{
    controller.state = HAL_CAN_OFF;
    controller.bus_offs = 1;
    ms(10);
    TEST_ASSERT_EQUAL_UINT(0, reported(0x8140));
    TEST_ASSERT_EQUAL_HEX8(0x11, bus.od.error_register);
    controller.state = HAL_CAN_ACTIVE;
    ms(1);
    TEST_ASSERT_EQUAL_UINT(1, reported(0x8140));
    TEST_ASSERT_EQUAL_UINT32(1, bus.od.can.bus_offs);
    ms(1);
    TEST_ASSERT_EQUAL_HEX8(0, bus.od.error_register);
    ms(1000);
    TEST_ASSERT_EQUAL_UINT(1, reported(0x8140));
}

static void test_lost_frames_are_reported_until_a_second_has_gone_without_one(void)
{
    controller.rx_lost = 3;
    ms(1);
    TEST_ASSERT_EQUAL_UINT(1, reported(0x8110));
    ms(500);
    controller.rx_lost = 4;
    ms(1000);
    TEST_ASSERT_EQUAL_UINT(1, reported(0x8110));
    TEST_ASSERT_EQUAL_HEX8(0x11, bus.od.error_register);
    ms(1);
    TEST_ASSERT_EQUAL_HEX8(0, bus.od.error_register);
    TEST_ASSERT_EQUAL_UINT32(4, bus.od.can.rx_lost);
}

static void test_both_error_counters_are_shown_and_reported(void)
{
    controller.state = HAL_CAN_PASSIVE;
    controller.tx_errors = 17;
    controller.rx_errors = 129;
    ms(1);
    TEST_ASSERT_EQUAL_UINT8(17, bus.od.can.tx_errors);
    TEST_ASSERT_EQUAL_UINT8(129, bus.od.can.rx_errors);
    bus_expect(&bus, 0, 0x085, "20 81 11 11 81 00 00 00");
}

static void test_a_bus_nobody_listens_on_is_reported_once_also_with_every_fault_of_the_drive_in_effect(void)
{
    for (uint16_t i = 0; i < FAULTS; i++) {
        co_emcy_set(&bus.node, (uint16_t)(0xFF00 + i), 0, 0);
    }
    controller.state = HAL_CAN_PASSIVE;
    ms(100);
    TEST_ASSERT_EQUAL_UINT(1, reported(0x8120));
    TEST_ASSERT_EQUAL_HEX8(0x11, bus.od.error_register);
    controller.state = HAL_CAN_ACTIVE;
    ms(1);
    TEST_ASSERT_EQUAL_HEX8(0x01, bus.od.error_register);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_a_bus_that_is_well_is_no_error);
    RUN_TEST(test_nobody_acknowledges_is_reported_once_and_ends);
    RUN_TEST(test_bus_off_is_reported_when_it_is_over);
    RUN_TEST(test_lost_frames_are_reported_until_a_second_has_gone_without_one);
    RUN_TEST(test_both_error_counters_are_shown_and_reported);
    RUN_TEST(test_a_bus_nobody_listens_on_is_reported_once_also_with_every_fault_of_the_drive_in_effect);
    return UNITY_END();
}
