/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/cyclic.h"

#include "motion/moving_average.h"

enum {
    FINE = 256,            /* in a nm */
    U_ONE = 0x40000,       /* a whole cycle, */
    U_FINE = 0x4000000,    /* finer */
    SETTLE_MS = 30,        /* of a profile, until its ramp shows */
    STEP_MAX = 0x4000000,  /* nm in a cycle, 3.3 m/s or more, and per cycle squared, 42 m/s2 or more: with these no */
    CHANGE_MAX = 0x1000000 /* polynomial leaves int64, however far it extrapolates */
};

void cyclic_reset(struct cyclic *c)
{
    *c = (struct cyclic){.ms = 1};
}

/* ---- set-points ---- */

static int32_t set_point(const struct cyclic_axis *a, uint32_t cycle)
{
    return a->past[cycle % CYCLIC_PAST];
}

static void store(struct cyclic_axis *a, uint32_t cycle, int32_t nm)
{
    a->latest = cycle;
    a->past[cycle % CYCLIC_PAST] = nm;
}

static int32_t newest(const struct cyclic_axis *a)
{
    return set_point(a, a->latest);
}

/* The state at the set-point of a cycle, by the cubic through it and the three before; of one that has not come by the cubic
 * through the newest four, further ahead by the parabola through three, which has less of their rounding. These are Newton's
 * backward differences. */
static struct cyclic_state state_at(const struct cyclic_axis *a, uint32_t cycle)
{
    const int32_t ahead = (int32_t)(cycle - a->latest);
    const int64_t h = ahead > 0 ? (int64_t)ahead : 0;
    const uint32_t at = ahead > 0 ? a->latest : cycle;
    const int64_t p0 = set_point(a, at), p1 = set_point(a, at - 1u), p2 = set_point(a, at - 2u);
    const int64_t p3 = set_point(a, at - 3u);
    const int64_t d1 = p0 - p1, d2 = p0 - 2 * p1 + p2;
    const int64_t d3 = h > 1 ? 0 : p0 - 3 * p1 + 3 * p2 - p3;
    return (struct cyclic_state){
        .pos = (p0 + h * d1) * FINE + d2 * (h * (h + 1) / 2) * FINE + d3 * (h * (h + 1) * (h + 2) / 6) * FINE,
        .vel = d1 * FINE + d2 * ((2 * h + 1) * (FINE / 2)) + d3 * (3 * h * h + 6 * h + 2) * FINE / 6,
        .acc = d2 * FINE + d3 * (h + 1) * FINE,
    };
}

static bool rests(const struct cyclic_axis *a)
{
    bool same = true;
    for (int i = 1; i < CYCLIC_PAST; i++) {
        same = same && a->past[i] == a->past[0];
    }
    return same;
}

void cyclic_sync(struct cyclic *c, uint32_t now, uint32_t per_ms, uint8_t ms)
{
    c->ms = ms;
    sync_clock_sync(&c->clock, now, per_ms * ms);
}

bool cyclic_leaves(const struct cyclic_limits *limits, int64_t nm, int64_t d1, unsigned ms)
{
    const int64_t way = d1 * SETTLE_MS / (int64_t)ms;
    const int64_t stop = d1 * d1 * 500 / ((int64_t)ms * (int64_t)ms * limits->stop_umps2);
    return (d1 > 0 && nm + way + stop > limits->max_nm) || (d1 < 0 && nm + way - stop < limits->min_nm);
}

/* Put those that are lost before this one in their places: on the parabola through it and the newest two. What had been
 * extrapolated is not kept, since its error would grow from gap to gap. */
static void bridge(struct cyclic_axis *a, uint32_t cycle, int32_t nm)
{
    const uint32_t from = a->latest;
    const int64_t gap = (int32_t)(cycle - from);
    const int64_t p0 = newest(a);
    const int64_t d1 = p0 - set_point(a, from - 1u);
    const int64_t bend = nm - p0 - gap * d1;
    for (int64_t k = 1; k < gap; k++) {
        const int64_t lost = p0 + k * d1 + moving_average_round(bend * k * (k + 1), gap * (gap + 1));
        store(a, from + (uint32_t)k, (int32_t)lost);
    }
}

