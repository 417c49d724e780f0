/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_bus.c: the bus of the STM32F405, which is slcan
 * on the serial port while its channel is open, and else CAN. */
#include <string.h>

#include "chip.h"
#include "port/stm32f405/bus.h"
#include "port/stm32f405/can.h"
#include "port/stm32f405/uart.h"
#include "unity.h"

enum { MAILBOXES_EMPTY = 7 * CAN_TSR_TME0, RING = 1024 };

static char line[4 * RING];
static struct can_frame got;
static const struct can_frame frame = {.id = 0x181, .len = 2, .data = {0xAB, 0xCD}};

void setUp(void)
{
    chip_reset();
    bus_init();
    can_init(1000);
    chip.can1.MSR = 0;
    chip.can1.TSR = MAILBOXES_EMPTY;
    while (bus_receive(&got)) {
    }
}

/* Returns the text that the port sends, byte by byte, in its interrupts. */
static const char *sent(void)
{
    unsigned n = 0;
    while ((chip.usart1.CR1 & USART_CR1_TXEIE) != 0 && n < sizeof line - 1) {
        chip.usart1.SR = USART_SR_TXE;
        uart_irq();
        if ((chip.usart1.CR1 & USART_CR1_TXEIE) != 0) {
            line[n++] = (char)chip.usart1.DR;
        }
    }
    line[n] = '\0';
    return line;
}

void tearDown(void)
{
    (void)sent();
}

static void type(const char *text)
{
    for (; *text != '\0'; text++) {
        chip.usart1.SR = USART_SR_RXNE;
        chip.usart1.DR = (uint8_t)*text;
        uart_irq();
    }
    chip.usart1.SR = 0;
}

static void can_frame_comes(uint16_t id)
{
    chip.can1.RX[0] = (struct can_mailbox){.IR = (uint32_t)id << CAN_IR_STID, .DTR = 1};
    chip.can1.RF0R = 1;
    can_rx_irq();
}

static void open_channel(void)
{
    type("O\r");
    TEST_ASSERT_FALSE(bus_receive(&got));
    TEST_ASSERT_EQUAL_STRING("\r", sent());
}

static void test_the_bus_is_can_until_the_serial_channel_is_opened(void)
{
    can_frame_comes(0x201);
    TEST_ASSERT_TRUE(bus_receive(&got));
    TEST_ASSERT_EQUAL_HEX16(0x201, got.id);
    TEST_ASSERT_FALSE(bus_receive(&got));
    TEST_ASSERT_TRUE(bus_send(&frame));
    can_tx_irq();
    TEST_ASSERT_EQUAL_HEX32((uint32_t)frame.id << CAN_IR_STID | CAN_IR_TXRQ, chip.can1.TX[0].IR);
    TEST_ASSERT_EQUAL_STRING("", sent());
    type("t2012AABB\r");
    TEST_ASSERT_FALSE(bus_receive(&got)); /* the channel is closed */
    TEST_ASSERT_EQUAL_STRING("\a", sent());
}

static void test_open_serial_channel_is_the_only_bus(void)
{
    open_channel();
    can_frame_comes(0x201);
    TEST_ASSERT_FALSE(bus_receive(&got));
    type("t2022AABB\rt2031CC\r");
    TEST_ASSERT_TRUE(bus_receive(&got));
    TEST_ASSERT_EQUAL_HEX16(0x202, got.id);
    TEST_ASSERT_EQUAL_HEX8(0xBB, got.data[1]);
    TEST_ASSERT_TRUE(bus_receive(&got));
    TEST_ASSERT_EQUAL_HEX16(0x203, got.id);
    TEST_ASSERT_FALSE(bus_receive(&got));
    TEST_ASSERT_TRUE(bus_send(&frame));
    TEST_ASSERT_EQUAL_STRING("t1812ABCD\r", sent());
    can_tx_irq();
    TEST_ASSERT_EQUAL_HEX32(0, chip.can1.TX[0].IR);
}

static void test_frames_of_can_that_came_while_the_channel_was_open_are_dropped(void)
{
    open_channel();
    can_frame_comes(0x201);
    can_frame_comes(0x202);
    while (bus_receive(&got)) {
    }
    (void)bus_receive(&got);
    type("C\r");
    TEST_ASSERT_FALSE(bus_receive(&got));
    can_frame_comes(0x203);
    TEST_ASSERT_TRUE(bus_receive(&got));
    TEST_ASSERT_EQUAL_HEX16(0x203, got.id);
}

