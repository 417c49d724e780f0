/* SPDX-License-Identifier: Apache-2.0 */
/* Other ways than a heartbeat by which a node sees that its master is there: node guarding (CiA 301, 7.2.8.2.2.1) and the
 * event timers of RPDOs (7.5.2.35). */
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

static void guard(uint16_t id)
{
    const struct can_frame request = {.id = id, .len = 1, .rtr = true};
    bus_clear(&bus);
    co_receive(&bus.node, &request);
}

static void expect_answer(const char *state)
{
    guard(0x705);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x705, state);
}

static void set_life_time(const char *ms, const char *factor)
{
    char request[24];
    snprintf(request, sizeof request, "2B 0C 10 00 %s 00 00", ms);
    bus_sdo(&bus, request, "60 0C 10 00 00 00 00 00");
    snprintf(request, sizeof request, "2F 0D 10 00 %s 00 00 00", factor);
    bus_sdo(&bus, request, "60 0D 10 00 00 00 00 00");
}

static void test_node_guarding_is_answered_with_the_state_and_a_bit_that_toggles(void)
{
    expect_answer("7F");
    expect_answer("FF");
    bus_give(&bus, 0, "01 05");
    expect_answer("05");
    expect_answer("85");
    bus_give(&bus, 0, "02 05");
    expect_answer("04");
    bus_give(&bus, 0, "82 05");
    expect_answer("7F"); /* it begins again with 0 */
    bus_run_ms(&bus, 10000);
    TEST_ASSERT_EQUAL_UINT(0, bus.lost); /* nobody asked for a life time */
}

static void test_remote_frames_of_others_are_ignored(void)
{
    static const uint16_t ids[] = {0x704, 0x700, 0x605, 0x185, 0x000, 0x7E5};
    for (unsigned i = 0; i < sizeof ids / sizeof ids[0]; i++) {
        guard(ids[i]);
        TEST_ASSERT_EQUAL_UINT(0, bus.count);
    }
}

