/* SPDX-License-Identifier: Apache-2.0 */
/* LSS (CiA 305), 1010h, 1011h and 2001h on the whole firmware, with its flash. */
#include "drive_rig.h"

static struct rig rig;
static struct can_frame sent[256]; /* by the device since `clear` */
static unsigned count;

static bool keep_frame(void *ctx, const struct can_frame *frame)
{
    if (count < sizeof sent / sizeof sent[0]) {
        sent[count++] = *frame;
    }
    return rig_can_send(ctx, frame);
}

static void power_on(void)
{
    count = 0;
    rig.hal.can_send = keep_frame;
    sim_flash_power_on(&rig.flash);
    device_init(&rig.device, &rig.hal, &rig.ring, 1);
}

void setUp(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    power_on();
}

void tearDown(void)
{
}

static unsigned node_id(void)
{
    return rig.device.node.config.node_id;
}

static void lss(uint8_t command, uint8_t a, uint8_t b)
{
    const uint8_t data[8] = {command, a, b};
    count = 0;
    rig_send(&rig, 0x7E5, 8, data);
}

static void lss_part(uint8_t command, uint32_t value)
{
    uint8_t data[8] = {command};
    co_put(&data[1], value, 4);
    count = 0;
    rig_send(&rig, 0x7E5, 8, data);
}

static bool scan(uint32_t number, uint8_t check, uint8_t sub, uint8_t next)
{
    uint8_t data[8] = {0x51};
    co_put(&data[1], number, 4);
    data[5] = check;
    data[6] = sub;
    data[7] = next;
    count = 0;
    rig_send(&rig, 0x7E5, 8, data);
    TEST_ASSERT_TRUE(count <= 1);
    return count == 1 && sent[0].id == 0x7E4 && sent[0].data[0] == 0x4F;
}

static void expect_response(uint8_t command, uint32_t value)
{
    TEST_ASSERT_EQUAL_UINT(1, count);
    TEST_ASSERT_EQUAL_HEX16(0x7E4, sent[0].id);
    TEST_ASSERT_EQUAL_UINT8(8, sent[0].len);
    TEST_ASSERT_EQUAL_HEX8(command, sent[0].data[0]);
    TEST_ASSERT_EQUAL_HEX32(value, co_get(&sent[0].data[1], 4));
}

static void nmt(uint8_t command, uint8_t node)
{
    const uint8_t data[2] = {command, node};
    count = 0;
    rig_send(&rig, 0, 2, data);
}

static bool was_sent(uint16_t id)
{
    for (unsigned i = 0; i < count; i++) {
        if (sent[i].id == id) {
            return true;
        }
    }
    return false;
}

/* ---- who is meant ---- */

static void test_services_of_the_configuration_state_have_no_answer_before_it(void)
{
    static const uint8_t commands[] = {0x11, 0x13, 0x15, 0x17, 0x5A, 0x5B, 0x5C, 0x5D, 0x5E};
    for (unsigned i = 0; i < sizeof commands; i++) {
        lss(commands[i], 3, 0);
        TEST_ASSERT_EQUAL_UINT(0, count);
    }
    lss(4, 1, 0);
    TEST_ASSERT_EQUAL_UINT(0, count);
    lss(0x5E, 0, 0);
    expect_response(0x5E, 1);
    lss(4, 0, 0);
    lss(0x5E, 0, 0);
    TEST_ASSERT_EQUAL_UINT(0, count);
}

static void test_identity_is_read_part_by_part(void)
{
    rig.device.od.identity.serial = 0x12345678;
    lss(4, 1, 0);
    lss(0x5A, 0, 0);
    expect_response(0x5A, 0);
    lss(0x5B, 0, 0);
    expect_response(0x5B, 1);
    lss(0x5C, 0, 0);
    expect_response(0x5C, 0x00010000);
    lss(0x5D, 0, 0);
    expect_response(0x5D, 0x12345678);
}

static void test_only_the_whole_address_in_order_selects(void)
{
    static const uint32_t own[] = {0, 1, 0x00010000, 77};
    rig.device.od.identity.serial = 77;
    for (unsigned wrong = 0; wrong < 4; wrong++) {
        for (unsigned part = 0; part < 4; part++) {
            lss_part((uint8_t)(0x40 + part), own[part] ^ (part == wrong ? 0x80u : 0u));
            TEST_ASSERT_EQUAL_UINT(0, count);
        }
    }
    lss_part(0x43, own[3]);
    TEST_ASSERT_EQUAL_UINT(0, count);
    for (unsigned part = 0; part < 4; part++) {
        lss_part((uint8_t)(0x40 + part), own[part]);
    }
    expect_response(0x44, 0);
    lss(0x5E, 0, 0);
    expect_response(0x5E, 1);
}

