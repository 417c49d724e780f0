/* SPDX-License-Identifier: Apache-2.0 */
/* dual_feedback.c: the complementary filter of dual_feedback.h. Runs in the servo tick. */
#include "core/dual_feedback.h"

void dual_feedback_reset(struct dual_feedback_state *state)
{
    state->offset = NUM(0);
}

bool dual_feedback_step(const struct dual_feedback_cfg *cfg, struct dual_feedback_state *state, num difference)
{
    state->offset = n_state(n_mad(state->offset, cfg->gain, n_sub(difference, state->offset)));
    return !n_lt(cfg->tolerance, n_abs(difference));
}
