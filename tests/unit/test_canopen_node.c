/* SPDX-License-Identifier: Apache-2.0 */
/* NMT, heartbeats and the queue of frames, byte by byte as in CiA 301. */
#include "test_canopen_bus.h"

static struct bus bus;

void setUp(void)
{
    bus_start(&bus);
}

void tearDown(void)
{
}

/* ---- NMT ---- */

static void test_power_on_sends_the_boot_up_message_and_enters_pre_operational(void)
{
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x705, "00");
    TEST_ASSERT_EQUAL(CO_PRE_OPERATIONAL, co_nmt_state(&bus.node));
    TEST_ASSERT_EQUAL(CO_PRE_OPERATIONAL, bus.state);
    TEST_ASSERT_EQUAL_UINT(0, bus.resets);
}

static void test_nmt_commands_lead_to_their_states(void)
{
    bus_give(&bus, 0, "01 05");
    TEST_ASSERT_EQUAL(CO_OPERATIONAL, co_nmt_state(&bus.node));
    bus_give(&bus, 0, "02 05");
    TEST_ASSERT_EQUAL(CO_STOPPED, co_nmt_state(&bus.node));
    bus_give(&bus, 0, "80 05");
    TEST_ASSERT_EQUAL(CO_PRE_OPERATIONAL, co_nmt_state(&bus.node));
    TEST_ASSERT_EQUAL_UINT(4, bus.nmt_changes); /* boot, start, stop, pre-operational */
}

static void test_nmt_command_to_node_0_is_for_everybody(void)
{
    bus_give(&bus, 0, "01 00");
    TEST_ASSERT_EQUAL(CO_OPERATIONAL, bus.state);
}

static void test_nmt_command_to_another_node_unknown_or_malformed_is_ignored(void)
{
    bus_give(&bus, 0, "01 06");
    bus_give(&bus, 0, "07 05");
    bus_give(&bus, 0, "01");
    bus_give(&bus, 0, "01 05 00");
    TEST_ASSERT_EQUAL(CO_PRE_OPERATIONAL, co_nmt_state(&bus.node));
    TEST_ASSERT_EQUAL_UINT(1, bus.nmt_changes);
}

static void test_repeated_start_changes_nothing(void)
{
    bus_give(&bus, 0, "01 05");
    bus_give(&bus, 0, "01 05");
    TEST_ASSERT_EQUAL_UINT(2, bus.nmt_changes);
}

static void test_reset_communication_restores_communication_objects_alone(void)
{
    bus.od.heartbeat_producer = 7;
    bus.od.tpdo1.cob_id = 0x80000185;
    bus.od.smc.lambda = 123456;
    bus.od.device_name = "other";
    bus_give(&bus, 0, "01 05");
    bus_clear(&bus);
    bus_give(&bus, 0, "82 05");
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x705, "00");
    TEST_ASSERT_EQUAL_UINT(1, bus.resets);
    TEST_ASSERT_TRUE(bus.reset_communication_only);
    TEST_ASSERT_EQUAL(CO_PRE_OPERATIONAL, bus.state);
    TEST_ASSERT_EQUAL_UINT(100, bus.od.heartbeat_producer);
    TEST_ASSERT_EQUAL_HEX32(0x40000185, bus.od.tpdo1.cob_id);
    TEST_ASSERT_EQUAL_UINT(123456, bus.od.smc.lambda);
    TEST_ASSERT_EQUAL_STRING("other", bus.od.device_name);
}

static void test_every_reset_is_reported_to_the_application_also_from_pre_operational(void)
{
    bus_give(&bus, 0, "82 05");
    bus_give(&bus, 0, "81 05");
    TEST_ASSERT_EQUAL_UINT(2, bus.resets);
    TEST_ASSERT_EQUAL_UINT(3, bus.nmt_changes);
}

