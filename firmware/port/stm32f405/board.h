/* SPDX-License-Identifier: Apache-2.0 */
/* board.h: the board that the image is built for. A board is one header with its
 * crystal, its pins, and the levels that mean "active". board_kontur.h explains each
 * name. For another pinout, copy it and name the copy in BOARD= of `make firmware`.
 *
 * Context: constants, for the drivers of this folder.
 */
#ifndef KONTUR_BOARD_H
#define KONTUR_BOARD_H
#include "port/stm32f405/pins.h"

/* A quadrature encoder at channels 1 and 2 of a timer. Another channel of the timer captures the index pulse. */
struct board_encoder {
    struct tim *tim;
    uint32_t apb1;         /* bit of its clock, RCC_APB1ENR_... */
    uint32_t top;          /* highest count: 0xFFFFFFFF of a 32-bit timer, 0xFFFF of a 16-bit timer */
    uint8_t a, b, index;   /* pins; index is PIN_NONE where there is no index pulse */
    uint8_t alternate;     /* AF number of these pins */
    uint8_t index_channel; /* 3 or 4 */
};

/* An input and the level at which it is active. An input at PIN_NONE is never active. */
struct board_input {
    uint8_t pin;
    bool active_high;
    uint8_t pull; /* enum pin_pull */
};

struct board_axis {
    struct board_encoder encoder;
    struct board_encoder second; /* at the table, without an index pulse; tim is NULL where the board has none */
    struct board_input limit_min, limit_max, amplifier_fault;
    uint8_t enable; /* output; high: power stage on. A resistor on the board holds it low while the chip starts. */
    uint8_t brake;  /* output; high: brake released */
    uint8_t pwm, direction; /* outputs; direction is high for a negative force */
};

#ifndef BOARD_HEADER
#define BOARD_HEADER "port/stm32f405/board_kontur.h"
#endif
#include BOARD_HEADER
#endif
