/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/homing.h"

#include "hal/hal.h"

enum { LIMITS = HAL_LIMIT_MIN | HAL_LIMIT_MAX };

static bool with_switch(int8_t method)
{
    return method == 1 || method == 2 || method == 17 || method == 18;
}

static bool with_index(int8_t method)
{
    return method == 1 || method == 2 || method == 33 || method == 34;
}

/* Direction in which the switch, or an index pulse without switch, is searched: downwards for odd methods */
static int direction(int8_t method)
{
    return method % 2 != 0 ? -1 : 1;
}

/* The switch at the end that lies in this direction */
static uint8_t switch_ahead(int dir)
{
    return dir < 0 ? HAL_LIMIT_MIN : HAL_LIMIT_MAX;
}

bool homing_method_known(int64_t method)
{
    return method == 1 || method == 2 || method == 17 || method == 18 || (method >= 33 && method <= 35) || method == 37;
}

bool homing_busy(const struct homing *h)
{
    return h->state != HOMING_NONE && h->state != HOMING_DONE && h->state != HOMING_FAILED;
}

static void go(struct homing *h, enum homing_state state, const struct homing_in *in)
{
    h->state = state;
    h->from_nm = in->position_nm;
    h->index_pulses = in->index_pulses;
}

static void found(struct homing *h, int64_t nm)
{
    h->state = HOMING_FOUND;
    h->found_nm = nm;
}

void homing_start(struct homing *h, int8_t method)
{
    *h = (struct homing){.state = HOMING_BEGIN, .method = method};
}

static void begin(struct homing *h, const struct homing_in *in)
{
    const int8_t method = h->method;
    if (!homing_method_known(method) || (with_switch(method) && (in->inputs & LIMITS) == LIMITS)) {
        go(h, HOMING_FAILING, in);
    } else if (with_switch(method)) {
        go(h, (in->inputs & switch_ahead(direction(method))) != 0 ? HOMING_LEAVE : HOMING_SEEK, in);
    } else if (with_index(method)) {
        go(h, HOMING_INDEX, in);
    } else {
        found(h, in->position_nm);
    }
}

int32_t homing_step(struct homing *h, const struct homing_in *in)
{
    if (h->state == HOMING_BEGIN) {
        if (h->shown < HOMING_SHOWN) {
            h->shown++;
            return 0;
        }
        begin(h, in);
    }
    const int seek = direction(h->method);
    const int search = with_switch(h->method) ? -seek : seek; /* direction in which the edge or the pulse is searched */
    const int64_t way = in->position_nm - h->from_nm;
    const bool on = (in->inputs & switch_ahead(seek)) != 0;
    const bool searching = h->state == HOMING_SEEK || h->state == HOMING_LEAVE || h->state == HOMING_INDEX;

    if (searching && ((way < 0 ? -way : way) > in->reach_nm || (in->inputs & LIMITS) == LIMITS)) {
        h->state = HOMING_FAILING;
    } else if (h->state == HOMING_SEEK && on) {
        h->state = HOMING_TURN;
    } else if (h->state == HOMING_TURN && in->standing) {
        go(h, HOMING_LEAVE, in);
    } else if (h->state == HOMING_LEAVE && !on) {
        if (with_index(h->method)) {
            go(h, HOMING_INDEX, in);
        } else {
            found(h, in->edge_nm);
        }
    } else if (h->state == HOMING_INDEX && in->index_pulses != h->index_pulses) {
        found(h, in->index_nm);
    } else if (h->state == HOMING_INDEX && (in->inputs & switch_ahead(search)) != 0) {
        h->state = HOMING_FAILING;
    } else if (h->state == HOMING_FAILING && in->standing) {
        h->state = HOMING_FAILED;
    }

    switch (h->state) {
    case HOMING_SEEK: return seek * in->switch_umps;
    case HOMING_LEAVE:
    case HOMING_INDEX: return search * in->zero_umps;
    default: return 0;
    }
}
