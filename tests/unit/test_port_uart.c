/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_uart.c: the serial port of the STM32F405: bytes pass two rings, by interrupt on a chip, and at once in an
 * emulator, whose USART raises no interrupt for an empty data register.
 */
#include "chip.h"
#include "port/stm32f405/board.h"
#include "port/stm32f405/uart.h"
#include "unity.h"

enum { ROOM = 1024, NOTHING = 0x1FF };

static unsigned lost_before;

static bool sending(void)
{
    return (chip.usart1.CR1 & USART_CR1_TXEIE) != 0;
}

/* An interrupt with the data register empty. Returns the byte that it sends, or NOTHING. */
static unsigned send_one(void)
{
    chip.usart1.SR = USART_SR_TXE;
    chip.usart1.DR = NOTHING;
    uart_irq();
    return chip.usart1.DR;
}

static void receive(unsigned byte, uint32_t status)
{
    chip.usart1.SR = status;
    chip.usart1.DR = byte;
    uart_irq();
}

void setUp(void)
{
    chip_reset();
    uart_init();
    lost_before = uart_lost();
}

void tearDown(void)
{
    for (int i = 0; i < ROOM + 1; i++) { /* empty the ring of the driver */
        chip.usart1.CR1 |= USART_CR1_TXEIE;
        (void)send_one();
    }
}

static void test_line_is_set_up_for_a_megabaud_and_interrupts_for_what_comes(void)
{
    TEST_ASSERT_EQUAL_UINT32(84, chip.usart1.BRR);
    TEST_ASSERT_EQUAL_HEX32(USART_CR1_UE | USART_CR1_RE | USART_CR1_TE | USART_CR1_RXNEIE, chip.usart1.CR1);
    TEST_ASSERT_EQUAL_HEX32(1u << (IRQ_USART1 - 32), chip.nvic.ISER[1]);
}

static void test_bytes_are_received_in_the_order_in_which_they_come(void)
{
    char byte;
    TEST_ASSERT_FALSE(uart_get(&byte));
    receive('a', USART_SR_RXNE | USART_SR_TXE);
    receive('b', USART_SR_RXNE | USART_SR_TXE);
    TEST_ASSERT_TRUE(uart_get(&byte));
    TEST_ASSERT_EQUAL_CHAR('a', byte);
    TEST_ASSERT_TRUE(uart_get(&byte));
    TEST_ASSERT_EQUAL_CHAR('b', byte);
    TEST_ASSERT_FALSE(uart_get(&byte));
    TEST_ASSERT_EQUAL_UINT32(lost_before, uart_lost());
}

static void test_byte_that_overran_another_is_received_and_the_loss_counted(void)
{
    receive('a', USART_SR_RXNE | USART_SR_ORE);
    char byte;
    TEST_ASSERT_TRUE(uart_get(&byte));
    TEST_ASSERT_EQUAL_CHAR('a', byte);
    TEST_ASSERT_EQUAL_UINT32(lost_before + 1, uart_lost());
}

/* slcan has no checksum: a wrong character could be another frame, and one that is missing is refused. */
static void test_bytes_damaged_on_the_line_are_dropped_and_counted(void)
{
    char byte;
    receive('a', USART_SR_RXNE | USART_SR_FE);
    receive('b', USART_SR_RXNE | USART_SR_NF);
    TEST_ASSERT_FALSE(uart_get(&byte));
    TEST_ASSERT_EQUAL_UINT32(lost_before + 2, uart_lost());
    receive('c', USART_SR_RXNE);
    TEST_ASSERT_TRUE(uart_get(&byte));
    TEST_ASSERT_EQUAL_CHAR('c', byte);
}

static void test_bytes_that_find_no_room_are_lost_and_counted_and_the_older_stay(void)
{
    for (int i = 0; i < ROOM + 3; i++) {
        receive(i < ROOM ? 'a' : 'z', USART_SR_RXNE);
    }
    TEST_ASSERT_EQUAL_UINT32(lost_before + 3, uart_lost());
    char byte;
    for (int i = 0; i < ROOM; i++) {
        TEST_ASSERT_TRUE(uart_get(&byte));
        TEST_ASSERT_EQUAL_CHAR('a', byte);
    }
    TEST_ASSERT_FALSE(uart_get(&byte));
}

static void test_bytes_from_before_the_start_are_dropped(void)
{
    receive('a', USART_SR_RXNE);
    uart_init();
    char byte;
    TEST_ASSERT_FALSE(uart_get(&byte));
}

