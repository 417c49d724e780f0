/* SPDX-License-Identifier: Apache-2.0 */
/* hash.c: a program that prints a hash over the state and the outputs of the servo in 100,000 control periods of a
 * part in closed loop under ccu, with every compensation on. It must print the same on the host and on every target.
 */
#include <stdio.h>

#include "rig.h"

enum { STEPS = 100000 };

/* The hash FNV-1a of data without padding, least significant byte first. */
static void mix(uint32_t *hash, const void *data, uint32_t size)
{
    const uint8_t *bytes = data;
    for (uint32_t i = 0; i < size; i++) {
        *hash = (*hash ^ bytes[i]) * 16777619u;
    }
}

static void mix_servo(uint32_t *hash, const struct servo_state *s)
{
    for (int i = 0; i < 2; i++) {
        mix(hash, &s->observer[i].pos, sizeof s->observer[i].pos);
        mix(hash, &s->observer[i].vel, sizeof s->observer[i].vel);
        mix(hash, &s->observer[i].disturbance, sizeof s->observer[i].disturbance);
        mix(hash, &s->energy[i], sizeof s->energy[i]);
    }
    mix(hash, &s->smc, sizeof s->smc);
    mix(hash, &s->compensator.q_bar, sizeof s->compensator.q_bar);
    mix(hash, &s->compensator.q_bar_dot, sizeof s->compensator.q_bar_dot);
    mix(hash, &s->compensator.mu, sizeof s->compensator.mu);
    mix(hash, &s->feedforward, sizeof s->feedforward);
    mix(hash, &s->friction, sizeof s->friction);
    mix(hash, &s->force_filter, sizeof s->force_filter);
    mix(hash, &s->force_limit, sizeof s->force_limit);
    mix(hash, &s->screw, sizeof s->screw);
    mix(hash, s->tool, sizeof s->tool);
    mix(hash, s->dual_feedback, sizeof s->dual_feedback);
    mix(hash, &s->offset, sizeof s->offset);
    mix(hash, &s->force, sizeof s->force);
    mix(hash, s->demand, sizeof s->demand);
}

int main(void)
{
    static struct rig r;
    uint32_t hash = 2166136261u;
    rig_init(&r, CONTROLLER_CCU, true);
    for (uint32_t i = 0; i < STEPS; i++) {
        rig_feed(&r);
        servo_loop_tick(&r.loop);
        rig_move(&r);
        mix(&hash, r.out.force_mN, sizeof r.out.force_mN);
        mix_servo(&hash, &r.loop.servo);
        for (int k = 0; k < 2; k++) {
            mix(&hash, &r.onchip_plant.axis[k].part[ONCHIP_TABLE].pos,
                sizeof r.onchip_plant.axis[k].part[ONCHIP_TABLE].pos);
            mix(&hash, &r.onchip_plant.axis[k].part[ONCHIP_TABLE].vel,
                sizeof r.onchip_plant.axis[k].part[ONCHIP_TABLE].vel);
        }
    }
    const struct servo_snapshot *s = servo_loop_snapshot(&r.loop);
    printf("%08lX at (%ld, %ld) nm, faults %lX\n", (unsigned long)hash, (long)s->position_nm[0],
           (long)s->position_nm[1], (unsigned long)r.loop.faults);
    return r.loop.faults == 0 ? 0 : 1;
}
