/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/node.h"

#include <stddef.h>

enum { NMT_START = 1, NMT_STOP = 2, NMT_PRE_OPERATIONAL = 128, NMT_RESET_NODE = 129, NMT_RESET_COMMUNICATION = 130 };
enum { ID_NMT = 0x000, ID_SDO_REQUEST = 0x600, ID_HEARTBEAT = 0x700, ID_SERVICE = 0x780, ID_NODE = 0x07F };

void co_put(uint8_t *data, uint32_t value, uint8_t count)
{
    for (unsigned i = 0; i < count; i++) {
        data[i] = (uint8_t)(value >> (8 * i));
    }
}

uint32_t co_get(const uint8_t *data, uint8_t count)
{
    uint32_t value = 0;
    for (unsigned i = 0; i < count; i++) {
        value |= (uint32_t)data[i] << (8 * i);
    }
    return value;
}

bool co_transmit(struct co_node *node, const struct can_frame *frame)
{
    const struct hal *hal = node->config.hal;
    return node->lss.silent_ms == 0 && hal->can_send(hal->ctx, frame);
}

static void flush(struct co_node *node)
{
    unsigned sent = 0;
    while (sent < node->tx_count && co_transmit(node, &node->tx[sent])) {
        sent++;
    }
    node->tx_count = (uint8_t)(node->tx_count - sent);
    for (unsigned i = 0; i < node->tx_count; i++) {
        node->tx[i] = node->tx[i + sent];
    }
}

void co_send(struct co_node *node, const struct can_frame *frame)
{
    flush(node);
    if (node->tx_count == 0 && co_transmit(node, frame)) {
        return;
    }
    if (node->tx_count < CO_TX_FRAMES) {
        node->tx[node->tx_count++] = *frame;
    }
}

/* The heartbeat; state 0 is the boot-up message. */
static void send_heartbeat(struct co_node *node, uint8_t state)
{
    const struct can_frame frame = {.id = (uint16_t)(ID_HEARTBEAT + node->config.node_id), .len = 1, .data = {state}};
    node->producer_ms = 0;
    co_send(node, &frame);
}

static void enter(struct co_node *node, enum co_state state)
{
    if (node->state == state) {
        return;
    }
    node->state = state;
    if (state == CO_OPERATIONAL) {
        co_pdo_start(node);
    }
    if (node->config.hooks.on_nmt != NULL) {
        node->config.hooks.on_nmt(node->config.hooks.ctx, state);
    }
}

/* From initialisation, which no frame can see, to pre-operational; a node without id stays there. */
static void boot(struct co_node *node)
{
    const struct co_hooks *hooks = &node->config.hooks;
    node->state = CO_INITIALISING;
    node->sdo.transfer = CO_SDO_IDLE;
    co_watch_heartbeat(node, 0);
    co_emcy_refresh(node);
    co_pdo_refresh(node);
    co_lss_reset(node);
    if (node->config.node_id != OD_UNCONFIGURED) {
        send_heartbeat(node, 0);
        enter(node, CO_PRE_OPERATIONAL);
    } else if (hooks->on_nmt != NULL) {
        hooks->on_nmt(hooks->ctx, CO_INITIALISING);
    }
}

static void reset(struct co_node *node, bool communication_only)
{
    const struct co_hooks *hooks = &node->config.hooks;
    if (hooks->load != NULL) {
        node->config.node_id = hooks->load(hooks->ctx, communication_only);
    } else {
        od_restore(node->config.od, node->config.node_id, 0x1000, communication_only ? 0x1FFF : 0xFFFF);
    }
    if (!communication_only) {
        node->emcy = (struct co_emcy){0};
        node->config.od->error_register = 0;
    }
    if (hooks->on_reset != NULL) {
        hooks->on_reset(hooks->ctx, communication_only);
    }
    boot(node);
}

void co_reset_communication(struct co_node *node)
{
    reset(node, true);
}

void co_init(struct co_node *node, const struct co_config *config)
{
    *node = (struct co_node){.config = *config};
    boot(node);
}

enum co_state co_nmt_state(const struct co_node *node)
{
    return node->state;
}

void co_written(struct co_node *node, const struct od_entry *entry)
{
    if (entry->index == 0x1014 || entry->index == 0x1015) {
        co_emcy_refresh(node);
    } else if (entry->index == 0x1016 && node->guarded == 0) {
        node->consumer_left_ms = 0;
    } else if (entry->index == 0x1017) {
        node->producer_ms = 0;
    } else if (entry->index >= 0x1400 && entry->index < 0x1C00) {
        co_pdo_refresh(node);
    }
}

