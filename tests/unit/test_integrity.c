/* SPDX-License-Identifier: Apache-2.0 */
/* Checksums over configuration and parameters (supervision/integrity.h): none of them is left out. */
#include "supervision/integrity.h"

#include "unity.h"

static struct od_data od;
static struct integrity m;
static uint32_t cfg[3];

static bool intact(void)
{
    return integrity_intact(&m, cfg, sizeof cfg, &od);
}

/* Whether all is intact for as long as it takes to read all parameters */
static bool stays_intact(void)
{
    bool all = true;
    for (unsigned i = 0; i <= od_table_len / INTEGRITY_ENTRIES_MS; i++) {
        all = intact() && all;
    }
    return all;
}

static void seal(bool reset)
{
    integrity_seal(&m, cfg, sizeof cfg, &od, reset);
}

void setUp(void)
{
    od_init(&od, 1);
    cfg[0] = 0x12345678;
    cfg[1] = 0x9ABCDEF0;
    cfg[2] = 7;
    m = (struct integrity){0};
    seal(true);
}

void tearDown(void)
{
}

static void test_what_nobody_changes_stays_intact_round_after_round(void)
{
    for (int i = 0; i < 5; i++) {
        TEST_ASSERT_TRUE(stays_intact());
    }
}

static void test_every_bit_of_the_configuration_is_checked_in_every_millisecond(void)
{
    for (unsigned bit = 0; bit < 8 * sizeof cfg; bit++) {
        cfg[bit / 32] ^= 1u << bit % 32;
        TEST_ASSERT_FALSE(intact());
        cfg[bit / 32] ^= 1u << bit % 32;
        TEST_ASSERT_TRUE(intact());
    }
}

static void test_every_parameter_is_checked_and_one_that_changed_stays_corrupt_until_a_reset(void)
{
    unsigned parameters = 0;
    for (uint16_t i = 0; i < od_table_len; i++) {
        const int64_t value = od_read(&od, &od_table[i]);
        if ((od_table[i].flags & OD_CONFIG) == 0) {
            continue;
        }
        parameters++;
        od_write(&od, &od_table[i], value ^ 1);
        TEST_ASSERT_FALSE(stays_intact());
        seal(false); /* another parameter has been written */
        TEST_ASSERT_FALSE(intact());
        od_write(&od, &od_table[i], value);
        seal(true);
        TEST_ASSERT_TRUE(stays_intact());
    }
    TEST_ASSERT_TRUE(parameters > 80);
}

static void test_parameters_are_intact_at_once_until_one_has_changed_without_a_seal(void)
{
    TEST_ASSERT_TRUE(integrity_parameters_intact(&m, &od));
    od.smc.lambda++;
    TEST_ASSERT_FALSE(integrity_parameters_intact(&m, &od));
    TEST_ASSERT_FALSE(stays_intact()); /* and that has been seen */
    od.smc.lambda--;
    TEST_ASSERT_FALSE(integrity_parameters_intact(&m, &od));
}

static void test_so_many_entries_are_read_in_a_millisecond_and_no_more(void)
{
    for (unsigned ms = 1; ms <= od_table_len / INTEGRITY_ENTRIES_MS; ms++) {
        TEST_ASSERT_TRUE(intact());
        TEST_ASSERT_EQUAL_UINT(ms * INTEGRITY_ENTRIES_MS % od_table_len, m.at);
    }
    TEST_ASSERT_TRUE(intact());
    TEST_ASSERT_EQUAL_UINT(od_table_len % INTEGRITY_ENTRIES_MS != 0 ? 0 : INTEGRITY_ENTRIES_MS, m.at);
}

static void test_parameter_that_is_written_by_a_master_is_no_corruption(void)
{
    (void)intact(); /* in the middle of a round */
    od.smc.lambda++;
    seal(false);
    TEST_ASSERT_TRUE(stays_intact());
}

static void test_value_that_is_no_parameter_may_change(void)
{
    od.axis[0].controlword ^= 1u;
    od.telemetry.tick++;
    TEST_ASSERT_TRUE(stays_intact());
}

/* drive_configure() follows a write by SDO or LSS, and a reset of all. Nothing else may write a parameter: no RPDO, no
 * reset of communication, no command of the scope, which sets its objects to their defaults. */
static void test_no_parameter_can_be_written_without_a_new_checksum(void)
{
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *e = &od_table[i];
        if ((e->flags & OD_CONFIG) != 0) {
            TEST_ASSERT_EQUAL_UINT(0, e->flags & OD_PDO);
            TEST_ASSERT_TRUE(e->index >= OD_APPLICATION_FIRST);
            TEST_ASSERT_TRUE(e->index < OBJ_SCOPE || e->index > OBJ_SCOPE_CHANNELS);
        }
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_what_nobody_changes_stays_intact_round_after_round);
    RUN_TEST(test_every_bit_of_the_configuration_is_checked_in_every_millisecond);
    RUN_TEST(test_every_parameter_is_checked_and_one_that_changed_stays_corrupt_until_a_reset);
    RUN_TEST(test_parameters_are_intact_at_once_until_one_has_changed_without_a_seal);
    RUN_TEST(test_so_many_entries_are_read_in_a_millisecond_and_no_more);
    RUN_TEST(test_parameter_that_is_written_by_a_master_is_no_corruption);
    RUN_TEST(test_value_that_is_no_parameter_may_change);
    RUN_TEST(test_no_parameter_can_be_written_without_a_new_checksum);
    return UNITY_END();
}
