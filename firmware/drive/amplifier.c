/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/amplifier.h"

#include "drive/servo_loop.h"

static void enter(struct amplifier *a, enum amplifier_state state, uint32_t ms)
{
    a->state = state;
    a->since_ms = ms;
}

/* At least so long: `since_ms` may be almost a millisecond before the tick puts it out. */
static bool lasts(const struct amplifier *a, enum amplifier_state state, uint32_t delay_ms, uint32_t ms)
{
    return a->state == state && (delay_ms == 0u || ms - a->since_ms > delay_ms);
}

void amplifier_step(struct amplifier *a, const struct od_axis *od, bool on, unsigned inputs, uint32_t ms)
{
    /* One that says "ready" is live at once. When it has not done so in time, it is taken as live all the same, and so the
     * tick raises its fault. */
    const bool says_ready = (inputs & (unsigned)HAL_AMPLIFIER_FAULT) == 0;
    const bool ready = a->state == AMPLIFIER_STARTING && od->wiring.ready != 0 && says_ready && a->inhibited;
    a->inhibited = !says_ready || (a->inhibited && !amplifier_holds(a));
    if (!on) {
        enter(a, AMPLIFIER_OFF, ms);
        return;
    }
    if (a->state == AMPLIFIER_OFF) {
        enter(a, AMPLIFIER_STARTING, ms);
    }
    if (ready || lasts(a, AMPLIFIER_STARTING, od->wiring.enable_delay, ms)) {
        enter(a, AMPLIFIER_RELEASING, ms);
    }
    if (lasts(a, AMPLIFIER_RELEASING, od->brake.release_delay, ms)) {
        enter(a, AMPLIFIER_LIVE, ms);
    }
}

bool amplifier_engage(struct amplifier *a, const struct od_axis *od, bool leaves, uint32_t ms)
{
    if (leaves && amplifier_released(a)) {
        enter(a, AMPLIFIER_ENGAGING, ms);
    }
    if (!leaves && a->state == AMPLIFIER_ENGAGING) {
        enter(a, AMPLIFIER_RELEASING, ms);
    }
    return a->state != AMPLIFIER_ENGAGING || lasts(a, AMPLIFIER_ENGAGING, od->brake.engage_delay, ms);
}

bool amplifier_holds(const struct amplifier *a)
{
    return amplifier_released(a) || a->state == AMPLIFIER_ENGAGING;
}

bool amplifier_released(const struct amplifier *a)
{
    return a->state == AMPLIFIER_RELEASING || a->state == AMPLIFIER_LIVE;
}

uint32_t amplifier_word(const struct amplifier *a)
{
    switch (a->state) {
    case AMPLIFIER_STARTING: return SERVO_LOOP_STARTING;
    case AMPLIFIER_RELEASING:
    case AMPLIFIER_LIVE: return SERVO_LOOP_ON;
    case AMPLIFIER_ENGAGING: return SERVO_LOOP_BRAKED;
    default: return SERVO_LOOP_OFF;
    }
}
