/* SPDX-License-Identifier: Apache-2.0 */
#include "supervision/command_guard.h"

void command_guard_reset(struct command_guard *g)
{
    *g = (struct command_guard){.noise = g->noise};
}

static void hold(struct command_guard *g, uint8_t id, uint32_t key)
{
    g->holder = id;
    g->key = key;
    g->silent = g->drawn = g->told = g->armed = false;
}

bool command_guard_claim(struct command_guard *g, uint8_t id, uint32_t key, bool powered)
{
    const bool same = g->holder != 0 && key == g->key;
    if (id != 0 && same && id == g->holder && key != 0) {
        return true;
    }
    const bool may = id != 0 ? g->holder == 0 : g->holder == 0 || same;
    if (!may || powered) {
        return false;
    }
    hold(g, id, key);
    return true;
}

void command_guard_holder_silent(struct command_guard *g)
{
    g->silent = g->holder != 0;
}

static bool in_time(const struct command_guard *g, uint32_t now)
{
    return now - g->armed_at < COMMAND_GUARD_ARM_MS * (CONTROL_HZ / 1000u);
}

bool command_guard_expire(struct command_guard *g, bool powered, uint32_t now)
{
    g->told = g->told && in_time(g, now);
    g->armed = g->armed && g->told;
    if (!g->silent || powered) {
        return false;
    }
    hold(g, 0, 0);
    return true;
}

/* Each bit of x changes about half of the bits of the result (Wellons, hash-prospector, lowbias32). */
static uint32_t scramble(uint32_t x)
{
    uint32_t y = x;
    y = (y ^ (y >> 16)) * 0x7FEB352Du;
    y = (y ^ (y >> 15)) * 0x846CA68Bu;
    return y ^ (y >> 16);
}

void command_guard_stir(struct command_guard *g, uint32_t noise)
{
    g->noise = scramble(g->noise + noise);
}

uint32_t command_guard_draw(struct command_guard *g, uint32_t now)
{
    g->noise = scramble(g->noise + now + 1u);
    g->ticket = g->noise;
    g->drawn = true;
    return g->ticket;
}

bool command_guard_arm(struct command_guard *g, uint32_t ticket, uint32_t now)
{
    const bool right = g->holder != 0 && (g->drawn || g->armed) && ticket == g->ticket;
    if (right && g->drawn) {
        g->told = g->armed = true;
        g->armed_at = now;
    }
    g->drawn = false;
    return right;
}

bool command_guard_told(const struct command_guard *g)
{
    return g->told;
}

void command_guard_disarm(struct command_guard *g)
{
    g->armed = false;
}

void command_guard_sent(struct command_guard *g, int axis, uint32_t changes)
{
    g->axis[axis].sent = changes;
}

void command_guard_drained(struct command_guard *g, uint32_t now)
{
    for (int i = 0; i < 2; i++) {
        struct command_guard_axis *a = &g->axis[i];
        if (a->known != a->sent) {
            a->known = a->sent;
            a->known_at = now;
        }
    }
}

bool command_guard_permits(const struct command_guard *g, int axis, uint32_t changes, bool claim_required, uint32_t now)
{
    const struct command_guard_axis *a = &g->axis[axis];
    const bool armed = g->armed && in_time(g, now) && !g->silent;
    return a->known == changes && now - a->known_at >= COMMAND_GUARD_PERIODS &&
           (g->holder != 0 ? armed : !claim_required);
}

void command_guard_refused(struct command_guard *g, int axis, uint32_t now)
{
    g->axis[axis].known_at = now;
}
