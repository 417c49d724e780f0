/* SPDX-License-Identifier: Apache-2.0 */
/* wire.h: the bus that the node hears: CAN; or, while a host has opened it, slcan on the serial port (../slcan.h).
 * Never both, so that there is one master, one order of frames and one flow control. Background only. */
#ifndef KONTUR_WIRE_H
#define KONTUR_WIRE_H
#include "hal/hal.h"

void wire_init(void);
bool wire_send(const struct can_frame *frame);
bool wire_receive(struct can_frame *frame);
void wire_status(struct hal_can_status *status);
#endif
