/* SPDX-License-Identifier: Apache-2.0 */
/* node.h: a CANopen device (CiA 301) on top of the generated object dictionary.
 *
 * NMT slave, heartbeat producer and consumer, SDO server (sdo.h), PDOs and SYNC (pdo.h), EMCY (emcy.h), LSS (lss.h).
 * No RTR, no node guarding.
 *
 * Use: od_init(), set the texts of the dictionary (build id, ...), fill a co_config, co_init();
 * then, in the background loop only, co_receive() for every frame and co_tick_ms() once a
 * millisecond. Fields that TPDOs carry are to be up to date whenever co_tick_ms() is called.
 * A frame that makes no sense is ignored where CiA 301 gives no answer to it.
 */
#ifndef CO_NODE_H
#define CO_NODE_H
#include <stdbool.h>
#include <stdint.h>

#include "canopen/busstate.h"
#include "canopen/emcy.h"
#include "canopen/lss.h"
#include "canopen/pdo.h"
#include "canopen/sdo.h"
#include "hal/hal.h"
#include "od/od.h"

/* Initialising: it has no node id. */
enum co_state { CO_INITIALISING = 0, CO_STOPPED = 4, CO_OPERATIONAL = 5, CO_PRE_OPERATIONAL = 127 };

/* What the application adds. Each may be NULL; all are called from co_init, co_receive, co_tick_ms. */
struct co_hooks {
    void *ctx;
    /* An SDO wants to write `value`, which is in range: SDO_OK, or the abort code to answer with.
     * `entry->flags & OD_CONFIG` marks what must not change while an axis is in operation enabled. */
    uint32_t (*check_write)(void *ctx, const struct od_entry *entry, int64_t value);
    /* An SDO has written. */
    void (*on_write)(void *ctx, const struct od_entry *entry);
    /* An SDO is about to read: bring the field up to date. */
    void (*before_read)(void *ctx, const struct od_entry *entry);
    /* An SDO reads a domain: how many bytes there are, 0 none. */
    uint32_t (*domain_size)(void *ctx, const struct od_entry *entry);
    /* Put `count` of these bytes, from `at` on; the same ones may be asked for again. false: they are gone. */
    bool (*domain_read)(void *ctx, const struct od_entry *entry, uint32_t at, uint8_t *to, uint32_t count);
    /* RPDO `number` (1...) takes effect: its fields are stored. Called for every frame before the next one
     * is looked at. co_rpdo_carries() tells what is mapped into it. */
    void (*on_rpdo)(void *ctx, unsigned number);
    /* TPDO `number` (1...) has been handed to the bus. co_tpdo_carries() tells what is mapped into it. */
    void (*on_tpdo)(void *ctx, unsigned number);
    /* The NMT state has changed. */
    void (*on_nmt)(void *ctx, enum co_state state);
    /* The node of 1016h, or of co_watch_heartbeat(), has been silent for its time; the NMT state of 1029h follows. Called once; the
     * next heartbeat rearms it. */
    void (*on_heartbeat_lost)(void *ctx);
    /* A reset: put the objects 1000h..1FFFh, or all, to what they are at power-on, and return the node id from now on.
     * NULL: they are put to their defaults. */
    uint8_t (*load)(void *ctx, bool communication_only);
    /* Store 2001h (LSS). false: that failed. */
    bool (*store_node)(void *ctx);
    /* Reset node, or reset communication only; what `load` says has been done. Stop the machine, take over the values.
     * The boot-up message follows, then on_nmt. */
    void (*on_reset)(void *ctx, bool communication_only);
};

struct co_config {
    struct od_data *od;
    const struct hal *hal; /* can_send, can_bitrate */
    uint8_t node_id;       /* 1..127, or OD_UNCONFIGURED */
    struct co_hooks hooks;
};

#define CO_TX_FRAMES 8
#define CO_HEARTBEAT_WATCH_MS 500u

/* Owned by the caller; no field is for his use. */
struct co_node {
    struct co_config config;
    enum co_state state;
    uint16_t producer_ms;              /* since the last heartbeat */
    uint32_t guarded;                  /* node << 16 | ms of co_watch_heartbeat(), in place of 1016h; 0: nobody */
    uint32_t consumer_left_ms;         /* until the consumed heartbeat is lost; 0: not watched */
    struct can_frame tx[CO_TX_FRAMES]; /* frames that the HAL had no room for, oldest first */
    uint8_t tx_count;
    struct co_emcy emcy;
    struct co_busstate busstate;
    struct co_sdo sdo;
    struct co_lss lss;
    struct co_pdo rpdo[OD_RPDOS], tpdo[OD_TPDOS];
};

/* Power-on: sends the boot-up message and enters pre-operational. The dictionary must be set up. */
void co_init(struct co_node *node, const struct co_config *config);
void co_receive(struct co_node *node, const struct can_frame *frame);
void co_tick_ms(struct co_node *node);
enum co_state co_nmt_state(const struct co_node *node);
/* From now on, and not from its first heartbeat only, the heartbeat of node `id` is watched in place of that of 1016h, for the
 * time that is there for it, or CO_HEARTBEAT_WATCH_MS; 0: 1016h counts again, from its next heartbeat on. A reset ends it. */
void co_watch_heartbeat(struct co_node *node, uint8_t id);

/* Between the files of this folder: */
/* Send, or keep until there is room; dropped where there is no room here either. */
void co_send(struct co_node *node, const struct can_frame *frame);
/* Send now. false: there is no room, or the bit rate is being changed. */
bool co_transmit(struct co_node *node, const struct can_frame *frame);
/* What the NMT command does. */
void co_reset_communication(struct co_node *node);
/* An SDO has written; what node.c keeps of the dictionary follows. */
void co_written(struct co_node *node, const struct od_entry *entry);
/* Put `count` bytes of `value`, little-endian. */
void co_put(uint8_t *data, uint32_t value, uint8_t count);
uint32_t co_get(const uint8_t *data, uint8_t count);
#endif