static void test_open_channel_is_an_active_bus_whatever_the_can_controller_says(void)
{
    struct hal_can_status status;
    chip.can1.ESR = 128u << CAN_ESR_TEC | CAN_ESR_EPVF;
    bus_status(&status);
    TEST_ASSERT_EQUAL(HAL_CAN_PASSIVE, status.state);
    open_channel();
    bus_status(&status);
    TEST_ASSERT_EQUAL(HAL_CAN_ACTIVE, status.state);
    TEST_ASSERT_EQUAL_UINT8(0, status.tx_errors);
    const uint32_t before = status.rx_lost;
    type("t20\r"); /* an incomplete line */
    TEST_ASSERT_FALSE(bus_receive(&got));
    bus_status(&status);
    TEST_ASSERT_EQUAL_UINT32(before + 1u, status.rx_lost);
}

static void test_bytes_that_come_too_fast_are_counted_and_the_line_goes_on(void)
{
    const uint32_t before = uart_lost();
    chip.usart1.SR = USART_SR_RXNE | USART_SR_ORE; /* a byte was overwritten in the data register by this one */
    chip.usart1.DR = 'O';
    uart_irq();
    TEST_ASSERT_EQUAL_UINT32(before + 1u, uart_lost());
    type("\r");
    TEST_ASSERT_FALSE(bus_receive(&got));
    TEST_ASSERT_EQUAL_STRING("\r", sent());
    for (unsigned i = 0; i < RING + 3; i++) { /* nobody reads them */
        type("x");
    }
    TEST_ASSERT_EQUAL_UINT32(before + 4u, uart_lost());
    TEST_ASSERT_FALSE(bus_receive(&got));
    type("\rt2010\r");
    TEST_ASSERT_TRUE(bus_receive(&got));
    TEST_ASSERT_EQUAL_HEX16(0x201, got.id);
}

static void test_frame_is_sent_completely_or_not_at_all_when_the_line_is_full(void)
{
    open_channel();
    unsigned frames = 0;
    while (frames < RING && bus_send(&frame)) {
        frames++;
    }
    TEST_ASSERT_EQUAL_UINT(RING / 10, frames); /* t1812ABCD and CR */
    const char *all = sent();
    TEST_ASSERT_EQUAL_UINT(10 * frames, strlen(all));
    TEST_ASSERT_EQUAL_STRING("t1812ABCD\r", &all[10 * (frames - 1)]);
    TEST_ASSERT_TRUE(bus_send(&frame));
}

static void test_interrupt_of_a_line_with_nothing_to_send_ends(void)
{
    chip.usart1.SR = USART_SR_TXE;
    chip.usart1.DR = 0x55;
    uart_irq(); /* as for a byte received, without a byte to send */
    TEST_ASSERT_EQUAL_HEX32(0x55, chip.usart1.DR);
    chip.usart1.CR1 |= USART_CR1_TXEIE;
    uart_irq();
    TEST_ASSERT_EQUAL_HEX32(0, chip.usart1.CR1 & USART_CR1_TXEIE);
    TEST_ASSERT_EQUAL_HEX32(0x55, chip.usart1.DR);
}

/* QEMU raises no interrupt for an empty transmitter. */
static void test_in_an_emulator_a_line_is_sent_at_once(void)
{
    open_channel();
    chip_emulate();
    TEST_ASSERT_TRUE(bus_send(&frame));
    TEST_ASSERT_EQUAL_HEX32('\r', chip.usart1.DR);
    TEST_ASSERT_EQUAL_HEX32(0, chip.usart1.CR1 & USART_CR1_TXEIE);
    for (unsigned i = 0; i < RING; i++) { /* the ring stays empty */
        TEST_ASSERT_TRUE(bus_send(&frame));
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_the_bus_is_can_until_the_serial_channel_is_opened);
    RUN_TEST(test_open_serial_channel_is_the_only_bus);
    RUN_TEST(test_frames_of_can_that_came_while_the_channel_was_open_are_dropped);
    RUN_TEST(test_open_channel_is_an_active_bus_whatever_the_can_controller_says);
    RUN_TEST(test_bytes_that_come_too_fast_are_counted_and_the_line_goes_on);
    RUN_TEST(test_frame_is_sent_completely_or_not_at_all_when_the_line_is_full);
    RUN_TEST(test_interrupt_of_a_line_with_nothing_to_send_ends);
    RUN_TEST(test_in_an_emulator_a_line_is_sent_at_once);
    return UNITY_END();
}
