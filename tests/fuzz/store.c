/* SPDX-License-Identifier: Apache-2.0 */
/* Fills the flash of the parameters with any contents. What is loaded is in range and fits together, and what is stored
 * over it can be loaded again. The input is read as pieces of the two sectors (enum piece). */
#include <string.h>

#include "bytes.h"
#include "drive/configuration.h"
#include "od/settings.h"
#include "sim/flash.h"
#include "unity.h"

enum piece { RAW, SKIP, SET, OTHER_SECTOR, PIECES };
enum { WORDS = HAL_FLASH_BYTES / 4, NODE = 3 };

static struct sim_flash flash;
static struct od_data od, again;

static void flash_read(void *ctx, unsigned sector, uint32_t offset, void *data, uint32_t bytes)
{
    (void)ctx;
    memcpy(data, (const unsigned char *)flash.word[sector] + offset, bytes);
}

static bool flash_erase(void *ctx, unsigned sector)
{
    (void)ctx;
    return sim_flash_erase(&flash, sector);
}

static bool flash_write(void *ctx, unsigned sector, uint32_t offset, const void *data, uint32_t bytes)
{
    (void)ctx;
    return sim_flash_write(&flash, sector, offset, data, bytes);
}

static bool can_bitrate(void *ctx, uint16_t kbitps, bool change)
{
    (void)ctx;
    (void)change;
    return kbitps == 1000;
}

static const struct hal hal = {
    .flash_read = flash_read, .flash_erase = flash_erase, .flash_write = flash_write, .can_bitrate = can_bitrate};

static uint32_t crc32(uint32_t crc, uint32_t word)
{
    crc ^= word;
    for (int bit = 0; bit < 32; bit++) {
        crc = (crc >> 1) ^ ((crc & 1u) != 0 ? 0xEDB88320u : 0u);
    }
    return crc;
}

/* A place in a sector, and the checksum of the set that is written there. */
struct cursor {
    unsigned sector, word;
    uint32_t crc;
};

static void put(struct cursor *c, uint32_t word)
{
    if (c->word < WORDS) {
        flash.word[c->sector][c->word++] = word;
    }
}

static void put_checked(struct cursor *c, uint32_t word)
{
    put(c, word);
    c->crc = crc32(c->crc, word);
}

/* Write a set. Mostly its checksum is right and its objects exist. */
static void put_set(struct cursor *c, struct bytes *in)
{
    const uint8_t how = bytes_u8(in);
    const unsigned pairs = bytes_u8(in) % 64;
    c->crc = 0xFFFFFFFF;
    put_checked(c, STORE_MAGIC);
    put_checked(c, bytes_number(in, 1) | ((how & 1) != 0 ? bytes_number(in, 4) : 0));
    for (unsigned i = 0; i < pairs; i++) {
        const struct od_entry *e = &od_table[bytes_number(in, 2) % od_table_len];
        put_checked(c, (how & 2) != 0 ? bytes_number(in, 4) : (uint32_t)e->index << 8 | e->sub);
        put_checked(c, bytes_number(in, 4));
    }
    put_checked(c, (STORE_END | pairs) + ((how & 0xF0) == 0x10 ? 1u : 0u));
    put(c, ~c->crc ^ ((how & 0xF0) == 0x20 ? 1u : 0u));
}

static void fill(struct bytes *in)
{
    struct cursor c = {0};
    while (in->left > 0) {
        switch (bytes_u8(in) % PIECES) {
        case RAW:
            for (unsigned left = bytes_u8(in); left > 0; left--) {
                put(&c, bytes_number(in, 4));
            }
            break;
        case SKIP: c.word += bytes_number(in, 2) % WORDS; break;
        case SET: put_set(&c, in); break;
        default: c = (struct cursor){.sector = 1u - c.sector}; break;
        }
        c.word = c.word < WORDS ? c.word : WORDS;
    }
}

