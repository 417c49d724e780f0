/* SPDX-License-Identifier: Apache-2.0 */
/* tx.h: frames on their way to the bus.
 *
 * The CAN controller may have no room for a frame. An answer or a message is then queued here and sent later, in the
 * order of the calls. A PDO is not queued, because its values would be old when it leaves.
 *
 * Background only. All services of this folder send through it; co_tick_ms() of node.h empties the queue.
 */
#ifndef CO_TX_H
#define CO_TX_H
#include <stdbool.h>
#include <stdint.h>

#include "hal/hal.h"

#define CO_TX_FRAMES 8

struct co_tx {
    const struct hal *hal;                /* can_send */
    bool muted;                           /* nothing is sent, because the bit rate of the bus is changing (lss.h) */
    struct can_frame queue[CO_TX_FRAMES]; /* oldest first */
    uint8_t count;
};

void co_tx_init(struct co_tx *tx, const struct hal *hal);
/* Send the frame behind those in the queue, or queue it. It is dropped when the queue is full. */
void co_tx_send(struct co_tx *tx, const struct can_frame *frame);
/* Send the frame now. false: there is no room, others are in the queue, or nothing may be sent. It is not queued. */
bool co_tx_send_now(const struct co_tx *tx, const struct can_frame *frame);
/* Send of the queue what there is room for. */
void co_tx_flush(struct co_tx *tx);
/* Drop the queue. */
void co_tx_clear(struct co_tx *tx);
#endif
