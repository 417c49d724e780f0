/* SPDX-License-Identifier: Apache-2.0 */
/* Of drive.h: what the parameters make of the servo's configuration, and whether all that is still as it was set. */
#include <stddef.h>

#include "drive/drive.h"

/* A speed of four times what the drive trips at is no movement; 100 counts of slack for coarse speeds. */
static uint32_t jump_counts(const struct od_data *od, const struct od_axis *a)
{
    const uint64_t counts = (uint64_t)od->limits.velocity * 4u * 100000000u / CONTROL_HZ / a->plant.encoder;
    return counts + 100u < INT32_MAX ? (uint32_t)counts + 100u : INT32_MAX;
}

struct servo_loop_cfg drive_loop_cfg(const struct od_data *od)
{
    struct servo_loop_cfg c = {.servo = configuration_servo(od),
                               .onchip_plant = configuration_onchip_plant(od),
                               .speed_max = n_ratio(od->limits.velocity, 200),
                               .stop_time = n_ratio(od->limits.path_stop_time, 1),
                               .cut = fault_mask(od, REACT_DISABLE),
                               .stop = fault_mask(od, REACT_PATH_STOP)};
    for (int i = 0; i < 2; i++) {
        const struct od_axis *a = &od->axis[i];
        c.encoder_10fm[i] = a->plant.encoder;
        c.following_max[i] = n_ratio(a->following_window, 1000);
        c.following_ticks[i] = a->following_timeout * (CONTROL_HZ / 1000u);
        c.min_nm[i] = a->position_limit.min;
        c.max_nm[i] = a->position_limit.max;
        c.jump_counts[i] = jump_counts(od, a);
    }
    return c;
}

static const struct servo_loop_cfg *in_use(const struct drive *d)
{
    return &d->loop.cfg[d->configured % 2u];
}

static void configure_hal(const struct od_data *od, const struct hal *hal)
{
    struct hal_axis_cfg cfg[AXES];
    for (int i = 0; i < AXES; i++) {
        const struct od_axis *a = &od->axis[i];
        cfg[i] = (struct hal_axis_cfg){
            .output = a->wiring.output != 0 ? HAL_OUTPUT_PWM : HAL_OUTPUT_DAC,
            .full_scale_mN = a->wiring.full_scale,
            .invert_force = a->wiring.invert_force != 0,
            .invert_encoder = a->wiring.invert_encoder != 0,
            .index_counts = a->wiring.index_counts,
            .jump_counts = jump_counts(od, a),
        };
    }
    if (hal->drive_configure != NULL) {
        hal->drive_configure(hal->ctx, cfg);
    }
}

/* ... of parameters that are as they were set. */
static void set_up(struct drive *d)
{
    const uint32_t next = atomic_load(&d->loop.command.configured) + 1u;
    d->configured_at = atomic_load(&d->loop.published);
    d->loop.cfg[next % 2u] = drive_loop_cfg(d->od);
    d->configured = next;
    atomic_store(&d->loop.command.configured, next);
    configure_hal(d->od, d->loop.hal);
    for (int i = 0; i < 2; i++) {
        d->queue.min_nm[i] = d->od->axis[i].position_limit.min;
        d->queue.max_nm[i] = d->od->axis[i].position_limit.max;
    }
}

void drive_configure(struct drive *d, bool anew)
{
    set_up(d);
    integrity_seal(&d->integrity, in_use(d), d->od, anew);
}

/* ---- bits that turn over ---- */

static bool at_fault(const struct drive *d)
{
    bool at = false;
    for (int i = 0; i < 2; i++) {
        at = at || d->axis[i].state == CIA402_FAULT || d->axis[i].state == CIA402_FAULT_REACTION_ACTIVE;
    }
    return at;
}

/* What the tick has been told is what it was told. */
static bool command_intact(const struct drive *d)
{
    const struct servo_loop_command *c = &d->loop.command;
    bool intact = atomic_load(&c->controller) == d->od->controller.select &&
                  atomic_load(&c->configured) == d->configured && atomic_load(&c->begin) == d->begun;
    for (int i = 0; i < 2; i++) {
        intact = intact && atomic_load(&c->powered[i]) == (d->powered[i] ? SERVO_LOOP_ON : SERVO_LOOP_OFF) &&
                 (!d->powered[i] || servo_loop_simulated(&d->loop) == in_use(d)->onchip_plant.simulated);
    }
    return intact;
}

bool drive_intact(struct drive *d)
{
    return integrity_intact(&d->integrity, in_use(d), d->od) && cia402_intact(&d->axis[0]) &&
           cia402_intact(&d->axis[1]) && command_intact(d) && at_fault(d) == (d->faults != 0);
}

void drive_mend(struct drive *d)
{
    for (int i = 0; i < 2; i++) {
        cia402_fault(&d->axis[i], false);
        d->powered[i] = false;
        atomic_store(&d->loop.command.powered[i], SERVO_LOOP_OFF);
    }
    atomic_store(&d->loop.command.controller, d->od->controller.select);
    atomic_store(&d->loop.command.begin, d->begun);
    d->faults = 0; /* whatever it was: the one that follows */
    if (!d->integrity.lost) {
        set_up(d);
        integrity_seal(&d->integrity, in_use(d), d->od, false);
    }
}
