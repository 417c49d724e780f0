/* SPDX-License-Identifier: Apache-2.0 */
/* board.h: which board. A board is one header: its crystal, its pins, the levels that mean "active". What each name
 * means stands in board_kontur.h; another pinout is a copy of it, named in BOARD= of `make firmware`. */
#ifndef KONTUR_BOARD_H
#define KONTUR_BOARD_H
#include "port/stm32f405/pins.h"

/* A quadrature encoder at channels 1 and 2 of a timer. The index pulse is captured by another channel of the same
 * timer. */
struct board_encoder {
    struct tim *tim;
    uint32_t apb1;         /* its clock: RCC_APB1ENR_... */
    uint32_t top;          /* 0xFFFFFFFF: a timer of 32 bits; 0xFFFF: of 16 */
    uint8_t a, b, index;   /* pins; index: PIN_NONE without */
    uint8_t alternate;     /* AF number of the three */
    uint8_t index_channel; /* 3 or 4 */
};

/* An input and the level at which it is active. PIN_NONE: never active. */
struct board_input {
    uint8_t pin;
    bool active_high;
    uint8_t pull; /* enum pin_pull */
};

struct board_axis {
    struct board_encoder encoder;
    struct board_input limit_min, limit_max, amplifier_fault;
    uint8_t enable; /* output, high: power stage on. A resistor on the board pulls it low while the chip starts */
    uint8_t pwm, direction; /* outputs; direction is high for a negative force */
};

#ifndef BOARD_HEADER
#define BOARD_HEADER "port/stm32f405/board_kontur.h"
#endif
#include BOARD_HEADER
#endif
