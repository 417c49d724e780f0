/* SPDX-License-Identifier: Apache-2.0 */
/* Cyclic modes over the bus: the whole firmware on a simulated machine, and a master whose SYNC is not punctual. */
#include <limits.h>
#include <math.h>
#include <string.h>

#include "test_axis_modes.h"

enum { CSP = 8, FOLLOWS = 12, UNDERRUN = 0xFF10, RANGE = 0xFF11, SWITCH = 0xFF12, ACCELERATION = 0xFF13 };

static const double PI = 3.14159265358979;
static const uint8_t no_data[1];

/* A master that sends set-points with each of its cycles. */
struct master {
    unsigned ms;         /* its cycle */
    double jitter;       /* of SYNC, as a part of the cycle */
    double ppm;          /* by which its clock is slower */
    unsigned lose, lost; /* so many set-points are lost from this cycle on, */
    unsigned lose_sync;  /* and the SYNC of this one */
    uint64_t random;
    unsigned cycle;                     /* the next one */
    uint64_t begin;                     /* control periods of the plant when cycle 0 was due */
    void (*at)(double s, double nm[2]); /* its path over its time */
};
static struct master master;

static double noise(void)
{
    master.random = master.random * 6364136223846793005u + 1442695040888963407u;
    return (double)(master.random >> 33) / 2147483648.0 * 2 - 1;
}

static void send_set_points(double x_nm, double y_nm)
{
    uint8_t data[8];
    co_put(&data[0], (uint32_t)(int32_t)lround(x_nm), 4);
    co_put(&data[4], (uint32_t)(int32_t)lround(y_nm), 4);
    rig_send(&rig, 0x401, 8, data);
}

static void stand_still(double s, double nm[2])
{
    (void)s;
    nm[0] = nm[1] = 0;
}

/* One lap of r = 20 mm at 100 mm/s from the origin on, with ramps of cos^2 in speed of 0.2 s. */
static const double R = 20e6, V = 100e6, RAMP = 0.2, START = 0.3;

static void circle(double s, double nm[2])
{
    const double t = fmax(0, s - START);
    const double whole = 2 * PI * R / V;
    double way = 0;
    if (t < RAMP) {
        way = V / 2 * (t - RAMP / PI * sin(PI * t / RAMP));
    } else if (t < whole) {
        way = V * (t - RAMP / 2);
    } else if (t < whole + RAMP) {
        const double left = whole + RAMP - t;
        way = V * whole - V / 2 * (left - RAMP / PI * sin(PI * left / RAMP));
    } else {
        way = V * whole;
    }
    nm[0] = R * (cos(way / R) - 1);
    nm[1] = R * sin(way / R);
}

static double mean_um, max_um, lag_ms;

/* Distance of the true position from the circle, and how far it is behind the master at its speed, while that is whole. */
static void measure(double s)
{
    static double sum;
    static unsigned samples;
    const double x = rig.plant.pos_m[0] * 1e9 + R, y = rig.plant.pos_m[1] * 1e9;
    if (s < START) {
        sum = max_um = lag_ms = 0;
        samples = 0;
    }
    if (s < START + RAMP || s > START + 2 * PI * R / V) {
        return;
    }
    const double e = fabs(hypot(x, y) - R) * 1e-3;
    sum += e;
    max_um = fmax(max_um, e);
    mean_um = sum / ++samples;
    const double ahead = (s - START) - RAMP / 2 - fmod(atan2(y, x) + 2 * PI, 2 * PI) * R / V;
    lag_ms = fabs(ahead) < 0.1 ? fmax(lag_ms, ahead * 1e3) : lag_ms; /* not where the angle begins anew */
}

static double master_s(void)
{
    return ((double)(rig.plant.period - master.begin)) * 1e-4 / (1 + master.ppm * 1e-6);
}

/* Let the master work for so many cycles. */
static void work(unsigned cycles)
{
    for (const unsigned end = master.cycle + cycles; master.cycle < end; master.cycle++) {
        const double due = master.cycle * master.ms * 10.0 * (1 + master.ppm * 1e-6);
        const uint64_t at = master.begin + (uint64_t)lround(due + noise() * master.jitter * master.ms * 10);
        while (rig.plant.period < at) {
            rig_run(&rig, 1);
            measure(master_s());
        }
        double nm[2];
        master.at(master.cycle * master.ms * 1e-3, nm);
        if (master.cycle < master.lose || master.cycle >= master.lose + master.lost) {
            send_set_points(nm[0], nm[1]);
        }
        if (master.cycle != master.lose_sync) {
            rig_send(&rig, 0x80, 0, no_data);
        }
    }
}

