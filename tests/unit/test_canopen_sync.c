/* SPDX-License-Identifier: Apache-2.0 */
/* SYNC and the transmission types of PDOs (CiA 301, 7.2.2 and 7.2.5). */
#include "test_canopen_bus.h"

static struct bus bus;

void setUp(void)
{
    bus_start(&bus);
    bus.od.heartbeat_producer = 0;
    bus_clear(&bus);
}

void tearDown(void)
{
}

/* 1800h:2 of TPDO1, by SDO. */
static void tpdo1_type(uint8_t type)
{
    char request[32];
    snprintf(request, sizeof request, "2F 00 18 02 %02X 00 00 00", type);
    bus_sdo(&bus, request, "60 00 18 02 00 00 00 00");
}

static void start(void)
{
    bus_give(&bus, 0, "01 05");
    bus_clear(&bus);
}

static unsigned sent(uint16_t id)
{
    unsigned count = 0;
    for (unsigned i = 0; i < bus.count; i++) {
        count += bus.sent[i].id == id;
    }
    return count;
}

static void sync(unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        bus_give(&bus, 0x80, "");
    }
}

/* ---- TPDO ---- */

static void test_type_1_answers_every_sync_with_the_values_of_that_moment_and_nothing_else_sends_it(void)
{
    tpdo1_type(1);
    start();
    bus_run_ms(&bus, 50);
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 1));
    TEST_ASSERT_EQUAL_UINT(0, sent(0x185));
    bus_clear(&bus);
    bus.od.stream.free = 500;
    sync(1);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x185, "00 00 00 00 F4 01 00 00");
    sync(3);
    TEST_ASSERT_EQUAL_UINT(4, bus.count);
}

static void test_type_n_sends_at_every_nth_sync(void)
{
    tpdo1_type(240);
    start();
    sync(239);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    sync(1);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    sync(240);
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
}

static void test_type_0_sends_at_the_sync_after_an_event(void)
{
    tpdo1_type(0);
    start();
    sync(3);
    bus_run_ms(&bus, 20);
    TEST_ASSERT_EQUAL_UINT(0, sent(0x185));
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 1));
    TEST_ASSERT_EQUAL_UINT(0, sent(0x185));
    sync(3);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
}

static void test_event_driven_tpdos_take_no_notice_of_sync(void)
{
    tpdo1_type(255);
    start();
    sync(5);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_run_ms(&bus, 10);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
}

static void test_types_that_are_reserved_or_remote_are_refused(void)
{
    for (unsigned type = 241; type <= 253; type++) {
        char request[32];
        snprintf(request, sizeof request, "2F 00 18 02 %02X 00 00 00", type);
        bus_sdo(&bus, request, "80 00 18 02 30 00 09 06");
    }
    tpdo1_type(240);
    tpdo1_type(254);
    tpdo1_type(255);
}

static void test_synchronous_tpdo_that_found_no_room_comes_at_the_next_sync(void)
{
    tpdo1_type(3);
    start();
    sync(2);
    bus.room = 0;
    sync(1);
    bus.room = SENT_MAX;
    sync(1);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    sync(2);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    sync(1);
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
}

static void test_counting_starts_anew_with_operational(void)
{
    tpdo1_type(3);
    start();
    sync(2);
    bus_give(&bus, 0, "80 05");
    start();
    sync(2);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    sync(1);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
}

static void test_event_before_operational_ended_is_not_sent_in_the_next(void)
{
    tpdo1_type(0);
    start();
    (void)co_tpdo_send(&bus.node, 1);
    bus_give(&bus, 0, "80 05");
    start();
    sync(2);
    TEST_ASSERT_EQUAL_UINT(0, sent(0x185));
    (void)co_tpdo_send(&bus.node, 1);
    sync(1);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
}

