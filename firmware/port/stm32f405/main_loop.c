/* SPDX-License-Identifier: Apache-2.0 */
/* main_loop.c: the chip's HAL, the servo tick and the background loop, main_loop.h. */
#include "port/stm32f405/main_loop.h"

#include <stdatomic.h>

#include "device.h"
#include "drive/configuration.h"
#include "port/stm32f405/board.h"
#include "port/stm32f405/bus.h"
#include "port/stm32f405/can.h"
#include "port/stm32f405/clock.h"
#include "port/stm32f405/cpu.h"
#include "port/stm32f405/crash.h"
#include "port/stm32f405/cycles.h"
#include "port/stm32f405/encoder.h"
#include "port/stm32f405/inputs.h"
#include "port/stm32f405/output.h"
#include "port/stm32f405/ram.h"
#include "port/stm32f405/sectors.h"
#include "port/stm32f405/supply.h"
#include "port/stm32f405/watchdog.h"

enum {
    NODE_ID = 1, /* until another one is set (2001h, LSS) */
    KBITPS = 1000,
    OVERRUNS_IN_A_ROW = 3, /* a single late tick may be due to an interrupt of higher priority */
    BEHIND_MS = 50,        /* the background loop may be this far behind the servo tick */
    TICK_US = 1000000 / CONTROL_HZ,
};

static struct device device;
extern struct spline_ring kontur_emulated_knots; /* kontur.ld */
static enum hal_reset reset_cause;
static struct hal_crash last_crash;
static _Atomic uint32_t ticks;
static uint32_t due_us; /* paced by SYNC: time that is due but has not passed */

static void drive_read(void *ctx, struct hal_drive_in *in)
{
    (void)ctx;
    *in = (struct hal_drive_in){0};
    encoder_read(in);
    inputs_read(in);
    output_read(in);
}

static void drive_write(void *ctx, const struct hal_drive_out *out)
{
    (void)ctx;
    watchdog_in_halt(out->enable[AXIS_X] || out->enable[AXIS_Y]);
    output_write(out);
}

static void drive_wiring(void *ctx, const struct hal_axis_cfg cfg[AXES])
{
    (void)ctx;
    encoder_configure(cfg);
    output_configure(cfg);
}

static bool send(void *ctx, const struct can_frame *frame)
{
    (void)ctx;
    return bus_send(frame);
}

/* Run servo ticks up to the end of a millisecond, `most` at most. Returns their number. */
static unsigned tick_to_ms(unsigned most)
{
    const uint32_t published = atomic_load(&device.drive.loop.published);
    unsigned n = 0;
    while (n < most && atomic_load(&device.drive.loop.published) == published) {
        device_tick(&device);
        n++;
    }
    return n;
}

/* Paced by SYNC (2034h), which only an emulator may be: run the ticks that are due, up to the end of a
 * millisecond. false: no tick is due. */
static bool pass_time(void)
{
    if (due_us < TICK_US) {
        return false;
    }
    due_us -= TICK_US * tick_to_ms(due_us / TICK_US);
    return true;
}

static bool receive(void *ctx, struct can_frame *frame)
{
    (void)ctx;
    if (pass_time() || !bus_receive(frame)) {
        return false;
    }
    if (device.od.clock.pace != 0 && !frame->rtr && frame->id == (device.od.sync_cob_id & 0x7FFu)) {
        due_us += device_sync_us(&device);
    }
    return true;
}

static void update_pace(void)
{
    const uint8_t pace = cpu_emulated() ? device.od.pace_select : 0;
    if (pace != device.od.clock.pace) {
        device.od.clock.pace = pace;
        due_us = 0;
        if (pace != 0) {
            (void)tick_to_ms(CONTROL_HZ / 1000u); /* so that each SYNC comes at the end of a millisecond */
        }
    }
}

static void status(void *ctx, struct hal_can_status *s)
{
    (void)ctx;
    bus_status(s);
}

static bool bitrate(void *ctx, uint16_t kbitps, bool change)
{
    (void)ctx;
    return can_bitrate(kbitps, change);
}

static void sector_read(void *ctx, unsigned sector, uint32_t offset, void *data, uint32_t bytes)
{
    (void)ctx;
    sectors_read(sector, offset, data, bytes);
}

