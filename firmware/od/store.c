/* SPDX-License-Identifier: Apache-2.0 */
#include "od/store.h"

#include <stddef.h>

#define ERASED 0xFFFFFFFFu
#define KIND 0xFF000000u /* bits of a pair's first word: 0 for a value, STORE_END for the end */
#define LOSS_MARK 0u     /* key of the pair that marks lost parameters; no object has it */

enum { WORD = 4, PAIR = 8 };
enum { EVERY_AREA = STORE_COMMUNICATION | STORE_APPLICATION | STORE_NODE | STORE_WEAR };

/* CRC-32 of IEEE 802.3, computed four bits at a time. */
static uint32_t crc32(uint32_t crc, uint32_t word)
{
    static const uint32_t nibble[16] = {0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u,
                                        0x4DB26158u, 0x5005713Cu, 0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu,
                                        0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu};
    crc ^= word;
    for (int i = 0; i < 8; i++) {
        crc = (crc >> 4) ^ nibble[crc & 15u];
    }
    return crc;
}

static uint32_t word_at(const struct hal *hal, unsigned sector, uint32_t offset)
{
    uint32_t word;
    hal->flash_read(hal->ctx, sector, offset, &word, WORD);
    return word;
}

static bool is_erased(const struct hal *hal, unsigned sector, uint32_t begin, uint32_t end)
{
    for (uint32_t at = begin; at < end; at += WORD) {
        if (word_at(hal, sector, at) != ERASED) {
            return false;
        }
    }
    return true;
}

/* Where the set at `begin` ends; 0 when there is none, or it is not intact. */
static uint32_t end_of_set(const struct hal *hal, unsigned sector, uint32_t begin)
{
    if (begin + 2 * PAIR > HAL_FLASH_BYTES || word_at(hal, sector, begin) != STORE_MAGIC) {
        return 0;
    }
    const uint32_t sequence = word_at(hal, sector, begin + WORD);
    if (sequence == ERASED) { /* no later set could have a higher one */
        return 0;
    }
    uint32_t crc = crc32(crc32(ERASED, STORE_MAGIC), sequence);
    uint32_t pairs = 0;
    for (uint32_t at = begin + PAIR; at + PAIR <= HAL_FLASH_BYTES; at += PAIR, pairs++) {
        const uint32_t key = word_at(hal, sector, at), value = word_at(hal, sector, at + WORD);
        crc = crc32(crc, key);
        if ((key & KIND) == STORE_END) {
            return key == (STORE_END | pairs) && value == ~crc ? at + PAIR : 0;
        }
        if ((key & KIND) != 0) {
            return 0;
        }
        crc = crc32(crc, value);
    }
    return 0;
}

void store_open(struct store *s, const struct hal *hal)
{
    *s = (struct store){.hal = hal};
    for (unsigned sector = 0; sector < HAL_FLASH_SECTORS; sector++) {
        uint32_t begin = 0, end;
        while ((end = end_of_set(hal, sector, begin)) != 0) {
            const uint32_t sequence = word_at(hal, sector, begin + WORD);
            if (!s->found || sequence > s->sequence) {
                s->found = true;
                s->sector = (uint8_t)sector;
                s->begin = begin;
                s->end = end;
                s->sequence = sequence;
            }
            begin = end;
        }
    }
    s->damaged = s->found && word_at(hal, s->sector, s->begin + PAIR) == LOSS_MARK;
    for (unsigned sector = 0; sector < HAL_FLASH_SECTORS; sector++) {
        s->damaged = s->damaged || (!s->found && !is_erased(hal, sector, 0, HAL_FLASH_BYTES));
    }
}

/* 0: the object is not stored. */
static unsigned area_of(const struct od_entry *entry)
{
    const unsigned both = OD_READ | OD_WRITE;
    if (entry->index == OBJ_FLASH_WEAR && entry->sub == SUB_FLASH_WEAR_ERASES) {
        return STORE_WEAR;
    }
    if ((entry->flags & both) != both || entry->index == OBJ_ERROR_HISTORY || entry->index == OBJ_STORE ||
        entry->index == OBJ_RESTORE || entry->index == OBJ_SDO_SERVER_2) {
        return 0;
    }
    if (entry->index <= OD_COMMUNICATION_LAST) {
        return STORE_COMMUNICATION;
    }
    if (entry->index == OBJ_NODE) {
        return STORE_NODE;
    }
    return (entry->flags & OD_CONFIG) != 0 ? STORE_APPLICATION : 0;
}

static uint32_t key_of(const struct od_entry *entry)
{
    return (uint32_t)entry->index << 8 | entry->sub;
}

/* The entry of a stored pair, or NULL when it is unknown or not of `areas`. */
static const struct od_entry *entry_of(uint32_t key, unsigned areas)
{
    uint32_t abort = 0;
    const struct od_entry *entry = od_find((uint16_t)(key >> 8), (uint8_t)key, &abort);
    return entry != NULL && (area_of(entry) & areas) != 0 ? entry : NULL;
}

bool store_load(const struct store *s, struct od_data *od, unsigned areas)
{
    bool in_range = true;
    for (uint32_t at = s->begin + PAIR; s->found && at < s->end - PAIR; at += PAIR) {
        const struct od_entry *entry = entry_of(word_at(s->hal, s->sector, at), areas);
        const uint32_t raw = word_at(s->hal, s->sector, at + WORD);
        if (entry == NULL) {
            continue;
        }
        const uint8_t bytes[4] = {(uint8_t)raw, (uint8_t)(raw >> 8), (uint8_t)(raw >> 16), (uint8_t)(raw >> 24)};
        const int64_t value = od_decode(entry, bytes);
        const bool unconfigured = entry->index == OBJ_NODE && entry->sub == SUB_NODE_ID && value == OD_UNCONFIGURED;
        if ((uint32_t)value == raw && (unconfigured || od_check(entry, value) == SDO_OK)) {
            od_write(od, entry, value);
        } else {
            in_range = false;
        }
    }
    return in_range;
}