/* All set-points up to this cycle are the same. */
static void fill(struct cyclic_axis *a, uint32_t cycle, int32_t nm)
{
    for (int i = 0; i < CYCLIC_PAST; i++) {
        a->past[i] = nm;
    }
    a->known = true;
    a->moved = false;
    a->latest = cycle;
    a->rest = cycle;
}

static enum cyclic_result take(struct cyclic *c, int axis, uint32_t cycle, int32_t nm)
{
    struct cyclic_axis *a = &c->axis[axis];
    if (!a->known) {
        fill(a, cycle, nm);
        return CYCLIC_TAKEN;
    }
    if (cycle - a->latest >= CYCLIC_PAST) { /* where it is on its way, it is too late for that */
        fill(a, cycle - 1u, newest(a));
    }
    bridge(a, cycle, nm);
    const int64_t before = set_point(a, cycle - 1u);
    const int64_t d1 = nm - before;
    const int64_t d2 = d1 - before + set_point(a, cycle - 2u);
    const int64_t allowed = a->limits.max_nmpms2 * c->ms * c->ms;
    const int64_t most = allowed < CHANGE_MAX ? allowed : CHANGE_MAX;
    if (d1 > STEP_MAX || d1 < -STEP_MAX) {
        return CYCLIC_RANGE;
    }
    if (d2 > most || d2 < -most) {
        return CYCLIC_ACCELERATION;
    }
    if (cyclic_leaves(&a->limits, nm, d1, c->ms)) {
        return CYCLIC_RANGE;
    }
    store(a, cycle, nm);
    const bool rest = rests(a);
    a->rest = rest ? cycle : a->moved ? a->rest : cycle - 1u;
    a->moved = !rest;
    return CYCLIC_TAKEN;
}

void cyclic_told(struct cyclic *c, int axis)
{
    c->axis[axis].fresh = true;
}

/* Take what has come with the latest SYNC, for which there may be another one within the ms: of a burst only the last
 * counts, since all of it belongs to one cycle. */
static void take_told(struct cyclic *c, int axis)
{
    struct cyclic_axis *a = &c->axis[axis];
    if (a->told) {
        a->told = false;
        a->known = a->known && a->follows; /* what was not followed is no way */
        const enum cyclic_result result = take(c, axis, a->told_cycle, a->told_nm);
        a->refused = result == CYCLIC_TAKEN ? a->refused : result;
    }
}

void cyclic_take(struct cyclic *c, int axis, int32_t nm, const struct cyclic_limits *limits)
{
    struct cyclic_axis *a = &c->axis[axis];
    if (a->told_cycle != c->clock.cycle) {
        take_told(c, axis);
    }
    const bool repeats = a->known && !a->moved && !a->told; /* a master at rest need not send its set-point again */
    if (a->fresh || repeats) {
        a->told = true;
        a->told_nm = a->fresh ? nm : newest(a);
        a->told_cycle = c->clock.cycle;
        a->limits = *limits;
    }
    a->fresh = false;
}

static int32_t clamp_nm(int64_t nm)
{
    return nm > INT32_MAX ? INT32_MAX : nm < -INT32_MAX ? -INT32_MAX : (int32_t)nm;
}

void cyclic_take_velocity(struct cyclic *c, int axis, int64_t umps, const struct cyclic_limits *limits)
{
    const struct cyclic_axis *a = &c->axis[axis];
    const uint32_t cycle = c->clock.cycle;
    take_told(c, axis);
    int64_t nm = a->at_nm; /* until it follows, wherever it stands */
    if (a->follows) {
        nm = state_at(a, cycle - 1u).pos / FINE + umps * c->ms;
    }
    cyclic_take(c, axis, clamp_nm(nm), limits);
}

