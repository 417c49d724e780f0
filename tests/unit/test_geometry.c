/* SPDX-License-Identifier: Apache-2.0 */
/* test_geometry.c: the position of the tool, from the positions of the encoders. */
#include "core/geometry.h"

#include <math.h>

#include "core/screw.h"
#include "nominal.h"
#include "unity.h"

static struct geometry_cfg cfg;
static struct geometry_state state;
static double at_mm[2]; /* the encoders */
static int32_t origin_nm[2];
static vec2 r_dot, r_ddot; /* of the reference */
static double direction[2];
static double tool_um[2];    /* the tool, less the encoder */
static double largest_um[2]; /* largest change of it in a period */

void setUp(void)
{
    cfg = (struct geometry_cfg){.on = true, .dt = mk(DT)};
    geometry_reset(&state);
    r_dot = r_ddot = mk2(0, 0);
    for (int i = 0; i < 2; i++) {
        cfg.axis[i].side_bandwidth = mk(GEOMETRY_SIDE_BANDWIDTH);
        at_mm[i] = 0;
        origin_nm[i] = 0;
        direction[i] = 0;
        largest_um[i] = 0;
    }
}
void tearDown(void)
{
}

static void step(unsigned periods)
{
    for (unsigned k = 0; k < periods; k++) {
        const bool first = !state.started;
        const pos_t encoder[2] = {pos_from_nm(llround(at_mm[0] * 1e6)), pos_from_nm(llround(at_mm[1] * 1e6))};
        geometry_step(&cfg, &state, encoder, origin_nm, -1);
        geometry_push(&cfg, &state, 0, r_dot.x, r_ddot.x, mk(direction[0]));
        geometry_push(&cfg, &state, 1, r_dot.y, r_ddot.y, mk(direction[1]));
        const vec2 tool = v2_add(v2_add(state.position, state.turn), state.force);
        for (int i = 0; i < 2; i++) {
            const double before = tool_um[i];
            tool_um[i] = val(i == 0 ? tool.x : tool.y);
            largest_um[i] = first ? 0 : fmax(largest_um[i], fabs(tool_um[i] - before));
        }
    }
}

static void expect(double x_um, double y_um)
{
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, x_um, tool_um[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, y_um, tool_um[1]);
}

/* ---- by position ---- */

static void map_of(int axis, uint32_t points, int32_t start_nm, uint32_t step_nm, const double lead_um[])
{
    struct geometry_axis_cfg *a = &cfg.axis[axis];
    a->points = points;
    a->start_nm = start_nm;
    a->step_nm = step_nm;
    for (uint32_t k = 0; k < points; k++) {
        a->lead[k] = mk(lead_um[k]);
    }
}

static void test_nothing_told_leaves_the_tool_at_the_encoders(void)
{
    at_mm[0] = 123.456789;
    at_mm[1] = -98.7654321;
    r_dot = mk2(100, -100);
    r_ddot = mk2(20, -20);
    step(100);
    TEST_ASSERT_EQUAL_DOUBLE(0, tool_um[0]);
    TEST_ASSERT_EQUAL_DOUBLE(0, tool_um[1]);
}

static void test_map_is_linear_between_its_points_and_constant_beyond(void)
{
    map_of(0, 3, -10000000, 10000000, (const double[]){-4, 2, 7});
    map_of(1, 2, 0, 1000000000, (const double[]){1, -3});
    const struct {
        double at_mm[2], um[2];
    } expected[] = {
        {{-100, -5}, {-4, 1}},        {{-10, 0}, {-4, 1}},         {{-7.5, 250}, {-2.5, 0}}, {{0, 500}, {2, -1}},
        {{5, 999.9}, {4.5, -2.9996}}, {{9.999999, 1000}, {7, -3}}, {{10, 2000}, {7, -3}},    {{2000, -2000}, {7, 1}},
    };
    for (unsigned k = 0; k < sizeof expected / sizeof expected[0]; k++) {
        at_mm[0] = expected[k].at_mm[0];
        at_mm[1] = expected[k].at_mm[1];
        step(1);
        expect(expected[k].um[0], expected[k].um[1]);
    }
}

static void test_map_is_by_the_users_position(void)
{
    map_of(0, 2, 0, 10000000, (const double[]){0, 10});
    origin_nm[0] = 3000000;
    at_mm[0] = 4;
    step(1);
    expect(7, 0);
}

