/* SPDX-License-Identifier: Apache-2.0 */
/* Faults of the controller, its store and its bus, refusals, and two faults at once (supervision/faults.toml). */
#include <math.h>
#include <string.h>

#include "test_faults.h"

void setUp(void)
{
    power_on();
}

void tearDown(void)
{
}

static void test_memory_that_changes_by_itself_cuts_the_power(void)
{
    const struct drive *d = &rig.device.drive;
    void *const changed[] = {&rig.device.drive.axis[0].state, &rig.device.drive.axis[1].standing,
                             &rig.device.drive.loop.command.controller,
                             &rig.device.drive.loop.cfg[d->configured % 2u].following_max, &rig.device.drive.faults};
    for (unsigned i = 0; i < sizeof changed / sizeof changed[0]; i++) {
        power_on();
        be_on_the_way();
        uint8_t byte;
        memcpy(&byte, changed[i], 1);
        byte ^= 2u;
        memcpy(changed[i], &byte, 1);
        expect_reaction(ROW_MEMORY);
        rig_ms(&rig, 400); /* the axes run out */
        expect_clearing(ROW_MEMORY, 0);
    }
}

static void test_memory_of_a_command_to_the_tick_that_changes_gives_no_power_and_takes_it(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 5);
    atomic_store(&rig.device.drive.loop.command.powered[0], SERVO_LOOP_OFF ^ 0x400u);
    rig_run(&rig, 5);
    expect_no_power();
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    power_on();
    be_on_the_way();
    atomic_fetch_add(&rig.device.drive.loop.command.configured, 1u);
    rig_run(&rig, 1);
    expect_no_power();
    rig_ms(&rig, 1);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
}

static void test_memory_of_a_parameter_that_changes_is_mended_by_a_reset_of_the_node(void)
{
    be_on_the_way();
    const uint32_t before = rig.device.od.tunnel.debounce;
    rig.device.od.tunnel.debounce ^= 0x40u;
    rig_ms(&rig, 30);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x5510));
    expect_no_power();
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_ms(&rig, 30);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2121, 1, 2, 20)); /* another one: it does not pass for all */
    rig_controlwords(&rig, 0, 0);
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_ms(&rig, 30);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    rig_nmt(&rig, 129);
    TEST_ASSERT_EQUAL_UINT32(before, rig_read(&rig, 0x2120, 2));
    rig_ms(&rig, 500);
    rig_enable(&rig);
}

/* The configuration is right, and its checksum is not. It is made anew with the fault, so that the drive can go on. */
static void test_memory_of_a_checksum_that_changes_is_a_fault_that_can_be_reset(void)
{
    be_on_the_way();
    rig.device.drive.integrity.cfg ^= 0x40u;
    expect_reaction(ROW_MEMORY);
    rig_ms(&rig, 400); /* the axes run out */
    expect_clearing(ROW_MEMORY, 0);
}

static void test_clock_that_fails_cuts_the_power(void)
{
    be_on_the_way();
    rig.health.bits = HAL_CLOCK;
    expect_reaction(ROW_CLOCK);
    expect_clearing(ROW_CLOCK, 0); /* who resets it takes notice of it */
}

static void test_restart_by_watchdog_or_crash_is_a_fault_from_power_on(void)
{
    const enum hal_reset causes[] = {HAL_RESET_WATCHDOG, HAL_RESET_CRASH};
    for (unsigned i = 0; i < 2; i++) {
        power_on();
        rig.health = (struct hal_health){.bits = HAL_RESET, .reset = causes[i]};
        rig_nmt(&rig, 1);
        expect_reaction(ROW_RESTART);
        expect_clearing(ROW_RESTART, 0);
        TEST_ASSERT_EQUAL_UINT32(causes[i], rig_read(&rig, 0x2031, 0));
    }
}

static void test_restart_by_a_crash_reports_each_register_of_it(void)
{
    rig.health = (struct hal_health){
        .bits = HAL_RESET,
        .reset = HAL_RESET_CRASH,
        .crash = {.pc = 0x08001111, .lr = 0x08002222, .psr = 0x01000003, .cfsr = 4, .hfsr = 5, .bfar = 6, .count = 7},
        .tick_cycles = 3071,
        .tick_cycles_worst = 3658};
    rig_ms(&rig, 1);
    const uint32_t expected[] = {0x08001111, 0x08002222, 0x01000003, 4, 5, 6, 7};
    for (uint8_t i = 0; i < 7; i++) {
        TEST_ASSERT_EQUAL_HEX32(expected[i], rig_read(&rig, 0x2030, (uint8_t)(i + 1)));
    }
    TEST_ASSERT_EQUAL_UINT32(3071, rig_read(&rig, 0x2162, 1));
    TEST_ASSERT_EQUAL_UINT32(3658, rig_read(&rig, 0x2162, 2));
}

