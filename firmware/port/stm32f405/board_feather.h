/* SPDX-License-Identifier: Apache-2.0 */
/* board_feather.h: Adafruit's Feather STM32F405 Express on a base board with the levels
 * and drivers of board_kontur.h, which explains the names. It has another crystal, another
 * serial port, 16-bit encoder timers and no index pulse. No PWM pin is accessible (.pwm is
 * PIN_NONE), so axes use a DAC, the chip's or a serial one. The comments behind the pins are the names on the board.
 */
#ifndef KONTUR_BOARD_FEATHER_H
#define KONTUR_BOARD_FEATHER_H

#define BOARD_NAME "Feather STM32F405"
#define BOARD_HSE_MHZ 12

#define BOARD_UART USART3
#define BOARD_UART_IRQ IRQ_USART3
#define BOARD_UART_CLOCK() (RCC->APB1ENR |= RCC_APB1ENR_USART3)
#define BOARD_UART_HZ 42000000u /* APB1 */
#define BOARD_UART_BAUD 1000000u
#define BOARD_UART_TX PIN('B', 10) /* TX */
#define BOARD_UART_RX PIN('B', 11) /* RX */
#define BOARD_UART_AF 7

#define BOARD_CAN_RX PIN('B', 8) /* D9 */
#define BOARD_CAN_TX PIN('B', 9) /* D10 */
#define BOARD_CAN_AF 9

#define BOARD_PWM_AF 3
#define BOARD_BREAK PIN_NONE
#define BOARD_BREAK_BDTR 0
#define BOARD_SPI SPI2
#define BOARD_SPI_CLOCK() (RCC->APB1ENR |= RCC_APB1ENR_SPI2)
#define BOARD_SPI_SCK PIN('B', 13)  /* SCK */
#define BOARD_SPI_MOSI PIN('B', 15) /* MO */
#define BOARD_SPI_SYNC PIN('B', 14) /* MI */
#define BOARD_SPI_AF 5
#define BOARD_LED PIN('C', 1)   /* D13 */
#define BOARD_ALIVE PIN('A', 7) /* A3 */

#define BOARD_DIGITAL {PIN_NONE} /* no pin is left */
#define BOARD_POWER PIN_NONE
#define BOARD_POWER_AF 1

#define BOARD_STOP {PIN('A', 6), true, PIN_PULL_UP} /* A2 */

/* The DAC channels are the pins A0 (x) and A1 (y). */
#define BOARD_X                                                                                                        \
    {.encoder = {TIM3, RCC_APB1ENR_TIM3, 0xFFFFu, PIN('C', 6), PIN('C', 7), PIN_NONE, 2, 3}, /* D6, D5 */              \
     .limit_min = {PIN_NONE, true, PIN_PULL_UP},                                                                       \
     .limit_max = {PIN_NONE, true, PIN_PULL_UP},                                                                       \
     .amplifier_fault = {PIN('C', 4), true, PIN_PULL_UP},                                                              \
     .enable = PIN('C', 3), /* A4, D11 */                                                                              \
     .brake = PIN_NONE,                                                                                                \
     .pwm = PIN_NONE,                                                                                                  \
     .direction = PIN_NONE}
#define BOARD_Y                                                                                                        \
    {.encoder = {TIM4, RCC_APB1ENR_TIM4, 0xFFFFu, PIN('B', 6), PIN('B', 7), PIN_NONE, 2, 3}, /* SCL, SDA */            \
     .limit_min = {PIN_NONE, true, PIN_PULL_UP},                                                                       \
     .limit_max = {PIN_NONE, true, PIN_PULL_UP},                                                                       \
     .amplifier_fault = {PIN('C', 5), true, PIN_PULL_UP},                                                              \
     .enable = PIN('C', 2), /* A5, D12 */                                                                              \
     .brake = PIN_NONE,                                                                                                \
     .pwm = PIN_NONE,                                                                                                  \
     .direction = PIN_NONE}
#endif
