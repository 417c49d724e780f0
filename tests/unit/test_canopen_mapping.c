/* SPDX-License-Identifier: Apache-2.0 */
/* PDO mapping changed by SDO, in the order and with the checks of CiA 301 (7.5.2.36, 7.5.2.38). */
#include "test_canopen_bus.h"

static struct bus bus;

void setUp(void)
{
    bus_start(&bus);
    bus.od.heartbeat_producer = 0;
    bus_telemetry_on(&bus);
}

void tearDown(void)
{
}

#define NO_OBJECT 0x06020000u
#define NOT_MAPPABLE 0x06040041u
#define TOO_LONG 0x06040042u
#define STATE 0x08000022u

/* What the node answers to a write: 0, or the abort code. */
static uint32_t write(uint16_t index, uint8_t sub, uint32_t value, unsigned bytes)
{
    struct can_frame request = {.id = 0x605, .len = 8, .data = {(uint8_t)(0x23u | (4u - bytes) << 2)}};
    co_put(&request.data[1], index, 2);
    request.data[3] = sub;
    co_put(&request.data[4], value, 4);
    bus_clear(&bus);
    co_receive(&bus.node, &request);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    return bus.sent[0].data[0] == 0x80 ? co_get(&bus.sent[0].data[4], 4) : 0;
}

static uint32_t map(uint16_t index, uint8_t sub, uint32_t value)
{
    return write(index, sub, value, 4);
}

static uint32_t count(uint16_t index, uint8_t value)
{
    return write(index, 0, value, 1);
}

enum { RPDO1 = 0x1600, TPDO5 = 0x1A04 };

/* Out of use, and empty */
static void open_mapping(uint16_t index)
{
    const uint16_t communication = (uint16_t)(index - 0x200);
    TEST_ASSERT_EQUAL_HEX32(0,
                            write(communication, 1, (uint32_t)od_number(&bus.od, communication, 1) | 0x80000000u, 4));
    TEST_ASSERT_EQUAL_HEX32(0, count(index, 0));
}

static void close_mapping(uint16_t index, uint8_t entries)
{
    const uint16_t communication = (uint16_t)(index - 0x200);
    TEST_ASSERT_EQUAL_HEX32(0, count(index, entries));
    TEST_ASSERT_EQUAL_HEX32(0,
                            write(communication, 1, (uint32_t)od_number(&bus.od, communication, 1) & 0x7FFFFFFFu, 4));
    bus_give(&bus, 0, "01 05");
    bus_clear(&bus);
}

static void test_tpdo_with_another_mapping_sends_it(void)
{
    open_mapping(TPDO5);
    TEST_ASSERT_EQUAL_HEX32(0, map(TPDO5, 1, 0x10010008)); /* error register */
    TEST_ASSERT_EQUAL_HEX32(0, map(TPDO5, 2, 0x22100218)); /* tangential error, i24 */
    TEST_ASSERT_EQUAL_HEX32(0, map(TPDO5, 3, 0x68410010)); /* statusword y */
    close_mapping(TPDO5, 3);
    bus.od.error_register = 0x11;
    bus.od.telemetry.tangential_error = -2;
    bus.od.axis[AXIS_Y].statusword = 0x1234;
    TEST_ASSERT_TRUE(co_tpdo_send(&bus.node, 5));
    bus_expect(&bus, 0, 0x685, "11 FE FF FF 34 12");
}

static void test_rpdo_with_gaps_stores_what_is_around_them(void)
{
    open_mapping(RPDO1);
    TEST_ASSERT_EQUAL_HEX32(0, map(RPDO1, 1, 0x00050008)); /* a dummy u8 */
    TEST_ASSERT_EQUAL_HEX32(0, map(RPDO1, 2, 0x68400010));
    TEST_ASSERT_EQUAL_HEX32(0, map(RPDO1, 3, 0x00040020)); /* a dummy i32 */
    close_mapping(RPDO1, 3);
    const struct od_data before = bus.od;
    bus_give(&bus, 0x205, "AA 0F 00 BB BB BB BB");
    TEST_ASSERT_EQUAL_UINT(1, bus.rpdos[1]);
    TEST_ASSERT_EQUAL_HEX16(0x000F, bus.od.axis[AXIS_Y].controlword);
    bus.od.axis[AXIS_Y].controlword = before.axis[AXIS_Y].controlword;
    TEST_ASSERT_EQUAL_MEMORY(&before, &bus.od, sizeof before);
    TEST_ASSERT_TRUE(co_rpdo_carries(&bus.node, 1, 0x6840));
    TEST_ASSERT_FALSE(co_rpdo_carries(&bus.node, 1, 0x6040));
}

