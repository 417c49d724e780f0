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

enum { SYNC_US = 1000 };
#define ONE_AXIS_MS 1000u
enum { MOST_BEHIND_MS = 5000 }; /* The background never falls that far behind: writing the flash takes less. */
enum { TPDO_OF_RANGE = 6 };     /* has the range of the contour error, 2210h:13 and 14 */

static void report(struct device *device, const struct servo_snapshot *s)
{
    struct od_data *od = &device->od;
    telemetry_report(od, s, path_position(&device->drive.path).nm);
    for (int i = 0; i < 2; i++) {
        od->axis[i].position_demand = path_reference(&device->drive.path).nm[i];
        od->axis[i].ip_buffer.position = (uint16_t)(od->stream.accepted - od->stream.executed);
    }
}

_Static_assert(FAULTS + CO_ERRORS_OF_NODE <= CO_ERRORS, "there must be room for every error");

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

/* Raise a fault for each condition of the microcontroller that is new since the last call, and for none a second time. */
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
    device->od.tick_cycles.last = h.tick_cycles;
    device->od.tick_cycles.worst = h.tick_cycles_worst;
}

/* An error of the row `node` of faults.toml is in effect, or not. */
static void report_of_node(struct device *device, uint16_t code, bool in_effect)
{
    if (in_effect) {
        co_emcy_set(&device->node, code, CO_REG_MANUFACTURER, 0);
    } else {
        co_emcy_reset(&device->node, code);
    }
}

static bool is_enabled(const struct device *device, int i)
{
    return device->drive.axis[i].state == CIA402_OPERATION_ENABLED;
}

static bool is_interpolating(const struct device *device, int i)
{
    return device->od.axis[i].mode_display == MODE_INTERPOLATED_POSITION;
}

/* Whether axis `i` is to follow a path in mode 7, and the other one neither follows it nor moves by itself. */
static bool follows_alone(const struct device *device, int i)
{
    const int other = 1 - i;
    const unsigned word = device->drive.axis[i].controlword, other_word = device->drive.axis[other].controlword;
    if (!is_enabled(device, i) || !is_interpolating(device, i) || (word & CW_ENABLE_IP) == 0) {
        return false;
    }
    return !is_enabled(device, other) || (is_interpolating(device, other) && (other_word & CW_ENABLE_IP) == 0);
}

/* Whether a master has commanded one axis alone in mode 7 for ONE_AXIS_MS: by its controlword, or by records for x and
 * none for y. Nothing moves then, and without a word nobody would know why. */
static bool waits_for_other_axis(struct device *device)
{
    const bool waits = device->record_of_x || follows_alone(device, 0) || follows_alone(device, 1);
    const unsigned ms = device->one_axis_ms;
    device->one_axis_ms = (uint16_t)(!waits ? 0u : ms < ONE_AXIS_MS ? ms + 1u : ms);
    return device->one_axis_ms >= ONE_AXIS_MS;
}

/* Whether the master is missing without which no axis may have power. The claim of a holder that falls silent without
 * power ends, and is no fault; nor is an RPDO that is late then. */
static bool master_lost(const struct device *device)
{
    const bool powered = drive_powered(&device->drive);
    return (co_master_lost(&device->node) && (powered || device->drive.command_guard.holder == 0)) ||
           (co_rpdo_late(&device->node) && powered);
}

/* One step of the drive, and what it changes for the master. Bit 0, 1 of `received`: a controlword of axis 0, 1 has come. */
static void step(struct device *device, unsigned received)
{
    const struct drive_in in = {.received = received,
                                .heartbeat_lost = master_lost(device),
                                .parameters_invalid = settings_invalid(&device->settings),
                                .node_warns = co_emcy_of_node(&device->node)};
    drive_step(&device->drive, &in);
    announce(device);
}

/* ---- PDOs ---- */

