/* SPDX-License-Identifier: Apache-2.0 */
/* LSS slave, byte by byte as in CiA 305. test_settings.c tests it with the flash and the whole firmware. */
#include "test_canopen_bus.h"

static struct bus bus;
static unsigned can_do[] = {1000, 500, 250, 125, 50, 20, 10, 800}, can_do_count; /* kbit/s that the port can */
static unsigned rate, changes; /* kbit/s it was changed to, 0: not yet; how often */
static bool stuck;             /* the port refuses to change it */

static bool can_bitrate(void *ctx, uint16_t kbitps, bool change)
{
    (void)ctx;
    for (unsigned i = 0; i < can_do_count; i++) {
        if (can_do[i] == kbitps) {
            rate = change && !stuck ? kbitps : rate;
            changes += change ? 1u : 0u;
            return !change || !stuck;
        }
    }
    return false;
}

static uint8_t load(void *ctx, bool communication_only)
{
    const struct bus *b = ctx;
    (void)communication_only;
    return b->od.node.id;
}

/* Power on with this id, at 1 Mbit/s. */
static void start(uint8_t id)
{
    bus_start(&bus);
    can_do_count = 7;
    stuck = false;
    bus.hal.can_bitrate = can_bitrate;
    bus.od.node.id = id;
    bus.od.identity.serial = 0xC0FFEE05;
    struct co_config config = bus.node.config;
    config.node_id = id;
    config.hooks.load = load;
    co_init(&bus.node, &config);
    rate = changes = 0;
    bus_clear(&bus);
}

void setUp(void)
{
    start(NODE);
}

void tearDown(void)
{
}

/* One LSS request, and its only answer ("": none). */
static void lss(const char *request, const char *answer)
{
    bus_clear(&bus);
    bus_give(&bus, 0x7E5, request);
    TEST_ASSERT_EQUAL_UINT_MESSAGE(answer[0] != '\0' ? 1 : 0, bus.count, request);
    if (answer[0] != '\0') {
        bus_expect(&bus, 0, 0x7E4, answer);
    }
}

static void configure(void)
{
    lss("04 01 00 00 00 00 00 00", "");
}

static bool configuring(void)
{
    bus_clear(&bus);
    bus_give(&bus, 0x7E5, "5E 00 00 00 00 00 00 00");
    return bus.count == 1;
}

/* ---- frames and states ---- */

static void test_request_that_is_not_eight_bytes_long_is_ignored(void)
{
    lss("04 01 00 00 00 00 00", "");
    TEST_ASSERT_FALSE(configuring());
    configure();
    lss("5E 00 00 00 00 00 00", "");
    lss("5E 00 00 00 00 00 00 00", "5E 05 00 00 00 00 00 00");
}

static void test_answers_are_eight_bytes_long_and_reserved_bytes_are_0(void)
{
    configure();
    lss("11 09 FF FF FF FF FF FF", "11 00 00 00 00 00 00 00");
    lss("13 00 02 FF FF FF FF FF", "13 00 00 00 00 00 00 00");
    lss("5A FF FF FF FF FF FF FF", "5A 00 00 00 00 00 00 00");
    lss("5B FF FF FF FF FF FF FF", "5B 01 00 00 00 00 00 00");
    lss("5C FF FF FF FF FF FF FF", "5C 00 00 01 00 00 00 00");
    lss("5D FF FF FF FF FF FF FF", "5D 05 EE FF C0 00 00 00");
    lss("17 FF FF FF FF FF FF FF", "17 02 00 00 00 00 00 00"); /* nothing to store to */
}

static void test_switch_to_a_state_that_does_not_exist_is_ignored(void)
{
    lss("04 02 00 00 00 00 00 00", "");
    TEST_ASSERT_FALSE(configuring());
    configure();
    lss("04 02 00 00 00 00 00 00", "");
    TEST_ASSERT_TRUE(configuring());
    lss("04 00 00 00 00 00 00 00", "");
    TEST_ASSERT_FALSE(configuring());
}

