/* SPDX-License-Identifier: Apache-2.0 */
/* The parameter store: what is stored, other layouts, wear, a failing flash, and a power supply that fails three times. */
#include <string.h>

#include "test_flash.h"

static struct od_data od;

/* Power-on: the dictionary has its defaults, and the stored values over them. */
static void power_on(void)
{
    sim_flash_power_on(&flash);
    od_init(&od, NODE);
    store_open(&store, &hal);
    store_load(&store, &od, ALL);
}

void setUp(void)
{
    flash_start();
    power_on();
}

void tearDown(void)
{
    TEST_ASSERT_EQUAL_UINT_MESSAGE(0, flash.misuse, "a word was written that was not erased");
}

/* Set `i` of parameters; a value of each area shows which set it is. */
static void set_up(struct od_data *to, uint32_t i)
{
    to->heartbeat_producer = (uint16_t)(100 + i);
    to->heartbeat_consumer[0] = 1000 + i;
    to->smc.lambda = 100000 + i;
    to->axis[AXIS_Y].position_limit.min = -1000000 - (int32_t)i;
}

static bool is_set(const struct od_data *d, uint32_t i)
{
    return d->heartbeat_producer == 100 + i && d->heartbeat_consumer[0] == 1000 + i && d->smc.lambda == 100000 + i &&
           d->axis[AXIS_Y].position_limit.min == -1000000 - (int32_t)i;
}

static bool is_default(const struct od_data *d)
{
    struct od_data fresh;
    od_init(&fresh, NODE);
    return memcmp(d, &fresh, sizeof fresh) == 0;
}

/* Of the communication objects that can be written */
static bool is_never_stored(uint16_t index)
{
    return index == 0x1003 || index == 0x1010 || index == 0x1011 || index == 0x1201;
}

static bool save(uint32_t i)
{
    set_up(&od, i);
    return store_write(&store, &od, NODE, ALL, 0);
}

/* ---- what is stored ---- */

static void test_empty_flash_leaves_the_defaults_and_is_no_damage(void)
{
    TEST_ASSERT_FALSE(store.found);
    TEST_ASSERT_FALSE(store.damaged);
    TEST_ASSERT_TRUE(is_default(&od));
}

static void test_what_is_saved_is_there_after_power_on(void)
{
    TEST_ASSERT_TRUE(save(7));
    power_on();
    TEST_ASSERT_TRUE(store.found);
    TEST_ASSERT_TRUE(is_set(&od, 7));
}

static void test_every_value_that_is_stored_comes_back_whatever_its_type(void)
{
    struct od_data saved;
    unsigned stored = 0;
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *e = &od_table[i];
        if ((e->flags & OD_WRITE) != 0 && (e->flags & OD_READ) != 0) {
            od_write(&od, e, e->min + (e->max - e->min) / 3);
        }
    }
    saved = od;
    TEST_ASSERT_TRUE(store_write(&store, &od, NODE, ALL, 0));
    power_on();
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *e = &od_table[i];
        const bool communication = e->index < 0x2000 && !is_never_stored(e->index);
        if ((e->flags & OD_WRITE) != 0 && (e->flags & OD_READ) != 0 && (communication || (e->flags & OD_CONFIG) != 0)) {
            TEST_ASSERT_EQUAL_INT64(od_read(&saved, e), od_read(&od, e));
            stored++;
        } else if ((e->flags & (OD_CONST | OD_WRITE)) == 0 && od_size(e) != 0) {
            TEST_ASSERT_EQUAL_INT64(od_read(&saved, e), od_read(&od, e));
        }
    }
    TEST_ASSERT_TRUE(stored > 80);
    TEST_ASSERT_EQUAL_UINT8(od_defaults.controller.select, od.controller.select); /* no parameter */
}

static void test_commands_and_the_error_history_are_not_stored(void)
{
    static const uint16_t not_stored[] = {0x1003, 0x1010, 0x1011};
    for (uint16_t i = 0; i < od_table_len; i++) {
        for (unsigned k = 0; k < 3; k++) {
            if (od_table[i].index == not_stored[k] && (od_table[i].flags & OD_WRITE) != 0) {
                od_write(&od, &od_table[i], od_read(&od_defaults, &od_table[i]) + 1);
            }
        }
    }
    TEST_ASSERT_TRUE(store_write(&store, &od, NODE, ALL, 0));
    for (uint32_t at = store.begin; at < store.end; at += 8) {
        uint32_t key;
        hal.flash_read(hal.ctx, store.sector, at, &key, sizeof key);
        for (unsigned k = 0; k < 3; k++) {
            TEST_ASSERT_NOT_EQUAL_HEX32(not_stored[k], key >> 8);
        }
    }
    power_on();
    TEST_ASSERT_TRUE(is_default(&od));
}

