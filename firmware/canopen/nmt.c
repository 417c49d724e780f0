/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/nmt.h"

enum { NODE_ID_MASK = 0x07F };

void co_nmt_init(struct co_nmt *nmt, const struct od_data *od, struct co_tx *tx)
{
    *nmt = (struct co_nmt){.od = od, .tx = tx, .node_id = OD_UNCONFIGURED, .state = CO_INITIALISING};
}

static void end_guarding(struct co_nmt *nmt)
{
    nmt->guard_left_ms = 0;
    nmt->guard_lost = false;
}

void co_nmt_reset(struct co_nmt *nmt, uint8_t node_id)
{
    nmt->node_id = node_id;
    nmt->state = CO_INITIALISING;
    nmt->toggle = 0;
    end_guarding(nmt);
    co_nmt_watch(nmt, 0);
}

bool co_nmt_enter(struct co_nmt *nmt, enum co_state state)
{
    const bool changed = nmt->state != state;
    nmt->state = state;
    return changed;
}

enum co_nmt_command co_nmt_decode(const struct co_nmt *nmt, const struct can_frame *frame)
{
    const enum co_nmt_command command = (enum co_nmt_command)frame->data[0];
    const bool is_reset = command == CO_NMT_RESET_NODE || command == CO_NMT_RESET_COMMUNICATION;
    if (nmt->state == CO_INITIALISING && !is_reset) {
        return CO_NMT_NONE;
    }
    if (frame->len != 2 || (frame->data[1] != 0 && frame->data[1] != nmt->node_id)) {
        return CO_NMT_NONE;
    }
    return command;
}

/* ---- heartbeat producer ---- */

static void send_state(const struct co_nmt *nmt, unsigned state)
{
    const struct can_frame frame = {
        .id = (uint16_t)(CO_HEARTBEAT_ID + nmt->node_id), .len = 1, .data = {(uint8_t)state}};
    co_tx_send(nmt->tx, &frame);
}

static void send_heartbeat(struct co_nmt *nmt, uint8_t state)
{
    nmt->producer_ms = 0;
    send_state(nmt, state);
}

void co_nmt_send_boot_up(struct co_nmt *nmt)
{
    send_heartbeat(nmt, CO_INITIALISING);
}

/* ---- heartbeat consumer ---- */

/* 1016h:1 holds the node id << 16 | the time in ms. */
static uint32_t time_of(uint32_t consumer)
{
    return consumer & 0xFFFFu;
}

static uint32_t node_of(uint32_t consumer)
{
    return consumer >> 16;
}

/* The time begins anew. The first tick may follow at once; with one tick more a loss is never detected early. */
static void restart(struct co_nmt *nmt, uint32_t time_ms)
{
    nmt->consumer_left_ms = time_ms + 1u;
    nmt->lost = false;
}

static void end_watch(struct co_nmt *nmt)
{
    nmt->consumer_left_ms = 0;
    nmt->lost = false;
}

void co_nmt_watch(struct co_nmt *nmt, uint8_t id)
{
    const uint32_t consumer = nmt->od->heartbeat_consumer[0];
    const bool has_time = node_of(consumer) == id && time_of(consumer) != 0;
    const uint32_t time_ms = has_time ? time_of(consumer) : CO_HEARTBEAT_WATCH_MS;
    if (id != 0) {
        nmt->watched = (uint32_t)id << 16 | time_ms;
        restart(nmt, time_ms);
    } else {
        nmt->watched = 0;
        end_watch(nmt);
    }
}

void co_nmt_heartbeat(struct co_nmt *nmt, const struct can_frame *frame)
{
    const uint32_t consumer = nmt->watched != 0 ? nmt->watched : nmt->od->heartbeat_consumer[0];
    if (frame->len != 1 || frame->data[0] == CO_INITIALISING) { /* a boot-up message: the node has just been away */
        return;
    }
    if (time_of(consumer) != 0 && node_of(consumer) == (frame->id & NODE_ID_MASK)) {
        restart(nmt, time_of(consumer));
    }
}

/* ---- node guarding ---- */

void co_nmt_guard(struct co_nmt *nmt)
{
    const uint32_t time_ms = (uint32_t)nmt->od->guard_time * nmt->od->life_time_factor;
    send_state(nmt, (unsigned)nmt->state | nmt->toggle);
    nmt->toggle ^= 0x80u;
    nmt->guard_left_ms = time_ms != 0 ? time_ms + 1u : 0u; /* see restart() */
    nmt->guard_lost = false;
}

/* ---- all ---- */

void co_nmt_written(struct co_nmt *nmt, uint16_t index)
{
    if (index == OBJ_HEARTBEAT_CONSUMER && nmt->watched == 0) {
        end_watch(nmt);
    }
    if (index == OBJ_HEARTBEAT_PRODUCER) {
        nmt->producer_ms = 0;
    }
    if (index == OBJ_GUARD_TIME || index == OBJ_LIFE_TIME_FACTOR) {
        end_guarding(nmt);
    }
}

/* A millisecond less. true: these were all. */
static bool expires(uint32_t *left_ms)
{
    const bool was_left = *left_ms != 0;
    *left_ms -= was_left ? 1u : 0u;
    return was_left && *left_ms == 0;
}

bool co_nmt_tick_ms(struct co_nmt *nmt)
{
    const uint16_t period_ms = nmt->od->heartbeat_producer;
    if (nmt->state != CO_INITIALISING && period_ms != 0 && ++nmt->producer_ms >= period_ms) {
        send_heartbeat(nmt, (uint8_t)nmt->state);
    }
    const bool lost = expires(&nmt->consumer_left_ms);
    const bool guard_lost = expires(&nmt->guard_left_ms);
    nmt->lost = nmt->lost || lost;
    nmt->guard_lost = nmt->guard_lost || guard_lost;
    return lost || guard_lost;
}
