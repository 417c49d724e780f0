/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/sdo_block.h"

#include <string.h>

#include "canopen/frame.h"

enum {
    BIT_CRC = 0x04,  /* the client wants a CRC; the server then makes it */
    BIT_SIZE = 0x02, /* the size is in bytes 4..7 */
    BIT_LAST = 0x80, /* of a segment: no more follow */
    SEQUENCE = 0x7F, /* of a segment: its number in the block, 1..127 */
    BLOCK_MAX = 127,
};
/* Bits 0..1: those of the client in an upload, and those of the server. */
enum { STEP_END = 1, STEP_ACKNOWLEDGE = 2, STEP_START = 3, STEP = 3 };
enum { SS_INITIATE = 0, SS_END = 1, SS_ACKNOWLEDGE = 2 };

/* CRC-16/CCITT with the initial value 0 (7.2.4.3.16). */
static uint16_t crc16(uint16_t crc, const uint8_t *data, uint32_t count)
{
    for (uint32_t i = 0; i < count; i++) {
        crc = (uint16_t)(crc ^ data[i] << 8);
        for (int bit = 0; bit < 8; bit++) {
            crc = (uint16_t)((crc & 0x8000u) != 0 ? crc << 1 ^ 0x1021 : crc << 1);
        }
    }
    return crc;
}

/* ---- download ---- */

void co_sdo_block_download(struct co_sdo *sdo, const struct od_entry *entry, const uint8_t *request)
{
    const unsigned crc = request[0] & BIT_CRC;
    uint32_t code = co_sdo_check_access(entry);
    if (code == SDO_OK && (request[0] & BIT_SIZE) != 0) {
        code = co_sdo_check_length(entry, co_get(&request[4], 4));
    }
    if (code != SDO_OK) {
        co_sdo_abort(sdo, entry, code);
        return;
    }
    sdo->transfer =
        (struct co_sdo_transfer){.phase = CO_SDO_BLOCK_DOWNLOAD, .entry = entry, .block = 1, .crc_wanted = crc != 0};
    struct can_frame frame = co_sdo_object_response(sdo, SCS_BLOCK_DOWNLOAD | crc | SS_INITIATE, entry);
    frame.data[4] = sdo->transfer.block;
    co_tx_send(sdo->tx, &frame);
}

bool co_sdo_block_segment(struct co_sdo *sdo, const uint8_t *request)
{
    struct co_sdo_transfer *transfer = &sdo->transfer;
    if (transfer->phase == CO_SDO_BLOCK_DOWNLOAD_END) {
        return request[0] == (BIT_LAST | 1); /* the bus has repeated it */
    }
    if (transfer->phase != CO_SDO_BLOCK_DOWNLOAD || (request[0] & SEQUENCE) != 1) {
        return false;
    }
    if ((request[0] & BIT_LAST) == 0) {
        co_sdo_abort_transfer(sdo, SDO_ABORT_TOO_LONG);
        return true;
    }
    memcpy(transfer->buffer, &request[1], sizeof transfer->buffer);
    transfer->phase = CO_SDO_BLOCK_DOWNLOAD_END;
    struct can_frame frame = co_sdo_response(sdo, SCS_BLOCK_DOWNLOAD | SS_ACKNOWLEDGE);
    frame.data[1] = 1;
    frame.data[2] = transfer->block;
    co_tx_send(sdo->tx, &frame);
    return true;
}

void co_sdo_block_download_end(struct co_sdo *sdo, const uint8_t *request)
{
    struct co_sdo_transfer *transfer = &sdo->transfer;
    const uint32_t size = CO_SDO_SEGMENT - ((request[0] >> 2) & 7u);
    if (transfer->phase != CO_SDO_BLOCK_DOWNLOAD_END) {
        co_sdo_abort_transfer(sdo, SDO_ABORT_COMMAND);
        return;
    }
    uint32_t code = co_sdo_check_length(transfer->entry, size);
    if (code == SDO_OK && transfer->crc_wanted && crc16(0, transfer->buffer, size) != co_get(&request[1], 2)) {
        code = SDO_ABORT_CRC;
    }
    if (code == SDO_OK) {
        code = co_sdo_write_value(sdo, transfer->entry, transfer->buffer);
    }
    if (code != SDO_OK) {
        co_sdo_abort_transfer(sdo, code);
        return;
    }
    transfer->phase = CO_SDO_IDLE;
    const struct can_frame frame = co_sdo_response(sdo, SCS_BLOCK_DOWNLOAD | SS_END);
    co_tx_send(sdo->tx, &frame);
}

/* ---- upload ---- */

static bool is_block_size(uint8_t segments)
{
    return segments >= 1 && segments <= BLOCK_MAX;
}

enum co_sdo_block_answer co_sdo_block_upload(struct co_sdo *sdo, const struct od_entry *entry, const uint8_t *request)
{
    struct co_sdo_transfer *transfer = &sdo->transfer;
    const uint8_t block = request[4], threshold = request[5];
    const unsigned crc = request[0] & BIT_CRC;
    uint32_t code = co_sdo_read_value(sdo, entry);
    if (code == SDO_OK && !is_block_size(block)) {
        code = SDO_ABORT_BLOCK_SIZE;
    }
    if (code != SDO_OK) {
        co_sdo_abort(sdo, entry, code);
        return CO_SDO_BLOCK_ANSWERED;
    }
    if (threshold != 0 && transfer->size <= threshold) {
        return CO_SDO_BLOCK_SWITCH;
    }
    transfer->phase = CO_SDO_BLOCK_UPLOAD_START;
    transfer->block = block;
    transfer->crc_wanted = crc != 0;
    struct can_frame frame = co_sdo_object_response(sdo, SCS_BLOCK_UPLOAD | crc | BIT_SIZE | SS_INITIATE, entry);
    co_put(&frame.data[4], transfer->size, 4);
    co_tx_send(sdo->tx, &frame);
    return CO_SDO_BLOCK_ANSWERED;
}