/* CiA 301, 7.4.2: data types 0002h..0007h */
static void test_dummy_of_each_type_takes_its_place_and_stores_nothing(void)
{
    static const struct {
        uint32_t map;
        const char *frame;
    } dummies[] = {{0x00020008, "FF 0F 00"}, {0x00030010, "FF FF 0F 00"}, {0x00040020, "FF FF FF FF 0F 00"},
                   {0x00050008, "FF 0F 00"}, {0x00060010, "FF FF 0F 00"}, {0x00070020, "FF FF FF FF 0F 00"}};
    for (unsigned i = 0; i < sizeof dummies / sizeof dummies[0]; i++) {
        setUp();
        open_mapping(RPDO1);
        TEST_ASSERT_EQUAL_HEX32(0, map(RPDO1, 1, dummies[i].map));
        TEST_ASSERT_EQUAL_HEX32(0, map(RPDO1, 2, 0x68400010));
        close_mapping(RPDO1, 2);
        struct od_data expected = bus.od;
        expected.axis[AXIS_Y].controlword = 0x000F;
        bus_give(&bus, 0x205, dummies[i].frame);
        TEST_ASSERT_EQUAL_UINT(1, bus.rpdos[1]);
        TEST_ASSERT_EQUAL_MEMORY(&expected, &bus.od, sizeof expected);
    }
    bus_give(&bus, 0, "80 05");
    open_mapping(RPDO1);
    TEST_ASSERT_EQUAL_HEX32(0x06020000, map(RPDO1, 1, 0x00010008));
    TEST_ASSERT_EQUAL_HEX32(0x06020000, map(RPDO1, 1, 0x00080020));
    TEST_ASSERT_EQUAL_HEX32(0x06020000, map(RPDO1, 1, 0x00050108)); /* a sub */
}

/* Each kind at both ends of its objects: 1600h.. of what is received, 1A00h.. of what is sent */
static void test_first_and_last_pdo_of_each_kind_map_what_fits_their_direction(void)
{
    static const struct {
        uint16_t index;
        uint32_t fits, does_not;
    } pdos[] = {{0x1600, 0x22010108, 0x60410010},
                {0x1602, 0x22010108, 0x60410010},
                {0x1A00, 0x60410010, 0x22010108},
                {0x1A04, 0x60410010, 0x22010108}};
    for (unsigned i = 0; i < sizeof pdos / sizeof pdos[0]; i++) {
        open_mapping(pdos[i].index);
        TEST_ASSERT_EQUAL_HEX32(0, map(pdos[i].index, 1, pdos[i].fits));
        TEST_ASSERT_EQUAL_HEX32(0x06040041, map(pdos[i].index, 2, pdos[i].does_not));
        TEST_ASSERT_EQUAL_HEX32(0x06040042, map(pdos[i].index, 2, pdos[i].fits + 1)); /* a bit longer */
    }
}

static uint32_t check_rpdo(void *ctx, const struct od_entry *entry, int64_t value)
{
    (void)ctx;
    return entry->index == 0x6060 && value == 4 ? 0x06090030 : 0;
}

static void test_values_of_an_rpdo_that_are_refused_are_left_out_and_told_until_all_rpdos_are_right(void)
{
    struct co_config config = bus.node.config;
    config.hooks.check_rpdo = check_rpdo;
    co_init(&bus.node, &config);
    open_mapping(RPDO1);
    TEST_ASSERT_EQUAL_HEX32(0, map(RPDO1, 1, 0x21310010)); /* feed override: up to 1200 */
    TEST_ASSERT_EQUAL_HEX32(0, map(RPDO1, 2, 0x60400010)); /* controlword x */
    close_mapping(RPDO1, 2);
    bus_give(&bus, 0, "80 05");
    open_mapping(RPDO1 + 1);
    TEST_ASSERT_EQUAL_HEX32(0, map(RPDO1 + 1, 1, 0x60600008)); /* mode x */
    close_mapping(RPDO1 + 1, 1);
    bus_clear(&bus);
    bus_give(&bus, 0x205, "B1 04 0F 00");
    TEST_ASSERT_EQUAL_UINT(1, bus.rpdos[1]);
    TEST_ASSERT_EQUAL_HEX16(0x0F, bus.od.axis[AXIS_X].controlword);
    TEST_ASSERT_EQUAL_UINT16(1000, bus.od.feed_override);
    TEST_ASSERT_EQUAL_UINT32(1, bus.od.stream.rejected_range);
    bus_give(&bus, 0x305, "04");
    TEST_ASSERT_EQUAL_INT8(7, bus.od.axis[AXIS_X].mode);
    TEST_ASSERT_EQUAL_UINT32(2, bus.od.stream.rejected_range);
    bus_give(&bus, 0x205, "B0 04 06 00");
    TEST_ASSERT_EQUAL_UINT16(1200, bus.od.feed_override);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);                  /* the other RPDO is still wrong */
    bus_expect(&bus, 0, 0x085, "00 82 11 01 00 31 21 00"); /* RPDO 1, sub-index, index */
    bus_give(&bus, 0x305, "03");
    TEST_ASSERT_EQUAL_INT8(3, bus.od.axis[AXIS_X].mode);
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
    bus_expect(&bus, 1, 0x085, "00 00 00 00 00 00 00 00");
}

