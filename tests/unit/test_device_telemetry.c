/* SPDX-License-Identifier: Apache-2.0 */
/* The whole firmware on a simulated machine. Telemetry by TPDOs, and a background that is late. */
#include <math.h>

#include "test_device.h"

static int32_t i24(const uint8_t *data)
{
    const uint32_t u = co_get(data, 3);
    return (int32_t)(u ^ 0x800000u) - 0x800000;
}

static int16_t i16(const uint8_t *data)
{
    return (int16_t)(uint16_t)co_get(data, 2);
}

static void test_telemetry_carries_the_low_24_bits_of_a_position_and_no_error_without_power(void)
{
    struct ks_machine machine = rig_machine();
    machine.start_m[0] = 20.0e-3;
    machine.start_m[1] = -1.5e-3;
    rig_start(&rig, &machine);
    rig_telemetry_on(&rig);
    rig_nmt(&rig, 1);
    rig_ms(&rig, 100);
    const uint8_t *error = rig.telemetry[0].data, *position = rig.telemetry[1].data;
    const int32_t x = (int32_t)rig_read(&rig, 0x6064, 0), y = (int32_t)rig_read(&rig, 0x6864, 0);
    TEST_ASSERT_INT32_WITHIN(39, 20000000, x);
    TEST_ASSERT_INT32_WITHIN(39, -1500000, y);
    TEST_ASSERT_EQUAL_INT32(x - 0x1000000, i24(&position[2]));
    TEST_ASSERT_EQUAL_INT32(y, i24(&position[5]));
    TEST_ASSERT_EQUAL_INT32(0, i24(&error[2]));
    TEST_ASSERT_EQUAL_INT32(0, i24(&error[5]));
    TEST_ASSERT_EQUAL_UINT16(100, co_get(&error[0], 2));
    TEST_ASSERT_EQUAL_UINT16(100, co_get(&position[0], 2));
    TEST_ASSERT_EQUAL_UINT32(100, rig_read(&rig, 0x2020, 3));
    TEST_ASSERT_EQUAL_INT32(0, (int32_t)rig_read(&rig, 0x60F4, 0));
    TEST_ASSERT_EQUAL_INT32(0, (int32_t)rig_read(&rig, 0x68F4, 0));
}

static void test_telemetry_carries_forces_gains_and_energy_in_their_units(void)
{
    rig_enable(&rig);
    rig_telemetry_on(&rig); /* while the node is operational */
    rig_go(&rig, &stream, 695);
    struct servo_state *servo = &rig.device.drive.loop.servo; /* so that the two gains of a kind differ */
    servo->compensator.mu[0] = acc_from(NUM(175));            /* um/T0^2: 7 m/s2 */
    servo->compensator.mu[1] = acc_from(NUM(200));
    servo->smc.k_hat[0] = acc_from(NUM(1)); /* 1/T0: 200 1/s */
    servo->smc.k_hat[1] = acc_from(NUM(1.5));
    do { /* TPDO4 comes every 10 ms, TPDO5 every 20 */
        rig_ms(&rig, 1);
    } while (rig.telemetry_ms[2] != rig.ms - 1 || rig.telemetry_ms[3] != rig.ms - 1);
    const uint8_t *force = rig.telemetry[2].data, *energy = rig.telemetry[3].data;
    TEST_ASSERT_TRUE(rig.out.force_mN[0] != rig.out.force_mN[1]);
    TEST_ASSERT_INT16_WITHIN(1, rig.out.force_mN[0] / 100, i16(&force[0]));
    TEST_ASSERT_INT16_WITHIN(1, rig.out.force_mN[1] / 100, i16(&force[2]));
    const struct servo_snapshot *s = servo_loop_snapshot(&rig.device.drive.loop);
    TEST_ASSERT_EQUAL_UINT16(s->adaptive_gain_per_10s[0], co_get(&force[4], 2));
    TEST_ASSERT_EQUAL_UINT16(s->adaptive_gain_per_10s[1], co_get(&force[6], 2));
    TEST_ASSERT_EQUAL_UINT16(s->switching_gain_mmps2[0], co_get(&energy[0], 2));
    TEST_ASSERT_EQUAL_UINT16(s->switching_gain_mmps2[1], co_get(&energy[2], 2));
    TEST_ASSERT_UINT16_WITHIN(20, 7000, s->switching_gain_mmps2[0]);
    TEST_ASSERT_UINT16_WITHIN(20, 8000, s->switching_gain_mmps2[1]);
    TEST_ASSERT_UINT16_WITHIN(100, 2000, s->adaptive_gain_per_10s[0]);
    TEST_ASSERT_UINT16_WITHIN(100, 3000, s->adaptive_gain_per_10s[1]);
    TEST_ASSERT_UINT32_WITHIN(200, rig_read(&rig, 0x2220, 2) + rig_read(&rig, 0x2220, 3), co_get(&energy[4], 4));
    TEST_ASSERT_TRUE(co_get(&energy[4], 4) > 1000);
    TEST_ASSERT_INT32_WITHIN(3000, (int32_t)lround(rig.plant.vel_mps[0] * 1e6), (int32_t)rig_read(&rig, 0x606C, 0));
    TEST_ASSERT_INT32_WITHIN(3000, (int32_t)lround(rig.plant.vel_mps[1] * 1e6), (int32_t)rig_read(&rig, 0x686C, 0));
}

static void test_background_that_was_late_makes_up_for_the_milliseconds_it_missed(void)
{
    for (int i = 0; i < 3000; i++) {
        device_tick(&rig.device);
    }
    TEST_ASSERT_EQUAL_UINT(0, rig.heartbeats);
    device_poll(&rig.device);
    TEST_ASSERT_EQUAL_UINT(3, rig.heartbeats); /* one each 100 ms */
    TEST_ASSERT_EQUAL_UINT32(300, rig_read(&rig, 0x2020, 3));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_telemetry_carries_the_low_24_bits_of_a_position_and_no_error_without_power);
    RUN_TEST(test_telemetry_carries_forces_gains_and_energy_in_their_units);
    RUN_TEST(test_background_that_was_late_makes_up_for_the_milliseconds_it_missed);
    return UNITY_END();
}
