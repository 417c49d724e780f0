/* SPDX-License-Identifier: Apache-2.0 */
/* The object dictionary's table and its values. */
#include "test_canopen_bus.h"

static struct bus bus;

void setUp(void)
{
    bus_start(&bus);
}

void tearDown(void)
{
}

static void test_every_entry_is_found_and_the_table_is_sorted(void)
{
    for (uint16_t i = 0; i < od_table_len; i++) {
        uint32_t abort = 0;
        TEST_ASSERT_EQUAL_PTR(&od_table[i], od_find(od_table[i].index, od_table[i].sub, &abort));
        if (i > 0) {
            const uint32_t a = (uint32_t)od_table[i - 1].index << 8 | od_table[i - 1].sub;
            TEST_ASSERT_TRUE(a < ((uint32_t)od_table[i].index << 8 | od_table[i].sub));
        }
    }
}

static void test_number_that_is_not_there_reads_as_0(void)
{
    TEST_ASSERT_EQUAL_INT64(1, od_number(&bus.od, 0x1018, 2));
    TEST_ASSERT_EQUAL_INT64(0, od_number(&bus.od, 0x1018, 5));
    TEST_ASSERT_EQUAL_INT64(0, od_number(&bus.od, 0x1FFF, 0));
}

static void test_every_default_is_in_range_and_every_number_keeps_what_is_written(void)
{
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *e = &od_table[i];
        if (!(e->flags & OD_WRITE)) {
            continue;
        }
        if (e->flags & OD_READ) {
            TEST_ASSERT_EQUAL_HEX32(SDO_OK, od_check(e, od_read(&bus.od, e)));
        }
        od_write(&bus.od, e, e->min);
        TEST_ASSERT_EQUAL_INT64(e->min, od_read(&bus.od, e));
        od_write(&bus.od, e, e->max);
        TEST_ASSERT_EQUAL_INT64(e->max, od_read(&bus.od, e));
    }
}

static void test_signed_types_are_sign_extended(void)
{
    const uint8_t minus_two[] = {0xFE, 0xFF, 0xFF, 0xFF};
    for (uint8_t type = OD_U8; type <= OD_I32; type++) {
        const struct od_entry e = {.type = type, .flags = OD_WRITE};
        const bool is_signed = type == OD_I8 || type == OD_I16 || type == OD_I24 || type == OD_I32;
        const int64_t expected = is_signed ? -2 : (INT64_C(1) << 8 * od_size(&e)) - 2;
        TEST_ASSERT_EQUAL_INT64(expected, od_decode(&e, minus_two));
        od_write(&bus.od, &e, expected);
        TEST_ASSERT_EQUAL_INT64(expected, od_read(&bus.od, &e));
    }
}

static void test_restore_begins_and_ends_with_the_objects_requested(void)
{
    bus.od.heartbeat_producer = 7; /* 1017h */
    bus.od.sync_overflow = 9;      /* 1019h */
    bus.od.smc.lambda = 123456;    /* 2110h:1 */
    od_restore(&bus.od, NODE, 0x1018, 0x1018);
    TEST_ASSERT_EQUAL_UINT(7, bus.od.heartbeat_producer);
    TEST_ASSERT_EQUAL_UINT(9, bus.od.sync_overflow);
    od_restore(&bus.od, NODE, 0x1017, 0x1018);
    TEST_ASSERT_EQUAL_UINT(od_defaults.heartbeat_producer, bus.od.heartbeat_producer);
    TEST_ASSERT_EQUAL_UINT(9, bus.od.sync_overflow);
    od_restore(&bus.od, NODE, 0x1018, 0x1019);
    TEST_ASSERT_EQUAL_UINT(0, bus.od.sync_overflow);
    TEST_ASSERT_EQUAL_UINT(123456, bus.od.smc.lambda);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_every_entry_is_found_and_the_table_is_sorted);
    RUN_TEST(test_number_that_is_not_there_reads_as_0);
    RUN_TEST(test_every_default_is_in_range_and_every_number_keeps_what_is_written);
    RUN_TEST(test_signed_types_are_sign_extended);
    RUN_TEST(test_restore_begins_and_ends_with_the_objects_requested);
    return UNITY_END();
}
