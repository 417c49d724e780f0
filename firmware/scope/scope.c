/* SPDX-License-Identifier: Apache-2.0 */
/* scope.c: the scope of scope.h. The first part runs in the servo tick, the second in the background. */
#include "scope/scope.h"

#include <stddef.h>
#include <string.h>

#include "core/servo.h"
#include "hal/hal.h"

/* Tick and background run on one processor, so no ordering beyond that of the compiler is needed. */
#define LOAD(x) atomic_load_explicit(&(x), memory_order_relaxed)

/* ---- the tick ---- */

static uint32_t path_hundredths(const struct path_state *p)
{
    return p->knot * 100u + (uint32_t)((uint64_t)p->fraction * (100u / 5u) >> 29); /* PATH_ONE is 5 2^29 */
}

static uint32_t reference_nm(const pos_t *position, unsigned axis, const struct servo_out *out)
{
    const vec2 e_w = out->contour.e_w;
    return (uint32_t)pos_to_nm(pos_add(*position, n_neg(axis == 0 ? e_w.x : e_w.y)));
}

static bool is_position(const struct scope_signal *s)
{
    return s->kind == SCOPE_POS || s->kind == SCOPE_REFERENCE;
}

static uint32_t sample(const struct scope_signal *s, const void *const base[])
{
    const void *at = (const unsigned char *)base[s->base] + s->offset;
    switch (s->kind) {
    case SCOPE_NUM: return n_word(*(const num *)at);
    case SCOPE_ACC: return n_word(acc_to(*(const acc_t *)at));
    case SCOPE_POS: return (uint32_t)pos_to_nm(*(const pos_t *)at);
    case SCOPE_REFERENCE: return reference_nm(at, s->axis, base[SCOPE_BASE_OUT]);
    case SCOPE_PATH: return path_hundredths(at);
    case SCOPE_U8: return *(const uint8_t *)at;
    default: return *(const uint32_t *)at;
    }
}

static bool is_number(const struct scope_signal *s)
{
    return s->kind == SCOPE_NUM || s->kind == SCOPE_ACC;
}

/* Whether the level has been crossed in this period, in the direction of the trigger. */
static bool crosses(struct scope *s, const void *const base[])
{
    const uint32_t now = sample(&s->source, base);
    const bool above =
        is_number(&s->source) ? n_lt(n_of_word(s->level), n_of_word(now)) : (int32_t)s->level < (int32_t)now;
    const bool crossed = s->primed && above != s->above && above == (s->trigger == SCOPE_RISING);
    s->above = above;
    s->primed = true;
    return crossed;
}

static bool triggers(struct scope *s, const void *const base[], uint32_t cause)
{
    if (cause != 0 || s->trigger == SCOPE_NOW) {
        return true;
    }
    return s->trigger != SCOPE_FAULT && crosses(s, base) && s->half[s->recording].filled >= s->before;
}

static void begin(struct scope *s, uint8_t half)
{
    struct scope_capture *c = &s->half[half];
    s->recording = half;
    c->next = c->filled = c->after = c->cause = 0;
}

static void finish(struct scope *s)
{
    s->done = s->recording;
    if (s->of_fault) {
        atomic_store(&s->runs, false);
    } else {
        begin(s, s->recording ^ 1u);
        s->trigger = SCOPE_FAULT;
        s->before = s->before_fault;
    }
    atomic_store(&s->state, SCOPE_DONE);
}

static void take_frame(struct scope *s, struct scope_capture *c, const void *const base[], uint32_t tick)
{
    uint32_t *to = &c->sample[(size_t)c->next * s->channels];
    for (unsigned i = 0; i < s->channels; i++) {
        to[i] = sample(&s->signal[i], base);
    }
    c->next = c->next + 1u < s->capacity ? c->next + 1u : 0u;
    c->filled += c->filled < s->capacity ? 1u : 0u;
    c->last_tick = tick;
}

void scope_step(struct scope *s, const void *const base[SCOPE_BASES], uint32_t tick)
{
    struct scope_capture *c = &s->half[s->recording];
    const uint8_t state = LOAD(s->state);
    const uint32_t fault = s->raised | LOAD(s->background_faults);
    const uint32_t cause = fault | (state == SCOPE_WAITING ? LOAD(s->background_warnings) : 0u);
    bool triggered = state == SCOPE_TRIGGERED;
    s->of_fault = s->of_fault || fault != 0;
    if (!triggered && triggers(s, base, cause)) {
        c->cause = cause;
        c->trigger_tick = tick;
        triggered = true;
        atomic_store(&s->state, SCOPE_TRIGGERED);
    }
    if (s->wait != 0) {
        s->wait--;
        return;
    }
    s->wait = (uint16_t)(s->periods - 1u);
    take_frame(s, c, base, tick);
    if (triggered && ++c->after == s->capacity - s->before) {
        finish(s);
    }
}

/* ---- the background ---- */

void scope_off(struct scope *s)
{
    atomic_store(&s->runs, false);
    atomic_store(&s->state, SCOPE_OFF);
    s->serial++;
}

