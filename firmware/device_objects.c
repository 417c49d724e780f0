/* SPDX-License-Identifier: Apache-2.0 */
#include "device_objects.h"

#include <stddef.h>

#include "drive/configuration.h"
#include "drive/excite.h"

enum { ANY_SUB = 0xFF, AXIS_STEP = OBJ_CONTROLWORD_Y - OBJ_CONTROLWORD_X };

/* What is handled now comes by the channel that all masters have, while the drive is held. */
static bool by_common_channel(const struct device_objects *d)
{
    return d->drive->command_guard.holder != 0 && !co_by_second_sdo(d->node);
}

bool device_objects_foreign(const struct device_objects *d)
{
    return by_common_channel(d) && (co_has_second_sdo(d->node) || !command_guard_told(&d->drive->command_guard));
}

static int axis_of(const struct od_entry *entry)
{
    return entry->index >= OBJ_ERROR_CODE_Y ? 1 : 0;
}

/* 1010h, 1011h, 2001h */
static uint32_t check_settings(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    return settings_check(d->settings, entry, value);
}

static uint32_t store(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)value; /* the signature, which has been checked */
    return settings_command(d->settings, entry, d->node->config.node_id);
}

/* The value of a command is not stored: reading 1010h or 1011h says what can be stored or restored. */
static void stored(const struct device_objects *d, const struct od_entry *entry)
{
    od_write(d->od, entry, od_read(&od_defaults, entry));
}

/* 2000h */
static void controller_written(const struct device_objects *d, const struct od_entry *entry)
{
    (void)entry;
    atomic_store(&d->drive->loop.command.controller, d->od->controller.select);
}

/* 2033h */
static void report_errors(const struct device_objects *d, const struct od_entry *entry)
{
    (void)entry;
    for (unsigned i = 0; i < sizeof d->od->errors / sizeof d->od->errors[0]; i++) {
        d->od->errors[i] = co_emcy_code(d->node, i);
    }
}

/* Another master was refused what is the holder's. */
static void tell_holder(const struct device_objects *d)
{
    d->od->master.refused = (uint16_t)(d->od->master.refused + (d->od->master.refused < UINT16_MAX ? 1u : 0u));
    fault_monitor_event(&d->drive->fault_monitor, FAULT_SECOND_MASTER);
}

/* 2140h: a master holds the drive by a heartbeat, which is watched meanwhile. */
static uint32_t check_claim(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)d;
    (void)entry;
    return (uint8_t)value <= 127u ? SDO_OK : SDO_ABORT_VALUE;
}

static uint32_t claim(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    struct command_guard *guard = &d->drive->command_guard;
    const uint8_t id = (uint8_t)value;
    const uint8_t before = guard->holder;
    (void)entry;
    if (!command_guard_claim(guard, id, (uint32_t)value >> 8, drive_powered(d->drive))) {
        tell_holder(d);
        return SDO_ABORT_STATE;
    }
    if (id != before) {
        co_watch_heartbeat(d->node, id);
        if (id != 0 && !co_by_second_sdo(d->node)) { /* the second channel was another master's */
            d->od->sdo_server_2.cob_id_request = od_defaults.sdo_server_2.cob_id_request;
            d->od->sdo_server_2.cob_id_response = od_defaults.sdo_server_2.cob_id_response;
        }
    }
    return SDO_OK;
}

static uint32_t arm(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return command_guard_arm(&d->drive->command_guard, (uint32_t)value, drive_now(d->drive)) ? SDO_OK : SDO_ABORT_STATE;
}

static void report_holder(const struct device_objects *d, const struct od_entry *entry)
{
    (void)entry;
    d->od->master.holder = d->drive->command_guard.holder;
}

static void draw_ticket(const struct device_objects *d, const struct od_entry *entry)
{
    (void)entry;
    if (!by_common_channel(d) || !co_has_second_sdo(d->node)) { /* nobody else makes the holder's ticket void */
        const struct hal *hal = d->node->config.hal;
        if (hal->entropy != NULL) {
            command_guard_stir(&d->drive->command_guard, hal->entropy(hal->ctx));
        }
        d->od->master.ticket = command_guard_draw(&d->drive->command_guard, drive_now(d->drive));
    }
}

/* 2200h, 60C4h */
static uint32_t command_stream(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return drive_stream_command(d->drive, (uint8_t)value);
}

static uint32_t end_stream(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return path_total(&d->drive->path, (uint32_t)value);
}

static uint32_t clear_buffer(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return value == 0 ? drive_stream_command(d->drive, STREAM_COMMAND_DISCARD) : SDO_OK;
}

