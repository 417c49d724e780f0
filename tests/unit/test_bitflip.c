/* SPDX-License-Identifier: Apache-2.0 */
/* A campaign: every bit of the variables that decide on power, limits and stops, turned over while the firmware runs, one at a time,
 * in each state of the drive.
 *
 * Whatever bit it is: where there is no power, there is none in any control period; where there is, the force stays within its limit,
 * and while there is power the axis stays within the soft limits and 2130h:1, both with what a fault takes to be seen; in the end the
 * drive does what its statuswords say, either as before or off. Nothing is undefined: this runs sanitized.
 *
 * Of a bool only the bit that C gives a meaning is turned, of a 64-bit position not the highest four, of a 64-bit rate not those above 4:
 * there sums and products leave the type, which C leaves undefined (the chip wraps, and so does what the low bits do). Pointers are not: a wrong one ends in a HardFault, which switches the
 * outputs off (port/stm32f405/crash.c), or in memory of this list. */
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "drive_rig.h"

enum { SHUTDOWN = 0x06, SWITCH_ON = 0x07, ENABLE = 0x0F, RUN = 0x1F, QUICK_STOP = 0x0B, FAULT_RESET = 0x80 };
enum { OFF_PERIODS = 40, ON_PERIODS = 200, PARAMETER_PERIODS = 300 }; /* that a trial takes */
enum {
    LARGE = 32,
    ONE_IN = 5
}; /* bytes; of a larger variable one bit in so many, all in the five states with power, or without */

static struct rig rig, begin_with;
static struct rig_stream stream;
static unsigned flips, safe, stopped;
static uint8_t turned[2][sizeof(struct rig)]; /* bits, without power and with it */

#define LIMIT_M 0.06  /* soft limits of the trials */
#define WINDOW_M 1e-3 /* 6065h */
#define FORCE_MAX_MN 600000
#define SPEED_MAX_MPS 0.5 /* 2130h:1 */

/* ---- the variables ---- */

struct variable {
    const char *name;
    size_t offset;                                   /* in struct rig */
    size_t size;                                     /* bytes */
    enum { ANY, BOOL, WIDE, RATES, PARAMETER } kind; /* WIDE, RATES: 64-bit; PARAMETER: its change is a fault */
};

