/* SPDX-License-Identifier: Apache-2.0 */
/* drive.h: the drive as its master sees it: two axes, one stream of knots, faults. Background only.
 *
 * In interpolated position both axes follow one path, so they stop together: path time runs only while both are in
 * operation enabled with controlword bit 4 set and halt (bit 8) clear; what stops one stops the other. For the other
 * modes see motion/axis_modes.h.
 */
#ifndef KONTUR_DRIVE_H
#define KONTUR_DRIVE_H
#include "drive/cia402.h"
#include "drive/servo_loop.h"
#include "motion/axis_modes.h"
#include "motion/queue.h"
#include "supervision/command_guard.h"
#include "supervision/fault_monitor.h"
#include "supervision/integrity.h"

struct drive {
    struct servo_loop loop;
    struct queue queue;
    struct od_data *od;
    struct cia402 axis[2];
    struct command_guard command_guard;
    struct axis_modes modes;
    uint32_t faults;   /* latched FAULT_BIT()s: what stops the axes */
    uint32_t warnings; /* FAULT_BIT()s in effect that stop nothing */
    uint8_t first;     /* enum fault: the first one of `faults` */
    struct fault_monitor fault_monitor;
    bool refused;    /* an axis is to be enabled while it moves */
    bool store_lost; /* set by device.c: settings_invalid() */
    bool node_warns; /* set by device.c: errors of the CANopen node are in effect */
    struct integrity integrity;
    bool powered[2];
    uint32_t configured, begun; /* loop.command's, as they are to be */
    uint32_t configured_at;     /* snapshots published by then */
    bool starved;
    struct knot left_at; /* where a suspended path stands, nm */
};

/* The servo tick's configuration that parameters which fit make. */
struct servo_loop_cfg drive_loop_cfg(const struct od_data *od);
/* Power-on, before the first tick. */
void drive_init(struct drive *d, struct od_data *od, const struct hal *hal);
/* As at power-on, while the tick goes on: power off at once, no stream, no fault. Position and time are kept. */
void drive_reset(struct drive *d);
/* Parameters have changed (without power) and fit together: take them over. anew: all of them have, by a reset. */
void drive_configure(struct drive *d, bool anew);
/* Controlwords in od have been written, just now those of the axes of which bit 0, 1 of `received` is set. */
void drive_command(struct drive *d, unsigned received);
/* A statusword, as it is in od, goes to the master. */
void drive_told(struct drive *d, int axis);
/* Servo periods since power-on: the clock of drive->guard. */
uint32_t drive_now(const struct drive *d);
/* Follow the servo: faults, transitions that wait for standstill, stream state, statuswords. Called once a
 * millisecond, and after drive_command(). */
void drive_poll(struct drive *d);
/* A fault that stops the axes. */
void drive_fault(struct drive *d, enum fault f);
/* Object 2200h command: SDO abort code, or 0. */
uint32_t drive_stream_command(struct drive *d, uint8_t command);
/* Object 2300h command, enum scope_command: SDO abort code, or 0. */
uint32_t drive_scope_command(struct drive *d, uint8_t command);
/* Knots may be taken; the servo is told when the stream is complete. */
enum queue_result drive_knot(struct drive *d, const struct od_knot *frame);
enum queue_result drive_push(struct drive *d, struct knot knot);
/* Object 2200h total is to be written: SDO abort code, or 0. An open-ended stream that is open ends with so many. */
uint32_t drive_stream_total(struct drive *d, uint32_t total);
/* The master can stop the axes no more: stop, then power off. */
void drive_stop(struct drive *d);
/* Where the axes are, nm. */
struct knot drive_position(struct drive *d);
/* An axis is in operation enabled or stopping: parameters must not change. */
bool drive_powered(const struct drive *d);

/* Between the files of this folder: */
/* No bit has turned over where that would matter. Each millisecond. */
bool drive_intact(struct drive *d);
/* ... one has: no power, and the rest as it is to be. FAULT_MEMORY follows. */
void drive_mend(struct drive *d);
/* Path time stands. */
bool drive_stands(const struct drive *d);
/* The tick has seen the last stream begin: what it says of the path is about this one. */
bool drive_in_step(const struct drive *d);
/* Where the path stands, nm. */
struct knot drive_reference(struct drive *d);
/* Forget the stream; stand where the powered axes are held, and where the others are. */
void drive_hold(struct drive *d);
/* Open the queue; path time starts anew. */
void drive_begin(struct drive *d, struct knot start, uint32_t total);
/* ... for an open-ended stream that a master sends, if its first knot is near enough: SDO abort code, or 0. */
uint32_t drive_begin_at(struct drive *d, struct knot start, struct knot first);
/* At standstill: the user's positions of an axis become the servo's plus origin_nm. Nothing moves. */
void drive_shift_origin(struct drive *d, int axis, int32_t origin_nm);
#endif