static void start_master(unsigned ms, double jitter, double ppm)
{
    master = (struct master){.ms = ms,
                             .jitter = jitter,
                             .ppm = ppm,
                             .lose = UINT_MAX,
                             .lose_sync = UINT_MAX,
                             .random = 1,
                             .at = stand_still};
    set(0, 0x1402, 2, 1, 1);
    map_set_points(0x607A, 32);
    for (int i = 0; i < 2; i++) {
        set(i, 0x60C2, 1, 1, ms);
    }
    rig_enable(&rig);
    rig_send(&rig, 0x80, 0, no_data); /* of which the modes so far know nothing */
    mode(0, CSP);
    mode(1, CSP);
    master.begin = rig.plant.period + 10;
}

static void lap(void)
{
    master.at = circle;
    work((unsigned)((START + 2 * PI * R / V + RAMP + 0.2) * 1e3) / master.ms);
}

static void expect_no_fault(void)
{
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
}

static void expect_stop(uint16_t emcy)
{
    rig_ms(&rig, 200);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, emcy));
    TEST_ASSERT_EQUAL_UINT(1, rig.emcy_count);
    rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
}

/* ---- the way ---- */

/* The same circle in mode 7: of what the master loses nothing. Knots are the quasi-interpolant of the way. */
static double lossless_um(void)
{
    double nm[3][2];
    setUp();
    rig_enable(&rig);
    master = (struct master){.ms = 1, .begin = rig.plant.period};
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2200, 1, 1, 1));
    int32_t sent[2] = {0, 0};
    for (unsigned i = 0; i < 2000; i++) {
        int32_t knot[2];
        for (int k = 0; k < 3; k++) {
            circle((i + (unsigned)k) * 1e-3 - 1e-3, nm[k]);
        }
        for (int axis = 0; axis < 2; axis++) {
            knot[axis] = (int32_t)lround(nm[1][axis] - (nm[0][axis] - 2 * nm[1][axis] + nm[2][axis]) / 6);
        }
        rig_knot(&rig, (uint8_t)i, knot[0] - sent[0], knot[1] - sent[1]);
        sent[0] = knot[0];
        sent[1] = knot[1];
        if (i == 200) {
            rig_controlwords(&rig, RUN, RUN);
            master.begin = rig.plant.period;
        }
        for (int k = 0; k < 10 && i >= 200; k++) {
            rig_run(&rig, 1);
            measure(master_s());
        }
    }
    return mean_um;
}

static void test_circle_by_set_points_is_as_good_as_by_a_stream(void)
{
    static const unsigned periods[] = {1, 2, 4, 10};
    static const double ppm[] = {0, 500, -500};
    const double lossless = lossless_um();
    TEST_ASSERT_TRUE(lossless > 0.01 && lossless < 0.1);
    for (int p = 0; p < 4; p++) {
        for (int k = 0; k < 3; k++) {
            setUp();
            start_master(periods[p], k == 0 ? 0 : 0.2, ppm[k]);
            lap();
            expect_no_fault();
            TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mm(0));
            TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mm(1));
            TEST_ASSERT_TRUE(mean_um < 1.5 * lossless);
            TEST_ASSERT_TRUE(max_um < 1);
        }
    }
}

/* Two cycles, or less; the rest is what a SYNC is late by, the control period and the law. */
static void test_lag_is_two_cycles_at_most(void)
{
    static const unsigned periods[] = {1, 2, 4, 10, 20};
    for (int p = 0; p < 5; p++) {
        setUp();
        start_master(periods[p], 0.2, 200);
        lap();
        expect_no_fault();
        TEST_ASSERT_TRUE(lag_ms < 2 * periods[p] + 0.3);
        TEST_ASSERT_TRUE(lag_ms > periods[p]);
    }
}