static uint32_t check_rpdo(void *ctx, const struct od_entry *entry, int64_t value)
{
    const struct device *device = ctx;
    return device_objects_check(&device->objects, entry, value);
}

/* Set-points of the cyclic modes, which count from the next SYNC on */
static void take_set_points(struct device *device, unsigned number)
{
    static const uint16_t objects[][2] = {{OBJ_TARGET_POSITION_X, OBJ_TARGET_POSITION_Y},
                                          {OBJ_TARGET_VELOCITY_X, OBJ_TARGET_VELOCITY_Y},
                                          {OBJ_TARGET_TORQUE_X, OBJ_TARGET_TORQUE_Y}};
    for (unsigned k = 0; k < sizeof objects / sizeof objects[0]; k++) {
        for (int i = 0; i < 2; i++) {
            if (co_rpdo_carries(&device->node, number, objects[k][i])) {
                drive_set_point(&device->drive, i);
            }
        }
    }
}

/* A refused frame is answered at once: TPDO1 says which knot is expected next. */
static void answer_knot(struct device *device, enum queue_result result)
{
    if (result != QUEUE_ACCEPTED && result != QUEUE_NOT_OPEN) {
        co_tpdo_send(&device->node, 1);
    }
}

static void on_rpdo(void *ctx, unsigned number)
{
    struct device *device = ctx;
    const struct od_axis *axis = device->od.axis;
    static const uint16_t set_points[] = {OBJ_MODE_X, OBJ_MODE_Y, OBJ_TARGET_VELOCITY_X, OBJ_TARGET_VELOCITY_Y};
    const unsigned received = (co_rpdo_carries(&device->node, number, OBJ_CONTROLWORD_X) ? 1u : 0u) |
                              (co_rpdo_carries(&device->node, number, OBJ_CONTROLWORD_Y) ? 2u : 0u);
    bool commands = received != 0;
    take_set_points(device, number);
    for (unsigned i = 0; i < sizeof set_points / sizeof set_points[0]; i++) {
        commands = commands || co_rpdo_carries(&device->node, number, set_points[i]);
    }
    if (commands) {
        step(device, received);
    }
    if (co_rpdo_carries(&device->node, number, OBJ_KNOT_OUTPUTS)) {
        answer_knot(device, path_outputs(&device->drive.path, &device->od.knot_outputs));
    }
    if (co_rpdo_carries(&device->node, number, OBJ_KNOT)) {
        answer_knot(device, path_knot(&device->drive.path, &device->od.knot));
    }
    device->record_of_x = device->record_of_x || co_rpdo_carries(&device->node, number, OBJ_IP_RECORD_X);
    if (co_rpdo_carries(&device->node, number, OBJ_IP_RECORD_Y)) {
        device->record_of_x = false;
        const struct knot record = {{axis[0].ip_record.position, axis[1].ip_record.position}};
        if (drive_record(&device->drive, record) != SDO_OK) {
            co_tpdo_send(&device->node, 1);
        }
    }
}

static void on_sync(void *ctx)
{
    struct device *device = ctx;
    drive_sync(&device->drive);
}

static void on_tpdo(void *ctx, unsigned number)
{
    struct device *device = ctx;
    for (int i = 0; i < 2; i++) {
        if (co_tpdo_carries(&device->node, number, i == 0 ? OBJ_STATUSWORD_X : OBJ_STATUSWORD_Y)) {
            drive_statusword_sent(&device->drive, i);
        }
    }
}

/* ---- objects by SDO ---- */

static uint32_t before_write(void *ctx, const struct od_entry *entry, int64_t value)
{
    const struct device *device = ctx;
    return device_objects_before_write(&device->objects, entry, value);
}

static void on_write(void *ctx, const struct od_entry *entry)
{
    struct device *device = ctx;
    unsigned received = 0;
    device->record_of_x = entry->index == OBJ_IP_RECORD_X || (device->record_of_x && entry->index != OBJ_IP_RECORD_Y);
    if (device_objects_written(&device->objects, entry, &received)) {
        step(device, received);
    }
}

