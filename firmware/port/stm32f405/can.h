/* SPDX-License-Identifier: Apache-2.0 */
/* can.h: bxCAN 1 (RM0090 32). Frames with 11-bit identifiers go in and out by interrupt through rings. No function
 * waits for the bus: when nobody acknowledges, the controller repeats the oldest frames and becomes error passive,
 * which can_status() reports; the ring fills, and can_send() returns false.
 *
 * The bit timing comes from the 42 MHz of APB1, with the sample point as near to 87.5 % as that clock allows (CiA 301,
 * 5.3): 85.7 % at 1000 and 500 kbit/s, 87.5 % at 250 and 125. After bus-off the controller returns to the bus by itself
 * after 128 times 11 recessive bits (ISO 11898-1; ABOM, RM0090 32.7.6), and the bus-off is counted. Frames that wait to
 * be sent then, and frames that come until the bus is back, are dropped, since they would be out of date.
 *
 * Context: the background loop calls it, except the three interrupt handlers.
 */
#ifndef KONTUR_CAN_H
#define KONTUR_CAN_H
#include "hal/hal.h"

/* false: the controller does not answer, as in an emulator. Then frames to send are dropped, and none is received. */
bool can_init(uint16_t kbitps);
/* The functions of hal.h. */
bool can_send(const struct can_frame *frame);
bool can_receive(struct can_frame *frame);
void can_status(struct hal_can_status *status);
bool can_bitrate(uint16_t kbitps, bool change);

/* Interrupt: a mailbox has become free, or can_send() has requested it. */
void can_tx_irq(void);
/* Interrupt: a frame has come. */
void can_rx_irq(void);
/* Interrupt: the error state has changed. */
void can_error_irq(void);
#endif