static void test_all_pdos_may_be_synchronous_and_go_in_the_order_of_their_numbers(void)
{
    static const uint16_t ids[] = {0x185, 0x285, 0x385, 0x485, 0x685, 0x6A5};
    bus_telemetry_on(&bus);
    bus_sdo(&bus, "23 05 18 01 A5 06 00 40", "60 05 18 01 00 00 00 00");
    for (unsigned i = 0; i < OD_TPDOS; i++) {
        char request[32], answer[32];
        (void)snprintf(request, sizeof request, "2F %02X 18 02 01 00 00 00", i);
        (void)snprintf(answer, sizeof answer, "60 %02X 18 02 00 00 00 00", i);
        bus_sdo(&bus, request, answer);
    }
    bus_sdo(&bus, "2F 02 14 02 00 00 00 00", "60 02 14 02 00 00 00 00");
    start();
    bus_give(&bus, 0x405, "01 00 00 00 02 00 00 00");
    sync(1);
    TEST_ASSERT_EQUAL_UINT(OD_TPDOS, bus.count);
    for (unsigned i = 0; i < OD_TPDOS; i++) {
        TEST_ASSERT_EQUAL_HEX16(ids[i], bus.sent[i].id);
    }
    TEST_ASSERT_EQUAL_UINT(1, bus.rpdos[3]);
    bus_give(&bus, 0x405, "01 00 00 00 02 00 00 00");
    bus_give(&bus, 0, "80 05");
    start();
    sync(1);
    TEST_ASSERT_EQUAL_UINT(1, bus.rpdos[3]); /* the RPDO that waited for SYNC is discarded */
}

/* ---- inhibit time ---- */

static void inhibit_tpdo1_for_3_ms(void)
{
    bus_sdo(&bus, "23 00 18 01 85 01 00 C0", "60 00 18 01 00 00 00 00");
    bus_sdo(&bus, "2B 00 18 03 15 00 00 00", "60 00 18 03 00 00 00 00"); /* 2.1 ms */
    bus_sdo(&bus, "23 00 18 01 85 01 00 40", "60 00 18 01 00 00 00 00");
}

static void test_event_within_the_inhibit_time_is_sent_once_after_it_with_the_values_of_that_moment(void)
{
    inhibit_tpdo1_for_3_ms();
    start();
    bus_run_ms(&bus, 1); /* the timer's */
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
    bus_run_ms(&bus, 3);
    TEST_ASSERT_TRUE(co_tpdo_send(&bus.node, 1));
    bus_clear(&bus);
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 1));
    TEST_ASSERT_FALSE(co_tpdo_send(&bus.node, 1));
    bus_run_ms(&bus, 3); /* the first tick may have come at once */
    bus.od.stream.free = 7;
    TEST_ASSERT_EQUAL_UINT(0, sent(0x185));
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
    bus_run_ms(&bus, 9);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
}

static void test_inhibit_time_does_not_delay_the_timer_of_the_same_length(void)
{
    inhibit_tpdo1_for_3_ms();
    bus_sdo(&bus, "2B 00 18 05 03 00 00 00", "60 00 18 05 00 00 00 00");
    start();
    bus_run_ms(&bus, 30);
    TEST_ASSERT_EQUAL_UINT(10, sent(0x185));
}

static void test_inhibit_time_ends_with_operational(void)
{
    bus_sdo(&bus, "23 00 18 01 85 01 00 C0", "60 00 18 01 00 00 00 00");
    bus_sdo(&bus, "2B 00 18 03 10 27 00 00", "60 00 18 03 00 00 00 00"); /* 1 s */
    bus_sdo(&bus, "23 00 18 01 85 01 00 40", "60 00 18 01 00 00 00 00");
    start();
    bus_run_ms(&bus, 100);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
    bus_give(&bus, 0, "80 05");
    start();
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
}

static void test_inhibit_time_changes_only_while_the_pdo_is_not_in_use(void)
{
    bus_sdo(&bus, "2B 00 18 03 15 00 00 00", "80 00 18 03 22 00 00 08");
}

/* ---- RPDO ---- */

static void test_synchronous_rpdo_takes_effect_at_the_next_sync_alone_and_the_latest_counts(void)
{
    bus_sdo(&bus, "2F 00 14 02 F0 00 00 00", "60 00 14 02 00 00 00 00");
    start();
    bus_give(&bus, 0x205, "06 00 06 00");
    bus_give(&bus, 0x205, "0F 00 1F 00");
    bus_run_ms(&bus, 5);
    TEST_ASSERT_EQUAL_UINT(0, bus.rpdos[1]);
    TEST_ASSERT_EQUAL_HEX16(0, bus.od.axis[AXIS_X].controlword);
    sync(2);
    TEST_ASSERT_EQUAL_UINT(1, bus.rpdos[1]);
    TEST_ASSERT_EQUAL_HEX16(0x0F, bus.od.axis[AXIS_X].controlword);
    TEST_ASSERT_EQUAL_HEX16(0x1F, bus.od.axis[AXIS_Y].controlword);
}