static void test_brown_out_is_a_fault_from_power_on(void)
{
    rig.health = (struct hal_health){.bits = HAL_RESET, .reset = HAL_RESET_BROWN_OUT};
    rig_nmt(&rig, 1);
    expect_reaction(ROW_BROWN_OUT);
    expect_clearing(ROW_BROWN_OUT, 0);
    TEST_ASSERT_EQUAL_UINT32(6, rig_read(&rig, 0x2031, 0));
}

static void test_overrun_of_the_servo_tick_cuts_the_power(void)
{
    be_on_the_way();
    servo_loop_raise(&rig.device.drive.loop, FAULT_OVERRUN); /* as the port does from the tick itself */
    expect_reaction(ROW_OVERRUN);
    expect_clearing(ROW_OVERRUN, 0);
}

static void test_store_that_is_damaged_is_warned_of_until_the_next_save(void)
{
    rig.flash.word[0][0] = 0x12345678;
    device_init(&rig.device, &rig.hal, &rig.ring, 1);
    rig_nmt(&rig, 1);
    expect_reaction(ROW_STORE);
    rig_enable(&rig); /* with defaults */
    TEST_ASSERT_TRUE(rig.out.enable[0] && rig.out.enable[1]);
    rig_controlwords(&rig, 0, 0);
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, 0x65766173));
    expect_clearing(ROW_STORE, 2);
}

static void test_enable_moving_is_refused_until_the_axis_stands(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 3);
    rig.plant.vel_mps[1] = 0.1;
    rig_ms(&rig, 10);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords(&rig, ENABLE, ENABLE);
    expect_reaction(ROW_ENABLE_MOVING);
    while (fabs(rig.plant.vel_mps[1]) > 0.006) {
        rig_run(&rig, 1);
        expect_no_power();
        TEST_ASSERT_NOT_EQUAL(RIG_ENABLED, rig_state(&rig, 0));
    }
    expect_clearing(ROW_ENABLE_MOVING, 20);
    expect_no_power(); /* an old command enables nothing */
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

static void test_enable_moving_is_refused_for_each_axis_and_direction(void)
{
    for (int i = 0; i < 4; i++) {
        power_on();
        rig_nmt(&rig, 1);
        rig_ms(&rig, 3);
        rig.plant.vel_mps[i / 2] = i % 2 == 0 ? 0.1 : -0.1;
        rig_ms(&rig, 10);
        rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
        rig_controlwords(&rig, ENABLE, ENABLE);
        rig_ms(&rig, 1);
        TEST_ASSERT_TRUE(rig_had_emcy(&rig, promises[ROW_ENABLE_MOVING].emcy));
        rig_expect_states(&rig, RIG_READY, RIG_READY);
        expect_no_power();
    }
}

static void test_enable_moving_that_is_requested_no_more_is_no_warning(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 3);
    rig.plant.vel_mps[0] = -0.1;
    rig_ms(&rig, 10);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords(&rig, ENABLE, ENABLE);
    expect_reaction(ROW_ENABLE_MOVING);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    expect_clearing(ROW_ENABLE_MOVING, 3);
    rig_ms(&rig, 500);
    expect_no_power();
}

static void test_second_master_is_refused_and_reported(void)
{
    rig_nmt(&rig, 1);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2140, 2, 4, 5));
    TEST_ASSERT_EQUAL_HEX32(0x08000022, rig_write(&rig, 0x2140, 2, 4, 6));
    expect_reaction(ROW_SECOND_MASTER);
    TEST_ASSERT_EQUAL_UINT32(5, rig_read(&rig, 0x2140, 1));
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2140, 5));
    expect_clearing(ROW_SECOND_MASTER, 1001);
}

