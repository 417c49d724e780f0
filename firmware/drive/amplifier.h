/* SPDX-License-Identifier: Apache-2.0 */
/* drive/amplifier.h: the amplifier of one axis and its brake. Power, force and movement are separate steps:
 *
 *  off        no power, and the brake is engaged
 *  starting   power, no force: the amplifier is not live yet (2104h enable_delay, ready)
 *  releasing  the law holds the axis in place, and the brake has the signal to release (2160h release_delay)
 *  live       the axis may move
 *  engaging   the axis stands and is to lose its power: the brake has the signal to engage (2160h engage_delay), and the law
 *             still holds the axis
 *
 * What cuts the power at once also engages the brake at once. Pure, background only; the caller is drive.c. The servo tick
 * gets the states as words (servo_loop.h), and cuts the power by itself.
 */
#ifndef KONTUR_AMPLIFIER_H
#define KONTUR_AMPLIFIER_H
#include <stdbool.h>
#include <stdint.h>

#include "od/od.h"

/* Any two differ in two bits or more, so a bit that flips makes none of another. */
enum amplifier_state {
    AMPLIFIER_OFF = 0,
    AMPLIFIER_STARTING = 3,
    AMPLIFIER_RELEASING = 5,
    AMPLIFIER_LIVE = 6,
    AMPLIFIER_ENGAGING = 9
};

/* All 0 is off. */
struct amplifier {
    enum amplifier_state state;
    uint32_t since_ms; /* when it became so */
    bool inhibited;    /* its "ready" output has said no since the axis was held the last time: a yes is news */
};

/* Switch the power on or off, and go on with what has lasted long enough. `inputs`: enum hal_input; ms: now. */
void amplifier_step(struct amplifier *a, const struct od_axis *od, bool on, unsigned inputs, uint32_t ms);
/* leaves: the axis stands and is to lose its power, so engage the brake. If it is to keep it after all, the brake is
 * released again. Returns whether the axis may lose its power: the brake has had its time, or was never released. */
bool amplifier_engage(struct amplifier *a, const struct od_axis *od, bool leaves, uint32_t ms);
/* Whether the law is active. */
bool amplifier_holds(const struct amplifier *a);
/* Whether the brake is released, or has the signal to be. */
bool amplifier_released(const struct amplifier *a);
/* The word of the servo tick for this state, SERVO_LOOP_OFF and so on; SERVO_LOOP_OFF for one that is none. */
uint32_t amplifier_word(const struct amplifier *a);
#endif
