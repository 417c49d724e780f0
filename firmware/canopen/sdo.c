/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/sdo.h"

#include <stddef.h>
#include <string.h>

#include "canopen/frame.h"
#include "canopen/sdo_block.h"

enum { BIT_SIZE = 0x01, BIT_EXPEDITED = 0x02, BIT_LAST = 0x01, BIT_TOGGLE = 0x10 };
enum { BIT_BLOCK_STEP = 0x03, BIT_BLOCK_END = 0x01 }; /* a later step: of a block upload, of a block download */

void co_sdo_init(struct co_sdo *sdo, struct od_data *od, struct co_tx *tx, const struct co_sdo_hooks *hooks)
{
    *sdo = (struct co_sdo){.od = od, .tx = tx, .hooks = *hooks};
}

void co_sdo_reset(struct co_sdo *sdo)
{
    sdo->transfer.phase = CO_SDO_IDLE;
}

/* ---- download: the client writes ---- */

static void download(struct co_sdo *sdo, const struct od_entry *entry, const uint8_t *request)
{
    const bool expedited = (request[0] & BIT_EXPEDITED) != 0, sized = (request[0] & BIT_SIZE) != 0;
    uint32_t size = sized ? co_get(&request[4], 4) : 0;
    if (expedited) {
        size = sized ? 4u - ((request[0] >> 2) & 3u) : od_size(entry);
    }
    uint32_t code = co_sdo_check_access(entry);
    if (code == SDO_OK && (expedited || sized)) {
        code = co_sdo_check_length(entry, size);
    }
    if (code == SDO_OK && expedited) {
        code = co_sdo_write_value(sdo, entry, &request[4]);
    }
    if (code != SDO_OK) {
        co_sdo_abort(sdo, entry, code);
        return;
    }
    if (!expedited) {
        sdo->transfer = (struct co_sdo_transfer){.phase = CO_SDO_DOWNLOAD, .entry = entry};
    }
    const struct can_frame frame = co_sdo_object_response(sdo, SCS_DOWNLOAD, entry);
    co_tx_send(sdo->tx, &frame);
}

static void download_segment(struct co_sdo *sdo, const uint8_t *request)
{
    struct co_sdo_transfer *transfer = &sdo->transfer;
    const uint32_t count = CO_SDO_SEGMENT - ((request[0] >> 1) & 7u);
    if (transfer->at + count > od_size(transfer->entry)) {
        co_sdo_abort_transfer(sdo, SDO_ABORT_TOO_LONG);
        return;
    }
    memcpy(&transfer->buffer[transfer->at], &request[1], count);
    transfer->at += count;
    if ((request[0] & BIT_LAST) != 0) {
        uint32_t code = co_sdo_check_length(transfer->entry, transfer->at);
        if (code == SDO_OK) {
            code = co_sdo_write_value(sdo, transfer->entry, transfer->buffer);
        }
        if (code != SDO_OK) {
            co_sdo_abort_transfer(sdo, code);
            return;
        }
        transfer->phase = CO_SDO_IDLE;
    }
    const struct can_frame frame = co_sdo_response(sdo, SCS_DOWNLOAD_SEGMENT | (request[0] & BIT_TOGGLE));
    transfer->toggle = !transfer->toggle;
    co_tx_send(sdo->tx, &frame);
}

/* ---- upload: the client reads ---- */

/* Answer with the prepared value, or with its length when it needs segments. */
static void send_value(struct co_sdo *sdo)
{
    struct co_sdo_transfer *transfer = &sdo->transfer;
    const bool expedited = od_size(transfer->entry) != 0;
    const unsigned how = expedited ? BIT_EXPEDITED | (unsigned)(4 - transfer->size) << 2 : 0u;
    struct can_frame frame = co_sdo_object_response(sdo, SCS_UPLOAD | BIT_SIZE | how, transfer->entry);
    if (expedited) {
        (void)co_sdo_value_bytes(sdo, 0, &frame.data[4], transfer->size);
    } else {
        co_put(&frame.data[4], transfer->size, 4);
        transfer->phase = CO_SDO_UPLOAD;
    }
    co_tx_send(sdo->tx, &frame);
}

static void upload(struct co_sdo *sdo, const struct od_entry *entry)
{
    const uint32_t code = co_sdo_read_value(sdo, entry);
    if (code != SDO_OK) {
        co_sdo_abort(sdo, entry, code);
    } else {
        send_value(sdo);
    }
}