static void test_areas_are_saved_retained_and_left_out_each_for_itself(void)
{
    TEST_ASSERT_TRUE(save(1));
    set_up(&od, 2);
    od.node.id = 9;
    TEST_ASSERT_TRUE(store_write(&store, &od, NODE, STORE_NODE, STORE_COMMUNICATION | STORE_APPLICATION));
    power_on();
    TEST_ASSERT_TRUE(is_set(&od, 1));
    TEST_ASSERT_EQUAL_UINT8(9, od.node.id);
    TEST_ASSERT_TRUE(store_write(&store, &od, NODE, 0, STORE_APPLICATION | STORE_NODE));
    power_on();
    TEST_ASSERT_EQUAL_UINT16(100, od.heartbeat_producer);
    TEST_ASSERT_EQUAL_UINT32(100001, od.smc.lambda);
    TEST_ASSERT_EQUAL_UINT8(9, od.node.id);
    TEST_ASSERT_TRUE(store_write(&store, &od, NODE, 0, 0));
    power_on();
    TEST_ASSERT_TRUE(is_default(&od));
    TEST_ASSERT_FALSE(store.damaged);
}

static void test_only_the_areas_requested_are_loaded(void)
{
    TEST_ASSERT_TRUE(save(3));
    od_init(&od, NODE);
    store_load(&store, &od, STORE_COMMUNICATION);
    TEST_ASSERT_EQUAL_UINT16(103, od.heartbeat_producer);
    TEST_ASSERT_EQUAL_UINT32(od_defaults.smc.lambda, od.smc.lambda);
}

static void test_identifier_at_its_default_follows_a_new_node_id_and_a_chosen_one_does_not(void)
{
    od.tpdo2.cob_id = 0x40000290;
    TEST_ASSERT_TRUE(save(1));
    od_init(&od, 9);
    store_load(&store, &od, ALL);
    TEST_ASSERT_EQUAL_HEX32(0x40000189, od.tpdo1.cob_id);
    TEST_ASSERT_EQUAL_HEX32(0x40000290, od.tpdo2.cob_id);
}

static void test_node_without_id_is_stored_as_such(void)
{
    od.node.id = OD_UNCONFIGURED;
    TEST_ASSERT_TRUE(store_write(&store, &od, NODE, ALL, 0));
    power_on();
    TEST_ASSERT_EQUAL_UINT8(OD_UNCONFIGURED, od.node.id);
}

/* ---- other layouts ---- */

static uint32_t crc32_of(const uint32_t *word, unsigned count)
{
    uint32_t crc = 0xFFFFFFFFu;
    for (unsigned i = 0; i < 4 * count; i++) {
        crc ^= word[i / 4] >> 8 * (i % 4) & 0xFFu;
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc & 1u) != 0 ? crc >> 1 ^ 0xEDB88320u : crc >> 1;
        }
    }
    return ~crc;
}

/* A set as another firmware may have written it. */
static void make_set(uint32_t magic, const uint32_t *pairs, unsigned count)
{
    uint32_t *word = flash.word[1];
    word[0] = magic;
    word[1] = 77;
    memcpy(&word[2], pairs, 8 * count);
    word[2 + 2 * count] = STORE_END | count;
    word[3 + 2 * count] = crc32_of(word, 3 + 2 * count);
}

