/* SPDX-License-Identifier: Apache-2.0 */
/* What the tests of modes and of homing share: a machine with limit switches and index pulses, axes by their number. */
#ifndef TEST_MODES_H
#define TEST_MODES_H
#include "drive_rig.h"

enum { SHUTDOWN = 0x06, ENABLE = 0x0F, RUN = 0x1F, HALT = 0x100, QUICK_STOP = 0x0B };
enum { TARGET_REACHED = 10, INTERNAL_LIMIT = 11, SPEED_0 = 12, ATTAINED = 12, HOMING_ERROR = 13 };
enum { VELOCITY = 3, HOMING = 6, PATH = 7 };
enum { DONE = 4 };

#define ABORT_STATE 0x08000022u
#define ABORT_VALUE 0x06090030u

/* Controlwords that stop an axis, and the state that it comes to. */
static const struct {
    uint16_t word;
    unsigned state;
} axis_stops[] = {{RUN | HALT, RIG_ENABLED},
                  {QUICK_STOP, RIG_DISABLED},
                  {SHUTDOWN, RIG_READY},
                  {0x07, RIG_SWITCHED_ON},
                  {0, RIG_DISABLED}};

static struct rig rig;

static inline void start_at(double x_m, double y_m)
{
    struct ks_machine machine = rig_machine();
    for (int i = 0; i < 2; i++) {
        machine.switch_m[i] = 0.002; /* at 198 mm */
        machine.index_m[i] = 0.01;
    }
    machine.start_m[0] = x_m;
    machine.start_m[1] = y_m;
    rig_start(&rig, &machine);
}

void setUp(void)
{
    start_at(0, 0);
}

void tearDown(void)
{
}

static inline void mode(int axis, int value)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, (uint16_t)(0x6060 + 0x800 * axis), 0, 1, value));
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL(value, (int8_t)rig_read(&rig, (uint16_t)(0x6061 + 0x800 * axis), 0));
}

static inline void velocity(int axis, int32_t umps)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, (uint16_t)(0x60FF + 0x800 * axis), 0, 4, umps));
}

static inline void set(int axis, uint16_t index, uint8_t sub, uint8_t size, int64_t value)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, (uint16_t)(index + 0x800 * axis), sub, size, value));
}

/* The object of both axes (index of x, size in bits) in the third RPDO, 401h. */
static inline void map_set_points(uint16_t index, uint8_t bits)
{
    set(0, 0x1402, 1, 4, 0x80000401);
    set(0, 0x1602, 0, 1, 0);
    set(0, 0x1602, 1, 4, (int64_t)index << 16 | bits);
    set(0, 0x1602, 2, 4, (int64_t)(index + 0x800) << 16 | bits);
    set(0, 0x1602, 0, 1, 2);
    set(0, 0x1402, 1, 4, 0x401);
}

static inline bool status(int axis, int bit)
{
    return ((unsigned)rig.statusword[axis] >> bit & 1u) != 0;
}

static inline double mmps(int axis)
{
    return rig.plant.vel_mps[axis] * 1e3;
}

static inline double mm(int axis)
{
    return rig.plant.pos_m[axis] * 1e3;
}

static inline double reported_mm(int axis)
{
    return (int32_t)rig_read(&rig, (uint16_t)(0x6064 + 0x800 * axis), 0) * 1e-6;
}

static inline void start_jog_mode(void)
{
    rig_enable(&rig);
    mode(0, VELOCITY);
    mode(1, VELOCITY);
}
#endif
