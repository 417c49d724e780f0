/* SPDX-License-Identifier: Apache-2.0 */
/* PDOs: identifiers, byte layout and times as docs/protocol.md has them. */
#include "test_canopen_bus.h"

static struct bus bus;

void setUp(void)
{
    bus_start(&bus);
    bus_give(&bus, 0, "01 05"); /* operational */
    bus.od.heartbeat_producer = 0;
    bus_telemetry_on(&bus);
}

void tearDown(void)
{
}

static unsigned sent(uint16_t id)
{
    unsigned count = 0;
    for (unsigned i = 0; i < bus.count; i++) {
        count += bus.sent[i].id == id;
    }
    return count;
}

/* ---- RPDO ---- */

static void test_rpdo1_carries_both_controlwords(void)
{
    bus_give(&bus, 0x205, "0F 00 1F 01");
    TEST_ASSERT_EQUAL_HEX16(0x000F, bus.od.axis[AXIS_X].controlword);
    TEST_ASSERT_EQUAL_HEX16(0x011F, bus.od.axis[AXIS_Y].controlword);
    TEST_ASSERT_EQUAL_UINT(1, bus.rpdos[1]);
}

static void test_every_knot_frame_reaches_the_hook_with_its_own_values(void)
{
    bus_give(&bus, 0x305, "00 AA 01 00 00 FF FF FF");
    bus_give(&bus, 0x305, "01 BB FF FF 7F 00 00 80");
    bus_give(&bus, 0x305, "02 CC 56 34 12 AA CB ED");
    TEST_ASSERT_EQUAL_UINT(3, bus.rpdos[2]);
    const int32_t dx[] = {1, 8388607, 0x123456}, dy[] = {-1, -8388608, -0x123456};
    const uint8_t crc[] = {0xAA, 0xBB, 0xCC};
    for (unsigned i = 0; i < 3; i++) {
        TEST_ASSERT_EQUAL_UINT8(i, bus.knots[i].sequence);
        TEST_ASSERT_EQUAL_HEX8(crc[i], bus.knots[i].crc);
        TEST_ASSERT_EQUAL_INT32(dx[i], bus.knots[i].dx);
        TEST_ASSERT_EQUAL_INT32(dy[i], bus.knots[i].dy);
    }
}

static void test_rpdo_is_ignored_outside_operational(void)
{
    bus_give(&bus, 0, "80 05");
    bus_give(&bus, 0x205, "0F 00 0F 00");
    bus_give(&bus, 0, "02 05");
    bus_give(&bus, 0x205, "0F 00 0F 00");
    TEST_ASSERT_EQUAL_UINT(0, bus.rpdos[1]);
    TEST_ASSERT_EQUAL_HEX16(0, bus.od.axis[AXIS_X].controlword);
}

static void test_rpdo_of_another_node_is_ignored(void)
{
    bus_give(&bus, 0x206, "0F 00 0F 00");
    TEST_ASSERT_EQUAL_UINT(0, bus.rpdos[1]);
}

static void test_short_rpdo_is_refused_and_reported_once_until_a_good_one_comes(void)
{
    bus_give(&bus, 0x305, "00 AA 01 00 00 FF FF");
    bus_give(&bus, 0x305, "");
    TEST_ASSERT_EQUAL_UINT(0, bus.rpdos[2]);
    TEST_ASSERT_EQUAL_INT32(0, bus.od.knot.dx);
    TEST_ASSERT_EQUAL_UINT32(2, bus.od.stream.rejected_length);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x085, "10 82 11 02 00 00 00 00");
    bus_give(&bus, 0x305, "00 AA 01 00 00 FF FF FF");
    TEST_ASSERT_EQUAL_UINT(1, bus.rpdos[2]);
    bus_expect(&bus, 1, 0x085, "00 00 00 00 00 00 00 00");
}

