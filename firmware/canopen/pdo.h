/* SPDX-License-Identifier: Apache-2.0 */
/* pdo.h: process data objects (PDOs) and SYNC (CiA 301, 7.2.2 and 7.2.5): 1005h, 1019h, 1400h to 1BFFh.
 *
 * A PDO is a frame whose bytes are values of the object dictionary. Its communication object (14xxh, 18xxh) holds
 * identifier, transmission type and times; its mapping object (16xxh, 1Axxh) says which values. Both change in
 * pre-operational only (check.h).
 *
 * A TPDO, which the node transmits, goes out by its transmission type: at events and by a timer (254, 255), at every
 * n-th SYNC (1..240), or at the SYNC after an event (0). Those of one millisecond go in the order of their numbers.
 * Values are those of the moment the frame leaves.
 *
 * An RPDO, which the node receives, takes effect at once (254, 255) or at the next SYNC (0..240). At a SYNC the TPDOs
 * go first, so they hold what was before it. An RPDO must be exactly as long as its mapping. CiA 301 lets a device take
 * a longer one, too; here that may be another frame with a corrupted identifier: a knot of the path is one bit away
 * from the controlwords. A value that its object does not take is left out (EMCY 8200h), and all others of the frame have
 * their effect: a stop must not wait for a value beside it to be right. All RPDOs with the same identifier get the frame.
 *
 * An RPDO with an event timer is watched: from its first frame on, the next one is late after that time (EMCY 8250h).
 *
 * Times are counted in calls of co_pdo_tick_ms(), one each millisecond; an inhibit time is rounded up. Background only; called by node.c,
 * and by the application through node.h.
 */
#ifndef CO_PDO_H
#define CO_PDO_H
#include <stdbool.h>
#include <stdint.h>

#include "canopen/emcy.h"
#include "canopen/tx.h"
#include "hal/hal.h"
#include "od/od.h"

enum { PDO_SYNC_MAX = 240, PDO_EVENT = 254 }; /* transmission types */

/* Functions of the node that are called for PDOs. */
struct co_pdo_hooks {
    void *ctx;
    uint32_t (*check_rpdo)(void *ctx, const struct od_entry *entry, int64_t value); /* SDO_OK, or why it is refused */
    void (*on_rpdo)(void *ctx, unsigned number); /* the values of RPDO `number` (1...) are stored */
    void (*on_tpdo)(void *ctx, unsigned number); /* TPDO `number` (1...) has been handed to the bus */
};

/* What a PDO carries. */
struct co_pdo_mapping {
    const struct od_entry *entry[OD_PDO_ENTRIES];
    uint8_t count, bytes;
};

struct co_rpdo {
    struct co_pdo_mapping mapping;
    uint16_t id; /* 0: not in use */
    uint8_t type;
    bool pending;      /* `data` takes effect at the next SYNC */
    bool refused;      /* a value of the latest frame */
    bool late;         /* no frame has come for event_ms since the last one */
    uint16_t event_ms; /* 0: not watched */
    uint32_t left_ms;  /* until the next frame is late; 0: none is awaited */
    uint8_t data[8];
};

struct co_tpdo {
    struct co_pdo_mapping mapping;
    uint16_t id; /* 0: not in use */
    uint8_t type;
    bool pending; /* an event has not been sent yet */
    /* type 1..240 */
    uint8_t sync_start; /* counter of the SYNC to count from; 0: any */
    bool counting;      /* that SYNC has come */
    uint8_t syncs;      /* since the last frame */
    /* type 254, 255 */
    uint16_t event_ms;   /* period of the timer; 0: none */
    uint16_t elapsed_ms; /* since the last frame */
    uint16_t inhibit_ms, inhibit_left_ms;
};

struct co_pdo {
    struct od_data *od;
    struct co_tx *tx;
    struct co_emcy *emcy;
    struct co_pdo_hooks hooks;
    struct co_rpdo rpdo[OD_RPDOS];
    struct co_tpdo tpdo[OD_TPDOS];
};

/* Power-on. co_pdo_refresh() is to follow. */
void co_pdo_init(struct co_pdo *pdo, struct od_data *od, struct co_tx *tx, struct co_emcy *emcy,
                 const struct co_pdo_hooks *hooks);
/* The objects of PDOs may have changed. */
void co_pdo_refresh(struct co_pdo *pdo);
/* An SDO has written the object `index`. */
void co_pdo_written(struct co_pdo *pdo, uint16_t index);
/* The node is operational from now on: TPDOs with a timer are due at once. */
void co_pdo_start(struct co_pdo *pdo);

/* The following are for a node that is operational. */
void co_pdo_receive(struct co_pdo *pdo, const struct can_frame *frame);
/* false: the frame is no SYNC, since its length is wrong. */
bool co_pdo_sync(struct co_pdo *pdo, const struct can_frame *frame);
void co_pdo_tick_ms(struct co_pdo *pdo);
/* An event has happened that TPDO `number` (1...) reports: send it now, and start its timer anew, or send it as soon as
 * its transmission type, its inhibit time and the bus allow. false: it was not sent now. */
bool co_pdo_send(struct co_pdo *pdo, unsigned number);

/* Whether an RPDO that is watched is late. */
bool co_pdo_late(const struct co_pdo *pdo);
/* Whether a part of object `index` is mapped. */
bool co_pdo_carries(const struct co_pdo_mapping *mapping, uint16_t index);
/* The object that a mapping entry (index << 16 | sub-index << 8 | bits) names. NULL: it cannot be mapped, and *code is
 * the abort code that says why. */
const struct od_entry *co_pdo_mappable(uint32_t map, bool transmit, uint32_t *code);
#endif
