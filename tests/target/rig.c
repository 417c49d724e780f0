/* SPDX-License-Identifier: Apache-2.0 */
/* rig.c: the closed loop of rig.h. */
#include "rig.h"

#include "drive/configuration.h"
#include "drive/onchip_configuration.h"

#include "part_knots.h"
#include "table1.h"

enum { AHEAD = 200 }; /* knots in the ring ahead of path time */

static void drive_read(void *ctx, struct hal_drive_in *in)
{
    const struct rig *r = ctx;
    *in = r->in;
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

/* What the machine shows is put down outside the tick, of whose cost it is no part. */
static void show(struct rig *r)
{
    onchip_plant_read(&r->onchip_plant_cfg, &r->onchip_plant, &r->in);
    r->in.second[0] = r->in.count[0];
    r->in.second[1] = r->in.count[1];
}

void rig_move(struct rig *r)
{
    onchip_plant_step(&r->onchip_plant_cfg, &r->onchip_plant, &r->out);
    show(r);
}

/* A machine with a little of everything: the simulated one has nothing of it, and works with it all the same. */
static void compensate(struct od_axis *a)
{
    a->plant.force_delay = 500;
    a->friction = (struct od_friction){.presliding = 20000, .breakaway = 1200, .stribeck = 1000000};
    a->screw = (struct od_screw){
        .lead = 5000000,
        .order_1 = 1,
        .cogging_cos_1 = 20,
        .cogging_sin_1 = 10,
        .ripple_cos_1 = 2000,
        .ripple_sin_1 = 1000,
        .order_2 = 4,
        .cogging_cos_2 = 20,
        .cogging_sin_2 = 10,
        .ripple_cos_2 = 2000,
        .ripple_sin_2 = 1000,
        .order_3 = 12,
        .cogging_cos_3 = 20,
        .cogging_sin_3 = 10,
        .ripple_cos_3 = 2000,
        .ripple_sin_3 = 1000,
        .error_cos = 3000,
        .error_sin = 2000,
    };
    a->force_filter = (struct od_force_filter){
        .zero_1 = 500000,
        .zero_damping_1 = 100,
        .pole_1 = 500000,
        .pole_damping_1 = 700,
        .zero_2 = 800000,
        .zero_damping_2 = 100,
        .pole_2 = 800000,
        .pole_damping_2 = 700,
    };
    a->force_continuous = (struct od_force_continuous){.force = a->plant.force_limit / 2u, .time = 10000};
    a->transmission =
        (struct od_transmission){.stiffness = 20000, .table_mass = 2000, .table_friction = 500, .backlash = 2000};
    a->lead_map = (struct od_lead_map){.points = GEOMETRY_POINTS, .start = -50000000, .step = 2000000};
    for (int32_t k = 0; k < (int32_t)GEOMETRY_POINTS; k++) {
        a->lead_error[k] = 100 * (k % 8);
    }
    a->second_encoder =
        (struct od_second_encoder){.length = a->plant.encoder, .crossover = 25000, .tolerance = 1000000};
}

void rig_init(struct rig *r, enum controller controller, bool compensated)
{
    static struct od_data od;
    od = table1();
    if (compensated) {
        compensate(&od.axis[0]);
        compensate(&od.axis[1]);
        od.geometry.squareness_x = od.geometry.squareness_y = 10000;
    }
    od.onchip_plant.start_x = part_knots[0][0];
    od.onchip_plant.start_y = part_knots[0][1];
    *r = (struct rig){.hal = {.ctx = r, .drive_read = drive_read, .drive_write = drive_write},
                      .ring = {.start = {{part_knots[0][0], part_knots[0][1]}}}};
    onchip_configuration(&od, &r->onchip_plant_cfg);
    onchip_plant_reset(&r->onchip_plant_cfg, &r->onchip_plant);
    show(r);
    servo_loop_init(&r->loop, &r->hal, &r->ring);
    configuration_servo_loop(&od, &r->loop.cfg[0]);
    for (int i = 0; i < 2; i++) {
        atomic_store(&r->loop.command.powered[i], SERVO_LOOP_ON);
    }
    atomic_store(&r->loop.command.controller, (uint8_t)controller);
    atomic_store(&r->loop.command.run, true);
    rig_feed(r);
}
