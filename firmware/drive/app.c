/* SPDX-License-Identifier: Apache-2.0 */
#include "app.h"

#include <stddef.h>

#ifndef KONTUR_BUILD_ID
#define KONTUR_BUILD_ID "unknown"
#endif
#ifndef KONTUR_VERSION
#define KONTUR_VERSION "0.0.0"
#endif

enum { MOST_BEHIND_MS = 5000 }; /* more than writing the flash takes */

static int32_t clamp(int32_t x, int32_t lo, int32_t hi)
{
    return x < lo ? lo : x > hi ? hi : x;
}

static int32_t int24(int32_t x)
{
    return clamp(x, -0x800000, 0x7FFFFF);
}

/* The low 24 bits, as a signed number */
static int32_t low24(int32_t x)
{
    return (int32_t)(((uint32_t)x + 0x800000u) & 0xFFFFFFu) - 0x800000;
}

static uint32_t mean_pm(const struct loop_error *error)
{
    const uint64_t pm = error->sum_nm * 1000u / error->samples;
    return pm > UINT32_MAX ? UINT32_MAX : (uint32_t)pm;
}

/* 60FDh: the limit switches from bit 0, what is ours from bit 16 */
static uint32_t digital_inputs(uint8_t inputs)
{
    return (inputs & 0x0Fu) | (uint32_t)(inputs >> 4) << 16;
}

static void report(struct app *app, const struct loop_snapshot *s)
{
    struct od_data *od = &app->od;
    struct od_telemetry *t = &od->telemetry;
    const struct knot position = drive_position(&app->drive);
    const int64_t energy = (int64_t)s->energy_mJ[0] + s->energy_mJ[1];

    od->clock.tick = s->ms;
    od->controller.active = s->controller;
    od->stream.rate = (uint16_t)s->rate;
    const struct loop_error *error = &s->error;
    od->path_error.samples = error->samples;
    od->path_error.max = error->max_nm;
    od->path_error.mean = error->samples == 0 ? 0u : mean_pm(error);
    od->energy.x = (uint32_t)clamp(s->energy_mJ[0], 0, INT32_MAX);
    od->energy.y = (uint32_t)clamp(s->energy_mJ[1], 0, INT32_MAX);
    for (int i = 0; i < 2; i++) {
        od->axis[i].position_actual = position.nm[i];
        od->axis[i].velocity_actual = s->velocity_umps[i];
        od->axis[i].following_error = s->following_nm[i];
        od->axis[i].learned.friction = s->learned_mN[i];
        od->axis[i].learned.mass = s->learned_g[i];
        od->axis[i].digital_inputs = digital_inputs(s->inputs[i]);
        od->axis[i].ip_buffer.position = (uint16_t)(od->stream.accepted - od->stream.executed);
    }
    t->tick = (uint16_t)s->ms;
    t->e_n1 = int24(s->e_n_nm[0]);
    t->e_n2 = int24(s->e_n_nm[1]);
    t->position_x = low24(position.nm[0]);
    t->position_y = low24(position.nm[1]);
    t->force_x = (int16_t)clamp(s->force_dN[0], INT16_MIN, INT16_MAX);
    t->force_y = (int16_t)clamp(s->force_dN[1], INT16_MIN, INT16_MAX);
    t->k_1 = (uint16_t)clamp(s->k_hat[0], 0, UINT16_MAX);
    t->k_2 = (uint16_t)clamp(s->k_hat[1], 0, UINT16_MAX);
    t->mu_1 = (uint16_t)clamp(s->mu[0], 0, UINT16_MAX);
    t->mu_2 = (uint16_t)clamp(s->mu[1], 0, UINT16_MAX);
    t->energy = energy < 0 ? 0 : (uint32_t)energy;
}

_Static_assert(FAULTS + CO_ERRORS_OF_NODE <= CO_ERRORS, "an error that has no room is not told");

static void announce_fault(struct app *app, unsigned f, bool in_effect)
{
    if (in_effect) {
        co_emcy_set(&app->node, fault_table[f].emcy, fault_table[f].reg, f);
    } else {
        co_emcy_reset(&app->node, fault_table[f].emcy);
    }
}

