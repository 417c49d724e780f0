/* SPDX-License-Identifier: Apache-2.0 */
/* SDO block download, byte by byte as in CiA 301, 7.2.4.3.8 to .11. */
#include "test_canopen_block.h"

void setUp(void)
{
    bus_start(&bus);
    bus.od.heartbeat_producer = 0;
}

void tearDown(void)
{
}

static void test_download_with_crc(void)
{
    bus_sdo(&bus, "C6 10 21 01 04 00 00 00", "A4 10 21 01 01 00 00 00");
    bus_sdo(&bus, "81 A0 86 01 00 00 00 00", "A2 01 01 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(0, bus.writes);
    char end[32];
    const uint16_t crc = crc16("\xA0\x86\x01", 4);
    snprintf(end, sizeof end, "CD %02X %02X 00 00 00 00 00", crc & 0xFFu, crc >> 8 & 0xFFu);
    bus_sdo(&bus, end, "A1 00 00 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(100000, bus.od.smc.lambda);
    TEST_ASSERT_EQUAL_UINT(1, bus.writes);
}

static void test_download_with_a_wrong_crc_changes_nothing(void)
{
    bus_sdo(&bus, "C6 10 21 01 04 00 00 00", "A4 10 21 01 01 00 00 00");
    bus_sdo(&bus, "81 A0 86 01 00 00 00 00", "A2 01 01 00 00 00 00 00");
    bus_sdo(&bus, "CD 00 00 00 00 00 00 00", "80 10 21 01 04 00 04 05");
    TEST_ASSERT_EQUAL_UINT(od_defaults.smc.lambda, bus.od.smc.lambda);
}

static void test_download_without_crc_and_without_size(void)
{
    bus_sdo(&bus, "C0 17 10 00 00 00 00 00", "A0 17 10 00 01 00 00 00");
    bus_sdo(&bus, "81 0A 00 00 00 00 00 00", "A2 01 01 00 00 00 00 00");
    bus_sdo(&bus, "D5 00 00 00 00 00 00 00", "A1 00 00 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(10, bus.od.heartbeat_producer);
}

static void test_download_of_a_wrong_length_is_refused(void)
{
    bus_sdo(&bus, "C2 10 21 01 05 00 00 00", "80 10 21 01 12 00 07 06");
    bus_sdo(&bus, "C2 10 21 01 03 00 00 00", "80 10 21 01 13 00 07 06");
    bus_sdo(&bus, "C0 10 21 01 00 00 00 00", "A0 10 21 01 01 00 00 00");
    bus_sdo(&bus, "01 A0 86 01 00 00 00 00", "80 10 21 01 12 00 07 06"); /* more are to follow */
    bus_sdo(&bus, "C0 10 21 01 00 00 00 00", "A0 10 21 01 01 00 00 00");
    bus_sdo(&bus, "81 A0 86 01 00 00 00 00", "A2 01 01 00 00 00 00 00");
    bus_sdo(&bus, "D1 00 00 00 00 00 00 00", "80 10 21 01 13 00 07 06"); /* 3 bytes */
    TEST_ASSERT_EQUAL_UINT(od_defaults.smc.lambda, bus.od.smc.lambda);
}

static void test_what_cannot_be_written_cannot_be_written_by_block(void)
{
    bus_sdo(&bus, "C2 00 10 00 04 00 00 00", "80 00 10 00 02 00 01 06");
    bus_sdo(&bus, "C2 FF 5F 00 04 00 00 00", "80 FF 5F 00 00 00 02 06");
    bus_sdo(&bus, "C1 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"); /* an end of nothing */
    bus_sdo(&bus, "C2 00 20 01 01 00 00 00", "A0 00 20 01 01 00 00 00");
    bus_sdo(&bus, "81 05 00 00 00 00 00 00", "A2 01 01 00 00 00 00 00");
    bus_sdo(&bus, "D9 00 00 00 00 00 00 00", "80 00 20 01 31 00 09 06");
    bus.refuse = SDO_ABORT_STATE;
    bus_sdo(&bus, "C2 00 20 01 01 00 00 00", "A0 00 20 01 01 00 00 00");
    bus_sdo(&bus, "81 01 00 00 00 00 00 00", "A2 01 01 00 00 00 00 00");
    bus_sdo(&bus, "D9 00 00 00 00 00 00 00", "80 00 20 01 22 00 00 08");
}

static void test_new_request_and_abort_end_a_download(void)
{
    bus_sdo(&bus, "C6 10 21 01 04 00 00 00", "A4 10 21 01 01 00 00 00");
    bus_sdo(&bus, "40 00 10 00 00 00 00 00", "43 00 10 00 92 01 FF FF");
    bus_sdo(&bus, "C6 10 21 01 04 00 00 00", "A4 10 21 01 01 00 00 00");
    give("80 10 21 01 00 00 00 08");
    give("81 A0 86 01 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(0, bus.writes);
}

static void test_segment_that_comes_twice_is_written_once(void)
{
    bus_sdo(&bus, "C0 17 10 00 00 00 00 00", "A0 17 10 00 01 00 00 00");
    bus_sdo(&bus, "81 0A 00 00 00 00 00 00", "A2 01 01 00 00 00 00 00");
    give("81 0A 00 00 00 00 00 00");
    bus_sdo(&bus, "D5 00 00 00 00 00 00 00", "A1 00 00 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(1, bus.writes);
    bus_sdo(&bus, "D5 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"); /* it is over */
    TEST_ASSERT_EQUAL_UINT(1, bus.writes);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_download_with_crc);
    RUN_TEST(test_download_with_a_wrong_crc_changes_nothing);
    RUN_TEST(test_download_without_crc_and_without_size);
    RUN_TEST(test_download_of_a_wrong_length_is_refused);
    RUN_TEST(test_what_cannot_be_written_cannot_be_written_by_block);
    RUN_TEST(test_new_request_and_abort_end_a_download);
    RUN_TEST(test_segment_that_comes_twice_is_written_once);
    return UNITY_END();
}
