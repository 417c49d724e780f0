/* SPDX-License-Identifier: Apache-2.0 */
/* What the background makes of power, configuration and faults, test_drive.h. */
#include "test_drive.h"
#include "drive/configuration.h"

static struct hal_axis_cfg wiring[AXES];

static void drive_configured(void *ctx, const struct hal_axis_cfg cfg[AXES])
{
    (void)ctx;
    memcpy(wiring, cfg, sizeof wiring);
}

static void test_power_on_is_idle_without_power_or_fault(void)
{
    step(0);
    TEST_ASSERT_EQUAL_HEX32(0, drive.faults);
    TEST_ASSERT_FALSE(drive_powered(&drive));
    TEST_ASSERT_EQUAL_HEX16(0x0250, od.axis[0].statusword);
    TEST_ASSERT_EQUAL_UINT8(STREAM_IDLE, od.stream.state);
    TEST_ASSERT_EQUAL_UINT16(QUEUE_ROOM, od.stream.free);
}

static void test_axes_are_enabled_no_sooner_than_their_position_is_known(void)
{
    wires.count[0] = 1000000;
    command(0x06, 0x06);
    command(0x0F, 0x0F);
    TEST_ASSERT_FALSE(drive_powered(&drive));
    ms(1);
    TEST_ASSERT_FALSE(drive_powered(&drive));
    ms(1);
    TEST_ASSERT_FALSE(drive_powered(&drive)); /* a command that came too soon is over */
    command(0x0F, 0x0F);
    TEST_ASSERT_TRUE(drive_powered(&drive));
    tick(1);
    TEST_ASSERT_TRUE(out.enable[0] && out.enable[1]);
    TEST_ASSERT_INT32_WITHIN(1, 76290000, knots.start.nm[0]); /* held where it stands */
}

static void test_axis_that_gets_power_is_held_where_it_is_and_the_other_one_at_its_reference(void)
{
    for (int axis = 0; axis < 2; axis++) {
        setUp();
        ms(3);
        command(0x06, 0x06);
        command(axis == 0 ? 0x0F : 0x06, axis == 1 ? 0x0F : 0x06);
        TEST_ASSERT_TRUE(cia402_powered(&drive.axis[axis]) && !cia402_powered(&drive.axis[1 - axis]));
        wires.count[axis] += 5; /* it yields to a force: 0.38 um */
        wires.count[1 - axis] += 10000;
        ms(300);
        command(0x0F, 0x0F);
        TEST_ASSERT_TRUE(cia402_powered(&drive.axis[0]) && cia402_powered(&drive.axis[1]));
        TEST_ASSERT_EQUAL_INT32(0, knots.start.nm[axis]);
        TEST_ASSERT_INT32_WITHIN(1, 762900, knots.start.nm[1 - axis]);
    }
}

static void test_new_parameters_are_in_force_before_the_axes_can_be_enabled(void)
{
    ms(5);
    wires.count[0] = 1000000;
    ms(300);
    od.axis[0].plant.encoder = 2 * 7629000;
    drive_configure(&drive, false);
    command(0x06, 0x06);
    command(0x0F, 0x0F);
    TEST_ASSERT_FALSE(drive_powered(&drive));
    ms(1);
    command(0x0F, 0x0F);
    TEST_ASSERT_FALSE(drive_powered(&drive)); /* the first snapshot may be half of the old configuration */
    ms(1);
    command(0x0F, 0x0F);
    TEST_ASSERT_TRUE(drive_powered(&drive));
    TEST_ASSERT_INT32_WITHIN(1, 2 * 76290000, knots.start.nm[0]);
}