bool scope_arm(struct scope *s, const struct od_data *od, const int32_t origin_nm[2])
{
    const struct od_scope *c = &od->scope;
    const uint32_t periods = (uint32_t)((uint64_t)c->interval * CONTROL_HZ / 1000000u);
    const bool level = c->trigger == SCOPE_RISING || c->trigger == SCOPE_FALLING;
    uint8_t channels = 0;
    while (channels < SCOPE_CHANNELS && od->scope_channels[channels] != 0) {
        channels++;
    }
    if (channels == 0 || (level && c->source == 0)) {
        return false;
    }
    scope_off(s);
    s->channels = channels;
    memcpy(s->number, od->scope_channels, sizeof s->number);
    for (unsigned i = 0; i < channels; i++) {
        s->signal[i] = scope_signals[s->number[i]];
    }
    s->periods = (uint16_t)(periods > 0 ? periods : 1u);
    s->capacity = (uint32_t)SCOPE_SAMPLES / channels;
    s->trigger = c->trigger;
    s->before = c->trigger == SCOPE_NOW ? 0u : s->capacity * c->pre / 1000u;
    s->before -= s->before == s->capacity ? 1u : 0u;
    s->before_fault = s->capacity * od_defaults.scope.pre / 1000u;
    if (level) {
        s->source = scope_signals[c->source];
        const int32_t origin = is_position(&s->source) ? origin_nm[s->source.axis] : 0;
        s->level =
            is_number(&s->source) ? n_word(n_ratio(c->level, s->source.scale)) : (uint32_t)c->level - (uint32_t)origin;
    }
    s->wait = 0;
    s->primed = s->of_fault = false;
    begin(s, 0);
    atomic_store(&s->background_faults, 0u);
    atomic_store(&s->background_warnings, 0u);
    atomic_store(&s->state, SCOPE_WAITING);
    atomic_store(&s->runs, true);
    return true;
}

void scope_fault(struct scope *s, uint32_t faults)
{
    atomic_fetch_or(&s->background_faults, faults);
}

void scope_warning(struct scope *s, uint32_t warnings)
{
    if (s->trigger == SCOPE_FAULT) {
        atomic_fetch_or(&s->background_warnings, warnings);
    }
}

/* The capture that was triggered last. */
static const struct scope_capture *newest(const struct scope *s)
{
    return &s->half[atomic_load(&s->state) == SCOPE_DONE ? s->done : s->recording];
}

bool scope_holds_fault(const struct scope *s)
{
    return atomic_load(&s->state) >= SCOPE_TRIGGERED && (s->of_fault || newest(s)->cause != 0);
}

void scope_report(const struct scope *s, struct od_data *od)
{
    const uint8_t state = atomic_load(&s->state);
    od->scope.state = state;
    od->scope.frames = state == SCOPE_DONE ? newest(s)->filled : 0u;
    od->scope.trigger_period = state >= SCOPE_TRIGGERED ? newest(s)->trigger_tick : 0u;
}

uint32_t scope_size(struct scope *s)
{
    if (atomic_load(&s->state) != SCOPE_DONE) {
        return 0;
    }
    s->reading = s->serial;
    s->read_half = s->done;
    return SCOPE_HEADER + s->half[s->read_half].filled * s->channels * 4u;
}

/* The counts on the wire of a sample. */
static uint32_t counts(const struct scope_signal *s, uint32_t word, const int32_t origin_nm[2])
{
    if (is_number(s)) {
        return (uint32_t)n_to_scaled(n_of_word(word), s->scale);
    }
    return is_position(s) ? word + (uint32_t)origin_nm[s->axis] : word;
}

/* Word i of 2302h. */
static uint32_t word_at(const struct scope *s, uint32_t i, const int32_t origin_nm[2])
{
    const struct scope_capture *c = &s->half[s->read_half];
    const uint32_t first = c->filled < s->capacity ? 0u : c->next;
    switch (i) {
    case 0: return SCOPE_VERSION | (uint32_t)s->channels << 8 | (uint32_t)s->periods << 16;
    case 1: return c->filled;
    case 2: return c->filled - c->after;
    case 3: return c->last_tick - (c->filled - 1u) * s->periods;
    case 4: return c->trigger_tick;
    case 5: return c->cause;
    case 6:
    case 7: {
        const uint8_t *n = &s->number[4 * (size_t)(i - 6)];
        return n[0] | (uint32_t)n[1] << 8 | (uint32_t)n[2] << 16 | (uint32_t)n[3] << 24;
    }
    default: break;
    }
    const uint32_t frame = (i - 8) / s->channels, channel = (i - 8) % s->channels;
    return counts(&s->signal[channel], c->sample[(first + frame) % s->capacity * s->channels + channel], origin_nm);
}

bool scope_read(const struct scope *s, uint32_t at, uint8_t *to, uint32_t count, const int32_t origin_nm[2])
{
    if (s->reading != s->serial) {
        return false;
    }
    for (uint32_t i = at; i < at + count; i++) {
        *to++ = (uint8_t)(word_at(s, i / 4u, origin_nm) >> 8 * (i % 4u));
    }
    return true;
}
