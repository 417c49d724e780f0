/* SPDX-License-Identifier: Apache-2.0 */
/* pdo.h: process data and SYNC (CiA 301, 7.2.2, 7.2.5), 1005h, 1019h, 1400h..1BFFh.
 *
 * TPDOs go out by their transmission type: at events and by a timer (254, 255), every n-th SYNC (1..240), or at the
 * SYNC after an event (0); those of one millisecond in the order of their numbers. Values are those of the moment a
 * frame leaves. RPDOs take effect at once (254, 255) or at the next SYNC (0..240), after the synchronous TPDOs of that
 * SYNC: these say what was before. Mapping and parameters change in pre-operational (check.h).
 *
 * An RPDO has exactly the length of its mapping. CiA 301 lets a device take a longer one, too; here that may be another
 * frame with a corrupted identifier: a knot is one bit away from controlwords.
 *
 * Times are whole milliseconds of co_tick_ms(); an inhibit time is rounded up.
 */
#ifndef CO_PDO_H
#define CO_PDO_H
#include <stdbool.h>
#include <stdint.h>

#include "hal/hal.h"
#include "od/od.h"

enum { PDO_SYNC_MAX = 240, PDO_EVENT = 254 }; /* transmission types */

#define COB_UNUSED 0x80000000u
#define COB_NO_RTR 0x40000000u
#define COB_ID_MASK 0x7FFu

struct co_pdo {
    const struct od_entry *entry[OD_PDO_ENTRIES];
    uint8_t count, bytes;
    uint16_t id; /* 0: not in use */
    uint8_t type;
    uint8_t data[8]; /* RPDO that waits for the SYNC */
    bool pending;    /* it does; TPDO: an event has not been told yet */
    /* of TPDOs */
    bool counting; /* the SYNC that counts as the first has come */
    uint8_t sync_start;
    uint8_t syncs;       /* since it was sent */
    uint16_t event_ms;   /* 0: no timer */
    uint16_t elapsed_ms; /* since it was sent */
    uint16_t inhibit_ms, inhibit_left_ms;
};

struct co_node;

/* Something happened that TPDO `number` (1...) tells: send it now, its event timer starts anew; or as soon as its
 * transmission type, inhibit time and the bus allow. false: not now. */
bool co_tpdo_send(struct co_node *node, unsigned number);
/* RPDO `number` carries a part of object `index`. */
bool co_rpdo_carries(const struct co_node *node, unsigned number, uint16_t index);
bool co_tpdo_carries(const struct co_node *node, unsigned number, uint16_t index);

/* For node.c, check.c: */
void co_pdo_refresh(struct co_node *node); /* the objects have changed */
void co_pdo_start(struct co_node *node);   /* operational: all with a timer are due */
void co_pdo_receive(struct co_node *node, const struct can_frame *frame);
void co_pdo_sync(struct co_node *node, const struct can_frame *frame);
void co_pdo_tick_ms(struct co_node *node);
/* The object that a mapping entry (index << 16 | sub << 8 | bits) names; NULL, and the abort code, if it is none. */
const struct od_entry *co_pdo_mappable(uint32_t map, bool transmit, uint32_t *code);
#endif