/* What the node answers in the configuration state is exactly what CiA 305 defines; the rest is reserved. */
static void test_reserved_commands_have_no_answer_and_change_nothing(void)
{
    for (unsigned command = 0; command < 256; command++) {
        const bool defined = command == 0x04 || command == 0x11 || command == 0x13 || command == 0x15 ||
                             command == 0x17 || (command >= 0x40 && command <= 0x43) ||
                             (command >= 0x46 && command <= 0x4C) || command == 0x51 ||
                             (command >= 0x5A && command <= 0x5E);
        if (!defined) {
            start(NODE);
            configure();
            const struct od_data before = bus.od;
            char request[32];
            (void)snprintf(request, sizeof request, "%02X 03 02 00 00 00 00 00", command);
            lss(request, "");
            TEST_ASSERT_EQUAL_MEMORY(&before, &bus.od, sizeof before);
            TEST_ASSERT_TRUE(configuring());
        }
    }
}

static void test_lss_works_in_every_nmt_state(void)
{
    static const char *const commands[] = {"01 00", "02 00", "80 00"};
    for (unsigned i = 0; i < sizeof commands / sizeof commands[0]; i++) {
        bus_give(&bus, 0, commands[i]);
        configure();
        lss("5E 00 00 00 00 00 00 00", "5E 05 00 00 00 00 00 00");
        lss("04 00 00 00 00 00 00 00", "");
    }
}

static void test_reset_communication_leads_to_the_waiting_state(void)
{
    configure();
    bus_give(&bus, 0, "82 05");
    TEST_ASSERT_FALSE(configuring());
}

/* ---- selective switch, identify: the parts come in order ---- */

static void test_selection_is_answered_at_its_last_part_alone(void)
{
    lss("40 00 00 00 00 00 00 00", "");
    lss("41 01 00 00 00 00 00 00", "");
    lss("42 00 00 01 00 00 00 00", "");
    TEST_ASSERT_FALSE(configuring());
    lss("43 05 EE FF C0 00 00 00", "44 00 00 00 00 00 00 00");
    TEST_ASSERT_TRUE(configuring());
    lss("04 00 00 00 00 00 00 00", "");
    lss("41 01 00 00 00 00 00 00", ""); /* what comes without the vendor is no selection */
    lss("42 00 00 01 00 00 00 00", "");
    lss("43 05 EE FF C0 00 00 00", "");
    TEST_ASSERT_FALSE(configuring());
}

static void test_selection_of_another_node_in_between_ends_it_and_a_new_one_begins_with_the_vendor(void)
{
    lss("40 00 00 00 00 00 00 00", "");
    lss("41 01 00 00 00 00 00 00", "");
    lss("40 07 00 00 00 00 00 00", ""); /* another vendor's */
    lss("41 01 00 00 00 00 00 00", "");
    lss("42 00 00 01 00 00 00 00", "");
    lss("43 05 EE FF C0 00 00 00", "");
    lss("40 00 00 00 00 00 00 00", "");
    lss("40 00 00 00 00 00 00 00", ""); /* the selection begins anew */
    lss("41 01 00 00 00 00 00 00", "");
    lss("42 00 00 01 00 00 00 00", "");
    lss("43 05 EE FF C0 00 00 00", "44 00 00 00 00 00 00 00");
}

static void test_selection_with_a_part_left_out_or_repeated_is_none(void)
{
    lss("40 00 00 00 00 00 00 00", "");
    lss("42 00 00 01 00 00 00 00", "");
    lss("43 05 EE FF C0 00 00 00", "");
    lss("40 00 00 00 00 00 00 00", "");
    lss("41 01 00 00 00 00 00 00", "");
    lss("41 01 00 00 00 00 00 00", "");
    lss("42 00 00 01 00 00 00 00", "");
    lss("43 05 EE FF C0 00 00 00", "");
}

static void identify(const uint32_t value[6], bool mine)
{
    for (uint8_t step = 0; step < 6; step++) {
        struct can_frame request = {.id = 0x7E5, .len = 8, .data = {(uint8_t)(0x46 + step)}};
        co_put(&request.data[1], value[step], 4);
        bus_clear(&bus);
        co_receive(&bus.node, &request);
        TEST_ASSERT_EQUAL_UINT(step == 5 && mine ? 1 : 0, bus.count);
    }
    if (mine) {
        bus_expect(&bus, 0, 0x7E4, "4F 00 00 00 00 00 00 00");
    }
}