/* Faults, the first of several first, and statuswords on their way out. */
static void announce(struct app *app)
{
    const uint32_t now = app->drive.faults | app->drive.warnings;
    const uint32_t changes = now ^ app->announced;
    for (unsigned i = 0; i < FAULTS && changes != 0; i++) {
        const unsigned f = (app->drive.first + i) % FAULTS;
        if ((changes & FAULT_BIT(f)) != 0) {
            announce_fault(app, f, (now & FAULT_BIT(f)) != 0);
        }
    }
    app->announced = now;
    bool changed = false;
    for (int i = 0; i < 2; i++) {
        changed = changed || app->statusword[i] != app->od.axis[i].statusword;
        app->statusword[i] = app->od.axis[i].statusword;
    }
    if (changed) {
        co_tpdo_send(&app->node, 1);
    }
}

/* What is new about the controller's own state is a fault; resetting it takes notice of it. */
static void check_health(struct app *app)
{
    static const struct {
        uint8_t bit;
        enum fault fault;
    } rows[] = {{HAL_CLOCK, FAULT_CLOCK}, {HAL_RESET, FAULT_RESTART}};
    struct hal_health h;
    if (app->hal->health == NULL) {
        return;
    }
    app->hal->health(app->hal->ctx, &h);
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        if ((h.bits & ~(unsigned)app->health & rows[i].bit) != 0) {
            const bool brown_out = rows[i].bit == HAL_RESET && h.reset == HAL_RESET_BROWN_OUT;
            loop_raise(&app->drive.loop, brown_out ? FAULT_BROWN_OUT : rows[i].fault);
        }
    }
    app->health = h.bits;
    app->od.reset_cause = (uint8_t)h.reset;
    app->od.crash.pc = h.crash.pc;
    app->od.crash.lr = h.crash.lr;
    app->od.crash.psr = h.crash.psr;
    app->od.crash.cfsr = h.crash.cfsr;
    app->od.crash.hfsr = h.crash.hfsr;
    app->od.crash.bfar = h.crash.bfar;
    app->od.crash.count = h.crash.count;
}

static void follow(struct app *app)
{
    app->drive.store_lost = settings_lost(&app->settings);
    app->drive.node_warns = co_emcy_of_node(&app->node);
    drive_poll(&app->drive);
    announce(app);
}

static void on_rpdo(void *ctx, unsigned number)
{
    struct app *app = ctx;
    const unsigned received = (co_rpdo_carries(&app->node, number, 0x6040) ? 1u : 0u) |
                              (co_rpdo_carries(&app->node, number, 0x6840) ? 2u : 0u);
    if (received != 0) {
        drive_command(&app->drive, received);
        follow(app);
    }
    if (co_rpdo_carries(&app->node, number, 0x2201)) {
        const enum queue_result result = drive_knot(&app->drive, &app->od.knot);
        if (result != QUEUE_TAKEN && result != QUEUE_NOT_OPEN) {
            co_tpdo_send(&app->node, 1); /* tell at once what is expected next */
        }
    }
    if (co_rpdo_carries(&app->node, number, 0x68C1)) {
        const struct od_axis *axis = app->od.axis;
        if (modes_record(&app->drive, (struct knot){{axis[0].ip_record.position, axis[1].ip_record.position}}) != 0) {
            co_tpdo_send(&app->node, 1);
        }
    }
}

static void on_tpdo(void *ctx, unsigned number)
{
    struct app *app = ctx;
    for (int i = 0; i < 2; i++) {
        if (co_tpdo_carries(&app->node, number, (uint16_t)(0x6041 + i * 0x800))) {
            drive_told(&app->drive, i);
        }
    }
}

/* Whether the parameters would still fit together with this one changed */
static uint32_t fits(struct od_data *od, const struct od_entry *entry, int64_t value)
{
    const int64_t now = od_read(od, entry);
    od_write(od, entry, value);
    const bool fit = params_fit(od);
    od_write(od, entry, now);
    return fit ? SDO_OK : SDO_ABORT_INCOMPATIBLE;
}

static uint32_t check_settings(struct app *app, const struct od_entry *entry, int64_t value)
{
    if (drive_powered(&app->drive)) {
        watch_event(&app->drive.watch, FAULT_CONFIG_ENABLED);
        return SDO_ABORT_STATE;
    }
    return settings_command(&app->settings, entry, value, app->node.config.node_id);
}