/* 2220h */
static void reset_energy(const struct device_objects *d, const struct od_entry *entry)
{
    (void)entry;
    atomic_store(&d->drive->loop.command.energy_reset, true);
}

/* 2123h */
static void reset_oscillation(const struct device_objects *d, const struct od_entry *entry)
{
    (void)entry;
    atomic_store(&d->drive->loop.command.oscillation_reset, true);
}

/* 2150h to 2154h */
static uint32_t command_excitation(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return drive_excite(d->drive, value != 0);
}

static void report_excitation(const struct device_objects *d, const struct od_entry *entry)
{
    (void)entry;
    excite_report(&d->drive->loop, d->od);
}

/* 2300h, 2301h: while there is a fault, its capture stays. */
static uint32_t check_scope(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    (void)value;
    return d->drive->faults != 0 && scope_holds_fault(&d->drive->loop.scope) ? SDO_ABORT_STATE : SDO_OK;
}

static uint32_t check_signal(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    const bool known = value == 0 || (value < SIGNALS && scope_signals[value].kind != SCOPE_NONE);
    const uint32_t code = check_scope(d, entry, value);
    return code != SDO_OK ? code : known ? SDO_OK : SDO_ABORT_VALUE;
}

static uint32_t command_scope(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return drive_scope_command(d->drive, (uint8_t)value);
}

static void report_scope(const struct device_objects *d, const struct od_entry *entry)
{
    (void)entry;
    scope_report(&d->drive->loop.scope, d->od);
}

/* 6041h */
static void statusword_read(const struct device_objects *d, const struct od_entry *entry)
{
    drive_statusword_sent(d->drive, axis_of(entry));
}

/* 605Ah: options 3 and 4 are not supported. */
static uint32_t check_quick_stop(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)d;
    (void)entry;
    return value == 3 || value == 4 ? SDO_ABORT_VALUE : SDO_OK;
}

/* With power, a flipped bit of a parameter must not be sealed with what is written. */
static uint32_t check_seal(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    (void)value;
    const bool intact = !drive_powered(d->drive) || integrity_parameters_intact(&d->drive->integrity, d->od);
    return intact ? SDO_OK : SDO_ABORT_HARDWARE;
}

/* 605Eh, 6007h: the tick knows which faults stop and which cut the power. */
static void reaction_written(const struct device_objects *d, const struct od_entry *entry)
{
    (void)entry;
    drive_configure_live(d->drive);
}

/* 607Dh: while there is power, the axis is inside. */
static uint32_t check_limit(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    const int32_t here = d->od->axis[axis_of(entry)].position_actual;
    const bool inside = entry->sub == SUB_POSITION_LIMIT_MIN ? here >= value : here <= value;
    return inside || !drive_powered(d->drive) ? SDO_OK : SDO_ABORT_STATE;
}

/* 6060h: 0 is no change of the mode (CiA 402-2). */
static uint32_t check_mode(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)d;
    (void)entry;
    return value == 0 || axis_modes_known(value) ? SDO_OK : SDO_ABORT_VALUE;
}

/* 607Ah, 60FFh, 6071h */
static void set_point_written(const struct device_objects *d, const struct od_entry *entry)
{
    drive_set_point(d->drive, axis_of(entry));
}

/* 608Fh: 1 m is 10^14 times 10 fm. */
static void report_resolution(const struct device_objects *d, const struct od_entry *entry)
{
    struct od_axis *axis = &d->od->axis[axis_of(entry)];
    const uint64_t length = axis->plant.encoder;
    const uint64_t counts = (100000000000000u + length / 2u) / length;
    axis->encoder_resolution.increments = (uint32_t)(counts < UINT32_MAX ? counts : UINT32_MAX);
}

/* 6076h */
static void report_rated_torque(const struct device_objects *d, const struct od_entry *entry)
{
    struct od_axis *axis = &d->od->axis[axis_of(entry)];
    axis->rated_torque = axis->plant.force_limit;
}

/* 6098h */
static uint32_t check_homing_method(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)d;
    (void)entry;
    return homing_method_known(value) ? SDO_OK : SDO_ABORT_VALUE;
}

/* 60C1h: the record is complete with that of axis y. */
static uint32_t record(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    (void)entry;
    return drive_record(d->drive, (struct knot){{d->od->axis[0].ip_record.position, (int32_t)value}});
}