#define VAR(member) {#member, offsetof(struct rig, member), sizeof rig.member, ANY}
#define FLAG(member) {#member, offsetof(struct rig, member), 1, BOOL}
#define FAR(member) {#member, offsetof(struct rig, device.drive.loop.member), sizeof rig.device.drive.loop.member, WIDE}
#define RATE(member)                                                                                                   \
    {#member, offsetof(struct rig, device.drive.loop.member), sizeof rig.device.drive.loop.member, RATES}
#define PARAMETERS(member) {#member, offsetof(struct rig, device.od.member), sizeof rig.device.od.member, PARAMETER}
#define LOOP(member) VAR(device.drive.loop.member)
#define DRIVE(member) VAR(device.drive.member)

static const struct variable variables[] = {
    /* state and commands of the master */
    DRIVE(axis[0].state),
    DRIVE(axis[0].standing),
    DRIVE(axis[0].changes),
    DRIVE(axis[0].controlword),
    DRIVE(axis[0].quick_stop),
    DRIVE(axis[0].shutdown),
    DRIVE(axis[0].disable),
    DRIVE(axis[1].state),
    DRIVE(axis[1].standing),
    DRIVE(axis[1].changes),
    DRIVE(axis[1].controlword),
    DRIVE(axis[1].quick_stop),
    DRIVE(axis[1].shutdown),
    DRIVE(axis[1].disable),
    DRIVE(axis[0].not_state),
    DRIVE(axis[1].not_state),
    VAR(device.od.axis[0].controlword),
    VAR(device.od.axis[1].controlword),
    VAR(device.od.axis[0].statusword),
    VAR(device.od.axis[0].mode),
    VAR(device.od.axis[1].mode),
    VAR(device.od.axis[0].target_velocity),
    VAR(device.od.claim_required),
    DRIVE(command_guard.holder),
    DRIVE(command_guard.key),
    DRIVE(command_guard.ticket),
    DRIVE(command_guard.armed_at),
    DRIVE(command_guard.axis),
    FLAG(device.drive.command_guard.silent),
    FLAG(device.drive.command_guard.drawn),
    FLAG(device.drive.command_guard.told),
    FLAG(device.drive.command_guard.armed),
    VAR(device.node.nmt.state),
    VAR(device.node.nmt.watched),
    VAR(device.node.nmt.consumer_left_ms),
    /* what the background tells the tick */
    LOOP(command.powered[0]),
    LOOP(command.powered[1]),
    FLAG(device.drive.loop.command.run),
    LOOP(command.rate),
    FLAG(device.drive.loop.command.complete),
    FLAG(device.drive.loop.command.may_end),
    LOOP(command.controller),
    LOOP(command.stream),
    LOOP(command.configured),
    LOOP(command.origin_nm[0]),
    LOOP(command.origin_nm[1]),
    LOOP(command.forced),
    LOOP(command.force_mN[0]),
    LOOP(command.force_mN[1]),
    LOOP(command.excite),
    LOOP(excitation.cfg.axis),
    /* what the tick tells the background */
    LOOP(faults),
    LOOP(first),
    LOOP(stream),
    LOOP(executed),
    LOOP(published),
    LOOP(ticks),
    FLAG(device.drive.loop.standing),
    FLAG(device.drive.loop.at_end),
    FLAG(device.drive.loop.starved),
    /* limits and masks */
    LOOP(cfg[0]),
    LOOP(cfg[1]),
    LOOP(following_ticks[0]),
    LOOP(following_ticks[1]),
    LOOP(configured),
    LOOP(inputs),
    LOOP(path.at.rate),
    RATE(path.motion),
    LOOP(path.enough),
    LOOP(rate_permille),
    LOOP(rate),
    FLAG(device.drive.loop.onchip.selected),
    /* the law */
    FAR(servo.observer[0].pos),
    LOOP(servo.observer[0].vel),
    LOOP(servo.observer[0].acc),
    LOOP(servo.controller),
    LOOP(servo.forced),
    LOOP(servo.offset),
    LOOP(servo.slot),
    LOOP(servo.demand),
    LOOP(servo.smc),
    LOOP(servo.compensator),
    LOOP(servo.feedforward),
    FAR(encoder[0].pos),
    FAR(encoder[0].count),
    LOOP(encoder[0].last),
    LOOP(encoder[0].fraction),
    FLAG(device.drive.loop.servo.enabled[0]),
    FLAG(device.drive.loop.servo.enabled[1]),
    FLAG(device.drive.loop.servo.extras),
    FLAG(device.drive.loop.servo.saturated),
    FLAG(device.drive.loop.servo.gains_lowered),
    FLAG(device.drive.loop.servo.gains_changed),
    LOOP(servo.gain),
    LOOP(servo.gains),
    LOOP(servo.oscillation[0].half_waves),
    LOOP(servo.oscillation[0].age),
    LOOP(servo.oscillation[0].ticks),
    LOOP(servo.oscillation[0].count),
    FLAG(device.drive.loop.command.oscillation_reset),
    /* faults */
    DRIVE(faults),
    DRIVE(warnings),
    DRIVE(first),
    FLAG(device.drive.enable_refused),
    DRIVE(amplifier[0].state),
    DRIVE(amplifier[1].state),
    DRIVE(amplifier[0].since_ms),
    DRIVE(amplifier[1].since_ms),
    FLAG(device.drive.amplifier[0].inhibited),
    FLAG(device.drive.amplifier[1].inhibited),
    DRIVE(configured),
    DRIVE(path.stream),
    DRIVE(configured_ms),
    DRIVE(path.suspended_at),
    DRIVE(fault_monitor),
    FLAG(device.drive.path.queue.starved),
    DRIVE(integrity.cfg),
    DRIVE(integrity.parameters),
    DRIVE(integrity.sum),
    DRIVE(integrity.at),
    FLAG(device.drive.integrity.corrupt),
    /* modes and queue */
    DRIVE(path.modes.axis[0].mode),
    DRIVE(path.modes.axis[1].mode),
    FLAG(device.drive.path.modes.generating),
    FLAG(device.drive.path.modes.ending),
    FLAG(device.drive.path.modes.by_record),
    FLAG(device.drive.path.short_lag),
    FLAG(device.drive.path.ran_out),
    FLAG(device.drive.path.modes.by_frame),
    DRIVE(path.modes.axis[0].homing.state),
    DRIVE(path.modes.axis[0].requested_umps),
    DRIVE(path.modes.axis[0].settings),
    DRIVE(path.queue.total),
    DRIVE(path.queue.min_nm),
    DRIVE(path.queue.max_nm),
    DRIVE(path.queue.low_nm),
    DRIVE(path.queue.high_nm),
    DRIVE(path.queue.origin_nm),
    DRIVE(path.queue.equal_knots),
    DRIVE(path.queue.max_nmpms2),
    DRIVE(path.queue.step_nm),
    FLAG(device.drive.path.queue.open),
    FLAG(device.drive.path.queue.suspended),
    FLAG(device.drive.path.queue.outside),
    FLAG(device.drive.path.queue.over_acceleration),
    VAR(ring.start),
    VAR(ring.count),
    VAR(ring.knot[0]),
    VAR(ring.knot[100]),
    VAR(ring.knot[401]),
    VAR(ring.knot[402]),
    VAR(ring.knot[405]),
    VAR(ring.knot[420]),
    VAR(ring.knot[1000]),
    VAR(device.od.stream.state),
    VAR(device.od.stream.accepted),
    VAR(device.od.stream.executed),
    VAR(device.od.stream.total),
    VAR(device.od.stream.end_x),
    VAR(device.od.stream.free),
    VAR(device.od.feed_override),
    VAR(device.od.axis[0].shutdown_option),
    VAR(device.od.axis[0].disable_option),
    VAR(device.od.axis[0].fault_reaction_option),
    VAR(device.od.axis[0].abort_connection_option),
    /* the parameters that are looked at while there is power */
    PARAMETERS(axis[0].quick_stop_option),
    PARAMETERS(axis[0].halt_option),
    PARAMETERS(axis[0].position_limit),
    PARAMETERS(axis[0].plant),
    PARAMETERS(axis[0].following_window),
    PARAMETERS(limits.velocity),
    PARAMETERS(limits.path_stop_time),
    PARAMETERS(limits.start_window),
    PARAMETERS(limits.acceleration),
    PARAMETERS(tunnel.radius),
    PARAMETERS(tunnel.debounce),
    PARAMETERS(tunnel.reaction),
    PARAMETERS(fault_delay),
    PARAMETERS(controller.select),
    VAR(device.od.controller.active),
};

/* ---- the states ---- */

static void power_on(void)
{
    struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    for (uint16_t axis = 0; axis < 2; axis++) {
        const uint16_t at = (uint16_t)(axis * 0x800);
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x607D + at, 1, 4, (int32_t)(-LIMIT_M * 1e9)));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x607D + at, 2, 4, (int32_t)(LIMIT_M * 1e9)));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6065 + at, 0, 4, (int32_t)(WINDOW_M * 1e9)));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x605A + at, 0, 2, 6));
    }
    rig_nmt(&rig, 1);
    rig_ms(&rig, 5);
}

