/* SPDX-License-Identifier: Apache-2.0 */
/* test_port_main_loop.c: the complete firmware of the STM32F405 on simulated registers. The test is the master at the
 * mailboxes of bxCAN, and it moves pins and timers. Every fault ends with safe outputs and is reported.
 */
#include <string.h>

#include "chip.h"
#include "port/stm32f405/can.h"
#include "port/stm32f405/clock.h"
#include "port/stm32f405/crash.h"
#include "port/stm32f405/main_loop.h"
#include "port/stm32f405/supply.h"
#include "unity.h"

enum { MAILBOXES_EMPTY = 7 * CAN_TSR_TME0, SENT_MAX = 64 };

static struct {
    uint8_t sdo[8];
    bool sdo_answered, listening;
    uint16_t emcy[SENT_MAX];
    unsigned emcys;
    uint16_t statusword;
} master;

void tearDown(void)
{
}

/* The master receives a frame. */
static void master_receives(const struct can_mailbox *box)
{
    const uint32_t id = box->IR >> CAN_IR_STID;
    if (id == 0x581) {
        for (unsigned i = 0; i < 8; i++) {
            master.sdo[i] = (uint8_t)((i < 4 ? box->DLR : box->DHR) >> 8 * (i % 4));
        }
        master.sdo_answered = true;
    } else if (id == 0x081 && master.emcys < SENT_MAX) {
        master.emcy[master.emcys++] = (uint16_t)box->DLR;
    } else if (id == 0x181) {
        master.statusword = (uint16_t)box->DLR;
    }
}

/* The bus carries the frames in the mailboxes. */
static void acknowledge(void)
{
    for (bool sent = true; sent;) {
        sent = false;
        chip.can1.TSR = MAILBOXES_EMPTY;
        can_tx_irq();
        for (unsigned i = 0; i < 3; i++) {
            if ((chip.can1.TX[i].IR & CAN_IR_TXRQ) != 0) {
                master_receives(&chip.can1.TX[i]);
                chip.can1.TX[i].IR = 0;
                sent = true;
            }
        }
    }
}

static void ticks(unsigned n)
{
    for (unsigned i = 0; i < n; i++) {
        tick_irq();
        main_loop_pass();
        if (master.listening) {
            acknowledge();
        }
    }
}

/* The master sends a frame to the drive. */
static void master_sends(uint32_t id, uint8_t len, uint32_t low, uint32_t high)
{
    chip.can1.RX[0] = (struct can_mailbox){.IR = id << CAN_IR_STID, .DTR = len, .DLR = low, .DHR = high};
    chip.can1.RF0R = 1;
    can_rx_irq();
    ticks(1);
}

static uint32_t read_object(uint16_t index, uint8_t sub)
{
    master.sdo_answered = false;
    master_sends(0x601, 8, 0x40u | (uint32_t)index << 8 | (uint32_t)sub << 24, 0);
    ticks(20);
    TEST_ASSERT_TRUE_MESSAGE(master.sdo_answered, "no SDO answer");
    TEST_ASSERT_NOT_EQUAL_HEX8(0x80, master.sdo[0]);
    return master.sdo[4] | (uint32_t)master.sdo[5] << 8 | (uint32_t)master.sdo[6] << 16 | (uint32_t)master.sdo[7] << 24;
}

static void write_object(uint16_t index, uint8_t sub, uint32_t value, unsigned bytes)
{
    master.sdo_answered = false;
    master_sends(0x601, 8, (0x23u | (4u - bytes) << 2) | (uint32_t)index << 8 | (uint32_t)sub << 24, value);
    ticks(20);
    TEST_ASSERT_TRUE_MESSAGE(master.sdo_answered, "no SDO answer");
    TEST_ASSERT_EQUAL_HEX8(0x60, master.sdo[0]);
}

static bool emcy_received(uint16_t code)
{
    for (unsigned i = 0; i < master.emcys; i++) {
        if (master.emcy[i] == code) {
            return true;
        }
    }
    return false;
}