static void test_limits_of_the_dictionary_reach_the_tick_in_its_units(void)
{
    od.limits.velocity = 123456;    /* um/s */
    od.limits.path_stop_time = 234; /* ms */
    for (int i = 0; i < 2; i++) {
        od.axis[i].following_window = 1234567u + (uint32_t)i; /* nm */
        od.axis[i].plant.encoder = 345678u + (uint32_t)i;     /* 10 fm */
        od.axis[i].position_limit.min = -4567891 - i;
        od.axis[i].position_limit.max = 5678912 + i;
    }
    drive_configure(&drive, false);
    const struct servo_loop_cfg *c = &drive.loop.cfg[atomic_load(&drive.loop.command.configured) % 2u];
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 123456 * 5e-3, val(c->speed_max)); /* um/T0 */
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 234, val(c->stop_time));
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, 1234.567 + 0.001 * i, val(c->following_max[i])); /* um */
        TEST_ASSERT_EQUAL_UINT32(345678 + i, c->encoder_10fm[i]);
        TEST_ASSERT_EQUAL_INT32(-4567891 - i, c->min_nm[i]);
        TEST_ASSERT_EQUAL_INT32(5678912 + i, c->max_nm[i]);
        TEST_ASSERT_EQUAL_INT32(-4567891 - i, drive.path.queue.min_nm[i]);
        TEST_ASSERT_EQUAL_INT32(5678912 + i, drive.path.queue.max_nm[i]);
    }
}

static void test_new_configuration_is_written_beside_the_one_that_the_tick_uses(void)
{
    for (uint32_t i = 0; i < 3; i++) {
        tick(1);
        const num before = drive.loop.cfg_in_use->speed_max;
        od.limits.velocity = 200000 + i;
        drive_configure(&drive, false);
        TEST_ASSERT_EQUAL_DOUBLE(val(before), val(drive.loop.cfg_in_use->speed_max));
        tick(1);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, (200000 + i) * 5e-3, val(drive.loop.cfg_in_use->speed_max));
    }
}

static void test_wiring_reaches_the_hal_from_power_on_and_with_each_configuration(void)
{
    hal.drive_configure = drive_configured;
    for (uint32_t i = 0; i < 2; i++) {
        od.axis[0].wiring.full_scale = 111000 + i;
        od.axis[1].wiring.full_scale = 222000 + i;
        if (i == 0) {
            drive_init(&drive, &od, &hal, &knots);
        } else {
            drive_configure(&drive, false);
        }
        TEST_ASSERT_EQUAL_UINT32(111000 + i, wiring[0].full_scale_mN);
        TEST_ASSERT_EQUAL_UINT32(222000 + i, wiring[1].full_scale_mN);
    }
}

static void test_jump_of_an_encoder_with_the_shortest_counts_is_within_the_range_of_its_counter(void)
{
    od.limits.velocity = 10000000;
    od.axis[0].plant.encoder = 100; /* 10 m/s of 1 pm */
    od.axis[1].plant.encoder = 1000000;
    struct servo_loop_cfg cfg;
    configuration_servo_loop(&od, &cfg);
    TEST_ASSERT_EQUAL_UINT32(INT32_MAX, cfg.jump_counts[0]);
    TEST_ASSERT_EQUAL_UINT32(400100, cfg.jump_counts[1]); /* 4 mm in 0.1 ms, and 100 */
    od.limits.velocity = 1000;
    configuration_servo_loop(&od, &cfg);
    TEST_ASSERT_EQUAL_UINT32(140, cfg.jump_counts[1]);
}

static void test_fault_at_standstill_has_switched_the_axes_off_when_the_step_ends(void)
{
    enable();
    ms(1);
    servo_loop_raise(&drive.loop, FAULT_UNDERRUN); /* a path stop, which has nothing to stop */
    step(0);
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_EQUAL(CIA402_FAULT, drive.axis[i].state);
        TEST_ASSERT_EQUAL(AMPLIFIER_OFF, drive.amplifier[i].state);
        TEST_ASSERT_EQUAL_HEX32(SERVO_LOOP_OFF, atomic_load(&drive.loop.command.powered[i]));
    }
}

static void test_fault_of_the_tick_is_a_fault_of_the_drive(void)
{
    enable();
    wires.inputs[0] = HAL_AMPLIFIER_FAULT;
    tick(1);
    step(0);
    TEST_ASSERT_EQUAL_HEX32(FAULT_BIT(FAULT_AMPLIFIER), drive.faults);
    tick(10);
    step(0);
    TEST_ASSERT_EQUAL_HEX32(FAULT_BIT(FAULT_AMPLIFIER), drive.faults);
    TEST_ASSERT_EQUAL_HEX16(0x5400, od.axis[0].error_code);
    TEST_ASSERT_EQUAL_HEX16(0x5400, od.axis[1].error_code);
}

