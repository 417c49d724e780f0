/* SPDX-License-Identifier: Apache-2.0 */
#include "device.h"

#include <stddef.h>

#ifndef KONTUR_BUILD_ID
#define KONTUR_BUILD_ID "unknown"
#endif
#ifndef KONTUR_VERSION
#define KONTUR_VERSION "0.0.0"
#endif

enum { MOST_BEHIND_MS = 5000 }; /* more than writing the flash takes */

static void report(struct device *device, const struct servo_snapshot *s)
{
    struct od_data *od = &device->od;
    telemetry_report(od, s, drive_position(&device->drive).nm);
    for (int i = 0; i < 2; i++) {
        od->axis[i].ip_buffer.position = (uint16_t)(od->stream.accepted - od->stream.executed);
    }
}

_Static_assert(FAULTS + CO_ERRORS_OF_NODE <= CO_ERRORS, "an error that has no room is not told");

static void announce_fault(struct device *device, unsigned f, bool in_effect)
{
    if (in_effect) {
        co_emcy_set(&device->node, fault_table[f].emcy, fault_table[f].reg, f);
    } else {
        co_emcy_reset(&device->node, fault_table[f].emcy);
    }
}

/* Faults, the first of several first, and statuswords on their way out. */
static void announce(struct device *device)
{
    const uint32_t now = device->drive.faults | device->drive.warnings;
    const uint32_t changes = now ^ device->announced;
    for (unsigned i = 0; i < FAULTS && changes != 0; i++) {
        const unsigned f = (device->drive.first + i) % FAULTS;
        if ((changes & FAULT_BIT(f)) != 0) {
            announce_fault(device, f, (now & FAULT_BIT(f)) != 0);
        }
    }
    device->announced = now;
    bool changed = false;
    for (int i = 0; i < 2; i++) {
        changed = changed || device->statusword[i] != device->od.axis[i].statusword;
        device->statusword[i] = device->od.axis[i].statusword;
    }
    if (changed) {
        co_tpdo_send(&device->node, 1);
    }
}

/* What is new about the controller's own state is a fault; resetting it takes notice of it. */
static void check_health(struct device *device)
{
    static const struct {
        uint8_t bit;
        enum fault fault;
    } rows[] = {{HAL_CLOCK, FAULT_CLOCK}, {HAL_RESET, FAULT_RESTART}};
    struct hal_health h;
    if (device->hal->health == NULL) {
        return;
    }
    device->hal->health(device->hal->ctx, &h);
    for (unsigned i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        if ((h.bits & ~(unsigned)device->health & rows[i].bit) != 0) {
            const bool brown_out = rows[i].bit == HAL_RESET && h.reset == HAL_RESET_BROWN_OUT;
            servo_loop_raise(&device->drive.loop, brown_out ? FAULT_BROWN_OUT : rows[i].fault);
        }
    }
    device->health = h.bits;
    device->od.reset_cause = (uint8_t)h.reset;
    device->od.crash.pc = h.crash.pc;
    device->od.crash.lr = h.crash.lr;
    device->od.crash.psr = h.crash.psr;
    device->od.crash.cfsr = h.crash.cfsr;
    device->od.crash.hfsr = h.crash.hfsr;
    device->od.crash.bfar = h.crash.bfar;
    device->od.crash.count = h.crash.count;
}

static void follow(struct device *device)
{
    device->drive.store_lost = settings_invalid(&device->settings);
    device->drive.node_warns = co_emcy_of_node(&device->node);
    drive_poll(&device->drive);
    announce(device);
}

static void on_rpdo(void *ctx, unsigned number)
{
    struct device *device = ctx;
    const unsigned received = (co_rpdo_carries(&device->node, number, 0x6040) ? 1u : 0u) |
                              (co_rpdo_carries(&device->node, number, 0x6840) ? 2u : 0u);
    if (received != 0) {
        drive_command(&device->drive, received);
        follow(device);
    }
    if (co_rpdo_carries(&device->node, number, 0x2201)) {
        const enum queue_result result = drive_knot(&device->drive, &device->od.knot);
        if (result != QUEUE_TAKEN && result != QUEUE_NOT_OPEN) {
            co_tpdo_send(&device->node, 1); /* tell at once what is expected next */
        }
    }
    if (co_rpdo_carries(&device->node, number, 0x68C1)) {
        const struct od_axis *axis = device->od.axis;
        if (axis_modes_record(&device->drive,
                              (struct knot){{axis[0].ip_record.position, axis[1].ip_record.position}}) != 0) {
            co_tpdo_send(&device->node, 1);
        }
    }
}