static void test_long_rpdo_may_be_another_frame_and_is_refused(void)
{
    bus_give(&bus, 0x205, "0F 00 0F 00 55");
    TEST_ASSERT_EQUAL_UINT32(1, bus.od.stream.rejected_length);
    TEST_ASSERT_EQUAL_UINT(0, bus.rpdos[1]);
    TEST_ASSERT_EQUAL_HEX16(0, bus.od.axis[AXIS_Y].controlword);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x085, "20 82 11 01 00 00 00 00");
    bus_give(&bus, 0x205, "0F 00 0F 00");
    TEST_ASSERT_EQUAL_UINT(1, bus.rpdos[1]);
    bus_expect(&bus, 1, 0x085, "00 00 00 00 00 00 00 00");
}

static void test_rpdo_that_is_switched_off_is_ignored(void)
{
    bus_give(&bus, 0, "80 05");
    bus_sdo(&bus, "23 00 14 01 05 02 00 80", "60 00 14 01 00 00 00 00");
    bus_give(&bus, 0, "01 05");
    bus_give(&bus, 0x205, "0F 00 0F 00");
    TEST_ASSERT_EQUAL_UINT(0, bus.rpdos[1]);
}

/* ---- TPDO ---- */

static void test_every_tpdo_has_its_identifier_and_layout(void)
{
    struct od_data *od = &bus.od;
    od->axis[AXIS_X].statusword = 0x1237;
    od->axis[AXIS_Y].statusword = 0x0637;
    od->stream.free = 511;
    od->stream.accepted16 = 0xFEDC;
    od->telemetry = (struct od_telemetry){.tick = 0x1234,
                                          .tangential_error = -1,
                                          .contour_error = 8388607,
                                          .position_x = -8388608,
                                          .position_y = 0x010203,
                                          .force_x = -6000,
                                          .force_y = 6000,
                                          .adaptive_gain_1 = 1000,
                                          .adaptive_gain_2 = 65535,
                                          .switching_gain_1 = 4000,
                                          .switching_gain_2 = 1,
                                          .energy = 0xDEADBEEF};
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(5, bus.count); /* all are due when operational begins */
    bus_expect(&bus, 0, 0x185, "37 12 37 06 FF 01 DC FE");
    bus_expect(&bus, 1, 0x285, "34 12 FF FF FF FF FF 7F");
    bus_expect(&bus, 2, 0x385, "34 12 00 00 80 03 02 01");
    bus_expect(&bus, 3, 0x485, "90 E8 70 17 E8 03 FF FF");
    bus_expect(&bus, 4, 0x685, "A0 0F 01 00 EF BE AD DE");
}

/* 100 frames a second, and the heartbeats: 11 % of 125 kbit/s at most. */
static void test_by_default_tpdo1_is_sent_alone(void)
{
    bus_start(&bus);
    bus.od.heartbeat_producer = 0;
    bus_give(&bus, 0, "01 05");
    bus_clear(&bus);
    bus_run_ms(&bus, 100);
    TEST_ASSERT_EQUAL_UINT(10, sent(0x185));
    TEST_ASSERT_EQUAL_UINT(10, bus.count);
}

static void test_pdo_is_switched_on_and_off_while_operational_and_the_others_go_on(void)
{
    bus_sdo(&bus, "23 01 18 01 85 02 00 C0", "60 01 18 01 00 00 00 00");
    bus_run_ms(&bus, 5);                                                 /* half of the time of TPDO1 */
    bus_sdo(&bus, "23 01 18 01 85 02 00 00", "60 01 18 01 00 00 00 00"); /* bit 30 means nothing */
    bus_clear(&bus);
    bus_run_ms(&bus, 5);
    TEST_ASSERT_EQUAL_UINT(5, sent(0x285));
    TEST_ASSERT_EQUAL_UINT(0, sent(0x185));
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
    bus_sdo(&bus, "23 01 18 01 85 02 00 80", "60 01 18 01 00 00 00 00");
    bus_clear(&bus);
    bus_run_ms(&bus, 20);
    TEST_ASSERT_EQUAL_UINT(0, sent(0x285));
    bus_sdo(&bus, "23 01 18 01 90 02 00 40", "80 01 18 01 22 00 00 08"); /* with another identifier */
    bus_sdo(&bus, "23 04 14 01 05 05 00 00", "60 04 14 01 00 00 00 00"); /* an RPDO */
    bus_sdo(&bus, "23 04 14 01 05 05 00 80", "60 04 14 01 00 00 00 00");
    bus_sdo(&bus, "23 00 14 01 05 02 00 80", "80 00 14 01 22 00 00 08"); /* but the one that carries stops */
}

