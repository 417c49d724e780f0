/* SPDX-License-Identifier: Apache-2.0 */
/* excitation.h: a small force on top of the law's, by which the closed loop of an axis is measured. Not in the paper.
 *
 * The force is a sum of up to EXCITATION_LINES sines, all of the same amplitude A:
 *   d = A sum_k cos(p_k n + phi_k)
 * in control period n, with phases phi_k that keep the sum small (M. R. Schroeder, IEEE Trans. Inf. Theory 16, 1970, 85).
 * One line is a stepped sine, several are a multisine. The law does not know of d, so d is a disturbance at the input of
 * the machine. Of each signal x there is, for each line and each window of N control periods,
 *   X_k = 2/N sum_n x_n exp(-j (p_k n + phi_k))
 * so that of d itself it is A. A line has a whole number of periods in a window: what is constant does not count, nor do
 * the other lines. Of a position its change from period to period is taken, of which a constant speed is a constant.
 * With U of the whole force and Y of the position, S = U / A is the sensitivity, and P = Y / U the machine.
 *
 * Context: servo_loop.c calls it in the servo tick while an axis is excited. The background begins it, and reads a window
 * that is complete.
 */
#ifndef KONTUR_EXCITATION_H
#define KONTUR_EXCITATION_H
#include "core/num.h"
#include "core/trig.h"

#define EXCITATION_LINES 8u

/* What is correlated: the whole force in N, and the counts that both encoders have moved in a control period. */
enum excitation_signal { EXCITATION_FORCE, EXCITATION_FIRST, EXCITATION_SECOND, EXCITATION_SIGNALS };

struct excitation_cfg {
    num amplitude;                      /* of each line, N */
    uint32_t lines;                     /* 1..EXCITATION_LINES */
    uint32_t periods[EXCITATION_LINES]; /* of each line, in a window */
    uint32_t settle;                    /* control periods in which the force grows, before the first window */
    uint32_t window;                    /* control periods, > 2 periods[] */
    uint32_t windows;                   /* after these it ends */
    uint32_t axis;                      /* 0 x, 1 y; for the caller */
};

struct excitation_sums {
    acc_t re[EXCITATION_LINES][EXCITATION_SIGNALS], im[EXCITATION_LINES][EXCITATION_SIGNALS];
};

struct excitation_state {
    uint32_t step[EXCITATION_LINES];  /* 2^-32 turns a control period */
    uint32_t phase[EXCITATION_LINES]; /* 2^-32 turns */
    struct trig_circle at[EXCITATION_LINES];
    uint32_t ticks;                 /* of settling, or of the window */
    bool settled;                   /* windows have begun */
    uint32_t done;                  /* complete windows; the sums of the latest one are at done - 1, modulo 2 */
    struct excitation_sums sums[2]; /* of the window that goes on: at done, modulo 2 */
};

/* Begin anew. */
void excitation_begin(const struct excitation_cfg *cfg, struct excitation_state *s);
/* The force of this control period, N. */
num excitation_step(const struct excitation_cfg *cfg, struct excitation_state *s);
/* Take the signals of this control period. Returns whether the last window is complete. */
bool excitation_correlate(const struct excitation_cfg *cfg, struct excitation_state *s,
                          const num signal[EXCITATION_SIGNALS]);
/* X of a line in the latest complete window, 0 if there is none: the real part, or the imaginary one. */
num excitation_result(const struct excitation_cfg *cfg, const struct excitation_state *s, uint32_t line,
                      enum excitation_signal signal, bool imaginary);
#endif