static void test_set_of_another_firmware_gives_what_is_known_and_in_range(void)
{
    const uint32_t pairs[] = {
        0x211001, 123456,          /* lambda */
        0x5FFF01, 1,               /* no such object */
        0x211077, 1,               /* no such sub-index */
        0x211002, 0xFFFFFFFF,      /* gamma: too large */
        0x101700, 0x10007,         /* heartbeat: of 16 bits here */
        0x687D01, (uint32_t)-5000, /* position limit of y */
        0x604000, 0x0F,            /* controlword: not stored */
        0x606400, 99,              /* position: read only */
    };
    make_set(STORE_MAGIC, pairs, 8);
    power_on();
    struct od_data expected;
    od_init(&expected, NODE);
    expected.smc.lambda = 123456;
    expected.axis[AXIS_Y].position_limit.min = -5000;
    TEST_ASSERT_EQUAL_MEMORY(&expected, &od, sizeof od);
    TEST_ASSERT_EQUAL_UINT32(77, store.sequence);
    TEST_ASSERT_FALSE(store_load(&store, &od, STORE_APPLICATION));
    TEST_ASSERT_FALSE(store_load(&store, &od, STORE_COMMUNICATION));
    TEST_ASSERT_TRUE(save(1)); /* goes on behind it */
    power_on();
    TEST_ASSERT_TRUE(is_set(&od, 1));
    TEST_ASSERT_EQUAL_UINT32(78, store.sequence);
    TEST_ASSERT_EQUAL_UINT(0, flash.erases);
}

/* The set that is there is the one that would be written, whatever was saved last. */
static void test_store_holds_a_set_that_is_the_same_pair_for_pair_and_no_other(void)
{
    TEST_ASSERT_FALSE(store_holds(&store, &od, NODE, ALL, 0));
    TEST_ASSERT_TRUE(save(1));
    for (unsigned saved = 1; saved <= ALL; saved++) {
        TEST_ASSERT_TRUE(store_holds(&store, &od, NODE, saved, ALL & ~saved));
        TEST_ASSERT_FALSE(store_holds(&store, &od, NODE, 0, ALL & ~saved));
        TEST_ASSERT_TRUE(store_write(&store, &od, NODE, saved, ALL & ~saved)); /* puts the areas in another order */
        TEST_ASSERT_TRUE(store_holds(&store, &od, NODE, ALL, 0));
    }
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *e = &od_table[i];
        const bool stored = (e->flags & OD_CONFIG) != 0 || e->index < 0x2000;
        if (stored && (e->flags & OD_WRITE) != 0 && !is_never_stored(e->index)) {
            const int64_t now = od_read(&od, e);
            od_write(&od, e, now ^ 1);
            TEST_ASSERT_FALSE(store_holds(&store, &od, NODE, ALL, 0));
            od_write(&od, e, now);
        }
    }
    TEST_ASSERT_TRUE(store_holds(&store, &od, NODE, ALL, 0));
    TEST_ASSERT_FALSE(store_holds(&store, &od, NODE + 1, ALL, 0)); /* identifiers that are no defaults there */
    TEST_ASSERT_TRUE(store_write(&store, &od, NODE, 0, STORE_APPLICATION));
    TEST_ASSERT_TRUE(store_holds(&store, &od, NODE, 0, STORE_APPLICATION));
    TEST_ASSERT_FALSE(store_holds(&store, &od, NODE, ALL, 0));
}

static void test_store_does_not_hold_what_another_firmware_stored_besides_or_twice(void)
{
    static const uint32_t sets[4][6] = {{0x200101, 1, 0x200102, 1000, 0x211001, 1},
                                        {0x200101, 1, 0x200102, 1000, 0x5FFF01, 1},
                                        {0x200101, 1, 0x200102, 1000, 0x200101, 1},
                                        {0x200101, 1, 0x200101, 1000, 0x211001, 1}};
    for (unsigned i = 0; i < 4; i++) {
        setUp();
        make_set(STORE_MAGIC, sets[i], 3);
        power_on();
        od.node.id = 1;
        od.node.bitrate = 1000;
        TEST_ASSERT_EQUAL(i == 0, store_holds(&store, &od, NODE, STORE_NODE, ALL & ~STORE_NODE));
    }
}

static void test_what_is_unknown_is_no_error(void)
{
    const uint32_t pairs[] = {0x211001, 123456, 0x5FFF01, 1, 0x211077, 1};
    make_set(STORE_MAGIC, pairs, 3);
    power_on();
    TEST_ASSERT_TRUE(store_load(&store, &od, ALL));
    TEST_ASSERT_EQUAL_UINT32(123456, od.smc.lambda);
}