static void test_mapping_is_changed_only_out_of_use_and_when_it_is_empty(void)
{
    TEST_ASSERT_EQUAL_HEX32(STATE, count(TPDO5, 0));
    TEST_ASSERT_EQUAL_HEX32(STATE, map(TPDO5, 1, 0x10010008));
    TEST_ASSERT_EQUAL_HEX32(0, write(0x1804, 1, 0xC0000685, 4));
    TEST_ASSERT_EQUAL_HEX32(STATE, map(TPDO5, 1, 0x10010008));
    TEST_ASSERT_EQUAL_HEX32(0, count(TPDO5, 0));
    TEST_ASSERT_EQUAL_HEX32(0, map(TPDO5, 1, 0x10010008));
}

static void test_operational_changes_no_pdo(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, write(0x1804, 1, 0xC0000685, 4));
    bus_give(&bus, 0, "01 05");
    TEST_ASSERT_EQUAL_HEX32(STATE, write(0x1804, 1, 0xC0000690, 4));
    TEST_ASSERT_EQUAL_HEX32(STATE, write(0x1804, 2, 1, 1));
    TEST_ASSERT_EQUAL_HEX32(STATE, write(0x1804, 3, 0, 2));
    TEST_ASSERT_EQUAL_HEX32(STATE, write(0x1804, 5, 1, 2));
    TEST_ASSERT_EQUAL_HEX32(STATE, write(0x1804, 6, 1, 1));
    TEST_ASSERT_EQUAL_HEX32(STATE, count(TPDO5, 0));
    TEST_ASSERT_EQUAL_HEX32(STATE, map(TPDO5, 1, 0x10010008));
    TEST_ASSERT_EQUAL_HEX32(STATE, write(0x1400, 2, 1, 1));
}

static void test_object_that_does_not_exist_cannot_be_mapped(void)
{
    open_mapping(TPDO5);
    TEST_ASSERT_EQUAL_HEX32(NO_OBJECT, map(TPDO5, 1, 0x50000008));
    TEST_ASSERT_EQUAL_HEX32(NO_OBJECT, map(TPDO5, 1, 0x22106308)); /* no such sub */
    open_mapping(RPDO1);
    TEST_ASSERT_EQUAL_HEX32(NO_OBJECT, map(RPDO1, 1, 0x00010001)); /* dummies have whole bytes */
    TEST_ASSERT_EQUAL_HEX32(NO_OBJECT, map(RPDO1, 1, 0x00080020));
    TEST_ASSERT_EQUAL_HEX32(NO_OBJECT, map(RPDO1, 1, 0x00050108));
}

static void test_object_of_the_wrong_direction_or_not_marked_cannot_be_mapped(void)
{
    open_mapping(TPDO5);
    TEST_ASSERT_EQUAL_HEX32(NOT_MAPPABLE, map(TPDO5, 1, 0x22010108)); /* write only */
    TEST_ASSERT_EQUAL_HEX32(NOT_MAPPABLE, map(TPDO5, 1, 0x10170010));
    TEST_ASSERT_EQUAL_HEX32(NOT_MAPPABLE, map(TPDO5, 1, 0x20100020)); /* a string */
    TEST_ASSERT_EQUAL_HEX32(NOT_MAPPABLE, map(TPDO5, 1, 0x00050008)); /* dummies are for RPDOs */
    open_mapping(RPDO1);
    TEST_ASSERT_EQUAL_HEX32(NOT_MAPPABLE, map(RPDO1, 1, 0x60410010)); /* read only */
}

static void test_entry_of_the_wrong_length_is_refused(void)
{
    open_mapping(TPDO5);
    TEST_ASSERT_EQUAL_HEX32(TOO_LONG, map(TPDO5, 1, 0x60410008));
    TEST_ASSERT_EQUAL_HEX32(TOO_LONG, map(TPDO5, 1, 0x60410020));
    TEST_ASSERT_EQUAL_HEX32(TOO_LONG, map(TPDO5, 1, 0x60410000));
}

