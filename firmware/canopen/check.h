/* SPDX-License-Identifier: Apache-2.0 */
/* check.h: whether an SDO may write a communication object, beyond the object's range (CiA 301, 7.5.2).
 *
 * It checks 1003h, 1005h, 1014h, 1019h, 1201h, and the objects of PDOs, 1400h to 1BFFh. Those change while the node is not
 * operational only, so that a PDO in use never has half of an old and half of a new description.
 *
 * The function is pure. node.c calls it before each write by SDO, in the background loop.
 */
#ifndef CO_CHECK_H
#define CO_CHECK_H
#include <stdbool.h>
#include <stdint.h>

#include "od/od.h"

/* SDO_OK, or the abort code. `value` is in range (od_check). Other objects are always OK. */
uint32_t co_check_write(const struct od_data *od, bool operational, const struct od_entry *entry, int64_t value);
#endif
