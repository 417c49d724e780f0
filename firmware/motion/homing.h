/* SPDX-License-Identifier: Apache-2.0 */
/* motion/homing.h: homing of one axis (CiA 402-2, clause "Homing mode"): which way to go until its home point is found.
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

enum homing_state {
    HOMING_NONE,  /* not started, or interrupted */
    HOMING_SEEK,  /* towards the switch */
    HOMING_TURN,  /* slowing down on it */
    HOMING_LEAVE, /* off the switch */
    HOMING_INDEX, /* towards the index pulse */
    HOMING_FOUND, /* slowing down; the caller makes the point found the home point */
    HOMING_DONE,
    HOMING_FAILING, /* slowing down */
    HOMING_FAILED
};

struct homing_in {
    uint8_t inputs;       /* enum hal_input */
    uint8_t index_pulses; /* counts them */
    int64_t index_nm;     /* where the latest was */
    int64_t edge_nm;      /* where a limit switch opened or closed last */
    int64_t position_nm;
    int64_t reach_nm;
    int32_t switch_umps, zero_umps;
    bool standing; /* the axis stands, and its target velocity is 0 */
};

struct homing {
    enum homing_state state;
    int8_t method;
    uint8_t index_pulses; /* seen */
    int64_t from_nm;      /* where the part of the way began that `reach_nm` bounds */
    int64_t found_nm;
};

bool homing_method_known(int64_t method);
void homing_start(struct homing *h, int8_t method, const struct homing_in *in);
/* Speed to go with, um/s. */
int32_t homing_step(struct homing *h, const struct homing_in *in);
/* From HOMING_SEEK to HOMING_FOUND, and HOMING_FAILING. */
bool homing_busy(const struct homing *h);
#endif
