/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/sdo.h"

#include <stddef.h>
#include <string.h>

#include "canopen/check.h"
#include "canopen/node.h"

enum { BIT_SIZE = 0x01, BIT_EXPEDITED = 0x02, BIT_LAST = 0x01, BIT_TOGGLE = 0x10 };
enum { BIT_BLOCK_STEP = 0x03, BIT_BLOCK_END = 0x01 }; /* a step after the first: of an upload, of a download */

struct can_frame co_sdo_response(const struct co_node *node, unsigned command)
{
    struct can_frame frame = {.id = (uint16_t)node->config.od->sdo_server.cob_id_response, .len = 8};
    frame.data[0] = (uint8_t)command;
    return frame;
}

struct can_frame co_sdo_object_response(const struct co_node *node, unsigned command, const struct od_entry *entry)
{
    struct can_frame frame = co_sdo_response(node, command);
    co_put(&frame.data[1], entry->index, 2);
    frame.data[3] = entry->sub;
    return frame;
}

void co_sdo_abort(struct co_node *node, const struct od_entry *entry, uint32_t code)
{
    static const struct od_entry none = {0};
    struct can_frame frame = co_sdo_object_response(node, SCS_ABORT, entry != NULL ? entry : &none);
    co_put(&frame.data[4], code, 4);
    node->sdo.transfer = CO_SDO_IDLE;
    co_send(node, &frame);
}

static void abort_transfer(struct co_node *node, uint32_t code)
{
    co_sdo_abort(node, node->sdo.transfer == CO_SDO_IDLE ? NULL : node->sdo.entry, code);
}

/* ---- download: the client writes ---- */

uint32_t co_sdo_check_length(const struct od_entry *entry, uint32_t size)
{
    if (size > od_size(entry)) {
        return SDO_ABORT_TOO_LONG;
    }
    return size < od_size(entry) ? SDO_ABORT_TOO_SHORT : SDO_OK;
}

uint32_t co_sdo_store(struct co_node *node, const struct od_entry *entry, const uint8_t *data)
{
    const struct co_hooks *hooks = &node->config.hooks;
    const int64_t value = od_decode(entry, data);
    uint32_t code = od_check(entry, value);
    if (code == SDO_OK) {
        code = co_check_write(node, entry, value);
    }
    if (code == SDO_OK && hooks->check_write != NULL) {
        code = hooks->check_write(hooks->ctx, entry, value);
    }
    if (code != SDO_OK) {
        return code;
    }
    od_write(node->config.od, entry, value);
    co_written(node, entry);
    if (hooks->on_write != NULL) {
        hooks->on_write(hooks->ctx, entry);
    }
    return SDO_OK;
}

static void download(struct co_node *node, const struct od_entry *entry, const uint8_t *request)
{
    struct co_sdo *sdo = &node->sdo;
    const bool expedited = (request[0] & BIT_EXPEDITED) != 0, sized = (request[0] & BIT_SIZE) != 0;
    uint32_t size = sized ? co_get(&request[4], 4) : 0;
    if (expedited) {
        size = sized ? 4u - ((request[0] >> 2) & 3u) : od_size(entry);
    }
    uint32_t code = (entry->flags & OD_WRITE) ? SDO_OK : SDO_ABORT_READ_ONLY;
    if (code == SDO_OK && (expedited || sized)) {
        code = co_sdo_check_length(entry, size);
    }
    if (code == SDO_OK && expedited) {
        code = co_sdo_store(node, entry, &request[4]);
    }
    if (code != SDO_OK) {
        co_sdo_abort(node, entry, code);
        return;
    }
    if (!expedited) {
        *sdo = (struct co_sdo){.transfer = CO_SDO_DOWNLOAD, .entry = entry};
    }
    const struct can_frame frame = co_sdo_object_response(node, SCS_DOWNLOAD, entry);
    co_send(node, &frame);
}

