/* SPDX-License-Identifier: Apache-2.0 */
/* home.h: homing of one axis (CiA 402-2, clause "Homing mode"): which way to go until its home point is found.
 * Background only.
 *
 * | method | home point                                                                        |
 * |--------|-----------------------------------------------------------------------------------|
 * | 1, 2   | first index pulse past the point where the negative, positive limit switch opens  |
 * | 17, 18 | where the negative, positive limit switch opens                                   |
 * | 33, 34 | next index pulse in negative, positive direction                                  |
 * | 35, 37 | where the axis stands                                                             |
 *
 * Where a switch or a pulse came is taken from the encoder by the servo tick, so the speeds do not blur it. Going
 * further than `reach_nm` without finding what is searched, or into a switch that is not, is an error.
 */
#ifndef KONTUR_HOME_H
#define KONTUR_HOME_H
#include <stdbool.h>
#include <stdint.h>

enum home_state {
    HOME_NONE,    /* not started, or interrupted */
    HOME_SEEK,    /* towards the switch */
    HOME_TURN,    /* slowing down on it */
    HOME_LEAVE,   /* off the switch */
    HOME_INDEX,   /* towards the index pulse */
    HOME_FOUND,   /* slowing down; the caller makes the point found the home point */
    HOME_DONE,
    HOME_FAILING, /* slowing down */
    HOME_FAILED
};

struct home_in {
    uint8_t inputs;       /* enum hal_input */
    uint8_t index_pulses; /* counts them */
    int64_t index_nm;     /* where the latest was */
    int64_t edge_nm;      /* where a limit switch opened or closed last */
    int64_t position_nm;
    int64_t reach_nm;
    int32_t switch_umps, zero_umps;
    bool resting;         /* the axis has been told no speed and stands */
};

struct home {
    enum home_state state;
    int8_t method;
    uint8_t index_pulses; /* seen */
    int64_t from_nm;      /* where the part of the way began that `reach_nm` bounds */
    int64_t found_nm;
};

bool home_method_known(int64_t method);
void home_start(struct home *h, int8_t method, const struct home_in *in);
/* Speed to go with, um/s. */
int32_t home_step(struct home *h, const struct home_in *in);
/* From HOME_SEEK to HOME_FOUND, and HOME_FAILING. */
bool home_busy(const struct home *h);
#endif