static bool enabled(void)
{
    return chip_pin('B', 12) || chip_pin('C', 8);
}

static void expect_safe(void)
{
    TEST_ASSERT_FALSE(enabled());
    TEST_ASSERT_EQUAL_HEX32(0x08000800, chip.dac.DHR12RD);
    TEST_ASSERT_EQUAL_UINT32(0, chip.tim8.CCR[0] | chip.tim8.CCR[1]);
}

static void expect_fault(uint16_t code)
{
    expect_safe();
    master_sends(0, 2, 0x0101, 0); /* NMT start, after which the drive sends statuswords */
    ticks(200);
    expect_safe();
    TEST_ASSERT_TRUE(emcy_received(code));
    TEST_ASSERT_EQUAL_HEX16(code, read_object(0x603F, 0) & 0xFFFF);
    TEST_ASSERT_EQUAL_HEX8(1, read_object(0x1001, 0) & 1);
    TEST_ASSERT_EQUAL_HEX16(0x08, master.statusword & 0x4F);
}

/* Every input is inactive, the crystal works, and there is a master on the bus. */
static void power_on(void)
{
    chip_reset();
    chip.rcc.CSR = RCC_CSR_PORRSTF;
    master.emcys = 0;
    master.listening = true;
}

static void start(void)
{
    main_loop_start();
    chip.can1.MSR = 0;
    master.statusword = 0xFFFF; /* none received yet */
    ticks(30);
}

void setUp(void)
{
    power_on();
    start();
}

static void enable(void)
{
    master_sends(0, 2, 0x0101, 0); /* NMT start */
    for (uint32_t word = 6; word != 0x1E; word = word == 6 ? 7 : word == 7 ? 0xF : 0x1E) {
        master_sends(0x201, 4, word | word << 16, 0);
        ticks(30);
    }
    TEST_ASSERT_TRUE(chip_pin('B', 12));
    TEST_ASSERT_TRUE(chip_pin('C', 8));
}

static void test_a_healthy_board_has_no_fault_and_can_be_enabled(void)
{
    TEST_ASSERT_EQUAL_HEX8(0, read_object(0x1001, 0) & 0xFF);
    TEST_ASSERT_EQUAL_UINT32(1, read_object(0x2031, 0) & 0xFF); /* power */
    expect_safe();
    enable();
    TEST_ASSERT_EQUAL_HEX16(0x27, master.statusword & 0x6F);
}

static void test_while_an_axis_has_power_the_watchdog_runs_on_in_a_debugger(void)
{
    TEST_ASSERT_EQUAL_HEX32(DBGMCU_APB1_FZ_IWDG | DBGMCU_APB1_FZ_WWDG, chip.dbgmcu.APB1_FZ);
    TEST_ASSERT_EQUAL_HEX32(DBGMCU_APB2_FZ_TIM1 | DBGMCU_APB2_FZ_TIM8, chip.dbgmcu.APB2_FZ);
    enable();
    TEST_ASSERT_EQUAL_HEX32(0, chip.dbgmcu.APB1_FZ);
    master_sends(0x201, 4, 0x00060006, 0);
    ticks(30);
    TEST_ASSERT_EQUAL_HEX32(DBGMCU_APB1_FZ_IWDG | DBGMCU_APB1_FZ_WWDG, chip.dbgmcu.APB1_FZ);
}

static void test_an_encoder_that_jumps_cuts_the_power_in_the_same_tick(void)
{
    enable();
    chip.tim2.CNT += 20000; /* 1.5 mm in 100 us */
    tick_irq();
    expect_safe();
    expect_fault(0x7305);
}

static void test_a_stop_of_axes_that_stand_cuts_the_power_within_two_milliseconds(void)
{
    enable();
    chip_drive_pin('C', 4, true);
    ticks(20);
    expect_safe();
    expect_fault(0x9000);
}

