/* SPDX-License-Identifier: Apache-2.0 */
/* For test_faults_*.c: what each row of supervision/faults.toml promises, checked on the simulated drive. A row NAME has at least one
 * test, whose name begins with test_NAME, which injects the cause and goes by these two:
 * - expect_reaction(ROW_NAME): detection within the row's delay, reaction within two control periods more, EMCY and its
 *   register, 603Fh, and the capture, or none; before it wait_for(ROW_NAME, cause, ...), where the cause takes time;
 * - expect_clearing(ROW_NAME), when the cause is gone: latched or not, what ends it, and the capture kept until then.
 * tests/host/test_fault_table.py sees that none is left out. */
#ifndef TEST_FAULTS_H
#define TEST_FAULTS_H
#include <math.h>
#include <stdio.h>

#include "drive_rig.h"
#include "supervision/fault_rows.h"

enum { SHUTDOWN = 0x06, SWITCH_ON = 0x07, ENABLE = 0x0F, RUN = 0x1F, FAULT_RESET = 0x80 };
enum { WARNING = 7 };                               /* bit of the statusword */
enum { REACTION = 2, BEFORE = 5000, AFTER = 1300 }; /* control periods; the last two: of a capture */

static struct rig rig;
static struct rig_stream stream;
static double off_path_nm; /* so far from its path a stop may be */
static struct {
    uint32_t armed, trigger; /* control period */
} capture;

static inline void power_on(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    stream = (struct rig_stream){.count = 1500, .length_nm = 50e6}; /* 50 mm in 1.5 s: up to 67 mm/s */
    off_path_nm = 1000;
    capture.armed = 0;
}

/* Enabled, and 400 ms on the way; half a second after power-on */
static inline void be_on_the_way(void)
{
    rig_ms(&rig, 100);
    rig_enable(&rig);
    rig_go(&rig, &stream, 400);
    TEST_ASSERT_EQUAL_HEX32(0, rig.device.drive.faults | rig.device.drive.warnings);
    rig.emcy_count = 0;
}

static inline bool detected(enum row r)
{
    const struct drive *d = &rig.device.drive;
    return promises[r].bit == 0 ? rig_had_emcy(&rig, promises[r].emcy)
                                : ((atomic_load(&d->loop.faults) | d->faults | d->warnings) & promises[r].bit) != 0;
}

static inline void run_period(enum row r)
{
    rig.busy = true;
    rig_run(&rig, 1);
    rig.busy = false;
    if (!detected(r)) { /* what the tick sees it reacts to alone: expect_power_cut(), expect_path_stop() */
        device_poll(&rig.device);
    }
}

/* Returns after how many control periods, at most `most`. */
static inline unsigned periods_to_detect(enum row r, unsigned most)
{
    for (unsigned n = 0; n <= most; n++) {
        if (detected(r)) {
            return n;
        }
        run_period(r);
    }
    TEST_FAIL_MESSAGE("not detected in time");
    return most;
}

/* The cause is there once `reached` holds, as it does soon, and has to last for `lasts` control periods: it is detected
 * then, within the row's delay, and not before. */
static inline void wait_for(enum row r, bool (*reached)(void), unsigned lasts)
{
    for (unsigned n = 0; !reached(); n++) {
        TEST_ASSERT_FALSE_MESSAGE(detected(r), "detected before its cause");
        TEST_ASSERT_TRUE_MESSAGE(n < 5000, "no cause");
        run_period(r);
    }
    TEST_ASSERT_TRUE_MESSAGE(periods_to_detect(r, lasts + promises[r].delay) >= lasts, "detected too soon");
}

/* What the law and the observer have made of the last control period */
static inline const struct servo_out *last_out(void)
{
    const struct servo_loop *l = &rig.device.drive.loop;
    return &(l->ticks % 10 == 0 ? &l->records[atomic_load(&l->published) % SERVO_LOOP_RECORDS] : l->record)->out;
}

static inline void expect_no_power(void)
{
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_FALSE(rig.out.enable[i]);
        TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[i]);
    }
}

/* In 2033h, which has one entry for each and then zeros */
static inline bool in_effect(uint16_t code)
{
    unsigned found = 0;
    for (uint8_t i = 1; i <= 8; i++) {
        found += rig_read(&rig, 0x2033, i) == code ? 1u : 0u;
    }
    return code == 0 ? found == 8 : found == 1;
}