static void test_set_that_fills_a_sector_is_loaded_and_saving_more_than_fits_leaves_it(void)
{
    static uint32_t pairs[2 * (HAL_FLASH_BYTES / 8 - 2)];
    for (unsigned i = 0; i < sizeof pairs / sizeof pairs[0]; i += 2) {
        pairs[i] = 0x101700; /* heartbeat: the same object again and again, the last one counts */
        pairs[i + 1] = 100 + i % 900;
    }
    pairs[sizeof pairs / sizeof pairs[0] - 1] = 1234;
    make_set(STORE_MAGIC, pairs, sizeof pairs / sizeof pairs[0] / 2);
    power_on();
    TEST_ASSERT_EQUAL_UINT16(1234, od.heartbeat_producer);
    TEST_ASSERT_FALSE(store_write(&store, &od, NODE, STORE_APPLICATION, STORE_COMMUNICATION));
    power_on();
    TEST_ASSERT_EQUAL_UINT32(77, store.sequence);
    TEST_ASSERT_EQUAL_UINT16(1234, od.heartbeat_producer);
    TEST_ASSERT_TRUE(save(1));
    power_on();
    TEST_ASSERT_TRUE(is_set(&od, 1));
}

static void test_unknown_layout_or_a_wrong_crc_is_damage_and_can_be_saved_over(void)
{
    const uint32_t pair[] = {0x211001, 123456};
    for (int i = 0; i < 3; i++) {
        setUp();
        make_set(i == 0 ? STORE_MAGIC + 1 : STORE_MAGIC, pair, 1);
        flash.word[1][3] ^= i == 1 ? 1u : 0u;
        flash.word[1][4] ^= i == 2 ? 1u : 0u; /* number of pairs */
        power_on();
        TEST_ASSERT_TRUE(store.damaged);
        TEST_ASSERT_TRUE(is_default(&od));
        TEST_ASSERT_TRUE(save(1));
        TEST_ASSERT_FALSE(store.damaged);
        power_on();
        TEST_ASSERT_TRUE(is_set(&od, 1));
    }
}

static void test_flash_full_of_nonsense_is_damage(void)
{
    uint32_t x = 1;
    for (unsigned k = 0; k < 2 * HAL_FLASH_BYTES / 4; k++) {
        x = x * 1664525u + 1013904223u;
        flash.word[k % 2][k / 2] = x;
    }
    power_on();
    TEST_ASSERT_TRUE(store.damaged);
    memset(flash.word, 0, sizeof flash.word);
    power_on();
    TEST_ASSERT_TRUE(store.damaged);
    for (unsigned k = 0; k < HAL_FLASH_BYTES / 4; k++) { /* sets without end */
        flash.word[0][k] = k == 0 ? STORE_MAGIC : 0;
    }
    power_on();
    TEST_ASSERT_TRUE(store.damaged);
}

/* Numbers rise by one a set: before the last one is reached a flash is worn out a thousand times. */
static void test_last_sequence_number_is_no_set_since_none_could_be_newer(void)
{
    const uint32_t pair[] = {0x211001, 123456};
    make_set(STORE_MAGIC, pair, 1);
    flash.word[1][1] = UINT32_MAX;
    flash.word[1][5] = crc32_of(flash.word[1], 5);
    power_on();
    TEST_ASSERT_TRUE(store.damaged);
    TEST_ASSERT_TRUE(save(1));
    power_on();
    TEST_ASSERT_TRUE(is_set(&od, 1));
}

/* ---- wear and failure ---- */

static void test_a_sector_is_erased_once_for_many_sets_and_both_are_used(void)
{
    for (uint32_t i = 1; i <= 200; i++) {
        TEST_ASSERT_TRUE(save(i));
        if (i % 7 == 0) {
            power_on();
            TEST_ASSERT_TRUE(is_set(&od, i));
        }
    }
    TEST_ASSERT_TRUE_MESSAGE(flash.erases >= 4 && flash.erases <= (200 + 2) / 3, "three sets fit into a sector");
    TEST_ASSERT_EQUAL_HEX32(STORE_MAGIC, flash.word[0][0]);
    TEST_ASSERT_EQUAL_HEX32(STORE_MAGIC, flash.word[1][0]);
}

static void test_failing_flash_is_reported_and_the_old_set_remains(void)
{
    TEST_ASSERT_TRUE(save(1));
    flash.broken = true;
    TEST_ASSERT_FALSE(save(2));
    flash.broken = false;
    power_on();
    TEST_ASSERT_TRUE(is_set(&od, 1));
    TEST_ASSERT_TRUE(save(2));
    power_on();
    TEST_ASSERT_TRUE(is_set(&od, 2));
}

