/* SPDX-License-Identifier: Apache-2.0 */
#include "sdo.h"

#include <stddef.h>
#include <string.h>

#include "node.h"

/* Command specifiers, bits 5..7 of byte 0: of the client, of the server. */
enum { CCS_DOWNLOAD_SEGMENT, CCS_DOWNLOAD, CCS_UPLOAD, CCS_UPLOAD_SEGMENT, CCS_ABORT };
enum {
    SCS_UPLOAD_SEGMENT = 0x00,
    SCS_DOWNLOAD_SEGMENT = 0x20,
    SCS_UPLOAD = 0x40,
    SCS_DOWNLOAD = 0x60,
    SCS_ABORT = 0x80,
};
enum { BIT_SIZE = 0x01, BIT_EXPEDITED = 0x02, BIT_LAST = 0x01, BIT_TOGGLE = 0x10 };
enum { SEGMENT = 7 };

static struct can_frame response(const struct co_node *node, unsigned command)
{
    struct can_frame frame = {.id = (uint16_t)node->config.od->sdo_server.cob_id_response, .len = 8};
    frame.data[0] = (uint8_t)command;
    return frame;
}

/* A response that names its object. */
static struct can_frame object_response(const struct co_node *node, unsigned command, uint16_t index, uint8_t sub)
{
    struct can_frame frame = response(node, command);
    co_put(&frame.data[1], index, 2);
    frame.data[3] = sub;
    return frame;
}

static void send_abort(struct co_node *node, uint16_t index, uint8_t sub, uint32_t code)
{
    struct can_frame frame = object_response(node, SCS_ABORT, index, sub);
    co_put(&frame.data[4], code, 4);
    node->sdo.transfer = CO_SDO_IDLE;
    (void)co_send(node, &frame);
}

static void abort_transfer(struct co_node *node, uint32_t code)
{
    const struct od_entry *entry = node->sdo.transfer == CO_SDO_IDLE ? NULL : node->sdo.entry;
    send_abort(node, entry ? entry->index : 0, entry ? entry->sub : 0, code);
}

/* ---- download: the client writes ---- */

static uint32_t check_length(const struct od_entry *entry, uint32_t size)
{
    if (size > od_size(entry)) {
        return SDO_ABORT_TOO_LONG;
    }
    return size < od_size(entry) ? SDO_ABORT_TOO_SHORT : SDO_OK;
}

/* Store the number in `data`, if everybody agrees. */
static uint32_t store(struct co_node *node, const struct od_entry *entry, const uint8_t *data)
{
    const struct co_hooks *hooks = &node->config.hooks;
    const int64_t value = od_decode(entry, data);
    uint32_t code = od_check(entry, value);
    if (code == SDO_OK) {
        code = co_pdo_check(node, entry, value);
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
        code = check_length(entry, size);
    }
    if (code == SDO_OK && expedited) {
        code = store(node, entry, &request[4]);
    }
    if (code != SDO_OK) {
        send_abort(node, entry->index, entry->sub, code);
        return;
    }
    if (!expedited) {
        *sdo = (struct co_sdo){.transfer = CO_SDO_DOWNLOAD, .entry = entry};
    }
    const struct can_frame frame = object_response(node, SCS_DOWNLOAD, entry->index, entry->sub);
    (void)co_send(node, &frame);
}

