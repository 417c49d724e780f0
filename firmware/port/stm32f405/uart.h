/* SPDX-License-Identifier: Apache-2.0 */
/* uart.h: the board's serial port, 8 data bits without parity, by interrupt through two rings (RM0090 30).
 *
 * Context: the background loop calls it through bus.c. uart_irq() is the interrupt, for one byte in and one byte out.
 */
#ifndef KONTUR_UART_H
#define KONTUR_UART_H
#include <stdbool.h>
#include <stdint.h>

/* Start the port with empty rings. */
void uart_init(void);
/* The oldest byte received. false: there is none. */
bool uart_get(char *byte);
/* Queue all of the bytes. false: there is no room, and none is queued. */
bool uart_put(const char *bytes, unsigned count);
/* Bytes received that were lost since power-on: overrun, without room, or damaged (framing error, noise). */
uint32_t uart_lost(void);
void uart_irq(void);
#endif
