/* SPDX-License-Identifier: Apache-2.0 */
/* What the tests of the whole firmware (test_device_*.c) share: it runs frame by frame on a simulated machine. */
#ifndef TEST_DEVICE_H
#define TEST_DEVICE_H
#include "drive_rig.h"

enum {
    SHUTDOWN = 0x06,
    SWITCH_ON = 0x07,
    ENABLE = 0x0F,
    RUN = 0x1F,
    HALT = 0x11F,
    QUICK_STOP = 0x0B,
    FAULT_RESET = 0x80
};
enum { TARGET_REACHED = 10, IP_ACTIVE = 12 };
enum { IDLE, FILLING, RUNNING, STOPPING, DONE, STOPPED }; /* 2200h:5 */

#define ABORT_STATE 0x08000022u
#define ABORT_INCOMPATIBLE 0x06040043u
#define STOP_MS 100u

static struct rig rig;
static struct rig_stream stream;

void setUp(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    stream = (struct rig_stream){.count = 1500, .length_nm = 50e6}; /* 50 mm in 1.5 s: up to 67 mm/s */
}

void tearDown(void)
{
}

static inline uint32_t stream_state(void)
{
    return rig_read(&rig, 0x2200, 5);
}

/* ... and still on its path */
static inline void expect_standing_on_the_line(void)
{
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, rig.plant.vel_mps[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, rig.plant.vel_mps[1]);
    TEST_ASSERT_TRUE_MESSAGE(rig_off_line(&rig, &stream) < 1000, "off the path by more than 1 um");
}

static inline void expect_power(bool x, bool y)
{
    TEST_ASSERT_EQUAL(x, rig.out.enable[0]);
    TEST_ASSERT_EQUAL(y, rig.out.enable[1]);
}

/* Stop on the path that goes on: never slower than a stop from rate 1 would be, and off the path never */
static inline void run_on_the_line(unsigned ms)
{
    for (unsigned i = 0; i < ms; i++) {
        rig_ms(&rig, 1);
        TEST_ASSERT_TRUE_MESSAGE(rig_off_line(&rig, &stream) < 1000, "off the path by more than 1 um");
    }
}

static inline void reset_faults_and_enable_again(void)
{
    rig_controlwords(&rig, FAULT_RESET, FAULT_RESET);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    rig_ms(&rig, 20);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[rig.emcy_count - 1]);
    TEST_ASSERT_EQUAL_HEX32(0, rig_read(&rig, 0x1001, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_read(&rig, 0x603F, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_read(&rig, 0x683F, 0));
    rig_enable(&rig);
    expect_power(true, true);
    rig_go(&rig, &stream, 1600);
    TEST_ASSERT_EQUAL_UINT32(DONE, stream_state());
}

static inline void expect_fault(uint16_t code)
{
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, code));
    TEST_ASSERT_EQUAL_HEX32(code, rig_read(&rig, 0x603F, 0));
    TEST_ASSERT_EQUAL_HEX32(code, rig_read(&rig, 0x683F, 0));
    TEST_ASSERT_NOT_EQUAL_HEX32(0, rig_read(&rig, 0x1001, 0));
    expect_power(false, false);
}
#endif