static void test_count_is_refused_when_the_entries_are_too_long_together_or_not_filled(void)
{
    open_mapping(TPDO5);
    for (uint8_t sub = 1; sub <= 4; sub++) {
        TEST_ASSERT_EQUAL_HEX32(0, map(TPDO5, sub, 0x22100218)); /* 3 bytes */
    }
    TEST_ASSERT_EQUAL_HEX32(TOO_LONG, count(TPDO5, 3));
    TEST_ASSERT_EQUAL_HEX32(0, map(TPDO5, 2, 0));
    TEST_ASSERT_EQUAL_HEX32(NO_OBJECT, count(TPDO5, 2));
    TEST_ASSERT_EQUAL_HEX32(0x06090031, count(TPDO5, 9));
    TEST_ASSERT_EQUAL_UINT8(0, bus.od.tpdo5_map.highest_sub);
    TEST_ASSERT_EQUAL_HEX32(0, count(TPDO5, 1));
}

static void test_eight_entries_of_one_byte(void)
{
    open_mapping(TPDO5);
    for (uint8_t sub = 1; sub <= 8; sub++) {
        TEST_ASSERT_EQUAL_HEX32(0, map(TPDO5, sub, 0x10010008));
    }
    close_mapping(TPDO5, 8);
    TEST_ASSERT_TRUE(co_tpdo_send(&bus.node, 5));
    bus_expect(&bus, 0, 0x685, "00 00 00 00 00 00 00 00");
}

static void test_pdo_that_maps_nothing_is_not_in_use(void)
{
    open_mapping(TPDO5);
    close_mapping(TPDO5, 0);
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 5));
    bus_run_ms(&bus, 100);
    for (unsigned i = 0; i < bus.count; i++) {
        TEST_ASSERT_NOT_EQUAL_HEX16(0x685, bus.sent[i].id);
    }
}

/* The store of another firmware may hold what no SDO could have written here. */
static void test_mapping_that_makes_no_sense_is_not_in_use(void)
{
    bus.od.tpdo4_map.map_2 = 0x22106308;
    bus.od.tpdo5_map.map_4 = 0x22100C20;
    bus.od.tpdo5_map.highest_sub = 4; /* 12 bytes */
    co_pdo_refresh(&bus.node.pdo);
    bus_give(&bus, 0, "01 05");
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 4));
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 5));
    TEST_ASSERT_TRUE(co_tpdo_send(&bus.node, 3));
    bus.od.tpdo5_map.map_1 = 0x10010008; /* 1 + 2 + 4 + 2: a byte too many */
    bus.od.tpdo5_map.map_4 = 0x60410010;
    co_pdo_refresh(&bus.node.pdo);
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 5));
}

static void test_reset_communication_brings_the_default_mapping_back(void)
{
    open_mapping(TPDO5);
    TEST_ASSERT_EQUAL_HEX32(0, map(TPDO5, 1, 0x10010008));
    close_mapping(TPDO5, 1);
    bus_give(&bus, 0, "82 05");
    bus_give(&bus, 0, "01 05");
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 5));
    bus_telemetry_on(&bus);
    TEST_ASSERT_TRUE(co_tpdo_send(&bus.node, 5));
    bus_expect(&bus, 0, 0x685, "00 00 00 00 00 00 00 00");
    TEST_ASSERT_EQUAL_HEX32(0x22100A10, bus.od.tpdo5_map.map_1);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_tpdo_with_another_mapping_sends_it);
    RUN_TEST(test_rpdo_with_gaps_stores_what_is_around_them);
    RUN_TEST(test_dummy_of_each_type_takes_its_place_and_stores_nothing);
    RUN_TEST(test_first_and_last_pdo_of_each_kind_map_what_fits_their_direction);
    RUN_TEST(test_values_of_an_rpdo_that_are_refused_are_left_out_and_told_until_all_rpdos_are_right);
    RUN_TEST(test_mapping_is_changed_only_out_of_use_and_when_it_is_empty);
    RUN_TEST(test_operational_changes_no_pdo);
    RUN_TEST(test_object_that_does_not_exist_cannot_be_mapped);
    RUN_TEST(test_object_of_the_wrong_direction_or_not_marked_cannot_be_mapped);
    RUN_TEST(test_entry_of_the_wrong_length_is_refused);
    RUN_TEST(test_count_is_refused_when_the_entries_are_too_long_together_or_not_filled);
    RUN_TEST(test_eight_entries_of_one_byte);
    RUN_TEST(test_pdo_that_maps_nothing_is_not_in_use);
    RUN_TEST(test_mapping_that_makes_no_sense_is_not_in_use);
    RUN_TEST(test_reset_communication_brings_the_default_mapping_back);
    return UNITY_END();
}