static void test_second_master_leaves_a_path_alone_that_nobody_has_claimed(void)
{
    be_on_the_way();
    TEST_ASSERT_EQUAL_HEX32(0x08000022, rig_write(&rig, 0x2140, 2, 4, 5));
    expect_reaction(ROW_SECOND_MASTER);
    expect_path_runs();
    expect_clearing(ROW_SECOND_MASTER, 1001);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

static void test_stale_command_is_refused_and_reported(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 10);
    rig_controlwords_at_once(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords_at_once(&rig, ENABLE, ENABLE);
    expect_reaction(ROW_STALE_COMMAND);
    expect_clearing(ROW_STALE_COMMAND, 1001);
    expect_no_power();
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

static void expect_refused(uint16_t index, uint8_t sub, int64_t value)
{
    uint32_t code;
    const struct od_entry *entry = od_find(index, sub, &code);
    const int64_t before = od_read(&rig.device.od, entry);
    TEST_ASSERT_EQUAL_HEX32(0x08000022, rig_write(&rig, index, sub, od_size(entry), value));
    TEST_ASSERT_EQUAL_INT64(before, od_read(&rig.device.od, entry));
}

static void test_config_enabled_is_refused_and_reported(void)
{
    static const struct {
        uint16_t index;
        uint8_t sub;
        int64_t value;
    } writes[] = {{0x2110, 1, 150000}, {0x1010, 1, 0x65766173}, {0x1011, 1, 0x64616F6C},
                  {0x2001, 1, 4},      {0x1016, 1, 0},          {0x1029, 1, 2}};
    for (unsigned i = 0; i < sizeof writes / sizeof writes[0]; i++) {
        power_on();
        be_on_the_way();
        expect_refused(writes[i].index, writes[i].sub, writes[i].value);
        expect_reaction(ROW_CONFIG_ENABLED);
        expect_clearing(ROW_CONFIG_ENABLED, 1001);
        rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    }
}

static void test_config_enabled_goes_for_every_parameter(void)
{
    unsigned parameters = 0;
    be_on_the_way();
    for (uint16_t i = 0; i < od_table_len; i++) {
        const struct od_entry *entry = &od_table[i];
        if ((entry->flags & OD_CONFIG) != 0 && (entry->flags & OD_LIVE) == 0) {
            const int64_t now = od_read(&rig.device.od, entry);
            const int64_t other = od_check(entry, now - 1) == SDO_OK ? now - 1 : now + 1;
            expect_refused(entry->index, entry->sub, other);
            parameters++;
        }
    }
    TEST_ASSERT_GREATER_THAN_UINT(100, parameters);
}

static void test_can_passive_is_warned_of(void)
{
    be_on_the_way();
    rig.can.state = HAL_CAN_WARNING; /* that is no fault */
    rig_ms(&rig, 5);
    TEST_ASSERT_FALSE(rig_bit(&rig, WARNING));
    rig.can.state = HAL_CAN_PASSIVE;
    expect_reaction(ROW_CAN_PASSIVE);
    rig.can.state = HAL_CAN_ACTIVE;
    expect_clearing(ROW_CAN_PASSIVE, 3);
}

static void test_can_off_is_reported_when_it_is_over_and_the_heartbeat_stops_the_axes(void)
{
    be_on_the_way();
    rig.can = (struct hal_can_status){.state = HAL_CAN_OFF, .bus_offs = 1};
    rig.heartbeat_every_ms = 0; /* nothing comes through */
    rig_ms(&rig, 400);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x8130));
    TEST_ASSERT_FALSE(rig_had_emcy(&rig, 0x8140));
    rig.can.state = HAL_CAN_ACTIVE;
    rig_ms(&rig, 1);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x8140));
    rig_ms(&rig, 3);
    TEST_ASSERT_EQUAL_HEX8(CO_REG_COMMUNICATION | CO_REG_GENERIC, rig_read(&rig, 0x1001, 0)); /* 8130h is latched */
    TEST_ASSERT_FALSE(rig_bit(&rig, WARNING));
}

static void test_can_off_for_a_moment_is_warned_of_until_the_controller_is_active(void)
{
    be_on_the_way();
    rig.can = (struct hal_can_status){.state = HAL_CAN_OFF, .bus_offs = 1};
    rig_ms(&rig, 20);
    rig.can.state = HAL_CAN_PASSIVE;
    expect_reaction(ROW_CAN_OFF);
    rig_ms(&rig, 20);
    rig.can.state = HAL_CAN_ACTIVE;
    expect_clearing(ROW_CAN_OFF, 3);
}