static void download_segment(struct co_node *node, const uint8_t *request)
{
    struct co_sdo *sdo = &node->sdo;
    const uint32_t count = SEGMENT - ((request[0] >> 1) & 7u);
    if (sdo->at + count > od_size(sdo->entry)) {
        abort_transfer(node, SDO_ABORT_TOO_LONG);
        return;
    }
    memcpy(&sdo->buffer[sdo->at], &request[1], count);
    sdo->at += count;
    if (request[0] & BIT_LAST) {
        uint32_t code = check_length(sdo->entry, sdo->at);
        if (code == SDO_OK) {
            code = store(node, sdo->entry, sdo->buffer);
        }
        if (code != SDO_OK) {
            abort_transfer(node, code);
            return;
        }
        sdo->transfer = CO_SDO_IDLE;
    }
    const struct can_frame frame = response(node, SCS_DOWNLOAD_SEGMENT | (request[0] & BIT_TOGGLE));
    sdo->toggle = !sdo->toggle;
    (void)co_send(node, &frame);
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

static void upload(struct co_node *node, const struct od_entry *entry)
{
    const struct od_data *od = node->config.od;
    const struct co_hooks *hooks = &node->config.hooks;
    const uint32_t code = check_read(node, entry);
    if (code != SDO_OK) {
        send_abort(node, entry->index, entry->sub, code);
        return;
    }
    if (hooks->before_read != NULL) {
        hooks->before_read(hooks->ctx, entry);
    }
    if (entry->type == OD_STRING) {
        const char *text = od_text(od, entry);
        const uint32_t size = (uint32_t)strlen(text);
        struct can_frame frame = object_response(node, SCS_UPLOAD | BIT_SIZE, entry->index, entry->sub);
        co_put(&frame.data[4], size, 4);
        node->sdo = (struct co_sdo){
            .transfer = CO_SDO_UPLOAD, .entry = entry, .size = size, .data = (const uint8_t *)text};
        (void)co_send(node, &frame);
        return;
    }
    const uint8_t size = od_size(entry);
    struct can_frame frame = object_response(
        node, SCS_UPLOAD | BIT_EXPEDITED | BIT_SIZE | (unsigned)(4 - size) << 2, entry->index, entry->sub);
    co_put(&frame.data[4], (uint32_t)od_read(od, entry), size);
    (void)co_send(node, &frame);
}

static void upload_segment(struct co_node *node, const uint8_t *request)
{
    struct co_sdo *sdo = &node->sdo;
    const uint32_t left = sdo->size - sdo->at;
    const uint32_t count = left < SEGMENT ? left : SEGMENT;
    const bool last = count == left;
    struct can_frame frame = response(
        node, SCS_UPLOAD_SEGMENT | (request[0] & BIT_TOGGLE) | (SEGMENT - count) << 1 | (last ? BIT_LAST : 0u));
    memcpy(&frame.data[1], &sdo->data[sdo->at], count);
    sdo->at += count;
    sdo->toggle = !sdo->toggle;
    if (last) {
        sdo->transfer = CO_SDO_IDLE;
    }
    (void)co_send(node, &frame);
}

/* ---- both ---- */

static void segment(struct co_node *node, enum co_sdo_transfer wanted, const uint8_t *request)
{
    struct co_sdo *sdo = &node->sdo;
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
    const uint16_t index = (uint16_t)co_get(&request[1], 2);
    const uint8_t sub = request[3];
    uint32_t code = SDO_OK;
    const struct od_entry *entry = od_find(index, sub, &code);
    node->sdo.transfer = CO_SDO_IDLE;
    if (entry == NULL) {
        send_abort(node, index, sub, code);
    } else if (command == CCS_DOWNLOAD) {
        download(node, entry, request);
    } else {
        upload(node, entry);
    }
}

void co_sdo_receive(struct co_node *node, const struct can_frame *frame)
{
    if (frame->len != 8) {
        return;
    }
    const unsigned command = frame->data[0] >> 5;
    switch (command) {
    case CCS_DOWNLOAD_SEGMENT: segment(node, CO_SDO_DOWNLOAD, frame->data); break;
    case CCS_UPLOAD_SEGMENT: segment(node, CO_SDO_UPLOAD, frame->data); break;
    case CCS_DOWNLOAD:
    case CCS_UPLOAD: initiate(node, command, frame->data); break;
    case CCS_ABORT: node->sdo.transfer = CO_SDO_IDLE; break;
    default: abort_transfer(node, SDO_ABORT_COMMAND); break; /* block transfer */
    }
}
