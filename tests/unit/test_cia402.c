/* SPDX-License-Identifier: Apache-2.0 */
/* The state machine of one axis against the tables of CiA 402-2 (commands of the controlword, states of the statusword). */
#include "drive/cia402.h"
#include "unity.h"

enum {
    DISABLE_VOLTAGE = 0x00,
    QUICK_STOP = 0x02,
    SHUTDOWN = 0x06,
    SWITCH_ON = 0x07,
    ENABLE = 0x0F,
    FAULT_RESET = 0x80
};
enum { COMMANDS = 5, STATES = 7 };

#define SOD CIA402_SWITCH_ON_DISABLED
#define RTSO CIA402_READY_TO_SWITCH_ON
#define SO CIA402_SWITCHED_ON
#define OE CIA402_OPERATION_ENABLED
#define QSA CIA402_QUICK_STOP_ACTIVE
#define FRA CIA402_FAULT_REACTION_ACTIVE
#define FLT CIA402_FAULT

static const uint16_t commands[COMMANDS] = {DISABLE_VOLTAGE, QUICK_STOP, SHUTDOWN, SWITCH_ON, ENABLE};
static struct cia402 axis;

void setUp(void)
{
    cia402_init(&axis);
}

void tearDown(void)
{
}

static void bring_to(enum cia402_state state)
{
    cia402_init(&axis);
    if (state == SOD) {
        return;
    }
    cia402_command(&axis, SHUTDOWN, true);
    if (state == RTSO) {
        return;
    }
    cia402_command(&axis, SWITCH_ON, true);
    if (state == SO) {
        return;
    }
    cia402_command(&axis, ENABLE, true);
    if (state == QSA) {
        cia402_command(&axis, QUICK_STOP, true);
    } else if (state == FRA || state == FLT) {
        cia402_fault(&axis, state == FRA);
    }
    TEST_ASSERT_EQUAL(state, axis.state);
}

/* A master that knows a state from before a reset must not be taken for one that knows the state after it. */
static void test_number_of_a_state_after_a_reset_is_none_from_before(void)
{
    bring_to(SO);
    const uint32_t before = axis.changes;
    cia402_init(&axis);
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_TRUE((int32_t)(axis.changes - before) > 0);
        cia402_command(&axis, SHUTDOWN, true);
    }
}

static void test_power_on_leads_to_switch_on_disabled(void)
{
    TEST_ASSERT_EQUAL(SOD, axis.state);
    TEST_ASSERT_FALSE(cia402_powered(&axis));
    TEST_ASSERT_FALSE(cia402_enabled(&axis));
    TEST_ASSERT_EQUAL_UINT8(2, axis.quick_stop); /* the default of 605Ah */
}

/* A command that answers a statusword from before a reset must not count after it (command_guard.h). */
static void test_reset_is_a_change_of_state_whatever_the_state_before(void)
{
    for (int i = 0; i < 3; i++) {
        const uint32_t before = axis.changes;
        cia402_init(&axis);
        TEST_ASSERT_TRUE(axis.changes != before);
    }
}

static void test_every_command_in_every_state_leads_where_cia_402_says(void)
{
    static const struct {
        enum cia402_state moving[COMMANDS], standing[COMMANDS]; /* at once, and once the path stands */
    } expected[STATES] = {
        /*         00   02    06    07   0F           00   02   06    07   0F */
        [SOD] = {{SOD, SOD, RTSO, SOD, SOD}, {SOD, SOD, RTSO, SOD, SOD}},
        [RTSO] = {{SOD, SOD, RTSO, SO, OE}, {SOD, SOD, RTSO, SO, OE}},
        [SO] = {{SOD, SOD, RTSO, SO, OE}, {SOD, SOD, RTSO, SO, OE}},
        [OE] = {{SOD, QSA, OE, OE, OE}, {SOD, SOD, RTSO, SO, OE}},
        [QSA] = {{SOD, QSA, QSA, QSA, QSA}, {SOD, SOD, SOD, SOD, SOD}},
        [FRA] = {{FRA, FRA, FRA, FRA, FRA}, {FLT, FLT, FLT, FLT, FLT}},
        [FLT] = {{FLT, FLT, FLT, FLT, FLT}, {FLT, FLT, FLT, FLT, FLT}},
    };
    for (unsigned state = 0; state < STATES; state++) {
        for (unsigned i = 0; i < COMMANDS; i++) {
            bring_to((enum cia402_state)state);
            cia402_command(&axis, commands[i], true);
            TEST_ASSERT_EQUAL_MESSAGE(expected[state].moving[i], axis.state, "at once");
            cia402_standstill(&axis);
            TEST_ASSERT_EQUAL_MESSAGE(expected[state].standing[i], axis.state, "once it stands");
        }
    }
}

static void test_quick_stop_options_say_what_comes_after_it(void)
{
    static const struct {
        int16_t option;
        enum cia402_state at_once, standing;
    } rows[] = {{0, SOD, SOD}, {1, QSA, SOD}, {2, QSA, SOD}, {5, QSA, QSA}, {6, QSA, QSA}};
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        bring_to(OE);
        axis.quick_stop = rows[i].option;
        cia402_command(&axis, QUICK_STOP, true);
        TEST_ASSERT_EQUAL(rows[i].at_once, axis.state);
        cia402_standstill(&axis);
        TEST_ASSERT_EQUAL(rows[i].standing, axis.state);
    }
}

