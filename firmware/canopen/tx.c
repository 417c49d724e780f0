/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/tx.h"

static bool transmit(const struct co_tx *tx, const struct can_frame *frame)
{
    return !tx->muted && tx->hal->can_send(tx->hal->ctx, frame);
}

void co_tx_init(struct co_tx *tx, const struct hal *hal)
{
    *tx = (struct co_tx){.hal = hal};
}

void co_tx_flush(struct co_tx *tx)
{
    unsigned sent = 0;
    while (sent < tx->count && transmit(tx, &tx->queue[sent])) {
        sent++;
    }
    tx->count = (uint8_t)(tx->count - sent);
    for (unsigned i = 0; i < tx->count; i++) {
        tx->queue[i] = tx->queue[i + sent];
    }
}

void co_tx_send(struct co_tx *tx, const struct can_frame *frame)
{
    co_tx_flush(tx);
    if (!co_tx_send_now(tx, frame) && tx->count < CO_TX_FRAMES) {
        tx->queue[tx->count++] = *frame;
    }
}

bool co_tx_send_now(const struct co_tx *tx, const struct can_frame *frame)
{
    return tx->count == 0 && transmit(tx, frame);
}

void co_tx_clear(struct co_tx *tx)
{
    tx->count = 0;
}