static bool sector_erase(void *ctx, unsigned sector)
{
    (void)ctx;
    const bool good = sectors_erase(sector);
    encoder_paused();
    return good;
}

static bool sector_write(void *ctx, unsigned sector, uint32_t offset, const void *data, uint32_t bytes)
{
    (void)ctx;
    return sectors_write(sector, offset, data, bytes);
}

static void health(void *ctx, struct hal_health *h)
{
    (void)ctx;
    const bool ended_badly =
        reset_cause == HAL_RESET_WATCHDOG || reset_cause == HAL_RESET_CRASH || reset_cause == HAL_RESET_BROWN_OUT;
    *h = (struct hal_health){
        .bits = (uint8_t)((clock_degraded() ? HAL_CLOCK : 0) | (ended_badly ? HAL_RESET : 0)),
        .reset = reset_cause,
        .crash = last_crash,
    };
    cycles_read(h);
}

/* The place of the tick's counter when a frame is handled. Its clock and that of the sender run apart, by more than a
 * replay can follow. */
static uint32_t entropy(void *ctx)
{
    (void)ctx;
    return SYSTICK->VAL;
}

static const struct hal hal = {
    .drive_read = drive_read,
    .drive_write = drive_write,
    .drive_configure = drive_wiring,
    .can_send = send,
    .can_receive = receive,
    .can_status = status,
    .can_bitrate = bitrate,
    .flash_read = sector_read,
    .flash_erase = sector_erase,
    .flash_write = sector_write,
    .entropy = entropy,
    .health = health,
};

void tick_irq(void)
{
    static unsigned late;
    cycles_begin();
    if (supply_low()) { /* supply_irq() sees it fall, and this that it stays low, which no fault reset can change */
        servo_loop_raise(&device.drive.loop, FAULT_BROWN_OUT);
    }
    if (device.od.clock.pace == 0) {
        device_tick(&device);
    }
    pin_write(BOARD_ALIVE, (atomic_fetch_add(&ticks, 1u) & 1u) != 0);
    /* Is the next tick pending already? In an emulator time is the host's, so a late tick is no fault. */
    late = (SCB->ICSR & SCB_ICSR_PENDSTSET) != 0 && !cpu_emulated() ? late + 1u : 0u;
    if (late >= OVERRUNS_IN_A_ROW) {
        servo_loop_raise(&device.drive.loop, FAULT_OVERRUN); /* the next tick disables the axes, and is short */
    }
    watchdog_tick();
    cycles_end();
}

static void tick_start(void)
{
    SCB->SHPR[2] = (uint32_t)PRIORITY_SERVO << 28; /* SysTick: the highest byte */
    SYSTICK->LOAD = CLOCK_HZ / CONTROL_HZ - 1u;
    SYSTICK->VAL = 0;
    SYSTICK->CTRL = SYSTICK_CORE_CLOCK | SYSTICK_TICKINT | SYSTICK_ENABLE;
}

static void blink_led(void)
{
    pin_write(BOARD_LED, (device.ms & 512u) != 0);
}

void main_loop_start(void)
{
    CCM_DATA static struct spline_ring knots;
    cpu_detect_emulator();
    output_init();
    (void)clock_start();
    crash_read(&reset_cause, &last_crash);
    if (!supply_start()) {
        reset_cause = HAL_RESET_BROWN_OUT;
    }
    inputs_init();
    encoder_init();
    pin_setup(BOARD_LED, PIN_OUTPUT, PIN_FLOATING, 0);
    pin_setup_low(BOARD_ALIVE);
    bus_init();
    (void)can_init(KBITPS);
    device_init(&device, &hal, cpu_emulated() ? &kontur_emulated_knots : &knots, NODE_ID);
    watchdog_start();
    cycles_start();
    tick_start(); /* it feeds one of them */
}

void main_loop_pass(void)
{
    device_poll(&device);
    update_pace();
    blink_led();
    watchdog_pass(atomic_load(&ticks), atomic_load(&device.drive.loop.published) - device.ms < BEHIND_MS);
    if (due_us < TICK_US) {
        cpu_sleep();
    }
}
