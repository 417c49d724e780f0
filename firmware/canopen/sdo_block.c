/* SPDX-License-Identifier: Apache-2.0 */
#include <stddef.h>
#include <string.h>

#include "canopen/node.h"
#include "canopen/sdo.h"

enum {
    BIT_CRC = 0x04,  /* the client wants it; so the server does it */
    BIT_SIZE = 0x02, /* the size is in bytes 4..7 */
    BIT_LAST = 0x80, /* of a segment: no more follow */
    SEQUENCE = 0x7F, /* of a segment: its number in the block, 1..127 */
    BLOCK_MAX = 127,
};
/* Bits 0..1: of the client (upload), of the server. */
enum { STEP_END = 1, STEP_ACKNOWLEDGE = 2, STEP_START = 3, STEP = 3 };
enum { SS_INITIATE = 0, SS_END = 1, SS_ACKNOWLEDGE = 2 };

/* CRC-16/CCITT, initial value 0 (7.2.4.3.16) */
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

static void fail(struct co_node *node, uint32_t code)
{
    co_sdo_abort(node, node->sdo.transfer == CO_SDO_IDLE ? NULL : node->sdo.entry, code);
}

/* ---- download ---- */

void co_sdo_block_download(struct co_node *node, const struct od_entry *entry, const uint8_t *request)
{
    uint32_t code = (entry->flags & OD_WRITE) != 0 ? SDO_OK : SDO_ABORT_READ_ONLY;
    if (code == SDO_OK && (request[0] & BIT_SIZE) != 0) {
        code = co_sdo_check_length(entry, co_get(&request[4], 4));
    }
    if (code != SDO_OK) {
        co_sdo_abort(node, entry, code);
        return;
    }
    node->sdo = (struct co_sdo){
        .transfer = CO_SDO_BLOCK_DOWNLOAD, .entry = entry, .block = 1, .crc_wanted = (request[0] & BIT_CRC) != 0};
    struct can_frame frame =
        co_sdo_object_response(node, SCS_BLOCK_DOWNLOAD | (request[0] & BIT_CRC) | SS_INITIATE, entry);
    frame.data[4] = node->sdo.block;
    co_send(node, &frame);
}

bool co_sdo_block_segment(struct co_node *node, const uint8_t *request)
{
    struct co_sdo *sdo = &node->sdo;
    if (sdo->transfer == CO_SDO_BLOCK_DOWNLOAD_END) {
        return request[0] == (BIT_LAST | 1); /* it has come twice */
    }
    if (sdo->transfer != CO_SDO_BLOCK_DOWNLOAD || (request[0] & SEQUENCE) != 1) {
        return false;
    }
    if ((request[0] & BIT_LAST) == 0) {
        fail(node, SDO_ABORT_TOO_LONG);
        return true;
    }
    memcpy(sdo->buffer, &request[1], sizeof sdo->buffer);
    sdo->transfer = CO_SDO_BLOCK_DOWNLOAD_END;
    struct can_frame frame = co_sdo_response(node, SCS_BLOCK_DOWNLOAD | SS_ACKNOWLEDGE);
    frame.data[1] = 1;
    frame.data[2] = sdo->block;
    co_send(node, &frame);
    return true;
}

void co_sdo_block_download_end(struct co_node *node, const uint8_t *request)
{
    struct co_sdo *sdo = &node->sdo;
    const uint32_t size = CO_SDO_SEGMENT - ((request[0] >> 2) & 7u);
    if (sdo->transfer != CO_SDO_BLOCK_DOWNLOAD_END) {
        fail(node, SDO_ABORT_COMMAND);
        return;
    }
    uint32_t code = co_sdo_check_length(sdo->entry, size);
    if (code == SDO_OK && sdo->crc_wanted && crc16(0, sdo->buffer, size) != co_get(&request[1], 2)) {
        code = SDO_ABORT_CRC;
    }
    if (code == SDO_OK) {
        code = co_sdo_store(node, sdo->entry, sdo->buffer);
    }
    if (code != SDO_OK) {
        fail(node, code);
        return;
    }
    sdo->transfer = CO_SDO_IDLE;
    const struct can_frame frame = co_sdo_response(node, SCS_BLOCK_DOWNLOAD | SS_END);
    co_send(node, &frame);
}

/* ---- upload ---- */

static bool is_block_size(uint8_t segments)
{
    return segments >= 1 && segments <= BLOCK_MAX;
}

