/* SPDX-License-Identifier: Apache-2.0 */
/* od/settings.h: the values of the dictionary at power-on and after a reset, and the objects that store them.
 *
 * At power-on every value is its default, or what has been stored over it. Objects 1010h and 1011h (CiA 301, 7.5.2.13
 * and 7.5.2.14) store values and restore defaults on command; 2001h holds node id and bit rate. store.h says how values
 * are stored.
 *
 * Background only; called by device.c.
 */
#ifndef KONTUR_SETTINGS_H
#define KONTUR_SETTINGS_H
#include "od/store.h"

enum { SETTINGS_SAVE_MS = 60000, SETTINGS_WORN_PERCENT = 80 };

struct settings {
    struct store store;
    struct od_data *od;
    const struct hal *hal;                  /* flash, can_bitrate */
    bool (*fits)(const struct od_data *od); /* whether the parameters fit together */
    uint8_t node_id;                        /* used where none is stored */
    unsigned
        invalid; /* STORE_ areas whose stored values are not in use as they are: one is out of range, or they do not
                       * fit together */
    uint16_t regain_ms; /* since 2170h:3 was less than its default, or has grown last */
    bool refused;       /* a save, until the next one is possible */
};

/* Power-on: od, which holds the defaults, gets the values that are stored. Parameters that do not fit together stay at
 * their defaults. Returns the node id, 1..31 or OD_UNCONFIGURED. */
uint8_t settings_init(struct settings *s, struct od_data *od, const struct hal *hal, uint8_t node_id,
                      bool (*fits)(const struct od_data *od));
/* The same as at power-on, for a reset of the communication objects only or of all objects. 2001h decides on the node id. */
uint8_t settings_reset(struct settings *s, bool communication_only);
/* Once a millisecond: another set may be written each SETTINGS_SAVE_MS. */
void settings_tick_ms(struct settings *s);
/* Whether the flash comes to the end of its life. */
bool settings_worn(const struct settings *s);
/* Whether a save was refused because of too many before, and none is possible yet. */
bool settings_refused(const struct settings *s);
/* Whether the flash holds values that cannot be used, and have neither been replaced nor restored since. */
bool settings_invalid(const struct settings *s);
/* SDO_OK, or why `value` cannot be written to 1010h, 1011h or 2001h. */
uint32_t settings_check(const struct settings *s, const struct od_entry *entry, int64_t value);
/* Carry out the command that writing 1010h or 1011h is, after settings_check(). node_id: the one in use. SDO_OK, also
 * where the flash holds just that already; or the abort code when the flash fails, or has been written too often of
 * late (2170h:3). */
uint32_t settings_command(struct settings *s, const struct od_entry *entry, uint8_t node_id);
/* Store 2001h alone (LSS). false: the flash failed, or has been written too often of late. */
bool settings_store_node(struct settings *s, uint8_t node_id);
#endif