static void download_segment(struct co_node *node, const uint8_t *request)
{
    struct co_sdo *sdo = &node->sdo;
    const uint32_t count = CO_SDO_SEGMENT - ((request[0] >> 1) & 7u);
    if (sdo->at + count > od_size(sdo->entry)) {
        abort_transfer(node, SDO_ABORT_TOO_LONG);
        return;
    }
    memcpy(&sdo->buffer[sdo->at], &request[1], count);
    sdo->at += count;
    if ((request[0] & BIT_LAST) != 0) {
        uint32_t code = co_sdo_check_length(sdo->entry, sdo->at);
        if (code == SDO_OK) {
            code = co_sdo_store(node, sdo->entry, sdo->buffer);
        }
        if (code != SDO_OK) {
            abort_transfer(node, code);
            return;
        }
        sdo->transfer = CO_SDO_IDLE;
    }
    const struct can_frame frame = co_sdo_response(node, SCS_DOWNLOAD_SEGMENT | (request[0] & BIT_TOGGLE));
    sdo->toggle = !sdo->toggle;
    co_send(node, &frame);
}

/* ---- upload: the client reads ---- */

/* Why the entry has no value to give, or SDO_OK. */
static uint32_t check_read(const struct co_node *node, const struct od_entry *entry)
{
    if (!(entry->flags & OD_READ)) {
        return SDO_ABORT_WRITE_ONLY;
    }
    if (entry->index == 0x1003 && entry->sub > node->config.od->error_history_count) {
        return SDO_ABORT_NO_DATA;
    }
    return SDO_OK;
}

uint32_t co_sdo_prepare(struct co_node *node, const struct od_entry *entry)
{
    const struct od_data *od = node->config.od;
    const struct co_hooks *hooks = &node->config.hooks;
    struct co_sdo *sdo = &node->sdo;
    const uint32_t code = check_read(node, entry);
    if (code != SDO_OK) {
        return code;
    }
    if (hooks->before_read != NULL) {
        hooks->before_read(hooks->ctx, entry);
    }
    *sdo = (struct co_sdo){.entry = entry, .data = sdo->buffer, .size = od_size(entry)};
    if (entry->type == OD_DOMAIN) {
        sdo->data = NULL;
        sdo->size = hooks->domain_size != NULL ? hooks->domain_size(hooks->ctx, entry) : 0u;
        return sdo->size != 0 ? SDO_OK : SDO_ABORT_NO_DATA;
    }
    if (entry->type == OD_STRING) {
        const char *text = od_text(od, entry);
        sdo->data = (const uint8_t *)text;
        sdo->size = (uint32_t)strlen(text);
    } else {
        co_put(sdo->buffer, (uint32_t)od_read(od, entry), (uint8_t)sdo->size);
    }
    return SDO_OK;
}

bool co_sdo_bytes(const struct co_node *node, uint32_t at, uint8_t *to, uint32_t count)
{
    const struct co_sdo *sdo = &node->sdo;
    const struct co_hooks *hooks = &node->config.hooks;
    if (sdo->entry->type == OD_DOMAIN) {
        return hooks->domain_read(hooks->ctx, sdo->entry, at, to, count);
    }
    memcpy(to, &sdo->data[at], count); /* NOLINT(clang-analyzer-core.NonNullParamChecker) */
    return true;
}

void co_sdo_upload(struct co_node *node)
{
    struct co_sdo *sdo = &node->sdo;
    const bool expedited = od_size(sdo->entry) != 0;
    const unsigned how = expedited ? BIT_EXPEDITED | (unsigned)(4 - sdo->size) << 2 : 0u;
    struct can_frame frame = co_sdo_object_response(node, SCS_UPLOAD | BIT_SIZE | how, sdo->entry);
    if (expedited) {
        (void)co_sdo_bytes(node, 0, &frame.data[4], sdo->size);
    } else {
        co_put(&frame.data[4], sdo->size, 4);
        sdo->transfer = CO_SDO_UPLOAD;
    }
    co_send(node, &frame);
}

static void upload(struct co_node *node, const struct od_entry *entry)
{
    const uint32_t code = co_sdo_prepare(node, entry);
    if (code != SDO_OK) {
        co_sdo_abort(node, entry, code);
    } else {
        co_sdo_upload(node);
    }
}