static void before_read(void *ctx, const struct od_entry *entry)
{
    const struct device *device = ctx;
    device_objects_before_read(&device->objects, entry);
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
    return !drive_powered(&device->drive) && !device_objects_foreign(&device->objects) &&
           settings_store_node(&device->settings, device->node.config.node_id);
}

static void on_heartbeat_lost(void *ctx)
{
    struct device *device = ctx;
    if (co_heartbeat_lost(&device->node)) { /* and not another master that guards the node */
        command_guard_holder_silent(&device->drive.command_guard);
    }
    step(device, 0);
}

static void set_build(struct od_data *od)
{
    od->device_name = "Kontur";
    od->hardware_version = "-";
    od->software_version = KONTUR_VERSION;
    od->build_id = KONTUR_BUILD_ID;
    od->num_backend = NUM_NAME;
    od->axis[0].motor_catalogue_number = "-";
    od->axis[1].motor_catalogue_number = "-";
    od->clock.control_hz = CONTROL_HZ;
    for (int i = 0; i < 2; i++) {
        od->axis[i].ip_buffer.max_size = QUEUE_ROOM;
        od->axis[i].ip_buffer.size = QUEUE_ROOM;
    }
}

static void on_reset(void *ctx, bool communication_only)
{
    struct device *device = ctx;
    command_guard_reset(&device->drive.command_guard);
    if (!communication_only) {
        device->record_of_x = false;
        drive_reset(&device->drive);
        device->announced = 0; /* the node has forgotten its errors */
    }
}

void device_init(struct device *device, const struct hal *hal, struct spline_ring *ring, uint8_t node_id)
{
    *device = (struct device){.hal = hal};
    device->objects = (struct device_objects){
        .od = &device->od, .node = &device->node, .drive = &device->drive, .settings = &device->settings};
    od_init(&device->od, node_id);
    set_build(&device->od);
    const uint8_t used_id = settings_init(&device->settings, &device->od, hal, node_id, configuration_fits);
    drive_init(&device->drive, &device->od, hal, ring);
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
                  .check_rpdo = check_rpdo,
                  .on_rpdo = on_rpdo,
                  .on_sync = on_sync,
                  .on_tpdo = on_tpdo,
                  .on_nmt = on_nmt,
                  .on_heartbeat_lost = on_heartbeat_lost,
                  .load = load,
                  .store_node = store_node,
                  .on_reset = on_reset},
    };
    co_init(&device->node, &config);
}

uint32_t device_sync_us(const struct device *device)
{
    return device->od.sync_period != 0 ? device->od.sync_period : SYNC_US;
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
    if (published - device->ms > MOST_BEHIND_MS) { /* the background is never so late, so a bit has flipped */
        servo_loop_raise(&device->drive.loop, FAULT_MEMORY);
        device->ms = published - 1u;
    }
    while (device->ms != published) {
        device->ms++;
        report(device, servo_loop_snapshot(&device->drive.loop));
        check_health(device);
        settings_tick_ms(&device->settings);
        report_of_node(device, CO_EMCY_FLASH_WORN, settings_worn(&device->settings));
        report_of_node(device, CO_EMCY_SAVE_REFUSED, settings_refused(&device->settings));
        report_of_node(device, CO_EMCY_QUEUE_FULL, device->drive.path.overflow);
        report_of_node(device, CO_EMCY_ONE_AXIS, waits_for_other_axis(device));
        step(device, 0);
        if (command_guard_expire(&device->drive.command_guard, drive_powered(&device->drive),
                                 drive_now(&device->drive))) {
            co_watch_heartbeat(&device->node, 0);
        }
        co_tick_ms(&device->node);
        atomic_store(&device->drive.loop.command.range, co_tpdo_in_use(&device->node, TPDO_OF_RANGE));
    }
}