bool cyclic_missing(const struct cyclic *c, uint32_t latest, uint32_t now)
{
    const int64_t since = sync_clock_since(&c->clock, now) + (int64_t)(c->clock.cycle - latest) * SYNC_CYCLE;
    return since > CYCLIC_MISSING * SYNC_CYCLE && since > CYCLIC_MISSING_MS * SYNC_CYCLE / c->ms;
}

/* ---- the way ---- */

/* Time of the knot `ahead_ms` from now, in cycles since that of the latest SYNC. */
static int64_t time_ahead(const struct cyclic *c, uint32_t now, unsigned ahead_ms)
{
    const int64_t two = 8 * (int64_t)c->ms; /* delays in ms / 4 */
    const int64_t less = 5 * (int64_t)c->ms + 10;
    const int64_t delay = two < less ? two : less;
    return sync_clock_since(&c->clock, now) + (4 * (int64_t)ahead_ms - delay) * SYNC_CYCLE / (4 * (int64_t)c->ms);
}

/* Cycles in a ms, by the master's clock. */
static int64_t frequency(const struct cyclic *c)
{
    const int64_t nominal = SYNC_CYCLE / c->ms;
    return nominal + nominal * c->clock.drift / SYNC_CYCLE;
}

static void join(struct cyclic *c, int axis, int32_t at_nm)
{
    struct cyclic_axis *a = &c->axis[axis];
    const int32_t first = set_point(a, a->rest);
    a->from = (struct cyclic_state){.pos = (int64_t)first * FINE};
    a->to = state_at(a, c->cycle + 1u);
    a->offset_nm = at_nm - first;
    a->blended = 0;
    a->same = 0;
    a->knot_nm = at_nm;
    a->step_nm = 0;
}

/* The next set-point that counts comes after this. */
static void leave(struct cyclic *c, int axis)
{
    struct cyclic_axis *a = &c->axis[axis];
    a->known = a->known && !a->follows;
    a->follows = false;
}

static bool within_window(int64_t a, int64_t b, int64_t window)
{
    return a - b <= window && b - a <= window;
}

static void enter(struct cyclic *c, int axis, const struct cyclic_in *in)
{
    struct cyclic_axis *a = &c->axis[axis];
    a->follows = within_window(newest(a), in->at_nm, in->window_nm);
    a->refused = a->follows ? a->refused : CYCLIC_RANGE;
    if (a->follows && c->runs) {
        join(c, axis, in->at_nm);
    }
}

bool cyclic_update(struct cyclic *c, int axis, const struct cyclic_in *in)
{
    struct cyclic_axis *a = &c->axis[axis];
    take_told(c, axis);
    if (a->follows && a->moved && cyclic_missing(c, a->latest, in->now)) {
        a->refused = CYCLIC_MISSED;
    }
    a->refused = in->enabled ? a->refused : CYCLIC_TAKEN;
    a->at_nm = a->follows ? a->at_nm : in->at_nm;
    const bool may_follow = in->enabled && !in->halt && a->refused == CYCLIC_TAKEN;
    if (!may_follow) {
        leave(c, axis);
    }
    if (may_follow && !a->follows && in->stands && a->known && sync_clock_locked(&c->clock, in->now)) {
        enter(c, axis, in);
    }
    return a->follows && (a->moved || newest(a) != in->at_nm);
}

void cyclic_begin(struct cyclic *c, uint32_t now, unsigned ahead_ms, const int32_t at_nm[2])
{
    int64_t first = time_ahead(c, now, ahead_ms); /* or where the set-points began to move, whichever is earlier */
    for (int i = 0; i < 2; i++) {
        if (c->axis[i].follows) {
            const int64_t rest = (int64_t)(int32_t)(c->axis[i].rest - c->clock.cycle) * SYNC_CYCLE;
            first = rest < first ? rest : first;
        }
    }
    int64_t cycles = first / SYNC_CYCLE;
    cycles -= cycles * SYNC_CYCLE > first ? 1 : 0;
    c->cycle = c->clock.cycle + (uint32_t)cycles;
    c->within = first - cycles * SYNC_CYCLE;
    c->rate = frequency(c);
    c->runs = true;
    for (int i = 0; i < 2; i++) {
        if (c->axis[i].follows) {
            join(c, i, at_nm[i]);
        }
    }
}

