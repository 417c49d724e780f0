/* SPDX-License-Identifier: Apache-2.0 */
/* sdo.h: SDO server, one transfer at a time, expedited and segmented. A new request ends a transfer
 * that is under way. Requests that are no 8 bytes long are ignored.
 */
#ifndef CO_SDO_H
#define CO_SDO_H
#include <stdbool.h>
#include <stdint.h>

#include "hal.h"
#include "od.h"

enum co_sdo_transfer { CO_SDO_IDLE, CO_SDO_DOWNLOAD, CO_SDO_UPLOAD };

struct co_sdo {
    enum co_sdo_transfer transfer;
    const struct od_entry *entry;
    bool toggle;          /* of the next segment */
    uint32_t at;          /* bytes transferred */
    const uint8_t *data;  /* upload: the bytes, */
    uint32_t size;        /* and how many */
    uint8_t buffer[4];    /* download; no object that can be written is longer */
};

struct co_node;
void co_sdo_receive(struct co_node *node, const struct can_frame *frame);
#endif