static void test_reset_node_restores_all_that_can_be_written(void)
{
    bus.od.heartbeat_producer = 7;
    bus.od.smc.lambda = 123456;
    bus.od.axis[AXIS_Y].plant.mass = 1000;
    bus.od.clock.tick = 99;
    co_emcy_set(&bus.node, 0x5000, 0, 0);
    bus_give(&bus, 0, "81 00");
    TEST_ASSERT_EQUAL_UINT(1, bus.resets);
    TEST_ASSERT_FALSE(bus.reset_communication_only);
    TEST_ASSERT_EQUAL_UINT(100, bus.od.heartbeat_producer);
    TEST_ASSERT_EQUAL_UINT(od_defaults.smc.lambda, bus.od.smc.lambda);
    TEST_ASSERT_EQUAL_UINT(97900, bus.od.axis[AXIS_Y].plant.mass);
    TEST_ASSERT_EQUAL_UINT(99, bus.od.clock.tick);
    TEST_ASSERT_EQUAL_HEX8(0, bus.od.error_register);
}

static void test_reset_ends_an_sdo_transfer(void)
{
    bus_sdo(&bus, "40 08 10 00 00 00 00 00", "41 08 10 00 06 00 00 00");
    bus_give(&bus, 0, "82 05");
    bus_sdo(&bus, "60 00 00 00 00 00 00 00", "80 00 00 00 01 00 04 05");
}