static void test_lost_set_points_and_a_lost_sync_are_bridged(void)
{
    static const unsigned periods[] = {1, 2, 4, 10};
    static const double most_um[] = {1, 1, 1, 2};
    for (int p = 0; p < 4; p++) {
        for (int k = 0; k < 2; k++) {
            setUp();
            start_master(periods[p], 0.2, 0);
            master.lose = k == 0 ? 900 / periods[p] : UINT_MAX;
            master.lost = 1;
            master.lose_sync = k == 1 ? 901 / periods[p] : UINT_MAX;
            lap();
            expect_no_fault();
            TEST_ASSERT_TRUE(max_um < most_um[p]);
            TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mm(1));
        }
    }
}

static void test_burst_that_a_gateway_held_back_is_followed(void)
{
    start_master(10, 0, 0);
    master.at = circle;
    work(90);
    master.begin += 40; /* 4 ms late, and then on time again */
    work(1);
    master.begin -= 40;
    work(100);
    expect_no_fault();
}

/* The master's computer was busy for three cycles, and sends all that it owes at once. */
static void test_burst_of_several_cycles_is_followed(void)
{
    static const unsigned periods[] = {2, 4, 10};
    for (int p = 0; p < 3; p++) {
        setUp();
        start_master(periods[p], 0, 0);
        master.at = circle;
        work(900 / periods[p]);
        rig_ms(&rig, 3 * periods[p]);
        const uint64_t begin = master.begin;
        master.begin -= 30 * periods[p];
        work(2);
        master.begin = begin;
        work(1000 / periods[p]);
        expect_no_fault();
    }
}

/* ---- what is no set-point that can be followed ---- */

/* The drive's own time stood still meanwhile, or its bus. */
static void test_flood_of_set_points_from_the_future_is_a_stop_along_the_tangent(void)
{
    static const unsigned periods[] = {1, 2, 4, 10};
    for (int p = 0; p < 4; p++) {
        for (unsigned ms = 40; ms < 160; ms += 20) { /* less may be within 2130h acceleration */
            setUp();
            start_master(periods[p], 0, 0);
            master.at = circle;
            work(900 / periods[p]);
            master.begin -= 10 * ms;
            work(ms / periods[p]);
            double fastest = 0;
            for (int k = 0; k < 300; k++) {
                rig_ms(&rig, 1);
                fastest = fmax(fastest, hypot(mmps(0), mmps(1)));
            }
            rig_expect_states(&rig, RIG_FAULT, RIG_FAULT);
            TEST_ASSERT_TRUE(rig.emcy[0] == ACCELERATION || rig.emcy[0] == UNDERRUN || rig.emcy[0] == RANGE);
            TEST_ASSERT_TRUE(fastest < 200);
            TEST_ASSERT_DOUBLE_WITHIN(1e-2, 0, hypot(mmps(0), mmps(1)));
        }
    }
}

static void test_master_that_falls_silent_on_its_way_is_an_underrun(void)
{
    static const unsigned periods[] = {1, 2, 10};
    for (int p = 0; p < 3; p++) {
        for (int k = 0; k < 2; k++) {
            setUp();
            start_master(periods[p], 0, 0);
            master.at = circle;
            if (k == 0) { /* SYNC goes on */
                master.lose = 900 / periods[p];
                master.lost = 1000;
            }
            work(1000 / periods[p]);
            expect_stop(UNDERRUN);
            TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mmps(0));
            TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mmps(1));
        }
    }
}

static void test_master_that_falls_silent_at_rest_is_none(void)
{
    start_master(2, 0, 0);
    work(100);
    rig_ms(&rig, 500);
    expect_no_fault();
    TEST_ASSERT_TRUE(status(0, FOLLOWS));
}

static void test_syncs_that_cease_for_eight_cycles_at_rest_matter_nothing(void)
{
    start_master(2, 0, 0);
    work(50);
    for (unsigned missing = 6; missing < 10; missing++) {
        master.begin += missing * 20;
        work(20);
        expect_no_fault();
    }
    master.at = circle;
    work(200);
    expect_no_fault();
}

static void far_away(double s, double nm[2])
{
    nm[0] = 0;
    nm[1] = s < 0 ? 0 : 11e3;
}

static void test_first_set_point_further_than_start_window_is_a_fault_and_moves_nothing(void)
{
    start_master(2, 0, 0);
    master.at = far_away;
    work(20);
    expect_stop(RANGE);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0, mm(1));
}