static void test_position_beyond_all_numbers_of_a_map_is_its_end(void)
{
    map_of(0, 2, -2000000000, 1000, (const double[]){1, 2});
    origin_nm[0] = INT32_MAX;
    at_mm[0] = 1900;
    step(1);
    expect(2, 0);
}

static void test_squareness_is_a_share_of_the_other_axis(void)
{
    cfg.axis[0].squareness = mk(0.2); /* um/mm: 0.2 mrad */
    cfg.axis[1].squareness = mk(-0.3);
    at_mm[0] = 100;
    at_mm[1] = 10;
    origin_nm[1] = 10000000; /* 20 mm from the user's zero */
    step(1);
    expect(-0.3 * 20, 0.2 * 100);
}

static void test_first_period_has_the_whole_correction(void)
{
    map_of(0, 2, 0, 10000000, (const double[]){50, 50});
    step(1);
    expect(50, 0);
    geometry_reset(&state);
    origin_nm[0] = 123;
    step(1);
    expect(50, 0);
}

static void test_new_origin_takes_effect_without_a_step(void)
{
    map_of(0, 2, 0, 10000000, (const double[]){0, 20});
    cfg.axis[0].squareness = mk(1);
    at_mm[0] = 1;
    step(1);
    expect(2, 1);
    origin_nm[0] = 4000000;
    step(1);
    largest_um[0] = largest_um[1] = 0;
    step(100);
    expect(2 + 101 * DT, 1 + 101 * DT); /* 1 um/T0 */
    step(1000);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, DT, largest_um[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, DT, largest_um[1]);
    expect(10, 5);
    origin_nm[0] = 0; /* and back */
    step(1);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 10 - DT, tool_um[0]);
    step(1000);
    expect(2, 1);
    at_mm[0] = 3; /* the map itself is followed at once */
    step(1);
    expect(6, 3);
}

/* ---- by angle ---- */

/* A screw of 5 mm a turn. */
static void once_a_turn(int axis, double cos_um, double sin_um)
{
    cfg.axis[axis].turns = screw_turns(5000000);
    cfg.axis[axis].error_cos = mk(cos_um);
    cfg.axis[axis].error_sin = mk(sin_um);
}

static void test_error_once_a_turn_goes_by_the_angle_of_the_screw(void)
{
    once_a_turn(0, 4, -3);
    once_a_turn(1, 0, 2);
    for (int k = -12; k <= 12; k++) {
        const double angle = 2 * 3.14159265358979 * k / 8;
        at_mm[0] = 1000 + 5.0 * k / 8;
        at_mm[1] = -5.0 * k / 8;
        step(1);
        expect(4 * cos(angle) - 3 * sin(angle), -2 * sin(angle));
        TEST_ASSERT_EQUAL_DOUBLE(0, val(state.position.x));
    }
}

static void test_error_once_a_turn_is_by_the_users_position(void)
{
    once_a_turn(0, 4, 0);
    at_mm[0] = 1;
    origin_nm[0] = 1500000;
    step(1);
    expect(-4, 0); /* half a turn */
}

static void test_new_origin_turns_the_screw_without_a_step(void)
{
    once_a_turn(0, 4, 0);
    step(1);
    expect(4, 0);
    origin_nm[0] = 2500000;
    step(1);
    expect(4 - DT, 0); /* 1 um/T0 */
    step(99);
    expect(4 - 100 * DT, 0);
    step(1000);
    expect(-4, 0);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, DT, largest_um[0]);
    at_mm[0] = 2.5; /* the error itself is followed at once */
    step(1);
    expect(4, 0);
}

static void turn(int n)
{
    const pos_t encoder[2] = {pos_from_nm(llround(at_mm[0] * 1e6)), pos_from_nm(llround(at_mm[1] * 1e6))};
    geometry_step(&cfg, &state, encoder, origin_nm, n);
}