/* An identifier at its default follows the node id, and is not stored. */
static bool is_to_store(const struct od_data *od, const struct od_entry *entry, uint8_t node_id)
{
    return (entry->flags & OD_NODE_ID) == 0 || od_read(od, entry) != od_read(&od_defaults, entry) + node_id;
}

/* Where the next pair of `area`, or of an object unknown to this firmware, is in the newest set from `at` on */
static uint32_t next_pair(const struct store *s, uint32_t at, unsigned area)
{
    while (at < s->end - PAIR) {
        const struct od_entry *entry = entry_of(word_at(s->hal, s->sector, at), EVERY_AREA);
        if (entry == NULL || area_of(entry) == area) {
            break;
        }
        at += PAIR;
    }
    return at;
}

/* Whether the newest set has of `area` just what od has, in the order of the dictionary, or nothing where !saved. */
static bool area_is_stored(const struct store *s, const struct od_data *od, uint8_t node_id, unsigned area, bool saved)
{
    uint32_t at = next_pair(s, s->begin + PAIR + (s->damaged ? PAIR : 0u), area);
    for (uint16_t i = 0; i < od_table_len && saved; i++) {
        const struct od_entry *entry = &od_table[i];
        if (area_of(entry) != area || !is_to_store(od, entry, node_id)) {
            continue;
        }
        if (word_at(s->hal, s->sector, at) != key_of(entry) ||
            word_at(s->hal, s->sector, at + WORD) != (uint32_t)od_read(od, entry)) {
            return false;
        }
        at = next_pair(s, at + PAIR, area);
    }
    return at == s->end - PAIR;
}

bool store_holds(const struct store *s, const struct od_data *od, uint8_t node_id, unsigned saved, unsigned retained)
{
    static const unsigned areas[] = {STORE_COMMUNICATION, STORE_APPLICATION, STORE_NODE};
    bool same = s->found && (!s->damaged || (retained & STORE_APPLICATION) != 0);
    for (unsigned i = 0; i < sizeof areas / sizeof areas[0] && same; i++) {
        same = (areas[i] & retained) != 0 || area_is_stored(s, od, node_id, areas[i], (areas[i] & saved) != 0);
    }
    return same;
}

struct writer {
    const struct hal *hal;
    unsigned sector;
    uint32_t at, crc, pairs;
    bool ok;
};

static void write_pair(struct writer *w, uint32_t first, uint32_t second)
{
    const uint32_t pair[2] = {first, second};
    w->ok = w->ok && w->at + PAIR <= HAL_FLASH_BYTES &&
            w->hal->flash_write(w->hal->ctx, w->sector, w->at, pair, sizeof pair);
    w->at += PAIR;
    w->crc = crc32(crc32(w->crc, first), second);
}

static void write_value(struct writer *w, const struct od_entry *entry, uint32_t value)
{
    write_pair(w, key_of(entry), value);
    w->pairs++;
}

static void write_dictionary(struct writer *w, const struct od_data *od, uint8_t node_id, unsigned areas)
{
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *entry = &od_table[i];
        if ((area_of(entry) & areas) == 0) {
            continue;
        }
        if (is_to_store(od, entry, node_id)) {
            write_value(w, entry, (uint32_t)od_read(od, entry));
        }
    }
}

static void write_retained(struct writer *w, const struct store *s, unsigned areas)
{
    for (uint32_t at = s->begin + PAIR; s->found && at < s->end - PAIR; at += PAIR) {
        const struct od_entry *entry = entry_of(word_at(s->hal, s->sector, at), areas);
        if (entry != NULL) {
            write_value(w, entry, word_at(s->hal, s->sector, at + WORD));
        }
    }
}

/* Bytes that a set can have at most. */
static uint32_t largest_set(void)
{
    uint32_t bytes = 3 * PAIR; /* begin, end, and the mark of lost parameters */
    for (uint16_t i = 0; i < od_table_len; i++) {
        bytes += area_of(&od_table[i]) != 0 ? PAIR : 0;
    }
    return bytes;
}

bool store_write(struct store *s, struct od_data *od, uint8_t node_id, unsigned saved, unsigned retained)
{
    const struct hal *hal = s->hal;
    const uint32_t room = largest_set();
    struct writer w = {.hal = hal, .sector = s->sector, .at = s->end, .crc = ERASED, .ok = true};
    if (!s->found || s->end + room > HAL_FLASH_BYTES || !is_erased(hal, s->sector, s->end, s->end + room)) {
        /* the sector with the newest set is never erased */
        w.sector = s->found ? 1u - s->sector : 0u;
        w.at = 0;
        w.ok = hal->flash_erase(hal->ctx, w.sector);
        od->flash_wear.erases++;
    }
    const uint32_t begin = w.at, sequence = s->sequence + 1;
    const bool damaged = s->damaged && (retained & STORE_APPLICATION) != 0;
    write_pair(&w, STORE_MAGIC, sequence);
    if (damaged) {
        write_pair(&w, LOSS_MARK, 0);
        w.pairs++;
    }
    write_dictionary(&w, od, node_id, saved | STORE_WEAR);
    write_retained(&w, s, retained);
    write_pair(&w, STORE_END | w.pairs, ~crc32(w.crc, STORE_END | w.pairs));
    if (!w.ok || end_of_set(hal, w.sector, begin) != w.at) {
        return false;
    }
    s->found = true;
    s->damaged = damaged;
    s->sector = (uint8_t)w.sector;
    s->begin = begin;
    s->end = w.at;
    s->sequence = sequence;
    return true;
}
