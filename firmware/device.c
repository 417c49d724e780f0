/* SPDX-License-Identifier: Apache-2.0 */
#include "device.h"

#include <stddef.h>

#include "drive/configuration.h"

#ifndef KONTUR_BUILD_ID
#define KONTUR_BUILD_ID "unknown"
#endif
#ifndef KONTUR_VERSION
#define KONTUR_VERSION "0.0.0"
#endif

enum { MOST_BEHIND_MS = 5000 }; /* more than writing the flash takes */
enum { ANY_SUB = 0xFF, AXIS_STEP = OBJ_CONTROLWORD_Y - OBJ_CONTROLWORD_X };

static void report(struct device *device, const struct servo_snapshot *s)
{
    struct od_data *od = &device->od;
    telemetry_report(od, s, path_position(&device->drive.path).nm);
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

/* One step of the drive, and what it changes for the master. Bit 0, 1 of `received`: a controlword of axis 0, 1 has come. */
static void step(struct device *device, unsigned received)
{
    const struct drive_in in = {.received = received,
                                .parameters_invalid = settings_invalid(&device->settings),
                                .node_warns = co_emcy_of_node(&device->node)};
    drive_step(&device->drive, &in);
    announce(device);
}

/* ---- PDOs ---- */

static void on_rpdo(void *ctx, unsigned number)
{
    struct device *device = ctx;
    const struct od_axis *axis = device->od.axis;
    const unsigned received = (co_rpdo_carries(&device->node, number, OBJ_CONTROLWORD_X) ? 1u : 0u) |
                              (co_rpdo_carries(&device->node, number, OBJ_CONTROLWORD_Y) ? 2u : 0u);
    if (received != 0) {
        step(device, received);
    }
    if (co_rpdo_carries(&device->node, number, OBJ_KNOT)) {
        const enum queue_result result = path_knot(&device->drive.path, &device->od.knot);
        if (result != QUEUE_ACCEPTED && result != QUEUE_NOT_OPEN) {
            co_tpdo_send(&device->node, 1); /* it says which knot is expected next */
        }
    }
    if (co_rpdo_carries(&device->node, number, OBJ_IP_RECORD_Y)) {
        const struct knot record = {{axis[0].ip_record.position, axis[1].ip_record.position}};
        if (drive_record(&device->drive, record) != SDO_OK) {
            co_tpdo_send(&device->node, 1);
        }
    }
}

static void on_tpdo(void *ctx, unsigned number)
{
    struct device *device = ctx;
    for (int i = 0; i < 2; i++) {
        if (co_tpdo_carries(&device->node, number, (uint16_t)(OBJ_STATUSWORD_X + i * AXIS_STEP))) {
            drive_statusword_sent(&device->drive, i);
        }
    }
}

/* ---- objects by SDO ---- */

static int axis_of(const struct od_entry *entry)
{
    return entry->index >= OBJ_ERROR_CODE_Y ? 1 : 0;
}

/* 1010h, 1011h, 2001h */
static uint32_t check_settings(const struct device *device, const struct od_entry *entry, int64_t value)
{
    return settings_check(&device->settings, entry, value);
}

static uint32_t store(struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)value; /* the signature, which has been checked */
    return settings_command(&device->settings, entry, device->node.config.node_id);
}

/* A command leaves no value: what is read says what can be stored and restored. */
static void stored(struct device *device, const struct od_entry *entry)
{
    od_write(&device->od, entry, od_read(&od_defaults, entry));
}

/* 2000h */
static void controller_written(struct device *device, const struct od_entry *entry)
{
    (void)entry;
    atomic_store(&device->drive.loop.command.controller, device->od.controller.select);
}

/* 2033h */
static void report_errors(struct device *device, const struct od_entry *entry)
{
    (void)entry;
    for (unsigned i = 0; i < sizeof device->od.errors / sizeof device->od.errors[0]; i++) {
        device->od.errors[i] = co_emcy_code(&device->node, i);
    }
}

/* 2131h */
static void feed_override_written(struct device *device, const struct od_entry *entry)
{
    (void)entry;
    step(device, 0);
}

/* 2140h: a master holds the drive by a heartbeat, which is watched meanwhile. */
static uint32_t check_claim(const struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)device;
    (void)entry;
    return (uint8_t)value <= 127u ? SDO_OK : SDO_ABORT_VALUE;
}

static uint32_t claim(struct device *device, const struct od_entry *entry, int64_t value)
{
    struct command_guard *guard = &device->drive.command_guard;
    const uint8_t id = (uint8_t)value;
    const uint8_t before = guard->holder;
    (void)entry;
    if (!command_guard_claim(guard, id, (uint32_t)value >> 8, drive_powered(&device->drive))) {
        device->od.master.refused++;
        fault_monitor_event(&device->drive.fault_monitor, FAULT_SECOND_MASTER);
        return SDO_ABORT_STATE;
    }
    if (id != before) {
        co_watch_heartbeat(&device->node, id);
    }
    return SDO_OK;
}

