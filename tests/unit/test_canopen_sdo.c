/* SPDX-License-Identifier: Apache-2.0 */
/* The SDO server, byte by byte as in CiA 301, 7.2.4.3. */
#include "test_canopen_bus.h"

static struct bus bus;

void setUp(void)
{
    bus_start(&bus);
}

void tearDown(void)
{
}

/* ---- upload ---- */

static void test_upload_of_1_2_3_and_4_bytes_is_expedited(void)
{
    bus_sdo(&bus, "40 18 10 00 00 00 00 00", "4F 18 10 00 04 00 00 00");
    bus_sdo(&bus, "40 17 10 00 00 00 00 00", "4B 17 10 00 64 00 00 00");
    bus.od.telemetry.contour_error = -2;
    bus_sdo(&bus, "40 10 22 03 00 00 00 00", "47 10 22 03 FE FF FF 00");
    bus_sdo(&bus, "40 00 10 00 00 00 00 00", "43 00 10 00 92 01 FF FF");
}

static void test_upload_of_negative_numbers_is_twos_complement(void)
{
    bus_sdo(&bus, "40 7D 60 01 00 00 00 00", "43 7D 60 01 80 2E 0F F7"); /* -150000000 = F70F2E80h */
    bus.od.telemetry.force_y = -300;
    bus_sdo(&bus, "40 10 22 07 00 00 00 00", "4B 10 22 07 D4 FE 00 00");
    bus_sdo(&bus, "40 61 68 00 00 00 00 00", "4F 61 68 00 07 00 00 00");
}

static void test_axis_y_is_800h_above_axis_x(void)
{
    bus_sdo(&bus, "40 00 21 01 00 00 00 00", "43 00 21 01 10 58 01 00"); /* 88080 */
    bus_sdo(&bus, "40 00 29 01 00 00 00 00", "43 00 29 01 6C 7E 01 00"); /* 97900 */
    bus.od.axis[AXIS_Y].position_actual = 0x01020304;
    bus_sdo(&bus, "40 64 68 00 00 00 00 00", "43 64 68 00 04 03 02 01");
}

static void test_cob_ids_contain_the_node_id(void)
{
    bus_sdo(&bus, "40 14 10 00 00 00 00 00", "43 14 10 00 85 00 00 00");
    bus_sdo(&bus, "40 00 12 01 00 00 00 00", "43 00 12 01 05 06 00 00");
    bus_sdo(&bus, "40 04 18 01 00 00 00 00", "43 04 18 01 85 06 00 C0");
}

static void test_value_is_refreshed_before_it_is_read(void)
{
    bus_sdo(&bus, "40 20 20 03 00 00 00 00", "43 20 20 03 04 03 02 01");
    TEST_ASSERT_EQUAL_UINT(1, bus.reads);
}

static void test_string_comes_in_segments_with_its_length_first(void)
{
    bus.od.build_id = "0123456789ABCDEFG"; /* 17 = 7 + 7 + 3 */
    bus_sdo(&bus, "40 10 20 00 00 00 00 00", "41 10 20 00 11 00 00 00");
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "00 30 31 32 33 34 35 36");
    bus_sdo(&bus, "70 00 00 00 00 00 00 00", "10 37 38 39 41 42 43 44");
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "09 45 46 47 00 00 00 00");
    bus_sdo(&bus, "70 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"); /* it is over */
}

static void test_domain_comes_in_segments(void)
{
    bus.domain = "12345678";
    bus_sdo(&bus, "40 02 23 00 00 00 00 00", "41 02 23 00 08 00 00 00");
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "00 31 32 33 34 35 36 37");
    bus_sdo(&bus, "70 00 00 00 00 00 00 00", "1D 38 00 00 00 00 00 00");
}

static void test_domain_without_contents_is_refused_and_so_is_its_rest_when_it_is_gone(void)
{
    bus_sdo(&bus, "40 02 23 00 00 00 00 00", "80 02 23 00 24 00 00 08");
    bus.domain = "12345678";
    bus_sdo(&bus, "40 02 23 00 00 00 00 00", "41 02 23 00 08 00 00 00");
    bus.domain = NULL;
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "80 02 23 00 22 00 00 08");
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"); /* it is over */
}

static void test_domain_cannot_be_written(void)
{
    bus_sdo(&bus, "2F 02 23 00 01 00 00 00", "80 02 23 00 02 00 01 06");
}