static void test_slave_in_the_ranges_identifies_itself(void)
{
    static const uint32_t inside[] = {0, 1, 0x00010000, 0x00010000, 70, 80};
    rig.device.od.identity.serial = 77;
    for (unsigned step = 0; step < 6; step++) {
        lss_part((uint8_t)(0x46 + step), inside[step]);
        TEST_ASSERT_EQUAL_UINT(step == 5 ? 1 : 0, count);
    }
    expect_response(0x4F, 0);
    static const uint32_t outside[] = {1, 2, 0x00010001, 0x0000FFFF, 78, 76};
    for (unsigned wrong = 0; wrong < 6; wrong++) {
        for (unsigned step = 0; step < 6; step++) {
            lss_part((uint8_t)(0x46 + step), step == wrong ? outside[step] : inside[step]);
            TEST_ASSERT_EQUAL_UINT(0, count);
        }
    }
}

/* ---- node id ---- */

static void test_new_node_id_acts_from_reset_communication_on(void)
{
    lss(4, 1, 0);
    lss(0x11, 9, 0);
    expect_response(0x11, 0);
    TEST_ASSERT_EQUAL_UINT(1, node_id());
    TEST_ASSERT_EQUAL_UINT(9, rig_read(&rig, 0x2001, 1));
    nmt(130, 1);
    TEST_ASSERT_EQUAL_UINT(9, node_id());
    TEST_ASSERT_TRUE(was_sent(0x709));
    TEST_ASSERT_EQUAL_HEX32(0x89, rig.device.od.emcy_cob_id);
    TEST_ASSERT_EQUAL_HEX32(0x589, rig.device.od.sdo_server.cob_id_response);
    TEST_ASSERT_EQUAL_HEX32(0x40000189, rig.device.od.tpdo1.cob_id);
    lss(0x5E, 0, 0);
    TEST_ASSERT_EQUAL_UINT(0, count); /* waiting state again */
}

static void test_node_id_that_kontur_does_not_take_is_refused(void)
{
    static const uint8_t refused[] = {0, 32, 127, 128, 254};
    lss(4, 1, 0);
    for (unsigned i = 0; i < sizeof refused; i++) {
        lss(0x11, refused[i], 0);
        expect_response(0x11, 1);
    }
    lss(0x11, 31, 0);
    expect_response(0x11, 0);
    TEST_ASSERT_EQUAL_UINT8(31, rig.device.od.node.id);
}

static void test_node_id_that_is_not_stored_is_gone_after_power_off(void)
{
    lss(4, 1, 0);
    lss(0x11, 9, 0);
    power_on();
    TEST_ASSERT_EQUAL_UINT(1, node_id());
}

static void test_stored_node_id_is_there_after_power_on_and_reset_and_nothing_else_is_stored(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 1, 4, 123456));
    lss(4, 1, 0);
    lss(0x11, 9, 0);
    lss(0x17, 0, 0);
    expect_response(0x17, 0);
    power_on();
    TEST_ASSERT_EQUAL_UINT(9, node_id());
    TEST_ASSERT_TRUE(was_sent(0x709));
    TEST_ASSERT_EQUAL_UINT32(od_defaults.smc.lambda, rig.device.od.smc.lambda);
    nmt(129, 9);
    TEST_ASSERT_EQUAL_UINT(9, node_id());
}

static void test_store_that_fails_has_error_code_2(void)
{
    lss(4, 1, 0);
    rig.flash.broken = true;
    lss(0x17, 0, 0);
    expect_response(0x17, 2);
    rig.flash.broken = false;
    rig_enable(&rig);
    lss(0x17, 0, 0);
    expect_response(0x17, 2);
    TEST_ASSERT_EQUAL_UINT(0, rig.flash.operations);
}

/* ---- no node id ---- */

static void unconfigure(void)
{
    lss(4, 1, 0);
    lss(0x11, 255, 0);
    expect_response(0x11, 0);
    lss(0x17, 0, 0);
    power_on();
}

