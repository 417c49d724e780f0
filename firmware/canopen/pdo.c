/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/pdo.h"

#include <stddef.h>
#include <string.h>

#include "canopen/node.h"

/* Data types 0002h..0007h may fill gaps of an RPDO (CiA 301, dummy mapping): what is there is not stored. */
static const struct od_entry dummies[] = {
    {.index = 2, .type = OD_I8, .flags = OD_WRITE | OD_PDO},  {.index = 3, .type = OD_I16, .flags = OD_WRITE | OD_PDO},
    {.index = 4, .type = OD_I32, .flags = OD_WRITE | OD_PDO}, {.index = 5, .type = OD_U8, .flags = OD_WRITE | OD_PDO},
    {.index = 6, .type = OD_U16, .flags = OD_WRITE | OD_PDO}, {.index = 7, .type = OD_U32, .flags = OD_WRITE | OD_PDO},
};
enum { DUMMY_FIRST = 2, DUMMY_LAST = 7 };

const struct od_entry *co_pdo_mappable(uint32_t map, bool transmit, uint32_t *code)
{
    const uint16_t index = (uint16_t)(map >> 16);
    const uint8_t sub = (uint8_t)(map >> 8);
    const bool dummy = index >= DUMMY_FIRST && index <= DUMMY_LAST && sub == 0;
    const struct od_entry *e = dummy ? &dummies[index - DUMMY_FIRST] : od_find(index, sub, code);
    if (e == NULL) {
        *code = SDO_ABORT_NO_OBJECT;
    } else if (!(e->flags & OD_PDO) || !(e->flags & (transmit ? OD_READ : OD_WRITE))) {
        *code = SDO_ABORT_NO_MAPPING;
    } else if ((map & 0xFFu) != 8u * od_size(e)) {
        *code = SDO_ABORT_PDO_LENGTH;
    } else {
        return e;
    }
    return NULL;
}

static void resolve(const struct od_data *od, struct co_pdo *pdo, unsigned communication)
{
    const unsigned mapping = communication + 0x200;
    const bool transmit = communication >= 0x1800;
    const uint32_t cob = (uint32_t)od_number(od, communication, 1);
    *pdo = (struct co_pdo){.type = (uint8_t)od_number(od, communication, 2)};
    const unsigned count = (unsigned)od_number(od, mapping, 0);
    for (unsigned i = 1; i <= count; i++) {
        uint32_t code = SDO_OK;
        const struct od_entry *e = co_pdo_mappable((uint32_t)od_number(od, mapping, i), transmit, &code);
        if (e == NULL || pdo->bytes + od_size(e) > 8) { /* a stored mapping may be another firmware's: not half of it */
            pdo->count = 0;
            break;
        }
        pdo->entry[pdo->count++] = e;
        pdo->bytes = (uint8_t)(pdo->bytes + od_size(e));
    }
    pdo->id = (cob & COB_UNUSED) || pdo->count == 0 ? 0 : (uint16_t)(cob & COB_ID_MASK);
    if (transmit) {
        pdo->inhibit_ms = (uint16_t)((od_number(od, communication, 3) + 9) / 10); /* of 100 us */
        pdo->event_ms = (uint16_t)od_number(od, communication, 5);
        pdo->sync_start = (uint8_t)od_number(od, communication, 6);
    }
}

void co_pdo_refresh(struct co_node *node)
{
    const struct od_data *od = node->config.od;
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        resolve(od, &node->rpdo[i], 0x1400 + i);
    }
    for (unsigned i = 0; i < OD_TPDOS; i++) {
        resolve(od, &node->tpdo[i], 0x1800 + i);
    }
}

void co_pdo_start(struct co_node *node)
{
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        node->rpdo[i].pending = false;
    }
    for (unsigned i = 0; i < OD_TPDOS; i++) {
        struct co_pdo *pdo = &node->tpdo[i];
        pdo->pending = false;
        pdo->counting = pdo->sync_start == 0 || node->config.od->sync_overflow == 0;
        pdo->syncs = 0;
        pdo->elapsed_ms = pdo->event_ms;
        pdo->inhibit_left_ms = 0;
    }
}

/* ---- received ---- */

/* All values are within the ranges of their objects. */
static bool in_range(const struct co_pdo *pdo, const uint8_t *data)
{
    for (unsigned k = 0; k < pdo->count; k++) {
        const struct od_entry *e = pdo->entry[k];
        if (e->index > DUMMY_LAST && od_check(e, od_decode(e, data)) != SDO_OK) {
            return false;
        }
        data += od_size(e);
    }
    return true;
}

/* All of it or nothing. */
static void store(struct co_node *node, unsigned i, const uint8_t *data)
{
    const struct co_pdo *pdo = &node->rpdo[i];
    if (!in_range(pdo, data)) {
        node->config.od->stream.rejected_range++;
        return;
    }
    for (unsigned k = 0; k < pdo->count; k++) {
        const struct od_entry *e = pdo->entry[k];
        if (e->index > DUMMY_LAST) {
            od_write(node->config.od, e, od_decode(e, data));
        }
        data += od_size(e);
    }
    if (node->config.hooks.on_rpdo != NULL) {
        node->config.hooks.on_rpdo(node->config.hooks.ctx, i + 1);
    }
}

