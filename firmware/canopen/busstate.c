/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/busstate.h"

#include <stddef.h>

#include "canopen/node.h"

enum { OVERRUN_MS = 1000 };

static void set_while(struct co_node *node, bool now, uint16_t code, uint32_t details)
{
    if (now) {
        co_emcy_set(node, code, CO_REG_COMMUNICATION, details);
    } else {
        co_emcy_reset(node, code);
    }
}

void co_busstate_tick_ms(struct co_node *node)
{
    const struct hal *hal = node->config.hal;
    struct co_busstate *known = &node->busstate;
    struct hal_can_status s;
    if (hal->can_status == NULL) {
        return;
    }
    hal->can_status(hal->ctx, &s);
    struct od_data *od = node->config.od;
    od->can.state = (uint8_t)s.state;
    od->can.tx_errors = s.tx_errors;
    od->can.rx_errors = s.rx_errors;
    od->can.rx_lost = s.rx_lost;
    od->can.bus_offs = s.bus_offs;

    const bool well = s.state == HAL_CAN_ACTIVE || s.state == HAL_CAN_WARNING;
    const uint32_t counters = (uint32_t)s.tx_errors | (uint32_t)s.rx_errors << 8;
    set_while(node, !well, CO_EMCY_PASSIVE, counters);
    if (s.bus_offs != known->bus_offs && s.state != HAL_CAN_OFF) {
        known->bus_offs = s.bus_offs;
        co_emcy_set(node, CO_EMCY_WAS_OFF, CO_REG_COMMUNICATION, s.bus_offs);
    } else if (well) {
        co_emcy_reset(node, CO_EMCY_WAS_OFF);
    }
    if (s.rx_lost != known->rx_lost) {
        known->rx_lost = s.rx_lost;
        known->overrun_ms = OVERRUN_MS;
        co_emcy_set(node, CO_EMCY_OVERRUN, CO_REG_COMMUNICATION, s.rx_lost);
    } else if (known->overrun_ms != 0 && --known->overrun_ms == 0) {
        co_emcy_reset(node, CO_EMCY_OVERRUN);
    }
}