static void test_can_overrun_is_warned_of(void)
{
    be_on_the_way();
    rig.can.rx_lost = 1;
    expect_reaction(ROW_CAN_OVERRUN);
    expect_clearing(ROW_CAN_OVERRUN, 1002);
}

static void test_pdo_short_is_refused_until_a_right_one_comes(void)
{
    be_on_the_way();
    const uint8_t zeros[8] = {0};
    rig_send(&rig, 0x201, 3, zeros); /* would cut the power */
    expect_reaction(ROW_PDO_SHORT);
    rig_controlwords(&rig, RUN, RUN);
    expect_clearing(ROW_PDO_SHORT, 2);
}

static void test_pdo_long_is_refused_until_a_right_one_comes(void)
{
    be_on_the_way();
    const uint8_t zeros[8] = {0};
    rig_send(&rig, 0x201, 5, zeros);
    expect_reaction(ROW_PDO_LONG);
    rig_controlwords(&rig, RUN, RUN);
    expect_clearing(ROW_PDO_LONG, 2);
}

static void test_pdo_value_is_refused_until_right_ones_come(void)
{
    rig_nmt(&rig, 1);
    const uint8_t pre_operational[] = {128, 1}, operational[] = {1, 1};
    rig_send(&rig, 0, 2, pre_operational);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1402, 1, 4, 0x80000401));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1602, 0, 1, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1602, 1, 4, 0x60600008));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1602, 0, 1, 1));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1402, 1, 4, 0x401));
    rig_send(&rig, 0, 2, operational);
    be_on_the_way();
    const uint8_t no_mode[] = {4}, mode[] = {7};
    rig_send(&rig, 0x401, 1, no_mode);
    expect_reaction(ROW_PDO_VALUE);
    rig_send(&rig, 0x401, 1, mode);
    expect_clearing(ROW_PDO_VALUE, 2);
}

static void test_sync_length_is_refused_until_a_right_one_comes(void)
{
    be_on_the_way();
    const uint8_t zeros[8] = {0};
    rig_send(&rig, 0x80, 2, zeros);
    expect_reaction(ROW_SYNC_LENGTH);
    rig_send(&rig, 0x80, 0, zeros);
    expect_clearing(ROW_SYNC_LENGTH, 2);
}

static void guard(void)
{
    const struct can_frame request = {.id = 0x701, .rtr = true};
    co_receive(&rig.device.node, &request);
}

static void test_heartbeat_by_node_guarding_that_ceases_stops_on_the_path(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x100C, 0, 2, 20));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x100D, 0, 1, 2));
    be_on_the_way();
    guard();
    rig_ms(&rig, 40);
    expect_path_runs();
    expect_reaction(ROW_HEARTBEAT);
    guard();
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x100D, 0, 1, 0)); /* nobody guards any more */
    expect_clearing(ROW_HEARTBEAT, 2);
}

static void test_pdo_late_is_told_and_stops_on_the_path_as_a_lost_heartbeat_does(void)
{
    const uint8_t pre_operational[] = {128, 1};
    rig_nmt(&rig, 1);
    rig_send(&rig, 0, 2, pre_operational);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1400, 5, 2, 500));
    rig_nmt(&rig, 1);
    rig_controlwords(&rig, 0, 0);
    rig_ms(&rig, 500);
    TEST_ASSERT_FALSE(rig_had_emcy(&rig, 0x8250));
    expect_reaction(ROW_PDO_LATE);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    rig_controlwords(&rig, 0, 0);
    expect_clearing(ROW_PDO_LATE, 2);
    rig_enable(&rig);
    rig_go(&rig, &stream, 300);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 499);
    expect_path_runs();
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x8250));
    rig.emcy_count = 0;
    expect_reaction(ROW_HEARTBEAT);
}

/* Axis x follows alone, or gets records alone; what y does meanwhile */
static void test_one_axis_in_mode_7_is_told_after_a_second(void)
{
    static const struct {
        uint16_t x, y;
        int8_t mode_y;
        bool told;
    } cases[] = {{RUN, ENABLE, 7, true}, {RUN, 0, 7, true},    {ENABLE, RUN, 7, true},
                 {RUN, RUN, 7, false},   {RUN, RUN, 3, false}, {ENABLE, ENABLE, 7, false}};
    for (unsigned i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        power_on();
        rig_nmt(&rig, 1);
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6860, 0, 1, cases[i].mode_y));
        rig_enable(&rig);
        rig.emcy_count = 0;
        rig_controlwords(&rig, cases[i].x, cases[i].y);
        rig_ms(&rig, 990);
        TEST_ASSERT_FALSE(rig_had_emcy(&rig, 0xFF33));
        rig_ms(&rig, 20);
        TEST_ASSERT_EQUAL(cases[i].told, rig_had_emcy(&rig, 0xFF33));
    }
    power_on();
    rig_nmt(&rig, 1);
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, ENABLE);
    rig_ms(&rig, 1005);
    expect_reaction(ROW_ONE_AXIS);
    rig_controlwords(&rig, RUN, RUN);
    expect_clearing(ROW_ONE_AXIS, 5);
}