/* EMCY and its register, 1001h, 1003h, 2033h; 603Fh of both axes: of what stops them alone */
static inline void expect_reported(enum row r, bool stops)
{
    const struct promise *p = &promises[r];
    unsigned i = 0;
    while (i < rig.emcy_count && rig.emcy[i] != p->emcy) {
        i++;
    }
    TEST_ASSERT_TRUE_MESSAGE(i < rig.emcy_count, "no EMCY");
    TEST_ASSERT_EQUAL_HEX8(p->reg | CO_REG_GENERIC, rig.emcy_reg[i]);
    TEST_ASSERT_EQUAL_HEX8(p->reg | CO_REG_GENERIC, rig_read(&rig, 0x1001, 0));
    TEST_ASSERT_EQUAL_HEX16(p->emcy, rig_read(&rig, 0x1003, 1) & 0xFFFFu);
    TEST_ASSERT_TRUE_MESSAGE(in_effect(p->emcy), "2033h");
    const uint16_t code = stops ? p->emcy : 0;
    TEST_ASSERT_EQUAL_HEX16(code, rig_read(&rig, 0x603F, 0));
    TEST_ASSERT_EQUAL_HEX16(code, rig_read(&rig, 0x683F, 0));
}

/* ---- the capture ---- */

static inline uint32_t capture_word(unsigned i)
{
    uint8_t b[4];
    TEST_ASSERT_TRUE(scope_read(&rig.device.drive.loop.scope, 4 * i, b, 4, rig.device.drive.path.queue.origin_nm));
    return b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
}

/* Detected in the last control period or the one before, or just now by the background. */
static inline void expect_trigger(enum row r)
{
    const uint32_t now = rig.device.drive.loop.ticks;
    const uint32_t state = rig_read(&rig, 0x2300, 2);
    if (!promises[r].captured) {
        TEST_ASSERT_EQUAL_UINT32(SCOPE_WAITING, state);
        return;
    }
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(SCOPE_TRIGGERED, state);
    capture.trigger = rig_read(&rig, 0x2300, 9);
    TEST_ASSERT_UINT_WITHIN(REACTION + 1, now, capture.trigger);
}

/* Some time later: it is complete, of this row, reaches half a second back, or to where it was armed, and stays so. */
static inline void expect_capture(enum row r)
{
    if (!promises[r].captured) {
        TEST_ASSERT_EQUAL_UINT32(SCOPE_WAITING, rig_read(&rig, 0x2300, 2));
        return;
    }
    TEST_ASSERT_EQUAL_UINT32(SCOPE_DONE, rig_read(&rig, 0x2300, 2));
    TEST_ASSERT_GREATER_THAN_UINT32(SCOPE_HEADER, scope_size(&rig.device.drive.loop.scope));
    const uint32_t periods = capture_word(0) >> 16, last = capture_word(3) + (capture_word(1) - 1) * periods;
    TEST_ASSERT_EQUAL_UINT32(capture.trigger, capture_word(4));
    TEST_ASSERT_BITS_HIGH(promises[r].bit, capture_word(5));
    const uint32_t there = capture.trigger - capture.armed;
    const uint32_t before = capture_word(3) < capture.trigger ? capture.trigger - capture_word(3) : 0;
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(there < BEFORE ? there - (there < periods ? there : periods) : BEFORE, before);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(AFTER - periods, last - capture.trigger);
}

/* ---- what stops the axes ---- */

/* What the tick does alone: the background may be late by many periods. */
static inline void let_it_react(void)
{
    rig.busy = true;
    rig_run(&rig, REACTION);
    rig.busy = false;
}

static inline void expect_power_cut(enum row r)
{
    let_it_react();
    expect_no_power();
    expect_trigger(r);
    rig_ms(&rig, 1);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    expect_reported(r, true);
}

/* Path time slows down, both axes stay within off_path_nm of the line, then there is no power. */
static inline void expect_path_stop(enum row r)
{
    const bool runs = !atomic_load(&rig.device.drive.loop.standing);
    let_it_react();
    if (runs) {
        TEST_ASSERT_TRUE(rig.out.enable[0] && rig.out.enable[1]);
        const num slope = rig.device.drive.loop.path.at.rate_dot;
        TEST_ASSERT_TRUE_MESSAGE(n_lt(slope, NUM(0)), "path time does not slow down");
    }
    expect_trigger(r);
    rig_ms(&rig, 1);
    expect_reported(r, true);
    for (unsigned ms = 0; ms < 130; ms++) {
        rig_ms(&rig, 1);
        TEST_ASSERT_TRUE_MESSAGE(rig_off_line(&rig, &stream) < off_path_nm, "off the path");
    }
    TEST_ASSERT_TRUE(atomic_load(&rig.device.drive.loop.standing));
    TEST_ASSERT_TRUE(fabs(rig.plant.vel_mps[0]) + fabs(rig.plant.vel_mps[1]) < 1e-3);
    expect_no_power();
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
}

