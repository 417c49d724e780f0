/* SPDX-License-Identifier: Apache-2.0 */
#include "drive/excite.h"

#include "drive/configuration.h"

uint32_t excite_begin(struct servo_loop *loop, const struct od_data *od)
{
    struct servo_loop_excitation *e = &loop->excitation;
    struct excitation_cfg cfg;
    if (!configuration_excitation(od, &cfg)) {
        return SDO_ABORT_INCOMPATIBLE;
    }
    e->cfg = cfg;
    excitation_begin(&e->cfg, &e->state);
    atomic_store(&e->status, EXCITATION_RUNS);
    atomic_store(&loop->command.excite, SERVO_LOOP_EXCITE);
    return SDO_OK;
}

void excite_end(struct servo_loop *loop)
{
    if (atomic_exchange(&loop->command.excite, 0u) == SERVO_LOOP_EXCITE) {
        atomic_store(&loop->excitation.status, EXCITATION_ENDED);
    }
}

void excite_report(const struct servo_loop *loop, struct od_data *od)
{
    const struct servo_loop_excitation *e = &loop->excitation;
    int32_t *const result[EXCITATION_SIGNALS] = {od->excitation_force, od->excitation_first, od->excitation_second};
    od->excitation.state = atomic_load(&e->status);
    od->excitation.done = (uint8_t)e->state.done;
    for (uint32_t k = 0; k < 2u * EXCITATION_LINES; k++) {
        for (int i = 0; i < EXCITATION_SIGNALS; i++) {
            const num x = excitation_result(&e->cfg, &e->state, k / 2u, (enum excitation_signal)i, k % 2u != 0);
            result[i][k] = n_to_scaled(x, 1000000);
        }
    }
}
