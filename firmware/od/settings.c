/* SPDX-License-Identifier: Apache-2.0 */
#include "od/settings.h"

#define SIGNATURE_SAVE 0x65766173u /* "save" */
#define SIGNATURE_LOAD 0x64616F6Cu /* "load" */

enum { ALL = STORE_COMMUNICATION | STORE_APPLICATION | STORE_NODE };

/* ---- power-on and reset ---- */

static void load(struct settings *s, unsigned area)
{
    const bool valid = store_load(&s->store, s->od, area);
    s->invalid = (s->invalid & ~area) | (valid ? 0u : area);
}

static void restore_application(struct settings *s)
{
    od_restore(s->od, s->node_id, OD_APPLICATION_FIRST, OD_LAST);
}

static void reset_application(struct settings *s)
{
    restore_application(s);
    s->od->node.id = s->node_id;
    load(s, STORE_NODE);
    load(s, STORE_APPLICATION);
    if (!s->fits(s->od)) {
        const struct od_node node = s->od->node;
        s->invalid |= STORE_APPLICATION;
        restore_application(s);
        s->od->node = node;
    }
}

uint8_t settings_reset(struct settings *s, bool communication_only)
{
    if (!communication_only) {
        reset_application(s);
    }
    const uint8_t node_id = s->od->node.id;
    od_restore(s->od, node_id, OD_COMMUNICATION_FIRST, OD_COMMUNICATION_LAST);
    load(s, STORE_COMMUNICATION);
    return node_id;
}

uint8_t settings_init(struct settings *s, struct od_data *od, const struct hal *hal, uint8_t node_id,
                      bool (*fits)(const struct od_data *od))
{
    *s = (struct settings){.od = od, .hal = hal, .fits = fits, .node_id = node_id};
    store_open(&s->store, hal);
    od->store_writes = s->store.sequence;
    (void)store_load(&s->store, od, STORE_WEAR);
    return settings_reset(s, false);
}

bool settings_invalid(const struct settings *s)
{
    return s->store.damaged || s->invalid != 0;
}

/* ---- storing ---- */

/* See store_write(), unless the flash has just that. What has been saved or left out is not invalid any more. */
static uint32_t write(struct settings *s, uint8_t node_id, unsigned saved, unsigned retained)
{
    bool ok = store_holds(&s->store, s->od, node_id, saved, retained);
    if (!ok) {
        s->refused = s->od->flash_wear.saves_left == 0;
        if (s->refused) {
            return SDO_ABORT_STATE;
        }
        s->od->flash_wear.saves_left--;
        ok = store_write(&s->store, s->od, node_id, saved, retained);
        s->od->store_writes = s->store.sequence;
    }
    s->invalid &= ok ? retained : ALL;
    return ok ? SDO_OK : SDO_ABORT_HARDWARE;
}

void settings_tick_ms(struct settings *s)
{
    struct od_flash_wear *wear = &s->od->flash_wear;
    if (wear->saves_left >= od_defaults.flash_wear.saves_left) {
        return;
    }
    s->regain_ms++;
    if (s->regain_ms >= SETTINGS_SAVE_MS) {
        s->regain_ms = 0;
        s->refused = false;
        wear->saves_left++;
    }
}

bool settings_refused(const struct settings *s)
{
    return s->refused;
}

bool settings_worn(const struct settings *s)
{
    const uint32_t endurance = (uint32_t)od_number(s->od, OBJ_FLASH_WEAR, SUB_FLASH_WEAR_ENDURANCE);
    return s->od->flash_wear.erases >= endurance / 100u * SETTINGS_WORN_PERCENT;
}

uint32_t settings_check(const struct settings *s, const struct od_entry *entry, int64_t value)
{
    if (entry->index == OBJ_NODE) {
        const bool possible =
            entry->sub != SUB_NODE_BITRATE || s->hal->can_bitrate(s->hal->ctx, (uint16_t)value, false);
        return possible ? SDO_OK : SDO_ABORT_VALUE;
    }
    return value == (entry->index == OBJ_STORE ? SIGNATURE_SAVE : SIGNATURE_LOAD) ? SDO_OK : SDO_ABORT_STORE;
}

uint32_t settings_command(struct settings *s, const struct od_entry *entry, uint8_t node_id)
{
    /* By sub-index. Restoring leaves 2001h, so that the drive stays where it is on the bus. */
    static const unsigned saved[] = {[SUB_STORE_ALL] = ALL,
                                     [SUB_STORE_COMMUNICATION] = STORE_COMMUNICATION,
                                     [SUB_STORE_APPLICATION] = STORE_APPLICATION | STORE_NODE};
    static const unsigned restored[] = {[SUB_RESTORE_ALL] = STORE_COMMUNICATION | STORE_APPLICATION,
                                        [SUB_RESTORE_COMMUNICATION] = STORE_COMMUNICATION,
                                        [SUB_RESTORE_APPLICATION] = STORE_APPLICATION};
    const bool save = entry->index == OBJ_STORE;
    const unsigned replaced = save ? saved[entry->sub] : restored[entry->sub];
    return write(s, node_id, save ? replaced : 0u, ALL & ~replaced);
}

bool settings_store_node(struct settings *s, uint8_t node_id)
{
    return write(s, node_id, STORE_NODE, STORE_COMMUNICATION | STORE_APPLICATION) == SDO_OK;
}
