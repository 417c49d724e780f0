/* SPDX-License-Identifier: Apache-2.0 */
/* can.h: bxCAN 1 (RM0090 32): frames with 11-bit identifiers, in and out by interrupt through rings. Nothing here waits
 * for the bus: when nobody acknowledges, the controller repeats the oldest frames (and goes error passive, which
 * can_status() tells), the ring fills, can_send() says no.
 *
 * Bit timing from the 42 MHz of APB1, sample point as near to 87.5 % as that clock allows (CiA 301, 5.3): 85.7 % at
 * 1000 and 500 kbit/s, 87.5 % at 250 and 125. Bus-off: left by itself after 128 times 11 recessive bits (ISO 11898-1;
 * ABOM, RM0090 32.7.6), counted; what waits to be sent then, and what comes meanwhile, is dropped, being out of date.
 */
#ifndef KONTUR_CAN_H
#define KONTUR_CAN_H
#include "hal/hal.h"

/* false: the controller does not answer (as in an emulator). Then frames to send are dropped and none comes. */
bool can_init(uint16_t kbitps);
/* As in hal.h. */
bool can_send(const struct can_frame *frame);
bool can_receive(struct can_frame *frame);
void can_status(struct hal_can_status *status);
bool can_bitrate(uint16_t kbitps, bool change);

/* Interrupts: a mailbox is free, or there is something new for one; a frame has come; the error state has changed. */
void can_tx_irq(void);
void can_rx_irq(void);
void can_error_irq(void);
#endif
