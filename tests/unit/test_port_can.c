/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_can.c: the driver of bxCAN: bit timing, both directions, and a bus on which nobody acknowledges. */
#include "chip.h"
#include "port/stm32f405/can.h"
#include "unity.h"

enum { MAILBOXES_EMPTY = 7 * CAN_TSR_TME0 };

void setUp(void)
{
    chip_reset();
    can_init(1000);
    chip.can1.MSR = 0; /* eleven recessive bits have come */
    chip.can1.TSR = MAILBOXES_EMPTY;
    chip.nvic.ISPR[0] = 0;
}

void tearDown(void)
{
}

static const struct can_frame frame = {.id = 0x181, .len = 8, .data = {1, 2, 3, 4, 5, 6, 7, 8}};

/* Do what the controller does: a mailbox with TXRQ is no longer empty. */
static void accept_requests(void)
{
    chip.can1.TSR = MAILBOXES_EMPTY;
    for (unsigned i = 0; i < 3; i++) {
        if ((chip.can1.TX[i].IR & CAN_IR_TXRQ) != 0) {
            chip.can1.TSR &= ~((uint32_t)CAN_TSR_TME0 << i);
        }
    }
}

static void test_bit_timing_has_the_rate_and_a_sample_point_of_cia_301(void)
{
    static const uint16_t rates[] = {1000, 500, 250, 125};
    for (unsigned i = 0; i < 4; i++) {
        TEST_ASSERT_TRUE(can_bitrate(rates[i], true));
        const uint32_t btr = chip.can1.BTR;
        const uint32_t prescaler = (btr & 1023u) + 1u, segment1 = (btr >> CAN_BTR_TS1 & 15u) + 1u,
                       segment2 = (btr >> CAN_BTR_TS2 & 7u) + 1u;
        const uint32_t quanta = 1u + segment1 + segment2;
        TEST_ASSERT_EQUAL_UINT32(42000, rates[i] * prescaler * quanta);
        TEST_ASSERT_UINT32_WITHIN(20, 875, 1000u * (1u + segment1) / quanta);
        TEST_ASSERT_EQUAL_UINT32(0, btr >> 30); /* neither silent nor loop-back */
    }
    TEST_ASSERT_FALSE(can_bitrate(800, false));
    TEST_ASSERT_FALSE(can_bitrate(0, true));
}

static void test_a_frame_sent_is_in_a_mailbox_bit_by_bit(void)
{
    TEST_ASSERT_TRUE(can_send(&frame));
    TEST_ASSERT_EQUAL_HEX32(1u << IRQ_CAN1_TX, chip.nvic.ISPR[0]);
    can_tx_irq();
    TEST_ASSERT_EQUAL_HEX32(0x181u << 21 | 1u, chip.can1.TX[0].IR);
    TEST_ASSERT_EQUAL_HEX32(8, chip.can1.TX[0].DTR);
    TEST_ASSERT_EQUAL_HEX32(0x04030201, chip.can1.TX[0].DLR);
    TEST_ASSERT_EQUAL_HEX32(0x08070605, chip.can1.TX[0].DHR);
}

static void test_a_frame_in_the_fifo_is_received(void)
{
    struct can_frame got;
    chip.can1.RX[0] = (struct can_mailbox){.IR = 0x201u << 21, .DTR = 4, .DLR = 0x44332211};
    chip.can1.RF0R = 1;
    can_rx_irq();
    TEST_ASSERT_TRUE(can_receive(&got));
    TEST_ASSERT_EQUAL_HEX16(0x201, got.id);
    TEST_ASSERT_EQUAL_UINT8(4, got.len);
    TEST_ASSERT_FALSE(got.rtr);
    TEST_ASSERT_EQUAL_HEX8(0x11, got.data[0]);
    TEST_ASSERT_EQUAL_HEX8(0x44, got.data[3]);
}

static void test_a_remote_frame_is_sent_and_received_as_one(void)
{
    const struct can_frame remote = {.id = 0x701, .len = 1, .rtr = true};
    struct can_frame got;
    TEST_ASSERT_TRUE(can_send(&remote));
    can_tx_irq();
    TEST_ASSERT_EQUAL_HEX32(0x701u << 21 | CAN_IR_RTR | CAN_IR_TXRQ, chip.can1.TX[0].IR);
    chip.can1.RX[0] = (struct can_mailbox){.IR = 0x701u << 21 | CAN_IR_RTR, .DTR = 15}; /* a length above 8 means 8 */
    chip.can1.RF0R = 1;
    can_rx_irq();
    TEST_ASSERT_TRUE(can_receive(&got));
    TEST_ASSERT_TRUE(got.rtr);
    TEST_ASSERT_EQUAL_UINT8(8, got.len);
}