static void on_tpdo(void *ctx, unsigned number)
{
    struct device *device = ctx;
    for (int i = 0; i < 2; i++) {
        if (co_tpdo_carries(&device->node, number, (uint16_t)(0x6041 + i * 0x800))) {
            drive_told(&device->drive, i);
        }
    }
}

/* Whether the parameters would still fit together with this one changed */
static uint32_t fits(struct od_data *od, const struct od_entry *entry, int64_t value)
{
    const int64_t now = od_read(od, entry);
    od_write(od, entry, value);
    const bool fit = configuration_fits(od);
    od_write(od, entry, now);
    return fit ? SDO_OK : SDO_ABORT_INCOMPATIBLE;
}

static uint32_t check_settings(struct device *device, const struct od_entry *entry, int64_t value)
{
    if (drive_powered(&device->drive)) {
        fault_monitor_event(&device->drive.fault_monitor, FAULT_CONFIG_ENABLED);
        return SDO_ABORT_STATE;
    }
    const uint32_t code = settings_check(&device->settings, entry, value);
    return code != SDO_OK ? code : settings_command(&device->settings, entry, device->node.config.node_id);
}

/* 2140h: the drive is held by the heartbeat that is watched meanwhile. */
static uint32_t check_claim(struct device *device, uint32_t value)
{
    struct command_guard *command_guard = &device->drive.command_guard;
    const uint8_t id = (uint8_t)value;
    const uint8_t before = command_guard->holder;
    if (id > 127u) {
        return SDO_ABORT_VALUE;
    }
    if (!command_guard_claim(command_guard, id, value >> 8, drive_powered(&device->drive))) {
        device->od.master.refused++;
        fault_monitor_event(&device->drive.fault_monitor, FAULT_SECOND_MASTER);
        return SDO_ABORT_STATE;
    }
    if (id != before) {
        co_watch_heartbeat(&device->node, id);
    }
    return SDO_OK;
}

static uint32_t check_master(struct device *device, const struct od_entry *entry, int64_t value)
{
    if (entry->sub == 2) {
        return check_claim(device, (uint32_t)value);
    }
    return command_guard_arm(&device->drive.command_guard, (uint32_t)value, drive_now(&device->drive))
               ? SDO_OK
               : SDO_ABORT_STATE;
}

static bool is_signal(uint32_t number)
{
    return number < SIGNALS && (number == 0 || scope_signals[number].kind != SCOPE_NONE);
}

static uint32_t check_scope(struct device *device, const struct od_entry *entry, int64_t value)
{
    if (device->drive.faults != 0 && scope_holds_fault(&device->drive.loop.scope)) {
        return SDO_ABORT_STATE; /* what led to the fault would be gone, or the scope armed otherwise for the next one */
    }
    if (entry->index == 0x2301 || entry->sub == 5) {
        return is_signal((uint32_t)value) ? SDO_OK : SDO_ABORT_VALUE;
    }
    return entry->sub == 1 ? drive_scope_command(&device->drive, (uint8_t)value) : SDO_OK;
}

static uint32_t domain_size(void *ctx, const struct od_entry *entry)
{
    struct device *device = ctx;
    (void)entry; /* there is one */
    return scope_size(&device->drive.loop.scope);
}

static bool domain_read(void *ctx, const struct od_entry *entry, uint32_t at, uint8_t *to, uint32_t count)
{
    const struct device *device = ctx;
    (void)entry;
    return scope_read(&device->drive.loop.scope, at, to, count, device->drive.queue.origin_nm);
}

static void before_read(void *ctx, const struct od_entry *entry)
{
    struct device *device = ctx;
    if (entry->index == 0x2300) {
        scope_report(&device->drive.loop.scope, &device->od);
    } else if (entry->index == 0x2033) {
        for (unsigned i = 0; i < sizeof device->od.errors / sizeof device->od.errors[0]; i++) {
            device->od.errors[i] = co_emcy_code(&device->node, i);
        }
    } else if (entry->index == 0x2140) {
        device->od.master.holder = device->drive.command_guard.holder;
        if (entry->sub == 3) {
            device->od.master.ticket = command_guard_draw(&device->drive.command_guard, drive_now(&device->drive));
        }
    } else if (entry->index == 0x6041 || entry->index == 0x6841) {
        drive_told(&device->drive, entry->index == 0x6041 ? 0 : 1);
    }
}

/* Parameters, and who is watched while the axes move, and what follows from his silence: 1016h, 1029h */
static bool needs_power_off(const struct od_entry *entry)
{
    return (entry->flags & OD_CONFIG) != 0 || entry->index == 0x1016 || entry->index == 0x1029;
}