static void command(uint16_t controlword)
{
    rig_controlwords(&rig, controlword, controlword);
    rig_ms(&rig, 2);
}

static void be_off(void)
{
}

static void be_ready(void)
{
    command(SHUTDOWN);
}

static void be_switched_on(void)
{
    command(SHUTDOWN);
    command(SWITCH_ON);
}

static void be_on(void)
{
    rig_enable(&rig);
    rig_ms(&rig, 20);
}

static void be_on_the_way(void)
{
    be_on();
    stream = (struct rig_stream){.count = 900, .length_nm = 50e6};
    rig_go(&rig, &stream, 400);
}

static void be_stopping(void)
{
    be_on_the_way();
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 230);
    rig_expect_states(&rig, RIG_REACTION, RIG_REACTION);
}

static void be_at_fault(void)
{
    be_on_the_way();
    rig.inputs[0] = HAL_AMPLIFIER_FAULT;
    rig_ms(&rig, 2);
    rig.inputs[0] = 0;
    rig_ms(&rig, 300); /* the axes run out */
}

static void be_stopped(void)
{
    be_on_the_way();
    command(QUICK_STOP);
    rig_ms(&rig, 150);
    rig_expect_states(&rig, RIG_QUICK_STOP, RIG_QUICK_STOP);
}

static void be_disabled_again(void)
{
    be_on_the_way();
    command(ENABLE);
    rig_ms(&rig, 150);
    command(0);
}

static void be_filled(void)
{
    be_on();
    stream = (struct rig_stream){.count = 900, .length_nm = 50e6};
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &stream));
    rig_feed(&rig, &stream, stream.count);
    rig_ms(&rig, 2);
}

/* ---- a trial ---- */

static char what[160];

