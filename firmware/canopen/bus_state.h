/* SPDX-License-Identifier: Apache-2.0 */
/* bus_state.h: what the CAN controller reports of its bus, as object 2032h and as EMCY (CiA 301, table 26).
 *
 *   8120h  The controller is error passive or off: nobody acknowledges, the bit rate is wrong, or a cable is broken.
 *          The error ends when the controller is error active again.
 *   8140h  The controller was off and has come back. The error ends when it is error active again.
 *   8110h  A frame came for which there was no room. The error ends after a second without another one.
 *
 * None of them stops the axes. If the bus is gone, the missing heartbeat of the master stops them (1016h).
 * Background only; called by node.c.
 */
#ifndef CO_BUS_STATE_H
#define CO_BUS_STATE_H
#include <stdint.h>

#include "canopen/emcy.h"
#include "hal/hal.h"
#include "od/od.h"

struct co_bus_state {
    struct od_data *od;    /* 2032h */
    const struct hal *hal; /* can_status */
    struct co_emcy *emcy;
    uint32_t rx_lost;    /* of the controller's counter, reported by EMCY */
    uint32_t bus_offs;   /* the same */
    uint16_t overrun_ms; /* until 8110h ends */
};

void co_bus_state_init(struct co_bus_state *bus, struct od_data *od, const struct hal *hal, struct co_emcy *emcy);
void co_bus_state_tick_ms(struct co_bus_state *bus);
#endif
