/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/queue.h"

static uint8_t crc8(const uint8_t *bytes, unsigned count)
{
    uint8_t crc = 0xFF;
    for (unsigned i = 0; i < count; i++) {
        crc ^= bytes[i];
        for (int bit = 0; bit < 8; bit++) {
            crc = (uint8_t)((crc & 0x80u) != 0 ? (crc << 1) ^ 0x2F : crc << 1);
        }
    }
    return crc ^ 0xFF;
}

uint8_t queue_crc8(const struct od_knot *f)
{
    const uint32_t dx = (uint32_t)f->dx;
    const uint32_t dy = (uint32_t)f->dy;
    const uint8_t bytes[7] = {f->sequence, (uint8_t)dx,        (uint8_t)(dx >> 8), (uint8_t)(dx >> 16),
                              (uint8_t)dy, (uint8_t)(dy >> 8), (uint8_t)(dy >> 16)};
    return crc8(bytes, sizeof bytes);
}

uint8_t queue_outputs_crc8(const struct od_knot_outputs *f)
{
    const uint8_t bytes[5] = {f->sequence, (uint8_t)f->digital, (uint8_t)(f->digital >> 8), (uint8_t)f->power,
                              (uint8_t)(f->power >> 8)};
    return crc8(bytes, sizeof bytes);
}

/* CRC-32 (IEEE 802.3) of one int32, little-endian; crc is the value without its final inversion */
static uint32_t crc32_int(uint32_t crc, int32_t value)
{
    for (int i = 0; i < 4; i++) {
        crc ^= ((uint32_t)value >> (8 * i)) & 0xFFu;
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ (0xEDB88320u & (0u - (crc & 1u)));
        }
    }
    return crc;
}

static void update_free(struct queue *q)
{
    const uint32_t waiting = q->stream->accepted - q->stream->executed;
    q->stream->free = (uint16_t)(waiting < QUEUE_ROOM ? QUEUE_ROOM - waiting : 0);
    q->stream->accepted16 = (uint16_t)q->stream->accepted;
}

static void reset_counters(struct od_stream *s)
{
    s->rejected_crc = s->rejected_full = s->rejected_sequence = s->rejected_state = s->rejected_range = 0;
    s->rejected_length = s->underruns = 0;
}

/* a + b; what leaves int32 ends at the limit, where the soft limits refuse it */
static int32_t add_nm(int32_t a, int64_t b)
{
    const int64_t sum = a + b;
    return sum > INT32_MAX ? INT32_MAX : sum < INT32_MIN ? INT32_MIN : (int32_t)sum;
}

struct knot queue_user(const struct queue *q, struct knot servo)
{
    return (struct knot){{add_nm(servo.nm[0], q->origin_nm[0]), add_nm(servo.nm[1], q->origin_nm[1])}};
}

static struct knot to_servo(const struct queue *q, struct knot user)
{
    const int32_t *origin = q->origin_nm;
    return (struct knot){{add_nm(user.nm[0], -(int64_t)origin[0]), add_nm(user.nm[1], -(int64_t)origin[1])}};
}

void queue_init(struct queue *q, struct spline_ring *ring, struct od_stream *stream)
{
    *ring = (struct spline_ring){0};
    *q = (struct queue){
        .ring = ring, .stream = stream, .min_nm = {INT32_MIN, INT32_MIN}, .max_nm = {INT32_MAX, INT32_MAX}};
    reset_counters(stream);
    queue_hold(q, (struct knot){{0, 0}});
}

void queue_hold(struct queue *q, struct knot start)
{
    struct od_stream *s = q->stream;
    q->ring->count = 0;
    q->ring->start = to_servo(q, start);
    q->equal_knots = 0;
    q->open = q->outside = q->over_acceleration = q->suspended = false;
    q->step_nm[0] = q->step_nm[1] = 0;
    q->max_nmpms2 = INT64_MAX;
    q->outputs = (struct queue_outputs){0};
    s->end_x = start.nm[0];
    s->end_y = start.nm[1];
    s->accepted = s->executed = s->checksum = 0;
    s->state = STREAM_IDLE;
    update_free(q);
}

/* The range of knots of a path that begins or goes on at `from`: the soft limits, or back to them. */
static void limit(struct queue *q, struct knot from)
{
    for (int i = 0; i < 2; i++) {
        q->low_nm[i] = from.nm[i] < q->min_nm[i] ? from.nm[i] : q->min_nm[i];
        q->high_nm[i] = from.nm[i] > q->max_nm[i] ? from.nm[i] : q->max_nm[i];
    }
}