/* 2140h: the drive is held by the heartbeat that is watched meanwhile. */
static uint32_t check_claim(struct app *app, uint32_t value)
{
    struct guard *guard = &app->drive.guard;
    const uint8_t id = (uint8_t)value;
    const uint8_t before = guard->holder;
    if (id > 127u) {
        return SDO_ABORT_VALUE;
    }
    if (!guard_claim(guard, id, value >> 8, drive_powered(&app->drive))) {
        app->od.master.refused++;
        watch_event(&app->drive.watch, FAULT_SECOND_MASTER);
        return SDO_ABORT_STATE;
    }
    if (id != before) {
        co_guard(&app->node, id);
    }
    return SDO_OK;
}

static uint32_t check_master(struct app *app, const struct od_entry *entry, int64_t value)
{
    if (entry->sub == 2) {
        return check_claim(app, (uint32_t)value);
    }
    return guard_arm(&app->drive.guard, (uint32_t)value, drive_now(&app->drive)) ? SDO_OK : SDO_ABORT_STATE;
}

static bool is_signal(uint32_t number)
{
    return number < SIGNALS && (number == 0 || scope_signals[number].kind != SCOPE_NONE);
}

static uint32_t check_scope(struct app *app, const struct od_entry *entry, int64_t value)
{
    if (app->drive.faults != 0 && scope_holds_fault(&app->drive.loop.scope)) {
        return SDO_ABORT_STATE; /* what led to the fault would be gone, or the scope armed otherwise for the next one */
    }
    if (entry->index == 0x2301 || entry->sub == 5) {
        return is_signal((uint32_t)value) ? SDO_OK : SDO_ABORT_VALUE;
    }
    return entry->sub == 1 ? drive_scope_command(&app->drive, (uint8_t)value) : SDO_OK;
}

static uint32_t domain_size(void *ctx, const struct od_entry *entry)
{
    struct app *app = ctx;
    (void)entry; /* there is one */
    return scope_size(&app->drive.loop.scope);
}

static bool domain_read(void *ctx, const struct od_entry *entry, uint32_t at, uint8_t *to, uint32_t count)
{
    const struct app *app = ctx;
    (void)entry;
    return scope_read(&app->drive.loop.scope, at, to, count, app->drive.queue.origin_nm);
}

static void before_read(void *ctx, const struct od_entry *entry)
{
    struct app *app = ctx;
    if (entry->index == 0x2300) {
        scope_report(&app->drive.loop.scope, &app->od);
    } else if (entry->index == 0x2033) {
        for (unsigned i = 0; i < sizeof app->od.errors / sizeof app->od.errors[0]; i++) {
            app->od.errors[i] = co_emcy_code(&app->node, i);
        }
    } else if (entry->index == 0x2140) {
        app->od.master.holder = app->drive.guard.holder;
        if (entry->sub == 3) {
            app->od.master.ticket = guard_draw(&app->drive.guard, drive_now(&app->drive));
        }
    } else if (entry->index == 0x6041 || entry->index == 0x6841) {
        drive_told(&app->drive, entry->index == 0x6041 ? 0 : 1);
    }
}

/* Parameters, and who is watched while the axes move, and what follows from his silence: 1016h, 1029h */
static bool needs_power_off(const struct od_entry *entry)
{
    return (entry->flags & OD_CONFIG) != 0 || entry->index == 0x1016 || entry->index == 0x1029;
}

static uint32_t check_write(void *ctx, const struct od_entry *entry, int64_t value)
{
    struct app *app = ctx;
    if (entry->index == 0x2300 || entry->index == 0x2301) {
        return check_scope(app, entry, value);
    }
    if (entry->index == 0x1010 || entry->index == 0x1011 || entry->index == 0x2001) {
        return check_settings(app, entry, value);
    }
    if (entry->index == 0x2140) {
        return check_master(app, entry, value);
    }
    const uint32_t code = modes_check_write(&app->drive, entry, value);
    if (code != SDO_OK) {
        return code;
    }
    if (needs_power_off(entry)) {
        if (drive_powered(&app->drive)) {
            watch_event(&app->drive.watch, FAULT_CONFIG_ENABLED);
            return SDO_ABORT_STATE;
        }
        return fits(&app->od, entry, value);
    }
    if (entry->index == 0x2200 && entry->sub == 1) {
        return drive_stream_command(&app->drive, (uint8_t)value);
    }
    if (entry->index == 0x2200 && entry->sub == 4) {
        return drive_stream_total(&app->drive, (uint32_t)value);
    }
    return SDO_OK;
}

