/* SPDX-License-Identifier: Apache-2.0 */
/* board_kontur.h: a controller board with an STM32F405RG (LQFP64). docs/hardware.md has the pins as a table.
 *
 * Alternate functions are those of ST, DS8626 "STM32F405xx STM32F407xx datasheet". Each input is a contact to ground
 * that opens when it is active, against the chip's pull-up, so that a broken wire is active. No pin is free. PA11 and
 * PA12 are reserved for USB (flashing), PA13 and PA14 for SWD.
 */
#ifndef KONTUR_BOARD_KONTUR_H
#define KONTUR_BOARD_KONTUR_H

#define BOARD_NAME "STM32F405, general"
#define BOARD_HSE_MHZ 8 /* crystal; 4..26, even */

/* The serial port with slcan. ST's boot loader listens on it,
 * too (AN2606): send nothing to it while flashing by USB. */
#define BOARD_UART USART1
#define BOARD_UART_IRQ IRQ_USART1
#define BOARD_UART_CLOCK() (RCC->APB2ENR |= RCC_APB2ENR_USART1)
#define BOARD_UART_HZ 84000000u /* clock of its bus, APB2 */
#define BOARD_UART_BAUD 1000000u
#define BOARD_UART_TX PIN('A', 9)
#define BOARD_UART_RX PIN('A', 10)
#define BOARD_UART_AF 7

#define BOARD_CAN_RX PIN('B', 8)
#define BOARD_CAN_TX PIN('B', 9)
#define BOARD_CAN_AF 9

/* The DAC channels are PA4 (x) and PA5 (y) on every STM32F405. The PWM outputs are channels 1 and 2 of TIM8. */
#define BOARD_PWM_AF 3
/* The break input of TIM8, of the same alternate function. */
#define BOARD_BREAK PIN('A', 6)
#define BOARD_BREAK_BDTR (TIM_BDTR_BKE | TIM_BDTR_BKP) /* active high */
/* The serial DAC (spi_dac.h). SCK and SYNC are pins of one port. */
#define BOARD_SPI SPI3
#define BOARD_SPI_CLOCK() (RCC->APB1ENR |= RCC_APB1ENR_SPI3)
#define BOARD_SPI_SCK PIN('C', 10)
#define BOARD_SPI_MOSI PIN('C', 12)
#define BOARD_SPI_SYNC PIN('C', 11)
#define BOARD_SPI_AF 6
#define BOARD_LED PIN('C', 13) /* it sinks 3 mA at most (DS8626, output current of PC13) */
/* A square wave of half the rate of the servo tick, while that runs. */
#define BOARD_ALIVE PIN('B', 0)

/* The outputs beside the axes (2180h) by their bits, and the pin of their power: channel 1 of TIM1. PC14 and PC15 sink
 * 3 mA at most, as PC13. */
#define BOARD_DIGITAL                                                                                                  \
    {PIN('B', 11), PIN('B', 13), PIN('C', 14), PIN('C', 9), PIN('A', 7), PIN('C', 15), PIN_NONE, PIN_NONE, PIN('B', 2)}
#define BOARD_POWER PIN('A', 8)
#define BOARD_POWER_AF 1

#define BOARD_STOP {PIN('C', 4), true, PIN_PULL_UP}

#define BOARD_X                                                                                                        \
    {.encoder = {TIM2, RCC_APB1ENR_TIM2, 0xFFFFFFFFu, PIN('A', 15), PIN('B', 3), PIN('B', 10), 1, 3},                  \
     .second = {TIM3, RCC_APB1ENR_TIM3, 0xFFFFu, PIN('B', 4), PIN('B', 5), PIN_NONE, 2, 3},                            \
     .limit_min = {PIN('C', 0), true, PIN_PULL_UP},                                                                    \
     .limit_max = {PIN('C', 1), true, PIN_PULL_UP},                                                                    \
     .amplifier_fault = {PIN('C', 5), true, PIN_PULL_UP},                                                              \
     .enable = PIN('B', 12),                                                                                           \
     .brake = PIN('D', 2),                                                                                             \
     .pwm = PIN('C', 6),                                                                                               \
     .direction = PIN('B', 14)}
#define BOARD_Y                                                                                                        \
    {.encoder = {TIM5, RCC_APB1ENR_TIM5, 0xFFFFFFFFu, PIN('A', 0), PIN('A', 1), PIN('A', 2), 2, 3},                    \
     .second = {TIM4, RCC_APB1ENR_TIM4, 0xFFFFu, PIN('B', 6), PIN('B', 7), PIN_NONE, 2, 3},                            \
     .limit_min = {PIN('C', 2), true, PIN_PULL_UP},                                                                    \
     .limit_max = {PIN('C', 3), true, PIN_PULL_UP},                                                                    \
     .amplifier_fault = {PIN('B', 1), true, PIN_PULL_UP},                                                              \
     .enable = PIN('C', 8),                                                                                            \
     .brake = PIN('A', 3),                                                                                             \
     .pwm = PIN('C', 7),                                                                                               \
     .direction = PIN('B', 15)}
#endif
