/* SPDX-License-Identifier: Apache-2.0 */
/* pdo.h: process data, 1400h.. to 1BFFh. The mapping is resolved once; COB-ID (valid bit) and event
 * time may be written. TPDOs go out by their event timers, in the order of their numbers, and when
 * the application says so.
 */
#ifndef CO_PDO_H
#define CO_PDO_H
#include <stdbool.h>
#include <stdint.h>

#include "hal.h"
#include "od.h"

enum { CO_RPDOS = 2, CO_TPDOS = 5, CO_PDO_ENTRIES = 8 };

struct co_pdo {
    const struct od_entry *entry[CO_PDO_ENTRIES];
    uint8_t count;
    uint8_t bytes;
    uint16_t id;         /* 0: not in use */
    uint16_t event_ms;   /* 0: no timer */
    uint16_t elapsed_ms; /* since it was sent */
};

struct co_node;

/* Send TPDO `number` (1...) now; its event timer starts anew. false: not operational, not in use,
 * or no room. */
bool co_tpdo_send(struct co_node *node, unsigned number);

/* For node.c, sdo.c: */
void co_pdo_init(struct co_node *node);
void co_pdo_start(struct co_node *node); /* operational: all are due */
void co_pdo_receive(struct co_node *node, const struct can_frame *frame);
void co_pdo_tick_ms(struct co_node *node);
/* SDO_OK, or the abort code for a COB-ID that is none or that changes while in use. */
uint32_t co_pdo_check(const struct co_node *node, const struct od_entry *entry, int64_t value);
void co_pdo_refresh(struct co_node *node); /* a communication object has been written */
#endif
