/* SPDX-License-Identifier: Apache-2.0 */
/* motion/queue.h: from knot frames to the ring of knots (docs/protocol.md, "Streaming knots").
 *
 * Positions here are the user's. The ring has the servo's, which count from power-on and never change. Between them lies
 * the origin, which homing sets (docs/adr/0015-origin-at-the-edges.md).
 *
 * The queue accepts no knot that is out of sequence, corrupt, out of range or more than there is room for. Each refused
 * one is counted in od.stream.
 *
 * Background only, but for the ring, which the servo tick reads; path.c and axis_modes.c call it.
 */
#ifndef KONTUR_QUEUE_H
#define KONTUR_QUEUE_H
#include "core/spline.h"
#include "motion/path_clock.h"
#include "od/od.h"

#define QUEUE_ROOM (SPLINE_RING - SPLINE_PAST) /* knots ahead of path time that fit */

/* Each knot has its own outputs, or inherits those of the one before. */
struct queue_outputs {
    uint32_t accepted;          /* of the last knot accepted */
    uint32_t executed;          /* of the last knot executed */
    uint32_t next;              /* of the next knot, where `chain` is not 0 */
    uint8_t chain;              /* the CRC of the next knot is changed by it, so that without `next` it is refused */
    uint32_t changes, checksum; /* executed changes; CRC-32 over their knots and outputs */
};

enum stream_state { STREAM_IDLE, STREAM_FILLING, STREAM_RUNNING, STREAM_STOPPING, STREAM_DONE, STREAM_STOPPED };

enum queue_result { QUEUE_ACCEPTED, QUEUE_BAD_CRC, QUEUE_OUT_OF_SEQUENCE, QUEUE_FULL, QUEUE_NOT_OPEN, QUEUE_OUTSIDE };

struct queue {
    struct spline_ring *ring;
    struct od_stream *stream;      /* counters and what the host sees of the stream */
    uint32_t total;                /* knots of the stream; 0: open-ended */
    int32_t min_nm[2], max_nm[2];  /* soft limits */
    int32_t low_nm[2], high_nm[2]; /* the range of knots: the soft limits, widened to where the stream began */
    int32_t origin_nm[2];          /* user's position less the servo's */
    uint32_t equal_knots;          /* knots at the end that are equal */
    bool starved;                  /* path time was slowed in the last step because knots were missing */
    bool open;                     /* knots are accepted */
    bool suspended;                /* closed, but the stream may be resumed */
    bool outside;                  /* a knot was out of range: no more are accepted */
    bool over_acceleration;        /* a knot exceeded max_nmpms2: no more are accepted */
    int64_t max_nmpms2;            /* second difference of knots of this stream */
    int64_t step_nm[2];            /* the last knot less the one before */
    struct queue_outputs outputs;
};

/* Knots of one stream. Path time counts in an int64, which would end after 39.8 days of knots. */
#define QUEUE_KNOTS_MAX 3000000000u

/* Initialise: the queue is closed and empty, without origin and limits. *ring: memory of its knots, which may be of another
 * kind than that of *q. */
void queue_init(struct queue *q, struct spline_ring *ring, struct od_stream *stream);
/* Discard all knots; the reference stands at `start`. */
void queue_hold(struct queue *q, struct knot start);
/* Open the queue for a stream of `total` knots (0: open-ended) from `start`. */
void queue_begin(struct queue *q, struct knot start, uint32_t total);
/* Let the open stream accept knots of this axis beyond the soft limits, for homing and for a path that follows the
 * axis. */
void queue_unlimited(struct queue *q, int axis);
/* Let the open stream refuse a knot whose second difference is larger, and a last knot that a larger step leads to.
 * 1 nm/ms2 is 1 mm/s2. */
void queue_limit_acceleration(struct queue *q, uint32_t max_nmpms2);
/* End the open-ended stream after so many knots. Returns false if none is open, if it already has more, or if it would end
 * while it moves. */
bool queue_end(struct queue *q, uint32_t total);
/* Whether an open-ended stream may end here, because its last knots are equal. */
bool queue_ends_standing(const struct queue *q);
/* A position of the servo as the user's. */
struct knot queue_user(const struct queue *q, struct knot servo);
/* Accept no more knots. */
void queue_close(struct queue *q);
/* Accept no knots until queue_resume(). A stream with a refused knot cannot be resumed. */
void queue_suspend(struct queue *q);
/* Accept knots again. false: no stopped stream is suspended, or its next knots are beyond the soft limits. */
bool queue_resume(struct queue *q);
/* Check a knot frame as received, and accept or refuse its knot. */
enum queue_result queue_frame(struct queue *q, const struct od_knot *frame);
/* Check an outputs frame as received (docs/protocol.md, "Outputs tied to knots"), and keep it for the next knot. */
enum queue_result queue_outputs_frame(struct queue *q, const struct od_knot_outputs *frame);
/* Accept or refuse a knot by its absolute position, without sequence and CRC. */
enum queue_result queue_push(struct queue *q, struct knot knot);
/* Path time has passed the first n knots: free their slots, and add them to the checksum. */
void queue_executed(struct queue *q, uint32_t n);
/* Update the state of the stream from path time. may_run: path time may run; generated: the knots are those of
 * axis_modes_generate(), which says by queue_end() where they end. */
void queue_follow(struct queue *q, const struct path_progress *path, bool may_run, bool generated);
/* Whether all knots of the stream have come. */
bool queue_complete(const struct queue *q);
/* CRC-8/AUTOSAR over sequence, dx, dy in the order of the wire. */
uint8_t queue_crc8(const struct od_knot *frame);
/* The same over sequence, digital, power. */
uint8_t queue_outputs_crc8(const struct od_knot_outputs *frame);
#endif