/* Nothing but a reset ends it, and then the axes can be enabled again. A second fault changes neither what is told of the
 * first one nor its capture. */
static inline void expect_latched(enum row r)
{
    rig_ms(&rig, 300);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 20);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    expect_no_power();
    expect_capture(r);
    rig.inputs[1] = promises[r].emcy == 0x7305 ? HAL_AMPLIFIER_FAULT : HAL_ENCODER_FAULT;
    rig_ms(&rig, 1);
    rig.inputs[1] = 0;
    rig_ms(&rig, 200);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, promises[r].emcy == 0x7305 ? 0x5400 : 0x7305));
    TEST_ASSERT_EQUAL_HEX16(promises[r].emcy, rig_read(&rig, 0x603F, 0));
    TEST_ASSERT_EQUAL_HEX16(promises[r].emcy, rig_read(&rig, 0x683F, 0));
    expect_capture(r);
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[rig.emcy_count - 1]);
    TEST_ASSERT_EQUAL_HEX8(0, rig_read(&rig, 0x1001, 0));
    TEST_ASSERT_TRUE(in_effect(0));
    TEST_ASSERT_EQUAL_HEX16(0, rig_read(&rig, 0x603F, 0));
    TEST_ASSERT_EQUAL_HEX16(0, rig_read(&rig, 0x683F, 0));
    TEST_ASSERT_EQUAL_UINT32(SCOPE_WAITING, rig_read(&rig, 0x2300, 2));
    rig_enable(&rig);
    TEST_ASSERT_TRUE(rig.out.enable[0] && rig.out.enable[1]);
}

/* ---- what is only told ---- */

/* Nothing stops. The EMCY is all that there is of a reaction. */
static inline void expect_warning(enum row r)
{
    const bool powered = rig.out.enable[0];
    const uint32_t rate = rig_read(&rig, 0x2200, 13);
    rig_run(&rig, REACTION);
    TEST_ASSERT_TRUE_MESSAGE(rig_had_emcy(&rig, promises[r].emcy), "not told in time");
    expect_trigger(r);
    rig_ms(&rig, 5);
    TEST_ASSERT_TRUE(rig_bit(&rig, WARNING));
    expect_reported(r, false);
    TEST_ASSERT_EQUAL(powered, rig.out.enable[0] && rig.out.enable[1]);
    TEST_ASSERT_EQUAL_UINT32(rate, rig_read(&rig, 0x2200, 13));
    if (powered) {
        rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    }
}

/* Time passes, and the stream, if there is one, goes on. */
static inline void run_on(unsigned ms)
{
    for (unsigned i = 0; i < ms; i++) {
        rig_ms(&rig, 1);
        if (i % 100 == 0 && stream.sent > 0) {
            rig_feed(&rig, &stream, stream.count);
        }
    }
}

/* It ends by itself, within `ms`. */
static inline void expect_end(enum row r, unsigned ms)
{
    run_on(ms);
    TEST_ASSERT_FALSE(rig_bit(&rig, WARNING));
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[rig.emcy_count - 1]);
    TEST_ASSERT_EQUAL_HEX8(0, rig.emcy_reg[rig.emcy_count - 1]);
    TEST_ASSERT_EQUAL_HEX8(0, rig_read(&rig, 0x1001, 0));
    TEST_ASSERT_TRUE(in_effect(0));
    if (!promises[r].captured) {
        expect_capture(r);
    }
}

/* ---- a row ---- */

static inline void expect_reaction_as(enum row r, enum promised reaction)
{
    const struct od_data *od = &rig.device.od;
    const bool off_at_once = od->axis[0].quick_stop_option == 0 || od->axis[1].quick_stop_option == 0;
    (void)periods_to_detect(r, promises[r].delay);
    switch (reaction) {
    case PROMISED_WARN:
    case PROMISED_REFUSE: expect_warning(r); break;
    case PROMISED_PATH_STOP: expect_path_stop(r); break;
    case PROMISED_QUICK_STOP: (off_at_once ? expect_power_cut : expect_path_stop)(r); break;
    case PROMISED_DISABLE: expect_power_cut(r); break;
    }
}

/* The cause is there since now, or it is detected already. */
static inline void expect_reaction(enum row r)
{
    expect_reaction_as(r, promises[r].reaction);
}

/* The cause is gone since now. ms: that a warning takes to end. */
static inline void expect_clearing(enum row r, unsigned ms)
{
    if (promises[r].latched) {
        expect_latched(r);
    } else {
        expect_end(r, ms);
    }
}

static inline void expect_path_runs(void)
{
    TEST_ASSERT_EQUAL_UINT32(1000, rig_read(&rig, 0x2200, 13));
}
#endif
