/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/pdo.h"

#include <stddef.h>
#include <string.h>

#include "canopen/frame.h"

/* Dummy mapping (CiA 301): an RPDO may have gaps, which are mapped to the index of a data type and not stored. */
enum { DUMMY_FIRST = 0x0002, DUMMY_LAST = 0x0007 };
static const struct od_entry dummies[] = {
    {.index = 0x0002, .type = OD_I8, .flags = OD_WRITE | OD_PDO},
    {.index = 0x0003, .type = OD_I16, .flags = OD_WRITE | OD_PDO},
    {.index = 0x0004, .type = OD_I32, .flags = OD_WRITE | OD_PDO},
    {.index = 0x0005, .type = OD_U8, .flags = OD_WRITE | OD_PDO},
    {.index = 0x0006, .type = OD_U16, .flags = OD_WRITE | OD_PDO},
    {.index = 0x0007, .type = OD_U32, .flags = OD_WRITE | OD_PDO},
};

void co_pdo_init(struct co_pdo *pdo, struct od_data *od, struct co_tx *tx, struct co_emcy *emcy,
                 const struct co_pdo_hooks *hooks)
{
    *pdo = (struct co_pdo){.od = od, .tx = tx, .emcy = emcy, .hooks = *hooks};
}

/* ---- mapping ---- */

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

bool co_pdo_carries(const struct co_pdo_mapping *mapping, uint16_t index)
{
    for (unsigned k = 0; k < mapping->count; k++) {
        if (mapping->entry[k]->index == index) {
            return true;
        }
    }
    return false;
}

/* Empty when an entry cannot be mapped: a stored mapping may be another firmware's, and half of it is of no use. */
static struct co_pdo_mapping resolve_mapping(const struct od_data *od, unsigned index, bool transmit)
{
    struct co_pdo_mapping mapping = {0};
    const unsigned count = (unsigned)od_number(od, index, 0);
    for (unsigned i = 1; i <= count; i++) {
        uint32_t code = SDO_OK;
        const struct od_entry *e = co_pdo_mappable((uint32_t)od_number(od, index, i), transmit, &code);
        if (e == NULL || mapping.bytes + od_size(e) > 8) {
            return (struct co_pdo_mapping){0};
        }
        mapping.entry[mapping.count++] = e;
        mapping.bytes = (uint8_t)(mapping.bytes + od_size(e));
    }
    return mapping;
}

static uint16_t resolve_id(const struct od_data *od, unsigned index, const struct co_pdo_mapping *mapping)
{
    const uint32_t cob_id = (uint32_t)od_number(od, index, SUB_RPDO1_COB_ID);
    return (cob_id & COB_UNUSED) || mapping->count == 0 ? 0 : (uint16_t)(cob_id & COB_ID_MASK);
}

static void resolve_rpdo(const struct od_data *od, struct co_rpdo *rpdo, unsigned i)
{
    const unsigned index = OBJ_RPDO1 + i;
    *rpdo = (struct co_rpdo){.mapping = resolve_mapping(od, OBJ_RPDO1_MAP + i, false),
                             .type = (uint8_t)od_number(od, index, SUB_RPDO1_TYPE),
                             .event_ms = (uint16_t)od_number(od, index, SUB_RPDO1_EVENT_MS)};
    rpdo->id = resolve_id(od, index, &rpdo->mapping);
}

static void resolve_tpdo(const struct od_data *od, struct co_tpdo *tpdo, unsigned i)
{
    const unsigned index = OBJ_TPDO1 + i;
    *tpdo =
        (struct co_tpdo){.mapping = resolve_mapping(od, OBJ_TPDO1_MAP + i, true),
                         .type = (uint8_t)od_number(od, index, SUB_TPDO1_TYPE),
                         .inhibit_ms = (uint16_t)((od_number(od, index, SUB_TPDO1_INHIBIT) + 9) / 10), /* of 100 us */
                         .event_ms = (uint16_t)od_number(od, index, SUB_TPDO1_EVENT_MS),
                         .sync_start = (uint8_t)od_number(od, index, SUB_TPDO1_SYNC_START)};
    tpdo->id = resolve_id(od, index, &tpdo->mapping);
}

void co_pdo_refresh(struct co_pdo *pdo)
{
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        resolve_rpdo(pdo->od, &pdo->rpdo[i], i);
    }
    for (unsigned i = 0; i < OD_TPDOS; i++) {
        resolve_tpdo(pdo->od, &pdo->tpdo[i], i);
    }
}

static void start_tpdo(const struct co_pdo *pdo, struct co_tpdo *tpdo)
{
    tpdo->pending = false;
    tpdo->counting = tpdo->sync_start == 0 || pdo->od->sync_overflow == 0;
    tpdo->syncs = 0;
    tpdo->elapsed_ms = tpdo->event_ms;
    tpdo->inhibit_left_ms = 0;
}

