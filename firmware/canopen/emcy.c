/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/emcy.h"

#include "canopen/frame.h"

void co_emcy_init(struct co_emcy *emcy, struct od_data *od, struct co_tx *tx, const struct co_nmt *nmt)
{
    *emcy = (struct co_emcy){.od = od, .tx = tx, .nmt = nmt};
    od->error_register = 0;
}

static bool is_unused(const struct co_emcy *emcy)
{
    return (emcy->od->emcy_cob_id & COB_UNUSED) != 0;
}

void co_emcy_refresh(struct co_emcy *emcy)
{
    emcy->inhibit_left_ms = 0;
    if (is_unused(emcy)) {
        emcy->waiting_count = 0;
    }
}

void co_emcy_written(struct co_emcy *emcy, uint16_t index)
{
    if (index == OBJ_EMCY_COB_ID || index == OBJ_EMCY_INHIBIT) {
        co_emcy_refresh(emcy);
    }
}

bool co_emcy_in_effect(const struct co_emcy *emcy, uint16_t code)
{
    for (unsigned i = 0; i < emcy->count; i++) {
        if (emcy->code[i] == code) {
            return true;
        }
    }
    return false;
}

/* ---- messages ---- */

/* Message `i` that waits may be left out: its error has ended, or a later message has the same code. */
static bool is_dispensable(const struct co_emcy *emcy, unsigned i)
{
    const uint16_t code = emcy->waiting[i].code;
    for (unsigned k = i + 1; k < emcy->waiting_count; k++) {
        if (emcy->waiting[k].code == code) {
            return true;
        }
    }
    return !co_emcy_in_effect(emcy, code);
}

static void remove_message(struct co_emcy *emcy, unsigned i)
{
    emcy->waiting_count--;
    for (; i < emcy->waiting_count; i++) {
        emcy->waiting[i] = emcy->waiting[i + 1];
    }
}

/* Send the messages that wait, as far as they may go. After each an inhibit time of `inhibit_ms` ticks begins. Half of
 * the queue for the bus is left to the answers of other services, so there is room whenever a message is sent. */
static void send_waiting(struct co_emcy *emcy, unsigned inhibit_ms)
{
    const bool allowed = emcy->nmt->state == CO_PRE_OPERATIONAL || emcy->nmt->state == CO_OPERATIONAL;
    while (allowed && emcy->waiting_count > 0 && emcy->inhibit_left_ms == 0 && emcy->tx->count < CO_TX_FRAMES / 2) {
        const struct co_emcy_message *message = &emcy->waiting[0];
        struct can_frame frame = {.id = (uint16_t)(emcy->od->emcy_cob_id & COB_ID_MASK), .len = 8};
        co_put(&frame.data[0], message->code, 2);
        frame.data[2] = message->reg;
        co_put(&frame.data[3], message->details, 4);
        co_tx_send(emcy->tx, &frame);
        remove_message(emcy, 0);
        emcy->inhibit_left_ms = (uint16_t)inhibit_ms;
    }
}

/* 1015h counts 100 us. */
static unsigned inhibit_ms(const struct co_emcy *emcy)
{
    return (emcy->od->emcy_inhibit + 9u) / 10u;
}

static void report(struct co_emcy *emcy, uint16_t code, uint32_t details)
{
    if (is_unused(emcy)) {
        return;
    }
    for (unsigned i = 0; emcy->waiting_count == CO_EMCY_WAITING; i++) {
        if (is_dispensable(emcy, i)) {
            remove_message(emcy, i);
        }
    }
    emcy->waiting[emcy->waiting_count++] =
        (struct co_emcy_message){.code = code, .reg = emcy->od->error_register, .details = details};
    send_waiting(emcy, inhibit_ms(emcy) != 0 ? inhibit_ms(emcy) + 1 : 0); /* the next tick may follow at once */
}

void co_emcy_tick_ms(struct co_emcy *emcy)
{
    if (emcy->inhibit_left_ms > 0) {
        emcy->inhibit_left_ms--;
    }
    send_waiting(emcy, inhibit_ms(emcy));
}

/* ---- errors ---- */

static void add_to_history(struct od_data *od, uint32_t entry)
{
    enum { SIZE = sizeof od->error_history / sizeof od->error_history[0] };
    for (unsigned i = SIZE - 1; i > 0; i--) {
        od->error_history[i] = od->error_history[i - 1];
    }
    od->error_history[0] = entry;
    if (od->error_history_count < SIZE) {
        od->error_history_count++;
    }
}

void co_emcy_raise(struct co_emcy *emcy, uint16_t code, uint8_t reg, uint32_t details)
{
    if (co_emcy_in_effect(emcy, code) || emcy->count == CO_ERRORS) {
        return;
    }
    reg |= CO_REG_GENERIC;
    emcy->code[emcy->count] = code;
    emcy->reg[emcy->count] = reg;
    emcy->count++;
    emcy->od->error_register |= reg;
    add_to_history(emcy->od, code | details << 16);
    report(emcy, code, details);
}

void co_emcy_clear(struct co_emcy *emcy, uint16_t code)
{
    uint8_t left = 0, reg = 0;
    for (unsigned i = 0; i < emcy->count; i++) {
        if (emcy->code[i] != code) {
            emcy->code[left] = emcy->code[i];
            emcy->reg[left] = emcy->reg[i];
            reg |= emcy->reg[i];
            left++;
        }
    }
    if (left != emcy->count) {
        emcy->count = left;
        emcy->od->error_register = reg;
        report(emcy, 0, 0);
    }
}
