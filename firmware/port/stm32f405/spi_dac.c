/* SPDX-License-Identifier: Apache-2.0 */
/* spi_dac.c: the serial DAC, spi_dac.h. */
#include "port/stm32f405/spi_dac.h"

#include "port/stm32f405/board.h"
#include "port/stm32f405/cpu.h"

/* Command (C2 to C0) and address (A2 to A0) of a frame: SLAS719E, table 17 */
enum {
    WRITE_A = 0,
    WRITE_B_UPDATE_ALL = 2 << 3 | 1,
    WRITE_BOTH_UPDATE_ALL = 2 << 3 | 7,
    RESET = 5 << 3,
    LDAC_PIN = 6 << 3,
    REFERENCE = 7 << 3
};
enum { RESET_ALL = 1, BOTH_INACTIVE = 3, ON_WITH_GAIN_2 = 1 };
enum { POLLS = 200 }; /* of 4 cycles or more: a byte takes 64 */

static void put(uint32_t byte)
{
    (void)wait_until(&BOARD_SPI->SR, SPI_SR_TXE, SPI_SR_TXE, POLLS);
    BOARD_SPI->DR = byte & 0xFFu;
}

/* BSY counts once TXE is set (RM0090 28.3.8). */
static void wait_sent(void)
{
    (void)wait_until(&BOARD_SPI->SR, SPI_SR_TXE, SPI_SR_TXE, POLLS);
    (void)wait_until(&BOARD_SPI->SR, SPI_SR_BSY, 0, POLLS);
}

static void send(uint32_t what, uint32_t data)
{
    for (int i = 0; i < 4; i++) { /* SYNC has been high for 80 ns: a read of APB1 takes 4 cycles of it or more */
        (void)BOARD_SPI->SR;
    }
    pin_write(BOARD_SPI_SYNC, false);
    put(what);
    put(data >> 8);
    put(data);
    wait_sent();
    pin_write(BOARD_SPI_SYNC, true);
}

void spi_dac_init(void)
{
    BOARD_SPI_CLOCK();
    (void)RCC->APB1ENR;
    /* The DAC takes a bit at the falling edge. 21 MHz, of APB1's 42. It answers nothing. */
    BOARD_SPI->CR1 = SPI_CR1_MSTR | SPI_CR1_CPHA | SPI_CR1_SSM | SPI_CR1_SSI | SPI_CR1_BIDIMODE | SPI_CR1_BIDIOE;
    BOARD_SPI->CR1 |= SPI_CR1_SPE;
    pin_setup(BOARD_SPI_SCK, PIN_ALTERNATE, PIN_FLOATING, BOARD_SPI_AF);
    pin_setup(BOARD_SPI_MOSI, PIN_ALTERNATE, PIN_FLOATING, BOARD_SPI_AF);
    pin_write(BOARD_SPI_SYNC, true); /* its port has a clock: it is that of SCK */
    pin_setup(BOARD_SPI_SYNC, PIN_OUTPUT, PIN_PULL_UP, 0);
    spi_dac_configure();
}

void spi_dac_configure(void)
{
    send(RESET, RESET_ALL);
    send(LDAC_PIN, BOTH_INACTIVE);
    send(REFERENCE, ON_WITH_GAIN_2);
}

void spi_dac_write(uint32_t x, uint32_t y)
{
    send(WRITE_A, x);
    send(WRITE_B_UPDATE_ALL, y);
}

void spi_dac_zero(void)
{
    wait_sent();
    pin_write(BOARD_SPI_SYNC, true); /* a frame that is not complete has no effect (SLAS719E 8.5.1) */
    send(WRITE_BOTH_UPDATE_ALL, SPI_DAC_MID_SCALE);
}