static void on_write(void *ctx, const struct od_entry *entry)
{
    struct app *app = ctx;
    if ((entry->flags & OD_CONFIG) != 0) {
        drive_configure(&app->drive, false);
    }
    switch (entry->index) {
    case 0x1010:
    case 0x1011: /* a command; what is read tells what can be done */
        od_write(&app->od, entry, od_read(&od_defaults, entry));
        break;
    case 0x6040:
    case 0x6840:
        drive_command(&app->drive, entry->index == 0x6040 ? 1u : 2u);
        follow(app);
        break;
    case 0x2131:
        follow(app);
        break;
    case 0x2000:
        atomic_store(&app->drive.loop.command.controller, app->od.controller.select);
        break;
    case 0x2220:
        atomic_store(&app->drive.loop.command.energy_reset, true);
        break;
    default:
        break;
    }
}

static void on_nmt(void *ctx, enum co_state state)
{
    struct app *app = ctx;
    if (state != CO_OPERATIONAL) { /* no PDO can stop the axes any more */
        drive_stop(&app->drive);
    }
}

static uint8_t load(void *ctx, bool communication_only)
{
    struct app *app = ctx;
    return settings_reset(&app->settings, communication_only);
}

static bool store_node(void *ctx)
{
    struct app *app = ctx;
    return !drive_powered(&app->drive) && settings_store_node(&app->settings, app->node.config.node_id);
}

static void on_heartbeat_lost(void *ctx)
{
    struct app *app = ctx;
    guard_lost(&app->drive.guard);
    if (drive_powered(&app->drive)) {
        drive_fault(&app->drive, FAULT_HEARTBEAT);
        follow(app);
    }
}

static void set_build(struct od_data *od)
{
    od->device_name = "Kontur";
    od->hardware_version = "-";
    od->software_version = KONTUR_VERSION;
    od->build_id = KONTUR_BUILD_ID;
    od->num_backend = NUM_NAME;
    od->clock.control_hz = CONTROL_HZ;
}

static void on_reset(void *ctx, bool communication_only)
{
    struct app *app = ctx;
    guard_reset(&app->drive.guard);
    if (!communication_only) {
        drive_reset(&app->drive);
        app->announced = 0; /* the node has forgotten its errors */
    }
}

void app_init(struct app *app, const struct hal *hal, uint8_t node_id)
{
    *app = (struct app){.hal = hal};
    od_init(&app->od, node_id);
    set_build(&app->od);
    const uint8_t used_id = settings_init(&app->settings, &app->od, hal, node_id);
    drive_init(&app->drive, &app->od, hal);
    const struct co_config config = {
        .od = &app->od,
        .hal = hal,
        .node_id = used_id,
        .hooks = {.ctx = app,
                  .check_write = check_write,
                  .on_write = on_write,
                  .before_read = before_read,
                  .domain_size = domain_size,
                  .domain_read = domain_read,
                  .on_rpdo = on_rpdo,
                  .on_tpdo = on_tpdo,
                  .on_nmt = on_nmt,
                  .on_heartbeat_lost = on_heartbeat_lost,
                  .load = load,
                  .store_node = store_node,
                  .on_reset = on_reset},
    };
    co_init(&app->node, &config);
}

void app_tick(struct app *app)
{
    loop_tick(&app->drive.loop);
}

void app_poll(struct app *app)
{
    struct can_frame frame;
    bool more = true;
    for (int i = 0; i < 64 && more; i++) {
        more = app->hal->can_receive(app->hal->ctx, &frame);
        if (more) {
            co_receive(&app->node, &frame);
        }
    }
    if (!more) {
        guard_drained(&app->drive.guard, drive_now(&app->drive));
    }
    const uint32_t published = atomic_load(&app->drive.loop.published);
    if (published - app->ms > MOST_BEHIND_MS) { /* no background is so late: the count has changed by itself */
        loop_raise(&app->drive.loop, FAULT_MEMORY);
        app->ms = published - 1u;
    }
    while (app->ms != published) {
        app->ms++;
        report(app, loop_snapshot(&app->drive.loop));
        check_health(app);
        follow(app);
        if (guard_ended(&app->drive.guard, drive_powered(&app->drive), drive_now(&app->drive))) {
            co_guard(&app->node, 0);
        }
        co_tick_ms(&app->node);
    }
}