static bool no_crystal(const reg *r, uint32_t mask, uint32_t value)
{
    (void)value;
    return !(r == &chip.rcc.CR && mask == RCC_CR_HSERDY);
}

static void test_a_crystal_that_does_not_start_is_a_fault_until_it_is_acknowledged(void)
{
    power_on();
    chip_waits = no_crystal;
    start();
    expect_fault(0x5200);
    master_sends(0, 2, 0x0101, 0);
    master_sends(0x201, 4, 0x00800080, 0);
    ticks(30);
    TEST_ASSERT_EQUAL_HEX8(0, read_object(0x1001, 0) & 0xFF);
    enable(); /* the clock is 1 % off, which is acknowledged */
}

static void test_a_crystal_that_stops_cuts_the_power_at_once(void)
{
    enable();
    chip.rcc.CIR = RCC_CIR_CSSF;
    clock_failed_irq();
    expect_safe();
    chip.rcc.CIR = 0;
    for (int i = 0; i < 20; i++) { /* the servo tick goes on until it notices */
        ticks(1);
        expect_safe();
    }
    expect_fault(0x5200);
    master_sends(0x201, 4, 0x00800080, 0);
    ticks(30);
    enable();
}

static void test_nobody_acknowledges_and_the_drive_goes_on_and_reports_it_later(void)
{
    master.listening = false;
    chip.can1.TSR = 0;
    chip.can1.ESR = 128u << CAN_ESR_TEC | CAN_ESR_EPVF | CAN_ESR_EWGF;
    chip.iwdg.KR = 0;
    ticks(10000);
    TEST_ASSERT_EQUAL_HEX32(IWDG_KEY_FEED, chip.iwdg.KR);
    expect_safe();

    chip.can1.ESR = 0;
    master.listening = true;
    ticks(50);
    TEST_ASSERT_EQUAL_HEX16(0x8120, read_object(0x1003, 1) & 0xFFFF);
    TEST_ASSERT_EQUAL_HEX8(0, read_object(0x1001, 0) & 0xFF);
}

/* Frames no longer pass in either direction while the axes are enabled. */
static void test_a_transceiver_that_dies_stops_the_axes_cuts_their_power_and_is_reported_later(void)
{
    write_object(0x1016, 1, 0x7F0000 | 500, 4);
    master_sends(0x77F, 1, 5, 0);
    enable();
    master.listening = false;
    chip.can1.TSR = 0;
    chip.can1.ESR = 128u << CAN_ESR_TEC | CAN_ESR_EPVF | CAN_ESR_EWGF;
    ticks(4900);
    TEST_ASSERT_TRUE(enabled()); /* a frame or two may be lost */
    ticks(1000);
    expect_safe();

    chip.can1.ESR = 0;
    master.listening = true;
    ticks(50);
    expect_fault(0x8130);
    TEST_ASSERT_EQUAL_HEX16(0x8130, read_object(0x1003, 1) & 0xFFFF);
    TEST_ASSERT_EQUAL_HEX16(0x8120, read_object(0x1003, 2) & 0xFFFF);
}

static void test_each_servo_tick_feeds_the_window_watchdog_and_turns_the_alive_pin_over(void)
{
    for (int i = 0; i < 10; i++) {
        const bool before = chip_pin('B', 0);
        chip.wwdg.CR = 0;
        tick_irq();
        TEST_ASSERT_EQUAL_HEX32(WWDG_CR_WDGA | WWDG_CR_T6, chip.wwdg.CR & (WWDG_CR_WDGA | WWDG_CR_T6));
        TEST_ASSERT_TRUE(before != chip_pin('B', 0));
        main_loop_pass();
    }
}

/* The watchdog resets the chip, which makes all pins inputs and starts the firmware again. */
static void expect_watchdog_starved(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, chip.iwdg.KR);
    power_on();
    chip.rcc.CSR = RCC_CSR_IWDGRSTF | RCC_CSR_PINRSTF;
    start();
    expect_fault(0x6010);
}

