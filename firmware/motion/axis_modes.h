/* SPDX-License-Identifier: Apache-2.0 */
/* motion/axis_modes.h: the modes of the axes (6060h): what moves them. Background only; called by drive.c and device.c.
 *
 * 7, interpolated position: both axes follow one stream of knots or records; it moves only while both are in mode 7.
 * 3, profile velocity, and 6, homing: each axis by itself. Their ways are made here (motion/profile.h) as knots for both axes,
 * some milliseconds ahead of path time, and go the way of all knots: same law, limits, faults, stop on the path. An axis in
 * mode 7 beside one in mode 3 or 6 is held where it stands.
 * A mode is taken over when its axis stands and homes no more; a stream that waits is forgotten then.
 */
#ifndef KONTUR_MODES_H
#define KONTUR_MODES_H
#include "motion/homing.h"
#include "motion/ip_record.h"
#include "motion/profile.h"
#include "od/od.h"

enum { MODE_VELOCITY = 3, MODE_HOMING = 6, MODE_PATH = 7 };

struct axis_mode {
    int8_t mode; /* in use */
    struct profile profile;
    struct homing homing;
    uint16_t controlword; /* of the last poll */
    int32_t wish_umps;    /* what the master asks for, before limits */
    bool limited;         /* ... and does not get, because of a limit */
};

struct axis_modes {
    struct axis_mode axis[2];
    bool generating; /* the path is made here */
    bool ending;     /* ... all of it has been */
    struct ip_record record;
    bool by_record; /* the stream was begun by a record */
    bool by_frame;  /* knot frames have been taken: no record is, whose checksum is that of CAN alone */
};

struct drive;

/* As at power-on; what homing has found is kept. */
void axis_modes_reset(struct drive *d);
/* With each drive_poll(): take modes over, make knots, end homings. */
void axis_modes_poll(struct drive *d);
/* The axis stands, whatever the other one does. */
bool axis_modes_stands(const struct drive *d, int axis);
/* Both axes are in mode 7, so a stream may move them. */
bool axis_modes_follows_stream(const struct drive *d);
/* Bits 10..13 of 6041h. */
uint16_t axis_modes_status(const struct drive *d, int axis);
/* A stream that records began has as many knots as keep it from starving at once: for a stop, and for a master whose
 * records come two periods and RECORD_JITTER late. */
bool axis_modes_may_start(const struct drive *d);
/* A record of 60C1h for both axes: SDO abort code, or 0. The first one while no stream is open begins one. */
uint32_t axis_modes_record(struct drive *d, struct knot record);
/* An SDO wants to write one of the objects of this file: abort code, or 0. */
uint32_t axis_modes_check_write(struct drive *d, const struct od_entry *entry, int64_t value);
#endif