static void test_node_without_id_says_nothing_but_by_lss(void)
{
    unconfigure();
    TEST_ASSERT_EQUAL_UINT(0, count);
    nmt(1, 0);
    TEST_ASSERT_EQUAL(CO_INITIALISING, co_nmt_state(&rig.device.node));
    const uint8_t upload[8] = {0x40, 0x00, 0x10};
    for (uint16_t id = 0x600; id < 0x700; id++) {
        rig_send(&rig, id, 8, upload);
    }
    rig_ms(&rig, 500);
    TEST_ASSERT_EQUAL_UINT(0, count);
    lss(0x4C, 0, 0);
    expect_response(0x50, 0);
}

static void test_node_with_an_id_takes_no_part_in_what_is_for_those_without(void)
{
    lss(0x4C, 0, 0);
    TEST_ASSERT_EQUAL_UINT(0, count);
    TEST_ASSERT_FALSE(scan(0, 128, 0, 0));
}

static void test_node_without_id_boots_when_it_gets_one_and_leaves_the_configuration_state(void)
{
    unconfigure();
    lss(4, 1, 0);
    lss(0x5E, 0, 0);
    expect_response(0x5E, 255);
    lss(0x11, 7, 0);
    expect_response(0x11, 0);
    lss(4, 0, 0);
    TEST_ASSERT_TRUE(was_sent(0x707));
    TEST_ASSERT_EQUAL_UINT(7, node_id());
    TEST_ASSERT_EQUAL(CO_PRE_OPERATIONAL, co_nmt_state(&rig.device.node));
}

static void test_node_without_id_boots_by_reset_when_it_has_got_one(void)
{
    unconfigure();
    nmt(130, 0);
    TEST_ASSERT_EQUAL_UINT(0, count);
    lss(4, 1, 0);
    lss(0x11, 7, 0);
    nmt(130, 0);
    TEST_ASSERT_TRUE(was_sent(0x707));
}

static void test_fastscan_finds_the_address_bit_by_bit(void)
{
    static const uint32_t own[] = {0, 1, 0x00010000, 0xC0FFEE05};
    unconfigure();
    rig.device.od.identity.serial = own[3];
    TEST_ASSERT_TRUE(scan(0, 128, 0, 0));
    for (uint8_t part = 0; part < 4; part++) {
        uint32_t found = 0;
        for (int bit = 31; bit >= 0; bit--) {
            if (!scan(found, (uint8_t)bit, part, part)) {
                found |= 1u << bit;
            }
        }
        TEST_ASSERT_EQUAL_HEX32(own[part], found);
        TEST_ASSERT_FALSE(scan(found ^ 1u, 0, part, (uint8_t)(part + 1) & 3u));
        TEST_ASSERT_TRUE(scan(found, 0, part, (uint8_t)(part + 1) & 3u));
    }
    lss(0x5E, 0, 0);
    expect_response(0x5E, 255); /* it is in configuration state now */
}

static void test_fastscan_out_of_range_or_of_another_part_is_ignored(void)
{
    unconfigure();
    TEST_ASSERT_TRUE(scan(0, 128, 0, 0));
    TEST_ASSERT_FALSE(scan(0, 32, 0, 0));
    TEST_ASSERT_FALSE(scan(0, 127, 0, 0));
    TEST_ASSERT_FALSE(scan(0, 5, 4, 0));
    TEST_ASSERT_FALSE(scan(0, 5, 255, 0));
    TEST_ASSERT_FALSE(scan(0, 0, 0, 4));
    TEST_ASSERT_FALSE(scan(1, 0, 1, 1));
}

/* ---- bit rate ---- */

static void test_bit_rate_by_its_table_and_only_what_the_port_can(void)
{
    lss(4, 1, 0);
    lss(0x13, 0, 4);
    expect_response(0x13, 0);
    TEST_ASSERT_EQUAL_UINT16(125, rig.device.od.node.bitrate);
    lss(0x13, 0, 1); /* 800: the rig cannot */
    expect_response(0x13, 1);
    lss(0x13, 0, 5); /* reserved */
    expect_response(0x13, 1);
    lss(0x13, 0, 9);
    expect_response(0x13, 1);
    lss(0x13, 1, 0);
    expect_response(0x13, 1);
    TEST_ASSERT_EQUAL_UINT16(125, rig.device.od.node.bitrate);
    TEST_ASSERT_EQUAL_UINT16(1000, rig.bitrate);
    nmt(130, 1);
    TEST_ASSERT_EQUAL_UINT16(125, rig.bitrate);
}