static void test_quick_stop_that_stays_is_left_by_enable_operation_or_by_the_power_alone(void)
{
    static const enum cia402_state left[COMMANDS] = {SOD, QSA, QSA, QSA, OE};
    for (unsigned i = 0; i < COMMANDS; i++) {
        bring_to(OE);
        axis.quick_stop = 6;
        cia402_command(&axis, QUICK_STOP, true);
        cia402_command(&axis, commands[i], false);
        TEST_ASSERT_EQUAL_MESSAGE(i == 0 ? SOD : QSA, axis.state, "while it may not be enabled");
        cia402_command(&axis, commands[i], true);
        TEST_ASSERT_EQUAL(left[i], axis.state);
    }
    cia402_command(&axis, SWITCH_ON, true);
    cia402_standstill(&axis);
    TEST_ASSERT_EQUAL_MESSAGE(SO, axis.state, "enabled as ever");
}

static void test_stop_from_outside_powers_off_whatever_the_option(void)
{
    static const int16_t options[] = {0, 2, 6};
    for (unsigned i = 0; i < 3; i++) {
        for (int stopped = 0; stopped < 2; stopped++) {
            bring_to(OE);
            axis.quick_stop = options[i];
            if (stopped && options[i] != 0) {
                cia402_command(&axis, QUICK_STOP, true);
            }
            cia402_stop(&axis);
            TEST_ASSERT_EQUAL(QSA, axis.state);
            cia402_command(&axis, ENABLE, true);
            TEST_ASSERT_EQUAL(QSA, axis.state);
            cia402_standstill(&axis);
            TEST_ASSERT_EQUAL(SOD, axis.state);
        }
    }
    bring_to(SO);
    cia402_stop(&axis);
    TEST_ASSERT_EQUAL(SOD, axis.state);
}

static void test_bits_without_a_meaning_change_no_command(void)
{
    bring_to(OE);
    cia402_command(&axis, ENABLE | 0xFF70, true);
    TEST_ASSERT_EQUAL(OE, axis.state);
    TEST_ASSERT_TRUE(cia402_enabled(&axis));
}

static void test_fault_is_reset_by_a_rising_edge_only(void)
{
    bring_to(FLT);
    cia402_command(&axis, FAULT_RESET, true);
    TEST_ASSERT_EQUAL(SOD, axis.state);
    cia402_fault(&axis, false);
    cia402_command(&axis, FAULT_RESET, true); /* still set */
    TEST_ASSERT_EQUAL(FLT, axis.state);
    cia402_command(&axis, ENABLE, true);
    TEST_ASSERT_EQUAL(FLT, axis.state);
    cia402_command(&axis, FAULT_RESET | ENABLE, true);
    TEST_ASSERT_EQUAL(SOD, axis.state);
}

static void test_fault_can_be_reset_where_nothing_may_be_enabled(void)
{
    bring_to(FLT);
    cia402_command(&axis, FAULT_RESET, false);
    TEST_ASSERT_EQUAL(SOD, axis.state);
}

static void test_fault_reaction_cannot_be_reset(void)
{
    bring_to(FRA);
    cia402_command(&axis, FAULT_RESET, true);
    TEST_ASSERT_EQUAL(FRA, axis.state);
}

static void test_nothing_is_enabled_while_it_may_not_be(void)
{
    bring_to(RTSO);
    cia402_command(&axis, ENABLE, false);
    TEST_ASSERT_EQUAL(RTSO, axis.state);
    bring_to(SO);
    cia402_command(&axis, ENABLE, false);
    TEST_ASSERT_EQUAL(SO, axis.state);
    bring_to(OE);
    cia402_command(&axis, ENABLE, false); /* enabled already: stays */
    TEST_ASSERT_EQUAL(OE, axis.state);
}

static void test_fault_with_power_stops_first_where_the_path_can_be_held(void)
{
    bring_to(OE);
    cia402_fault(&axis, true);
    TEST_ASSERT_EQUAL(FRA, axis.state);
    bring_to(QSA);
    cia402_fault(&axis, true);
    TEST_ASSERT_EQUAL(FRA, axis.state);
    bring_to(OE);
    cia402_fault(&axis, false);
    TEST_ASSERT_EQUAL(FLT, axis.state);
}

static void test_fault_without_power_goes_to_fault_at_once(void)
{
    static const enum cia402_state off[] = {SOD, RTSO, SO};
    for (unsigned i = 0; i < 3; i++) {
        bring_to(off[i]);
        cia402_fault(&axis, true);
        TEST_ASSERT_EQUAL(FLT, axis.state);
    }
}

static void test_worse_fault_during_the_reaction_cuts_the_power(void)
{
    bring_to(FRA);
    cia402_fault(&axis, true);
    TEST_ASSERT_EQUAL(FRA, axis.state);
    cia402_fault(&axis, false);
    TEST_ASSERT_EQUAL(FLT, axis.state);
    cia402_fault(&axis, true);
    TEST_ASSERT_EQUAL(FLT, axis.state);
}

