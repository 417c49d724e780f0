/* SPDX-License-Identifier: Apache-2.0 */
/* What the objects tell of numbers that they cannot hold, and the background on a bus that gives it no rest. */
#include "drive_rig.h"

static struct rig rig;
static unsigned given;

void setUp(void)
{
    const struct ks_machine machine = rig_machine();
    rig_start(&rig, &machine);
    rig_ms(&rig, 2);
}

void tearDown(void)
{
}

static void energies(int32_t x_mJ, int32_t y_mJ)
{
    rig.device.drive.loop.servo.energy[0].mJ = x_mJ;
    rig.device.drive.loop.servo.energy[1].mJ = y_mJ;
    rig_ms(&rig, 1);
}

static void test_energy_that_an_axis_gave_back_is_reported_as_none(void)
{
    energies(-2000, 5000);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2220, 2));
    TEST_ASSERT_UINT32_WITHIN(1, 5000, rig_read(&rig, 0x2220, 3));
    TEST_ASSERT_UINT32_WITHIN(1, 3000, rig.device.od.telemetry.energy); /* of both */
    energies(2000, -5000);
    TEST_ASSERT_UINT32_WITHIN(1, 2000, rig_read(&rig, 0x2220, 2));
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2220, 3));
    TEST_ASSERT_EQUAL_UINT32(0, rig.device.od.telemetry.energy);
}

static void test_mean_of_the_contour_error_ends_at_the_largest_number(void)
{
    rig.device.drive.loop.contour_statistics =
        (struct contour_statistics){.sum_nm = 2 * 4294967, .samples = 2, .max_nm = 4294967};
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_UINT32(4294967000, rig_read(&rig, 0x2211, 1)); /* pm */
    rig.device.drive.loop.contour_statistics.sum_nm = 2 * 4294968;
    rig_ms(&rig, 1);
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, rig_read(&rig, 0x2211, 1));
}

static void test_friction_and_mass_that_ccu_has_learned_are_reported_for_each_axis(void)
{
    struct feedforward_state *learned = &rig.device.drive.loop.servo.feedforward;
    learned->friction[0] = acc_from(NUM(1.5)); /* N */
    learned->friction[1] = acc_from(NUM(-2.5));
    learned->mass[0] = acc_from(NUM(0.125)); /* N T0^2/um: 25 kg */
    learned->mass[1] = acc_from(NUM(-0.25));
    rig_ms(&rig, 2);
    TEST_ASSERT_EQUAL_INT32(1500, (int32_t)rig_read(&rig, 0x2102, 1)); /* mN */
    TEST_ASSERT_EQUAL_INT32(-2500, (int32_t)rig_read(&rig, 0x2902, 1));
    TEST_ASSERT_EQUAL_INT32(3125, (int32_t)rig_read(&rig, 0x2102, 2)); /* g */
    TEST_ASSERT_EQUAL_INT32(-6250, (int32_t)rig_read(&rig, 0x2902, 2));
}

static void test_inputs_of_each_axis_are_reported_in_their_bits_of_60FDh(void)
{
    for (int axis = 0; axis < 2; axis++) {
        for (unsigned bit = 0; bit < 8; bit++) {
            rig.inputs[axis] = (uint8_t)(1u << bit);
            rig_ms(&rig, 2);
            const uint32_t expected = bit < 4 ? 1u << bit : 1u << (bit + 12); /* the manufacturer's from bit 16 on */
            TEST_ASSERT_EQUAL_HEX32(expected, rig_read(&rig, axis == 0 ? 0x60FD : 0x68FD, 0));
            TEST_ASSERT_EQUAL_HEX32(0, rig_read(&rig, axis == 0 ? 0x68FD : 0x60FD, 0));
        }
        rig.inputs[axis] = 0;
    }
}

static void test_controlword_of_y_alone_in_a_pdo_commands_y_alone(void)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1400, 1, 4, 0x80000201));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1600, 0, 1, 0));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1600, 1, 4, 0x68400010));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1600, 0, 1, 1));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x1400, 1, 4, 0x201));
    rig_nmt(&rig, 1);
    rig_ms(&rig, 3);
    const uint8_t shutdown[2] = {0x06};
    rig_send(&rig, 0x201, 2, shutdown);
    rig_expect_states(&rig, RIG_DISABLED, RIG_READY);
}

/* A bus on which there is always another frame */
static bool flood(void *ctx, struct can_frame *frame)
{
    (void)ctx;
    given++;
    *frame = (struct can_frame){.id = 0x123, .len = 8};
    return true;
}

static void test_bus_that_is_never_empty_does_not_keep_the_drive_from_its_work(void)
{
    rig_enable(&rig);
    rig_ms(&rig, 100); /* the heartbeat is watched from its first one on */
    rig.hal.can_receive = flood;
    given = 0;
    device_poll(&rig.device);
    TEST_ASSERT_EQUAL_UINT(64, given);
    rig.heartbeat_every_ms = 0; /* nothing of the master comes through */
    rig_ms(&rig, 400);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, 0x8130));
    TEST_ASSERT_FALSE(rig.out.enable[0] || rig.out.enable[1]);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_energy_that_an_axis_gave_back_is_reported_as_none);
    RUN_TEST(test_mean_of_the_contour_error_ends_at_the_largest_number);
    RUN_TEST(test_friction_and_mass_that_ccu_has_learned_are_reported_for_each_axis);
    RUN_TEST(test_inputs_of_each_axis_are_reported_in_their_bits_of_60FDh);
    RUN_TEST(test_controlword_of_y_alone_in_a_pdo_commands_y_alone);
    RUN_TEST(test_bus_that_is_never_empty_does_not_keep_the_drive_from_its_work);
    return UNITY_END();
}
