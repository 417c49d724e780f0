/* SPDX-License-Identifier: Apache-2.0 */
#include "od/settings.h"

#include "drive/configuration.h"

#define SIGNATURE_SAVE 0x65766173u /* "save" */
#define SIGNATURE_LOAD 0x64616F6Cu /* "load" */

enum { ALL = STORE_COMMUNICATION | STORE_APPLICATION | STORE_NODE };

static void load(struct settings *s, unsigned area)
{
    const bool whole = store_load(&s->store, s->od, area);
    s->unfit = (s->unfit & ~area) | (whole ? 0u : area);
}

static void reset_application(struct settings *s, uint8_t node_id)
{
    od_restore(s->od, node_id, 0x2000, 0xFFFF);
    s->od->node.id = s->node_id;
    load(s, STORE_NODE);
    load(s, STORE_APPLICATION);
    if (!configuration_fits(s->od)) {
        s->unfit |= STORE_APPLICATION;
        const struct od_node kept = s->od->node;
        od_restore(s->od, node_id, 0x2000, 0xFFFF);
        s->od->node = kept;
    }
}

uint8_t settings_reset(struct settings *s, bool communication_only)
{
    if (!communication_only) {
        reset_application(s, s->node_id);
    }
    const uint8_t node_id = s->od->node.id;
    od_restore(s->od, node_id, 0x1000, 0x1FFF);
    load(s, STORE_COMMUNICATION);
    return node_id;
}

uint8_t settings_init(struct settings *s, struct od_data *od, const struct hal *hal, uint8_t node_id)
{
    *s = (struct settings){.od = od, .hal = hal, .node_id = node_id};
    store_open(&s->store, hal);
    od->store_writes = s->store.sequence;
    return settings_reset(s, false);
}

bool settings_lost(const struct settings *s)
{
    return s->store.damaged || s->unfit != 0;
}

static bool write(struct settings *s, uint8_t node_id, unsigned take, unsigned keep)
{
    const bool ok = store_write(&s->store, s->od, node_id, take, keep);
    s->unfit &= ok ? keep : ALL;
    s->od->store_writes = s->store.sequence;
    return ok;
}

uint32_t settings_command(struct settings *s, const struct od_entry *entry, int64_t value, uint8_t node_id)
{
    /* by sub-index: all, communication, application */
    static const unsigned saved[] = {0, ALL, STORE_COMMUNICATION, STORE_APPLICATION | STORE_NODE};
    /* a drive keeps its place on the bus */
    static const unsigned restored[] = {0, STORE_COMMUNICATION | STORE_APPLICATION, STORE_COMMUNICATION,
                                        STORE_APPLICATION};
    if (entry->index == 0x2001) {
        const bool possible = entry->sub != 2 || s->hal->can_bitrate(s->hal->ctx, (uint16_t)value, false);
        return possible ? SDO_OK : SDO_ABORT_VALUE;
    }
    const bool save = entry->index == 0x1010;
    if (value != (save ? SIGNATURE_SAVE : SIGNATURE_LOAD)) {
        return SDO_ABORT_STORE;
    }
    const unsigned take = save ? saved[entry->sub] : 0u;
    const unsigned keep = ALL & ~(save ? take : restored[entry->sub]);
    return write(s, node_id, take, keep) ? SDO_OK : SDO_ABORT_HARDWARE;
}

bool settings_store_node(struct settings *s, uint8_t node_id)
{
    return write(s, node_id, STORE_NODE, STORE_COMMUNICATION | STORE_APPLICATION);
}
