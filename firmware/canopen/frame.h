/* SPDX-License-Identifier: Apache-2.0 */
/* frame.h: numbers in the bytes of a CAN frame, and frame identifiers as the object dictionary holds them.
 *
 * CiA 301 sends numbers with the lowest byte first (7.1.4). The functions have no state and are called by all services
 * of this folder.
 */
#ifndef CO_FRAME_H
#define CO_FRAME_H
#include <stdint.h>

/* Bits of a COB-ID, the value of an object that holds the identifier of a PDO, of SYNC or of EMCY (CiA 301, 7.5.2). */
#define COB_UNUSED 0x80000000u /* the service is not in use */
#define COB_NO_RTR 0x40000000u /* a PDO that answers no remote frame */
#define COB_ID_MASK 0x7FFu

/* Put the lowest `count` bytes of `value`, 1..4, into `data`. */
void co_put(uint8_t *data, uint32_t value, uint8_t count);
/* The number in the first `count` bytes, 1..4. */
uint32_t co_get(const uint8_t *data, uint8_t count);
#endif
