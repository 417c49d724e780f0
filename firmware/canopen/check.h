/* SPDX-License-Identifier: Apache-2.0 */
/* check.h: what CiA 301 (7.5.2) wants checked, beyond the range, before an SDO writes a communication object:
 * 1003h, 1005h, 1014h, 1019h, and the PDOs' 1400h..1BFFh. Background only.
 *
 * PDOs change in pre-operational only, so that one that runs is never half one thing and half another.
 */
#ifndef CO_CHECK_H
#define CO_CHECK_H
#include <stdint.h>

#include "od/od.h"

struct co_node;

/* SDO_OK, or the abort code. `value` is in range (od_check). Other objects are always OK. */
uint32_t co_check_write(const struct co_node *node, const struct od_entry *entry, int64_t value);
#endif