static void test_tpdos_come_at_their_times_in_the_order_of_their_numbers(void)
{
    bus_run_ms(&bus, 100);
    TEST_ASSERT_EQUAL_UINT(10, sent(0x185));
    TEST_ASSERT_EQUAL_UINT(100, sent(0x285));
    TEST_ASSERT_EQUAL_UINT(100, sent(0x385));
    TEST_ASSERT_EQUAL_UINT(10, sent(0x485));
    TEST_ASSERT_EQUAL_UINT(5, sent(0x685));
    for (unsigned i = 0; i < bus.count; i++) {
        if (bus.sent[i].id == 0x485) { /* dated by the TPDO2 of the same millisecond */
            TEST_ASSERT_EQUAL_HEX16(0x285, bus.sent[i - 2].id);
            TEST_ASSERT_EQUAL_HEX16(0x385, bus.sent[i - 1].id);
        }
    }
}

static void test_no_tpdo_outside_operational(void)
{
    bus_give(&bus, 0, "80 05");
    bus_run_ms(&bus, 50);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 1));
    bus_give(&bus, 0, "02 05");
    bus_run_ms(&bus, 50);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

static void test_tpdo_sent_by_an_event_starts_its_timer_anew(void)
{
    bus_run_ms(&bus, 4);
    bus_clear(&bus);
    TEST_ASSERT_TRUE(co_tpdo_send(&bus.node, 1));
    bus_run_ms(&bus, 9);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(2, sent(0x185));
}

static void test_event_time_may_be_changed_and_0_leaves_events_only(void)
{
    bus_give(&bus, 0, "80 05");
    bus_sdo(&bus, "2B 01 18 05 05 00 00 00", "60 01 18 05 00 00 00 00");
    bus_give(&bus, 0, "01 05");
    bus_run_ms(&bus, 50);
    TEST_ASSERT_EQUAL_UINT(10, sent(0x285));
    bus_give(&bus, 0, "80 05");
    bus_sdo(&bus, "2B 01 18 05 00 00 00 00", "60 01 18 05 00 00 00 00");
    bus_give(&bus, 0, "01 05");
    bus_clear(&bus);
    bus_run_ms(&bus, 50);
    TEST_ASSERT_EQUAL_UINT(0, sent(0x285));
    TEST_ASSERT_TRUE(co_tpdo_send(&bus.node, 2));
    TEST_ASSERT_EQUAL_UINT(1, sent(0x285));
}

static void test_tpdo_that_is_switched_off_is_not_sent(void)
{
    bus_give(&bus, 0, "80 05");
    bus_sdo(&bus, "23 01 18 01 85 02 00 C0", "60 01 18 01 00 00 00 00");
    bus_give(&bus, 0, "01 05");
    bus_clear(&bus);
    bus_run_ms(&bus, 10);
    TEST_ASSERT_EQUAL_UINT(0, sent(0x285));
    TEST_ASSERT_EQUAL_UINT(0, sent(0)); /* NMT's */
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 2));
}

static void test_writing_other_objects_leaves_running_pdos_alone(void)
{
    bus_run_ms(&bus, 5); /* half of the time of TPDO1 */
    bus_sdo(&bus, "2B 17 10 00 00 00 00 00", "60 17 10 00 00 00 00 00");
    bus_sdo(&bus, "23 10 21 01 A0 86 01 00", "60 10 21 01 00 00 00 00");
    bus_clear(&bus);
    bus_run_ms(&bus, 5);
    TEST_ASSERT_EQUAL_UINT(0, sent(0x185));
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
}

