/* SPDX-License-Identifier: Apache-2.0 */
/* motion/homing.h: homing of one axis (CiA 402-2, clause "Homing mode"): which way to go until the home point is found.
 *
 * | method | home point                                                                        |
 * |--------|-----------------------------------------------------------------------------------|
 * | 1, 2   | first index pulse past the point where the negative, positive limit switch opens  |
 * | 17, 18 | where the negative, positive limit switch opens                                   |
 * | 33, 34 | next index pulse in negative, positive direction                                  |
 * | 35, 37 | where the axis stands                                                             |
 *
 * A homing begins with HOMING_SHOWN steps at standstill, in which the statusword says that it is in progress. So TPDO1
 * shows each master, at least twice, that the result of the homing before is gone.
 *
 * The servo tick records the position at the edge of a switch and at an index pulse, so the velocity does not blur it. It
 * is an error to go further than `reach_nm` without finding what is searched, and to reach the other switch.
 *
 * Pure, background only; axis_modes.c calls it in each drive step.
 */
#ifndef KONTUR_HOMING_H
#define KONTUR_HOMING_H
#include <stdbool.h>
#include <stdint.h>

enum homing_state {
    HOMING_NONE,  /* not started, or interrupted */
    HOMING_BEGIN, /* stands, while the statusword shows that it has started */
    HOMING_SEEK,  /* moves towards the switch */
    HOMING_TURN,  /* slows down on the switch */
    HOMING_LEAVE, /* moves off the switch */
    HOMING_INDEX, /* moves towards the index pulse */
    HOMING_FOUND, /* slows down; then the caller makes found_nm the home point */
    HOMING_DONE,
    HOMING_FAILING, /* slows down */
    HOMING_FAILED
};

enum { HOMING_SHOWN = 25 }; /* drive steps, one a millisecond; TPDO1 is sent at once and each 10 ms */

struct homing_in {
    uint8_t inputs;       /* enum hal_input */
    uint8_t index_pulses; /* number of index pulses, modulo 256 */
    int64_t index_nm;     /* position at the latest index pulse */
    int64_t edge_nm;      /* position when a limit switch opened or closed last */
    int64_t position_nm;
    int64_t reach_nm;
    int32_t switch_umps, zero_umps;
    bool standing; /* the axis stands, and its target velocity is 0 */
};

struct homing {
    enum homing_state state;
    int8_t method;
    uint8_t shown;        /* steps in HOMING_BEGIN */
    uint8_t index_pulses; /* when the search began */
    int64_t from_nm;      /* position where the search began that `reach_nm` bounds */
    int64_t found_nm;
};

bool homing_method_known(int64_t method);
void homing_start(struct homing *h, int8_t method);
/* Returns the target velocity, um/s. */
int32_t homing_step(struct homing *h, const struct homing_in *in);
/* Whether homing is running: HOMING_BEGIN to HOMING_FOUND, and HOMING_FAILING. */
bool homing_busy(const struct homing *h);
#endif
