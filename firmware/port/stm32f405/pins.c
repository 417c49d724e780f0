/* SPDX-License-Identifier: Apache-2.0 */
/* pins.c: sets up a pin, pins.h. */
#include "port/stm32f405/pins.h"

static void set_field(reg *r, unsigned position, unsigned width, uint32_t value)
{
    const uint32_t mask = (1u << width) - 1u;
    *r = (*r & ~(mask << position)) | value << position;
}

static void clock_on(uint8_t pin)
{
    RCC->AHB1ENR |= 1u << (pin >> 4);
    /* The clock is on two cycles later (ST, ES0182, "Delay after an RCC peripheral clock enabling"). */
    (void)RCC->AHB1ENR;
}

void pin_setup(uint8_t pin, enum pin_mode mode, enum pin_pull pull, unsigned alternate)
{
    const unsigned n = pin & 15u;
    if (pin == PIN_NONE) {
        return;
    }
    struct gpio *gpio = GPIO(pin >> 4);
    clock_on(pin);
    if (mode == PIN_ALTERNATE) {
        set_field(&gpio->AFR[n / 8u], n % 8u * 4u, 4, alternate);
        set_field(&gpio->OSPEEDR, 2u * n, 2, 2);
    }
    set_field(&gpio->PUPDR, 2u * n, 2, (uint32_t)pull);
    set_field(&gpio->MODER, 2u * n, 2, (uint32_t)mode);
}

void pin_setup_low(uint8_t pin)
{
    if (pin != PIN_NONE) {
        clock_on(pin); /* a port without its clock ignores what is written (RM0090 7.2.11) */
        pin_write(pin, false);
        pin_setup(pin, PIN_OUTPUT, PIN_PULL_DOWN, 0);
    }
}
