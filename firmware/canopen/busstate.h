/* SPDX-License-Identifier: Apache-2.0 */
/* busstate.h: what the CAN controller says of its bus, as object 2032h and as EMCY (CiA 301, table 26):
 *   8120h  error passive, or off: nobody acknowledges, the wrong bit rate, a broken cable. Ends when it is active again
 *   8140h  it was off and has come back. Ends when it is active again
 *   8110h  a frame came for which there was no room. Ends after a second without another
 * None stops the axes: whether the master is still there is the heartbeat's business (1016h).
 */
#ifndef CO_BUSSTATE_H
#define CO_BUSSTATE_H
#include <stdint.h>

enum { CO_EMCY_OVERRUN = 0x8110, CO_EMCY_PASSIVE = 0x8120, CO_EMCY_WAS_OFF = 0x8140 };

struct co_busstate {
    uint32_t rx_lost, bus_offs; /* known of */
    uint16_t overrun_ms;        /* until 8110h ends */
};

struct co_node;

/* From co_tick_ms(). */
void co_busstate_tick_ms(struct co_node *node);
#endif