static void test_one_axis_has_records_and_the_other_none(void)
{
    const uint8_t record[8] = {0};
    rig_nmt(&rig, 1);
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C1, 1, 4, 1000));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1017, 0, 2, 100)); /* something else */
    rig_ms(&rig, 1005);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF33));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68C1, 1, 4, 0));
    expect_end(ROW_ONE_AXIS, 5);
    rig.device.od.rpdo3_map.highest_sub = 1;
    co_pdo_refresh(&rig.device.node.pdo);
    rig_send(&rig, 0x401, 4, record);
    rig_ms(&rig, 1005);
    TEST_ASSERT_EQUAL_HEX16(0xFF33, rig.emcy[rig.emcy_count - 1]);
    rig.device.od.rpdo3_map.highest_sub = 2;
    co_pdo_refresh(&rig.device.node.pdo);
    rig_send(&rig, 0x401, 8, record);
    expect_end(ROW_ONE_AXIS, 5);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C1, 1, 4, 1000));
    rig_nmt(&rig, 129);
    rig_ms(&rig, 1100);
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[rig.emcy_count - 1]);
}

static void test_queue_full_of_records_is_told_until_the_stream_is_discarded(void)
{
    const uint8_t at_rest[8] = {0};
    rig_nmt(&rig, 1);
    rig_enable(&rig);
    for (unsigned i = 0; i < QUEUE_ROOM; i++) {
        rig_send(&rig, 0x401, 8, at_rest);
    }
    rig_ms(&rig, 5);
    TEST_ASSERT_FALSE(rig_had_emcy(&rig, 0xFF34));
    rig_send(&rig, 0x401, 8, at_rest);
    expect_reaction(ROW_QUEUE_FULL);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C4, 6, 1, 0));
    expect_clearing(ROW_QUEUE_FULL, 5);
}

static void test_flash_worn_is_a_warning_that_stays(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 5);
    rig.device.od.flash_wear.erases = 16000;
    expect_reaction(ROW_FLASH_WORN);
    rig.device.od.flash_wear.erases = 0; /* another board */
    expect_clearing(ROW_FLASH_WORN, 5);
}

static void test_save_refused_is_a_warning_until_the_next_save_is_possible(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 5);
    for (uint32_t i = 0; i < 8; i++) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 1, 4, 100000 + i));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, 0x65766173));
    }
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 1, 4, 123456));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STATE, rig_write(&rig, 0x1010, 1, 4, 0x65766173));
    expect_reaction(ROW_SAVE_REFUSED);
    expect_clearing(ROW_SAVE_REFUSED, 60000);
}

/* ---- several at once ---- */

static void test_of_two_faults_within_a_millisecond_603Fh_and_the_first_emcy_tell_the_first(void)
{
    const struct {
        uint8_t first, second;
        uint16_t emcy;
    } orders[] = {{HAL_ENCODER_FAULT, HAL_AMPLIFIER_FAULT, 0x7305},
                  {HAL_AMPLIFIER_FAULT, HAL_ENCODER_FAULT, 0x5400},
                  {HAL_STOP, HAL_AMPLIFIER_FAULT, 0x9000}};
    for (unsigned i = 0; i < 3; i++) {
        power_on();
        be_on_the_way();
        rig_run(&rig, (10 - rig.device.drive.loop.ticks % 10) % 10);
        rig.inputs[0] = orders[i].first;
        rig_run(&rig, 3);
        rig.inputs[0] = orders[i].second;
        rig_run(&rig, 3);
        TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count); /* the background has seen none of them yet */
        rig_ms(&rig, 1);
        TEST_ASSERT_EQUAL_UINT(2, rig.emcy_count);
        TEST_ASSERT_EQUAL_HEX16(orders[i].emcy, rig.emcy[0]);
        TEST_ASSERT_EQUAL_HEX16(orders[i].emcy, rig_read(&rig, 0x603F, 0));
        TEST_ASSERT_EQUAL_HEX16(orders[i].emcy, rig_read(&rig, 0x683F, 0));
        rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    }
}

