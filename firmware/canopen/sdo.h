/* SPDX-License-Identifier: Apache-2.0 */
/* sdo.h: the SDO server (CiA 301, 7.2.4), one transfer at a time: expedited, segmented and block, both ways.
 *
 * sdo_transfer.h says what an SDO is. A new request ends a transfer under way, and so does a client that is silent for
 * CO_SDO_TIMEOUT_MS. Requests that are not 8 bytes long are ignored. Background only; called by node.c.
 */
#ifndef CO_SDO_H
#define CO_SDO_H
#include "canopen/sdo_transfer.h"

enum { CO_SDO_REQUEST_ID = 0x600, CO_SDO_TIMEOUT_MS = 2000 }; /* the identifier plus the node id */

/* Power-on. */
void co_sdo_init(struct co_sdo *sdo, struct od_data *od, struct co_tx *tx, const struct co_sdo_hooks *hooks);
/* End the transfer under way without an answer to the client. */
void co_sdo_reset(struct co_sdo *sdo);
/* Handle a frame with the identifier of requests. Answers go to response_id. */
void co_sdo_receive(struct co_sdo *sdo, const struct can_frame *frame, uint16_t response_id);
void co_sdo_tick_ms(struct co_sdo *sdo);
#endif
