/* SPDX-License-Identifier: Apache-2.0 */
/* nmt.h: the state of the node, and heartbeats (CiA 301, 7.2.8 and 7.3.2).
 *
 * NMT is network management: a master starts, stops and resets the nodes of its bus. This module keeps the state,
 * decodes the master's commands, sends the node's own heartbeat (1017h) and watches that of another node (1016h).
 * What a change of state means for the other services is up to the caller, node.c. Background only.
 *
 * Node guarding (100Ch, 100Dh) is the older service that heartbeats replace. The master asks for the state by a remote
 * frame, whose answers have a bit that toggles. Once it has asked, it is watched as by its heartbeat.
 */
#ifndef CO_NMT_H
#define CO_NMT_H
#include <stdbool.h>
#include <stdint.h>

#include "canopen/tx.h"
#include "od/od.h"

/* A node without id stays in CO_INITIALISING. The values are those of the heartbeat's byte. */
enum co_state { CO_INITIALISING = 0, CO_STOPPED = 4, CO_OPERATIONAL = 5, CO_PRE_OPERATIONAL = 127 };

/* The values are those of the command's byte; CO_NMT_NONE is no command of CiA 301. */
enum co_nmt_command {
    CO_NMT_NONE = 0,
    CO_NMT_START = 1,
    CO_NMT_STOP = 2,
    CO_NMT_ENTER_PRE_OPERATIONAL = 128,
    CO_NMT_RESET_NODE = 129,
    CO_NMT_RESET_COMMUNICATION = 130,
};

enum { CO_NMT_COMMAND_ID = 0x000, CO_HEARTBEAT_ID = 0x700 }; /* frame identifiers; of a heartbeat plus the node id */
#define CO_HEARTBEAT_WATCH_MS 500u

struct co_nmt {
    const struct od_data *od; /* 100Ch, 100Dh, 1016h, 1017h */
    struct co_tx *tx;
    uint8_t node_id; /* since the last reset, or OD_UNCONFIGURED */
    enum co_state state;
    uint16_t producer_ms;      /* since the node's last heartbeat */
    uint32_t watched;          /* node id << 16 | ms, in place of 1016h, by co_nmt_watch(); 0: 1016h holds */
    uint32_t consumer_left_ms; /* time until the watched heartbeat counts as lost; 0: none is awaited */
    bool lost;                 /* the watched heartbeat, until it comes again or another one is to be watched */
    uint32_t guard_left_ms;    /* the same of node guarding: time until the master is to have asked again, */
    bool guard_lost;           /* and whether it has not */
    uint8_t toggle;            /* bit 7 of the next answer */
};

/* Power-on. co_nmt_reset() is to follow. */
void co_nmt_init(struct co_nmt *nmt, const struct od_data *od, struct co_tx *tx);
/* The node is initialising from now on, has this node id, and watches nobody until the next heartbeat of 1016h. */
void co_nmt_reset(struct co_nmt *nmt, uint8_t node_id);
void co_nmt_send_boot_up(struct co_nmt *nmt);
/* Enter a state. false: it is the present one. */
bool co_nmt_enter(struct co_nmt *nmt, enum co_state state);
/* The command in a frame with the identifier CO_NMT_COMMAND_ID, or CO_NMT_NONE when it does not apply: it is for
 * another node, malformed, or a command other than a reset for a node without id. */
enum co_nmt_command co_nmt_decode(const struct co_nmt *nmt, const struct can_frame *frame);

/* A frame with an identifier from CO_HEARTBEAT_ID on has come. */
void co_nmt_heartbeat(struct co_nmt *nmt, const struct can_frame *frame);
/* A remote frame with the identifier of the node's own heartbeat has come: the master asks for the state. */
void co_nmt_guard(struct co_nmt *nmt);
/* Watch the heartbeat of node `id` in place of that of 1016h, from now on and not from its first heartbeat only. The
 * time is that of 1016h where 1016h names this node, else CO_HEARTBEAT_WATCH_MS. 0: 1016h holds again, from its next
 * heartbeat on. */
void co_nmt_watch(struct co_nmt *nmt, uint8_t id);
/* An SDO has written the object `index`. */
void co_nmt_written(struct co_nmt *nmt, uint16_t index);
/* Send the node's heartbeat when it is due. true: the watched heartbeat, or the master that guarded the node, has just
 * been lost, which is reported once. */
bool co_nmt_tick_ms(struct co_nmt *nmt);
#endif