/* 60C2h: not while a stream is open; with power it is refused anyway */
static uint32_t check_period(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    const struct queue *queue = &d->drive->path.queue;
    (void)entry;
    (void)value;
    return queue->open && queue->stream->state != STREAM_DONE ? SDO_ABORT_STATE : SDO_OK;
}

/* One row of the table. A function that is NULL has nothing to do. */
static const struct object {
    uint16_t index;
    uint8_t sub;
    bool both_axes;     /* the row also describes the object of axis y */
    bool without_power; /* it cannot be written while an axis has power; the same holds for all parameters */
    bool step;          /* a drive step follows the write */
    uint32_t (*check)(const struct device_objects *d, const struct od_entry *entry, int64_t value);
    uint32_t (*command)(const struct device_objects *d, const struct od_entry *entry, int64_t value);
    void (*written)(const struct device_objects *d, const struct od_entry *entry);
    void (*refresh)(const struct device_objects *d, const struct od_entry *entry);
} objects[] = {
    {OBJ_STORE, ANY_SUB, .without_power = true, .check = check_settings, .command = store, .written = stored},
    {OBJ_RESTORE, ANY_SUB, .without_power = true, .check = check_settings, .command = store, .written = stored},
    {OBJ_GUARD_TIME, ANY_SUB, .without_power = true},
    {OBJ_LIFE_TIME_FACTOR, ANY_SUB, .without_power = true},
    {OBJ_HEARTBEAT_CONSUMER, ANY_SUB, .without_power = true},
    {OBJ_ERROR_BEHAVIOUR, ANY_SUB, .without_power = true},
    {OBJ_CONTROLLER, ANY_SUB, .written = controller_written},
    {OBJ_NODE, ANY_SUB, .without_power = true, .check = check_settings},
    {OBJ_ERRORS, ANY_SUB, .refresh = report_errors},
    {OBJ_FEED_OVERRIDE, ANY_SUB, .step = true},
    {OBJ_MASTER, SUB_MASTER_HOLDER, .refresh = report_holder},
    {OBJ_MASTER, SUB_MASTER_CLAIM, .check = check_claim, .command = claim},
    {OBJ_MASTER, SUB_MASTER_TICKET, .refresh = draw_ticket},
    {OBJ_MASTER, SUB_MASTER_ARM, .command = arm},
    {OBJ_EXCITATION, SUB_EXCITATION_COMMAND, .command = command_excitation},
    {OBJ_EXCITATION, ANY_SUB, .refresh = report_excitation},
    {OBJ_EXCITATION_FORCE, ANY_SUB, .refresh = report_excitation},
    {OBJ_EXCITATION_FIRST, ANY_SUB, .refresh = report_excitation},
    {OBJ_EXCITATION_SECOND, ANY_SUB, .refresh = report_excitation},
    {OBJ_STREAM, SUB_STREAM_COMMAND, .command = command_stream},
    {OBJ_STREAM, SUB_STREAM_TOTAL, .command = end_stream},
    {OBJ_ENERGY, SUB_ENERGY_RESET, .written = reset_energy},
    {OBJ_OSCILLATION_STATE, SUB_OSCILLATION_STATE_RESET, .written = reset_oscillation},
    {OBJ_SCOPE, SUB_SCOPE_COMMAND, .check = check_scope, .command = command_scope},
    {OBJ_SCOPE, SUB_SCOPE_SOURCE, .check = check_signal, .refresh = report_scope},
    {OBJ_SCOPE, ANY_SUB, .check = check_scope, .refresh = report_scope},
    {OBJ_SCOPE_CHANNELS, ANY_SUB, .check = check_signal},
    {OBJ_CONTROLWORD_X, ANY_SUB, .both_axes = true, .step = true},
    {OBJ_STATUSWORD_X, ANY_SUB, .both_axes = true, .refresh = statusword_read},
    {OBJ_QUICK_STOP_OPTION_X, ANY_SUB, .both_axes = true, .check = check_quick_stop},
    {OBJ_FAULT_REACTION_OPTION_X, ANY_SUB, .both_axes = true, .check = check_seal, .written = reaction_written},
    {OBJ_ABORT_CONNECTION_OPTION_X, ANY_SUB, .both_axes = true, .check = check_seal, .written = reaction_written},
    {OBJ_POSITION_LIMIT_X, ANY_SUB, .both_axes = true, .check = check_limit},
    {OBJ_MODE_X, ANY_SUB, .both_axes = true, .step = true, .check = check_mode},
    {OBJ_HOMING_METHOD_X, ANY_SUB, .both_axes = true, .check = check_homing_method},
    {OBJ_TARGET_VELOCITY_X, ANY_SUB, .both_axes = true, .step = true, .written = set_point_written},
    {OBJ_ENCODER_RESOLUTION_X, ANY_SUB, .both_axes = true, .refresh = report_resolution},
    {OBJ_TARGET_POSITION_X, ANY_SUB, .both_axes = true, .written = set_point_written},
    {OBJ_TARGET_TORQUE_X, ANY_SUB, .both_axes = true, .written = set_point_written},
    {OBJ_RATED_TORQUE_X, ANY_SUB, .both_axes = true, .refresh = report_rated_torque},
    {OBJ_IP_RECORD_Y, ANY_SUB, .command = record},
    {OBJ_IP_PERIOD_X, ANY_SUB, .both_axes = true, .check = check_period},
    {OBJ_IP_BUFFER_X, SUB_IP_BUFFER_CLEAR, .both_axes = true, .command = clear_buffer},
};

