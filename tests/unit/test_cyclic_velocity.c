/* SPDX-License-Identifier: Apache-2.0 */
/* Cyclic synchronous velocity (mode 9) over the bus, and the objects that tell a master what the drive is. */
#include <math.h>

#include "test_axis_modes.h"

enum { CSV = 9, FOLLOWS = 12, UNDERRUN = 0xFF10, RANGE = 0xFF11, ACCELERATION = 0xFF13, CYCLE_MS = 4 };

static const uint8_t no_data[1];
static int32_t sent_umps[2];

static void cycle(int32_t x_umps, int32_t y_umps)
{
    uint8_t data[8];
    co_put(&data[0], (uint32_t)x_umps, 4);
    co_put(&data[4], (uint32_t)y_umps, 4);
    rig_send(&rig, 0x401, 8, data);
    rig_send(&rig, 0x80, 0, no_data);
    rig_ms(&rig, CYCLE_MS);
    sent_umps[0] = x_umps;
    sent_umps[1] = y_umps;
}

/* Come to these speeds with 1 m/s2, and stay there for so many cycles. */
static void run_at(int32_t x_umps, int32_t y_umps, unsigned cycles)
{
    const int32_t goal[2] = {x_umps, y_umps};
    for (bool there = false; !there;) {
        int32_t next[2];
        there = true;
        for (int i = 0; i < 2; i++) {
            const int32_t d = goal[i] - sent_umps[i];
            next[i] = sent_umps[i] + (d > 4000 ? 4000 : d < -4000 ? -4000 : d);
            there = there && next[i] == goal[i];
        }
        cycle(next[0], next[1]);
    }
    for (unsigned i = 0; i < cycles; i++) {
        cycle(x_umps, y_umps);
    }
}

static void start_velocity(void)
{
    map_set_points(0x60FF, 32);
    for (int i = 0; i < 2; i++) {
        set(i, 0x60C2, 1, 1, CYCLE_MS);
        sent_umps[i] = 0;
    }
    rig_enable(&rig);
    mode(0, CSV);
    mode(1, CSV);
    run_at(0, 0, 10);
    TEST_ASSERT_TRUE(status(0, FOLLOWS) && status(1, FOLLOWS));
}

static void test_velocity_is_followed_and_adds_up_to_its_way(void)
{
    start_velocity();
    run_at(40000, -20000, 100);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 40, mmps(0));
    TEST_ASSERT_DOUBLE_WITHIN(0.1, -20, mmps(1));
    run_at(0, 0, 50);
    /* 101 cycles at full speed, and the ramps: 4 + 8 + ... + 36 and 36 + ... + 4 mm/s */
    TEST_ASSERT_DOUBLE_WITHIN(2e-3, 40 * 0.004 * 101 + 2 * 180 * 0.004, mm(0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    TEST_ASSERT_TRUE(status(0, FOLLOWS));
}

static void test_offset_is_added(void)
{
    start_velocity();
    run_at(20000, 0, 10);
    set(0, 0x60B1, 0, 4, 4000);
    run_at(20000, 0, 50);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 24, mmps(0));
}

static void test_lost_velocity_is_that_of_before(void)
{
    start_velocity();
    run_at(20000, 0, 20);
    rig_send(&rig, 0x80, 0, no_data);
    rig_ms(&rig, CYCLE_MS);
    run_at(20000, 0, 20);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 20, mmps(0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    rig_ms(&rig, 300); /* silence */
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, UNDERRUN));
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
}

static void test_step_and_soft_limit_are_faults(void)
{
    start_velocity();
    cycle(100000, 0); /* 25 m/s2 */
    rig_ms(&rig, 3);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, ACCELERATION));
    for (int k = 0; k < 2; k++) {
        setUp();
        start_velocity();
        set(0, 0x607D, 1, 4, -10000000);
        set(0, 0x607D, 2, 4, 10000000);
        run_at(k == 0 ? 50000 : -50000, 0, 100);
        TEST_ASSERT_TRUE(rig_had_emcy(&rig, RANGE));
        rig_ms(&rig, 300);
        TEST_ASSERT_TRUE(fabs(mm(0)) < 10 && fabs(mm(0)) > 6);
    }
}

static void test_velocity_that_no_position_can_have_is_refused(void)
{
    static const int32_t most[] = {INT32_MAX, INT32_MIN};
    for (int k = 0; k < 2; k++) {
        setUp();
        start_velocity();
        set(0, 0x60B1, 0, 4, most[k]);
        cycle(most[k], 0);
        rig_ms(&rig, 3);
        TEST_ASSERT_TRUE(rig_had_emcy(&rig, RANGE));
        TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mm(0));
    }
}

static void test_speed_that_comes_before_the_axis_follows_moves_nothing(void)
{
    start_velocity();
    run_at(20000, 0, 10);
    rig_controlwords(&rig, ENABLE | HALT, ENABLE | HALT);
    run_at(20000, 0, 100);
    TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, mmps(0));
    rig_controlwords(&rig, ENABLE, ENABLE);
    run_at(0, 0, 10);
    run_at(20000, 0, 20);
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 20, mmps(0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_objects_say_what_the_drive_does(void)
{
    TEST_ASSERT_UINT32_WITHIN(1, (uint32_t)(1 / 76.29e-9), rig_read(&rig, 0x608F, 1));
    set(1, 0x2100, 5, 4, 20000000); /* 200 nm */
    TEST_ASSERT_EQUAL_UINT32(5000000, rig_read(&rig, 0x688F, 1));
    set(1, 0x2100, 5, 4, 100);
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, rig_read(&rig, 0x688F, 1));
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x608F, 2));
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x6091, 1));
    TEST_ASSERT_EQUAL_UINT32(1000000000, rig_read(&rig, 0x6892, 1));
    TEST_ASSERT_EQUAL_HEX32(0xF7010000, rig_read(&rig, 0x60A8, 0));
    TEST_ASSERT_EQUAL_HEX32(0xFA010300, rig_read(&rig, 0x68A9, 0));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x6402, 0));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_velocity_is_followed_and_adds_up_to_its_way);
    RUN_TEST(test_offset_is_added);
    RUN_TEST(test_lost_velocity_is_that_of_before);
    RUN_TEST(test_step_and_soft_limit_are_faults);
    RUN_TEST(test_velocity_that_no_position_can_have_is_refused);
    RUN_TEST(test_speed_that_comes_before_the_axis_follows_moves_nothing);
    RUN_TEST(test_objects_say_what_the_drive_does);
    return UNITY_END();
}
