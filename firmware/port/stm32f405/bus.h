/* SPDX-License-Identifier: Apache-2.0 */
/* bus.h: the bus of the node. It is CAN (can.h), or slcan on the serial port (../slcan.h) while a host has opened that
 * channel. It is never both, so that there is one master, one order of frames and one flow control.
 *
 * Context: the background loop, from the HAL in main_loop.c.
 */
#ifndef KONTUR_STM32_BUS_H
#define KONTUR_STM32_BUS_H
#include "hal/hal.h"

/* At start-up: the serial port, with its channel closed. */
void bus_init(void);
/* The functions of hal.h. */
bool bus_send(const struct can_frame *frame);
bool bus_receive(struct can_frame *frame);
void bus_status(struct hal_can_status *status);
#endif