/* The first row of the table that describes the entry, or NULL */
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

/* Whether the parameters would still fit together if this one had the new value */
static uint32_t check_parameter(struct od_data *od, const struct od_entry *entry, int64_t value)
{
    const int64_t now = od_read(od, entry);
    od_write(od, entry, value);
    const bool fit = configuration_fits(od);
    od_write(od, entry, now);
    return fit ? SDO_OK : SDO_ABORT_INCOMPATIBLE;
}

static uint32_t refuse_with_power(const struct device_objects *d)
{
    fault_monitor_event(&d->drive->fault_monitor, FAULT_CONFIG_ENABLED);
    return SDO_ABORT_STATE;
}

/* A parameter may be written with power if it is OD_LIVE. */
static uint32_t check_config(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    if (drive_powered(d->drive) && (entry->flags & OD_LIVE) == 0) {
        return refuse_with_power(d);
    }
    const uint32_t code = check_seal(d, entry, value);
    return code == SDO_OK ? check_parameter(d->od, entry, value) : code;
}

uint32_t device_objects_check(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    const struct object *o = object_of(entry);
    return o->check != NULL ? o->check(d, entry, value) : SDO_OK;
}

/* A controlword that can only stop: anybody may write it. */
static bool is_stop(uint32_t controlword)
{
    const uint32_t enable = CW_SWITCH_ON | CW_ENABLE_VOLTAGE | CW_QUICK_STOP | CW_ENABLE_OPERATION;
    return (controlword & CW_FAULT_RESET) == 0 && ((controlword & enable) != enable || (controlword & CW_HALT) != 0);
}

/* What is not the holder's alone: a stop, and a claim, which has its own answer. A holder without a channel of its own
 * shows its ticket, or opens one. */
static bool is_open_to_all(const struct device_objects *d, const struct od_entry *entry, const struct object *o,
                           int64_t value)
{
    const bool stop = o->index == OBJ_CONTROLWORD_X && is_stop((uint32_t)value);
    const bool introduces = o->command == arm || entry->index == OBJ_SDO_SERVER_2;
    return stop || o->command == claim || (introduces && !co_has_second_sdo(d->node));
}

uint32_t device_objects_before_write(const struct device_objects *d, const struct od_entry *entry, int64_t value)
{
    const struct object *o = object_of(entry);
    if (device_objects_foreign(d) && !is_open_to_all(d, entry, o, value)) {
        tell_holder(d);
        return SDO_ABORT_LOCAL;
    }
    if (o->without_power && drive_powered(d->drive)) {
        return refuse_with_power(d);
    }
    uint32_t code = device_objects_check(d, entry, value);
    if (code == SDO_OK && (entry->flags & OD_CONFIG) != 0) {
        code = check_config(d, entry, value);
    }
    return code == SDO_OK && o->command != NULL ? o->command(d, entry, value) : code;
}

bool device_objects_written(const struct device_objects *d, const struct od_entry *entry, unsigned *received)
{
    const struct object *o = object_of(entry);
    if ((entry->flags & OD_LIVE) != 0) {
        drive_configure_live(d->drive);
    } else if ((entry->flags & OD_CONFIG) != 0) {
        drive_configure(d->drive, false);
    }
    if (o->written != NULL) {
        o->written(d, entry);
    }
    *received = o->index == OBJ_CONTROLWORD_X ? 1u << axis_of(entry) : 0u;
    return o->step;
}

void device_objects_before_read(const struct device_objects *d, const struct od_entry *entry)
{
    const struct object *o = object_of(entry);
    if (o->refresh != NULL) {
        o->refresh(d, entry);
    }
}