static void test_the_filter_lets_data_frames_of_11_bits_pass_only(void)
{
    TEST_ASSERT_EQUAL_HEX32(1, chip.can1.FA1R);
    TEST_ASSERT_EQUAL_HEX32(0, chip.can1.FR[0][0]);
    TEST_ASSERT_EQUAL_HEX32(CAN_IR_IDE | CAN_IR_RTR, chip.can1.FR[0][1]);
    TEST_ASSERT_EQUAL_HEX32(0, chip.can1.FMR & CAN_FMR_FINIT);
}

static void test_nobody_acknowledges_the_queue_fills_and_no_call_blocks(void)
{
    struct hal_can_status status;
    unsigned sent = 0;
    chip_waited = 0;
    while (sent < 1000 && can_send(&frame)) {
        sent++;
        can_tx_irq();
        accept_requests(); /* no mailbox becomes free again */
    }
    TEST_ASSERT_EQUAL_UINT(3 + 32, sent);
    TEST_ASSERT_FALSE(can_send(&frame));
    TEST_ASSERT_EQUAL_UINT(0, chip_waited);

    /* ISO 11898-1: without an acknowledgement the transmit error counter stops at 128, error passive. */
    chip.can1.ESR = 128u << CAN_ESR_TEC | CAN_ESR_EPVF | CAN_ESR_EWGF;
    can_error_irq();
    can_status(&status);
    TEST_ASSERT_EQUAL(HAL_CAN_PASSIVE, status.state);
    TEST_ASSERT_EQUAL_UINT8(128, status.tx_errors);
}

/* The controller sets BOFF with an interrupt, and clears it without one. */
static void bus_off(void)
{
    chip.can1.ESR = CAN_ESR_BOFF | CAN_ESR_EPVF | CAN_ESR_EWGF | 248u << CAN_ESR_TEC;
    chip.can1.MSR = CAN_MSR_ERRI;
    can_error_irq();
}

static void bus_on(void)
{
    chip.can1.ESR = 0;
    chip.can1.TSR = MAILBOXES_EMPTY;
    can_tx_irq();
}

static void test_each_bus_off_is_counted_drops_pending_frames_and_ends(void)
{
    struct hal_can_status status;
    can_status(&status);
    const uint32_t before = status.bus_offs;
    TEST_ASSERT_TRUE((chip.can1.MCR & CAN_MCR_ABOM) != 0);
    for (uint32_t n = 1; n <= 3; n++) {
        can_send(&frame);
        bus_off();
        can_status(&status);
        TEST_ASSERT_EQUAL(HAL_CAN_OFF, status.state);
        TEST_ASSERT_EQUAL_UINT32(before + n, status.bus_offs);
        TEST_ASSERT_EQUAL_HEX32(CAN_TSR_ABRQ0 | CAN_TSR_ABRQ1 | CAN_TSR_ABRQ2, chip.can1.TSR);
        TEST_ASSERT_EQUAL_HEX32(0, chip.can1.MSR & CAN_MSR_ERRI);

        bus_on();
        TEST_ASSERT_EQUAL_HEX32(0, chip.can1.TX[0].IR); /* no old frame is sent */
        can_status(&status);
        TEST_ASSERT_EQUAL(HAL_CAN_ACTIVE, status.state);
    }
}

static void test_frames_to_send_while_the_bus_is_off_are_not_sent_later(void)
{
    bus_off();
    for (unsigned i = 0; i < 100; i++) {
        chip.can1.TSR = MAILBOXES_EMPTY;
        TEST_ASSERT_TRUE(can_send(&frame));
        can_tx_irq();
    }
    bus_on();
    TEST_ASSERT_EQUAL_HEX32(0, chip.can1.TX[0].IR);
    TEST_ASSERT_TRUE(can_send(&frame));
    can_tx_irq();
    TEST_ASSERT_EQUAL_HEX32(0x181u << 21 | 1u, chip.can1.TX[0].IR);
}

static void test_frames_without_room_are_counted(void)
{
    struct hal_can_status status;
    uint32_t before;
    can_status(&status);
    before = status.rx_lost;
    chip.can1.RF0R = 1;
    for (int i = 0; i < 100; i++) {
        chip.can1.RF0R = 3;
        can_rx_irq();
    }
    can_status(&status);
    TEST_ASSERT_GREATER_THAN_UINT32(before, status.rx_lost);
}

static void test_frames_that_the_controller_had_no_room_for_are_counted(void)
{
    struct hal_can_status before, after;
    can_status(&before);
    chip.can1.RF0R = CAN_RF0R_FOVR;
    can_rx_irq();
    can_status(&after);
    TEST_ASSERT_EQUAL_UINT32(before.rx_lost + 1u, after.rx_lost);
    TEST_ASSERT_EQUAL_HEX32(0, chip.can1.RF0R & CAN_RF0R_FOVR);
}