static void test_activated_bit_rate_comes_after_one_delay_and_the_node_is_silent_for_two(void)
{
    rig_nmt(&rig, 1);
    rig_ms(&rig, 5);
    lss(4, 1, 0);
    lss(0x13, 0, 2);
    lss(0x15, 50, 0);
    count = 0;
    rig_ms(&rig, 49);
    TEST_ASSERT_EQUAL_UINT16(1000, rig.bitrate);
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_UINT16(500, rig.bitrate);
    rig_ms(&rig, 49);
    TEST_ASSERT_EQUAL_UINT(0, count);
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(count > 0);
}

static void test_bit_rate_by_parameter_is_checked_with_the_port(void)
{
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_VALUE, rig_write(&rig, 0x2001, 2, 2, 250));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2001, 2, 2, 500));
    TEST_ASSERT_EQUAL_UINT16(1000, rig.bitrate);
    nmt(130, 1);
    TEST_ASSERT_EQUAL_UINT16(500, rig.bitrate);
}

/* ---- 1010h, 1011h ---- */

enum { SAVE = 0x65766173, LOAD = 0x64616F6C };

static void test_saved_parameters_are_there_after_power_on_and_after_reset(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 1, 4, 123456));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1017, 0, 2, 70));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE));
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x1010, 1));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 1, 4, 99000));
    nmt(129, 1);
    TEST_ASSERT_EQUAL_UINT32(123456, rig_read(&rig, 0x2110, 1));
    TEST_ASSERT_EQUAL_UINT32(70, rig_read(&rig, 0x1017, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1017, 0, 2, 30));
    nmt(130, 1);
    TEST_ASSERT_EQUAL_UINT32(70, rig_read(&rig, 0x1017, 0));
    power_on();
    TEST_ASSERT_EQUAL_UINT32(123456, rig_read(&rig, 0x2110, 1));
    TEST_ASSERT_EQUAL_UINT32(70, rig_read(&rig, 0x1017, 0));
}

static void test_sub_indices_save_and_restore_their_part(void)
{
    for (uint8_t sub = 1; sub <= 3; sub++) {
        setUp();
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 1, 4, 123456));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1017, 0, 2, 70));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, sub, 4, SAVE));
        power_on();
        TEST_ASSERT_EQUAL_UINT32(sub != 2 ? 123456 : od_defaults.smc.lambda, rig_read(&rig, 0x2110, 1));
        TEST_ASSERT_EQUAL_UINT32(sub != 3 ? 70 : od_defaults.heartbeat_producer, rig_read(&rig, 0x1017, 0));
    }
    for (uint8_t sub = 1; sub <= 3; sub++) {
        setUp();
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 1, 4, 123456));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1017, 0, 2, 70));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1011, sub, 4, LOAD));
        TEST_ASSERT_EQUAL_UINT32(123456, rig_read(&rig, 0x2110, 1)); /* until the next reset */
        power_on();
        TEST_ASSERT_EQUAL_UINT32(sub == 2 ? 123456 : od_defaults.smc.lambda, rig_read(&rig, 0x2110, 1));
        TEST_ASSERT_EQUAL_UINT32(sub == 3 ? 70 : od_defaults.heartbeat_producer, rig_read(&rig, 0x1017, 0));
    }
}

static void test_restored_defaults_act_at_the_next_reset_and_leave_the_node_id(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2001, 1, 1, 4));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 1, 4, 123456));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1011, 1, 4, LOAD));
    nmt(129, 0);
    TEST_ASSERT_EQUAL_UINT(4, node_id());
    TEST_ASSERT_EQUAL_UINT32(od_defaults.smc.lambda, rig.device.od.smc.lambda);
}

