/* SPDX-License-Identifier: Apache-2.0 */
/* sdo.h: SDO server (CiA 301, 7.2.4), one transfer at a time: expedited, segmented and block, both ways.
 *
 * A new request ends a transfer that is under way, and so does a client's silence of CO_SDO_TIMEOUT_MS. Requests
 * that are no 8 bytes long are ignored. Background only.
 *
 * Block transfer (7.2.4.2.7 to .16) with CRC where the client wants it. Upload: blocks of 1..127 segments as the
 * client says, CO_SDO_SEGMENTS_PER_MS a millisecond, so that PDOs keep their place on the bus and nothing waits
 * for a long object (a block at once where time does not pass by itself, 2020h pace); an acknowledgement, also
 * within a block, goes back to the first segment that is missing. Download: no object that can be written is
 * longer than one segment, so a block is one segment; that also tells a new request from a segment.
 */
#ifndef CO_SDO_H
#define CO_SDO_H
#include <stdbool.h>
#include <stdint.h>

#include "hal/hal.h"
#include "od/od.h"

enum { CO_SDO_SEGMENT = 7, CO_SDO_SEGMENTS_PER_MS = 3, CO_SDO_TIMEOUT_MS = 2000 };

/* Command specifiers, bits 5..7 of byte 0: of the client, of the server. */
enum {
    CCS_DOWNLOAD_SEGMENT,
    CCS_DOWNLOAD,
    CCS_UPLOAD,
    CCS_UPLOAD_SEGMENT,
    CCS_ABORT,
    CCS_BLOCK_UPLOAD,
    CCS_BLOCK_DOWNLOAD,
};
enum {
    SCS_UPLOAD_SEGMENT = 0x00,
    SCS_DOWNLOAD_SEGMENT = 0x20,
    SCS_UPLOAD = 0x40,
    SCS_DOWNLOAD = 0x60,
    SCS_ABORT = 0x80,
    SCS_BLOCK_DOWNLOAD = 0xA0,
    SCS_BLOCK_UPLOAD = 0xC0,
};

enum co_sdo_transfer {
    CO_SDO_IDLE,
    CO_SDO_DOWNLOAD,
    CO_SDO_UPLOAD,
    CO_SDO_BLOCK_DOWNLOAD,     /* waits for the segment */
    CO_SDO_BLOCK_DOWNLOAD_END, /* waits for the end and its CRC */
    CO_SDO_BLOCK_UPLOAD_START, /* waits for the client's start */
    CO_SDO_BLOCK_UPLOAD,       /* segments go, or wait to be acknowledged */
    CO_SDO_BLOCK_UPLOAD_END,   /* the end is sent */
};

struct co_sdo {
    enum co_sdo_transfer transfer;
    const struct od_entry *entry;
    bool toggle;                    /* of the next segment */
    uint16_t silent_ms;             /* since the last step of the transfer */
    uint32_t at;                    /* bytes transferred; block upload: acknowledged, as a multiple of a segment */
    const uint8_t *data;            /* upload: the bytes (NULL: a domain), */
    uint32_t size;                  /* and how many */
    uint8_t buffer[CO_SDO_SEGMENT]; /* a number on its way */
    bool crc_wanted;
    uint16_t crc;
    uint32_t crc_at; /* bytes in crc */
    uint8_t block;   /* segments a block */
    uint8_t sent;    /* of the current block */
};

struct co_node;
void co_sdo_receive(struct co_node *node, const struct can_frame *frame);
void co_sdo_tick_ms(struct co_node *node);

/* Between sdo.c and sdo_block.c: */
struct can_frame co_sdo_response(const struct co_node *node, unsigned command);
/* A response that names its object. */
struct can_frame co_sdo_object_response(const struct co_node *node, unsigned command, const struct od_entry *entry);
/* End the transfer, which was about `entry` (NULL: none), telling why. */
void co_sdo_abort(struct co_node *node, const struct od_entry *entry, uint32_t code);
/* Why `size` bytes cannot be the value, or SDO_OK. */
uint32_t co_sdo_check_length(const struct od_entry *entry, uint32_t size);
/* Store the number in `data`, if everybody agrees: SDO_OK, or why not. */
uint32_t co_sdo_store(struct co_node *node, const struct od_entry *entry, const uint8_t *data);
/* Make the value ready to be sent: entry, data and size of node->sdo. SDO_OK, or why there is none. */
uint32_t co_sdo_prepare(struct co_node *node, const struct od_entry *entry);
/* `count` bytes of it; false: they are gone (of a domain). */
bool co_sdo_bytes(const struct co_node *node, uint32_t at, uint8_t *to, uint32_t count);
/* Answer an upload whose value is prepared: expedited, or its first segment. */
void co_sdo_upload(struct co_node *node);

void co_sdo_block_download(struct co_node *node, const struct od_entry *entry, const uint8_t *request);
void co_sdo_block_upload(struct co_node *node, const struct od_entry *entry, const uint8_t *request);
/* Whether the frame is a segment of a block download, which has no command specifier; it is handled. */
bool co_sdo_block_segment(struct co_node *node, const uint8_t *request);
/* Later steps. */
void co_sdo_block_download_end(struct co_node *node, const uint8_t *request);
void co_sdo_block_upload_step(struct co_node *node, const uint8_t *request);
void co_sdo_block_tick_ms(struct co_node *node);
#endif