static void test_node_without_id_answers_no_guarding(void)
{
    bus.node.config.node_id = OD_UNCONFIGURED;
    co_nmt_reset(&bus.node.nmt, OD_UNCONFIGURED);
    guard(0x700 + OD_UNCONFIGURED);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

static void test_master_that_ceases_to_guard_is_lost_once_its_life_time_is_over(void)
{
    set_life_time("0A 00", "03");
    bus_run_ms(&bus, 1000);
    TEST_ASSERT_EQUAL_UINT(0, bus.lost); /* it has not asked yet */
    for (unsigned i = 0; i < 5; i++) {
        guard(0x705);
        bus_run_ms(&bus, 30);
        TEST_ASSERT_FALSE(co_master_lost(&bus.node));
    }
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
    TEST_ASSERT_TRUE(co_master_lost(&bus.node));
    TEST_ASSERT_FALSE(co_heartbeat_lost(&bus.node));
    bus_run_ms(&bus, 1000);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
    TEST_ASSERT_TRUE(co_master_lost(&bus.node));
    guard(0x705);
    TEST_ASSERT_FALSE(co_master_lost(&bus.node));
}

static void test_life_time_that_is_written_or_a_reset_ends_the_watch(void)
{
    set_life_time("0A 00", "02");
    guard(0x705);
    bus_run_ms(&bus, 100);
    TEST_ASSERT_TRUE(co_master_lost(&bus.node));
    bus_sdo(&bus, "2F 0D 10 00 03 00 00 00", "60 0D 10 00 00 00 00 00");
    TEST_ASSERT_FALSE(co_master_lost(&bus.node));
    guard(0x705);
    bus_run_ms(&bus, 100);
    TEST_ASSERT_TRUE(co_master_lost(&bus.node));
    bus_sdo(&bus, "2B 0C 10 00 00 00 00 00", "60 0C 10 00 00 00 00 00");
    TEST_ASSERT_FALSE(co_master_lost(&bus.node));
    set_life_time("0A 00", "02");
    guard(0x705);
    bus_give(&bus, 0, "82 05");
    bus_run_ms(&bus, 100);
    TEST_ASSERT_EQUAL_UINT(2, bus.lost);
}

static void test_1029h_acts_when_the_master_ceases_to_guard(void)
{
    bus_sdo(&bus, "2F 29 10 01 00 00 00 00", "60 29 10 01 00 00 00 00");
    set_life_time("0A 00", "01");
    bus_give(&bus, 0, "01 05");
    guard(0x705);
    bus_run_ms(&bus, 11);
    TEST_ASSERT_EQUAL(CO_PRE_OPERATIONAL, bus.state);
}

/* ---- event timers of RPDOs ---- */

static void watch_rpdo(const char *communication, const char *ms)
{
    char request[24], answer[24];
    snprintf(request, sizeof request, "2B %s 05 %s 00 00", communication, ms);
    snprintf(answer, sizeof answer, "60 %s 05 00 00 00 00", communication);
    bus_sdo(&bus, request, answer);
}

static void test_watched_rpdo_is_late_after_its_time_and_told_until_it_comes(void)
{
    watch_rpdo("00 14", "14 00");
    bus_give(&bus, 0, "01 05");
    bus_run_ms(&bus, 100);
    TEST_ASSERT_FALSE(co_rpdo_late(&bus.node)); /* there was none yet */
    for (unsigned i = 0; i < 3; i++) {
        bus_give(&bus, 0x205, "06 00 06 00");
        bus_run_ms(&bus, 20);
        TEST_ASSERT_FALSE(co_rpdo_late(&bus.node));
    }
    bus_clear(&bus);
    bus_give(&bus, 0x205, "06 00 06"); /* does not count */
    bus_give(&bus, 0x305, "00 AA 01 00 00 FF FF FF");
    bus_clear(&bus);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_TRUE(co_rpdo_late(&bus.node));
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
    TEST_ASSERT_TRUE(co_emcy_in_effect(&bus.node.emcy, CO_EMCY_PDO_LATE));
    bus_run_ms(&bus, 1000);
    TEST_ASSERT_TRUE(co_rpdo_late(&bus.node));
    bus_give(&bus, 0x205, "06 00 06 00");
    TEST_ASSERT_FALSE(co_rpdo_late(&bus.node));
    TEST_ASSERT_FALSE(co_emcy_in_effect(&bus.node.emcy, CO_EMCY_PDO_LATE));
}

static void test_each_rpdo_has_its_own_time(void)
{
    watch_rpdo("00 14", "14 00");
    watch_rpdo("01 14", "0A 00");
    bus_give(&bus, 0, "01 05");
    bus_give(&bus, 0x205, "06 00 06 00");
    bus_give(&bus, 0x305, "00 AA 01 00 00 FF FF FF");
    bus_clear(&bus);
    bus_run_ms(&bus, 11);
    TEST_ASSERT_TRUE(co_rpdo_late(&bus.node));
    unsigned i = 0;
    while (i < bus.count && bus.sent[i].id != 0x085) {
        i++;
    }
    bus_expect(&bus, i, 0x085, "50 82 11 02 00 00 00 00");
    bus_run_ms(&bus, 20);
    bus_give(&bus, 0x305, "00 AA 01 00 00 FF FF FF");
    TEST_ASSERT_TRUE(co_emcy_in_effect(&bus.node.emcy, CO_EMCY_PDO_LATE)); /* the other one is late, too */
    bus_give(&bus, 0x205, "06 00 06 00");
    TEST_ASSERT_FALSE(co_emcy_in_effect(&bus.node.emcy, CO_EMCY_PDO_LATE));
}

static void test_rpdos_are_watched_in_operational_only(void)
{
    watch_rpdo("00 14", "14 00");
    bus_give(&bus, 0, "01 05");
    bus_give(&bus, 0x205, "06 00 06 00");
    bus_run_ms(&bus, 21);
    TEST_ASSERT_TRUE(co_rpdo_late(&bus.node));
    bus_give(&bus, 0, "80 05");
    TEST_ASSERT_FALSE(co_rpdo_late(&bus.node));
    bus_give(&bus, 0, "01 05");
    TEST_ASSERT_FALSE(co_emcy_in_effect(&bus.node.emcy, CO_EMCY_PDO_LATE));
    bus_run_ms(&bus, 100);
    TEST_ASSERT_FALSE(co_rpdo_late(&bus.node));
}

static void test_fourth_rpdo_is_there_and_off_until_a_master_wants_it(void)
{
    bus_give(&bus, 0, "01 05");
    bus_give(&bus, 0x505, "01 00 00 00 02 00 00 00");
    TEST_ASSERT_EQUAL_UINT(0, bus.rpdos[4]);
    bus_give(&bus, 0, "80 05");
    bus_sdo(&bus, "23 03 14 01 05 05 00 00", "60 03 14 01 00 00 00 00");
    bus_give(&bus, 0, "01 05");
    bus_give(&bus, 0x505, "01 00 00 00 FE FF FF FF");
    TEST_ASSERT_EQUAL_UINT(1, bus.rpdos[4]);
    TEST_ASSERT_EQUAL_INT32(1, bus.od.axis[AXIS_X].target_velocity);
    TEST_ASSERT_EQUAL_INT32(-2, bus.od.axis[AXIS_Y].target_velocity);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_node_guarding_is_answered_with_the_state_and_a_bit_that_toggles);
    RUN_TEST(test_remote_frames_of_others_are_ignored);
    RUN_TEST(test_node_without_id_answers_no_guarding);
    RUN_TEST(test_master_that_ceases_to_guard_is_lost_once_its_life_time_is_over);
    RUN_TEST(test_life_time_that_is_written_or_a_reset_ends_the_watch);
    RUN_TEST(test_1029h_acts_when_the_master_ceases_to_guard);
    RUN_TEST(test_watched_rpdo_is_late_after_its_time_and_told_until_it_comes);
    RUN_TEST(test_each_rpdo_has_its_own_time);
    RUN_TEST(test_rpdos_are_watched_in_operational_only);
    RUN_TEST(test_fourth_rpdo_is_there_and_off_until_a_master_wants_it);
    return UNITY_END();
}
