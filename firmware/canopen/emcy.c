/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/emcy.h"

#include "canopen/node.h"

void co_emcy_refresh(struct co_node *node)
{
    node->emcy.inhibit_left_ms = 0;
    if ((node->config.od->emcy_cob_id & COB_UNUSED) != 0) {
        node->emcy.waiting_count = 0;
    }
}

static bool in_effect(const struct co_emcy *emcy, uint16_t code)
{
    for (unsigned i = 0; i < emcy->count; i++) {
        if (emcy->code[i] == code) {
            return true;
        }
    }
    return false;
}

uint16_t co_emcy_code(const struct co_node *node, unsigned i)
{
    return i < node->emcy.count ? node->emcy.code[i] : 0;
}

bool co_emcy_of_node(const struct co_node *node)
{
    static const uint16_t codes[CO_ERRORS_OF_NODE] = {CO_EMCY_PDO_SHORT, CO_EMCY_PDO_LONG, CO_EMCY_SYNC_LENGTH,
                                                      CO_EMCY_PASSIVE,   CO_EMCY_WAS_OFF,  CO_EMCY_OVERRUN};
    for (unsigned i = 0; i < CO_ERRORS_OF_NODE; i++) {
        if (in_effect(&node->emcy, codes[i])) {
            return true;
        }
    }
    return false;
}

/* Waiting message `i` may be left out: it is not the only word of an error in effect. */
static bool dispensable(const struct co_emcy *emcy, unsigned i)
{
    const uint16_t code = emcy->waiting[i].code;
    for (unsigned k = i + 1; k < emcy->waiting_count; k++) {
        if (emcy->waiting[k].code == code) {
            return true;
        }
    }
    return !in_effect(emcy, code);
}

static void leave_out(struct co_emcy *emcy, unsigned i)
{
    emcy->waiting_count--;
    for (; i < emcy->waiting_count; i++) {
        emcy->waiting[i] = emcy->waiting[i + 1];
    }
}

/* Send what waits and may go; the inhibit time after a message lasts `inhibit_ms` ticks. Half of the node's frames that
 * wait for the bus are left to answers. */
static void send_waiting(struct co_node *node, unsigned inhibit_ms)
{
    struct co_emcy *emcy = &node->emcy;
    const bool allowed = node->state == CO_PRE_OPERATIONAL || node->state == CO_OPERATIONAL;
    while (allowed && emcy->waiting_count > 0 && emcy->inhibit_left_ms == 0 && node->tx_count < CO_TX_FRAMES / 2) {
        const struct co_emcy_message *message = &emcy->waiting[0];
        struct can_frame frame = {.id = (uint16_t)(node->config.od->emcy_cob_id & COB_ID_MASK), .len = 8};
        co_put(&frame.data[0], message->code, 2);
        frame.data[2] = message->reg;
        co_put(&frame.data[3], message->msef, 4);
        co_send(node, &frame); /* there is room */
        leave_out(emcy, 0);
        emcy->inhibit_left_ms = (uint16_t)inhibit_ms;
    }
}

/* Of 1015h, in 100 us */
static unsigned inhibit_ms(const struct co_node *node)
{
    return (node->config.od->emcy_inhibit + 9u) / 10u;
}

static void report(struct co_node *node, uint16_t code, uint32_t msef)
{
    struct co_emcy *emcy = &node->emcy;
    if ((node->config.od->emcy_cob_id & COB_UNUSED) != 0) {
        return;
    }
    for (unsigned i = 0; emcy->waiting_count == CO_EMCY_WAITING; i++) {
        if (dispensable(emcy, i)) {
            leave_out(emcy, i);
        }
    }
    emcy->waiting[emcy->waiting_count++] =
        (struct co_emcy_message){.code = code, .reg = node->config.od->error_register, .msef = msef};
    send_waiting(node, inhibit_ms(node) != 0 ? inhibit_ms(node) + 1 : 0); /* the next tick may follow at once */
}

void co_emcy_tick_ms(struct co_node *node)
{
    if (node->emcy.inhibit_left_ms > 0) {
        node->emcy.inhibit_left_ms--;
    }
    send_waiting(node, inhibit_ms(node));
}

static void remember(struct od_data *od, uint32_t entry)
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

void co_emcy_set(struct co_node *node, uint16_t code, uint8_t reg, uint32_t msef)
{
    struct co_emcy *emcy = &node->emcy;
    struct od_data *od = node->config.od;
    if (in_effect(emcy, code) || emcy->count == CO_ERRORS) {
        return;
    }
    reg |= CO_REG_GENERIC;
    emcy->code[emcy->count] = code;
    emcy->reg[emcy->count] = reg;
    emcy->count++;
    od->error_register |= reg;
    remember(od, code | msef << 16);
    report(node, code, msef);
}

void co_emcy_reset(struct co_node *node, uint16_t code)
{
    struct co_emcy *emcy = &node->emcy;
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
        node->config.od->error_register = reg;
        report(node, 0, 0);
    }
}