void co_sdo_block_upload(struct co_node *node, const struct od_entry *entry, const uint8_t *request)
{
    struct co_sdo *sdo = &node->sdo;
    const uint8_t block = request[4], threshold = request[5];
    uint32_t code = co_sdo_prepare(node, entry);
    if (code == SDO_OK && !is_block_size(block)) {
        code = SDO_ABORT_BLOCK_SIZE;
    }
    if (code != SDO_OK) {
        co_sdo_abort(node, entry, code);
        return;
    }
    if (threshold != 0 && sdo->size <= threshold) { /* the client may take it the simple way */
        co_sdo_upload(node);
        return;
    }
    sdo->transfer = CO_SDO_BLOCK_UPLOAD_START;
    sdo->block = block;
    sdo->crc_wanted = (request[0] & BIT_CRC) != 0;
    struct can_frame frame =
        co_sdo_object_response(node, SCS_BLOCK_UPLOAD | (request[0] & BIT_CRC) | BIT_SIZE | SS_INITIATE, entry);
    co_put(&frame.data[4], sdo->size, 4);
    co_send(node, &frame);
}

/* Bytes from the first not acknowledged one on, in whole segments; an empty value has one segment, too. */
static uint32_t bytes_left(const struct co_sdo *sdo)
{
    const uint32_t segments = sdo->size == 0 ? 1 : (sdo->size + CO_SDO_SEGMENT - 1) / CO_SDO_SEGMENT;
    return segments * CO_SDO_SEGMENT - sdo->at;
}

static void send_end(struct co_node *node)
{
    struct co_sdo *sdo = &node->sdo;
    const uint32_t unused = sdo->at - sdo->size;
    struct can_frame frame = co_sdo_response(node, SCS_BLOCK_UPLOAD | unused << 2 | SS_END);
    co_put(&frame.data[1], sdo->crc_wanted ? sdo->crc : 0u, 2);
    sdo->transfer = CO_SDO_BLOCK_UPLOAD_END;
    co_send(node, &frame);
}

static void acknowledged(struct co_node *node, uint8_t sequence, uint8_t block)
{
    struct co_sdo *sdo = &node->sdo;
    if (sdo->sent == 0) {
        return; /* the last one has come twice */
    }
    if (sequence > sdo->sent) {
        fail(node, SDO_ABORT_SEQUENCE);
        return;
    }
    if (!is_block_size(block)) {
        fail(node, SDO_ABORT_BLOCK_SIZE);
        return;
    }
    sdo->at += (uint32_t)sequence * CO_SDO_SEGMENT;
    sdo->sent = 0;
    sdo->block = block;
    if (bytes_left(sdo) == 0) {
        send_end(node);
    }
}

/* The next segment; false when there is none to send, or no room. */
static bool send_segment(struct co_node *node)
{
    struct co_sdo *sdo = &node->sdo;
    const uint32_t ahead = (uint32_t)sdo->sent * CO_SDO_SEGMENT, at = sdo->at + ahead;
    if (sdo->sent == sdo->block || ahead == bytes_left(sdo) || node->tx_count > 0) {
        return false;
    }
    const bool last = bytes_left(sdo) - ahead == CO_SDO_SEGMENT;
    const uint32_t count = last ? sdo->size - at : CO_SDO_SEGMENT;
    struct can_frame frame = co_sdo_response(node, (sdo->sent + 1u) | (last ? (unsigned)BIT_LAST : 0u));
    if (!co_sdo_bytes(node, at, &frame.data[1], count)) {
        fail(node, SDO_ABORT_STATE);
        return false;
    }
    if (!co_transmit(node, &frame)) {
        return false;
    }
    sdo->sent++;
    sdo->silent_ms = 0;
    if (at == sdo->crc_at) { /* else it has been sent before */
        sdo->crc = crc16(sdo->crc, &frame.data[1], count);
        sdo->crc_at += count;
    }
    return true;
}

static void send_segments(struct co_node *node, int most)
{
    for (int i = 0; i < most && send_segment(node); i++) {
    }
}

void co_sdo_block_tick_ms(struct co_node *node)
{
    send_segments(node, CO_SDO_SEGMENTS_PER_MS);
}

/* A step that the bus has repeated has been taken already. */
void co_sdo_block_upload_step(struct co_node *node, const uint8_t *request)
{
    struct co_sdo *sdo = &node->sdo;
    const unsigned step = request[0] & STEP;
    const enum co_sdo_transfer now = sdo->transfer;
    if (step == STEP_START && (now == CO_SDO_BLOCK_UPLOAD_START || now == CO_SDO_BLOCK_UPLOAD)) {
        sdo->transfer = CO_SDO_BLOCK_UPLOAD;
    } else if (step == STEP_ACKNOWLEDGE && now == CO_SDO_BLOCK_UPLOAD) {
        acknowledged(node, request[1], request[2]);
    } else if (step == STEP_END && (now == CO_SDO_BLOCK_UPLOAD_END || now == CO_SDO_IDLE)) {
        sdo->transfer = CO_SDO_IDLE;
    } else if (step != STEP_ACKNOWLEDGE || now != CO_SDO_BLOCK_UPLOAD_END) {
        fail(node, SDO_ABORT_COMMAND);
    }
    if (sdo->transfer == CO_SDO_BLOCK_UPLOAD && node->config.od->clock.pace != 0) {
        send_segments(node, BLOCK_MAX); /* no time passes until it is read, and no PDO wants the bus */
    }
}
