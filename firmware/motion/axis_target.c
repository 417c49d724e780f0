/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/axis_target.h"

#include "hal/hal.h"

enum { HALT_QUICK_STOP_RAMP = 2 /* 605Dh: halt slows down with 6085h */, PM = 1000 /* in a nm */ };

void axis_target_enter(struct axis_mode *a, int8_t mode)
{
    a->mode = mode;
    a->homing.state = HOMING_NONE; /* bits 12 and 13 are about a homing of this stay in the mode */
    positioning_reset(&a->positioning);
}

void axis_target_reset(struct axis_mode *a)
{
    axis_target_enter(a, MODE_INTERPOLATED_POSITION);
    profile_start(&a->profile, 0); /* not followed; its moving average needs a length */
}

bool axis_target_own(const struct axis_mode *a)
{
    return a->mode == MODE_PROFILE_POSITION || a->mode == MODE_PROFILE_VELOCITY || a->mode == MODE_HOMING;
}

/* ---- what is asked for ---- */

static int32_t larger(int32_t a, int32_t b)
{
    return a > b ? a : b;
}

static int32_t smaller(int32_t a, int32_t b)
{
    return a < b ? a : b;
}

/* Where the way to the target of mode 1 ends. */
static int32_t goal_nm(const struct axis_mode *a)
{
    return smaller(larger(a->positioning.now.nm, a->settings.min_nm), a->settings.max_nm);
}

static int64_t here_pm(const struct axis_mode *a, const struct axis_mode_in *in)
{
    return in->generating ? a->profile.pos_pm : (int64_t)in->reference_nm * PM;
}

static void take_set_points(struct axis_mode *a, const struct axis_mode_in *in)
{
    const struct od_axis *od = in->od;
    const struct positioning_in positioning = {
        .controlword = in->controlword,
        .before = a->controlword,
        .enabled = in->enabled,
        .arrived = in->stands && in->reference_nm == goal_nm(a),
        .reference_nm = in->reference_nm,
        .distance_nm = (int64_t)od->position_actual - goal_nm(a),
        .set_point = {od->target_position, od->profile_velocity, od->profile_acceleration, od->profile_deceleration},
        .window_nm = od->position_window,
        .window_periods = od->position_window_time * (CONTROL_HZ / 1000u),
        .now = in->now,
    };
    positioning_step(&a->positioning, &positioning);
}

/* Target velocity towards the target of mode 1 */
static int32_t positioning_velocity(const struct axis_mode *a, const struct axis_mode_in *in)
{
    const uint32_t most = in->od->max_profile_velocity;
    const uint32_t velocity = a->positioning.now.velocity_umps;
    const int32_t speed = (int32_t)(velocity < most ? velocity : most);
    const int64_t way_pm = (int64_t)goal_nm(a) * PM - here_pm(a, in);
    return way_pm > 0 ? speed : way_pm < 0 ? -speed : 0;
}

/* Target velocity that the master asks for, in modes 1 and 3 */
static int32_t requested_velocity(const struct axis_mode *a, const struct axis_mode_in *in)
{
    if (!in->enabled || (in->controlword & CW_HALT) != 0) {
        return 0;
    }
    if (a->mode == MODE_PROFILE_POSITION) {
        return a->positioning.active ? positioning_velocity(a, in) : 0;
    }
    return a->mode == MODE_PROFILE_VELOCITY ? in->od->target_velocity : 0;
}

static void take_over_settings(struct axis_mode *a, const struct axis_mode_in *in)
{
    const struct od_axis *od = in->od;
    const int32_t requested = requested_velocity(a, in);
    const bool goes_on = homing_busy(&a->homing) || (in->generating && !in->stands && requested == a->requested_umps);
    a->requested_umps = requested;
    if (!in->generating) {
        a->settings.min_nm = od->position_limit.min;
        a->settings.max_nm = od->position_limit.max;
    }
    if (!goes_on) {
        a->settings.up_umps2 = od->profile_acceleration;
        a->settings.down_umps2 = od->profile_deceleration;
        a->settings.quick_umps2 = od->quick_stop_deceleration;
        a->settings.homing_umps2 = od->homing_acceleration;
        a->settings.search_umps = (int32_t)od->homing_speed.search;
        a->settings.zero_umps = (int32_t)od->homing_speed.zero;
        a->settings.home_offset_nm = od->home_offset;
        a->settings.halt_option = od->halt_option;
        a->settings.homing_method = od->homing_method;
    }
}

/* ---- homing ---- */

static struct homing_in homing_in(const struct axis_mode *a, const struct axis_mode_in *in)
{
    const struct axis_settings *settings = &a->settings;
    return (struct homing_in){
        .inputs = in->inputs,
        .index_pulses = in->index_pulses,
        .index_nm = in->index_nm,
        .edge_nm = in->edge_nm,
        .position_nm = in->position_nm,
        .reach_nm = (int64_t)settings->max_nm - settings->min_nm,
        .switch_umps = settings->search_umps,
        .zero_umps = settings->zero_umps,
        .standing = in->stands,
    };
}

/* Target velocity of an axis in mode 6. The result of a homing lasts while the axis stays enabled: a master whose statusword
 * is late then never takes it for that of the next one. A rising edge of bit 4 clears it, too, and starts the next homing,
 * which runs while the bit stays set, unless the axis is on halt. */
static int32_t homing_velocity(struct axis_mode *a, const struct axis_mode_in *in)
{
    const uint16_t cw = in->controlword;
    const bool edge = (cw & ~(unsigned)a->controlword & CW_ENABLE_IP) != 0;
    const struct homing_in homing = homing_in(a, in);
    if (!in->enabled || (cw & CW_ENABLE_IP) == 0 || (cw & CW_HALT) != 0) {
        a->homing.state = !in->enabled || edge || homing_busy(&a->homing) ? HOMING_NONE : a->homing.state;
        return 0;
    }
    if (edge) {
        homing_start(&a->homing, a->settings.homing_method);
    }
    return homing_step(&a->homing, &homing);
}

