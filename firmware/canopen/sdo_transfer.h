/* SPDX-License-Identifier: Apache-2.0 */
/* sdo_transfer.h: what all kinds of SDO transfer have in common (CiA 301, 7.2.4): the object that is read or written,
 * its value on the way, and the frames of the answers.
 *
 * An SDO is a service data object: a client, mostly the master, writes (download) or reads (upload) one object of the
 * dictionary. A short value fits into one frame (expedited); a longer one comes in segments, or in blocks of segments.
 *
 * sdo.c serves expedited and segmented transfers, sdo_block.c block transfers. Background only.
 */
#ifndef CO_SDO_TRANSFER_H
#define CO_SDO_TRANSFER_H
#include <stdbool.h>
#include <stdint.h>

#include "canopen/tx.h"
#include "hal/hal.h"
#include "od/od.h"

enum { CO_SDO_SEGMENT = 7 }; /* bytes */

/* Command specifiers, bits 5..7 of byte 0: those of the client, and in place those of the server. */
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

/* Functions of the node that a transfer calls. */
struct co_sdo_hooks {
    void *ctx;
    /* `value`, which is in range, is to be written. SDO_OK, or the abort code to answer with. */
    uint32_t (*before_write)(void *ctx, const struct od_entry *entry, int64_t value);
    /* The value has been written. */
    void (*on_write)(void *ctx, const struct od_entry *entry);
    /* The value is to be read: bring it up to date. */
    void (*before_read)(void *ctx, const struct od_entry *entry);
    /* The number of bytes of a domain; 0: there are none. */
    uint32_t (*domain_size)(void *ctx, const struct od_entry *entry);
    /* Put `count` bytes of a domain from `at` on into `to`. false: the domain has changed. */
    bool (*domain_read)(void *ctx, const struct od_entry *entry, uint32_t at, uint8_t *to, uint32_t count);
};

enum co_sdo_phase {
    CO_SDO_IDLE,
    CO_SDO_DOWNLOAD,           /* the next segment is awaited */
    CO_SDO_UPLOAD,             /* the request for the next segment is awaited */
    CO_SDO_BLOCK_DOWNLOAD,     /* the segment is awaited */
    CO_SDO_BLOCK_DOWNLOAD_END, /* the end and its CRC are awaited */
    CO_SDO_BLOCK_UPLOAD_START, /* the client's start is awaited */
    CO_SDO_BLOCK_UPLOAD,       /* segments are sent, or their acknowledgement is awaited */
    CO_SDO_BLOCK_UPLOAD_END,   /* the end has been sent */
};

struct co_sdo_transfer {
    enum co_sdo_phase phase;
    const struct od_entry *entry;
    bool toggle;                    /* bit of the next segment */
    uint32_t at;                    /* bytes transferred; block upload: acknowledged, a multiple of a segment */
    const uint8_t *data;            /* upload: the value; NULL: a domain */
    uint32_t size;                  /* upload: bytes of the value */
    uint8_t buffer[CO_SDO_SEGMENT]; /* a number on its way */
    /* of block transfers */
    bool crc_wanted;
    uint16_t crc;
    uint32_t crc_at; /* bytes that the crc covers */
    uint8_t block;   /* segments of a block */
    uint8_t sent;    /* segments of the present block */
};

struct co_sdo {
    struct od_data *od;
    struct co_tx *tx;
    struct co_sdo_hooks hooks;
    uint16_t response_id; /* of the latest request */
    uint16_t silent_ms;   /* since the last step of the transfer */
    struct co_sdo_transfer transfer;
};

/* A response, and one that names its object. */
struct can_frame co_sdo_response(const struct co_sdo *sdo, unsigned command);
struct can_frame co_sdo_object_response(const struct co_sdo *sdo, unsigned command, const struct od_entry *entry);
/* End the transfer with an abort code. The first is for a request that began none, the second for the one under way. */
void co_sdo_abort(struct co_sdo *sdo, const struct od_entry *entry, uint32_t code);
void co_sdo_abort_transfer(struct co_sdo *sdo, uint32_t code);

/* SDO_OK, or why the object cannot be written. */
uint32_t co_sdo_check_access(const struct od_entry *entry);
/* SDO_OK, or why `size` bytes cannot be the object's value. */
uint32_t co_sdo_check_length(const struct od_entry *entry, uint32_t size);
/* Write the number in `data` if all checks and hooks agree. SDO_OK, or why it has not been written. */
uint32_t co_sdo_write_value(struct co_sdo *sdo, const struct od_entry *entry, const uint8_t *data);
/* Prepare an upload: set entry, data and size of a new transfer. SDO_OK, or why there is no value. */
uint32_t co_sdo_read_value(struct co_sdo *sdo, const struct od_entry *entry);
/* Put `count` bytes of the prepared value from `at` on into `to`. false: it is a domain, which has changed. */
bool co_sdo_value_bytes(const struct co_sdo *sdo, uint32_t at, uint8_t *to, uint32_t count);
#endif