static void upload_segment(struct co_node *node, const uint8_t *request)
{
    struct co_sdo *sdo = &node->sdo;
    const uint32_t left = sdo->size - sdo->at;
    const uint32_t count = left < CO_SDO_SEGMENT ? left : CO_SDO_SEGMENT;
    const bool last = count == left;
    struct can_frame frame = co_sdo_response(node, SCS_UPLOAD_SEGMENT | (request[0] & BIT_TOGGLE) |
                                                       (CO_SDO_SEGMENT - count) << 1 | (last ? BIT_LAST : 0u));
    if (!co_sdo_bytes(node, sdo->at, &frame.data[1], count)) {
        abort_transfer(node, SDO_ABORT_STATE);
        return;
    }
    sdo->at += count;
    sdo->toggle = !sdo->toggle;
    if (last) {
        sdo->transfer = CO_SDO_IDLE;
    }
    co_send(node, &frame);
}

/* ---- both ---- */

static void segment(struct co_node *node, enum co_sdo_transfer wanted, const uint8_t *request)
{
    const struct co_sdo *sdo = &node->sdo;
    if (sdo->transfer != wanted) {
        abort_transfer(node, SDO_ABORT_COMMAND);
    } else if (((request[0] & BIT_TOGGLE) != 0) != sdo->toggle) {
        abort_transfer(node, SDO_ABORT_TOGGLE);
    } else if (wanted == CO_SDO_DOWNLOAD) {
        download_segment(node, request);
    } else {
        upload_segment(node, request);
    }
}

static void initiate(struct co_node *node, unsigned command, const uint8_t *request)
{
    const struct od_entry asked = {.index = (uint16_t)co_get(&request[1], 2), .sub = request[3]};
    uint32_t code = SDO_OK;
    const struct od_entry *entry = od_find(asked.index, asked.sub, &code);
    node->sdo.transfer = CO_SDO_IDLE;
    if (entry == NULL) {
        co_sdo_abort(node, &asked, code);
        return;
    }
    switch (command) {
    case CCS_DOWNLOAD: download(node, entry, request); break;
    case CCS_UPLOAD: upload(node, entry); break;
    case CCS_BLOCK_DOWNLOAD: co_sdo_block_download(node, entry, request); break;
    default: co_sdo_block_upload(node, entry, request); break;
    }
}

void co_sdo_receive(struct co_node *node, const struct can_frame *frame)
{
    const uint8_t *request = frame->data;
    const unsigned command = request[0] >> 5;
    if (frame->len != 8) {
        return;
    }
    node->sdo.silent_ms = 0;
    if (co_sdo_block_segment(node, request)) {
        return;
    }
    switch (command) {
    case CCS_DOWNLOAD_SEGMENT: segment(node, CO_SDO_DOWNLOAD, request); break;
    case CCS_UPLOAD_SEGMENT: segment(node, CO_SDO_UPLOAD, request); break;
    case CCS_DOWNLOAD:
    case CCS_UPLOAD: initiate(node, command, request); break;
    case CCS_BLOCK_DOWNLOAD:
        if ((request[0] & BIT_BLOCK_END) != 0) {
            co_sdo_block_download_end(node, request);
        } else {
            initiate(node, command, request);
        }
        break;
    case CCS_BLOCK_UPLOAD:
        if ((request[0] & BIT_BLOCK_STEP) != 0) {
            co_sdo_block_upload_step(node, request);
        } else {
            initiate(node, command, request);
        }
        break;
    case CCS_ABORT: node->sdo.transfer = CO_SDO_IDLE; break;
    default: abort_transfer(node, SDO_ABORT_COMMAND); break;
    }
}

void co_sdo_tick_ms(struct co_node *node)
{
    struct co_sdo *sdo = &node->sdo;
    if (sdo->transfer == CO_SDO_IDLE) {
        return;
    }
    if (node->state == CO_STOPPED) { /* there are no SDOs */
        sdo->transfer = CO_SDO_IDLE;
    } else if (++sdo->silent_ms > CO_SDO_TIMEOUT_MS) {
        abort_transfer(node, SDO_ABORT_TIMEOUT);
    } else if (sdo->transfer == CO_SDO_BLOCK_UPLOAD) {
        co_sdo_block_tick_ms(node);
    }
}