static void test_rpdo_that_waits_is_forgotten_when_operational_ends(void)
{
    bus_sdo(&bus, "2F 00 14 02 01 00 00 00", "60 00 14 02 00 00 00 00");
    start();
    bus_give(&bus, 0x205, "06 00 06 00");
    bus_give(&bus, 0, "80 05");
    start();
    sync(1);
    TEST_ASSERT_EQUAL_UINT(0, bus.rpdos[1]);
}

/* ---- the SYNC itself ---- */

static void test_sync_does_nothing_outside_operational(void)
{
    tpdo1_type(1);
    sync(2);
    bus_give(&bus, 0, "02 05");
    bus_clear(&bus);
    sync(2);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

static void test_sync_on_another_identifier(void)
{
    tpdo1_type(1);
    bus_sdo(&bus, "23 05 10 00 20 01 00 00", "80 05 10 00 30 00 09 06"); /* restricted: 101h..180h */
    bus_sdo(&bus, "23 05 10 00 90 00 00 40", "80 05 10 00 30 00 09 06"); /* to be its producer */
    bus_sdo(&bus, "23 05 10 00 90 00 00 20", "80 05 10 00 30 00 09 06"); /* 29 bits */
    bus_sdo(&bus, "23 05 10 00 90 00 00 80", "60 05 10 00 00 00 00 00");
    start();
    sync(1);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_give(&bus, 0x90, "");
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
}

static void test_sync_of_a_wrong_length_is_ignored_and_reported_once(void)
{
    tpdo1_type(1);
    start();
    bus_give(&bus, 0x80, "01");
    bus_give(&bus, 0x80, "02");
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x085, "40 82 11 01 00 00 00 00");
    sync(1);
    TEST_ASSERT_EQUAL_UINT(3, bus.count);
    bus_expect(&bus, 1, 0x085, "00 00 00 00 00 00 00 00");
    TEST_ASSERT_EQUAL_HEX16(0x185, bus.sent[2].id);
}

static void test_counting_begins_with_the_sync_that_carries_the_start_value(void)
{
    bus_sdo(&bus, "23 06 10 00 E8 03 00 00", "60 06 10 00 00 00 00 00");
    bus_sdo(&bus, "2F 19 10 00 0A 00 00 00", "80 19 10 00 22 00 00 08"); /* 1006h is not 0 */
    bus_sdo(&bus, "23 06 10 00 00 00 00 00", "60 06 10 00 00 00 00 00"); /* as at power-on */
    bus_sdo(&bus, "2F 19 10 00 01 00 00 00", "80 19 10 00 30 00 09 06");
    bus_sdo(&bus, "2F 19 10 00 0A 00 00 00", "60 19 10 00 00 00 00 00");
    bus_sdo(&bus, "2F 00 18 06 03 00 00 00", "80 00 18 06 22 00 00 08"); /* in use */
    bus_sdo(&bus, "23 00 18 01 85 01 00 C0", "60 00 18 01 00 00 00 00");
    bus_sdo(&bus, "2F 00 18 06 03 00 00 00", "60 00 18 06 00 00 00 00");
    bus_sdo(&bus, "23 00 18 01 85 01 00 40", "60 00 18 01 00 00 00 00");
    tpdo1_type(2);
    start();
    bus_give(&bus, 0x80, "01");
    bus_give(&bus, 0x80, "02");
    bus_give(&bus, 0x80, "03"); /* the first */
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_give(&bus, 0x80, "04");
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_give(&bus, 0x80, "05");
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_give(&bus, 0x80, "06");
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
}

static void test_counter_without_start_value_counts_from_the_first_sync(void)
{
    bus_sdo(&bus, "23 06 10 00 00 00 00 00", "60 06 10 00 00 00 00 00");
    bus_sdo(&bus, "2F 19 10 00 0A 00 00 00", "60 19 10 00 00 00 00 00");
    tpdo1_type(2);
    start();
    bus_give(&bus, 0x80, "07");
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_give(&bus, 0x80, "08");
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
}