static void nmt(struct co_node *node, const struct can_frame *frame)
{
    const bool is_reset = frame->data[0] == NMT_RESET_NODE || frame->data[0] == NMT_RESET_COMMUNICATION;
    if (node->state == CO_INITIALISING && !is_reset) {
        return;
    }
    if (frame->len != 2 || (frame->data[1] != 0 && frame->data[1] != node->config.node_id)) {
        return;
    }
    switch (frame->data[0]) {
    case NMT_START: enter(node, CO_OPERATIONAL); break;
    case NMT_STOP: enter(node, CO_STOPPED); break;
    case NMT_PRE_OPERATIONAL: enter(node, CO_PRE_OPERATIONAL); break;
    case NMT_RESET_NODE: reset(node, false); break;
    case NMT_RESET_COMMUNICATION: reset(node, true); break;
    default: break;
    }
}

void co_watch_heartbeat(struct co_node *node, uint8_t id)
{
    const uint32_t consumer = node->config.od->heartbeat_consumer[0];
    const uint32_t time_ms =
        consumer >> 16 == id && (consumer & 0xFFFFu) != 0 ? consumer & 0xFFFFu : CO_HEARTBEAT_WATCH_MS;
    node->guarded = id != 0 ? (uint32_t)id << 16 | time_ms : 0u;
    node->consumer_left_ms = id != 0 ? time_ms + 1u : 0u;
}

/* 1016h:1 holds node << 16 | ms. */
static void heartbeat_seen(struct co_node *node, unsigned from)
{
    const uint32_t consumer = node->guarded != 0 ? node->guarded : node->config.od->heartbeat_consumer[0];
    const uint32_t time_ms = consumer & 0xFFFFu;
    if (time_ms != 0 && consumer >> 16 == from) {
        node->consumer_left_ms = time_ms + 1; /* never early: the first tick may follow at once */
    }
}

void co_receive(struct co_node *node, const struct can_frame *frame)
{
    if (frame->rtr) {
        return;
    }
    if (frame->id == ID_NMT) {
        nmt(node, frame);
    } else if (frame->id == CO_LSS_REQUEST) {
        co_lss_receive(node, frame);
    } else if (node->state == CO_INITIALISING) {
        return;
    } else if (frame->id == ID_SDO_REQUEST + node->config.node_id) {
        if (node->state != CO_STOPPED) {
            co_sdo_receive(node, frame);
        }
    } else if ((frame->id & ID_SERVICE) == ID_HEARTBEAT) {
        if (frame->len == 1 && frame->data[0] != 0) { /* 0 is a boot-up message: the node has just been away */
            heartbeat_seen(node, frame->id & ID_NODE);
        }
    } else if (node->state == CO_OPERATIONAL) {
        if (frame->id == (node->config.od->sync_cob_id & COB_ID_MASK)) {
            co_pdo_sync(node, frame);
        } else {
            co_pdo_receive(node, frame);
        }
    }
}

/* 1029h:1 says which NMT state follows. The application learns of the loss first: its stop may be gentler than the one
 * it makes of the state. */
static void heartbeat_lost(struct co_node *node)
{
    const struct co_hooks *hooks = &node->config.hooks;
    const uint8_t behaviour = node->config.od->error_behaviour.communication;
    if (hooks->on_heartbeat_lost != NULL) {
        hooks->on_heartbeat_lost(hooks->ctx);
    }
    if (behaviour == 2) {
        enter(node, CO_STOPPED);
    } else if (behaviour == 0 && node->state == CO_OPERATIONAL) {
        enter(node, CO_PRE_OPERATIONAL);
    }
}

void co_tick_ms(struct co_node *node)
{
    const uint16_t period_ms = node->config.od->heartbeat_producer;
    co_lss_tick_ms(node);
    flush(node);
    co_busstate_tick_ms(node);
    co_emcy_tick_ms(node);
    if (node->state != CO_INITIALISING && period_ms != 0 && ++node->producer_ms >= period_ms) {
        send_heartbeat(node, (uint8_t)node->state);
    }
    if (node->consumer_left_ms != 0 && --node->consumer_left_ms == 0) {
        heartbeat_lost(node);
    }
    if (node->state == CO_OPERATIONAL) {
        co_pdo_tick_ms(node);
    }
    co_sdo_tick_ms(node); /* last: PDOs go first */
}