static void test_later_fault_cuts_a_stop_on_the_path_short_and_603Fh_keeps_the_first(void)
{
    be_on_the_way();
    rig.inputs[0] = HAL_STOP;
    rig_ms(&rig, 20);
    rig_expect_states(&rig, RIG_REACTION, RIG_REACTION);
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_run(&rig, 1);
    expect_no_power();
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x5400));
    TEST_ASSERT_EQUAL_HEX16(0x9000, rig_read(&rig, 0x603F, 0));
}

static void test_warning_is_reported_again_after_a_reset_of_the_node(void)
{
    rig.flash.word[0][0] = 0x12345678;
    device_init(&rig.device, &rig.hal, &rig.ring, 1);
    rig_ms(&rig, 2);
    rig.emcy_count = 0;
    rig_nmt(&rig, 129);
    rig_nmt(&rig, 1);
    rig_ms(&rig, 1);
    expect_reaction(ROW_STORE);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_memory_that_changes_by_itself_cuts_the_power);
    RUN_TEST(test_memory_of_a_command_to_the_tick_that_changes_gives_no_power_and_takes_it);
    RUN_TEST(test_memory_of_a_parameter_that_changes_is_mended_by_a_reset_of_the_node);
    RUN_TEST(test_memory_of_a_checksum_that_changes_is_a_fault_that_can_be_reset);
    RUN_TEST(test_clock_that_fails_cuts_the_power);
    RUN_TEST(test_restart_by_watchdog_or_crash_is_a_fault_from_power_on);
    RUN_TEST(test_restart_by_a_crash_reports_each_register_of_it);
    RUN_TEST(test_brown_out_is_a_fault_from_power_on);
    RUN_TEST(test_overrun_of_the_servo_tick_cuts_the_power);
    RUN_TEST(test_store_that_is_damaged_is_warned_of_until_the_next_save);
    RUN_TEST(test_enable_moving_is_refused_until_the_axis_stands);
    RUN_TEST(test_enable_moving_is_refused_for_each_axis_and_direction);
    RUN_TEST(test_enable_moving_that_is_requested_no_more_is_no_warning);
    RUN_TEST(test_second_master_is_refused_and_reported);
    RUN_TEST(test_second_master_leaves_a_path_alone_that_nobody_has_claimed);
    RUN_TEST(test_stale_command_is_refused_and_reported);
    RUN_TEST(test_config_enabled_is_refused_and_reported);
    RUN_TEST(test_config_enabled_goes_for_every_parameter);
    RUN_TEST(test_can_passive_is_warned_of);
    RUN_TEST(test_can_off_is_reported_when_it_is_over_and_the_heartbeat_stops_the_axes);
    RUN_TEST(test_can_off_for_a_moment_is_warned_of_until_the_controller_is_active);
    RUN_TEST(test_can_overrun_is_warned_of);
    RUN_TEST(test_pdo_short_is_refused_until_a_right_one_comes);
    RUN_TEST(test_pdo_long_is_refused_until_a_right_one_comes);
    RUN_TEST(test_pdo_value_is_refused_until_right_ones_come);
    RUN_TEST(test_sync_length_is_refused_until_a_right_one_comes);
    RUN_TEST(test_heartbeat_by_node_guarding_that_ceases_stops_on_the_path);
    RUN_TEST(test_pdo_late_is_told_and_stops_on_the_path_as_a_lost_heartbeat_does);
    RUN_TEST(test_one_axis_in_mode_7_is_told_after_a_second);
    RUN_TEST(test_one_axis_has_records_and_the_other_none);
    RUN_TEST(test_queue_full_of_records_is_told_until_the_stream_is_discarded);
    RUN_TEST(test_flash_worn_is_a_warning_that_stays);
    RUN_TEST(test_save_refused_is_a_warning_until_the_next_save_is_possible);
    RUN_TEST(test_of_two_faults_within_a_millisecond_603Fh_and_the_first_emcy_tell_the_first);
    RUN_TEST(test_later_fault_cuts_a_stop_on_the_path_short_and_603Fh_keeps_the_first);
    RUN_TEST(test_warning_is_reported_again_after_a_reset_of_the_node);
    return UNITY_END();
}
