/* SPDX-License-Identifier: Apache-2.0 */
/* spi_dac.h: a serial dual 16-bit DAC at the board's SPI: TI's DAC8563. RM0090 28.3; TI, SLAS719E: frame and commands 8.5
 * and table 17, SCLK and SYNC 7.6, mid-scale at power-on 8.3.3.2, reset 8.4.3, reference and gain 8.4.4, LDAC 8.4.6.
 *
 * Its own reference, 2.5 V, and a gain of 2 make 0..5 V; the board makes -10..10 V of that. Both channels change with the
 * last bit of one frame, since the pin LDAC is made inactive: it may have any level. A write takes 3 us, which the
 * caller waits.
 *
 * Context: spi_dac_zero() in any context; spi_dac_write() in the servo tick; the others in the background loop, before the
 * first tick or with interrupts disabled.
 */
#ifndef KONTUR_SPI_DAC_H
#define KONTUR_SPI_DAC_H
#include <stdint.h>

#define SPI_DAC_MID_SCALE 0x8000u

/* At start-up: pins, SPI, and spi_dac_configure(). */
void spi_dac_init(void);
/* Reset and configure the DAC: both channels at mid-scale. */
void spi_dac_configure(void);
/* Set both channels, x is A: 0 to FFFFh. */
void spi_dac_write(uint32_t x, uint32_t y);
/* Set both channels to mid-scale. A write that this interrupts has no effect. */
void spi_dac_zero(void);
#endif