static bool released;
static bool when_released(const reg *r, uint32_t mask, uint32_t value)
{
    (void)mask, (void)value;
    return r != &chip.can1.RF0R || released;
}

/* Before the mailbox is released (RFOM), it still holds the frame that was read. */
static void test_a_frame_is_not_received_again_while_its_mailbox_is_being_released(void)
{
    struct can_frame got;
    while (can_receive(&got)) {
    }
    chip_waits = when_released;
    released = false;
    chip.can1.RF0R = 1u | CAN_RF0R_RFOM;
    can_rx_irq();
    TEST_ASSERT_FALSE(can_receive(&got));
    released = true;
    can_rx_irq();
    TEST_ASSERT_TRUE(can_receive(&got));
    TEST_ASSERT_FALSE(can_receive(&got));
}

static bool never(const reg *r, uint32_t mask, uint32_t value)
{
    (void)r, (void)mask, (void)value;
    return false;
}

static void test_a_controller_that_does_not_answer_is_off_and_drops_frames(void)
{
    struct hal_can_status status;
    chip_waits = never;
    TEST_ASSERT_FALSE(can_init(1000));
    TEST_ASSERT_TRUE(can_send(&frame));
    can_status(&status);
    TEST_ASSERT_EQUAL(HAL_CAN_OFF, status.state);
}

/* QEMU has no bxCAN; there the drive uses the serial port. */
static void test_an_emulator_without_a_controller_is_not_off(void)
{
    struct hal_can_status status;
    chip_waits = never;
    TEST_ASSERT_FALSE(can_init(1000));
    chip.can1 = (struct can){0};
    chip_emulate();
    can_status(&status);
    TEST_ASSERT_EQUAL(HAL_CAN_ACTIVE, status.state);
}

static void test_a_bit_rate_is_changed_when_it_is_requested_and_possible(void)
{
    const uint32_t before = chip.can1.BTR;
    chip.can1.TSR = 0;
    TEST_ASSERT_TRUE(can_bitrate(125, false));
    TEST_ASSERT_EQUAL_HEX32(before, chip.can1.BTR);
    TEST_ASSERT_EQUAL_HEX32(0, chip.can1.TSR); /* no pending frame is dropped */
    TEST_ASSERT_TRUE(can_bitrate(125, true));
    TEST_ASSERT_NOT_EQUAL_HEX32(before, chip.can1.BTR);
    TEST_ASSERT_FALSE(can_init(800));
    TEST_ASSERT_TRUE(can_send(&frame)); /* dropped */
}

static void test_a_controller_that_comes_to_life_with_another_bit_rate_works(void)
{
    struct can_frame got;
    chip_waits = never;
    TEST_ASSERT_FALSE(can_init(1000));
    setUp();
    chip.can1.FA1R = 0;
    chip.can1.IER = 0;
    TEST_ASSERT_TRUE(can_bitrate(500, true));
    TEST_ASSERT_EQUAL_HEX32(1, chip.can1.FA1R); /* the filter is active */
    TEST_ASSERT_TRUE((chip.can1.IER & CAN_IER_FMPIE0) != 0);
    TEST_ASSERT_FALSE(can_receive(&got));
}

static void test_a_bus_held_dominant_is_off(void)
{
    struct hal_can_status status;
    chip.can1.MSR = CAN_MSR_INAK; /* eleven recessive bits have not come */
    can_status(&status);
    TEST_ASSERT_EQUAL(HAL_CAN_OFF, status.state);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_bit_timing_has_the_rate_and_a_sample_point_of_cia_301);
    RUN_TEST(test_a_frame_sent_is_in_a_mailbox_bit_by_bit);
    RUN_TEST(test_a_frame_in_the_fifo_is_received);
    RUN_TEST(test_a_remote_frame_is_sent_and_received_as_one);
    RUN_TEST(test_the_filter_lets_data_frames_of_11_bits_pass_only);
    RUN_TEST(test_nobody_acknowledges_the_queue_fills_and_no_call_blocks);
    RUN_TEST(test_each_bus_off_is_counted_drops_pending_frames_and_ends);
    RUN_TEST(test_frames_to_send_while_the_bus_is_off_are_not_sent_later);
    RUN_TEST(test_a_frame_is_not_received_again_while_its_mailbox_is_being_released);
    RUN_TEST(test_frames_without_room_are_counted);
    RUN_TEST(test_frames_that_the_controller_had_no_room_for_are_counted);
    RUN_TEST(test_a_controller_that_does_not_answer_is_off_and_drops_frames);
    RUN_TEST(test_an_emulator_without_a_controller_is_not_off);
    RUN_TEST(test_a_bit_rate_is_changed_when_it_is_requested_and_possible);
    RUN_TEST(test_a_controller_that_comes_to_life_with_another_bit_rate_works);
    RUN_TEST(test_a_bus_held_dominant_is_off);
    return UNITY_END();
}