static void near_by(double s, double nm[2])
{
    (void)s;
    nm[0] = 9e3;
    nm[1] = -9e3;
}

static void test_distance_to_the_first_set_point_is_made_up_for_gently(void)
{
    start_master(1, 0, 0);
    master.at = near_by;
    double fastest = 0;
    for (int i = 0; i < 300; i++) {
        work(1);
        fastest = fmax(fastest, fabs(mmps(0)));
    }
    expect_no_fault();
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 9e-3, mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, -9e-3, mm(1));
    TEST_ASSERT_TRUE(fastest < 0.5);
}

static double jump_nm;

static void jump(double s, double nm[2])
{
    nm[0] = s < 0.2 ? 0 : jump_nm;
    nm[1] = 0;
}

static void test_second_sync_within_a_cycle_loses_no_set_point(void)
{
    start_master(4, 0, 0);
    work(20);
    send_set_points(3000, 0);
    rig_send(&rig, 0x80, 0, no_data);
    rig_send(&rig, 0x80, 0, no_data);
    TEST_ASSERT_EQUAL_INT32(3000, rig.device.drive.path.modes.cyclic.axis[0].told_nm);
    jump_nm = 3000;
    master.at = jump;
    master.cycle = 60; /* after its jump */
    master.begin = rig.plant.period - 59 * 40;
    work(30);
    TEST_ASSERT_DOUBLE_WITHIN(2e-4, 3e-3, mm(0));
    expect_no_fault();
}

static void test_jump_is_a_fault_by_its_acceleration(void)
{
    static const double jumps[] = {1e6, -1e6, 81e3, -81e3}; /* at 2 ms, 80 um are 20 m/s2 */
    for (int k = 0; k < 4; k++) {
        setUp();
        start_master(2, 0, 0);
        master.at = jump;
        jump_nm = jumps[k];
        work(120);
        expect_stop(ACCELERATION);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, mm(0));
    }
}

static double drift_nmps;

static void drift(double s, double nm[2])
{
    const double t = fmax(0, s - 0.1);
    nm[0] = drift_nmps * (t < 0.1 ? t * t / 0.2 : t - 0.05);
    nm[1] = 0;
}

static void test_set_points_that_leave_the_soft_limits_stop_inside_of_them(void)
{
    for (int k = 0; k < 2; k++) {
        setUp();
        start_master(2, 0, 0);
        set(0, 0x607D, 1, 4, -20000000);
        set(0, 0x607D, 2, 4, 20000000);
        master.at = drift;
        drift_nmps = k == 0 ? 100e6 : -100e6;
        work(300);
        expect_stop(RANGE);
        TEST_ASSERT_TRUE(fabs(mm(0)) < 20.001);
        TEST_ASSERT_TRUE(fabs(mm(0)) > 12);
    }
}

static double from_nm;

static void drift_on(double s, double nm[2])
{
    drift(s, nm);
    nm[0] += from_nm;
}

static void test_limit_switch_stops_the_path_of_set_points(void)
{
    start_at(0.19, 0); /* the switch is at 198 mm */
    set(0, 0x607D, 2, 4, 250000000);
    start_master(2, 0, 0);
    from_nm = (int32_t)rig_read(&rig, 0x6064, 0);
    master.at = drift_on;
    drift_nmps = 20e6;
    work(400);
    expect_stop(SWITCH);
    TEST_ASSERT_DOUBLE_WITHIN(1, 198.6, mm(0));
}

/* ---- stops ---- */

static void test_every_stop_is_obeyed(void)
{
    for (unsigned n = 0; n < sizeof axis_stops / sizeof axis_stops[0]; n++) {
        setUp();
        start_master(4, 0.1, 0);
        master.at = circle;
        work(200);
        TEST_ASSERT_TRUE(status(0, FOLLOWS) && status(1, FOLLOWS));
        TEST_ASSERT_DOUBLE_WITHIN(1, 100, hypot(mmps(0), mmps(1)));
        rig_controlwords(&rig, axis_stops[n].word, axis_stops[n].word);
        work(2);
        TEST_ASSERT_FALSE(status(0, FOLLOWS) || status(1, FOLLOWS));
        TEST_ASSERT_TRUE(hypot(mmps(0), mmps(1)) < 99.9);
        work(100); /* its master goes on all the same */
        rig_expect_states(&rig, axis_stops[n].state, axis_stops[n].state);
        TEST_ASSERT_DOUBLE_WITHIN(0.1, 0, mmps(0));
        TEST_ASSERT_DOUBLE_WITHIN(0.1, 0, mmps(1));
        TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    }
}