static void test_stopped_node_answers_no_sdo(void)
{
    bus_give(&bus, 0, "02 05");
    bus_clear(&bus);
    bus_give(&bus, 0x605, "40 00 10 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

static void test_remote_frames_are_ignored(void)
{
    const struct can_frame upload = {.id = 0x605, .len = 8, .rtr = true, .data = {0x40, 0x00, 0x10}};
    bus_clear(&bus);
    co_receive(&bus.node, &upload);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

static void test_node_works_without_any_hook(void)
{
    struct co_node node;
    const struct co_config config = {.od = &bus.od, .hal = &bus.hal, .node_id = NODE, .hooks = {.ctx = NULL}};
    co_init(&node, &config);
    const struct can_frame frames[] = {
        {.id = 0x605, .len = 8, .data = {0x2B, 0x17, 0x10, 0, 0x0A}},
        {.id = 0x605, .len = 8, .data = {0x40, 0x17, 0x10}},
        {.id = 0x605, .len = 8, .data = {0x23, 0x16, 0x10, 1, 1, 0, 0x7F}},
        {.id = 0x77F, .len = 1, .data = {5}},
        {.id = 0, .len = 2, .data = {1, 5}},
        {.id = 0x205, .len = 4},
    };
    for (unsigned i = 0; i < sizeof frames / sizeof frames[0]; i++) {
        co_receive(&node, &frames[i]);
    }
    for (unsigned i = 0; i < 5; i++) {
        co_tick_ms(&node);
    }
    const struct can_frame reset = {.id = 0, .len = 2, .data = {129, 5}};
    co_receive(&node, &reset);
    TEST_ASSERT_EQUAL(CO_PRE_OPERATIONAL, co_nmt_state(&node));
}

/* ---- heartbeats ---- */

static void test_heartbeat_comes_every_100_ms_with_the_state(void)
{
    bus_clear(&bus);
    bus_run_ms(&bus, 99);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_run_ms(&bus, 1);
    bus_expect(&bus, 0, 0x705, "7F");
    bus_give(&bus, 0, "02 05");
    bus_run_ms(&bus, 100);
    TEST_ASSERT_EQUAL_UINT(2, bus.count);
    bus_expect(&bus, 1, 0x705, "04");
}

static void test_heartbeat_period_can_be_changed_and_switched_off(void)
{
    bus_sdo(&bus, "2B 17 10 00 0A 00 00 00", "60 17 10 00 00 00 00 00");
    bus_clear(&bus);
    bus_run_ms(&bus, 30);
    TEST_ASSERT_EQUAL_UINT(3, bus.count);
    bus_sdo(&bus, "2B 17 10 00 00 00 00 00", "60 17 10 00 00 00 00 00");
    bus_clear(&bus);
    bus_run_ms(&bus, 1000);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

static void test_new_heartbeat_period_begins_when_it_is_written(void)
{
    bus_run_ms(&bus, 60);
    bus_sdo(&bus, "2B 17 10 00 32 00 00 00", "60 17 10 00 00 00 00 00"); /* 50 ms */
    bus_clear(&bus);
    bus_run_ms(&bus, 49);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
}

static void consume_node_127_for_50_ms(void)
{
    bus_sdo(&bus, "23 16 10 01 32 00 7F 00", "60 16 10 01 00 00 00 00");
}

static void test_heartbeat_is_not_missed_before_the_first_one(void)
{
    consume_node_127_for_50_ms();
    bus_run_ms(&bus, 1000);
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
}

static void test_lost_heartbeat_is_reported_once_and_never_early(void)
{
    consume_node_127_for_50_ms();
    bus_give(&bus, 0x77F, "05");
    bus_run_ms(&bus, 50); /* the first tick may come right after the frame */
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
    bus_run_ms(&bus, 1000);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
}

static void test_shortest_consumer_time_is_a_millisecond(void)
{
    bus_sdo(&bus, "23 16 10 01 01 00 7F 00", "60 16 10 01 00 00 00 00");
    bus_give(&bus, 0x77F, "05");
    bus_run_ms(&bus, 1); /* this tick may have come at once */
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
}

static void test_regular_heartbeats_are_not_lost_and_the_watch_starts_anew_after_a_loss(void)
{
    consume_node_127_for_50_ms();
    for (unsigned i = 0; i < 10; i++) {
        bus_give(&bus, 0x77F, "05");
        bus_run_ms(&bus, 49);
    }
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
    bus_run_ms(&bus, 10);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
    bus_give(&bus, 0x77F, "05");
    bus_run_ms(&bus, 60);
    TEST_ASSERT_EQUAL_UINT(2, bus.lost);
}

static void test_heartbeat_of_another_node_does_not_count(void)
{
    consume_node_127_for_50_ms();
    bus_give(&bus, 0x77F, "05");
    bus_run_ms(&bus, 40);
    bus_give(&bus, 0x77E, "05");
    bus_run_ms(&bus, 40);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
}

static void test_consumer_switched_off_forgets_the_heartbeat(void)
{
    consume_node_127_for_50_ms();
    bus_give(&bus, 0x77F, "05");
    bus_sdo(&bus, "23 16 10 01 00 00 00 00", "60 16 10 01 00 00 00 00");
    bus_run_ms(&bus, 1000);
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
}

static void test_consumer_with_time_0_watches_nothing(void)
{
    bus_sdo(&bus, "23 16 10 01 00 00 7F 00", "60 16 10 01 00 00 00 00");
    bus_give(&bus, 0x77F, "05");
    bus_run_ms(&bus, 1000);
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
}

static void test_reset_communication_ends_the_watch(void)
{
    consume_node_127_for_50_ms();
    bus_give(&bus, 0x77F, "05");
    bus_give(&bus, 0, "82 05");
    bus_run_ms(&bus, 1000);
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
}

static void test_boot_up_message_and_frames_of_a_wrong_length_are_no_heartbeats(void)
{
    consume_node_127_for_50_ms();
    bus_give(&bus, 0x77F, "00");
    bus_give(&bus, 0x77F, "");
    bus_give(&bus, 0x77F, "05 00");
    bus_run_ms(&bus, 1000);
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
}

/* 1029h:1, from operational and from pre-operational */
static enum co_state state_after_loss(uint8_t behaviour, const char *nmt)
{
    setUp();
    bus.od.error_behaviour.communication = behaviour;
    consume_node_127_for_50_ms();
    bus_give(&bus, 0, nmt);
    bus_give(&bus, 0x77F, "05");
    bus_run_ms(&bus, 51);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
    TEST_ASSERT_EQUAL(bus.state, co_nmt_state(&bus.node));
    return bus.state;
}

static void test_lost_heartbeat_leads_to_the_nmt_state_of_the_error_behaviour(void)
{
    TEST_ASSERT_EQUAL_UINT8(1, od_defaults.error_behaviour.communication);
    TEST_ASSERT_EQUAL(CO_PRE_OPERATIONAL, state_after_loss(0, "01 05"));
    TEST_ASSERT_EQUAL(CO_STOPPED, state_after_loss(0, "02 05"));
    TEST_ASSERT_EQUAL(CO_OPERATIONAL, state_after_loss(1, "01 05"));
    TEST_ASSERT_EQUAL(CO_STOPPED, state_after_loss(2, "01 05"));
    TEST_ASSERT_EQUAL(CO_STOPPED, state_after_loss(2, "80 05"));
}

/* ---- co_watch_heartbeat ---- */

static void test_heartbeat_is_watched_before_its_first_one_and_in_place_of_1016h(void)
{
    consume_node_127_for_50_ms();
    co_watch_heartbeat(&bus.node, 9);
    bus_run_ms(&bus, CO_HEARTBEAT_WATCH_MS);
    bus_give(&bus, 0x709, "05");
    bus_give(&bus, 0x77F, "05"); /* no longer watched */
    bus_run_ms(&bus, CO_HEARTBEAT_WATCH_MS);
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
}

static void test_watched_heartbeat_of_the_node_of_1016h_has_its_time(void)
{
    bus_sdo(&bus, "23 16 10 01 01 00 7F 00", "60 16 10 01 00 00 00 00"); /* 1 ms */
    co_watch_heartbeat(&bus.node, 127);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
    bus_sdo(&bus, "23 16 10 01 00 00 7F 00", "60 16 10 01 00 00 00 00"); /* 0 ms: no time is set */
    co_watch_heartbeat(&bus.node, 127);
    bus_run_ms(&bus, CO_HEARTBEAT_WATCH_MS);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(2, bus.lost);
}

static void test_end_of_the_watch_leaves_1016h_from_its_next_heartbeat_on(void)
{
    consume_node_127_for_50_ms();
    co_watch_heartbeat(&bus.node, 9);
    co_watch_heartbeat(&bus.node, 0);
    bus_run_ms(&bus, 2 * CO_HEARTBEAT_WATCH_MS);
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
    bus_give(&bus, 0x709, "05");
    bus_run_ms(&bus, 2 * CO_HEARTBEAT_WATCH_MS);
    TEST_ASSERT_EQUAL_UINT(0, bus.lost);
    bus_give(&bus, 0x77F, "05");
    bus_run_ms(&bus, 51);
    TEST_ASSERT_EQUAL_UINT(1, bus.lost);
}

/* ---- a full bus ---- */

static void test_emcy_and_answers_wait_in_order_until_the_bus_has_room(void)
{
    bus_clear(&bus);
    bus.room = 0;
    co_emcy_set(&bus.node, 0x8130, CO_REG_COMMUNICATION, 0);
    bus_give(&bus, 0x605, "40 01 10 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus.room = 1;
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x085, "30 81 11 00 00 00 00 00");
    bus.room = 9;
    co_emcy_reset(&bus.node, 0x8130);
    TEST_ASSERT_EQUAL_UINT(3, bus.count);
    bus_expect(&bus, 1, 0x585, "4F 01 10 00 11 00 00 00");
    bus_expect(&bus, 2, 0x085, "00 00 00 00 00 00 00 00");
}

static void test_frames_that_wait_keep_their_order_when_room_comes_for_some(void)
{
    static const char *const requests[] = {"40 00 10 00 00 00 00 00", "40 01 10 00 00 00 00 00",
                                           "40 17 10 00 00 00 00 00", "40 19 10 00 00 00 00 00",
                                           "40 16 10 01 00 00 00 00"};
    bus_clear(&bus);
    bus.room = 0;
    for (unsigned i = 0; i < 5; i++) {
        bus_give(&bus, 0x605, requests[i]);
    }
    for (unsigned i = 0; i < 3; i++) {
        bus.room = 2;
        bus_run_ms(&bus, 1);
    }
    TEST_ASSERT_EQUAL_UINT(5, bus.count);
    for (unsigned i = 0; i < 5; i++) {
        const uint16_t index = (uint16_t)(bus.sent[i].data[1] | bus.sent[i].data[2] << 8);
        static const uint16_t expected[] = {0x1000, 0x1001, 0x1017, 0x1019, 0x1016};
        TEST_ASSERT_EQUAL_HEX16(expected[i], index);
    }
}

static void test_frames_beyond_the_queue_are_dropped_and_the_oldest_sent(void)
{
    bus_clear(&bus);
    bus.room = 0;
    for (unsigned i = 1; i <= CO_TX_FRAMES + 3; i++) {
        bus_give(&bus, 0x605, i == 1 ? "40 01 10 00 00 00 00 00" : "40 17 10 00 00 00 00 00");
    }
    bus.room = SENT_MAX;
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(CO_TX_FRAMES, bus.count);
    bus_expect(&bus, 0, 0x585, "4F 01 10 00 00 00 00 00");
    bus_expect(&bus, CO_TX_FRAMES - 1, 0x585, "4B 17 10 00 64 00 00 00");
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_power_on_sends_the_boot_up_message_and_enters_pre_operational);
    RUN_TEST(test_nmt_commands_lead_to_their_states);
    RUN_TEST(test_nmt_command_to_node_0_is_for_everybody);
    RUN_TEST(test_nmt_command_to_another_node_unknown_or_malformed_is_ignored);
    RUN_TEST(test_repeated_start_changes_nothing);
    RUN_TEST(test_reset_communication_restores_communication_objects_alone);
    RUN_TEST(test_every_reset_is_reported_to_the_application_also_from_pre_operational);
    RUN_TEST(test_reset_node_restores_all_that_can_be_written);
    RUN_TEST(test_reset_ends_an_sdo_transfer);
    RUN_TEST(test_stopped_node_answers_no_sdo);
    RUN_TEST(test_remote_frames_are_ignored);
    RUN_TEST(test_node_works_without_any_hook);
    RUN_TEST(test_heartbeat_comes_every_100_ms_with_the_state);
    RUN_TEST(test_heartbeat_period_can_be_changed_and_switched_off);
    RUN_TEST(test_new_heartbeat_period_begins_when_it_is_written);
    RUN_TEST(test_heartbeat_is_not_missed_before_the_first_one);
    RUN_TEST(test_lost_heartbeat_is_reported_once_and_never_early);
    RUN_TEST(test_shortest_consumer_time_is_a_millisecond);
    RUN_TEST(test_regular_heartbeats_are_not_lost_and_the_watch_starts_anew_after_a_loss);
    RUN_TEST(test_heartbeat_of_another_node_does_not_count);
    RUN_TEST(test_consumer_switched_off_forgets_the_heartbeat);
    RUN_TEST(test_consumer_with_time_0_watches_nothing);
    RUN_TEST(test_reset_communication_ends_the_watch);
    RUN_TEST(test_boot_up_message_and_frames_of_a_wrong_length_are_no_heartbeats);
    RUN_TEST(test_lost_heartbeat_leads_to_the_nmt_state_of_the_error_behaviour);
    RUN_TEST(test_heartbeat_is_watched_before_its_first_one_and_in_place_of_1016h);
    RUN_TEST(test_watched_heartbeat_of_the_node_of_1016h_has_its_time);
    RUN_TEST(test_end_of_the_watch_leaves_1016h_from_its_next_heartbeat_on);
    RUN_TEST(test_emcy_and_answers_wait_in_order_until_the_bus_has_room);
    RUN_TEST(test_frames_that_wait_keep_their_order_when_room_comes_for_some);
    RUN_TEST(test_frames_beyond_the_queue_are_dropped_and_the_oldest_sent);
    return UNITY_END();
}