static void test_wrong_signature_power_and_a_failing_flash_have_their_abort_codes(void)
{
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STORE, rig_write(&rig, 0x1010, 1, 4, LOAD));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STORE, rig_write(&rig, 0x1011, 1, 4, SAVE));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STORE, rig_write(&rig, 0x1010, 1, 4, 1));
    rig.flash.broken = true;
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_HARDWARE, rig_write(&rig, 0x1010, 1, 4, SAVE));
    rig.flash.broken = false;
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STATE, rig_write(&rig, 0x1010, 1, 4, SAVE));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STATE, rig_write(&rig, 0x1011, 1, 4, LOAD));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STATE, rig_write(&rig, 0x2001, 1, 1, 4));
    TEST_ASSERT_EQUAL_UINT(0, rig.flash.operations);
}

static void test_damaged_store_is_reported_the_drive_works_with_defaults_and_can_save_again(void)
{
    rig.flash.word[0][0] = 0x12345678;
    power_on();
    rig.emcy_count = 0;
    nmt(129, 1);
    rig_ms(&rig, 1);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x5530));
    TEST_ASSERT_EQUAL_HEX8(0x81, rig.device.od.error_register);
    TEST_ASSERT_EQUAL_UINT32(od_defaults.smc.lambda, rig.device.od.smc.lambda);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE));
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_HEX8(0, rig.device.od.error_register);
    rig_enable(&rig);
    power_on();
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_HEX8(0, rig.device.od.error_register);
}

static void test_stored_parameters_that_do_not_fit_together_are_reported_and_not_used(void)
{
    rig.device.od.smc.k_bar = od_defaults.smc.k_bar * 100; /* with e_max as it is, cosh overflows */
    rig.device.od.node.id = 3;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE));
    rig.emcy_count = 0;
    power_on();
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_UINT(3, node_id());
    TEST_ASSERT_EQUAL_HEX8(0x81, rig.device.od.error_register);
    TEST_ASSERT_EQUAL_UINT32(od_defaults.smc.k_bar, rig.device.od.smc.k_bar);
}

static void test_warning_of_stored_parameters_that_do_not_fit_stays_until_they_are_replaced(void)
{
    rig.device.od.smc.k_bar = od_defaults.smc.k_bar * 100;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE));
    power_on();
    rig.flash.broken = true;
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_HARDWARE, rig_write(&rig, 0x1010, 1, 4, SAVE));
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_HEX8(0x81, rig.device.od.error_register);
    rig.flash.broken = false;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE));
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_HEX8(0, rig.device.od.error_register);
}

static void expect_warning(bool warned)
{
    for (int i = 0; i < 2; i++) {
        rig_ms(&rig, 1);
        TEST_ASSERT_EQUAL_HEX8(warned ? 0x81 : 0, rig.device.od.error_register);
        power_on(); /* and from then on */
    }
}

/* What writes a set and retains its parameters: 1010h and 1011h for communication, LSS for 2001h. */
static void store_other_areas(unsigned which)
{
    if (which == 0) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 2, 4, SAVE));
    } else if (which == 1) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1011, 2, 4, LOAD));
    } else {
        lss(4, 1, 0);
        lss(0x17, 0, 0);
        expect_response(0x17, 0);
    }
}

static void test_warning_of_the_store_ends_when_the_parameters_are_saved_or_restored_and_not_before(void)
{
    static const struct {
        uint16_t index;
        uint8_t sub;
        uint32_t signature;
    } ends[] = {{0x1010, 1, SAVE}, {0x1010, 3, SAVE}, {0x1011, 1, LOAD}, {0x1011, 3, LOAD}};
    for (unsigned i = 0; i < 8; i++) {
        setUp();
        if (i % 2 == 0) { /* damaged */
            rig.flash.word[0][0] = 0x12345678;
        } else { /* the parameters do not fit together */
            rig.device.od.smc.k_bar = od_defaults.smc.k_bar * 100;
            TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE));
        }
        power_on();
        expect_warning(true);
        for (unsigned which = 0; which < 3; which++) {
            store_other_areas(which);
            expect_warning(true);
        }
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, ends[i / 2].index, ends[i / 2].sub, 4, ends[i / 2].signature));
        expect_warning(false);
    }
}

static void test_stored_parameter_out_of_range_is_reported_and_the_others_are_used(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x687D, 1, 4, -1234));
    rig.device.od.smc.gamma = UINT32_MAX; /* in range for another firmware */
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE));
    power_on();
    expect_warning(true);
    TEST_ASSERT_EQUAL_UINT32(od_defaults.smc.gamma, rig.device.od.smc.gamma);
    TEST_ASSERT_EQUAL_INT32(-1234, rig.device.od.axis[1].position_limit.min);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 3, 4, SAVE));
    expect_warning(false);
    TEST_ASSERT_EQUAL_INT32(-1234, rig.device.od.axis[1].position_limit.min);
}