/* A flash that does not report a bit that stays 1. */
static bool bad_write(void *ctx, unsigned sector, uint32_t offset, const void *data, uint32_t bytes)
{
    const bool ok = sim_flash_write(ctx, sector, offset, data, bytes);
    flash.word[sector][offset / 4] |= 1u;
    return ok;
}

static void test_set_that_cannot_be_read_back_is_reported(void)
{
    TEST_ASSERT_TRUE(save(1));
    hal.flash_write = bad_write;
    TEST_ASSERT_FALSE(save(2));
    hal.flash_write = flash_write;
    power_on();
    TEST_ASSERT_TRUE(is_set(&od, 1));
    TEST_ASSERT_TRUE(save(2));
    power_on();
    TEST_ASSERT_TRUE(is_set(&od, 2));
}

/* ---- power cuts (of full sets: test_power_cut.c) ---- */

/* Small sets, so that all pairs and triples of power cuts can be tried: 2001h alone. */
static bool save_node(uint8_t id)
{
    od.node.id = id;
    od.node.bitrate = (uint16_t)(100 + id);
    return store_write(&store, &od, NODE, STORE_NODE, 0);
}

static bool node_is(uint8_t id)
{
    return od.node.id == id && od.node.bitrate == 100 + id;
}

/* From this flash, which holds node id `old`: cuts in `depth` saves that follow each other, in all combinations. */
static void cut_combinations(uint8_t old, uint8_t next, unsigned depth)
{
    const struct sim_flash before = flash;
    bool done = false;
    for (uint32_t cut = 1; !done; cut++) {
        flash = before;
        flash.random += cut;
        power_on();
        flash.cut_at = cut;
        done = save_node(next);
        power_on();
        TEST_ASSERT_TRUE_MESSAGE(node_is(next) || (!done && (old == 0 ? is_default(&od) : node_is(old))), "neither");
        const uint8_t now = node_is(next) ? next : old;
        if (depth > 1) {
            cut_combinations(now, (uint8_t)(next + 1), depth - 1);
        } else {
            TEST_ASSERT_TRUE(save_node(31));
            power_on();
            TEST_ASSERT_TRUE(node_is(31));
        }
    }
}

static void test_power_cuts_in_three_saves_in_a_row_leave_an_intact_set(void)
{
    cut_combinations(0, 1, 2);
    for (unsigned switches = 0; switches < 2;) {
        const struct sim_flash before = flash;
        power_on();
        TEST_ASSERT_TRUE(save_node(10));
        if (flash.erases != before.erases) {
            const struct sim_flash after = flash;
            flash = before;
            power_on();
            cut_combinations(node_is(10) ? 10 : 0, 20, 3);
            flash = after;
            switches++;
        }
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_empty_flash_leaves_the_defaults_and_is_no_damage);
    RUN_TEST(test_what_is_saved_is_there_after_power_on);
    RUN_TEST(test_every_value_that_is_stored_comes_back_whatever_its_type);
    RUN_TEST(test_commands_and_the_error_history_are_not_stored);
    RUN_TEST(test_areas_are_saved_retained_and_left_out_each_for_itself);
    RUN_TEST(test_only_the_areas_requested_are_loaded);
    RUN_TEST(test_identifier_at_its_default_follows_a_new_node_id_and_a_chosen_one_does_not);
    RUN_TEST(test_node_without_id_is_stored_as_such);
    RUN_TEST(test_set_of_another_firmware_gives_what_is_known_and_in_range);
    RUN_TEST(test_unknown_layout_or_a_wrong_crc_is_damage_and_can_be_saved_over);
    RUN_TEST(test_flash_full_of_nonsense_is_damage);
    RUN_TEST(test_last_sequence_number_is_no_set_since_none_could_be_newer);
    RUN_TEST(test_a_sector_is_erased_once_for_many_sets_and_both_are_used);
    RUN_TEST(test_failing_flash_is_reported_and_the_old_set_remains);
    RUN_TEST(test_set_that_cannot_be_read_back_is_reported);
    RUN_TEST(test_power_cuts_in_three_saves_in_a_row_leave_an_intact_set);
    RUN_TEST(test_set_that_fills_a_sector_is_loaded_and_saving_more_than_fits_leaves_it);
    RUN_TEST(test_what_is_unknown_is_no_error);
    RUN_TEST(test_store_holds_a_set_that_is_the_same_pair_for_pair_and_no_other);
    RUN_TEST(test_store_does_not_hold_what_another_firmware_stored_besides_or_twice);
    return UNITY_END();
}
