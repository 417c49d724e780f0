/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/sdo_transfer.h"

#include <stddef.h>
#include <string.h>

#include "canopen/frame.h"

struct can_frame co_sdo_response(const struct co_sdo *sdo, unsigned command)
{
    struct can_frame frame = {.id = sdo->response_id, .len = 8};
    frame.data[0] = (uint8_t)command;
    return frame;
}

struct can_frame co_sdo_object_response(const struct co_sdo *sdo, unsigned command, const struct od_entry *entry)
{
    struct can_frame frame = co_sdo_response(sdo, command);
    co_put(&frame.data[1], entry->index, 2);
    frame.data[3] = entry->sub;
    return frame;
}

void co_sdo_abort(struct co_sdo *sdo, const struct od_entry *entry, uint32_t code)
{
    struct can_frame frame = co_sdo_object_response(sdo, SCS_ABORT, entry);
    co_put(&frame.data[4], code, 4);
    sdo->transfer.phase = CO_SDO_IDLE;
    co_tx_send(sdo->tx, &frame);
}

void co_sdo_abort_transfer(struct co_sdo *sdo, uint32_t code)
{
    static const struct od_entry none = {0};
    co_sdo_abort(sdo, sdo->transfer.phase == CO_SDO_IDLE ? &none : sdo->transfer.entry, code);
}

/* ---- download: the client writes ---- */

uint32_t co_sdo_check_access(const struct od_entry *entry)
{
    return (entry->flags & OD_WRITE) != 0 ? SDO_OK : SDO_ABORT_READ_ONLY;
}

uint32_t co_sdo_check_length(const struct od_entry *entry, uint32_t size)
{
    if (size > od_size(entry)) {
        return SDO_ABORT_TOO_LONG;
    }
    return size < od_size(entry) ? SDO_ABORT_TOO_SHORT : SDO_OK;
}

uint32_t co_sdo_write_value(struct co_sdo *sdo, const struct od_entry *entry, const uint8_t *data)
{
    const int64_t value = od_decode(entry, data);
    uint32_t code = od_check(entry, value);
    if (code == SDO_OK) {
        code = sdo->hooks.before_write(sdo->hooks.ctx, entry, value);
    }
    if (code == SDO_OK) {
        od_write(sdo->od, entry, value);
        sdo->hooks.on_write(sdo->hooks.ctx, entry);
    }
    return code;
}

/* ---- upload: the client reads ---- */

static uint32_t check_read(const struct od_data *od, const struct od_entry *entry)
{
    if (!(entry->flags & OD_READ)) {
        return SDO_ABORT_WRITE_ONLY;
    }
    if (entry->index == OBJ_ERROR_HISTORY && entry->sub > od->error_history_count) {
        return SDO_ABORT_NO_DATA;
    }
    return SDO_OK;
}

uint32_t co_sdo_read_value(struct co_sdo *sdo, const struct od_entry *entry)
{
    struct co_sdo_transfer *transfer = &sdo->transfer;
    const uint32_t code = check_read(sdo->od, entry);
    if (code != SDO_OK) {
        return code;
    }
    sdo->hooks.before_read(sdo->hooks.ctx, entry);
    *transfer = (struct co_sdo_transfer){.entry = entry, .data = transfer->buffer, .size = od_size(entry)};
    if (entry->type == OD_DOMAIN) {
        transfer->data = NULL;
        transfer->size = sdo->hooks.domain_size(sdo->hooks.ctx, entry);
        return transfer->size != 0 ? SDO_OK : SDO_ABORT_NO_DATA;
    }
    if (entry->type == OD_STRING) {
        const char *text = od_text(sdo->od, entry);
        transfer->data = (const uint8_t *)text;
        transfer->size = (uint32_t)strlen(text);
    } else {
        co_put(transfer->buffer, (uint32_t)od_read(sdo->od, entry), (uint8_t)transfer->size);
    }
    return SDO_OK;
}

bool co_sdo_value_bytes(const struct co_sdo *sdo, uint32_t at, uint8_t *to, uint32_t count)
{
    const struct co_sdo_transfer *transfer = &sdo->transfer;
    if (transfer->entry->type == OD_DOMAIN) {
        return sdo->hooks.domain_read(sdo->hooks.ctx, transfer->entry, at, to, count);
    }
    memcpy(to, &transfer->data[at], count); /* NOLINT(clang-analyzer-core.NonNullParamChecker) */
    return true;
}