static void receive(struct co_node *node, unsigned i, const struct can_frame *frame)
{
    struct co_pdo *pdo = &node->rpdo[i];
    if (frame->len != pdo->bytes) {
        node->config.od->stream.rejected_length++;
        co_emcy_set(node, frame->len < pdo->bytes ? CO_EMCY_PDO_SHORT : CO_EMCY_PDO_LONG, CO_REG_COMMUNICATION, i + 1);
        return;
    }
    co_emcy_reset(node, CO_EMCY_PDO_SHORT);
    co_emcy_reset(node, CO_EMCY_PDO_LONG);
    if (pdo->type <= PDO_SYNC_MAX) {
        memcpy(pdo->data, frame->data, sizeof pdo->data);
        pdo->pending = true;
    } else {
        store(node, i, frame->data);
    }
}

void co_pdo_receive(struct co_node *node, const struct can_frame *frame)
{
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        if (node->rpdo[i].id == frame->id) { /* 0, not in use, is NMT's */
            receive(node, i, frame);
            return;
        }
    }
}

static bool carries(const struct co_pdo *pdo, uint16_t index)
{
    for (unsigned k = 0; k < pdo->count; k++) {
        if (pdo->entry[k]->index == index) {
            return true;
        }
    }
    return false;
}

bool co_rpdo_carries(const struct co_node *node, unsigned number, uint16_t index)
{
    return carries(&node->rpdo[number - 1], index);
}

bool co_tpdo_carries(const struct co_node *node, unsigned number, uint16_t index)
{
    return carries(&node->tpdo[number - 1], index);
}

/* ---- transmitted ---- */

/* An inhibit time of `inhibit_ms` ticks begins. */
static bool transmit(struct co_node *node, struct co_pdo *pdo, unsigned inhibit_ms)
{
    struct can_frame frame = {.id = pdo->id, .len = pdo->bytes};
    uint8_t *at = frame.data;
    /* Frames that wait go first. Of this one only what is true when it leaves is worth something: it is not kept. */
    if (node->tx_count > 0) {
        return false;
    }
    for (unsigned k = 0; k < pdo->count; k++) {
        const uint8_t size = od_size(pdo->entry[k]);
        co_put(at, (uint32_t)od_read(node->config.od, pdo->entry[k]), size);
        at += size;
    }
    if (!co_transmit(node, &frame)) {
        return false;
    }
    pdo->pending = false;
    pdo->syncs = 0;
    pdo->elapsed_ms = 0;
    pdo->inhibit_left_ms = (uint16_t)inhibit_ms;
    if (node->config.hooks.on_tpdo != NULL) {
        node->config.hooks.on_tpdo(node->config.hooks.ctx, (unsigned)(pdo - node->tpdo) + 1u);
    }
    return true;
}

bool co_tpdo_send(struct co_node *node, unsigned number)
{
    struct co_pdo *pdo = &node->tpdo[number - 1];
    if (node->state != CO_OPERATIONAL || pdo->id == 0) {
        return false;
    }
    pdo->pending = true;
    /* the next tick may follow at once: one more */
    return pdo->type >= PDO_EVENT && pdo->inhibit_left_ms == 0 &&
           transmit(node, pdo, pdo->inhibit_ms != 0 ? pdo->inhibit_ms + 1u : 0u);
}

void co_pdo_tick_ms(struct co_node *node)
{
    for (unsigned i = 0; i < OD_TPDOS; i++) {
        struct co_pdo *pdo = &node->tpdo[i];
        if (pdo->id == 0 || pdo->type < PDO_EVENT) {
            continue;
        }
        if (pdo->inhibit_left_ms > 0) {
            pdo->inhibit_left_ms--;
        }
        if (pdo->elapsed_ms < pdo->event_ms) {
            pdo->elapsed_ms++;
        }
        const bool due = pdo->event_ms != 0 && pdo->elapsed_ms >= pdo->event_ms;
        if ((due || pdo->pending) && pdo->inhibit_left_ms == 0) {
            (void)transmit(node, pdo, pdo->inhibit_ms);
        }
    }
}

/* ---- SYNC ---- */

static void tpdo_sync(struct co_node *node, struct co_pdo *pdo, const struct can_frame *frame)
{
    if (pdo->type == 0) {
        if (pdo->pending) {
            (void)transmit(node, pdo, 0);
        }
        return;
    }
    pdo->counting = pdo->counting || frame->data[0] == pdo->sync_start;
    if (pdo->counting && pdo->syncs < pdo->type) {
        pdo->syncs++;
    }
    if (pdo->syncs >= pdo->type) {
        (void)transmit(node, pdo, 0);
    }
}

void co_pdo_sync(struct co_node *node, const struct can_frame *frame)
{
    const unsigned len = node->config.od->sync_overflow != 0 ? 1 : 0;
    if (frame->len != len) {
        co_emcy_set(node, CO_EMCY_SYNC_LENGTH, CO_REG_COMMUNICATION, frame->len);
        return;
    }
    co_emcy_reset(node, CO_EMCY_SYNC_LENGTH);
    for (unsigned i = 0; i < OD_TPDOS; i++) {
        if (node->tpdo[i].id != 0 && node->tpdo[i].type <= PDO_SYNC_MAX) {
            tpdo_sync(node, &node->tpdo[i], frame);
        }
    }
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        if (node->rpdo[i].pending) {
            node->rpdo[i].pending = false;
            store(node, i, node->rpdo[i].data);
        }
    }
}
