/* SPDX-License-Identifier: Apache-2.0 */
/* node.h: a CANopen device (CiA 301) on top of the generated object dictionary.
 *
 * The node is an NMT slave, producer and consumer of heartbeats (nmt.h), an SDO server (sdo.h), sends and receives PDOs
 * and follows SYNC (pdo.h), sends EMCY (emcy.h), and is an LSS slave (lss.h). Of remote frames it answers those of node guarding. This module
 * puts these services together: it gives each frame and each millisecond to them in a fixed order, and passes between
 * them what one must know of another. A service knows only the other services that its header includes.
 *
 * Use: od_init(), set the texts of the dictionary (build id, ...), fill a co_config, call co_init(). Then, in the
 * background loop only, call co_receive() for every frame and co_tick_ms() once a millisecond. Values that TPDOs carry
 * must be up to date whenever co_tick_ms() is called. A frame that makes no sense is ignored where CiA 301 gives no
 * answer to it.
 */
#ifndef CO_NODE_H
#define CO_NODE_H
#include <stdbool.h>
#include <stdint.h>

#include "canopen/bus_state.h"
#include "canopen/emcy.h"
#include "canopen/frame.h"
#include "canopen/lss.h"
#include "canopen/nmt.h"
#include "canopen/pdo.h"
#include "canopen/sdo.h"
#include "canopen/tx.h"
#include "hal/hal.h"
#include "od/od.h"

/* What the application adds. Each may be NULL. All are called from co_init(), co_receive() or co_tick_ms(). */
struct co_hooks {
    void *ctx;
    /* An SDO is to write `value`, which is in range and which check.h accepts. Returns SDO_OK, or the abort code to
     * answer with. Where writing is a command, this is where it is carried out. `entry->flags & OD_CONFIG` marks what
     * must not change while an axis is in operation enabled. */
    uint32_t (*before_write)(void *ctx, const struct od_entry *entry, int64_t value);
    /* An SDO has written. */
    void (*on_write)(void *ctx, const struct od_entry *entry);
    /* An SDO is about to read: bring the value up to date. */
    void (*before_read)(void *ctx, const struct od_entry *entry);
    /* An SDO is about to read a domain. Returns the number of its bytes; 0: there are none. */
    uint32_t (*domain_size)(void *ctx, const struct od_entry *entry);
    /* Put `count` bytes of a domain from `at` on into `to`; they may be read again. false: it has changed. */
    bool (*domain_read)(void *ctx, const struct od_entry *entry, uint32_t at, uint8_t *to, uint32_t count);
    /* An RPDO carries `value`, which is in range. Returns SDO_OK, or the reason why it is left out. */
    uint32_t (*check_rpdo)(void *ctx, const struct od_entry *entry, int64_t value);
    /* The values of RPDO `number` (1...) are stored, but for those refused. Called for every RPDO before the next one is handled;
     * co_rpdo_carries() says what is mapped into it. */
    void (*on_rpdo)(void *ctx, unsigned number);
    /* A SYNC has come, and the RPDOs that waited for it have had their effect. */
    void (*on_sync)(void *ctx);
    /* TPDO `number` (1...) has been handed to the bus; co_tpdo_carries() says what is mapped into it. */
    void (*on_tpdo)(void *ctx, unsigned number);
    /* The NMT state has changed. */
    void (*on_nmt)(void *ctx, enum co_state state);
    /* The heartbeat of 1016h, or of co_watch_heartbeat(), has not come for its time, or the master has ceased to guard
     * the node. Called once, until it has come again. The NMT state that 1029h asks for follows. */
    void (*on_heartbeat_lost)(void *ctx);
    /* A reset: set the objects 1000h to 1FFFh, or all, to their values at power-on. Returns the node id from now on.
     * NULL: the objects are set to their defaults, and the node id stays. */
    uint8_t (*load)(void *ctx, bool communication_only);
    /* LSS asks to store 2001h. false: that failed. */
    bool (*store_node)(void *ctx);
    /* A reset of the node, or of communication only; `load` has been called. Stop the machine and take over the values.
     * The boot-up message follows, then on_nmt. */
    void (*on_reset)(void *ctx, bool communication_only);
};

struct co_config {
    struct od_data *od;
    const struct hal *hal; /* can_send, can_bitrate, can_status */
    uint8_t node_id;       /* 1..127, or OD_UNCONFIGURED */
    struct co_hooks hooks;
};

/* Owned by the caller, who must not move it: the services point to each other. No field is for the caller's use, but
 * for config.node_id, the node id in use. */
struct co_node {
    struct co_config config;
    struct co_tx tx;
    struct co_nmt nmt;
    struct co_emcy emcy;
    struct co_bus_state bus_state;
    struct co_pdo pdo;
    struct co_sdo sdo, second_sdo; /* 1200h, 1201h */
    bool by_second;                /* what is handled now is a request to the second one */
    struct co_lss lss;
};

/* Power-on: send the boot-up message and enter pre-operational. The dictionary must be set up. */
void co_init(struct co_node *node, const struct co_config *config);
void co_receive(struct co_node *node, const struct can_frame *frame);
void co_tick_ms(struct co_node *node);

enum co_state co_nmt_state(const struct co_node *node);
/* Watch the heartbeat of node `id` in place of that of 1016h (co_nmt_watch). 0, or a reset: 1016h holds again. */
void co_watch_heartbeat(struct co_node *node, uint8_t id);
/* Whether the heartbeat that is watched has been lost, and has not come again since. */
bool co_heartbeat_lost(const struct co_node *node);
/* The same, or the master has ceased to guard the node. */
bool co_master_lost(const struct co_node *node);
/* Whether an RPDO that is watched has not come in time. */
bool co_rpdo_late(const struct co_node *node);

/* An error is in effect from now on (co_emcy_raise), or ends (co_emcy_clear). */
void co_emcy_set(struct co_node *node, uint16_t code, uint8_t reg, uint32_t details);
void co_emcy_reset(struct co_node *node, uint16_t code);
/* The i-th code in effect, oldest first; 0: there are not so many. */
uint16_t co_emcy_code(const struct co_node *node, unsigned i);
/* Whether an error that the node raises itself is in effect. */
bool co_emcy_of_node(const struct co_node *node);

/* Whether a master has opened the second SDO channel (1201h), and whether what a hook is called for came by it. */
bool co_has_second_sdo(const struct co_node *node);
bool co_by_second_sdo(const struct co_node *node);

/* An event has happened that TPDO `number` (1...) reports (co_pdo_send). false: it was not sent now. */
bool co_tpdo_send(struct co_node *node, unsigned number);
/* Whether RPDO or TPDO `number` (1...) carries a part of object `index`. */
bool co_rpdo_carries(const struct co_node *node, unsigned number, uint16_t index);
bool co_tpdo_carries(const struct co_node *node, unsigned number, uint16_t index);
/* Whether TPDO `number` (1...) is in use. */
bool co_tpdo_in_use(const struct co_node *node, unsigned number);
#endif