/* The node may be operational: what other PDOs wait for goes on. */
void co_pdo_written(struct co_pdo *pdo, uint16_t index)
{
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        if (index == OBJ_RPDO1 + i || index == OBJ_RPDO1_MAP + i) {
            resolve_rpdo(pdo->od, &pdo->rpdo[i], i);
        }
    }
    for (unsigned i = 0; i < OD_TPDOS; i++) {
        if (index == OBJ_TPDO1 + i || index == OBJ_TPDO1_MAP + i) {
            resolve_tpdo(pdo->od, &pdo->tpdo[i], i);
            start_tpdo(pdo, &pdo->tpdo[i]);
        }
    }
}

void co_pdo_start(struct co_pdo *pdo)
{
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        pdo->rpdo[i].pending = false;
        pdo->rpdo[i].late = false;
        pdo->rpdo[i].left_ms = 0;
    }
    co_emcy_clear(pdo->emcy, CO_EMCY_PDO_LATE);
    for (unsigned i = 0; i < OD_TPDOS; i++) {
        start_tpdo(pdo, &pdo->tpdo[i]);
    }
}

/* ---- received ---- */

bool co_pdo_late(const struct co_pdo *pdo)
{
    bool any = false;
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        any = any || pdo->rpdo[i].late;
    }
    return any;
}

/* Its time begins anew. The first tick may follow at once; with one tick more a frame is never late too early. */
static void in_time(struct co_pdo *pdo, struct co_rpdo *rpdo)
{
    rpdo->left_ms = rpdo->event_ms != 0 ? rpdo->event_ms + 1u : 0u;
    rpdo->late = false;
    if (!co_pdo_late(pdo)) {
        co_emcy_clear(pdo->emcy, CO_EMCY_PDO_LATE);
    }
}

static void watch_rpdo(struct co_pdo *pdo, unsigned i)
{
    struct co_rpdo *rpdo = &pdo->rpdo[i];
    if (rpdo->left_ms == 0) {
        return;
    }
    rpdo->left_ms--;
    if (rpdo->left_ms == 0) {
        rpdo->late = true;
        co_emcy_raise(pdo->emcy, CO_EMCY_PDO_LATE, CO_REG_COMMUNICATION, i + 1u);
    }
}

static bool any_refused(const struct co_pdo *pdo)
{
    bool any = false;
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        any = any || pdo->rpdo[i].refused;
    }
    return any;
}

/* A value of RPDO `i` that its object does not take */
static void refuse(struct co_pdo *pdo, unsigned i, const struct od_entry *e)
{
    pdo->rpdo[i].refused = true;
    co_emcy_raise(pdo->emcy, CO_EMCY_PDO_VALUE, CO_REG_COMMUNICATION,
                  (uint32_t)e->index << 16 | (uint32_t)e->sub << 8 | (i + 1u));
}

static void store_value(struct co_pdo *pdo, unsigned i, const struct od_entry *e, const uint8_t *data)
{
    const int64_t value = od_decode(e, data);
    if (od_check(e, value) == SDO_OK && pdo->hooks.check_rpdo(pdo->hooks.ctx, e, value) == SDO_OK) {
        od_write(pdo->od, e, value);
    } else {
        refuse(pdo, i, e);
    }
}

/* Store the values of RPDO `i`, but for those that are refused. */
static void store(struct co_pdo *pdo, unsigned i, const uint8_t *data)
{
    struct co_rpdo *rpdo = &pdo->rpdo[i];
    rpdo->refused = false;
    for (unsigned k = 0; k < rpdo->mapping.count; k++) {
        const struct od_entry *e = rpdo->mapping.entry[k];
        if (e->index > DUMMY_LAST) {
            store_value(pdo, i, e, data);
        }
        data += od_size(e);
    }
    pdo->od->stream.rejected_range += rpdo->refused ? 1u : 0u;
    if (!any_refused(pdo)) {
        co_emcy_clear(pdo->emcy, CO_EMCY_PDO_VALUE);
    }
    pdo->hooks.on_rpdo(pdo->hooks.ctx, i + 1);
}

static void receive(struct co_pdo *pdo, unsigned i, const struct can_frame *frame)
{
    struct co_rpdo *rpdo = &pdo->rpdo[i];
    if (frame->len != rpdo->mapping.bytes) {
        const uint16_t code = frame->len < rpdo->mapping.bytes ? CO_EMCY_PDO_SHORT : CO_EMCY_PDO_LONG;
        pdo->od->stream.rejected_length++;
        co_emcy_raise(pdo->emcy, code, CO_REG_COMMUNICATION, i + 1);
        return;
    }
    co_emcy_clear(pdo->emcy, CO_EMCY_PDO_SHORT);
    co_emcy_clear(pdo->emcy, CO_EMCY_PDO_LONG);
    in_time(pdo, rpdo);
    if (rpdo->type <= PDO_SYNC_MAX) {
        memcpy(rpdo->data, frame->data, sizeof rpdo->data);
        rpdo->pending = true;
    } else {
        store(pdo, i, frame->data);
    }
}