static void test_axes_take_turns_and_a_new_origin_is_the_turn_of_both(void)
{
    for (int i = 0; i < 2; i++) {
        once_a_turn(i, 4, 0);
        map_of(i, 2, 0, 10000000, (const double[]){0, 10});
    }
    turn(0); /* the first one is that of all */
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 4, val(state.turn.y));
    for (int n = 0; n < 4; n++) {
        at_mm[0] = at_mm[1] = n < 2 ? 2.5 : 5;
        turn(n);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, n < 2 ? -4 : 4, val(n % 2 == 0 ? state.turn.x : state.turn.y));
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, n == 0 || n == 3 ? 4 : -4, val(state.turn.y));
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, n < 2 ? 0 : 5, val(state.position.x));
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, n < 3 ? 0 : 5, val(state.position.y));
    }
    for (int i = 0; i < 2; i++) {
        at_mm[0] = at_mm[1] = 2.5;
        origin_nm[i] = 2500000; /* turns the screw of axis i by a half */
        turn(0);
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, i == 0 ? -4 : 4, val(state.axis[1].turn.placed));
        TEST_ASSERT_DOUBLE_WITHIN(1e-3, 4, val(state.axis[0].turn.placed));
    }
}

/* Where an origin has changed, map and angle go to what they are at 0.2 mm/s, in whatever turns they come. */
static void test_new_origin_takes_effect_at_one_rate_in_all_turns(void)
{
    map_of(0, 2, 0, 10000000, (const double[]){0, 10});
    turn(0);
    origin_nm[0] = 10000000;
    turn(0);
    cfg.dt = mk(2 * DT); /* of two periods, which is a turn */
    for (int k = 0; k < 100; k++) {
        turn(k % 4);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 100 * DT, val(state.position.x));
}

/* ---- by force ---- */

static void spring(int axis)
{
    cfg.axis[axis].compliance = mk(0.25); /* 4 N/um */
    cfg.axis[axis].mass = mk(2);          /* 50 kg */
    cfg.axis[axis].coulomb = mk(8);
    cfg.axis[axis].viscous = mk(0.5);
}

static void test_table_hangs_back_by_the_force_on_it(void)
{
    spring(0);
    r_ddot = mk2(10, 10);
    step(1000);
    expect(-0.25 * 20, 0);
    r_ddot = mk2(0, 0);
    r_dot = mk2(-40, -40);
    step(1000);
    expect(0.25 * 20, 0);
    r_dot = mk2(0, 0);
    direction[0] = 0.5;
    step(1000);
    expect(-0.25 * 4, 0);
}

static void test_deflection_of_each_axis_is_its_own(void)
{
    spring(1);
    r_dot = mk2(1, 4);
    r_ddot = mk2(1, 5);
    direction[1] = -1;
    step(1000);
    expect(0, -0.25 * (10 + 2 - 8));
}

static void test_deflection_changes_by_2_mm_per_s_at_most(void)
{
    spring(0);
    step(1);
    r_ddot = mk2(10, 0);
    step(10);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, -10 * 10 * DT, tool_um[0]);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 10 * DT, largest_um[0]);
}

static void test_side_of_a_gap_follows_the_force_and_stays_where_nothing_pushes(void)
{
    cfg.axis[0].half_gap = cfg.axis[1].half_gap = mk(6);
    cfg.axis[0].mass = cfg.axis[1].mass = mk(2);
    step(10);
    expect(0, 0); /* nothing has pushed yet */
    r_ddot = mk2(1, -1);
    step(400);
    expect(-6, 6);
    r_ddot = mk2(0.002, 0.002); /* 4 mN */
    step(400);
    expect(-6, 6);
    r_ddot = mk2(0, 0);
    step(400);
    expect(-6, 6);
    r_ddot = mk2(-0.003, 0.003);
    step(400);
    expect(6, -6);
}

static void test_force_and_not_the_motion_decides_the_side(void)
{
    cfg.axis[0].half_gap = mk(6);
    cfg.axis[0].mass = mk(2);
    cfg.axis[0].coulomb = mk(1);
    direction[0] = 1;
    r_ddot = mk2(-1, 0); /* the table is braked by 2 N, of which its friction takes 1 N */
    step(400);
    expect(6, 0);
}

static void test_table_of_which_nothing_is_known_follows_the_motion(void)
{
    cfg.axis[0].half_gap = cfg.axis[1].half_gap = mk(6);
    direction[0] = 1;
    direction[1] = -1;
    step(400);
    expect(-6, 6);
    direction[0] = 0;
    direction[1] = 0.6;
    step(400);
    expect(-6, -6);
}

