/* SPDX-License-Identifier: Apache-2.0 */
#include "emcy.h"

#include "node.h"

static void report(struct co_node *node, uint16_t code, uint32_t msef)
{
    const struct od_data *od = node->config.od;
    if (node->state == CO_STOPPED || node->state == CO_INITIALISING) {
        return;
    }
    struct can_frame frame = {.id = (uint16_t)od->emcy_cob_id, .len = 8};
    co_put(&frame.data[0], code, 2);
    frame.data[2] = od->error_register;
    co_put(&frame.data[3], msef, 4);
    (void)co_send(node, &frame);
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
    for (unsigned i = 0; i < emcy->count; i++) {
        if (emcy->code[i] == code) {
            return;
        }
    }
    reg |= CO_REG_GENERIC;
    if (emcy->count < CO_ERRORS) {
        emcy->code[emcy->count] = code;
        emcy->reg[emcy->count] = reg;
        emcy->count++;
        od->error_register |= reg;
    }
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
