/* SPDX-License-Identifier: Apache-2.0 */
/* uart.c: the serial port, uart.h. */
#include "port/stm32f405/uart.h"

#include <stdatomic.h>

#include "port/stm32f405/board.h"
#include "port/stm32f405/cpu.h"

enum { ROOM = 1024 }; /* bytes; 10 ms at 1 Mbit/s */
_Static_assert((ROOM & (ROOM - 1)) == 0, "positions wrap at 2^32");

/* A ring with one writer and one reader. Its positions count bytes since power-on. */
struct ring {
    char byte[ROOM];
    _Atomic uint32_t in, out;
};

static struct ring rx, tx;
static _Atomic uint32_t lost;

void uart_init(void)
{
    atomic_store(&rx.out, atomic_load(&rx.in));
    BOARD_UART_CLOCK();
    pin_setup(BOARD_UART_TX, PIN_ALTERNATE, PIN_PULL_UP, BOARD_UART_AF);
    pin_setup(BOARD_UART_RX, PIN_ALTERNATE, PIN_PULL_UP, BOARD_UART_AF);
    /* With 16 samples a bit, BRR is the number of clocks in a bit. */
    BOARD_UART->BRR = (BOARD_UART_HZ + BOARD_UART_BAUD / 2u) / BOARD_UART_BAUD;
    BOARD_UART->CR1 = USART_CR1_UE | USART_CR1_RE | USART_CR1_TE | USART_CR1_RXNEIE;
    cpu_irq_enable(BOARD_UART_IRQ, PRIORITY_SERIAL);
}

void uart_irq(void)
{
    const uint32_t status = BOARD_UART->SR;
    if ((status & (USART_SR_RXNE | USART_SR_ORE)) != 0) {
        const char byte = (char)BOARD_UART->DR; /* clears these flags, FE and NF */
        const uint32_t in = atomic_load(&rx.in);
        const bool dropped = (status & (USART_SR_FE | USART_SR_NF)) != 0 || in - atomic_load(&rx.out) == ROOM;
        if (dropped || (status & USART_SR_ORE) != 0) {
            atomic_fetch_add(&lost, 1u);
        }
        if (!dropped) {
            rx.byte[in % ROOM] = byte;
            atomic_store(&rx.in, in + 1u);
        }
    }
    /* Send only while TXEIE is set. In QEMU the background loop
     * sends, and a byte received meanwhile must not send, too. */
    if ((status & USART_SR_TXE) != 0 && (BOARD_UART->CR1 & USART_CR1_TXEIE) != 0) {
        const uint32_t out = atomic_load(&tx.out);
        if (out == atomic_load(&tx.in)) {
            BOARD_UART->CR1 &= ~(uint32_t)USART_CR1_TXEIE;
        } else {
            BOARD_UART->DR = (uint8_t)tx.byte[out % ROOM];
            atomic_store(&tx.out, out + 1u);
        }
    }
}

bool uart_get(char *byte)
{
    const uint32_t out = atomic_load(&rx.out);
    if (out == atomic_load(&rx.in)) {
        return false;
    }
    *byte = rx.byte[out % ROOM];
    atomic_store(&rx.out, out + 1u);
    return true;
}

/* QEMU 7.2 raises no interrupt for TXE, because its USART sends at once. There the background loop sends. */
static void send_without_interrupt(void)
{
    for (int i = 0; i < ROOM && atomic_load(&tx.out) != atomic_load(&tx.in); i++) {
        const uint32_t out = atomic_load(&tx.out);
        BOARD_UART->DR = (uint8_t)tx.byte[out % ROOM];
        atomic_store(&tx.out, out + 1u);
    }
}

bool uart_put(const char *bytes, unsigned count)
{
    const uint32_t in = atomic_load(&tx.in);
    if (in - atomic_load(&tx.out) + count > ROOM) {
        return false;
    }
    for (unsigned i = 0; i < count; i++) {
        tx.byte[(in + i) % ROOM] = bytes[i];
    }
    atomic_store(&tx.in, in + count);
    if (cpu_emulated()) {
        send_without_interrupt();
    } else {
        const uint32_t lock = cpu_lock(); /* the interrupt changes CR1, too */
        BOARD_UART->CR1 |= USART_CR1_TXEIE;
        cpu_unlock(lock);
    }
    return true;
}

uint32_t uart_lost(void)
{
    return atomic_load(&lost);
}