/* ---- the target of the profile ---- */

/* Whether a limit switch stops an axis that has this velocity. */
static bool switch_ahead(uint8_t inputs, int64_t velocity)
{
    return (velocity > 0 && (inputs & HAL_LIMIT_MAX) != 0) || (velocity < 0 && (inputs & HAL_LIMIT_MIN) != 0);
}

/* Target velocity of an axis in modes 1 and 3 */
static int32_t limited_velocity(struct axis_mode *a, const struct axis_mode_in *in)
{
    const int32_t max = in->velocity_max_umps;
    int32_t velocity = smaller(larger(a->requested_umps, -max), max);
    if (switch_ahead(in->inputs, velocity) || (velocity > 0 && here_pm(a, in) >= (int64_t)a->settings.max_nm * PM) ||
        (velocity < 0 && here_pm(a, in) <= (int64_t)a->settings.min_nm * PM)) {
        velocity = 0;
    }
    a->limited = velocity != a->requested_umps;
    return velocity;
}

/* Slow down with 6085h. This also holds for an axis without power: it coasts, and its profile is to end soon. */
static bool on_quick_stop_ramp(const struct axis_mode *a, const struct axis_mode_in *in)
{
    if (!in->powered) {
        return true;
    }
    if (in->quick_stop != NO_QUICK_STOP) {
        return in->quick_stop == 2 || in->quick_stop == 6;
    }
    return ((in->controlword & CW_HALT) != 0 && a->settings.halt_option == HALT_QUICK_STOP_RAMP) ||
           switch_ahead(in->inputs, a->profile.vel_pmpms);
}

/* Go to the target of mode 1: stop there. */
static void aim(struct axis_mode *a, const struct axis_mode_in *in, struct profile_in *profile)
{
    profile->target_umps = limited_velocity(a, in);
    if (a->positioning.active) {
        const int32_t goal = goal_nm(a);
        profile->up_umps2 = a->positioning.now.up_umps2;
        profile->down_umps2 = a->positioning.now.down_umps2;
        profile->max_nm = profile->target_umps > 0 ? goal : profile->max_nm;
        profile->min_nm = profile->target_umps < 0 ? goal : profile->min_nm;
        a->limited = a->limited || goal != a->positioning.now.nm;
    }
}

static struct profile_in profile_in(struct axis_mode *a, const struct axis_mode_in *in)
{
    const struct axis_settings *settings = &a->settings;
    struct profile_in profile = {.up_umps2 = settings->up_umps2,
                                 .down_umps2 = settings->down_umps2,
                                 .min_nm = settings->min_nm,
                                 .max_nm = settings->max_nm};
    if (a->mode == MODE_PROFILE_POSITION) {
        aim(a, in, &profile);
    } else if (a->mode == MODE_PROFILE_VELOCITY) {
        profile.target_umps = limited_velocity(a, in);
    } else if (a->mode == MODE_HOMING) {
        profile.up_umps2 = settings->homing_umps2;
        profile.down_umps2 = settings->homing_umps2;
        profile.target_umps = homing_velocity(a, in);
        profile.min_nm = INT32_MIN;
        profile.max_nm = INT32_MAX;
    }
    if (on_quick_stop_ramp(a, in)) {
        profile.down_umps2 = settings->quick_umps2;
    }
    return profile;
}

void axis_target_step(struct axis_mode *a, const struct axis_mode_in *in)
{
    if (a->mode == MODE_PROFILE_POSITION) {
        take_set_points(a, in);
    }
    take_over_settings(a, in);
    a->target = profile_in(a, in);
    a->controlword = in->controlword;
}

/* ---- status ---- */

static unsigned homing_status(const struct homing *h, bool stands)
{
    const unsigned reached = stands ? SW_TARGET_REACHED : 0u;
    switch (h->state) {
    case HOMING_NONE: return reached;
    case HOMING_DONE: return SW_HOMING_ATTAINED | SW_TARGET_REACHED;
    case HOMING_FAILING: return SW_HOMING_ERROR;
    case HOMING_FAILED: return SW_HOMING_ERROR | reached;
    default: return 0;
    }
}

static unsigned velocity_status(const struct axis_mode *a, bool generating, bool stands)
{
    const bool reached =
        generating ? profile_reached(&a->profile, a->requested_umps) : a->requested_umps == 0 && stands;
    const bool limited = a->limited || (generating && a->profile.limited);
    return (reached ? SW_TARGET_REACHED : 0u) | (limited ? SW_INTERNAL_LIMIT : 0u) | (stands ? SW_SPEED_0 : 0u);
}

static unsigned position_status(const struct axis_mode *a, bool stands)
{
    const struct positioning *p = &a->positioning;
    const bool halted = (a->controlword & CW_HALT) != 0;
    const bool reached = halted || !p->active ? stands : p->reached;
    return (reached ? SW_TARGET_REACHED : 0u) | (a->limited ? SW_INTERNAL_LIMIT : 0u) |
           (p->acknowledged ? SW_ACKNOWLEDGED : 0u);
}

unsigned axis_target_status(const struct axis_mode *a, bool generating, bool stands)
{
    switch (a->mode) {
    case MODE_PROFILE_POSITION: return position_status(a, stands);
    case MODE_PROFILE_VELOCITY: return velocity_status(a, generating, stands);
    default: return homing_status(&a->homing, stands);
    }
}