static void test_flipped_bit_of_what_the_tick_reads_is_the_first_fault_and_can_be_reset(void)
{
    for (int flip = 0; flip < 5; flip++) {
        setUp();
        enable();
        begin(100, 10);
        wires.inputs[0] = HAL_AMPLIFIER_FAULT;
        tick(1);
        wires.inputs[0] = 0;
        struct servo_loop_command *c = &drive.loop.command;
        switch (flip) {
        case 0: atomic_fetch_xor(&c->controller, 4u); break;
        case 1: atomic_fetch_xor(&c->stream, 0x100u); break;
        case 2: atomic_fetch_xor(&c->powered[0], 1u); break;
        case 3: atomic_fetch_xor(&c->powered[1], 1u); break;
        default: atomic_fetch_xor(&c->configured, 1u); break;
        }
        step(0);
        for (int i = 0; i < 2; i++) {
            TEST_ASSERT_EQUAL(CIA402_FAULT, drive.axis[i].state);
            TEST_ASSERT_EQUAL_HEX16(fault_table[FAULT_MEMORY].emcy, od.axis[i].error_code);
            TEST_ASSERT_EQUAL_HEX32(SERVO_LOOP_OFF, atomic_load(&c->powered[i]));
        }
        TEST_ASSERT_EQUAL_UINT8(FAULT_MEMORY, drive.first);
        TEST_ASSERT_FALSE(drive.path.queue.open); /* as with any other fault */
        TEST_ASSERT_EQUAL(od.controller.select, atomic_load(&c->controller));
        TEST_ASSERT_EQUAL_UINT32(drive.path.stream, atomic_load(&c->stream));
        ms(3);
        command(0x80, 0x80);
        ms(3);
        TEST_ASSERT_EQUAL_HEX32(0, drive.faults);
        enable();
    }
}

static void test_machine_that_is_another_one_than_configured_while_there_is_power_is_a_fault(void)
{
    static struct hal other;
    other = hal;
    enable();
    drive.loop.io = &other; /* a bit has flipped */
    step(0);
    TEST_ASSERT_EQUAL_HEX32(FAULT_BIT(FAULT_MEMORY), drive.faults);
    TEST_ASSERT_FALSE(drive_powered(&drive));
}

static void test_fault_that_lasts_for_a_moment_outlives_a_controlword_that_comes_before_it_is_polled(void)
{
    ms(3);
    wires.inputs[0] = HAL_ENCODER_FAULT;
    tick(1);
    wires.inputs[0] = HAL_AMPLIFIER_FAULT;
    command(0x06, 0x06);
    step(0);
    TEST_ASSERT_EQUAL_HEX32(FAULT_BIT(FAULT_ENCODER), drive.faults);
    TEST_ASSERT_EQUAL_HEX16(0x7305, od.axis[0].error_code);
    tick(1); /* another one, while the first is reset */
    wires.inputs[0] = 0;
    command(0x80, 0x80);
    step(0);
    TEST_ASSERT_EQUAL_HEX32(FAULT_BIT(FAULT_AMPLIFIER), drive.faults);
    TEST_ASSERT_EQUAL_HEX16(0x5400, od.axis[0].error_code);
    command(0, 0);
    command(0x80, 0x80);
    ms(1);
    TEST_ASSERT_EQUAL_HEX32(0, drive.faults);
    TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&drive.loop.faults));
    enable();
}

static void test_faults_are_cleared_when_both_axes_have_left_the_state_fault(void)
{
    for (int first = 0; first < 2; first++) {
        setUp();
        enable();
        wires.inputs[0] = HAL_AMPLIFIER_FAULT;
        tick(1);
        wires.inputs[0] = 0;
        step(0);
        command(first == 0 ? 0x80 : 0, first == 1 ? 0x80 : 0);
        TEST_ASSERT_TRUE(drive.axis[first].state != CIA402_FAULT);
        TEST_ASSERT_EQUAL(CIA402_FAULT, drive.axis[1 - first].state);
        TEST_ASSERT_EQUAL_HEX32(FAULT_BIT(FAULT_AMPLIFIER), drive.faults);
        TEST_ASSERT_EQUAL_HEX16(0, od.axis[first].error_code);
        TEST_ASSERT_EQUAL_HEX16(0x5400, od.axis[1 - first].error_code);
        command(first == 1 ? 0x80 : 0, first == 0 ? 0x80 : 0);
        TEST_ASSERT_EQUAL_HEX32(0, drive.faults);
        ms(2);
        TEST_ASSERT_EQUAL_HEX32(0, drive.faults);
    }
}