void cyclic_step(struct cyclic *c, uint32_t now, unsigned ahead_ms)
{
    const int64_t nominal = SYNC_CYCLE / c->ms;
    const int64_t most = nominal / SYNC_DRIFT;
    c->within += c->rate;
    const int64_t early =
        (int64_t)(int32_t)(c->cycle - c->clock.cycle) * SYNC_CYCLE + c->within - time_ahead(c, now, ahead_ms);
    const int64_t rate =
        c->rate - early / ((int64_t)CYCLIC_TURN * CYCLIC_TURN) - (c->rate - frequency(c)) * 2 / CYCLIC_TURN;
    c->rate = rate > nominal + most ? nominal + most : rate < nominal - most ? nominal - most : rate;
    while (c->within >= SYNC_CYCLE) {
        c->within -= SYNC_CYCLE;
        c->cycle++;
        for (int i = 0; i < 2; i++) {
            struct cyclic_axis *a = &c->axis[i];
            a->from = a->to;
            a->to = state_at(a, c->cycle + 1u);
        }
    }
}

static int64_t scaled(int64_t a, int64_t u)
{
    return a * u / U_ONE;
}

/* Where the way is that takes over from->vel and from->acc, less the sixth of its second difference that a cubic B-spline
 * adds to its knots (a quasi-interpolant; C. de Boor, A Practical Guide to Splines, XII). */
static int64_t knot_of(const struct cyclic *c, const struct cyclic_axis *a)
{
    const int64_t u = c->within / (SYNC_CYCLE / U_ONE);
    const int64_t d = a->to.pos - a->from.pos - a->from.vel - a->from.acc / 2;
    const int64_t v = a->to.vel - a->from.vel - a->from.acc;
    const int64_t w = a->to.acc - a->from.acc;
    const int64_t c3 = 10 * d - 4 * v + w / 2;
    const int64_t c4 = -15 * d + 7 * v - w;
    const int64_t c5 = 6 * d - 3 * v + w / 2;
    const int64_t u3 = scaled(c3 + scaled(c4 + scaled(c5, u), u), u);
    const int64_t linear = a->from.vel * (c->within / (SYNC_CYCLE / U_FINE)) / U_FINE;
    const int64_t pos = a->from.pos + linear + scaled(scaled(a->from.acc / 2 + u3, u), u);
    const int64_t bend = scaled(6 * (c3 / 16) + scaled(12 * (c4 / 16) + scaled(20 * (c5 / 16), u), u), u);
    const int64_t sixth = 6 * (int64_t)c->ms * c->ms;
    return moving_average_round(pos * sixth - a->from.acc - 16 * bend, FINE * sixth);
}

int32_t cyclic_knot(struct cyclic *c, int axis)
{
    struct cyclic_axis *a = &c->axis[axis];
    int64_t knot = knot_of(c, a);
    if (a->blended < CYCLIC_BLEND) {
        const int64_t k = a->blended;
        const int64_t whole = (int64_t)CYCLIC_BLEND * CYCLIC_BLEND * CYCLIC_BLEND;
        knot += moving_average_round(a->offset_nm * (whole - ((int64_t)3 * CYCLIC_BLEND - 2 * k) * k * k), whole);
        a->blended++;
    }
    a->step_nm = clamp_nm(knot - a->knot_nm);
    a->knot_nm = clamp_nm(knot);
    a->same = (uint8_t)(a->step_nm != 0 ? 0u : a->same + (a->same < UINT8_MAX ? 1u : 0u));
    return a->knot_nm;
}

bool cyclic_stands(const struct cyclic *c, int axis)
{
    return !c->runs || c->axis[axis].same >= CYCLIC_REST;
}