static void expect_sound(const struct od_data *values, uint8_t node_id)
{
    TEST_ASSERT_TRUE((node_id >= 1 && node_id <= OD_NODE_MAX) || node_id == OD_UNCONFIGURED);
    TEST_ASSERT_TRUE(configuration_fits(values));
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *e = &od_table[i];
        if ((e->flags & OD_WRITE) != 0 && (e->flags & OD_READ) != 0 && e->index != 0x2001 && e->index != 0x1003) {
            TEST_ASSERT_TRUE_MESSAGE(od_check(e, od_read(values, e)) == SDO_OK, "a value is out of its range");
        }
    }
}

static const struct od_entry *entry(uint16_t index, uint8_t sub)
{
    uint32_t abort_code = 0;
    const struct od_entry *e = od_find(index, sub, &abort_code);
    TEST_ASSERT_NOT_NULL(e);
    return e;
}

/* The ways to save over the set that was found. `replaced`: the groups of values that the new set replaces. `same`: the
 * values in use are then the stored ones. */
static const struct {
    uint16_t index;
    uint8_t sub;
    unsigned replaced;
    bool same;
} saves[] = {
    {0x1010, 1, STORE_COMMUNICATION | STORE_APPLICATION | STORE_NODE, true},
    {0x1010, 2, STORE_COMMUNICATION, true},
    {0x1010, 3, STORE_APPLICATION | STORE_NODE, true},
    {0x1011, 1, STORE_COMMUNICATION | STORE_APPLICATION, false},
    {0x1011, 3, STORE_APPLICATION, false},
    {0, 0, STORE_NODE, true},
};
enum { SAVES = sizeof saves / sizeof saves[0], SAVE_NODE = SAVES - 1, NO_SAVE = 12 };

static uint32_t save(struct settings *s, unsigned which, uint8_t node_id)
{
    if (which == SAVE_NODE) {
        return settings_store_node(s, node_id) ? SDO_OK : SDO_ABORT_HARDWARE;
    }
    return settings_command(s, entry(saves[which].index, saves[which].sub), node_id);
}

/* The first byte of the input chooses what is saved. Often it is nothing, because saving takes longest. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct bytes in = {data, size};
    struct settings s;
    const unsigned which = bytes_u8(&in) % NO_SAVE;
    sim_flash_init(&flash, 1);
    fill(&in);
    od_init(&od, NODE);
    od_init(&again, NODE);
    const uint8_t node_id = settings_init(&s, &od, &hal, NODE, configuration_fits);
    expect_sound(&od, node_id);
    if (which >= SAVES) {
        return 0;
    }
    const uint8_t used = node_id == OD_UNCONFIGURED ? 1 : node_id;
    const bool last = s.store.sequence >= UINT32_MAX - 1; /* no later set can follow */
    const uint32_t code = save(&s, which, used);
    if (last && code == SDO_ABORT_HARDWARE) {
        return 0;
    }
    TEST_ASSERT_EQUAL_HEX32(SDO_OK, code);
    TEST_ASSERT_TRUE(!last || flash.operations == 0); /* it was there already */
    struct settings t;
    const uint8_t node_after = settings_init(&t, &again, &hal, NODE, configuration_fits);
    TEST_ASSERT_TRUE(t.store.found && t.store.damaged == s.store.damaged);
    expect_sound(&again, node_after);
    TEST_ASSERT_EQUAL_HEX32(s.invalid, t.invalid);
    TEST_ASSERT_EQUAL_HEX32(0, t.invalid & saves[which].replaced);
    TEST_ASSERT_TRUE(!t.store.damaged || (saves[which].replaced & STORE_APPLICATION) == 0);
    again.flash_wear.saves_left = od.flash_wear.saves_left; /* since power-on */
    if (saves[which].same && node_id != OD_UNCONFIGURED) {
        TEST_ASSERT_EQUAL(node_id, node_after);
        TEST_ASSERT_TRUE_MESSAGE(memcmp(&od, &again, sizeof od) == 0, "what was stored is not what is loaded");
    }
    TEST_ASSERT_EQUAL_UINT(0, flash.misuse);
    return 0;
}
