/* SPDX-License-Identifier: Apache-2.0 */
/* od/settings.h: what the dictionary holds at power-on and after a reset (defaults, and over them what is stored), and the
 * objects that store it: 1010h and 1011h (CiA 301, 7.5.2.13 and .14), 2001h. Background only.
 */
#ifndef KONTUR_SETTINGS_H
#define KONTUR_SETTINGS_H
#include "od/store.h"

struct settings {
    struct store store;
    struct od_data *od;
    const struct hal *hal;
    uint8_t node_id; /* where nothing is stored */
    unsigned unfit; /* STORE_ areas with stored values out of range, and at their defaults; or that do not fit together:
                      * all are */
};

/* od is set to what the drive starts with; returns the node id, 1..31 or OD_UNCONFIGURED. */
uint8_t settings_init(struct settings *s, struct od_data *od, const struct hal *hal, uint8_t node_id);
/* The same for a reset, of the communication objects only or of all; 2001h decides on the node id. */
uint8_t settings_reset(struct settings *s, bool communication_only);
/* The flash holds what could not be used: it has been neither saved nor restored since. */
bool settings_lost(const struct settings *s);
/* An SDO wants to write 1010h, 1011h or 2001h: do it, or tell why not. node_id: the one in use. */
uint32_t settings_command(struct settings *s, const struct od_entry *entry, int64_t value, uint8_t node_id);
/* Store 2001h alone (LSS). false: the flash failed. */
bool settings_store_node(struct settings *s, uint8_t node_id);
#endif