void co_pdo_receive(struct co_pdo *pdo, const struct can_frame *frame)
{
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        if (pdo->rpdo[i].id == frame->id) { /* no frame has 0, which stands for not in use: that is an NMT command */
            receive(pdo, i, frame);
        }
    }
}

/* ---- transmitted ---- */

/* Send TPDO `i` now; an inhibit time of `inhibit_ms` ticks begins. A frame for which there is no room is made anew
 * later, with the values of that moment. */
static bool transmit(struct co_pdo *pdo, unsigned i, unsigned inhibit_ms)
{
    struct co_tpdo *tpdo = &pdo->tpdo[i];
    struct can_frame frame = {.id = tpdo->id, .len = tpdo->mapping.bytes};
    uint8_t *at = frame.data;
    for (unsigned k = 0; k < tpdo->mapping.count; k++) {
        const struct od_entry *e = tpdo->mapping.entry[k];
        co_put(at, (uint32_t)od_read(pdo->od, e), od_size(e));
        at += od_size(e);
    }
    if (!co_tx_send_now(pdo->tx, &frame)) {
        return false;
    }
    tpdo->pending = false;
    tpdo->syncs = 0;
    tpdo->elapsed_ms = 0;
    tpdo->inhibit_left_ms = (uint16_t)inhibit_ms;
    pdo->hooks.on_tpdo(pdo->hooks.ctx, i + 1u);
    return true;
}

bool co_pdo_send(struct co_pdo *pdo, unsigned number)
{
    struct co_tpdo *tpdo = &pdo->tpdo[number - 1];
    if (tpdo->id == 0) {
        return false;
    }
    tpdo->pending = true;
    if (tpdo->type < PDO_EVENT || tpdo->inhibit_left_ms != 0) {
        return false;
    }
    return transmit(pdo, number - 1,
                    tpdo->inhibit_ms != 0 ? tpdo->inhibit_ms + 1u : 0u); /* the next tick may follow at once */
}

void co_pdo_tick_ms(struct co_pdo *pdo)
{
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        watch_rpdo(pdo, i);
    }
    for (unsigned i = 0; i < OD_TPDOS; i++) {
        struct co_tpdo *tpdo = &pdo->tpdo[i];
        if (tpdo->id == 0 || tpdo->type < PDO_EVENT) {
            continue;
        }
        if (tpdo->inhibit_left_ms > 0) {
            tpdo->inhibit_left_ms--;
        }
        if (tpdo->elapsed_ms < tpdo->event_ms) {
            tpdo->elapsed_ms++;
        }
        const bool due = tpdo->event_ms != 0 && tpdo->elapsed_ms >= tpdo->event_ms;
        if ((due || tpdo->pending) && tpdo->inhibit_left_ms == 0) {
            (void)transmit(pdo, i, tpdo->inhibit_ms);
        }
    }
}

/* ---- SYNC ---- */

static void sync_tpdo(struct co_pdo *pdo, unsigned i, uint8_t counter)
{
    struct co_tpdo *tpdo = &pdo->tpdo[i];
    if (tpdo->type == 0) {
        if (tpdo->pending) {
            (void)transmit(pdo, i, 0);
        }
        return;
    }
    tpdo->counting = tpdo->counting || counter == tpdo->sync_start;
    if (tpdo->counting && tpdo->syncs < tpdo->type) {
        tpdo->syncs++;
    }
    if (tpdo->syncs >= tpdo->type) {
        (void)transmit(pdo, i, 0);
    }
}

bool co_pdo_sync(struct co_pdo *pdo, const struct can_frame *frame)
{
    const unsigned len = pdo->od->sync_overflow != 0 ? 1 : 0; /* 1019h: SYNC has a counter */
    if (frame->len != len) {
        co_emcy_raise(pdo->emcy, CO_EMCY_SYNC_LENGTH, CO_REG_COMMUNICATION, frame->len);
        return false;
    }
    co_emcy_clear(pdo->emcy, CO_EMCY_SYNC_LENGTH);
    for (unsigned i = 0; i < OD_TPDOS; i++) {
        if (pdo->tpdo[i].id != 0 && pdo->tpdo[i].type <= PDO_SYNC_MAX) {
            sync_tpdo(pdo, i, frame->data[0]);
        }
    }
    for (unsigned i = 0; i < OD_RPDOS; i++) {
        if (pdo->rpdo[i].pending) {
            pdo->rpdo[i].pending = false;
            store(pdo, i, pdo->rpdo[i].data);
        }
    }
    return true;
}