static bool within(const struct queue *q, struct knot knot)
{
    return knot.nm[0] >= q->low_nm[0] && knot.nm[0] <= q->high_nm[0] && knot.nm[1] >= q->low_nm[1] &&
           knot.nm[1] <= q->high_nm[1];
}

void queue_begin(struct queue *q, struct knot start, uint32_t total)
{
    struct od_stream *s = q->stream;
    queue_hold(q, start);
    q->total = total;
    reset_counters(s);
    s->state = STREAM_FILLING;
    limit(q, start);
    q->open = true;
}

void queue_unlimited(struct queue *q, int axis)
{
    q->low_nm[axis] = INT32_MIN;
    q->high_nm[axis] = INT32_MAX;
}

void queue_limit_acceleration(struct queue *q, uint32_t max_nmpms2)
{
    q->max_nmpms2 = max_nmpms2;
}

static const int64_t standstill_nm[2] = {0, 0};

/* Whether the velocity changes from one step to the next by more than max_nmpms2. */
static bool too_much(const struct queue *q, const int64_t from_nm[2], const int64_t to_nm[2])
{
    for (int i = 0; i < 2; i++) {
        const int64_t change = to_nm[i] - from_nm[i];
        if (change > q->max_nmpms2 || change < -q->max_nmpms2) {
            return true;
        }
    }
    return false;
}

bool queue_end(struct queue *q, uint32_t total)
{
    const uint32_t accepted = q->stream->accepted;
    if (!q->open || q->total != 0 || total == 0 || total < accepted ||
        (total == accepted && too_much(q, q->step_nm, standstill_nm))) {
        return false;
    }
    q->total = total;
    return true;
}

bool queue_ends_standing(const struct queue *q)
{
    return q->equal_knots >= 4; /* the spline between two knots is made of four */
}

void queue_close(struct queue *q)
{
    q->open = false;
}

void queue_suspend(struct queue *q)
{
    q->suspended = q->suspended || (q->open && !q->outside && !q->over_acceleration);
    q->open = false;
}

/* Knot n, which is in the ring */
static struct knot knot_at(const struct queue *q, uint32_t n)
{
    return queue_user(q, q->ring->knot[n % SPLINE_RING]);
}

bool queue_resume(struct queue *q)
{
    const struct od_stream *s = q->stream;
    if (!q->suspended || s->state != STREAM_STOPPED) {
        return false;
    }
    limit(q, s->executed > 0 ? knot_at(q, s->executed - 1u) : queue_user(q, q->ring->start));
    for (uint32_t n = s->executed; n < s->accepted; n++) {
        if (!within(q, knot_at(q, n))) {
            return false;
        }
    }
    q->suspended = false;
    q->open = true;
    return true;
}

bool queue_complete(const struct queue *q)
{
    return q->total != 0 && q->stream->accepted == q->total;
}

static bool accepts_knots(struct queue *q)
{
    const bool accepting = q->open && !q->outside && !q->over_acceleration;
    q->stream->rejected_state += accepting ? 0u : 1u;
    return accepting;
}

/* The outputs of the next knot: its own, or those of the one before. */
static uint32_t take_outputs(struct queue_outputs *o)
{
    const uint32_t taken = o->chain != 0 ? o->next : o->accepted;
    o->chain = 0;
    o->accepted = taken & ~KNOT_HOLD; /* which is that knot's alone */
    return taken;
}

static enum queue_result accept(struct queue *q, struct knot knot)
{
    struct od_stream *s = q->stream;
    if (s->free == 0 || queue_complete(q) || s->accepted >= QUEUE_KNOTS_MAX) {
        s->rejected_full++;
        return QUEUE_FULL;
    }
    bool counts = true; /* for the servo */
    for (int i = 0; i < 2; i++) {
        const int64_t servo = (int64_t)knot.nm[i] - q->origin_nm[i];
        counts = counts && servo <= INT32_MAX && servo >= INT32_MIN;
    }
    if (!counts || !within(q, knot)) {
        q->outside = true;
        s->rejected_range++;
        return QUEUE_OUTSIDE;
    }
    const int64_t step_nm[2] = {(int64_t)knot.nm[0] - s->end_x, (int64_t)knot.nm[1] - s->end_y};
    const bool last = q->total != 0 && s->accepted + 1u == q->total; /* after it the path stands */
    if (too_much(q, q->step_nm, step_nm) || (last && too_much(q, step_nm, standstill_nm))) {
        q->over_acceleration = true;
        s->rejected_range++;
        return QUEUE_OUTSIDE;
    }
    q->step_nm[0] = step_nm[0];
    q->step_nm[1] = step_nm[1];
    q->ring->knot[s->accepted % SPLINE_RING] = to_servo(q, knot);
    q->ring->outputs[s->accepted % SPLINE_RING] = take_outputs(&q->outputs);
    q->equal_knots = s->accepted > 0 && knot.nm[0] == s->end_x && knot.nm[1] == s->end_y ? q->equal_knots + 1u : 1u;
    s->end_x = knot.nm[0];
    s->end_y = knot.nm[1];
    s->accepted++;
    q->ring->count = s->accepted;
    update_free(q);
    return QUEUE_ACCEPTED;
}

