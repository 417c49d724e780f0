/* SPDX-License-Identifier: Apache-2.0 */
/* emcy.h: errors in effect, and their report: EMCY messages (1014h, 1015h), the error register 1001h and the error
 * history 1003h (CiA 301, 7.2.7).
 *
 * An error is known by its code (CiA 301, CiA 402) and is in effect from co_emcy_raise() to co_emcy_clear(). Each sends
 * a message, the second one with code 0 and the bits of the error register that remain. A message that must not be sent
 * yet waits: for the inhibit time 1015h, for the end of the NMT state stopped, or for room on the bus.
 *
 * When CO_EMCY_WAITING messages wait, the oldest one of an error that has ended is left out. The message that raises an
 * error still in effect is never left out. Each message holds the error register of the moment it was made.
 *
 * Background only. Called by bus_state.c, pdo.c and node.c, and by the application through node.h.
 */
#ifndef CO_EMCY_H
#define CO_EMCY_H
#include <stdbool.h>
#include <stdint.h>

#include "canopen/nmt.h"
#include "canopen/tx.h"
#include "od/od.h"

/* Codes that the node raises itself (CiA 301, table 26). Those of the length of PDOs and SYNC end with the next frame
 * of the right length, that of values when the latest frame of each RPDO has none to refuse; bus_state.h says when the others end. */
enum {
    CO_EMCY_OVERRUN = 0x8110,
    CO_EMCY_PASSIVE = 0x8120,
    CO_EMCY_WAS_OFF = 0x8140,
    CO_EMCY_PDO_VALUE = 0x8200,
    CO_EMCY_PDO_SHORT = 0x8210,
    CO_EMCY_PDO_LONG = 0x8220,
    CO_EMCY_SYNC_LENGTH = 0x8240,
    CO_EMCY_PDO_LATE = 0x8250,
    /* raised by the application: about the store of the dictionary, and about records, for one axis or too many */
    CO_EMCY_FLASH_WORN = 0xFF31,
    CO_EMCY_SAVE_REFUSED = 0xFF32,
    CO_EMCY_ONE_AXIS = 0xFF33,
    CO_EMCY_QUEUE_FULL = 0xFF34,
};
#define CO_ERRORS_OF_NODE 12

#define CO_ERRORS 48       /* most codes that can be in effect; the application's and the node's must fit */
#define CO_EMCY_WAITING 52 /* more than CO_ERRORS, so that there is always one to leave out */

struct co_emcy_message {
    uint16_t code; /* 0: an error has ended */
    uint8_t reg;
    uint32_t details;
};

struct co_emcy {
    struct od_data *od; /* 1001h, 1003h, 1014h, 1015h */
    struct co_tx *tx;
    const struct co_nmt *nmt; /* the state decides whether messages are sent */
    uint16_t code[CO_ERRORS]; /* in effect, oldest first */
    uint8_t reg[CO_ERRORS];   /* bits of the error register that each sets */
    uint8_t count;
    struct co_emcy_message waiting[CO_EMCY_WAITING]; /* oldest first */
    uint8_t waiting_count;
    uint16_t inhibit_left_ms;
};

/* Power-on, or NMT reset node: no error is in effect, and no message waits. */
void co_emcy_init(struct co_emcy *emcy, struct od_data *od, struct co_tx *tx, const struct co_nmt *nmt);
/* 1014h or 1015h may have changed: the inhibit time ends, and messages that nobody wants are dropped. */
void co_emcy_refresh(struct co_emcy *emcy);
/* An SDO has written the object `index`. */
void co_emcy_written(struct co_emcy *emcy, uint16_t index);
void co_emcy_tick_ms(struct co_emcy *emcy);

/* The error `code` is in effect from now on, and sets the bits `reg` (CO_REG_) of the error register. `details` are
 * bytes 3..6 of the message, the manufacturer-specific field. Nothing happens when the error is in effect already, or
 * when CO_ERRORS others are. */
void co_emcy_raise(struct co_emcy *emcy, uint16_t code, uint8_t reg, uint32_t details);
/* The error ends. Nothing happens when it is not in effect. */
void co_emcy_clear(struct co_emcy *emcy, uint16_t code);
bool co_emcy_in_effect(const struct co_emcy *emcy, uint16_t code);
#endif