static void test_start_value_without_a_counter_in_the_sync_is_without_effect(void)
{
    bus_sdo(&bus, "23 00 18 01 85 01 00 C0", "60 00 18 01 00 00 00 00");
    bus_sdo(&bus, "2F 00 18 06 03 00 00 00", "60 00 18 06 00 00 00 00");
    bus_sdo(&bus, "23 00 18 01 85 01 00 40", "60 00 18 01 00 00 00 00");
    tpdo1_type(2);
    start();
    sync(1);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    sync(1);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
}

static void test_synchronous_tpdo_that_is_not_in_use_is_not_sent(void)
{
    tpdo1_type(1);
    bus_sdo(&bus, "23 00 18 01 85 01 00 C0", "60 00 18 01 00 00 00 00");
    start();
    sync(3);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

static void test_tpdos_of_a_sync_say_what_was_before_the_rpdos_it_releases(void)
{
    tpdo1_type(1);
    bus_sdo(&bus, "23 00 18 01 85 01 00 C0", "60 00 18 01 00 00 00 00");
    bus_sdo(&bus, "2F 00 1A 00 00 00 00 00", "60 00 1A 00 00 00 00 00");
    bus_sdo(&bus, "23 00 1A 01 10 00 40 60", "60 00 1A 01 00 00 00 00"); /* 6040h, which is rw */
    bus_sdo(&bus, "2F 00 1A 00 01 00 00 00", "60 00 1A 00 00 00 00 00");
    bus_sdo(&bus, "23 00 18 01 85 01 00 40", "60 00 18 01 00 00 00 00");
    bus_sdo(&bus, "2F 00 14 02 00 00 00 00", "60 00 14 02 00 00 00 00");
    start();
    bus_give(&bus, 0x205, "06 00 06 00");
    sync(2);
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
    bus_expect(&bus, 0, 0x185, "00 00");
    bus_expect(&bus, 1, 0x185, "06 00");
}

static void test_reset_communication_makes_all_event_driven_again(void)
{
    tpdo1_type(1);
    bus_give(&bus, 0, "82 05");
    start();
    sync(2);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, sent(0x185));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_type_1_answers_every_sync_with_the_values_of_that_moment_and_nothing_else_sends_it);
    RUN_TEST(test_type_n_sends_at_every_nth_sync);
    RUN_TEST(test_type_0_sends_at_the_sync_after_an_event);
    RUN_TEST(test_event_driven_tpdos_take_no_notice_of_sync);
    RUN_TEST(test_types_that_are_reserved_or_remote_are_refused);
    RUN_TEST(test_synchronous_tpdo_that_found_no_room_comes_at_the_next_sync);
    RUN_TEST(test_counting_starts_anew_with_operational);
    RUN_TEST(test_event_before_operational_ended_is_not_sent_in_the_next);
    RUN_TEST(test_all_pdos_may_be_synchronous_and_go_in_the_order_of_their_numbers);
    RUN_TEST(test_event_within_the_inhibit_time_is_sent_once_after_it_with_the_values_of_that_moment);
    RUN_TEST(test_inhibit_time_does_not_delay_the_timer_of_the_same_length);
    RUN_TEST(test_inhibit_time_ends_with_operational);
    RUN_TEST(test_inhibit_time_changes_only_while_the_pdo_is_not_in_use);
    RUN_TEST(test_synchronous_rpdo_takes_effect_at_the_next_sync_alone_and_the_latest_counts);
    RUN_TEST(test_rpdo_that_waits_is_forgotten_when_operational_ends);
    RUN_TEST(test_sync_does_nothing_outside_operational);
    RUN_TEST(test_sync_on_another_identifier);
    RUN_TEST(test_sync_of_a_wrong_length_is_ignored_and_reported_once);
    RUN_TEST(test_counting_begins_with_the_sync_that_carries_the_start_value);
    RUN_TEST(test_counter_without_start_value_counts_from_the_first_sync);
    RUN_TEST(test_start_value_without_a_counter_in_the_sync_is_without_effect);
    RUN_TEST(test_synchronous_tpdo_that_is_not_in_use_is_not_sent);
    RUN_TEST(test_tpdos_of_a_sync_say_what_was_before_the_rpdos_it_releases);
    RUN_TEST(test_reset_communication_makes_all_event_driven_again);
    return UNITY_END();
}
