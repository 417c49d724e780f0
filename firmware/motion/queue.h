/* SPDX-License-Identifier: Apache-2.0 */
/* motion/queue.h: from knot frames to the ring of knots (docs/protocol.md, "Streaming knots"). Background only, except that the
 * servo tick reads the ring.
 *
 * Positions here are the user's; the ring has those of the servo, which count from power-on and never change. Between
 * them lies the origin, which homing shifts (docs/adr/0015).
 *
 * Nothing is taken that is out of sequence, corrupt or too much; everything refused is counted in od.stream.
 */
#ifndef KONTUR_QUEUE_H
#define KONTUR_QUEUE_H
#include "core/spline.h"
#include "motion/path_clock.h"
#include "od/od.h"

#define QUEUE_ROOM (SPLINE_RING - SPLINE_PAST) /* knots that can wait */

enum stream_state { STREAM_IDLE, STREAM_FILLING, STREAM_RUNNING, STREAM_STOPPING, STREAM_DONE, STREAM_STOPPED };

enum queue_result { QUEUE_ACCEPTED, QUEUE_BAD_CRC, QUEUE_OUT_OF_SEQUENCE, QUEUE_FULL, QUEUE_NOT_OPEN, QUEUE_OUTSIDE };

struct queue {
    struct spline_ring ring;
    struct od_stream *stream;      /* counters and what the host sees of the stream */
    uint32_t total;                /* knots of the stream; 0: open-ended */
    int32_t min_nm[2], max_nm[2];  /* soft limits */
    int32_t low_nm[2], high_nm[2]; /* ... when it began or was resumed, and where it stood: no knot beyond is taken */
    int32_t origin_nm[2];          /* user's position less the servo's */
    uint32_t still;                /* knots at the end that are equal */
    bool starved;                  /* path time was slowed for want of knots when last looked at */
    bool open;                     /* knots are taken */
    bool suspended;                /* closed, but its path may go on */
    bool outside;                  /* one was refused as beyond the soft limits: none is taken any more */
    bool sharp;                    /* ... as beyond max_nmpms2 */
    int64_t max_nmpms2;            /* second difference of knots of this stream */
    int64_t step_nm[2];            /* the last knot less the one before */
};

/* Closed, empty; no origin, no limits. */
void queue_init(struct queue *q, struct od_stream *stream);
/* Forget all knots; the reference stands at start. */
void queue_hold(struct queue *q, struct knot start);
/* Open for a stream of `total` knots (0: open-ended) from `start`. */
void queue_begin(struct queue *q, struct knot start, uint32_t total);
/* The stream that is open takes knots of this axis beyond the soft limits, too: homing. */
void queue_unlimited(struct queue *q, int axis);
/* The stream that is open takes no knots whose second difference is larger, and no last one after a step that is;
 * 1 nm/ms2 is 1 mm/s2. */
void queue_limit_acceleration(struct queue *q, uint32_t max_nmpms2);
/* An open-ended stream that is open ends with so many knots. false: there is none, it has more already, or just as many,
 * but would end at speed. */
bool queue_end(struct queue *q, uint32_t total);
/* An open-ended stream could end here: it stands still in its last knots. */
bool queue_ends_standing(const struct queue *q);
/* Positions of the servo in the user's. */
struct knot queue_user(const struct queue *q, struct knot servo);
/* Take no more knots. */
void queue_close(struct queue *q);
/* Take none until queue_resume(). A stream with a refused knot is closed for good. */
void queue_suspend(struct queue *q);
/* Take knots again. false: there is no suspended stream that was stopped, or what waits of it is beyond the soft limits. */
bool queue_resume(struct queue *q);
/* One knot frame as it came from the wire. */
enum queue_result queue_frame(struct queue *q, const struct od_knot *frame);
/* Take a knot by its absolute position, without sequence and CRC. */
enum queue_result queue_push(struct queue *q, struct knot knot);
/* Path time has passed the first n knots: free their slots, go on with the checksum. */
void queue_executed(struct queue *q, uint32_t n);
/* The state of the stream follows path time. may_run: path time may run; generated: the knots are those of
 * axis_modes_generate(), which says by queue_end() where they end. */
void queue_follow(struct queue *q, const struct path_progress *path, bool may_run, bool generated);
/* All knots of the stream are here. */
bool queue_complete(const struct queue *q);
/* CRC-8/AUTOSAR over sequence, dx, dy in the order of the wire. */
uint8_t queue_crc8(const struct od_knot *frame);
#endif
