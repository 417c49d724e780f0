/* SPDX-License-Identifier: Apache-2.0 */
/* pins.h: the pins of the chip (RM0090 8.3). A pin is one byte: PIN('B', 8) is PB8. pin_setup() is for power-on; every
 * context reads and writes pins. */
#ifndef KONTUR_PINS_H
#define KONTUR_PINS_H
#include <stdbool.h>

#include "port/stm32f405/regs.h"

#define PIN(port, number) ((uint8_t)(((port) - 'A') << 4 | (number)))
#define PIN_NONE 0xFFu

enum pin_mode { PIN_INPUT, PIN_OUTPUT, PIN_ALTERNATE, PIN_ANALOG };
enum pin_pull { PIN_FLOATING, PIN_PULL_UP, PIN_PULL_DOWN };

/* `alternate` is the AF number (DS8626) of a pin with PIN_ALTERNATE. PIN_NONE is ignored, here and below. */
void pin_setup(uint8_t pin, enum pin_mode mode, enum pin_pull pull, unsigned alternate);
/* An output that is low from its first moment. */
void pin_setup_low(uint8_t pin);

static inline void pin_write(uint8_t pin, bool high)
{
    if (pin != PIN_NONE) {
        const uint32_t bit = 1u << (pin & 15u);
        GPIO(pin >> 4)->BSRR = high ? bit : bit << 16;
#ifndef __arm__ /* on the chip the hardware does this */
        GPIO(pin >> 4)->ODR = high ? GPIO(pin >> 4)->ODR | bit : GPIO(pin >> 4)->ODR & ~bit;
#endif
    }
}

static inline bool pin_read(uint8_t pin)
{
    return pin != PIN_NONE && (GPIO(pin >> 4)->IDR >> (pin & 15u) & 1u) != 0;
}
#endif