static void test_a_servo_tick_that_stands_still_starves_the_watchdog(void)
{
    enable();
    main_loop_pass();
    chip.iwdg.KR = 0;
    for (int i = 0; i < 1000; i++) {
        main_loop_pass();
    }
    expect_watchdog_starved();
}

static void test_a_background_that_does_not_run_starves_the_watchdog(void)
{
    enable();
    main_loop_pass();
    chip.iwdg.KR = 0;
    for (int i = 0; i < 10000; i++) {
        tick_irq();
    }
    expect_watchdog_starved();
}

static void test_a_watchdog_reset_is_a_fault_of_the_next_run(void)
{
    power_on();
    chip.rcc.CSR = RCC_CSR_IWDGRSTF | RCC_CSR_PINRSTF;
    start();
    TEST_ASSERT_EQUAL_UINT32(4, read_object(0x2031, 0) & 0xFF);
    expect_fault(0x6010);
}

static bool supply_stays_low(const reg *r, uint32_t mask, uint32_t value)
{
    (void)value;
    return !(r == &chip.pwr.CSR && mask == PWR_CSR_PVDO);
}

static void test_a_supply_that_fails_cuts_the_power_and_is_a_fault_of_the_next_run(void)
{
    TEST_ASSERT_EQUAL_HEX32(PWR_CR_PVDE | PWR_CR_PLS_2V8, chip.pwr.CR & (PWR_CR_PVDE | 7u << 5));
    TEST_ASSERT_EQUAL_HEX32(EXTI_PVD, chip.exti.IMR & chip.exti.RTSR);
    TEST_ASSERT_TRUE(supply_start());
    TEST_ASSERT_EQUAL_HEX32(1u << IRQ_PVD, chip.nvic.ISER[0]);
    enable();
    chip.scb.AIRCR = 0;
    supply_irq();
    expect_safe();
    TEST_ASSERT_EQUAL_HEX32(SCB_AIRCR_KEY | SCB_AIRCR_SYSRESETREQ, chip.scb.AIRCR);
    power_on();
    chip.rcc.CSR = RCC_CSR_SFTRSTF | RCC_CSR_PINRSTF;
    start();
    TEST_ASSERT_EQUAL_UINT32(HAL_RESET_BROWN_OUT, read_object(0x2031, 0) & 0xFF);
    expect_fault(0x5110);
}

static void test_a_supply_that_is_low_is_a_fault_as_long_and_nothing_is_stored(void)
{
    power_on();
    chip_waits = supply_stays_low;
    start();
    chip.pwr.CSR = PWR_CSR_PVDO;
    expect_fault(0x5110);
    master.sdo_answered = false;
    master_sends(0x601, 8, 0x01101023, 0x65766173); /* 1010h:1 "save" */
    ticks(20);
    TEST_ASSERT_TRUE(master.sdo_answered);
    TEST_ASSERT_EQUAL_HEX8(0x80, master.sdo[0]);
    TEST_ASSERT_EQUAL_HEX32(0xFFFFFFFF, chip_store[0]);
    master_sends(0x201, 4, 0x00800080, 0); /* fault reset */
    ticks(30);
    expect_fault(0x5110);
    chip.pwr.CSR = 0;
    master_sends(0x201, 4, 0, 0);
    ticks(30);
    master_sends(0x201, 4, 0x00800080, 0);
    ticks(30);
    TEST_ASSERT_EQUAL_HEX8(0, read_object(0x1001, 0) & 0xFF);
}

static void test_a_brown_out_is_a_fault_of_the_next_run(void)
{
    power_on();
    chip.rcc.CSR = RCC_CSR_BORRSTF | RCC_CSR_PINRSTF;
    start();
    TEST_ASSERT_EQUAL_UINT32(HAL_RESET_BROWN_OUT, read_object(0x2031, 0) & 0xFF);
    expect_fault(0x5110);
}