static void test_rpdo_says_which_objects_it_carries(void)
{
    TEST_ASSERT_TRUE(co_rpdo_carries(&bus.node, 1, 0x6040));
    TEST_ASSERT_TRUE(co_rpdo_carries(&bus.node, 1, 0x6840));
    TEST_ASSERT_FALSE(co_rpdo_carries(&bus.node, 1, 0x2201));
    TEST_ASSERT_TRUE(co_rpdo_carries(&bus.node, 2, 0x2201));
    TEST_ASSERT_FALSE(co_rpdo_carries(&bus.node, 2, 0x6040));
    TEST_ASSERT_TRUE(co_rpdo_carries(&bus.node, 3, 0x60C1));
    TEST_ASSERT_TRUE(co_rpdo_carries(&bus.node, 3, 0x68C1));
}

static void test_tpdo_on_a_new_identifier(void)
{
    bus_give(&bus, 0, "80 05");
    bus_sdo(&bus, "23 01 18 01 85 02 00 C0", "60 01 18 01 00 00 00 00");
    bus_sdo(&bus, "23 01 18 01 90 02 00 40", "60 01 18 01 00 00 00 00");
    bus_give(&bus, 0, "01 05");
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x290));
}

static void test_full_bus_drops_telemetry_and_keeps_nothing_stale(void)
{
    bus.room = 0;
    bus_run_ms(&bus, 10);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 2));
    bus.room = SENT_MAX;
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(5, bus.count);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x285));
}

static void test_telemetry_does_not_overtake_a_waiting_emcy(void)
{
    bus.room = 0;
    co_emcy_set(&bus.node, 0x8130, CO_REG_COMMUNICATION, 0);
    bus.room = SENT_MAX;
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 1));
    bus_run_ms(&bus, 1);
    bus_expect(&bus, 0, 0x085, "30 81 11 00 00 00 00 00");
    TEST_ASSERT_EQUAL_HEX16(0x185, bus.sent[1].id);
}

static void test_mapping_objects_say_what_is_sent(void)
{
    bus_sdo(&bus, "40 01 1A 00 00 00 00 00", "4F 01 1A 00 03 00 00 00");
    bus_sdo(&bus, "40 01 1A 01 00 00 00 00", "43 01 1A 01 10 01 10 22"); /* 2210h:1, 16 bits */
    bus_sdo(&bus, "40 01 1A 02 00 00 00 00", "43 01 1A 02 18 02 10 22"); /* 2210h:2, 24 bits */
    bus_sdo(&bus, "40 00 16 02 00 00 00 00", "43 00 16 02 10 00 40 68"); /* 6840h:0, 16 bits */
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_rpdo1_carries_both_controlwords);
    RUN_TEST(test_every_knot_frame_reaches_the_hook_with_its_own_values);
    RUN_TEST(test_rpdo_is_ignored_outside_operational);
    RUN_TEST(test_rpdo_of_another_node_is_ignored);
    RUN_TEST(test_short_rpdo_is_refused_and_reported_once_until_a_good_one_comes);
    RUN_TEST(test_long_rpdo_may_be_another_frame_and_is_refused);
    RUN_TEST(test_rpdo_that_is_switched_off_is_ignored);
    RUN_TEST(test_every_tpdo_has_its_identifier_and_layout);
    RUN_TEST(test_by_default_tpdo1_is_sent_alone);
    RUN_TEST(test_pdo_is_switched_on_and_off_while_operational_and_the_others_go_on);
    RUN_TEST(test_tpdos_come_at_their_times_in_the_order_of_their_numbers);
    RUN_TEST(test_no_tpdo_outside_operational);
    RUN_TEST(test_tpdo_sent_by_an_event_starts_its_timer_anew);
    RUN_TEST(test_event_time_may_be_changed_and_0_leaves_events_only);
    RUN_TEST(test_tpdo_that_is_switched_off_is_not_sent);
    RUN_TEST(test_writing_other_objects_leaves_running_pdos_alone);
    RUN_TEST(test_rpdo_says_which_objects_it_carries);
    RUN_TEST(test_tpdo_on_a_new_identifier);
    RUN_TEST(test_full_bus_drops_telemetry_and_keeps_nothing_stale);
    RUN_TEST(test_telemetry_does_not_overtake_a_waiting_emcy);
    RUN_TEST(test_mapping_objects_say_what_is_sent);
    return UNITY_END();
}
