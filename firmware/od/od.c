/* SPDX-License-Identifier: Apache-2.0 */
#include "od/od.h"

#include <stddef.h>
#include <string.h>

static void *field_of(struct od_data *od, const struct od_entry *entry)
{
    return (unsigned char *)od + entry->offset;
}

static const void *const_field_of(const struct od_data *od, const struct od_entry *entry)
{
    return (const unsigned char *)od + entry->offset;
}

static void restore_default(struct od_data *od, uint8_t node_id, const struct od_entry *entry)
{
    const int64_t value = od_read(&od_defaults, entry);
    od_write(od, entry, (entry->flags & OD_NODE_ID) ? value + node_id : value);
}

void od_init(struct od_data *od, uint8_t node_id)
{
    *od = od_defaults;
    for (uint16_t i = 0; i < od_table_len; i++) {
        if ((od_table[i].flags & OD_NODE_ID) != 0) {
            restore_default(od, node_id, &od_table[i]);
        }
    }
}

void od_restore(struct od_data *od, uint8_t node_id, uint16_t first, uint16_t last)
{
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *e = &od_table[i];
        if ((e->flags & (OD_WRITE | OD_NODE_ID)) != 0 && e->index >= first && e->index <= last) {
            restore_default(od, node_id, e);
        }
    }
}

const struct od_entry *od_find(uint16_t index, uint8_t sub, uint32_t *abort)
{
    const uint32_t key = (uint32_t)index << 8 | sub;
    uint16_t low = 0, high = od_table_len;
    while (low < high) {
        const uint16_t middle = (uint16_t)((low + high) / 2);
        const struct od_entry *e = &od_table[middle];
        const uint32_t at = (uint32_t)e->index << 8 | e->sub;
        if (at == key) {
            return e;
        }
        if (at < key) {
            low = (uint16_t)(middle + 1);
        } else {
            high = middle;
        }
    }
    /* Every object has a sub 0, so an entry of the same object would be just before the gap. */
    *abort = low > 0 && od_table[low - 1].index == index ? SDO_ABORT_NO_SUB : SDO_ABORT_NO_OBJECT;
    return NULL;
}

uint8_t od_size(const struct od_entry *entry)
{
    static const uint8_t bytes[] = {
        [OD_U8] = 1,  [OD_I8] = 1,  [OD_U16] = 2,    [OD_I16] = 2,    [OD_I24] = 3,
        [OD_U32] = 4, [OD_I32] = 4, [OD_STRING] = 0, [OD_DOMAIN] = 0,
    };
    return bytes[entry->type];
}

int64_t od_read(const struct od_data *od, const struct od_entry *entry)
{
    if ((entry->flags & OD_CONST) != 0) {
        return entry->min;
    }
    const void *p = const_field_of(od, entry);
    switch (entry->type) {
    case OD_U8: return *(const uint8_t *)p;
    case OD_I8: return *(const int8_t *)p;
    case OD_U16: return *(const uint16_t *)p;
    case OD_I16: return *(const int16_t *)p;
    case OD_U32: return *(const uint32_t *)p;
    default: return *(const int32_t *)p;
    }
}

int64_t od_number(const struct od_data *od, unsigned index, unsigned sub)
{
    uint32_t abort = 0;
    const struct od_entry *e = od_find((uint16_t)index, (uint8_t)sub, &abort);
    return e ? od_read(od, e) : 0;
}

const char *od_text(const struct od_data *od, const struct od_entry *entry)
{
    const char *text;
    memcpy(&text, const_field_of(od, entry), sizeof text);
    return text ? text : "";
}

uint32_t od_check(const struct od_entry *entry, int64_t value)
{
    if (value > entry->max) {
        return SDO_ABORT_TOO_HIGH;
    }
    return value < entry->min ? SDO_ABORT_TOO_LOW : SDO_OK;
}

void od_write(struct od_data *od, const struct od_entry *entry, int64_t value)
{
    void *p = field_of(od, entry);
    switch (od_size(entry)) {
    case 1: *(uint8_t *)p = (uint8_t)value; break;
    case 2: *(uint16_t *)p = (uint16_t)value; break;
    default: *(uint32_t *)p = (uint32_t)value; break;
    }
}

int64_t od_decode(const struct od_entry *entry, const uint8_t *data)
{
    const uint8_t size = od_size(entry);
    uint32_t raw = 0;
    for (uint8_t i = 0; i < size; i++) {
        raw |= (uint32_t)data[i] << (8 * i);
    }
    switch (entry->type) {
    case OD_I8: return (int8_t)raw;
    case OD_I16: return (int16_t)raw;
    case OD_I24: return (int32_t)(raw ^ 0x800000u) - 0x800000;
    case OD_I32: return (int32_t)raw;
    default: return raw;
    }
}
