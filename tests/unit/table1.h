/* SPDX-License-Identifier: Apache-2.0 */
/* table1.h: the gains of the rigid machine of Table 1, for tests on that machine. They are those of
 * host/kontur/machines/table1.toml, in the units of the wire (docs/objects.md); tests/host/test_machine_gains.py compares
 * both. */
#ifndef KONTUR_TABLE1_H
#define KONTUR_TABLE1_H
#include "od/od.h"

static inline void table1_gains(struct od_data *od)
{
    od->smc.lambda = 200000;
    od->smc.k_0 = 100000;
    od->smc.k_max = 400000;
    od->smc.zeta = 100000;
    od->compensator.alpha = 60000;
    od->compensator.mu_0 = 6000000;
    od->compensator.mu_max = 10000000;
    od->compensator.phi = 6000000;
    od->compensator.dead_zone = 6000000;
    od->observer.bandwidth = 1120000;
    od->cascade.position_gain = 67400;
    od->cascade.velocity_gain = 307200;
    od->cascade.integral_gain = 77000;
    od->cascade.coupling_gain = 1000;
    od->feedforward.friction_rate = 40000;
    od->feedforward.mass_rate = 20000;
}

/* A drive from the factory with these gains */
static inline struct od_data table1(void)
{
    struct od_data od;
    od_init(&od, 1);
    table1_gains(&od);
    return od;
}
#endif