static void test_a_crash_is_a_fault_of_the_next_run(void)
{
    static const uint32_t no_stack[8];
    enable();
    crash_record(no_stack);
    expect_safe();
    chip.rcc.CSR = RCC_CSR_SFTRSTF | RCC_CSR_PINRSTF;
    master.emcys = 0;
    start();
    TEST_ASSERT_EQUAL_UINT32(HAL_RESET_CRASH, read_object(0x2031, 0) & 0xFF);
    expect_fault(0x6010);
    TEST_ASSERT_EQUAL_UINT32(1, read_object(0x2030, 7)); /* count */
}

static void test_saved_parameters_are_in_the_flash_and_loaded_in_the_next_run(void)
{
    write_object(0x1017, 0, 70, 2);
    write_object(0x1010, 1, 0x65766173, 4); /* "save" */
    write_object(0x1017, 0, 80, 2);
    chip.rcc.CSR = RCC_CSR_SFTRSTF;
    start();
    TEST_ASSERT_EQUAL_UINT32(70, read_object(0x1017, 0) & 0xFFFF);
    memset(chip_store, 0xFF, sizeof chip_store);
    start();
    TEST_ASSERT_EQUAL_UINT32(100, read_object(0x1017, 0) & 0xFFFF);
}

/* The servo tick does not read the encoders while a sector is erased, for 250 ms or more. */
static void test_a_table_that_moves_while_parameters_are_saved_is_followed(void)
{
    const uint32_t before = read_object(0x6064, 0);
    chip.can1.RX[0] = (struct can_mailbox){
        .IR = 0x601u << CAN_IR_STID, .DTR = 8, .DLR = 0x01101023, .DHR = 0x65766173}; /* 1010h "save" */
    chip.can1.RF0R = 1;
    can_rx_irq();
    tick_irq();
    chip.tim2.CNT += 20000; /* without the save it would be a fault */
    main_loop_pass();
    TEST_ASSERT_NOT_EQUAL_HEX32(0xFFFFFFFF, chip_store[0]);
    ticks(200);
    TEST_ASSERT_EQUAL_HEX8(0, read_object(0x1001, 0) & 0xFF);
    TEST_ASSERT_GREATER_THAN_INT32((int32_t)before + 1000000, (int32_t)read_object(0x6064, 0)); /* nm */
}

/* Objects 2034h and 1006h. The test turns the chip into an emulator after start-up. */
static void test_in_an_emulator_time_passes_with_sync_if_that_is_chosen(void)
{
    write_object(0x2034, 0, 1, 1);
    const uint32_t at_first = read_object(0x2020, 3);
    TEST_ASSERT_GREATER_THAN_UINT32(at_first, read_object(0x2020, 3)); /* the time of a chip always passes */
    chip_emulate();
    ticks(1);
    write_object(0x1006, 0, 2000, 4);
    const uint32_t before = read_object(0x2020, 3);
    ticks(1000);
    TEST_ASSERT_EQUAL_UINT32(before, read_object(0x2020, 3));
    master_sends(0x80, 0, 0, 0);
    ticks(5);
    TEST_ASSERT_EQUAL_UINT32(before + 2, read_object(0x2020, 3));
    master_sends(0x81, 0, 0, 0); /* another frame than SYNC */
    chip.can1.RX[0] = (struct can_mailbox){.IR = 0x80u << CAN_IR_STID | CAN_IR_RTR};
    chip.can1.RF0R = 1;
    can_rx_irq(); /* a remote frame with the identifier of SYNC */
    ticks(5);
    TEST_ASSERT_EQUAL_UINT32(before + 2, read_object(0x2020, 3));
    write_object(0x1006, 0, 0, 4); /* where nothing is told, a SYNC is 1 ms */
    master_sends(0x80, 0, 0, 0);
    ticks(5);
    TEST_ASSERT_EQUAL_UINT32(before + 3, read_object(0x2020, 3));
    write_object(0x2034, 0, 0, 1);
    TEST_ASSERT_GREATER_THAN_UINT32(before + 3, read_object(0x2020, 3));
}