static double stopped_nm[2];

static void stay(double s, double nm[2])
{
    (void)s;
    nm[0] = stopped_nm[0];
    nm[1] = stopped_nm[1];
}

static void test_halt_ends_where_the_master_takes_the_axes_up_again(void)
{
    start_master(4, 0, 0);
    master.at = circle;
    work(200);
    rig_controlwords(&rig, RUN | HALT, RUN | HALT);
    work(100);
    for (int i = 0; i < 2; i++) {
        stopped_nm[i] = (int32_t)rig_read(&rig, (uint16_t)(0x6064 + 0x800 * i), 0);
    }
    master.at = stay;
    work(2);
    rig_controlwords(&rig, ENABLE, ENABLE);
    work(100);
    expect_no_fault();
    TEST_ASSERT_TRUE(status(0, FOLLOWS) && status(1, FOLLOWS));
}

static void halt_on_a_circle(void)
{
    start_master(4, 0, 0);
    master.at = circle;
    work(200);
    rig_controlwords(&rig, RUN | HALT, RUN | HALT);
}

static void test_halt_that_ends_elsewhere_is_a_fault(void)
{
    halt_on_a_circle();
    work(100);
    rig_controlwords(&rig, ENABLE, ENABLE);
    work(2);
    expect_stop(RANGE);
}

static void test_halt_that_ends_before_the_axes_stand_waits_for_this(void)
{
    halt_on_a_circle();
    work(2);
    rig_controlwords(&rig, ENABLE, ENABLE);
    work(10);
    TEST_ASSERT_FALSE(status(0, FOLLOWS));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    work(100); /* by then the circle is elsewhere */
    expect_stop(RANGE);
}

/* ---- one axis, then the other ---- */

static void test_axis_by_itself_follows_while_the_other_one_jogs(void)
{
    start_master(2, 0.2, 0);
    mode(1, VELOCITY);
    master.at = drift;
    drift_nmps = 30e6;
    velocity(1, -20000);
    work(300);
    expect_no_fault();
    TEST_ASSERT_DOUBLE_WITHIN(0.2, 30, mmps(0));
    TEST_ASSERT_DOUBLE_WITHIN(0.1, -20, mmps(1));
    TEST_ASSERT_FALSE(status(1, FOLLOWS));
}

static void test_axis_y_follows_alone(void)
{
    start_master(2, 0, 0);
    mode(0, PATH);
    set(0, 0x60C2, 1, 1, 7); /* not that of a cyclic mode */
    master.at = near_by;
    work(200);
    expect_no_fault();
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0, mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, -9e-3, mm(1));
}

static void test_second_axis_is_enabled_while_the_first_one_rests_at_its_set_point(void)
{
    start_master(2, 0, 0);
    rig_controlwords(&rig, ENABLE, SHUTDOWN);
    master.at = near_by;
    work(200);
    rig_expect_states(&rig, RIG_ENABLED, RIG_READY);
    rig_controlwords(&rig, ENABLE, ENABLE);
    work(200);
    expect_no_fault();
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 9e-3, mm(0));
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, -9e-3, mm(1));
}

static void both(double s, double nm[2])
{
    drift(s, nm);
    nm[1] = s < 0.6 ? 0 : 1e6 * (s - 0.6);
}

static void test_second_axis_joins_the_first_one_on_its_way(void)
{
    start_master(2, 0, 0);
    master.at = both;
    drift_nmps = 30e6;
    mode(1, PATH);
    work(200);
    TEST_ASSERT_TRUE(status(0, FOLLOWS));
    mode(1, CSP);
    work(200);
    expect_no_fault();
    TEST_ASSERT_TRUE(status(1, FOLLOWS));
    TEST_ASSERT_DOUBLE_WITHIN(0.1, 1, mmps(1));
}