static uint32_t before_write(void *ctx, const struct od_entry *entry, int64_t value)
{
    struct device *device = ctx;
    if (entry->index == 0x2300 || entry->index == 0x2301) {
        return check_scope(device, entry, value);
    }
    if (entry->index == 0x1010 || entry->index == 0x1011 || entry->index == 0x2001) {
        return check_settings(device, entry, value);
    }
    if (entry->index == 0x2140) {
        return check_master(device, entry, value);
    }
    const uint32_t code = axis_modes_check_write(&device->drive, entry, value);
    if (code != SDO_OK) {
        return code;
    }
    if (needs_power_off(entry)) {
        if (drive_powered(&device->drive)) {
            fault_monitor_event(&device->drive.fault_monitor, FAULT_CONFIG_ENABLED);
            return SDO_ABORT_STATE;
        }
        return fits(&device->od, entry, value);
    }
    if (entry->index == 0x2200 && entry->sub == 1) {
        return drive_stream_command(&device->drive, (uint8_t)value);
    }
    if (entry->index == 0x2200 && entry->sub == 4) {
        return drive_stream_total(&device->drive, (uint32_t)value);
    }
    return SDO_OK;
}

static void on_write(void *ctx, const struct od_entry *entry)
{
    struct device *device = ctx;
    if ((entry->flags & OD_CONFIG) != 0) {
        drive_configure(&device->drive, false);
    }
    switch (entry->index) {
    case 0x1010:
    case 0x1011: /* a command; what is read tells what can be done */
        od_write(&device->od, entry, od_read(&od_defaults, entry));
        break;
    case 0x6040:
    case 0x6840:
        drive_command(&device->drive, entry->index == 0x6040 ? 1u : 2u);
        follow(device);
        break;
    case 0x2131: follow(device); break;
    case 0x2000: atomic_store(&device->drive.loop.command.controller, device->od.controller.select); break;
    case 0x2220: atomic_store(&device->drive.loop.command.energy_reset, true); break;
    default: break;
    }
}

static void on_nmt(void *ctx, enum co_state state)
{
    struct device *device = ctx;
    if (state != CO_OPERATIONAL) { /* no PDO can stop the axes any more */
        drive_stop(&device->drive);
    }
}

static uint8_t load(void *ctx, bool communication_only)
{
    struct device *device = ctx;
    return settings_reset(&device->settings, communication_only);
}

static bool store_node(void *ctx)
{
    struct device *device = ctx;
    return !drive_powered(&device->drive) && settings_store_node(&device->settings, device->node.config.node_id);
}

static void on_heartbeat_lost(void *ctx)
{
    struct device *device = ctx;
    command_guard_lost(&device->drive.command_guard);
    if (drive_powered(&device->drive)) {
        drive_fault(&device->drive, FAULT_HEARTBEAT);
        follow(device);
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
    struct device *device = ctx;
    command_guard_reset(&device->drive.command_guard);
    if (!communication_only) {
        drive_reset(&device->drive);
        device->announced = 0; /* the node has forgotten its errors */
    }
}

void device_init(struct device *device, const struct hal *hal, uint8_t node_id)
{
    *device = (struct device){.hal = hal};
    od_init(&device->od, node_id);
    set_build(&device->od);
    const uint8_t used_id = settings_init(&device->settings, &device->od, hal, node_id, configuration_fits);
    drive_init(&device->drive, &device->od, hal);
    const struct co_config config = {
        .od = &device->od,
        .hal = hal,
        .node_id = used_id,
        .hooks = {.ctx = device,
                  .before_write = before_write,
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
    co_init(&device->node, &config);
}

void device_tick(struct device *device)
{
    servo_loop_tick(&device->drive.loop);
}

void device_poll(struct device *device)
{
    struct can_frame frame;
    bool more = true;
    for (int i = 0; i < 64 && more; i++) {
        more = device->hal->can_receive(device->hal->ctx, &frame);
        if (more) {
            co_receive(&device->node, &frame);
        }
    }
    if (!more) {
        command_guard_drained(&device->drive.command_guard, drive_now(&device->drive));
    }
    const uint32_t published = atomic_load(&device->drive.loop.published);
    if (published - device->ms > MOST_BEHIND_MS) { /* no background is so late: the count has changed by itself */
        servo_loop_raise(&device->drive.loop, FAULT_MEMORY);
        device->ms = published - 1u;
    }
    while (device->ms != published) {
        device->ms++;
        report(device, servo_loop_snapshot(&device->drive.loop));
        check_health(device);
        follow(device);
        if (command_guard_ended(&device->drive.command_guard, drive_powered(&device->drive),
                                drive_now(&device->drive))) {
            co_watch_heartbeat(&device->node, 0);
        }
        co_tick_ms(&device->node);
    }
}