/* Bools within larger variables */
static bool of_no_meaning(const struct variable *v, size_t bit)
{
#define IN_BOTH(member)                                                                                                \
    offsetof(struct rig, device.drive.loop.cfg[0].member), offsetof(struct rig, device.drive.loop.cfg[1].member)
    static const size_t bools[] = {
        IN_BOTH(servo.contour.newton),
        IN_BOTH(servo.gains.smc.psi_printed),
        IN_BOTH(servo.gains.compensator.law_printed),
        IN_BOTH(servo.gains.compensator.input_printed),
        IN_BOTH(servo.force_filter.on),
        IN_BOTH(servo.force_limit.on),
        IN_BOTH(servo.delay.on),
        IN_BOTH(servo.friction.on),
        IN_BOTH(servo.screw.on),
        IN_BOTH(servo.dual_feedback[0].on),
        IN_BOTH(servo.dual_feedback[1].on),
        IN_BOTH(servo.geometry.on),
        IN_BOTH(servo.oscillation.on),
        IN_BOTH(servo.oscillation.lower),
        IN_BOTH(onchip_plant.simulated),
        offsetof(struct rig, device.drive.loop.servo.gains.smc.psi_printed),
        offsetof(struct rig, device.drive.loop.servo.gains.compensator.law_printed),
        offsetof(struct rig, device.drive.loop.servo.gains.compensator.input_printed),
        offsetof(struct rig, device.drive.fault_monitor.hot[0]),
        offsetof(struct rig, device.drive.fault_monitor.hot[1]),
    };
    for (unsigned i = 0; i < sizeof bools / sizeof bools[0]; i++) {
        if (v->offset + bit / 8 == bools[i] && bit % 8 != 0) {
            return true;
        }
    }
    return (v->kind == WIDE && bit % 64u >= 60u) || (v->kind == RATES && bit % 64u >= 34u);
}

static size_t bits_of(const struct variable *v)
{
    return v->kind == BOOL ? 1u : 8u * v->size;
}

static void flip(const struct variable *v, size_t bit)
{
    uint8_t *at = (uint8_t *)&rig + v->offset + bit / 8;
    *at = (uint8_t)(*at ^ 1u << bit % 8);
}

static void expect_off(void)
{
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_FALSE_MESSAGE(rig.out.enable[i], what);
        TEST_ASSERT_EQUAL_INT32_MESSAGE(0, rig.out.force_mN[i], what);
    }
}

static void expect_within_limits(void)
{
    for (int i = 0; i < 2; i++) {
        const int32_t f = rig.out.force_mN[i];
        TEST_ASSERT_TRUE_MESSAGE(f <= FORCE_MAX_MN && f >= -FORCE_MAX_MN, what);
        TEST_ASSERT_TRUE_MESSAGE(f == 0 || rig.out.enable[i], what);
        if (rig.out.enable[i]) {
            TEST_ASSERT_TRUE_MESSAGE(fabs(rig.plant.pos_m[i]) < LIMIT_M + 2 * WINDOW_M, what);
            TEST_ASSERT_TRUE_MESSAGE(fabs(rig.plant.vel_mps[i]) < 1.1 * SPEED_MAX_MPS, what);
        }
    }
}

/* In the end it is as it was, or off; what it says is what it does. */
static void expect_consistent(void)
{
    for (int i = 0; i < 2; i++) {
        const bool on = rig.out.enable[i];
        TEST_ASSERT_EQUAL_MESSAGE(cia402_powered(&rig.device.drive.axis[i]), on, what);
    }
}

static void trial(const char *state, const struct variable *v, size_t bit, bool has_power)
{
    memcpy(&rig, &begin_with, sizeof rig);
    (void)snprintf(what, sizeof what, "%s: %s bit %zu", state, v->name, bit);
    flip(v, bit);
    turned[has_power][v->offset + bit / 8] |= (uint8_t)(1u << bit % 8);
    flips++;
    const unsigned on_periods = v->kind == PARAMETER ? PARAMETER_PERIODS : ON_PERIODS;
    for (unsigned n = 0; n < (has_power ? on_periods : OFF_PERIODS); n++) {
        rig_run(&rig, 1);
        if (has_power) {
            expect_within_limits();
        } else {
            expect_off();
        }
        rig.emcy_count = 0;
    }
    if (has_power) {
        expect_consistent();
    }
    if (has_power && v->kind == PARAMETER) {
        TEST_ASSERT_BITS_HIGH_MESSAGE(FAULT_BIT(FAULT_MEMORY), rig.device.drive.faults, what);
    }
    stopped += (rig.device.drive.faults & ~begin_with.device.drive.faults) != 0 ? 1u : 0u;
    safe++;
}