/* Vendor, product, lower and upper bound of revision (00010000h) and serial number (C0FFEE05h) */
static void test_slave_identifies_itself_within_the_bounds_and_on_them(void)
{
    identify((const uint32_t[]){0, 1, 0x10000, 0x10000, 0xC0FFEE05, 0xC0FFEE05}, true);
    identify((const uint32_t[]){0, 1, 0x0FFFF, 0x10001, 0xC0FFEE04, 0xC0FFEE06}, true);
    identify((const uint32_t[]){0, 1, 0, 0xFFFFFFFF, 0, 0xFFFFFFFF}, true);
    identify((const uint32_t[]){0, 1, 0x10001, 0xFFFFFFFF, 0, 0xFFFFFFFF}, false);
    identify((const uint32_t[]){0, 1, 0, 0x0FFFF, 0, 0xFFFFFFFF}, false);
    identify((const uint32_t[]){0, 1, 0, 0xFFFFFFFF, 0xC0FFEE06, 0xFFFFFFFF}, false);
    identify((const uint32_t[]){0, 1, 0, 0xFFFFFFFF, 0, 0xC0FFEE04}, false);
    identify((const uint32_t[]){0, 0, 0, 0xFFFFFFFF, 0, 0xFFFFFFFF}, false);
    identify((const uint32_t[]){0, 2, 0, 0xFFFFFFFF, 0, 0xFFFFFFFF}, false);
    identify((const uint32_t[]){1, 1, 0, 0xFFFFFFFF, 0, 0xFFFFFFFF}, false);
    TEST_ASSERT_FALSE(configuring()); /* to be identified is not to be selected */
}

static void test_steps_of_identify_out_of_order_or_without_the_vendor_are_none(void)
{
    static const char *const steps[] = {"46 00 00 00 00 00 00 00", "47 01 00 00 00 00 00 00",
                                        "49 FF FF FF FF 00 00 00", "48 00 00 00 00 00 00 00",
                                        "4A 00 00 00 00 00 00 00", "4B FF FF FF FF 00 00 00"};
    for (unsigned i = 0; i < 6; i++) {
        lss(steps[i], "");
    }
    identify((const uint32_t[]){0, 1, 0, 0xFFFFFFFF, 0, 0xFFFFFFFF}, true);
    for (unsigned i = 1; i < 6; i++) {
        lss(steps[i == 2 ? 3 : i == 3 ? 2 : i], ""); /* in order */
    }
}

/* ---- nodes without id ---- */

static void test_node_without_id_or_hooks_waits_for_lss(void)
{
    const struct co_config config = {.od = &bus.od, .hal = &bus.hal, .node_id = OD_UNCONFIGURED};
    bus.od.node.id = OD_UNCONFIGURED;
    co_init(&bus.node, &config);
    TEST_ASSERT_EQUAL(CO_INITIALISING, co_nmt_state(&bus.node));
    bus_run_ms(&bus, 500);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    lss("4C 00 00 00 00 00 00 00", "50 00 00 00 00 00 00 00");
}

static void test_both_resets_boot_a_node_that_has_got_an_id(void)
{
    static const char *const resets[] = {"81 00", "82 00"};
    for (unsigned i = 0; i < 2; i++) {
        start(OD_UNCONFIGURED);
        configure();
        lss("11 01 00 00 00 00 00 00", "11 00 00 00 00 00 00 00");
        bus_clear(&bus);
        bus_give(&bus, 0, resets[i]);
        TEST_ASSERT_EQUAL_UINT(1, bus.count);
        bus_expect(&bus, 0, 0x701, "00");
    }
}

static void test_node_without_id_stays_so_when_it_is_switched_back_without_one(void)
{
    start(OD_UNCONFIGURED);
    configure();
    const unsigned resets = bus.resets;
    lss("04 00 00 00 00 00 00 00", "");
    TEST_ASSERT_EQUAL_UINT(resets, bus.resets);
    TEST_ASSERT_EQUAL(CO_INITIALISING, co_nmt_state(&bus.node));
    lss("4C 00 00 00 00 00 00 00", "50 00 00 00 00 00 00 00");
}

static void test_node_with_an_id_is_not_reset_when_it_is_switched_back(void)
{
    configure();
    lss("11 09 00 00 00 00 00 00", "11 00 00 00 00 00 00 00");
    lss("04 00 00 00 00 00 00 00", "");
    TEST_ASSERT_EQUAL_UINT(0, bus.resets);
    TEST_ASSERT_EQUAL(CO_PRE_OPERATIONAL, co_nmt_state(&bus.node));
}

