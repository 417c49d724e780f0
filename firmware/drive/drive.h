/* SPDX-License-Identifier: Apache-2.0 */
/* drive.h: the drive as its master sees it: two axes, one stream of knots, faults. Background only.
 *
 * Both axes follow one path, so they stop together: path time runs only while both are in operation enabled with
 * controlword bit 4 set and halt (bit 8) clear; what stops one stops the other.
 */
#ifndef KONTUR_DRIVE_H
#define KONTUR_DRIVE_H
#include "cia402.h"
#include "loop.h"
#include "queue.h"

struct drive {
    struct loop loop;
    struct queue queue;
    struct od_data *od;
    struct cia402 axis[2];
    uint32_t faults;     /* latched FAULT_BIT()s */
    bool powered[2];
    uint32_t configured_at; /* snapshots published by then */
    bool starved;
};

/* Power-on, before the first tick. */
void drive_init(struct drive *d, struct od_data *od, const struct hal *hal);
/* As at power-on, while the tick goes on: power off at once, no stream, no fault. Position and time are kept. */
void drive_reset(struct drive *d);
/* Parameters have changed (without power) and fit together: take them over. */
void drive_configure(struct drive *d);
/* Controlwords in od have been written. */
void drive_command(struct drive *d);
/* Follow the servo: faults, transitions that wait for standstill, stream state, statuswords. Called once a
 * millisecond, and after drive_command(). Returns the faults that are new. */
uint32_t drive_poll(struct drive *d);
void drive_fault(struct drive *d, enum fault f);
/* Object 2200h command: SDO abort code, or 0. */
uint32_t drive_stream_command(struct drive *d, uint8_t command);
/* Knots may be taken; the servo is told when the stream is complete. */
enum queue_result drive_knot(struct drive *d, const struct od_knot *frame);
enum queue_result drive_push(struct drive *d, struct knot knot);
/* An axis is in operation enabled or stopping: parameters must not change. */
bool drive_powered(const struct drive *d);
#endif
