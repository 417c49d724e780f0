/* SPDX-License-Identifier: Apache-2.0 */
#include "home.h"

#include "hal.h"

enum { LIMITS = HAL_LIMIT_MIN | HAL_LIMIT_MAX };

static bool with_switch(int8_t method)
{
    return method == 1 || method == 2 || method == 17 || method == 18;
}

static bool with_index(int8_t method)
{
    return method == 1 || method == 2 || method == 33 || method == 34;
}

/* Of the search for the switch, or for the index pulse alone: odd methods go down */
static int direction(int8_t method)
{
    return method % 2 != 0 ? -1 : 1;
}

/* The switch at the end that lies in this direction */
static uint8_t switch_ahead(int dir)
{
    return dir < 0 ? HAL_LIMIT_MIN : HAL_LIMIT_MAX;
}

bool home_method_known(int64_t method)
{
    return method == 1 || method == 2 || method == 17 || method == 18 || (method >= 33 && method <= 35) || method == 37;
}

bool home_busy(const struct home *h)
{
    return h->state != HOME_NONE && h->state != HOME_DONE && h->state != HOME_FAILED;
}

static void go(struct home *h, enum home_state state, const struct home_in *in)
{
    h->state = state;
    h->from_nm = in->position_nm;
    h->index_pulses = in->index_pulses;
}

static void found(struct home *h, int64_t nm)
{
    h->state = HOME_FOUND;
    h->found_nm = nm;
}

void home_start(struct home *h, int8_t method, const struct home_in *in)
{
    *h = (struct home){.method = method};
    if (!home_method_known(method) || (with_switch(method) && (in->inputs & LIMITS) == LIMITS)) {
        go(h, HOME_FAILING, in);
    } else if (with_switch(method)) {
        go(h, (in->inputs & switch_ahead(direction(method))) != 0 ? HOME_LEAVE : HOME_SEEK, in);
    } else if (with_index(method)) {
        go(h, HOME_INDEX, in);
    } else {
        found(h, in->position_nm);
    }
}

int32_t home_step(struct home *h, const struct home_in *in)
{
    const int seek = direction(h->method);
    const int search = with_switch(h->method) ? -seek : seek; /* of edge or pulse */
    const int64_t way = in->position_nm - h->from_nm;
    const bool on = (in->inputs & switch_ahead(seek)) != 0;
    const bool searching = h->state == HOME_SEEK || h->state == HOME_LEAVE || h->state == HOME_INDEX;

    if (searching && ((way < 0 ? -way : way) > in->reach_nm || (in->inputs & LIMITS) == LIMITS)) {
        h->state = HOME_FAILING;
    } else if (h->state == HOME_SEEK && on) {
        h->state = HOME_TURN;
    } else if (h->state == HOME_TURN && in->resting) {
        go(h, HOME_LEAVE, in);
    } else if (h->state == HOME_LEAVE && !on) {
        if (with_index(h->method)) {
            go(h, HOME_INDEX, in);
        } else {
            found(h, in->edge_nm);
        }
    } else if (h->state == HOME_INDEX && in->index_pulses != h->index_pulses) {
        found(h, in->index_nm);
    } else if (h->state == HOME_INDEX && (in->inputs & switch_ahead(search)) != 0) {
        h->state = HOME_FAILING;
    } else if (h->state == HOME_FAILING && in->resting) {
        h->state = HOME_FAILED;
    }

    switch (h->state) {
    case HOME_SEEK: return seek * in->switch_umps;
    case HOME_LEAVE:
    case HOME_INDEX: return search * in->zero_umps;
    default: return 0;
    }
}