/* Node id, bit rate and communication objects: the warning lasts until the value that is out of range is replaced. */
static void test_stored_value_of_another_area_out_of_range_is_reported_until_it_is_replaced(void)
{
    enum { ID, BIT_RATE, COMMUNICATION, CASES };
    for (unsigned i = 0; i < CASES; i++) {
        setUp();
        if (i == ID) {
            rig.device.od.node.id = 99;
        } else if (i == BIT_RATE) {
            rig.device.od.node.bitrate = 2000;
        } else {
            rig.device.od.error_behaviour.communication = 9;
        }
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE));
        power_on();
        expect_warning(true);
        TEST_ASSERT_EQUAL_UINT(1, node_id());
        TEST_ASSERT_EQUAL_UINT(od_defaults.node.bitrate, rig.device.od.node.bitrate);
        TEST_ASSERT_EQUAL_UINT(od_defaults.error_behaviour.communication, rig.device.od.error_behaviour.communication);
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, i == COMMUNICATION ? 3 : 2, 4, SAVE));
        expect_warning(true);
        store_other_areas(i == COMMUNICATION ? 1 : 2);
        expect_warning(false);
    }
}

/* 2035h */
static void test_sets_written_are_counted_over_power_off_and_every_way_of_writing(void)
{
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2035, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE));
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2035, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1011, 2, 4, LOAD));
    lss(4, 1, 0);
    lss(0x13, 0, 2); /* 500 kbit/s */
    store_other_areas(2);
    TEST_ASSERT_EQUAL_UINT32(3, rig_read(&rig, 0x2035, 0));
    rig.flash.broken = true;
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_HARDWARE, rig_write(&rig, 0x1010, 1, 4, SAVE));
    rig.flash.broken = false;
    TEST_ASSERT_EQUAL_UINT32(3, rig_read(&rig, 0x2035, 0));
    nmt(129, 1);
    TEST_ASSERT_EQUAL_UINT32(3, rig_read(&rig, 0x2035, 0));
    power_on();
    TEST_ASSERT_EQUAL_UINT32(3, rig_read(&rig, 0x2035, 0));
}

/* ---- wear of the flash: 2170h ---- */

static uint32_t save_other(uint32_t value)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2110, 1, 4, 100000 + value));
    return rig_write(&rig, 0x1010, 1, 4, SAVE);
}

static void test_what_is_stored_already_is_not_written_again(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, save_other(1));
    const uint32_t operations = rig.flash.operations;
    for (unsigned i = 0; i < 1000; i++) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, (uint8_t)(1 + i % 3), 4, SAVE));
    }
    store_other_areas(2);
    TEST_ASSERT_EQUAL_UINT32(operations, rig.flash.operations);
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2035, 0));
    TEST_ASSERT_EQUAL_UINT32(7, rig_read(&rig, 0x2170, 3));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1011, 2, 4, LOAD));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1011, 2, 4, LOAD));
    TEST_ASSERT_EQUAL_UINT32(2, rig_read(&rig, 0x2035, 0));
    power_on();
    TEST_ASSERT_EQUAL_UINT32(100001, rig_read(&rig, 0x2110, 1));
}

static void test_storm_of_saves_is_let_through_once_a_minute(void)
{
    for (unsigned i = 0; i < 8; i++) {
        TEST_ASSERT_EQUAL_HEX32(0, save_other(i));
    }
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1010, 1, 4, SAVE)); /* the same once more */
    rig_ms(&rig, 2);
    TEST_ASSERT_FALSE(rig_had_emcy(&rig, 0xFF32));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STATE, save_other(9));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STATE, rig_write(&rig, 0x1011, 1, 4, LOAD));
    lss(4, 1, 0);
    lss(0x11, 9, 0);
    lss(0x17, 0, 0);
    expect_response(0x17, 2);
    lss(0x11, 1, 0);
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF32));
    TEST_ASSERT_EQUAL_UINT32(8, rig_read(&rig, 0x2035, 0));
    nmt(129, 1);
    TEST_ASSERT_EQUAL_UINT32(100007, rig_read(&rig, 0x2110, 1));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STATE, save_other(9));
    rig_ms(&rig, 60000);
    TEST_ASSERT_EQUAL_HEX8(0, rig.device.od.error_register);
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2170, 3));
    TEST_ASSERT_EQUAL_HEX32(0, save_other(9));
    TEST_ASSERT_EQUAL_HEX32(SDO_ABORT_STATE, save_other(10));
}