static void test_fastscan_is_for_nodes_that_are_neither_configured_nor_found(void)
{
    static const char scan[] = "51 00 00 00 00 80 00 00", found[] = "4F 00 00 00 00 00 00 00";
    lss(scan, ""); /* it has an id */
    start(OD_UNCONFIGURED);
    lss(scan, found);
    configure();
    lss(scan, "");
    lss("11 07 00 00 00 00 00 00", "11 00 00 00 00 00 00 00");
    lss(scan, "");
    lss("4C 00 00 00 00 00 00 00", "50 00 00 00 00 00 00 00");
}

static void test_fastscan_compares_from_the_checked_bit_up(void)
{
    static const char found[] = "4F 00 00 00 00 00 00 00";
    start(OD_UNCONFIGURED);
    lss("51 00 00 00 00 80 00 00", found);
    lss("51 00 00 00 00 1F 00 00", found); /* bit 31 of the vendor: 0 */
    lss("51 00 00 00 80 1F 00 00", "");
    lss("51 FF 00 00 00 08 00 00", found); /* bits below the checked one may differ */
    lss("51 00 01 00 00 08 00 00", "");
    lss("51 00 00 00 00 20 00 00", ""); /* there is no bit 32, */
    lss("51 00 00 00 00 00 04 00", ""); /* no part 4, */
    lss("51 00 00 00 00 00 00 04", ""); /* here neither */
    lss("51 01 00 00 00 00 01 02", ""); /* product: not its turn */
}

static void test_fastscan_ends_in_the_configuration_state_and_can_begin_anew_before(void)
{
    static const char found[] = "4F 00 00 00 00 00 00 00";
    start(OD_UNCONFIGURED);
    lss("51 00 00 00 00 80 00 00", found);
    lss("51 00 00 00 00 00 00 01", found);
    lss("51 01 00 00 00 00 01 02", found);
    lss("51 00 00 00 00 80 00 00", found); /* anew */
    lss("51 01 00 00 00 00 01 02", "");
    lss("51 00 00 00 00 00 00 01", found);
    lss("51 01 00 00 00 00 01 02", found);
    lss("51 00 00 01 00 00 02 03", found);
    TEST_ASSERT_FALSE(configuring());
    lss("51 05 EE FF C0 00 03 00", found);
    TEST_ASSERT_TRUE(configuring());
}

/* ---- bit timing, store ---- */

