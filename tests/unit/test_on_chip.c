/* SPDX-License-Identifier: Apache-2.0 */
/* The drive on the machine that it simulates by itself (2103h): the one at its connector is neither read nor driven. */
#include "drive_rig.h"

static struct rig rig;

void setUp(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
}

void tearDown(void)
{
}

static double reported_mm(int axis)
{
    return (int32_t)rig_read(&rig, (uint16_t)(0x6064 + 0x800 * axis), 0) * 1e-6;
}

static void start_on_chip(int32_t x_nm, int32_t y_nm)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2103, 11, 4, x_nm));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2103, 12, 4, y_nm));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2103, 1, 1, 1));
    rig_ms(&rig, 3);
}

static void test_simulated_machine_stands_where_it_is_commanded_to_start(void)
{
    start_on_chip(12000000, -3000000);
    TEST_ASSERT_DOUBLE_WITHIN(40e-6, 12, reported_mm(0)); /* half a count */
    TEST_ASSERT_DOUBLE_WITHIN(40e-6, -3, reported_mm(1));
}

static void test_stream_moves_the_simulated_machine_and_not_the_one_at_the_connector(void)
{
    struct rig_stream s = {.count = 500, .length_nm = 10e6};
    start_on_chip(0, 0);
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &s));
    rig_feed(&rig, &s, s.count);
    rig_controlwords(&rig, 0x1F, 0x1F);
    for (int i = 0; i < 600; i++) {
        rig_ms(&rig, 1);
        TEST_ASSERT_FALSE(rig.out.enable[0] || rig.out.enable[1]);
        TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[0]);
        TEST_ASSERT_EQUAL_INT32(0, rig.out.force_mN[1]);
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 8, reported_mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 6, reported_mm(1));
    TEST_ASSERT_DOUBLE_WITHIN(1e-6, 0, rig.plant.pos_m[0]);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_machine_at_the_connector_is_back_when_the_simulated_one_is_switched_off(void)
{
    start_on_chip(12000000, -3000000);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2103, 1, 1, 0));
    rig_ms(&rig, 3);
    TEST_ASSERT_DOUBLE_WITHIN(40e-6, 0, reported_mm(0));
    rig_enable(&rig);
    rig_ms(&rig, 10);
    TEST_ASSERT_TRUE(rig.out.enable[0] && rig.out.enable[1]);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_simulated_machine_stands_where_it_is_commanded_to_start);
    RUN_TEST(test_stream_moves_the_simulated_machine_and_not_the_one_at_the_connector);
    RUN_TEST(test_machine_at_the_connector_is_back_when_the_simulated_one_is_switched_off);
    return UNITY_END();
}