static void test_capture_of_a_warning_stays_when_the_second_axis_gets_power(void)
{
    for (int first = 0; first < 2; first++) {
        setUp();
        ms(3);
        command(0x06, 0x06);
        command(first == 0 ? 0x0F : 0x06, first == 1 ? 0x0F : 0x06);
        ms(1000); /* the capture's part before the trigger */
        scope_warning(&drive.loop.scope, FAULT_BIT(FAULT_TUNNEL));
        ms(1);
        TEST_ASSERT_TRUE(scope_holds_fault(&drive.loop.scope));
        command(0x0F, 0x0F);
        TEST_ASSERT_TRUE(cia402_powered(&drive.axis[0]) && cia402_powered(&drive.axis[1]));
        TEST_ASSERT_TRUE(scope_holds_fault(&drive.loop.scope));
        command(0, 0);
        ms(300);
        TEST_ASSERT_TRUE(scope_holds_fault(&drive.loop.scope));
        enable();
        TEST_ASSERT_FALSE(scope_holds_fault(&drive.loop.scope));
    }
}

/* A master claims the drive, arms it, and enables one axis. */
static void claim_and_enable(int axis)
{
    ms(3);
    TEST_ASSERT_TRUE(command_guard_claim(&drive.command_guard, 1, 7, false));
    command(0x06, 0x06);
    const uint32_t ticket = command_guard_draw(&drive.command_guard, drive_now(&drive));
    TEST_ASSERT_TRUE(command_guard_arm(&drive.command_guard, ticket, drive_now(&drive)));
    command(axis == 0 ? 0x0F : 0x06, axis == 1 ? 0x0F : 0x06);
    ms(5);
}

static void test_permission_to_enable_outlives_the_enabling_of_one_axis_and_ends_with_that_of_both(void)
{
    for (int first = 0; first < 2; first++) {
        setUp();
        claim_and_enable(first);
        TEST_ASSERT_TRUE(cia402_enabled(&drive.axis[first]) && !cia402_powered(&drive.axis[1 - first]));
        command(0x0F, 0x0F);
        TEST_ASSERT_TRUE(cia402_enabled(&drive.axis[1 - first]));
        command(first == 0 ? 0x06 : 0x0F, first == 1 ? 0x06 : 0x0F);
        ms(5);
        command(0x0F, 0x0F);
        TEST_ASSERT_FALSE(cia402_powered(&drive.axis[first]));
    }
}

static void test_permission_to_enable_ends_when_an_axis_loses_its_power(void)
{
    for (int first = 0; first < 2; first++) {
        setUp();
        claim_and_enable(first);
        command(first == 0 ? 0x06 : 0x0F, first == 1 ? 0x06 : 0x0F); /* one goes off as the other one goes on */
        ms(5);
        TEST_ASSERT_TRUE(cia402_enabled(&drive.axis[1 - first]) && !cia402_powered(&drive.axis[first]));
        command(0x0F, 0x0F);
        TEST_ASSERT_FALSE(cia402_powered(&drive.axis[first]));
    }
}

static void test_stop_of_the_node_reaches_the_tick_before_the_next_step(void)
{
    enable();
    begin(900, 900);
    command(0x1F, 0x1F);
    ms(100);
    TEST_ASSERT_TRUE(atomic_load(&drive.loop.command.run));
    drive_stop(&drive);
    TEST_ASSERT_FALSE(atomic_load(&drive.loop.command.run));
    ms(200);
    TEST_ASSERT_FALSE(drive_powered(&drive));
}

static void test_power_is_off_in_the_background_as_soon_as_a_fault_is_polled(void)
{
    enable();
    begin(100, 10);
    wires.inputs[1] = HAL_AMPLIFIER_FAULT;
    tick(1);
    step(0);
    TEST_ASSERT_FALSE(drive_powered(&drive));
    TEST_ASSERT_EQUAL_HEX32(SERVO_LOOP_OFF, atomic_load(&drive.loop.command.powered[0]));
    TEST_ASSERT_FALSE(drive.path.queue.open);
}