static void test_every_bit_rate_of_table_0_has_its_number(void)
{
    static const struct {
        const char *request;
        unsigned kbitps;
    } table[] = {{"13 00 00 00 00 00 00 00", 1000}, {"13 00 02 00 00 00 00 00", 500}, {"13 00 03 00 00 00 00 00", 250},
                 {"13 00 04 00 00 00 00 00", 125},  {"13 00 06 00 00 00 00 00", 50},  {"13 00 07 00 00 00 00 00", 20},
                 {"13 00 08 00 00 00 00 00", 10}};
    configure();
    for (unsigned i = 0; i < sizeof table / sizeof table[0]; i++) {
        lss(table[i].request, "13 00 00 00 00 00 00 00");
        TEST_ASSERT_EQUAL_UINT16(table[i].kbitps, bus.od.node.bitrate);
        TEST_ASSERT_EQUAL_UINT(0, changes); /* not before it is activated */
    }
    lss("13 00 01 00 00 00 00 00", "13 01 00 00 00 00 00 00"); /* 800: the port cannot */
    lss("13 00 05 00 00 00 00 00", "13 01 00 00 00 00 00 00"); /* reserved */
    lss("13 00 09 00 00 00 00 00", "13 01 00 00 00 00 00 00"); /* automatic */
    lss("13 01 00 00 00 00 00 00", "13 01 00 00 00 00 00 00"); /* table 1 */
    TEST_ASSERT_EQUAL_UINT16(10, bus.od.node.bitrate);
    can_do_count = 8;
    lss("13 00 01 00 00 00 00 00", "13 00 00 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT16(800, bus.od.node.bitrate);
}

static void test_bit_rate_activated_without_delay_acts_at_once(void)
{
    configure();
    lss("13 00 04 00 00 00 00 00", "13 00 00 00 00 00 00 00");
    lss("15 00 00 00 00 00 00 00", "");
    TEST_ASSERT_EQUAL_UINT(125, rate);
    lss("5E 00 00 00 00 00 00 00", "5E 05 00 00 00 00 00 00"); /* no delay: the answer comes at once */
}

static void test_node_is_silent_for_both_delays_and_the_rate_changes_between_them(void)
{
    bus.od.heartbeat_producer = 1;
    configure();
    lss("13 00 03 00 00 00 00 00", "13 00 00 00 00 00 00 00");
    lss("15 2C 01 00 00 00 00 00", ""); /* 300 ms */
    bus_run_ms(&bus, 299);
    TEST_ASSERT_EQUAL_UINT(0, rate);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(250, rate);
    TEST_ASSERT_EQUAL_UINT(1, changes);
    bus_run_ms(&bus, 299);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_TRUE(bus.count > 0);
    TEST_ASSERT_EQUAL_UINT(1, changes);
}

static void test_longest_delay_passes_in_full(void)
{
    bus.od.heartbeat_producer = 1;
    configure();
    lss("13 00 03 00 00 00 00 00", "13 00 00 00 00 00 00 00");
    lss("15 FF FF 00 00 00 00 00", "");
    bus_run_ms(&bus, 65534);
    TEST_ASSERT_EQUAL_UINT(0, rate);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_EQUAL_UINT(250, rate);
    bus_run_ms(&bus, 65534);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_run_ms(&bus, 1);
    TEST_ASSERT_TRUE(bus.count > 0);
}

/* Frames in the queue would come late, and tell of a state that is over. */
static void test_frames_that_waited_for_the_old_bit_rate_are_dropped_with_it(void)
{
    configure();
    lss("13 00 03 00 00 00 00 00", "13 00 00 00 00 00 00 00");
    lss("15 0A 00 00 00 00 00 00", "");
    bus_give(&bus, 0x605, "40 00 10 00 00 00 00 00");
    bus_run_ms(&bus, 9);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
    bus_run_ms(&bus, 1);
    bus_give(&bus, 0x605, "40 01 10 00 00 00 00 00"); /* a request at the new one */
    bus_run_ms(&bus, 11);
    TEST_ASSERT_EQUAL_UINT(1, bus.count);
    bus_expect(&bus, 0, 0x585, "4F 01 10 00 00 00 00 00");
}

static void test_bit_rate_that_is_in_use_or_refused_by_the_port_changes_nothing(void)
{
    configure();
    bus_give(&bus, 0, "82 05");
    TEST_ASSERT_EQUAL_UINT(0, changes); /* the same as before the reset */
    configure();
    lss("15 00 00 00 00 00 00 00", "");
    TEST_ASSERT_EQUAL_UINT(0, changes);
    lss("13 00 02 00 00 00 00 00", "13 00 00 00 00 00 00 00");
    stuck = true;
    lss("15 05 00 00 00 00 00 00", "");
    bus_give(&bus, 0x605, "40 01 10 00 00 00 00 00");
    bus_run_ms(&bus, 10);
    TEST_ASSERT_EQUAL_UINT(0, rate);
    TEST_ASSERT_EQUAL_UINT(1, bus.count); /* still at the old one: the queue is not dropped */
    stuck = false;
    lss("15 00 00 00 00 00 00 00", ""); /* tried again */
    TEST_ASSERT_EQUAL_UINT(500, rate);
}

static void test_port_that_cannot_the_stored_rate_keeps_its_own_at_reset(void)
{
    bus.od.node.bitrate = 800;
    bus_give(&bus, 0, "82 05");
    TEST_ASSERT_EQUAL_UINT(0, changes);
    bus_expect(&bus, 0, 0x705, "00");
    bus.od.node.bitrate = 125;
    bus_give(&bus, 0, "82 05");
    TEST_ASSERT_EQUAL_UINT(125, rate);
}

static void test_what_the_application_refuses_by_sdo_it_refuses_by_lss_and_bit_timing_is_not_activated(void)
{
    configure();
    lss("13 00 03 00 00 00 00 00", "13 00 00 00 00 00 00 00");
    TEST_ASSERT_EQUAL_HEX16(0x2001, bus.written.index);
    TEST_ASSERT_EQUAL_UINT(2, bus.written.sub);
    bus.refuse = 0x08000022;
    lss("11 09 00 00 00 00 00 00", "11 FF 01 00 00 00 00 00");
    lss("11 20 00 00 00 00 00 00", "11 01 00 00 00 00 00 00"); /* out of range */
    lss("13 00 02 00 00 00 00 00", "13 FF 01 00 00 00 00 00");
    lss("15 00 00 00 00 00 00 00", "");
    lss("15 0A 00 00 00 00 00 00", "");
    lss("5E 00 00 00 00 00 00 00", "5E 05 00 00 00 00 00 00"); /* not silent */
    TEST_ASSERT_EQUAL_UINT(0, changes);
    TEST_ASSERT_EQUAL_UINT(NODE, bus.od.node.id);
    TEST_ASSERT_EQUAL_UINT(250, bus.od.node.bitrate);
    bus.refuse = 0;
    lss("15 00 00 00 00 00 00 00", "");
    TEST_ASSERT_EQUAL_UINT(250, rate);
}

static bool stores;
static unsigned stored;

static bool store_node(void *ctx)
{
    (void)ctx;
    stored++;
    return stores;
}

static void test_store_says_whether_it_could(void)
{
    struct co_config config = bus.node.config;
    config.hooks.store_node = store_node;
    co_init(&bus.node, &config);
    stored = 0;
    lss("17 00 00 00 00 00 00 00", "");
    TEST_ASSERT_EQUAL_UINT(0, stored); /* not in the configuration state */
    configure();
    stores = true;
    lss("17 00 00 00 00 00 00 00", "17 00 00 00 00 00 00 00");
    stores = false;
    lss("17 00 00 00 00 00 00 00", "17 02 00 00 00 00 00 00");
    TEST_ASSERT_EQUAL_UINT(2, stored);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_request_that_is_not_eight_bytes_long_is_ignored);
    RUN_TEST(test_answers_are_eight_bytes_long_and_reserved_bytes_are_0);
    RUN_TEST(test_switch_to_a_state_that_does_not_exist_is_ignored);
    RUN_TEST(test_reserved_commands_have_no_answer_and_change_nothing);
    RUN_TEST(test_lss_works_in_every_nmt_state);
    RUN_TEST(test_reset_communication_leads_to_the_waiting_state);
    RUN_TEST(test_selection_is_answered_at_its_last_part_alone);
    RUN_TEST(test_selection_of_another_node_in_between_ends_it_and_a_new_one_begins_with_the_vendor);
    RUN_TEST(test_selection_with_a_part_left_out_or_repeated_is_none);
    RUN_TEST(test_slave_identifies_itself_within_the_bounds_and_on_them);
    RUN_TEST(test_steps_of_identify_out_of_order_or_without_the_vendor_are_none);
    RUN_TEST(test_node_without_id_or_hooks_waits_for_lss);
    RUN_TEST(test_both_resets_boot_a_node_that_has_got_an_id);
    RUN_TEST(test_node_without_id_stays_so_when_it_is_switched_back_without_one);
    RUN_TEST(test_node_with_an_id_is_not_reset_when_it_is_switched_back);
    RUN_TEST(test_fastscan_is_for_nodes_that_are_neither_configured_nor_found);
    RUN_TEST(test_fastscan_compares_from_the_checked_bit_up);
    RUN_TEST(test_fastscan_ends_in_the_configuration_state_and_can_begin_anew_before);
    RUN_TEST(test_every_bit_rate_of_table_0_has_its_number);
    RUN_TEST(test_bit_rate_activated_without_delay_acts_at_once);
    RUN_TEST(test_node_is_silent_for_both_delays_and_the_rate_changes_between_them);
    RUN_TEST(test_longest_delay_passes_in_full);
    RUN_TEST(test_frames_that_waited_for_the_old_bit_rate_are_dropped_with_it);
    RUN_TEST(test_bit_rate_that_is_in_use_or_refused_by_the_port_changes_nothing);
    RUN_TEST(test_port_that_cannot_the_stored_rate_keeps_its_own_at_reset);
    RUN_TEST(test_what_the_application_refuses_by_sdo_it_refuses_by_lss_and_bit_timing_is_not_activated);
    RUN_TEST(test_store_says_whether_it_could);
    return UNITY_END();
}
