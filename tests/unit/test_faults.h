/* SPDX-License-Identifier: Apache-2.0 */
/* For test_faults_*.c: what each row of faults.toml promises, checked on the simulated drive. A row NAME has at least one
 * test, whose name begins with test_NAME (tests/host/test_fault_table.py). */
#ifndef TEST_FAULTS_H
#define TEST_FAULTS_H
#include "test_drive_rig.h"

enum { SHUTDOWN = 0x06, SWITCH_ON = 0x07, ENABLE = 0x0F, RUN = 0x1F, FAULT_RESET = 0x80 };
enum { WARNING = 7 }; /* bit of the statusword */

static struct rig rig;
static struct rig_stream stream;

static inline void power_on(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    stream = (struct rig_stream){.count = 1500, .length_nm = 50e6}; /* 50 mm in 1.5 s: up to 67 mm/s */
}

/* Enabled, and 400 ms on the way */
static inline void be_on_the_way(void)
{
    rig_enable(&rig);
    rig_go(&rig, &stream, 400);
    TEST_ASSERT_EQUAL_HEX32(0, rig.app.drive.faults | rig.app.drive.warnings);
    rig.emcy_count = 0;
}

static inline bool detected(enum fault f)
{
    const struct drive *d = &rig.app.drive;
    return ((atomic_load(&d->loop.faults) | d->faults | d->warnings) & FAULT_BIT(f)) != 0;
}

/* Returns after how many control periods, at most `most`. */
static inline unsigned periods_to_detect(enum fault f, unsigned most)
{
    for (unsigned n = 0; n <= most; n++) {
        if (detected(f)) {
            return n;
        }
        rig_run(&rig, 1);
    }
    TEST_FAIL_MESSAGE("not detected");
    return most;
}

/* EMCY, error register, 603Fh */
static inline void expect_told(enum fault f)
{
    const uint16_t code = fault_table[f].emcy;
    TEST_ASSERT_EQUAL_HEX16(code, rig.emcy[0]);
    TEST_ASSERT_EQUAL_HEX8(fault_table[f].reg | CO_REG_GENERIC, rig_read(&rig, 0x1001, 0));
    TEST_ASSERT_EQUAL_HEX16(code, rig_read(&rig, 0x603F, 0));
    TEST_ASSERT_EQUAL_HEX16(code, rig_read(&rig, 0x683F, 0));
}

static inline void expect_no_power(void)
{
    for (int i = 0; i < 2; i++) {
        TEST_ASSERT_FALSE(rig.out.enable[i]);
        TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[i]);
    }
}

/* The fault is detected within `most` control periods; two later there is no power, a millisecond later it is told. */
static inline void expect_power_cut(enum fault f, unsigned most)
{
    (void)periods_to_detect(f, most);
    rig_run(&rig, 2);
    expect_no_power();
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    expect_told(f);
}

/* ... two periods later path time slows down, both axes stay within off_nm of the line, then there is no power. */
static inline void expect_path_stop(enum fault f, unsigned most, double off_nm)
{
    (void)periods_to_detect(f, most);
    const bool runs = !atomic_load(&rig.app.drive.loop.standing);
    rig_run(&rig, 2);
    if (runs) {
        TEST_ASSERT_TRUE(rig.out.enable[0] && rig.out.enable[1]);
        TEST_ASSERT_TRUE_MESSAGE(rig.app.drive.loop.path.at.rate_dot < 0, "path time does not slow down");
    }
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_HEX16(fault_table[f].emcy, rig.emcy[0]);
    for (unsigned ms = 0; ms < 130; ms++) {
        rig_ms(&rig, 1);
        TEST_ASSERT_TRUE_MESSAGE(rig_off_line(&rig, &stream) < off_nm, "off the path");
    }
    TEST_ASSERT_TRUE(atomic_load(&rig.app.drive.loop.standing));
    TEST_ASSERT_TRUE(fabs(rig.plant.vel_mps[0]) + fabs(rig.plant.vel_mps[1]) < 1e-3);
    expect_no_power();
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    expect_told(f);
}

/* The cause has gone: nothing but a reset ends the fault, and then the axes can be enabled again. */
static inline void expect_latched(enum fault f)
{
    rig_ms(&rig, 300);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    rig_controlwords(&rig, ENABLE, ENABLE);
    rig_ms(&rig, 20);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    expect_no_power();
    TEST_ASSERT_EQUAL_HEX16(fault_table[f].emcy, rig_read(&rig, 0x603F, 0));
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_ms(&rig, 2);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[rig.emcy_count - 1]);
    TEST_ASSERT_EQUAL_HEX8(0, rig_read(&rig, 0x1001, 0));
    TEST_ASSERT_EQUAL_HEX16(0, rig_read(&rig, 0x603F, 0));
    rig_enable(&rig);
    TEST_ASSERT_TRUE(rig.out.enable[0] && rig.out.enable[1]);
}

/* Warned of within `most` control periods, and two more; nothing stops. */
static inline void expect_warning(uint16_t emcy, uint8_t reg, unsigned most)
{
    const bool powered = rig.out.enable[0];
    unsigned n = 0;
    while (!rig_had_emcy(&rig, emcy) && n++ < most + 2) {
        rig_run(&rig, 1);
    }
    TEST_ASSERT_TRUE_MESSAGE(n <= most + 2, "not warned of");
    rig_ms(&rig, 2);
    TEST_ASSERT_TRUE(rig_bit(&rig, WARNING));
    TEST_ASSERT_EQUAL_HEX8(reg | CO_REG_GENERIC, rig_read(&rig, 0x1001, 0));
    TEST_ASSERT_EQUAL_HEX16(0, rig_read(&rig, 0x603F, 0));
    TEST_ASSERT_EQUAL(powered, rig.out.enable[0] && rig.out.enable[1]);
    if (powered) {
        rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    }
}

/* ... and the stream, if there is one, goes on. */
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
static inline void expect_warning_ends(unsigned ms)
{
    run_on(ms);
    TEST_ASSERT_FALSE(rig_bit(&rig, WARNING));
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[rig.emcy_count - 1]);
    TEST_ASSERT_EQUAL_HEX8(0, rig_read(&rig, 0x1001, 0));
}

static inline void expect_path_runs(void)
{
    TEST_ASSERT_EQUAL_UINT32(1000, rig_read(&rig, 0x2200, 13));
}
#endif
