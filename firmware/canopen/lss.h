/* SPDX-License-Identifier: Apache-2.0 */
/* lss.h: layer setting services, slave (CiA 305): node id and bit rate from the bus, by identity 1018h.
 *
 * What is configured goes to 2001h and is in effect from the next reset communication on; a bit rate also by
 * "activate bit timing", for whose two delays the node sends nothing. A node without id (OD_UNCONFIGURED)
 * answers LSS only, until it is given one and sent back to the waiting state, or reset. Background only.
 */
#ifndef CO_LSS_H
#define CO_LSS_H
#include <stdbool.h>
#include <stdint.h>

#include "hal/hal.h"

enum { CO_LSS_REQUEST = 0x7E5, CO_LSS_RESPONSE = 0x7E4 };

struct co_lss {
    bool configuring;   /* state: configuration, else waiting */
    uint8_t selected;   /* parts of the address that were this node's, in order: switch state selective, */
    uint8_t identified; /* identify remote slave */
    uint8_t scanned;    /* part that the fastscan is at */
    uint16_t bitrate;   /* in use, kbit/s */
    uint16_t delay_ms;  /* of the switch of bit rate under way */
    uint32_t silent_ms; /* left of both of its delays */
};

struct co_node;
/* After a reset: waiting state, bit rate of 2001h. */
void co_lss_reset(struct co_node *node);
void co_lss_receive(struct co_node *node, const struct can_frame *frame);
void co_lss_tick_ms(struct co_node *node);
#endif
