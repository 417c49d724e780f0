/* SPDX-License-Identifier: Apache-2.0 */
/* emcy.h: errors in effect, EMCY messages (1014h, 1015h), error register 1001h and history 1003h (CiA 301, 7.2.7).
 *
 * An error is known by its code (CiA 301/402) and stays in effect until it is reset. It sends one message when it begins
 * and one (code 0, and the register that is left) when it ends. A message that cannot go now, because of the inhibit
 * time, the NMT state stopped or a full bus, waits for its turn. Only when very many wait are some left out: those of
 * errors that have ended, the oldest first; the begin of every error that is in effect is always told, and the register
 * in every message is the one of its moment.
 */
#ifndef CO_EMCY_H
#define CO_EMCY_H
#include <stdbool.h>
#include <stdint.h>

/* Bits of the error register */
enum {
    CO_REG_GENERIC = 1, /* set with every error */
    CO_REG_CURRENT = 2,
    CO_REG_VOLTAGE = 4,
    CO_REG_TEMPERATURE = 8,
    CO_REG_COMMUNICATION = 16,
    CO_REG_PROFILE = 32,
    CO_REG_MANUFACTURER = 128,
};

/* Codes that the node raises itself; each ends with the next frame of the right length. */
enum { CO_EMCY_PDO_SHORT = 0x8210, CO_EMCY_PDO_LONG = 0x8220, CO_EMCY_SYNC_LENGTH = 0x8240 };

/* Those of the node: these, and those of busstate.h */
#define CO_ERRORS_OF_NODE 6
#define CO_ERRORS 36       /* that there can be */
#define CO_EMCY_WAITING 40 /* more than CO_ERRORS, so that there is always one to leave out */

struct co_emcy_message {
    uint16_t code; /* 0: an error has ended */
    uint8_t reg;
    uint32_t msef;
};

struct co_emcy {
    uint16_t code[CO_ERRORS];
    uint8_t reg[CO_ERRORS];
    uint8_t count;
    struct co_emcy_message waiting[CO_EMCY_WAITING]; /* oldest first */
    uint8_t waiting_count;
    uint16_t inhibit_left_ms;
};

struct co_node;

/* An error begins; nothing happens when it is in effect already. msef: bytes 3..6 of the message, as
 * you like. Nor when CO_ERRORS are: who has more codes makes room for all. */
void co_emcy_set(struct co_node *node, uint16_t code, uint8_t reg, uint32_t msef);
/* It ends; nothing happens when it is not in effect. */
void co_emcy_reset(struct co_node *node, uint16_t code);

/* The i-th code in effect, oldest first; 0: there are not so many. */
uint16_t co_emcy_code(const struct co_node *node, unsigned i);
/* An error that the node raises itself is in effect. */
bool co_emcy_of_node(const struct co_node *node);

/* For node.c: */
void co_emcy_refresh(struct co_node *node); /* 1014h, 1015h have changed */
void co_emcy_tick_ms(struct co_node *node);
#endif