static uint32_t arm(struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return command_guard_arm(&device->drive.command_guard, (uint32_t)value, drive_now(&device->drive))
               ? SDO_OK
               : SDO_ABORT_STATE;
}

static void report_holder(struct device *device, const struct od_entry *entry)
{
    (void)entry;
    device->od.master.holder = device->drive.command_guard.holder;
}

static void draw_ticket(struct device *device, const struct od_entry *entry)
{
    (void)entry;
    device->od.master.ticket = command_guard_draw(&device->drive.command_guard, drive_now(&device->drive));
}

/* 2200h, 60C4h */
static uint32_t command_stream(struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return drive_stream_command(&device->drive, (uint8_t)value);
}

static uint32_t end_stream(struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return path_total(&device->drive.path, (uint32_t)value);
}

static uint32_t clear_buffer(struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return value == 0 ? drive_stream_command(&device->drive, STREAM_COMMAND_DISCARD) : SDO_OK;
}

/* 2220h */
static void reset_energy(struct device *device, const struct od_entry *entry)
{
    (void)entry;
    atomic_store(&device->drive.loop.command.energy_reset, true);
}

/* 2300h, 2301h: while there is a fault, its capture stays. */
static uint32_t check_scope(const struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    (void)value;
    return device->drive.faults != 0 && scope_holds_fault(&device->drive.loop.scope) ? SDO_ABORT_STATE : SDO_OK;
}

static uint32_t check_signal(const struct device *device, const struct od_entry *entry, int64_t value)
{
    const bool known = value == 0 || (value < SIGNALS && scope_signals[value].kind != SCOPE_NONE);
    const uint32_t code = check_scope(device, entry, value);
    return code != SDO_OK ? code : known ? SDO_OK : SDO_ABORT_VALUE;
}

static uint32_t command_scope(struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return drive_scope_command(&device->drive, (uint8_t)value);
}

static void report_scope(struct device *device, const struct od_entry *entry)
{
    (void)entry;
    scope_report(&device->drive.loop.scope, &device->od);
}

/* 6040h, 6041h */
static void controlword_written(struct device *device, const struct od_entry *entry)
{
    step(device, 1u << axis_of(entry));
}

static void statusword_read(struct device *device, const struct od_entry *entry)
{
    drive_statusword_sent(&device->drive, axis_of(entry));
}

/* 605Ah: options 3 and 4 are not supported. */
static uint32_t check_quick_stop(const struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)device;
    (void)entry;
    return value == 3 || value == 4 ? SDO_ABORT_VALUE : SDO_OK;
}

/* 6060h */
static uint32_t check_mode(const struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)device;
    (void)entry;
    return axis_modes_known(value) ? SDO_OK : SDO_ABORT_VALUE;
}

/* 6098h */
static uint32_t check_homing_method(const struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)device;
    (void)entry;
    return homing_method_known(value) ? SDO_OK : SDO_ABORT_VALUE;
}

/* 60C1h: the record is complete with that of axis y. */
static uint32_t record(struct device *device, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return drive_record(&device->drive, (struct knot){{device->od.axis[0].ip_record.position, (int32_t)value}});
}

/* 60C2h: not while a stream is open */
static uint32_t check_period(const struct device *device, const struct od_entry *entry, int64_t value)
{
    const struct queue *queue = &device->drive.path.queue;
    (void)entry;
    (void)value;
    return queue->open && queue->stream->state != STREAM_DONE ? SDO_ABORT_STATE : SDO_OK;
}