static void test_ticks_that_take_longer_than_their_period_are_a_fault(void)
{
    enable();
    chip.scb.ICSR = SCB_ICSR_PENDSTSET;
    ticks(2);
    chip.scb.ICSR = 0; /* one or two late ticks are no fault */
    ticks(20);
    TEST_ASSERT_TRUE(enabled());
    chip.scb.ICSR = SCB_ICSR_PENDSTSET;
    for (int i = 0; i < 4; i++) {
        TEST_ASSERT_TRUE(enabled());
        tick_irq(); /* no time for the background loop between two ticks */
    }
    expect_safe();
    chip.scb.ICSR = 0;
    expect_fault(0x6100);
}

/* The time of an emulator is that of its host. */
static void test_late_ticks_of_an_emulator_are_no_fault(void)
{
    enable();
    chip_emulate();
    chip.scb.ICSR = SCB_ICSR_PENDSTSET;
    ticks(20);
    TEST_ASSERT_TRUE(enabled());
    TEST_ASSERT_EQUAL_HEX8(0, read_object(0x1001, 0) & 0xFF);
}

/* An emulator lacks the core-coupled memory (kontur.ld). */
static void test_the_knots_of_an_emulator_are_in_memory_that_it_has(void)
{
    for (int emulated = 0; emulated < 2; emulated++) {
        power_on();
        if (emulated != 0) {
            chip_emulate();
        }
        kontur_emulated_knots.knot[SPLINE_RING - 1u].nm[1] = 5;
        start();
        TEST_ASSERT_EQUAL_INT32(emulated != 0 ? 0 : 5, kontur_emulated_knots.knot[SPLINE_RING - 1u].nm[1]);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_a_healthy_board_has_no_fault_and_can_be_enabled);
    RUN_TEST(test_while_an_axis_has_power_the_watchdog_runs_on_in_a_debugger);
    RUN_TEST(test_an_encoder_that_jumps_cuts_the_power_in_the_same_tick);
    RUN_TEST(test_a_stop_of_axes_that_stand_cuts_the_power_within_two_milliseconds);
    RUN_TEST(test_a_crystal_that_does_not_start_is_a_fault_until_it_is_acknowledged);
    RUN_TEST(test_a_crystal_that_stops_cuts_the_power_at_once);
    RUN_TEST(test_nobody_acknowledges_and_the_drive_goes_on_and_reports_it_later);
    RUN_TEST(test_a_transceiver_that_dies_stops_the_axes_cuts_their_power_and_is_reported_later);
    RUN_TEST(test_each_servo_tick_feeds_the_window_watchdog_and_turns_the_alive_pin_over);
    RUN_TEST(test_a_servo_tick_that_stands_still_starves_the_watchdog);
    RUN_TEST(test_a_background_that_does_not_run_starves_the_watchdog);
    RUN_TEST(test_a_watchdog_reset_is_a_fault_of_the_next_run);
    RUN_TEST(test_a_brown_out_is_a_fault_of_the_next_run);
    RUN_TEST(test_a_supply_that_fails_cuts_the_power_and_is_a_fault_of_the_next_run);
    RUN_TEST(test_a_supply_that_is_low_is_a_fault_as_long_and_nothing_is_stored);
    RUN_TEST(test_a_crash_is_a_fault_of_the_next_run);
    RUN_TEST(test_saved_parameters_are_in_the_flash_and_loaded_in_the_next_run);
    RUN_TEST(test_a_table_that_moves_while_parameters_are_saved_is_followed);
    RUN_TEST(test_in_an_emulator_time_passes_with_sync_if_that_is_chosen);
    RUN_TEST(test_ticks_that_take_longer_than_their_period_are_a_fault);
    RUN_TEST(test_late_ticks_of_an_emulator_are_no_fault);
    RUN_TEST(test_the_knots_of_an_emulator_are_in_memory_that_it_has);
    return UNITY_END();
}