static void test_power_is_on_in_operation_enabled_and_while_stopping(void)
{
    static const bool on[STATES] = {[OE] = true, [QSA] = true, [FRA] = true};
    for (unsigned state = 0; state < STATES; state++) {
        bring_to((enum cia402_state)state);
        TEST_ASSERT_EQUAL(on[state], cia402_powered(&axis));
        TEST_ASSERT_EQUAL(state == OE, cia402_enabled(&axis));
    }
}

static void test_axis_that_is_to_leave_keeps_its_power_but_counts_as_enabled_no_more(void)
{
    bring_to(OE);
    cia402_command(&axis, SWITCH_ON, true);
    TEST_ASSERT_TRUE(cia402_powered(&axis));
    TEST_ASSERT_FALSE(cia402_enabled(&axis));
    cia402_command(&axis, SHUTDOWN, true); /* thinks again */
    cia402_standstill(&axis);
    TEST_ASSERT_EQUAL(RTSO, axis.state);
    bring_to(OE);
    cia402_command(&axis, SWITCH_ON, true);
    cia402_command(&axis, QUICK_STOP, true);
    TEST_ASSERT_EQUAL(QSA, axis.state);
}

static void test_statusword_of_each_state_has_the_bits_of_cia_402(void)
{
    static const uint16_t bits[STATES] = {/* of mask 6Fh: bit 5 is quick stop */
                                          [SOD] = 0x40, [RTSO] = 0x21, [SO] = 0x23, [OE] = 0x27,
                                          [QSA] = 0x07, [FRA] = 0x0F,  [FLT] = 0x08};
    for (unsigned state = 0; state < STATES; state++) {
        bring_to((enum cia402_state)state);
        TEST_ASSERT_EQUAL_HEX16(bits[state] | 1u << 4 | 1u << 9, cia402_statusword(&axis, true));
        TEST_ASSERT_EQUAL_HEX16(bits[state == OE ? SO : state] | 1u << 4 | 1u << 9, cia402_statusword(&axis, false));
    }
}

static void test_state_with_a_bit_turned_over_has_no_power_tells_a_fault_and_is_left_by_a_fault_only(void)
{
    static const enum cia402_state states[] = {OE, QSA, FRA, FLT};
    for (unsigned i = 0; i < sizeof states / sizeof states[0]; i++) {
        for (unsigned bit = 0; bit < 32; bit++) {
            bring_to(states[i]);
            axis.not_state ^= 1u << bit;
            TEST_ASSERT_FALSE(cia402_intact(&axis));
            TEST_ASSERT_FALSE(cia402_powered(&axis) || cia402_enabled(&axis));
            TEST_ASSERT_EQUAL_HEX16(0x0218, cia402_statusword(&axis, true));
            cia402_command(&axis, FAULT_RESET, true);
            cia402_command(&axis, DISABLE_VOLTAGE, true);
            cia402_command(&axis, ENABLE, true);
            cia402_stop(&axis);
            cia402_standstill(&axis);
            TEST_ASSERT_EQUAL(states[i], axis.state);
            TEST_ASSERT_FALSE(cia402_intact(&axis));
            cia402_fault(&axis, true);
            TEST_ASSERT_TRUE(cia402_intact(&axis));
            TEST_ASSERT_EQUAL(FLT, axis.state);
        }
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_number_of_a_state_after_a_reset_is_none_from_before);
    RUN_TEST(test_power_on_leads_to_switch_on_disabled);
    RUN_TEST(test_reset_is_a_change_of_state_whatever_the_state_before);
    RUN_TEST(test_every_command_in_every_state_leads_where_cia_402_says);
    RUN_TEST(test_quick_stop_options_say_what_comes_after_it);
    RUN_TEST(test_quick_stop_that_stays_is_left_by_enable_operation_or_by_the_power_alone);
    RUN_TEST(test_stop_from_outside_powers_off_whatever_the_option);
    RUN_TEST(test_bits_without_a_meaning_change_no_command);
    RUN_TEST(test_fault_is_reset_by_a_rising_edge_only);
    RUN_TEST(test_fault_can_be_reset_where_nothing_may_be_enabled);
    RUN_TEST(test_fault_reaction_cannot_be_reset);
    RUN_TEST(test_nothing_is_enabled_while_it_may_not_be);
    RUN_TEST(test_fault_with_power_stops_first_where_the_path_can_be_held);
    RUN_TEST(test_fault_without_power_goes_to_fault_at_once);
    RUN_TEST(test_worse_fault_during_the_reaction_cuts_the_power);
    RUN_TEST(test_power_is_on_in_operation_enabled_and_while_stopping);
    RUN_TEST(test_axis_that_is_to_leave_keeps_its_power_but_counts_as_enabled_no_more);
    RUN_TEST(test_statusword_of_each_state_has_the_bits_of_cia_402);
    RUN_TEST(test_state_with_a_bit_turned_over_has_no_power_tells_a_fault_and_is_left_by_a_fault_only);
    return UNITY_END();
}