static void test_a_chip_sends_a_byte_each_interrupt_until_there_is_none(void)
{
    TEST_ASSERT_FALSE(sending());
    TEST_ASSERT_TRUE(uart_put("xyz", 3));
    TEST_ASSERT_TRUE(sending());
    TEST_ASSERT_EQUAL_UINT('x', send_one());
    TEST_ASSERT_EQUAL_UINT('y', send_one());
    TEST_ASSERT_EQUAL_UINT('z', send_one());
    TEST_ASSERT_TRUE(sending());
    TEST_ASSERT_EQUAL_UINT(NOTHING, send_one());
    TEST_ASSERT_FALSE(sending());
}

/* Found in QEMU: an interrupt for a received byte came while the background loop was sending, and sent the byte
 * that the background loop was about to send. */
static void test_byte_received_while_the_background_sends_sends_nothing_itself(void)
{
    (void)uart_put("xy", 2);
    chip.usart1.CR1 &= ~(uint32_t)USART_CR1_TXEIE; /* as while the background loop sends */
    receive('a', USART_SR_RXNE | USART_SR_TXE);
    TEST_ASSERT_EQUAL_UINT('a', chip.usart1.DR);
    chip.usart1.CR1 |= USART_CR1_TXEIE;
    TEST_ASSERT_EQUAL_UINT('x', send_one());
    TEST_ASSERT_EQUAL_UINT('y', send_one());
    char byte;
    TEST_ASSERT_TRUE(uart_get(&byte));
    TEST_ASSERT_EQUAL_CHAR('a', byte);
}

static void test_byte_received_and_byte_sent_share_an_interrupt_on_a_chip(void)
{
    (void)uart_put("x", 1);
    receive('a', USART_SR_RXNE | USART_SR_TXE);
    TEST_ASSERT_EQUAL_UINT('x', chip.usart1.DR);
    char byte;
    TEST_ASSERT_TRUE(uart_get(&byte));
    TEST_ASSERT_EQUAL_CHAR('a', byte);
}

static void test_an_emulator_sends_at_once_without_interrupts(void)
{
    chip_emulate();
    chip.usart1.DR = NOTHING;
    TEST_ASSERT_TRUE(uart_put("xyz", 3));
    TEST_ASSERT_FALSE(sending());
    TEST_ASSERT_EQUAL_UINT('z', chip.usart1.DR);
    chip.usart1.CR1 |= USART_CR1_TXEIE;
    TEST_ASSERT_EQUAL_UINT(NOTHING, send_one());
}

static void test_all_of_a_message_is_sent_or_nothing_of_it(void)
{
    static const char text[ROOM + 1] = "x";
    TEST_ASSERT_FALSE(uart_put(text, ROOM + 1));
    TEST_ASSERT_FALSE(sending());
    TEST_ASSERT_TRUE(uart_put(text, ROOM - 1));
    TEST_ASSERT_FALSE(uart_put("ab", 2));
    TEST_ASSERT_TRUE(uart_put("c", 1));
    unsigned last = NOTHING, count = 0;
    for (unsigned byte; (byte = send_one()) != NOTHING; count++) {
        last = byte;
    }
    TEST_ASSERT_EQUAL_UINT(ROOM, count);
    TEST_ASSERT_EQUAL_UINT('c', last);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_line_is_set_up_for_a_megabaud_and_interrupts_for_what_comes);
    RUN_TEST(test_bytes_are_received_in_the_order_in_which_they_come);
    RUN_TEST(test_byte_that_overran_another_is_received_and_the_loss_counted);
    RUN_TEST(test_bytes_damaged_on_the_line_are_dropped_and_counted);
    RUN_TEST(test_bytes_that_find_no_room_are_lost_and_counted_and_the_older_stay);
    RUN_TEST(test_bytes_from_before_the_start_are_dropped);
    RUN_TEST(test_a_chip_sends_a_byte_each_interrupt_until_there_is_none);
    RUN_TEST(test_byte_received_while_the_background_sends_sends_nothing_itself);
    RUN_TEST(test_byte_received_and_byte_sent_share_an_interrupt_on_a_chip);
    RUN_TEST(test_an_emulator_sends_at_once_without_interrupts);
    RUN_TEST(test_all_of_a_message_is_sent_or_nothing_of_it);
    return UNITY_END();
}
