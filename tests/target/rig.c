/* SPDX-License-Identifier: Apache-2.0 */
/* rig.c: the closed loop of rig.h. */
#include "rig.h"

#include "drive/configuration.h"

#include "part_knots.h"

enum { AHEAD = 200 }; /* knots in the ring ahead of path time */

static void drive_read(void *ctx, struct hal_drive_in *in)
{
    const struct rig *r = ctx;
    onchip_plant_read(&r->onchip_plant, in);
}

static void drive_write(void *ctx, const struct hal_drive_out *out)
{
    struct rig *r = ctx;
    r->out = *out;
}

void rig_feed(struct rig *r)
{
    uint32_t count = r->ring.count;
    const uint32_t wanted = atomic_load(&r->loop.executed) + AHEAD;
    for (; count < wanted && count < PART_KNOTS; count++) {
        r->ring.knot[count % SPLINE_RING] = (struct knot){{part_knots[count][0], part_knots[count][1]}};
    }
    r->ring.count = count;
}

void rig_move(struct rig *r)
{
    onchip_plant_step(&r->onchip_plant_cfg, &r->onchip_plant, &r->out);
}

void rig_init(struct rig *r, enum controller controller)
{
    static struct od_data od;
    od_init(&od, 1);
    od.onchip_plant.start_x = part_knots[0][0];
    od.onchip_plant.start_y = part_knots[0][1];
    *r = (struct rig){.hal = {.ctx = r, .drive_read = drive_read, .drive_write = drive_write},
                      .onchip_plant_cfg = configuration_onchip_plant(&od),
                      .ring = {.start = {{part_knots[0][0], part_knots[0][1]}}}};
    onchip_plant_reset(&r->onchip_plant_cfg, &r->onchip_plant);
    servo_loop_init(&r->loop, &r->hal, &r->ring);
    r->loop.cfg[0] = configuration_servo_loop(&od);
    for (int i = 0; i < 2; i++) {
        atomic_store(&r->loop.command.powered[i], SERVO_LOOP_ON);
    }
    atomic_store(&r->loop.command.controller, (uint8_t)controller);
    atomic_store(&r->loop.command.run, true);
    rig_feed(r);
}