static void test_reset_cuts_the_power_and_keeps_position_and_time(void)
{
    wires.count[0] = 500000;
    ms(300);
    enable();
    const uint32_t published = atomic_load(&drive.loop.published);
    for (int i = 0; i < 2; i++) { /* as homing has left it */
        drive.path.queue.origin_nm[i] = 1000 - 3000 * i;
        atomic_store(&drive.loop.command.origin_nm[i], 1000 - 3000 * i);
    }
    od.stream.rejected_crc = od.stream.underruns = 7;
    drive_reset(&drive);
    TEST_ASSERT_EQUAL_UINT32(0, od.stream.rejected_crc + od.stream.underruns);
    tick(1);
    TEST_ASSERT_FALSE(out.enable[0] || out.enable[1]);
    TEST_ASSERT_EQUAL_UINT32(published, atomic_load(&drive.loop.published));
    ms(3);
    TEST_ASSERT_INT32_WITHIN(1, 38145000, servo_loop_snapshot(&drive.loop)->position_nm[0]);
    TEST_ASSERT_INT32_WITHIN(1, 38146000, path_position(&drive.path).nm[0]);
    TEST_ASSERT_INT32_WITHIN(1, -2000, path_position(&drive.path).nm[1]);
    TEST_ASSERT_EQUAL_UINT8(STREAM_IDLE, od.stream.state);
    command(0, 0);
    enable();
}

static void test_configuration_that_changes_by_itself_is_a_fault_whichever_axis_has_power(void)
{
    for (int powered = 0; powered < 2; powered++) {
        setUp();
        ms(3);
        command(0x06, 0x06);
        command(powered == 0 ? 0x0F : 0x06, powered == 1 ? 0x0F : 0x06);
        tick(1);
        TEST_ASSERT_TRUE(out.enable[powered] && !out.enable[1 - powered]);
        drive.loop.configured ^= 1u;
        tick(1);
        TEST_ASSERT_TRUE((atomic_load(&drive.loop.faults) & FAULT_BIT(FAULT_MEMORY)) != 0);
        TEST_ASSERT_FALSE(out.enable[powered]);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_power_on_is_idle_without_power_or_fault);
    RUN_TEST(test_axes_are_enabled_no_sooner_than_their_position_is_known);
    RUN_TEST(test_axis_that_gets_power_is_held_where_it_is_and_the_other_one_at_its_reference);
    RUN_TEST(test_new_parameters_are_in_force_before_the_axes_can_be_enabled);
    RUN_TEST(test_limits_of_the_dictionary_reach_the_tick_in_its_units);
    RUN_TEST(test_new_configuration_is_written_beside_the_one_that_the_tick_uses);
    RUN_TEST(test_wiring_reaches_the_hal_from_power_on_and_with_each_configuration);
    RUN_TEST(test_jump_of_an_encoder_with_the_shortest_counts_is_within_the_range_of_its_counter);
    RUN_TEST(test_fault_at_standstill_has_switched_the_axes_off_when_the_step_ends);
    RUN_TEST(test_fault_of_the_tick_is_a_fault_of_the_drive);
    RUN_TEST(test_flipped_bit_of_what_the_tick_reads_is_the_first_fault_and_can_be_reset);
    RUN_TEST(test_machine_that_is_another_one_than_configured_while_there_is_power_is_a_fault);
    RUN_TEST(test_fault_that_lasts_for_a_moment_outlives_a_controlword_that_comes_before_it_is_polled);
    RUN_TEST(test_faults_are_cleared_when_both_axes_have_left_the_state_fault);
    RUN_TEST(test_capture_of_a_warning_stays_when_the_second_axis_gets_power);
    RUN_TEST(test_permission_to_enable_outlives_the_enabling_of_one_axis_and_ends_with_that_of_both);
    RUN_TEST(test_permission_to_enable_ends_when_an_axis_loses_its_power);
    RUN_TEST(test_stop_of_the_node_reaches_the_tick_before_the_next_step);
    RUN_TEST(test_power_is_off_in_the_background_as_soon_as_a_fault_is_polled);
    RUN_TEST(test_reset_cuts_the_power_and_keeps_position_and_time);
    RUN_TEST(test_configuration_that_changes_by_itself_is_a_fault_whichever_axis_has_power);
    return UNITY_END();
}