static void upload_segment(struct co_sdo *sdo, const uint8_t *request)
{
    struct co_sdo_transfer *transfer = &sdo->transfer;
    const uint32_t left = transfer->size - transfer->at;
    const uint32_t count = left < CO_SDO_SEGMENT ? left : CO_SDO_SEGMENT;
    const bool last = count == left;
    struct can_frame frame = co_sdo_response(sdo, SCS_UPLOAD_SEGMENT | (request[0] & BIT_TOGGLE) |
                                                      (CO_SDO_SEGMENT - count) << 1 | (last ? BIT_LAST : 0u));
    if (!co_sdo_value_bytes(sdo, transfer->at, &frame.data[1], count)) {
        co_sdo_abort_transfer(sdo, SDO_ABORT_STATE);
        return;
    }
    transfer->at += count;
    transfer->toggle = !transfer->toggle;
    if (last) {
        transfer->phase = CO_SDO_IDLE;
    }
    co_tx_send(sdo->tx, &frame);
}

/* ---- both ---- */

static void segment(struct co_sdo *sdo, enum co_sdo_phase wanted, const uint8_t *request)
{
    if (sdo->transfer.phase != wanted) {
        co_sdo_abort_transfer(sdo, SDO_ABORT_COMMAND);
    } else if (((request[0] & BIT_TOGGLE) != 0) != sdo->transfer.toggle) {
        co_sdo_abort_transfer(sdo, SDO_ABORT_TOGGLE);
    } else if (wanted == CO_SDO_DOWNLOAD) {
        download_segment(sdo, request);
    } else {
        upload_segment(sdo, request);
    }
}

static void initiate(struct co_sdo *sdo, unsigned command, const uint8_t *request)
{
    const struct od_entry requested = {.index = (uint16_t)co_get(&request[1], 2), .sub = request[3]};
    uint32_t code = SDO_OK;
    const struct od_entry *entry = od_find(requested.index, requested.sub, &code);
    co_sdo_reset(sdo);
    if (entry == NULL) {
        co_sdo_abort(sdo, &requested, code);
        return;
    }
    switch (command) {
    case CCS_DOWNLOAD: download(sdo, entry, request); break;
    case CCS_UPLOAD: upload(sdo, entry); break;
    case CCS_BLOCK_DOWNLOAD: co_sdo_block_download(sdo, entry, request); break;
    default:
        if (co_sdo_block_upload(sdo, entry, request) == CO_SDO_BLOCK_SWITCH) {
            send_value(sdo);
        }
        break;
    }
}

void co_sdo_receive(struct co_sdo *sdo, const struct can_frame *frame, uint16_t response_id)
{
    const uint8_t *request = frame->data;
    const unsigned command = request[0] >> 5;
    if (frame->len != 8) {
        return;
    }
    sdo->silent_ms = 0;
    sdo->response_id = response_id;
    if (co_sdo_block_segment(sdo, request)) {
        return;
    }
    switch (command) {
    case CCS_DOWNLOAD_SEGMENT: segment(sdo, CO_SDO_DOWNLOAD, request); break;
    case CCS_UPLOAD_SEGMENT: segment(sdo, CO_SDO_UPLOAD, request); break;
    case CCS_DOWNLOAD:
    case CCS_UPLOAD: initiate(sdo, command, request); break;
    case CCS_BLOCK_DOWNLOAD:
        if ((request[0] & BIT_BLOCK_END) != 0) {
            co_sdo_block_download_end(sdo, request);
        } else {
            initiate(sdo, command, request);
        }
        break;
    case CCS_BLOCK_UPLOAD:
        if ((request[0] & BIT_BLOCK_STEP) != 0) {
            co_sdo_block_upload_step(sdo, request);
        } else {
            initiate(sdo, command, request);
        }
        break;
    case CCS_ABORT: co_sdo_reset(sdo); break;
    default: co_sdo_abort_transfer(sdo, SDO_ABORT_COMMAND); break;
    }
}

void co_sdo_tick_ms(struct co_sdo *sdo)
{
    if (sdo->transfer.phase == CO_SDO_IDLE) {
        return;
    }
    if (++sdo->silent_ms > CO_SDO_TIMEOUT_MS) {
        co_sdo_abort_transfer(sdo, SDO_ABORT_TIMEOUT);
    } else if (sdo->transfer.phase == CO_SDO_BLOCK_UPLOAD) {
        co_sdo_block_tick_ms(sdo);
    }
}