static void test_node_without_the_hook_has_no_domain(void)
{
    bus.domain = "1";
    bus.node.config.hooks.domain_size = NULL;
    bus_sdo(&bus, "40 02 23 00 00 00 00 00", "80 02 23 00 24 00 00 08");
}

static void test_string_of_seven_and_of_no_characters(void)
{
    bus.od.num_backend = "seven..";
    bus_sdo(&bus, "40 11 20 00 00 00 00 00", "41 11 20 00 07 00 00 00");
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "01 73 65 76 65 6E 2E 2E");
    bus.od.num_backend = NULL;
    bus_sdo(&bus, "40 11 20 00 00 00 00 00", "41 11 20 00 00 00 00 00");
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "0F 00 00 00 00 00 00 00");
}

static void test_wrong_toggle_ends_an_upload(void)
{
    bus_sdo(&bus, "40 08 10 00 00 00 00 00", "41 08 10 00 06 00 00 00");
    bus_sdo(&bus, "70 00 00 00 00 00 00 00", "80 08 10 00 00 00 03 05");
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05");
}

/* ---- download ---- */

static void test_download_stores_and_calls_the_application(void)
{
    bus_sdo(&bus, "23 10 21 01 A0 86 01 00", "60 10 21 01 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(100000, bus.od.smc.lambda);
    TEST_ASSERT_EQUAL_UINT(1, bus.writes);
    TEST_ASSERT_EQUAL_HEX16(0x2110, bus.written.index);
    TEST_ASSERT_EQUAL_UINT8(1, bus.written.sub);
    TEST_ASSERT_EQUAL_INT64(100000, bus.written.value);
    TEST_ASSERT_EQUAL_HEX16(0x2110, bus.checked.index);
    TEST_ASSERT_EQUAL_INT64(100000, bus.checked.value);
}

static void test_download_of_1_2_and_signed_bytes(void)
{
    bus_sdo(&bus, "2F 00 20 01 04 00 00 00", "60 00 20 01 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT8(4, bus.od.controller.select);
    bus_sdo(&bus, "2B 40 68 00 0F 00 00 00", "60 40 68 00 00 00 00 00");
    TEST_ASSERT_EQUAL_HEX16(0x000F, bus.od.axis[AXIS_Y].controlword);
    TEST_ASSERT_EQUAL_HEX16(0, bus.od.axis[AXIS_X].controlword);
    bus_sdo(&bus, "23 00 22 02 FF FF FF FF", "60 00 22 02 00 00 00 00");
    TEST_ASSERT_EQUAL_INT32(-1, bus.od.stream.start_x);
    TEST_ASSERT_EQUAL_INT64(-1, bus.checked.value);
}

static void test_download_of_24_bits_keeps_the_sign(void)
{
    bus_sdo(&bus, "27 01 22 03 00 00 80 00", "60 01 22 03 00 00 00 00");
    TEST_ASSERT_EQUAL_INT32(-8388608, bus.od.knot.dx);
    bus_sdo(&bus, "27 01 22 04 FF FF 7F 00", "60 01 22 04 00 00 00 00");
    TEST_ASSERT_EQUAL_INT32(8388607, bus.od.knot.dy);
}

static void test_expedited_download_without_size_takes_the_size_of_the_object(void)
{
    bus_sdo(&bus, "22 17 10 00 0A 00 00 00", "60 17 10 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(10, bus.od.heartbeat_producer);
}

static void test_only_parameters_carry_the_config_flag(void)
{
    bus_sdo(&bus, "2F 00 20 01 01 00 00 00", "60 00 20 01 00 00 00 00");
    TEST_ASSERT_FALSE(bus.checked.flags & OD_CONFIG);
    bus_sdo(&bus, "23 12 21 01 A0 86 01 00", "60 12 21 01 00 00 00 00");
    TEST_ASSERT_TRUE(bus.checked.flags & OD_CONFIG);
}

static void test_application_may_refuse_with_its_own_abort_code(void)
{
    bus.refuse = SDO_ABORT_STATE;
    bus_sdo(&bus, "23 10 21 01 A0 86 01 00", "80 10 21 01 22 00 00 08");
    TEST_ASSERT_EQUAL_UINT(od_defaults.smc.lambda, bus.od.smc.lambda);
    TEST_ASSERT_EQUAL_UINT(0, bus.writes);
}

static void test_segmented_download_of_four_bytes(void)
{
    bus_sdo(&bus, "21 10 21 01 04 00 00 00", "60 10 21 01 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(0, bus.writes);
    bus_sdo(&bus, "07 A0 86 01 00 00 00 00", "20 00 00 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(100000, bus.od.smc.lambda);
    TEST_ASSERT_EQUAL_UINT(1, bus.writes);
    bus_sdo(&bus, "1D 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05"); /* it is over */
    TEST_ASSERT_EQUAL_UINT(1, bus.writes);
}

static void test_segmented_download_in_two_segments_without_announced_size(void)
{
    bus_sdo(&bus, "20 10 21 01 00 00 00 00", "60 10 21 01 00 00 00 00");
    bus_sdo(&bus, "0A A0 86 00 00 00 00 00", "20 00 00 00 00 00 00 00"); /* 2 bytes, more follow */
    TEST_ASSERT_EQUAL_UINT(od_defaults.smc.lambda, bus.od.smc.lambda);
    bus_sdo(&bus, "1B 01 00 00 00 00 00 00", "30 00 00 00 00 00 00 00"); /* 2 bytes, last, toggle 1 */
    TEST_ASSERT_EQUAL_UINT(100000, bus.od.smc.lambda);
}

static void test_wrong_toggle_ends_a_download(void)
{
    bus_sdo(&bus, "20 10 21 01 00 00 00 00", "60 10 21 01 00 00 00 00");
    bus_sdo(&bus, "17 A0 86 01 00 00 00 00", "80 10 21 01 00 00 03 05");
    bus_sdo(&bus, "07 A0 86 01 00 00 00 00", "80 00 00 00 01 00 04 05");
    TEST_ASSERT_EQUAL_UINT(od_defaults.smc.lambda, bus.od.smc.lambda);
}

static void test_segmented_download_that_is_too_long_or_too_short_is_refused(void)
{
    bus_sdo(&bus, "21 10 21 01 05 00 00 00", "80 10 21 01 12 00 07 06");
    bus_sdo(&bus, "21 10 21 01 03 00 00 00", "80 10 21 01 13 00 07 06");
    bus_sdo(&bus, "20 10 21 01 00 00 00 00", "60 10 21 01 00 00 00 00");
    bus_sdo(&bus, "01 A0 86 01 00 00 00 00", "80 10 21 01 12 00 07 06"); /* 7 bytes */
    bus_sdo(&bus, "20 10 21 01 00 00 00 00", "60 10 21 01 00 00 00 00");
    bus_sdo(&bus, "00 A0 86 01 00 00 00 00", "80 10 21 01 12 00 07 06"); /* 7 bytes, more follow */
    bus_sdo(&bus, "20 10 21 01 00 00 00 00", "60 10 21 01 00 00 00 00");
    bus_sdo(&bus, "09 A0 86 01 00 00 00 00", "80 10 21 01 13 00 07 06"); /* 3 bytes, last */
    TEST_ASSERT_EQUAL_UINT(od_defaults.smc.lambda, bus.od.smc.lambda);
}

static void test_segmented_download_is_range_checked_at_its_end(void)
{
    bus_sdo(&bus, "20 10 21 01 00 00 00 00", "60 10 21 01 00 00 00 00");
    bus_sdo(&bus, "07 00 00 00 00 00 00 00", "80 10 21 01 32 00 09 06");
    TEST_ASSERT_EQUAL_UINT(od_defaults.smc.lambda, bus.od.smc.lambda);
}

/* ---- what is refused ---- */

static void test_unknown_object_and_unknown_sub_have_different_codes(void)
{
    bus_sdo(&bus, "40 FF 5F 00 00 00 00 00", "80 FF 5F 00 00 00 02 06");
    bus_sdo(&bus, "40 FF FF FF 00 00 00 00", "80 FF FF FF 00 00 02 06"); /* after the last */
    bus_sdo(&bus, "40 00 00 00 00 00 00 00", "80 00 00 00 00 00 02 06"); /* before the first */
    bus_sdo(&bus, "40 18 10 05 00 00 00 00", "80 18 10 05 11 00 09 06");
    bus_sdo(&bus, "40 00 10 01 00 00 00 00", "80 00 10 01 11 00 09 06");
    bus_sdo(&bus, "40 FF 6F 01 00 00 00 00", "80 FF 6F 01 11 00 09 06"); /* sub after the last entry */
    bus_sdo(&bus, "2F FF 5F 00 00 00 00 00", "80 FF 5F 00 00 00 02 06");
}

static void test_read_only_and_constant_objects_cannot_be_written(void)
{
    bus_sdo(&bus, "2B 41 60 00 00 00 00 00", "80 41 60 00 02 00 01 06");
    bus_sdo(&bus, "23 00 10 00 00 00 00 00", "80 00 10 00 02 00 01 06");
    bus_sdo(&bus, "21 08 10 00 06 00 00 00", "80 08 10 00 02 00 01 06");
    bus_sdo(&bus, "23 20 20 01 00 00 00 00", "80 20 20 01 02 00 01 06");
}

static void test_write_only_objects_cannot_be_read(void)
{
    bus_sdo(&bus, "40 00 22 01 00 00 00 00", "80 00 22 01 01 00 01 06");
}

static void test_value_outside_the_range_is_refused_and_changes_nothing(void)
{
    bus_sdo(&bus, "2F 00 20 01 05 00 00 00", "80 00 20 01 31 00 09 06");
    TEST_ASSERT_EQUAL_UINT8(2, bus.od.controller.select);
    bus_sdo(&bus, "2F 98 60 00 00 00 00 00", "80 98 60 00 32 00 09 06");
    bus_sdo(&bus, "2F 98 60 00 FF 00 00 00", "80 98 60 00 32 00 09 06"); /* -1 */
    bus_sdo(&bus, "23 7D 60 01 FF 6B CA 88", "80 7D 60 01 32 00 09 06"); /* -2000000001 */
    TEST_ASSERT_EQUAL_INT32(-150000000, bus.od.axis[AXIS_X].position_limit.min);
    TEST_ASSERT_EQUAL_UINT(0, bus.writes);
}

static void test_both_ends_of_a_range_are_allowed(void)
{
    bus_sdo(&bus, "23 7D 60 01 00 6C CA 88", "60 7D 60 01 00 00 00 00"); /* -2000000000 */
    bus_sdo(&bus, "23 7D 60 02 00 94 35 77", "60 7D 60 02 00 00 00 00"); /* +2000000000 */
    TEST_ASSERT_EQUAL_INT32(-2000000000, bus.od.axis[AXIS_X].position_limit.min);
    TEST_ASSERT_EQUAL_INT32(2000000000, bus.od.axis[AXIS_X].position_limit.max);
}

static void test_expedited_download_of_a_wrong_length_is_refused(void)
{
    bus_sdo(&bus, "23 17 10 00 0A 00 00 00", "80 17 10 00 12 00 07 06");
    bus_sdo(&bus, "2F 17 10 00 0A 00 00 00", "80 17 10 00 13 00 07 06");
    TEST_ASSERT_EQUAL_UINT(100, bus.od.heartbeat_producer);
}

static void test_request_that_is_not_eight_bytes_long_is_ignored(void)
{
    bus_clear(&bus);
    bus_give(&bus, 0x605, "40 00 10 00 00 00 00");
    bus_give(&bus, 0x605, "");
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

static void test_segment_without_transfer_and_unknown_commands_are_refused(void)
{
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05");
    bus_sdo(&bus, "00 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05");
    bus_sdo(&bus, "E0 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05");
}

static void test_segment_of_the_other_direction_ends_a_transfer(void)
{
    bus_sdo(&bus, "40 08 10 00 00 00 00 00", "41 08 10 00 06 00 00 00");
    bus_sdo(&bus, "00 00 00 00 00 00 00 00", "80 08 10 00 01 00 04 05");
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05");
}

static void test_new_request_takes_the_place_of_a_transfer(void)
{
    bus_sdo(&bus, "20 10 21 01 00 00 00 00", "60 10 21 01 00 00 00 00");
    bus_sdo(&bus, "40 17 10 00 00 00 00 00", "4B 17 10 00 64 00 00 00");
    bus_sdo(&bus, "07 A0 86 01 00 00 00 00", "80 00 00 00 01 00 04 05");
    bus_sdo(&bus, "20 10 21 01 00 00 00 00", "60 10 21 01 00 00 00 00");
    bus_sdo(&bus, "2B 17 10 00 0A 00 00 00", "60 17 10 00 00 00 00 00");
    bus_sdo(&bus, "07 A0 86 01 00 00 00 00", "80 00 00 00 01 00 04 05");
    TEST_ASSERT_EQUAL_UINT(od_defaults.smc.lambda, bus.od.smc.lambda);
}

static void test_abort_of_the_client_ends_a_transfer_without_an_answer(void)
{
    bus_sdo(&bus, "40 08 10 00 00 00 00 00", "41 08 10 00 06 00 00 00");
    bus_clear(&bus);
    bus_give(&bus, 0x605, "80 08 10 00 00 00 04 05");
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05");
}

static void test_silent_client_ends_a_transfer_after_two_seconds(void)
{
    bus_sdo(&bus, "40 08 10 00 00 00 00 00", "41 08 10 00 06 00 00 00");
    bus.node.config.od->heartbeat_producer = 0;
    bus_clear(&bus);
    bus_run_ms(&bus, CO_SDO_TIMEOUT_MS);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_run_ms(&bus, CO_SDO_TIMEOUT_MS);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x585, "80 08 10 00 00 00 04 05");
}

static void test_slow_client_is_not_silent(void)
{
    bus.od.heartbeat_producer = 0;
    bus.od.build_id = "123456789012345";
    bus_sdo(&bus, "40 10 20 00 00 00 00 00", "41 10 20 00 0F 00 00 00");
    bus_run_ms(&bus, CO_SDO_TIMEOUT_MS);
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "00 31 32 33 34 35 36 37");
    bus_run_ms(&bus, CO_SDO_TIMEOUT_MS);
    bus_sdo(&bus, "70 00 00 00 00 00 00 00", "10 38 39 30 31 32 33 34");
    bus_run_ms(&bus, CO_SDO_TIMEOUT_MS);
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "0D 35 00 00 00 00 00 00");
}

static void test_pdo_identifier_changes_only_while_the_pdo_is_not_in_use(void)
{
    bus_telemetry_on(&bus);
    bus_sdo(&bus, "23 01 18 01 90 02 00 40", "80 01 18 01 30 00 09 06");
    bus_sdo(&bus, "23 01 18 01 85 02 00 C0", "60 01 18 01 00 00 00 00");
    bus_sdo(&bus, "23 01 18 01 90 02 00 C0", "60 01 18 01 00 00 00 00");
    bus_sdo(&bus, "23 01 18 01 90 02 00 40", "60 01 18 01 00 00 00 00");
    TEST_ASSERT_EQUAL_HEX32(0x40000290, bus.od.tpdo2.cob_id);
}

static void test_pdo_identifier_must_be_free_and_of_11_bits(void)
{
    bus_sdo(&bus, "23 00 14 01 05 02 00 80", "60 00 14 01 00 00 00 00");
    bus_sdo(&bus, "23 00 14 01 05 06 00 00", "80 00 14 01 30 00 09 06"); /* SDO */
    bus_sdo(&bus, "23 00 14 01 00 00 00 00", "80 00 14 01 30 00 09 06"); /* NMT */
    bus_sdo(&bus, "23 00 14 01 7F 07 00 00", "80 00 14 01 30 00 09 06"); /* heartbeat */
    bus_sdo(&bus, "23 00 14 01 05 02 00 20", "80 00 14 01 30 00 09 06"); /* 29 bits */
}

/* CiA 301, restricted CAN-IDs: each end of each range. Bit 30 may change while the identifier stays. */
static void test_ends_of_the_ranges_of_restricted_identifiers(void)
{
    static const uint16_t free_ids[] = {0x080, 0x100, 0x181, 0x580, 0x600, 0x680, 0x6DF};
    static const uint16_t restricted[] = {0x000, 0x001, 0x07F, 0x101, 0x180, 0x581, 0x5FF, 0x601,
                                          0x67F, 0x6E0, 0x700, 0x701, 0x77F, 0x780, 0x7FF};
    char request[32];
    for (unsigned i = 0; i < sizeof free_ids / sizeof free_ids[0]; i++) {
        bus_sdo(&bus, "23 02 14 01 05 04 00 80", "60 02 14 01 00 00 00 00");
        (void)snprintf(request, sizeof request, "23 02 14 01 %02X %02X 00 00", free_ids[i] & 0xFFu, free_ids[i] >> 8);
        bus_sdo(&bus, request, "60 02 14 01 00 00 00 00");
        (void)snprintf(request, sizeof request, "23 02 14 01 %02X %02X 00 40", free_ids[i] & 0xFFu, free_ids[i] >> 8);
        bus_sdo(&bus, request, "60 02 14 01 00 00 00 00");
        TEST_ASSERT_EQUAL_HEX32(0x40000000u | free_ids[i], bus.od.rpdo3.cob_id);
    }
    bus_sdo(&bus, "23 02 14 01 05 04 00 80", "60 02 14 01 00 00 00 00");
    for (unsigned i = 0; i < sizeof restricted / sizeof restricted[0]; i++) {
        (void)snprintf(request, sizeof request, "23 02 14 01 %02X %02X 00 00", restricted[i] & 0xFFu,
                       restricted[i] >> 8);
        bus_sdo(&bus, request, "80 02 14 01 30 00 09 06");
        (void)snprintf(request, sizeof request, "23 02 14 01 %02X %02X 00 80", restricted[i] & 0xFFu,
                       restricted[i] >> 8);
        bus_sdo(&bus, request, "60 02 14 01 00 00 00 00"); /* a PDO that is not in use may hold any identifier */
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_upload_of_1_2_3_and_4_bytes_is_expedited);
    RUN_TEST(test_upload_of_negative_numbers_is_twos_complement);
    RUN_TEST(test_axis_y_is_800h_above_axis_x);
    RUN_TEST(test_cob_ids_contain_the_node_id);
    RUN_TEST(test_value_is_refreshed_before_it_is_read);
    RUN_TEST(test_string_comes_in_segments_with_its_length_first);
    RUN_TEST(test_domain_comes_in_segments);
    RUN_TEST(test_domain_without_contents_is_refused_and_so_is_its_rest_when_it_is_gone);
    RUN_TEST(test_domain_cannot_be_written);
    RUN_TEST(test_node_without_the_hook_has_no_domain);
    RUN_TEST(test_string_of_seven_and_of_no_characters);
    RUN_TEST(test_wrong_toggle_ends_an_upload);
    RUN_TEST(test_download_stores_and_calls_the_application);
    RUN_TEST(test_download_of_1_2_and_signed_bytes);
    RUN_TEST(test_download_of_24_bits_keeps_the_sign);
    RUN_TEST(test_expedited_download_without_size_takes_the_size_of_the_object);
    RUN_TEST(test_only_parameters_carry_the_config_flag);
    RUN_TEST(test_application_may_refuse_with_its_own_abort_code);
    RUN_TEST(test_segmented_download_of_four_bytes);
    RUN_TEST(test_segmented_download_in_two_segments_without_announced_size);
    RUN_TEST(test_wrong_toggle_ends_a_download);
    RUN_TEST(test_segmented_download_that_is_too_long_or_too_short_is_refused);
    RUN_TEST(test_segmented_download_is_range_checked_at_its_end);
    RUN_TEST(test_unknown_object_and_unknown_sub_have_different_codes);
    RUN_TEST(test_read_only_and_constant_objects_cannot_be_written);
    RUN_TEST(test_write_only_objects_cannot_be_read);
    RUN_TEST(test_value_outside_the_range_is_refused_and_changes_nothing);
    RUN_TEST(test_both_ends_of_a_range_are_allowed);
    RUN_TEST(test_expedited_download_of_a_wrong_length_is_refused);
    RUN_TEST(test_request_that_is_not_eight_bytes_long_is_ignored);
    RUN_TEST(test_segment_without_transfer_and_unknown_commands_are_refused);
    RUN_TEST(test_segment_of_the_other_direction_ends_a_transfer);
    RUN_TEST(test_new_request_takes_the_place_of_a_transfer);
    RUN_TEST(test_abort_of_the_client_ends_a_transfer_without_an_answer);
    RUN_TEST(test_silent_client_ends_a_transfer_after_two_seconds);
    RUN_TEST(test_slow_client_is_not_silent);
    RUN_TEST(test_pdo_identifier_changes_only_while_the_pdo_is_not_in_use);
    RUN_TEST(test_pdo_identifier_must_be_free_and_of_11_bits);
    RUN_TEST(test_ends_of_the_ranges_of_restricted_identifiers);
    return UNITY_END();
}