/* What writing and reading an object by SDO does beside its value. NULL: nothing. */
static const struct object {
    uint16_t index;
    uint8_t sub;
    bool both_axes;     /* there is a second one for axis y */
    bool without_power; /* it cannot be written while an axis has power; parameters (OD_CONFIG) never can */
    uint32_t (*check)(const struct device *device, const struct od_entry *entry, int64_t value); /* SDO abort code */
    uint32_t (*command)(struct device *device, const struct od_entry *entry, int64_t value);     /* SDO abort code */
    void (*written)(struct device *device, const struct od_entry *entry);
    void (*before_read)(struct device *device, const struct od_entry *entry);
} objects[] = {
    {OBJ_STORE, ANY_SUB, .without_power = true, .check = check_settings, .command = store, .written = stored},
    {OBJ_RESTORE, ANY_SUB, .without_power = true, .check = check_settings, .command = store, .written = stored},
    {OBJ_HEARTBEAT_CONSUMER, ANY_SUB, .without_power = true},
    {OBJ_ERROR_BEHAVIOUR, ANY_SUB, .without_power = true},
    {OBJ_CONTROLLER, ANY_SUB, .written = controller_written},
    {OBJ_NODE, ANY_SUB, .without_power = true, .check = check_settings},
    {OBJ_ERRORS, ANY_SUB, .before_read = report_errors},
    {OBJ_FEED_OVERRIDE, ANY_SUB, .written = feed_override_written},
    {OBJ_MASTER, SUB_MASTER_HOLDER, .before_read = report_holder},
    {OBJ_MASTER, SUB_MASTER_CLAIM, .check = check_claim, .command = claim},
    {OBJ_MASTER, SUB_MASTER_TICKET, .before_read = draw_ticket},
    {OBJ_MASTER, SUB_MASTER_ARM, .command = arm},
    {OBJ_STREAM, SUB_STREAM_COMMAND, .command = command_stream},
    {OBJ_STREAM, SUB_STREAM_TOTAL, .command = end_stream},
    {OBJ_ENERGY, SUB_ENERGY_RESET, .written = reset_energy},
    {OBJ_SCOPE, SUB_SCOPE_COMMAND, .check = check_scope, .command = command_scope},
    {OBJ_SCOPE, SUB_SCOPE_SOURCE, .check = check_signal, .before_read = report_scope},
    {OBJ_SCOPE, ANY_SUB, .check = check_scope, .before_read = report_scope},
    {OBJ_SCOPE_CHANNELS, ANY_SUB, .check = check_signal},
    {OBJ_CONTROLWORD_X, ANY_SUB, .both_axes = true, .written = controlword_written},
    {OBJ_STATUSWORD_X, ANY_SUB, .both_axes = true, .before_read = statusword_read},
    {OBJ_QUICK_STOP_OPTION_X, ANY_SUB, .both_axes = true, .check = check_quick_stop},
    {OBJ_MODE_X, ANY_SUB, .both_axes = true, .check = check_mode},
    {OBJ_HOMING_METHOD_X, ANY_SUB, .both_axes = true, .check = check_homing_method},
    {OBJ_IP_RECORD_Y, ANY_SUB, .command = record},
    {OBJ_IP_PERIOD_X, ANY_SUB, .both_axes = true, .check = check_period},
    {OBJ_IP_BUFFER_X, SUB_IP_BUFFER_CLEAR, .both_axes = true, .command = clear_buffer},
};

static const struct object *object_of(const struct od_entry *entry)
{
    static const struct object none;
    for (unsigned i = 0; i < sizeof objects / sizeof objects[0]; i++) {
        const struct object *o = &objects[i];
        const bool index = entry->index == o->index || (o->both_axes && entry->index == o->index + AXIS_STEP);
        if (index && (o->sub == ANY_SUB || o->sub == entry->sub)) {
            return o;
        }
    }
    return &none;
}

/* Whether the parameters would still fit together with this one changed */
static uint32_t check_parameter(struct od_data *od, const struct od_entry *entry, int64_t value)
{
    const int64_t now = od_read(od, entry);
    od_write(od, entry, value);
    const bool fit = configuration_fits(od);
    od_write(od, entry, now);
    return fit ? SDO_OK : SDO_ABORT_INCOMPATIBLE;
}

static uint32_t refuse_with_power(struct device *device)
{
    fault_monitor_event(&device->drive.fault_monitor, FAULT_CONFIG_ENABLED);
    return SDO_ABORT_STATE;
}

static uint32_t before_write(void *ctx, const struct od_entry *entry, int64_t value)
{
    struct device *device = ctx;
    const struct object *o = object_of(entry);
    const bool powered = drive_powered(&device->drive);
    if (o->without_power && powered) {
        return refuse_with_power(device);
    }
    uint32_t code = o->check != NULL ? o->check(device, entry, value) : SDO_OK;
    if (code == SDO_OK && (entry->flags & OD_CONFIG) != 0) {
        code = powered ? refuse_with_power(device) : check_parameter(&device->od, entry, value);
    }
    return code == SDO_OK && o->command != NULL ? o->command(device, entry, value) : code;
}

static void on_write(void *ctx, const struct od_entry *entry)
{
    struct device *device = ctx;
    const struct object *o = object_of(entry);
    if ((entry->flags & OD_CONFIG) != 0) {
        drive_configure(&device->drive, false);
    }
    if (o->written != NULL) {
        o->written(device, entry);
    }
}

static void before_read(void *ctx, const struct od_entry *entry)
{
    struct device *device = ctx;
    const struct object *o = object_of(entry);
    if (o->before_read != NULL) {
        o->before_read(device, entry);
    }
}

/* There is one domain: 2302h. */
static uint32_t domain_size(void *ctx, const struct od_entry *entry)
{
    struct device *device = ctx;
    (void)entry;
    return scope_size(&device->drive.loop.scope);
}

static bool domain_read(void *ctx, const struct od_entry *entry, uint32_t at, uint8_t *to, uint32_t count)
{
    const struct device *device = ctx;
    (void)entry;
    return scope_read(&device->drive.loop.scope, at, to, count, device->drive.path.queue.origin_nm);
}

/* ---- NMT, resets, store ---- */

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
        step(device, 0);
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
        step(device, 0);
        if (command_guard_ended(&device->drive.command_guard, drive_powered(&device->drive),
                                drive_now(&device->drive))) {
            co_watch_heartbeat(&device->node, 0);
        }
        co_tick_ms(&device->node);
    }
}
