/* SPDX-License-Identifier: Apache-2.0 */
/* A master whose set-points come with each second or third SYNC only, as where its task is slower than its SYNC. */
#include <math.h>

#include "test_axis_modes.h"

enum { CSP = 8, LOCK_CYCLES = 20, LAPS = 3 };

static const double PI = 3.14159265358979;
static const double RADIUS_NM = 2e6, LAP_S = 1;
static const double SPEED_MMPS = 4 * PI; /* what the path has */
static const uint8_t no_data[1];

/* Laps to the left of the origin, of which the radius grows in the first one. */
static void path(double s, double nm[2])
{
    const double laps = fmax(0, s) / LAP_S;
    const double ramp = pow(sin(PI / 2 * fmin(1, laps)), 2);
    nm[0] = RADIUS_NM * ramp * (cos(2 * PI * laps) - 1);
    nm[1] = RADIUS_NM * ramp * sin(2 * PI * laps);
}

static void send_set_points(double s)
{
    uint8_t data[8];
    double nm[2];
    path(s, nm);
    co_put(&data[0], (uint32_t)(int32_t)lround(nm[0]), 4);
    co_put(&data[4], (uint32_t)(int32_t)lround(nm[1]), 4);
    rig_send(&rig, 0x401, 8, data);
}

/* Drive the laps; with `sync`, SYNC comes also where no set-point does. Returns the highest speed in mm/s. */
static double drive_laps(unsigned ms, unsigned every, bool sync)
{
    const unsigned cycles = LOCK_CYCLES + (unsigned)(LAPS * LAP_S * 1e3) / ms;
    double most = 0;
    set(0, 0x1402, 2, 1, 1);
    map_set_points(0x607A, 32);
    for (int i = 0; i < 2; i++) {
        set(i, 0x60C2, 1, 1, ms);
        mode(i, CSP);
    }
    rig_enable(&rig);
    for (unsigned k = 0; k < cycles; k++) {
        const bool told = k < LOCK_CYCLES || k % every == 0;
        if (told) {
            send_set_points(((double)k - LOCK_CYCLES) * ms * 1e-3);
        }
        if (told || sync) {
            rig_send(&rig, 0x80, 0, no_data);
        }
        for (unsigned i = 0; i < ms; i++) {
            rig_ms(&rig, 1);
            most = fmax(most, hypot(mmps(0), mmps(1)));
        }
    }
    return most;
}

static void test_set_points_that_come_with_some_syncs_only_are_followed_as_smoothly(void)
{
    static const unsigned periods[] = {1, 2, 4, 10};
    for (int p = 0; p < 4; p++) {
        for (unsigned every = 2; every <= 3; every++) {
            for (int sync = 0; sync < 2; sync++) {
                setUp();
                const double most = drive_laps(periods[p], every, sync == 1);
                TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
                TEST_ASSERT_TRUE(most > SPEED_MMPS);
                TEST_ASSERT_TRUE(most < 1.05 * SPEED_MMPS);
            }
        }
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_set_points_that_come_with_some_syncs_only_are_followed_as_smoothly);
    return UNITY_END();
}