/* Bytes that have not been acknowledged yet, rounded up to segments. An empty value has one segment, too. */
static uint32_t bytes_left(const struct co_sdo_transfer *transfer)
{
    const uint32_t segments = transfer->size == 0 ? 1 : (transfer->size + CO_SDO_SEGMENT - 1) / CO_SDO_SEGMENT;
    return segments * CO_SDO_SEGMENT - transfer->at;
}

static void send_end(struct co_sdo *sdo)
{
    struct co_sdo_transfer *transfer = &sdo->transfer;
    const uint32_t unused = transfer->at - transfer->size;
    struct can_frame frame = co_sdo_response(sdo, SCS_BLOCK_UPLOAD | unused << 2 | SS_END);
    co_put(&frame.data[1], transfer->crc_wanted ? transfer->crc : 0u, 2);
    transfer->phase = CO_SDO_BLOCK_UPLOAD_END;
    co_tx_send(sdo->tx, &frame);
}

static void acknowledge(struct co_sdo *sdo, uint8_t sequence, uint8_t block)
{
    struct co_sdo_transfer *transfer = &sdo->transfer;
    if (transfer->sent == 0) {
        return; /* the bus has repeated the last acknowledgement */
    }
    if (sequence > transfer->sent) {
        co_sdo_abort_transfer(sdo, SDO_ABORT_SEQUENCE);
        return;
    }
    if (!is_block_size(block)) {
        co_sdo_abort_transfer(sdo, SDO_ABORT_BLOCK_SIZE);
        return;
    }
    transfer->at += (uint32_t)sequence * CO_SDO_SEGMENT;
    transfer->sent = 0;
    transfer->block = block;
    if (bytes_left(transfer) == 0) {
        send_end(sdo);
    }
}

/* Send the next segment. false: none is due, or there is no room for it. */
static bool send_segment(struct co_sdo *sdo)
{
    struct co_sdo_transfer *transfer = &sdo->transfer;
    const uint32_t ahead = (uint32_t)transfer->sent * CO_SDO_SEGMENT, at = transfer->at + ahead;
    if (transfer->sent == transfer->block || ahead == bytes_left(transfer) || sdo->tx->count > 0) {
        return false;
    }
    const bool last = bytes_left(transfer) - ahead == CO_SDO_SEGMENT;
    const uint32_t count = last ? transfer->size - at : CO_SDO_SEGMENT;
    struct can_frame frame = co_sdo_response(sdo, (transfer->sent + 1u) | (last ? (unsigned)BIT_LAST : 0u));
    if (!co_sdo_value_bytes(sdo, at, &frame.data[1], count)) {
        co_sdo_abort_transfer(sdo, SDO_ABORT_STATE);
        return false;
    }
    if (!co_tx_send_now(sdo->tx, &frame)) {
        return false;
    }
    transfer->sent++;
    sdo->silent_ms = 0;
    if (at == transfer->crc_at) { /* else the segment has been sent before */
        transfer->crc = crc16(transfer->crc, &frame.data[1], count);
        transfer->crc_at += count;
    }
    return true;
}

static void send_segments(struct co_sdo *sdo, int most)
{
    for (int i = 0; i < most && send_segment(sdo); i++) {
    }
}

void co_sdo_block_tick_ms(struct co_sdo *sdo)
{
    send_segments(sdo, CO_SDO_SEGMENTS_PER_MS);
}

/* A request that the bus has repeated changes nothing. */
void co_sdo_block_upload_step(struct co_sdo *sdo, const uint8_t *request)
{
    struct co_sdo_transfer *transfer = &sdo->transfer;
    const unsigned step = request[0] & STEP;
    const enum co_sdo_phase now = transfer->phase;
    if (step == STEP_START && (now == CO_SDO_BLOCK_UPLOAD_START || now == CO_SDO_BLOCK_UPLOAD)) {
        transfer->phase = CO_SDO_BLOCK_UPLOAD;
    } else if (step == STEP_ACKNOWLEDGE && now == CO_SDO_BLOCK_UPLOAD) {
        acknowledge(sdo, request[1], request[2]);
    } else if (step == STEP_END && (now == CO_SDO_BLOCK_UPLOAD_END || now == CO_SDO_IDLE)) {
        transfer->phase = CO_SDO_IDLE;
    } else if (step != STEP_ACKNOWLEDGE || now != CO_SDO_BLOCK_UPLOAD_END) {
        co_sdo_abort_transfer(sdo, SDO_ABORT_COMMAND);
    }
    if (transfer->phase == CO_SDO_BLOCK_UPLOAD && sdo->od->clock.pace != 0) {
        send_segments(sdo, BLOCK_MAX); /* no time passes until these are read, and no PDO wants the bus */
    }
}