static void campaign(const char *state, void (*be)(void), bool has_power)
{
    static unsigned states[2]; /* so far, without power and with it */
    const size_t from = states[has_power]++;
    flips = safe = stopped = 0;
    power_on();
    be();
    rig_run(&rig,
            11 - (unsigned)rig.device.drive.loop.ticks % 10u); /* just after the background has had its millisecond */
    begin_with = rig;
    TEST_ASSERT_EQUAL(has_power, rig.out.enable[0]);
    for (unsigned i = 0; i < sizeof variables / sizeof variables[0]; i++) {
        const struct variable *v = &variables[i];
        const size_t bits = bits_of(v), step = v->size > LARGE ? ONE_IN : 1u;
        for (size_t bit = from % step; bit < bits; bit += step) {
            if (!of_no_meaning(v, bit)) {
                trial(state, v, bit, has_power);
            }
        }
    }
    printf("bit flips, %s: %u bits turned, %u of them a fault; unsafe outcomes: %u\n", state, flips, stopped,
           flips - safe);
}

void setUp(void)
{
}

void tearDown(void)
{
}

static void test_drive_that_was_never_enabled_stays_without_power(void)
{
    campaign("switched off", be_off, false);
}

static void test_drive_that_is_ready_stays_without_power(void)
{
    campaign("ready", be_ready, false);
}

static void test_drive_that_is_switched_on_stays_without_power(void)
{
    campaign("switched on", be_switched_on, false);
}

static void test_drive_that_was_switched_off_on_its_path_stays_without_power(void)
{
    campaign("switched off on its path", be_disabled_again, false);
}

static void test_drive_at_fault_stays_without_power(void)
{
    campaign("fault", be_at_fault, false);
}

static void test_drive_that_holds_its_position_goes_on_or_stops(void)
{
    campaign("enabled, standing", be_on, true);
}

static void test_drive_with_a_path_before_it_goes_on_or_stops(void)
{
    campaign("enabled, path not started", be_filled, true);
}

static void test_drive_on_its_path_goes_on_or_stops(void)
{
    campaign("enabled, on its path", be_on_the_way, true);
}

static void test_drive_that_stops_for_a_fault_stops(void)
{
    campaign("stopping for a fault", be_stopping, true);
}

static void test_drive_in_quick_stop_stays_there_or_stops(void)
{
    campaign("quick stop active", be_stopped, true);
}

static void test_each_bit_was_turned_without_power_and_with_it(void)
{
    unsigned bits = 0;
    for (unsigned i = 0; i < sizeof variables / sizeof variables[0]; i++) {
        const struct variable *v = &variables[i];
        for (size_t bit = 0; bit < bits_of(v); bit++) {
            const unsigned mask = 1u << bit % 8;
            if (!of_no_meaning(v, bit)) {
                (void)snprintf(what, sizeof what, "%s bit %zu", v->name, bit);
                TEST_ASSERT_BITS_HIGH_MESSAGE(mask, turned[0][v->offset + bit / 8], what);
                TEST_ASSERT_BITS_HIGH_MESSAGE(mask, turned[1][v->offset + bit / 8], what);
                bits++;
            }
        }
    }
    printf("bit flips: %u bits\n", bits);
}

int main(void)
{
    setvbuf(stdout, NULL, _IOLBF, 0);
    UNITY_BEGIN();
    RUN_TEST(test_drive_that_was_never_enabled_stays_without_power);
    RUN_TEST(test_drive_that_is_ready_stays_without_power);
    RUN_TEST(test_drive_that_is_switched_on_stays_without_power);
    RUN_TEST(test_drive_that_was_switched_off_on_its_path_stays_without_power);
    RUN_TEST(test_drive_at_fault_stays_without_power);
    RUN_TEST(test_drive_that_holds_its_position_goes_on_or_stops);
    RUN_TEST(test_drive_with_a_path_before_it_goes_on_or_stops);
    RUN_TEST(test_drive_on_its_path_goes_on_or_stops);
    RUN_TEST(test_drive_that_stops_for_a_fault_stops);
    RUN_TEST(test_drive_in_quick_stop_stays_there_or_stops);
    RUN_TEST(test_each_bit_was_turned_without_power_and_with_it);
    return UNITY_END();
}