static void test_mode_is_left_at_standstill_and_the_period_stays_while_an_axis_follows(void)
{
    start_master(2, 0, 0);
    master.at = drift;
    drift_nmps = 30e6;
    work(100);
    TEST_ASSERT_EQUAL_HEX32(ABORT_STATE, rig_write(&rig, 0x60C2, 1, 1, 4));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x6060, 0, 1, VELOCITY));
    work(20);
    TEST_ASSERT_EQUAL(CSP, rig_read(&rig, 0x6061, 0));
    rig_controlwords(&rig, RUN | HALT, ENABLE);
    work(100);
    TEST_ASSERT_EQUAL(VELOCITY, rig_read(&rig, 0x6061, 0));
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
}

static void test_set_points_by_sdo_count_from_the_next_sync_on(void)
{
    start_master(20, 0, 0);
    for (int k = 0; k < 20; k++) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x607A, 0, 4, k < 8 ? 0 : 5000));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x687A, 0, 4, 0));
        rig_send(&rig, 0x80, 0, no_data);
        rig_ms(&rig, 20);
    }
    expect_no_fault();
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 5e-3, mm(0));
}

static void test_set_point_that_is_written_once_before_enabling_is_followed(void)
{
    start_master(10, 0, 0);
    rig_controlwords(&rig, SHUTDOWN, SHUTDOWN);
    set(0, 0x607A, 0, 4, 4000);
    set(1, 0x607A, 0, 4, 0);
    master.lose = 0;
    master.lost = 1000;
    work(10);
    rig_controlwords(&rig, ENABLE, ENABLE);
    work(20);
    expect_no_fault();
    TEST_ASSERT_DOUBLE_WITHIN(2e-4, 4e-3, mm(0));
}

static void test_axis_rests_at_its_set_point_while_the_other_one_jogs_on(void)
{
    start_master(2, 0, 0);
    mode(1, VELOCITY);
    master.at = near_by;
    velocity(1, -10000);
    work(500);
    expect_no_fault();
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 9e-3, mm(0));
    TEST_ASSERT_TRUE(status(0, FOLLOWS));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_circle_by_set_points_is_as_good_as_by_a_stream);
    RUN_TEST(test_lag_is_two_cycles_at_most);
    RUN_TEST(test_lost_set_points_and_a_lost_sync_are_bridged);
    RUN_TEST(test_burst_that_a_gateway_held_back_is_followed);
    RUN_TEST(test_burst_of_several_cycles_is_followed);
    RUN_TEST(test_second_sync_within_a_cycle_loses_no_set_point);
    RUN_TEST(test_flood_of_set_points_from_the_future_is_a_stop_along_the_tangent);
    RUN_TEST(test_master_that_falls_silent_on_its_way_is_an_underrun);
    RUN_TEST(test_master_that_falls_silent_at_rest_is_none);
    RUN_TEST(test_syncs_that_cease_for_eight_cycles_at_rest_matter_nothing);
    RUN_TEST(test_first_set_point_further_than_start_window_is_a_fault_and_moves_nothing);
    RUN_TEST(test_distance_to_the_first_set_point_is_made_up_for_gently);
    RUN_TEST(test_jump_is_a_fault_by_its_acceleration);
    RUN_TEST(test_set_points_that_leave_the_soft_limits_stop_inside_of_them);
    RUN_TEST(test_limit_switch_stops_the_path_of_set_points);
    RUN_TEST(test_every_stop_is_obeyed);
    RUN_TEST(test_halt_ends_where_the_master_takes_the_axes_up_again);
    RUN_TEST(test_halt_that_ends_elsewhere_is_a_fault);
    RUN_TEST(test_halt_that_ends_before_the_axes_stand_waits_for_this);
    RUN_TEST(test_set_point_that_is_written_once_before_enabling_is_followed);
    RUN_TEST(test_axis_rests_at_its_set_point_while_the_other_one_jogs_on);
    RUN_TEST(test_axis_by_itself_follows_while_the_other_one_jogs);
    RUN_TEST(test_axis_y_follows_alone);
    RUN_TEST(test_second_axis_is_enabled_while_the_first_one_rests_at_its_set_point);
    RUN_TEST(test_second_axis_joins_the_first_one_on_its_way);
    RUN_TEST(test_mode_is_left_at_standstill_and_the_period_stays_while_an_axis_follows);
    RUN_TEST(test_set_points_by_sdo_count_from_the_next_sync_on);
    return UNITY_END();
}
