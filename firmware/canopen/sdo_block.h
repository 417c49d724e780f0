/* SPDX-License-Identifier: Apache-2.0 */
/* sdo_block.h: SDO block transfer (CiA 301, 7.2.4.2.7 to 7.2.4.2.16), with CRC where the client wants it.
 *
 * In a block transfer several segments follow each other before one acknowledgement.
 *
 * Upload: blocks of 1..127 segments, as the client says. CO_SDO_SEGMENTS_PER_MS go out in a millisecond, so that a long
 * object delays neither PDOs nor anything else on the bus. When time passes with SYNC (2020h:4), all segments of a
 * block go out at once. An acknowledgement, also within a block, goes back to the first segment that is missing.
 *
 * Download: no object that can be written is longer than one segment, so a block is one segment. That also tells apart
 * a segment and a new request.
 *
 * Background only; called by sdo.c.
 */
#ifndef CO_SDO_BLOCK_H
#define CO_SDO_BLOCK_H
#include <stdbool.h>
#include <stdint.h>

#include "canopen/sdo_transfer.h"

enum { CO_SDO_SEGMENTS_PER_MS = 3 };

/* The first request of a download. */
void co_sdo_block_download(struct co_sdo *sdo, const struct od_entry *entry, const uint8_t *request);
/* Handle the segment of a download, which has no command specifier. false: the request is another one. */
bool co_sdo_block_segment(struct co_sdo *sdo, const uint8_t *request);
/* The last request of a download. */
void co_sdo_block_download_end(struct co_sdo *sdo, const uint8_t *request);

enum co_sdo_block_answer {
    CO_SDO_BLOCK_ANSWERED,
    CO_SDO_BLOCK_SWITCH, /* the value is short enough for the client to read it without blocks, and is prepared */
};
/* The first request of an upload. */
enum co_sdo_block_answer co_sdo_block_upload(struct co_sdo *sdo, const struct od_entry *entry, const uint8_t *request);
/* Any later request of an upload. */
void co_sdo_block_upload_step(struct co_sdo *sdo, const uint8_t *request);
/* Send segments of an upload; only in the phase CO_SDO_BLOCK_UPLOAD. */
void co_sdo_block_tick_ms(struct co_sdo *sdo);
#endif