static void test_erasures_are_counted_over_power_off_and_warned_of(void)
{
    for (unsigned i = 1; i <= 40; i++) {
        if (i % 8 == 0) {
            power_on();
        }
        TEST_ASSERT_EQUAL_HEX32(0, save_other(i));
        TEST_ASSERT_EQUAL_UINT32(rig.flash.erases, rig_read(&rig, 0x2170, 1));
    }
    TEST_ASSERT_TRUE(rig.flash.erases >= 8);
    power_on();
    TEST_ASSERT_EQUAL_UINT32(rig.flash.erases, rig_read(&rig, 0x2170, 1));
    rig.device.od.flash_wear.erases = 15999;
    rig.emcy_count = 0;
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    for (unsigned i = 1; i <= 5; i++) {
        TEST_ASSERT_EQUAL_HEX32(0, save_other(100 + i));
    }
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF31));
    TEST_ASSERT_BITS(1u << 7, 1u << 7, rig.device.od.axis[0].statusword);
    rig.emcy_count = 0;
    nmt(129, 1);
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0xFF31));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_services_of_the_configuration_state_have_no_answer_before_it);
    RUN_TEST(test_identity_is_read_part_by_part);
    RUN_TEST(test_only_the_whole_address_in_order_selects);
    RUN_TEST(test_slave_in_the_ranges_identifies_itself);
    RUN_TEST(test_new_node_id_acts_from_reset_communication_on);
    RUN_TEST(test_node_id_that_kontur_does_not_take_is_refused);
    RUN_TEST(test_node_id_that_is_not_stored_is_gone_after_power_off);
    RUN_TEST(test_stored_node_id_is_there_after_power_on_and_reset_and_nothing_else_is_stored);
    RUN_TEST(test_store_that_fails_has_error_code_2);
    RUN_TEST(test_node_without_id_says_nothing_but_by_lss);
    RUN_TEST(test_node_with_an_id_takes_no_part_in_what_is_for_those_without);
    RUN_TEST(test_node_without_id_boots_when_it_gets_one_and_leaves_the_configuration_state);
    RUN_TEST(test_node_without_id_boots_by_reset_when_it_has_got_one);
    RUN_TEST(test_fastscan_finds_the_address_bit_by_bit);
    RUN_TEST(test_fastscan_out_of_range_or_of_another_part_is_ignored);
    RUN_TEST(test_bit_rate_by_its_table_and_only_what_the_port_can);
    RUN_TEST(test_activated_bit_rate_comes_after_one_delay_and_the_node_is_silent_for_two);
    RUN_TEST(test_bit_rate_by_parameter_is_checked_with_the_port);
    RUN_TEST(test_saved_parameters_are_there_after_power_on_and_after_reset);
    RUN_TEST(test_sub_indices_save_and_restore_their_part);
    RUN_TEST(test_restored_defaults_act_at_the_next_reset_and_leave_the_node_id);
    RUN_TEST(test_wrong_signature_power_and_a_failing_flash_have_their_abort_codes);
    RUN_TEST(test_damaged_store_is_reported_the_drive_works_with_defaults_and_can_save_again);
    RUN_TEST(test_stored_parameters_that_do_not_fit_together_are_reported_and_not_used);
    RUN_TEST(test_warning_of_stored_parameters_that_do_not_fit_stays_until_they_are_replaced);
    RUN_TEST(test_warning_of_the_store_ends_when_the_parameters_are_saved_or_restored_and_not_before);
    RUN_TEST(test_stored_parameter_out_of_range_is_reported_and_the_others_are_used);
    RUN_TEST(test_stored_value_of_another_area_out_of_range_is_reported_until_it_is_replaced);
    RUN_TEST(test_sets_written_are_counted_over_power_off_and_every_way_of_writing);
    RUN_TEST(test_what_is_stored_already_is_not_written_again);
    RUN_TEST(test_storm_of_saves_is_let_through_once_a_minute);
    RUN_TEST(test_erasures_are_counted_over_power_off_and_warned_of);
    return UNITY_END();
}
