/* SPDX-License-Identifier: Apache-2.0 */
/* drive/drive.h: the drive as its master sees it: two axes (CiA 402), one stream of knots, faults. Background only; the
 * caller is device.c.
 *
 * drive_step() runs once a millisecond, and once for each write of a controlword, a mode or a target velocity, so that
 * the statusword never answers an older command. It calls these functions once each, in this order:
 *
 *  1. path_read            the servo's snapshot and the progress of path time
 *  2. take_controlwords    CiA 402 of each axis: controlwords that have just come; reset of faults
 *  3. supervise            flipped bits, fault monitor, faults of the tick: what stops the axes, what is warned of
 *  4. settle               CiA 402 of each axis: transitions that waited for standstill, and for the brake
 *  5. switch_power         which axes have power from now on; a path is held, suspended or ended with it
 *  6. follow_path          whether path time may run; progress and end of the path; modes of operation
 *  7. write_command        the words that the servo tick reads
 *  8. report_status        statusword and mode of each axis
 *
 * Frames are sent and EMCYs raised by device.c after the step. No module but drive.c works on struct drive.
 *
 * In interpolated position both axes follow one path, so they stop together: path time runs only while both are in
 * operation enabled with bit 4 of the controlword set and bit 8 (halt) clear. For the other modes see
 * motion/axis_modes.h.
 */
#ifndef KONTUR_DRIVE_H
#define KONTUR_DRIVE_H
#include "drive/amplifier.h"
#include "drive/cia402.h"
#include "drive/path.h"
#include "drive/servo_loop.h"
#include "supervision/command_guard.h"
#include "supervision/fault_monitor.h"
#include "supervision/integrity.h"

struct drive {
    struct servo_loop loop;
    struct path path;
    struct od_data *od;
    struct cia402 axis[2];
    struct command_guard command_guard;
    uint32_t faults;   /* latched FAULT_BIT()s: what stops the axes */
    uint32_t warnings; /* FAULT_BIT()s in effect that stop nothing */
    uint8_t first;     /* enum fault: the first one of `faults` */
    struct fault_monitor fault_monitor;
    struct integrity integrity;
    bool node_warns;               /* drive_in.node_warns of the last step */
    bool enable_refused;           /* an axis is to be enabled while one without power moves */
    struct amplifier amplifier[2]; /* loop.command.powered is to be amplifier_word() of it */
    uint32_t configured;           /* loop.command.configured as it is to be */
    uint32_t configured_ms;        /* snapshots published when the configuration was handed over */
};

struct drive_in {
    unsigned received;       /* bit 0, 1: a controlword of axis 0, 1 has just come, and is in od */
    bool heartbeat_lost;     /* that of the master is missing */
    bool parameters_invalid; /* stored parameters could not be used */
    bool node_warns;         /* errors of the CANopen node are in effect */
};

/* Initialise at power-on, before the first tick. */
void drive_init(struct drive *d, struct od_data *od, const struct hal *hal, struct spline_ring *ring);
/* Reset to the state at power-on, while the tick goes on: power off at once, no stream, no fault. Position and time do not
 * change. */
void drive_reset(struct drive *d);
/* Parameters have changed (without power) and fit together: hand them over to the tick. reset: every one is new, by a
 * reset. */
void drive_configure(struct drive *d, bool reset);
/* Parameters marked OD_LIVE have changed, with power or without, and fit together: they are in effect from the next movement
 * on. */
void drive_configure_live(struct drive *d);
/* One step: called once a millisecond, and once for each write of a command. */
void drive_step(struct drive *d, const struct drive_in *in);
/* The master can no longer stop the axes: stop them, then switch their power off. */
void drive_stop(struct drive *d);
/* Whether a fault that stops the axes is latched. */
void drive_fault(struct drive *d, enum fault f);
/* The statusword of od has been sent to the master. */
void drive_statusword_sent(struct drive *d, int axis);

/* A set-point of a cyclic mode has come for an axis, by RPDO or SDO. It counts from the next SYNC on. */
void drive_set_point(struct drive *d, int axis);
/* SYNC has come, and synchronous RPDOs are in od. */
void drive_sync(struct drive *d);

/* Object 2200h command: SDO abort code, or 0. */
uint32_t drive_stream_command(struct drive *d, uint8_t command);
/* A record of 60C1h for both axes has come. The first one opens a stream if none is open. Returns SDO_OK, or the abort
 * code. */
uint32_t drive_record(struct drive *d, struct knot record);
/* Carry out the command written to object 2300h, enum scope_command. Returns SDO_OK, or the abort code. */
uint32_t drive_scope_command(struct drive *d, uint8_t command);

/* Begin the excitation that 2150h and 2151h describe, or end the one that runs. Returns SDO_OK, or the abort code. */
uint32_t drive_excite(struct drive *d, bool begin);

/* Whether an axis is in operation enabled or stops, so that parameters must not change. */
bool drive_powered(const struct drive *d);
/* Servo periods since power-on: the clock of the command guard. */
uint32_t drive_now(const struct drive *d);
#endif
