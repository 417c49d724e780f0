/* SPDX-License-Identifier: Apache-2.0 */
/* The parameter store, sets of full size, and a power supply that fails twice.
 *
 * From each fill level of the flash (0, 1, 2 ... sets, until both sectors have been full and one was erased again): the
 * power is cut in an operation of a save, comes back, and is cut in an operation of the next save. An operation is a word
 * written or a sector erased, and the one that is cut leaves a random part of its work (sim/flash.h). After each cut the
 * drive must find one intact set, the old or the new one; every object that is stored has another value in each. Starting
 * only reads the flash, so that a cut while it starts changes nothing.
 *
 * Every single cut is tried. Of the pairs, a part; all of them with POWER_CUT=all in the environment (preset `power-cut`).
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "test_flash.h"

enum {
    LEVELS = 20,
    SETS = LEVELS + 3,
    ERASE_WAYS = 16
}; /* an erase that is cut can leave much: it is tried more often */
enum { FIRST_STRIDE = 61, SECOND_STRIDE = 41, EDGE = 4, THIRD_SAVE = 61 };

static struct od_data od, expected[SETS]; /* the dictionary with set i loaded; 0: no set */
static unsigned stored;                   /* objects in a set */
static unsigned long singles, pairs, operations;
static bool every;

static void power_on(void)
{
    sim_flash_power_on(&flash);
    od_init(&od, NODE);
    store_open(&store, &hal);
    store_load(&store, &od, ALL);
    TEST_ASSERT_EQUAL_UINT32_MESSAGE(0, flash.operations, "starting writes the flash");
}

static bool is_stored(const struct od_entry *e)
{
    const unsigned both = OD_READ | OD_WRITE;
    const bool communication =
        e->index < 0x2000 && e->index != 0x1003 && e->index != 0x1010 && e->index != 0x1011 && e->index != 0x1201;
    return (e->flags & both) == both && (communication || e->index == 0x2001 || (e->flags & OD_CONFIG) != 0);
}

/* Other than in the set before and behind, wherever there is more than one value */
static int64_t value_of(const struct od_entry *e, unsigned set)
{
    const uint64_t span = (uint64_t)(e->max - e->min) + 1;
    const uint64_t hash = (((uint64_t)e->index << 8 | e->sub) + 1) * 0x9E3779B97F4A7C15u;
    const uint64_t step = span < 3 ? 1 : 1 + (hash >> 32) % (span - 2);
    return e->min + (int64_t)((hash % span + set * step) % span);
}

static bool save(unsigned set)
{
    for (uint16_t i = 0; i < od_table_len; i++) {
        if (is_stored(&od_table[i])) {
            od_write(&od, &od_table[i], value_of(&od_table[i], set));
        }
    }
    return store_write(&store, &od, NODE, ALL, 0);
}

static bool found(unsigned set)
{
    return memcmp(&od, &expected[set], sizeof od) == 0;
}

/* Save a set with the power failing in operation `cut`, in one of several ways, and start again. Returns which is found. */
static unsigned save_cut(const struct sim_flash *before, unsigned old, unsigned set, uint32_t cut, uint32_t way,
                         bool *done)
{
    flash = *before;
    flash.random += ((uint64_t)way << 40) + cut;
    power_on();
    flash.cut_at = cut;
    *done = save(set);
    TEST_ASSERT_EQUAL(*done, !flash.off);
    power_on();
    TEST_ASSERT_EQUAL_UINT_MESSAGE(0, flash.misuse, "a word was written that was not erased");
    TEST_ASSERT_TRUE_MESSAGE(found(set) || (!*done && found(old)), "a set is mixed or lost");
    return found(set) ? set : old;
}

/* How often the cut in an operation is tried: once, but for an erase, which is always the first. */
static uint32_t ways(const struct sim_flash *before, uint32_t cut)
{
    return cut == 1 && flash.erases != before->erases ? ERASE_WAYS : 1;
}

/* Whether this cut is one of the pairs' that are tried; those at both ends of a set always are. */
static bool tried(uint32_t cut, uint32_t phase, uint32_t stride)
{
    return every || cut <= EDGE || cut > 2 * stored || (cut + phase) % stride == 0;
}

static void cut_second(unsigned old, unsigned set, uint32_t phase)
{
    const struct sim_flash before = flash;
    bool done = false;
    for (uint32_t cut = 1; !done; cut++) {
        if (!tried(cut, phase, SECOND_STRIDE)) {
            continue;
        }
        for (uint32_t way = 0, count = 1; way < count; way++) {
            const unsigned now = save_cut(&before, old, set, cut, way, &done);
            count = ways(&before, cut);
            pairs += done ? 0 : 1;
            if (pairs % THIRD_SAVE == 0) { /* the save that follows works as ever */
                power_on();
                TEST_ASSERT_TRUE(save(now + 1));
                power_on();
                TEST_ASSERT_TRUE(found(now + 1));
            }
        }
    }
}

static void cut_first(unsigned level)
{
    const struct sim_flash before = flash;
    bool done = false;
    for (uint32_t cut = 1; !done; cut++) {
        for (uint32_t way = 0, count = 1; way < count; way++) {
            const unsigned now = save_cut(&before, level, level + 1, cut, way, &done);
            count = ways(&before, cut);
            singles += done ? 0 : 1;
            operations += way == 0 && !done ? 1 : 0;
            if (tried(cut, level, FIRST_STRIDE)) {
                cut_second(now, level + 2, cut);
            }
        }
    }
}

static void test_power_cut_once_and_twice_leaves_an_intact_set_at_every_fill_level(void)
{
    for (unsigned level = 0; level < LEVELS; level++) {
        const struct sim_flash before = flash;
        cut_first(level);
        flash = before;
        power_on();
        TEST_ASSERT_TRUE(save(level + 1));
        power_on();
        TEST_ASSERT_TRUE(found(level + 1));
    }
    TEST_ASSERT_TRUE_MESSAGE(flash.erases >= 3, "no sector has been erased again");
    printf("Power cuts in sets of %u objects, at %u fill levels: %lu operations, each cut: %lu single cuts;"
           " %s: %lu pairs of cuts. Sets mixed or lost: 0.\n",
           stored, (unsigned)LEVELS, operations, singles, every ? "every pair of operations" : "a part of the pairs",
           pairs);
}

void setUp(void)
{
    flash_start();
    const char *how = getenv("POWER_CUT");
    every = how != NULL && strcmp(how, "all") == 0;
    stored = 0;
    for (unsigned set = 0; set < SETS; set++) {
        od_init(&expected[set], NODE);
    }
    for (uint16_t i = 0; i < od_table_len; i++) {
        for (unsigned set = 1; set < SETS && is_stored(&od_table[i]); set++) {
            od_write(&expected[set], &od_table[i], value_of(&od_table[i], set));
        }
        stored += is_stored(&od_table[i]) ? 1 : 0;
    }
    power_on();
    TEST_ASSERT_TRUE(found(0));
}

void tearDown(void)
{
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_power_cut_once_and_twice_leaves_an_intact_set_at_every_fill_level);
    return UNITY_END();
}
