/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/bus_state.h"

#include <stdbool.h>
#include <stddef.h>

enum { OVERRUN_MS = 1000 };

void co_bus_state_init(struct co_bus_state *bus, struct od_data *od, const struct hal *hal, struct co_emcy *emcy)
{
    *bus = (struct co_bus_state){.od = od, .hal = hal, .emcy = emcy};
}

static void publish(struct od_data *od, const struct hal_can_status *s)
{
    od->can.state = (uint8_t)s->state;
    od->can.tx_errors = s->tx_errors;
    od->can.rx_errors = s->rx_errors;
    od->can.rx_lost = s->rx_lost;
    od->can.bus_offs = s->bus_offs;
}

static void report_passive(struct co_emcy *emcy, const struct hal_can_status *s, bool is_active)
{
    if (is_active) {
        co_emcy_clear(emcy, CO_EMCY_PASSIVE);
    } else {
        const uint32_t counters = (uint32_t)s->tx_errors | (uint32_t)s->rx_errors << 8;
        co_emcy_raise(emcy, CO_EMCY_PASSIVE, CO_REG_COMMUNICATION, counters);
    }
}

static void report_bus_off(struct co_bus_state *bus, const struct hal_can_status *s, bool is_active)
{
    if (s->bus_offs != bus->bus_offs && s->state != HAL_CAN_OFF) {
        bus->bus_offs = s->bus_offs;
        co_emcy_raise(bus->emcy, CO_EMCY_WAS_OFF, CO_REG_COMMUNICATION, s->bus_offs);
    } else if (is_active) {
        co_emcy_clear(bus->emcy, CO_EMCY_WAS_OFF);
    }
}

static void report_overrun(struct co_bus_state *bus, const struct hal_can_status *s)
{
    if (s->rx_lost != bus->rx_lost) {
        bus->rx_lost = s->rx_lost;
        bus->overrun_ms = OVERRUN_MS;
        co_emcy_raise(bus->emcy, CO_EMCY_OVERRUN, CO_REG_COMMUNICATION, s->rx_lost);
    } else if (bus->overrun_ms != 0 && --bus->overrun_ms == 0) {
        co_emcy_clear(bus->emcy, CO_EMCY_OVERRUN);
    }
}

void co_bus_state_tick_ms(struct co_bus_state *bus)
{
    struct hal_can_status s;
    if (bus->hal->can_status == NULL) {
        return;
    }
    bus->hal->can_status(bus->hal->ctx, &s);
    const bool is_active = s.state == HAL_CAN_ACTIVE || s.state == HAL_CAN_WARNING;
    publish(bus->od, &s);
    report_passive(bus->emcy, &s, is_active);
    report_bus_off(bus, &s, is_active);
    report_overrun(bus, &s);
}
