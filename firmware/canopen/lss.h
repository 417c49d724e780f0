/* SPDX-License-Identifier: Apache-2.0 */
/* lss.h: layer setting services, slave (CiA 305): a master sets node id and bit rate over the bus.
 *
 * The master addresses the node by its identity, object 1018h. What it configures is written to 2001h and takes effect
 * at the next reset of communication. A new bit rate also takes effect by "activate bit timing"; for the two delays of
 * that service the node sends nothing. What the application refuses to take by SDO now, it refuses here, too. A node
 * without id (OD_UNCONFIGURED) answers LSS only, until it has been given one and is sent back to the waiting state, or
 * reset.
 *
 * Background only; called by node.c.
 */
#ifndef CO_LSS_H
#define CO_LSS_H
#include <stdbool.h>
#include <stdint.h>

#include "canopen/tx.h"
#include "hal/hal.h"
#include "od/od.h"

enum { CO_LSS_REQUEST = 0x7E5, CO_LSS_RESPONSE = 0x7E4 }; /* frame identifiers */

/* How the node takes over its id and bit rate, as by SDO (co_hooks in node.h), and stores them. */
struct co_lss_hooks {
    void *ctx;
    uint32_t (*before_write)(void *ctx, const struct od_entry *entry, int64_t value);
    void (*on_write)(void *ctx, const struct od_entry *entry);
    bool (*store_node)(void *ctx); /* store 2001h; false: that failed */
};

struct co_lss {
    struct od_data *od; /* 1018h, 2001h */
    struct co_tx *tx;
    const struct hal *hal; /* can_bitrate */
    struct co_lss_hooks hooks;
    uint8_t node_id;    /* since the last reset, or OD_UNCONFIGURED */
    bool configuring;   /* the state is configuration, else waiting */
    uint8_t selected;   /* parts of the address that have been this node's, in order: by switch state selective, */
    uint8_t identified; /* and by identify remote slave */
    uint8_t scanned;    /* part of the address that the fastscan has reached */
    uint16_t bitrate;   /* in use, kbit/s; 0: not set yet */
    uint16_t delay_ms;  /* of the change of bit rate under way */
    uint32_t silent_ms; /* left of both its delays */
};

/* Power-on. co_lss_reset() is to follow. */
void co_lss_init(struct co_lss *lss, struct od_data *od, struct co_tx *tx, const struct hal *hal,
                 const struct co_lss_hooks *hooks);
/* The node has this id from now on, is in the waiting state, and uses the bit rate of 2001h. */
void co_lss_reset(struct co_lss *lss, uint8_t node_id);
/* Handle a frame with the identifier CO_LSS_REQUEST. true: the node without id has been given one, and communication is
 * to be reset. */
bool co_lss_receive(struct co_lss *lss, const struct can_frame *frame);
void co_lss_tick_ms(struct co_lss *lss);
#endif
