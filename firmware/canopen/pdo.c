/* SPDX-License-Identifier: Apache-2.0 */
#include "pdo.h"

#include <stddef.h>

#include "node.h"

#define COB_UNUSED 0x80000000u
#define COB_NO_RTR 0x40000000u
#define COB_ID_MASK 0x7FFu

static int64_t read_object(const struct od_data *od, unsigned index, unsigned sub)
{
    uint32_t abort = 0;
    const struct od_entry *e = od_find((uint16_t)index, (uint8_t)sub, &abort);
    return e ? od_read(od, e) : 0;
}

static void refresh(const struct od_data *od, struct co_pdo *pdo, unsigned index)
{
    const uint32_t cob = (uint32_t)read_object(od, index, 1);
    pdo->id = (cob & COB_UNUSED) ? 0 : (uint16_t)(cob & COB_ID_MASK);
    pdo->event_ms = (uint16_t)read_object(od, index, 5);
}

/* Mapping value: index << 16 | sub << 8 | bits. */
static void resolve(const struct od_data *od, struct co_pdo *pdo, unsigned index)
{
    *pdo = (struct co_pdo){0};
    const unsigned count = (unsigned)read_object(od, index, 0);
    for (unsigned i = 1; i <= count && i <= CO_PDO_ENTRIES; i++) {
        const uint32_t map = (uint32_t)read_object(od, index, i);
        uint32_t abort = 0;
        const struct od_entry *e = od_find((uint16_t)(map >> 16), (uint8_t)(map >> 8), &abort);
        if (e != NULL) {
            pdo->entry[pdo->count++] = e;
            pdo->bytes = (uint8_t)(pdo->bytes + od_size(e));
        }
    }
}

void co_pdo_init(struct co_node *node)
{
    const struct od_data *od = node->config.od;
    for (unsigned i = 0; i < CO_RPDOS; i++) {
        resolve(od, &node->rpdo[i], 0x1600 + i);
    }
    for (unsigned i = 0; i < CO_TPDOS; i++) {
        resolve(od, &node->tpdo[i], 0x1A00 + i);
    }
    co_pdo_refresh(node);
}

void co_pdo_refresh(struct co_node *node)
{
    const struct od_data *od = node->config.od;
    for (unsigned i = 0; i < CO_RPDOS; i++) {
        refresh(od, &node->rpdo[i], 0x1400 + i);
    }
    for (unsigned i = 0; i < CO_TPDOS; i++) {
        refresh(od, &node->tpdo[i], 0x1800 + i);
    }
}

void co_pdo_start(struct co_node *node)
{
    for (unsigned i = 0; i < CO_TPDOS; i++) {
        node->tpdo[i].elapsed_ms = node->tpdo[i].event_ms;
    }
}

/* CiA 301, table 37: identifiers that other services use. */
static bool is_restricted(uint32_t id)
{
    return id < 0x80 || (id > 0x100 && id <= 0x180) || (id > 0x580 && id < 0x600) || (id > 0x600 && id < 0x680) ||
           (id >= 0x6E0);
}

uint32_t co_pdo_check(const struct co_node *node, const struct od_entry *entry, int64_t value)
{
    const bool communication = (entry->index & 0xFE00u) == 0x1400 || (entry->index & 0xFE00u) == 0x1800;
    if (!communication || entry->sub != 1) {
        return SDO_OK;
    }
    const uint32_t cob = (uint32_t)value;
    const uint32_t now = (uint32_t)od_read(node->config.od, entry);
    if ((cob & ~(COB_UNUSED | COB_NO_RTR | COB_ID_MASK)) != 0) {
        return SDO_ABORT_VALUE;
    }
    if (!(cob & COB_UNUSED) && is_restricted(cob & COB_ID_MASK)) {
        return SDO_ABORT_VALUE;
    }
    if (!((cob | now) & COB_UNUSED) && ((cob ^ now) & COB_ID_MASK)) {
        return SDO_ABORT_VALUE;
    }
    return SDO_OK;
}

void co_pdo_receive(struct co_node *node, const struct can_frame *frame)
{
    for (unsigned i = 0; i < CO_RPDOS; i++) {
        const struct co_pdo *pdo = &node->rpdo[i];
        if (pdo->id == 0 || pdo->id != frame->id) {
            continue;
        }
        if (frame->len < pdo->bytes) {
            co_emcy_set(node, CO_EMCY_PDO_SHORT, CO_REG_COMMUNICATION, i + 1);
            return;
        }
        co_emcy_reset(node, CO_EMCY_PDO_SHORT);
        if (frame->len > pdo->bytes) { /* the rest is ignored */
            co_emcy_set(node, CO_EMCY_PDO_LONG, CO_REG_COMMUNICATION, i + 1);
        } else {
            co_emcy_reset(node, CO_EMCY_PDO_LONG);
        }
        const uint8_t *at = frame->data;
        for (unsigned k = 0; k < pdo->count; k++) {
            od_write(node->config.od, pdo->entry[k], od_decode(pdo->entry[k], at));
            at += od_size(pdo->entry[k]);
        }
        if (node->config.hooks.on_rpdo != NULL) {
            node->config.hooks.on_rpdo(node->config.hooks.ctx, i + 1);
        }
        return;
    }
}

bool co_tpdo_send(struct co_node *node, unsigned number)
{
    struct co_pdo *pdo = &node->tpdo[number - 1];
    /* Frames that wait go first, and a late PDO is worth nothing: it is not kept. */
    if (node->state != CO_OPERATIONAL || pdo->id == 0 || node->tx_count > 0) {
        return false;
    }
    struct can_frame frame = {.id = pdo->id, .len = pdo->bytes};
    uint8_t *at = frame.data;
    for (unsigned k = 0; k < pdo->count; k++) {
        const uint8_t size = od_size(pdo->entry[k]);
        co_put(at, (uint32_t)od_read(node->config.od, pdo->entry[k]), size);
        at += size;
    }
    if (!node->config.hal->can_send(node->config.hal->ctx, &frame)) {
        return false;
    }
    pdo->elapsed_ms = 0;
    return true;
}

void co_pdo_tick_ms(struct co_node *node)
{
    for (unsigned i = 0; i < CO_TPDOS; i++) {
        struct co_pdo *pdo = &node->tpdo[i];
        if (pdo->event_ms == 0) {
            continue;
        }
        if (pdo->elapsed_ms < pdo->event_ms) {
            pdo->elapsed_ms++;
        }
        if (pdo->elapsed_ms >= pdo->event_ms) {
            (void)co_tpdo_send(node, i + 1);
        }
    }
}
