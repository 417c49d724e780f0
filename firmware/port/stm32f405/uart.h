/* SPDX-License-Identifier: Apache-2.0 */
/* uart.h: the board's serial port, 8 data bits, no parity, by interrupt through two rings (RM0090 30). From the
 * background: all but uart_irq(), which is one byte in and one byte out. */
#ifndef KONTUR_UART_H
#define KONTUR_UART_H
#include <stdbool.h>
#include <stdint.h>

void uart_init(void);
/* The oldest byte received. false: there is none. */
bool uart_get(char *byte);
/* All of them, or none: false. */
bool uart_put(const char *bytes, unsigned count);
/* Bytes that came too fast, since power-on. */
uint32_t uart_lost(void);
void uart_irq(void);
#endif