enum queue_result queue_push(struct queue *q, struct knot knot)
{
    return accepts_knots(q) ? accept(q, knot) : QUEUE_NOT_OPEN;
}

/* Whether a frame that has come is the next one; what it is refused for is counted. */
static enum queue_result check_frame(struct queue *q, uint8_t sequence, bool sound)
{
    struct od_stream *s = q->stream;
    if (!accepts_knots(q)) {
        return QUEUE_NOT_OPEN;
    }
    if (!sound) {
        s->rejected_crc++;
        return QUEUE_BAD_CRC;
    }
    if (sequence != (uint8_t)s->accepted) {
        s->rejected_sequence++;
        return QUEUE_OUT_OF_SEQUENCE;
    }
    return QUEUE_ACCEPTED;
}

enum queue_result queue_frame(struct queue *q, const struct od_knot *frame)
{
    const bool sound = frame->crc == (queue_crc8(frame) ^ q->outputs.chain);
    const enum queue_result result = check_frame(q, frame->sequence, sound);
    const struct od_stream *s = q->stream;
    const struct knot knot = {{add_nm(s->end_x, frame->dx), add_nm(s->end_y, frame->dy)}};
    return result == QUEUE_ACCEPTED ? accept(q, knot) : result;
}

enum queue_result queue_outputs_frame(struct queue *q, const struct od_knot_outputs *frame)
{
    const enum queue_result result = check_frame(q, frame->sequence, frame->crc == queue_outputs_crc8(frame));
    if (result == QUEUE_ACCEPTED) {
        q->outputs.next = (uint32_t)frame->power << 16 | frame->digital;
        q->outputs.chain = frame->crc | 1u; /* never 0 */
    }
    return result;
}

/* Path time has passed knot n: count what has changed with it. */
static void outputs_executed(struct queue *q, uint32_t n)
{
    struct queue_outputs *o = &q->outputs;
    const uint32_t now = q->ring->outputs[n % SPLINE_RING];
    if (now != o->executed) {
        o->changes++;
        o->checksum = ~crc32_int(crc32_int(~o->checksum, (int32_t)n), (int32_t)now);
        o->executed = now & ~KNOT_HOLD;
    }
}

void queue_executed(struct queue *q, uint32_t n)
{
    struct od_stream *s = q->stream;
    uint32_t crc = ~s->checksum;
    for (; s->executed < n && s->executed < s->accepted; s->executed++) {
        const struct knot k = knot_at(q, s->executed);
        crc = crc32_int(crc32_int(crc, k.nm[0]), k.nm[1]);
        outputs_executed(q, s->executed);
    }
    s->checksum = ~crc;
    update_free(q);
}

/* Whether path time has run through an open-ended stream as far as it can. */
static void end_standing(struct queue *q)
{
    struct od_stream *s = q->stream;
    if (queue_ends_standing(q) && s->accepted - s->executed <= 4u) { /* no knot has come meanwhile */
        queue_executed(q, s->accepted);
        queue_close(q);
        s->state = STREAM_DONE;
    }
}

void queue_follow(struct queue *q, const struct path_progress *path, bool may_run, bool generated)
{
    struct od_stream *s = q->stream;
    if (!path->current) {
        return;
    }
    queue_executed(q, path->executed);
    s->underruns += path->starved && !q->starved ? 1u : 0u;
    q->starved = path->starved;
    if (s->state == STREAM_IDLE || s->state == STREAM_DONE) {
        return;
    }
    if (path->at_end && q->total == 0 && !generated) {
        end_standing(q);
    } else if (path->at_end) {
        s->state = STREAM_DONE;
    } else if (!path->standing) {
        s->state = may_run ? STREAM_RUNNING : STREAM_STOPPING;
    } else if (s->state != STREAM_FILLING || !q->open) {
        s->state = STREAM_STOPPED;
    }
}