/* The response 1 - (1 + w t) exp(-w t) of two equal poles */
static void test_side_changes_smoothly_in_some_milliseconds(void)
{
    cfg.axis[0].half_gap = mk(10);
    direction[0] = 1;
    double before_um = 0, before_change_um = 0;
    for (int k = 1; k <= 100; k++) {
        step(1);
        const double wt = GEOMETRY_SIDE_BANDWIDTH * DT * k;
        TEST_ASSERT_DOUBLE_WITHIN(0.4, 10 * (1 - (1 + wt) * exp(-wt)), -tool_um[0]);
        const double change_um = tool_um[0] - before_um;
        TEST_ASSERT_DOUBLE_WITHIN(0.085, before_change_um, change_um); /* at most 10 um (w dt)^2 */
        before_um = tool_um[0];
        before_change_um = change_um;
    }
}

/* The force m_0 g b'' moves what is before the gap by what the side says, and is 0 in the end. */
static void test_force_of_the_gap_moves_the_mass_before_it_across(void)
{
    cfg.axis[0].half_gap = cfg.axis[1].half_gap = mk(6);
    cfg.axis[0].gap_inertia = mk(2 * 6);
    direction[0] = direction[1] = 1;
    step(1); /* the first period starts at rest */
    double velocity = 0, moved_um = -tool_um[0];
    for (int k = 0; k < 400; k++) {
        step(1);
        velocity += DT * val(state.axis[0].gap_force) / 2;
        moved_um += DT * velocity;
        if (k == 0) {
            velocity = val(state.axis[0].side_rate) * 6;
            moved_um = -tool_um[0];
        }
        TEST_ASSERT_DOUBLE_WITHIN(0.01, -tool_um[0], moved_um);
    }
    TEST_ASSERT_DOUBLE_WITHIN(0.01, 6, moved_um);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, val(state.axis[0].gap_force));
    TEST_ASSERT_DOUBLE_WITHIN(0, 0, val(state.axis[1].gap_force)); /* its mass is not known */
}

static void test_correction_is_split_into_what_goes_by_position_and_what_goes_by_force(void)
{
    map_of(0, 2, 0, 10000000, (const double[]){3, 3});
    cfg.axis[1].half_gap = mk(6);
    direction[1] = 1;
    step(200);
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 3, val(state.position.x));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, val(state.position.y));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, 0, val(state.force.x));
    TEST_ASSERT_DOUBLE_WITHIN(1e-3, -6, val(state.force.y));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_nothing_told_leaves_the_tool_at_the_encoders);
    RUN_TEST(test_map_is_linear_between_its_points_and_constant_beyond);
    RUN_TEST(test_map_is_by_the_users_position);
    RUN_TEST(test_position_beyond_all_numbers_of_a_map_is_its_end);
    RUN_TEST(test_squareness_is_a_share_of_the_other_axis);
    RUN_TEST(test_first_period_has_the_whole_correction);
    RUN_TEST(test_new_origin_takes_effect_without_a_step);
    RUN_TEST(test_error_once_a_turn_goes_by_the_angle_of_the_screw);
    RUN_TEST(test_error_once_a_turn_is_by_the_users_position);
    RUN_TEST(test_new_origin_turns_the_screw_without_a_step);
    RUN_TEST(test_axes_take_turns_and_a_new_origin_is_the_turn_of_both);
    RUN_TEST(test_new_origin_takes_effect_at_one_rate_in_all_turns);
    RUN_TEST(test_table_hangs_back_by_the_force_on_it);
    RUN_TEST(test_deflection_of_each_axis_is_its_own);
    RUN_TEST(test_deflection_changes_by_2_mm_per_s_at_most);
    RUN_TEST(test_side_of_a_gap_follows_the_force_and_stays_where_nothing_pushes);
    RUN_TEST(test_force_and_not_the_motion_decides_the_side);
    RUN_TEST(test_table_of_which_nothing_is_known_follows_the_motion);
    RUN_TEST(test_side_changes_smoothly_in_some_milliseconds);
    RUN_TEST(test_force_of_the_gap_moves_the_mass_before_it_across);
    RUN_TEST(test_correction_is_split_into_what_goes_by_position_and_what_goes_by_force);
    return UNITY_END();
}
