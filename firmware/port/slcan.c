/* SPDX-License-Identifier: Apache-2.0 */
/* slcan.c: the parser and formatter of slcan.h. */
#include "port/slcan.h"

enum { CR = '\r', LF = '\n', BEL = '\a', STAMP_MS = 60000, VERSION = 0x1010 };

static const char hex[] = "0123456789ABCDEF";

static int digit(char c)
{
    if (c >= '0' && c <= '9') {
        return c - '0';
    }
    if (c >= 'A' && c <= 'F') {
        return c - 'A' + 10;
    }
    return c >= 'a' && c <= 'f' ? c - 'a' + 10 : -1;
}

/* The number of `count` hex digits, 7 at most. -1: one of them is not a hex digit. */
static int32_t number(const char *text, unsigned count)
{
    int32_t value = 0;
    for (unsigned i = 0; i < count; i++) {
        const int d = digit(text[i]);
        if (d < 0) {
            return -1;
        }
        value = value << 4 | d;
    }
    return value;
}

static char *put(char *at, uint32_t value, unsigned digits)
{
    for (unsigned i = digits; i-- > 0;) {
        *at++ = hex[value >> (4 * i) & 0xFu];
    }
    return at;
}

void slcan_init(struct slcan *s, uint16_t serial)
{
    *s = (struct slcan){.serial = serial};
}

static bool read_frame(const struct slcan *s, struct can_frame *frame)
{
    const bool rtr = s->line[0] == 'r';
    if (!s->open || s->listen_only || s->count < 5) {
        return false;
    }
    const int32_t id = number(&s->line[1], 3);
    const int len = digit(s->line[4]);
    if (id < 0 || id > 0x7FF || len < 0 || len > 8 || s->count != (rtr ? 5 : 5 + 2 * len)) {
        return false;
    }
    *frame = (struct can_frame){.id = (uint16_t)id, .len = (uint8_t)len, .rtr = rtr};
    for (int i = 0; i < len && !rtr; i++) {
        const int32_t byte = number(&s->line[5 + 2 * i], 2);
        if (byte < 0) {
            return false;
        }
        frame->data[i] = (uint8_t)byte;
    }
    return true;
}

/* Frames that classic CANopen does not have: with 29-bit identifiers (T, R), and of CAN FD (d, D, b, B, as CANable 2.0
 * writes them). */
static bool is_foreign_frame(char letter)
{
    switch (letter) {
    case 'T':
    case 'R':
    case 'd':
    case 'D':
    case 'b':
    case 'B': return true;
    default: return false;
    }
}

/* The length of the line of a command. 0: there is no such command. */
static unsigned length(char letter)
{
    switch (letter) {
    case 'O':
    case 'L':
    case 'C':
    case 'F':
    case 'V':
    case 'N': return 1;
    case 'S':
    case 'Z': return 2;
    case 's': return 5;
    case 'M':
    case 'm': return 9;
    default: return 0;
    }
}

static bool command(struct slcan *s, enum slcan_event *event, struct slcan_answer *answer)
{
    const char letter = s->line[0];
    char *at = answer->text;
    if (s->count != length(letter)) {
        return false;
    }
    switch (letter) {
    case 'O':
    case 'L':
        s->open = true;
        s->listen_only = letter == 'L';
        *event = SLCAN_OPENED;
        return true;
    case 'C':
        s->open = false;
        *event = SLCAN_CLOSED;
        return true;
    case 'F':
        at = put(at + 1, s->flags, 2);
        s->flags = 0;
        break;
    case 'V': at = put(at + 1, VERSION, 4); break;
    case 'N': at = put(at + 1, s->serial, 4); break;
    case 'S': return !s->open && s->line[1] >= '0' && s->line[1] <= '8';
    case 's': return !s->open && number(&s->line[1], 4) >= 0;
    case 'Z':
        if (s->line[1] != '0' && s->line[1] != '1') {
            return false;
        }
        s->stamps = s->line[1] == '1';
        return true;
    default: return number(&s->line[1], 4) >= 0 && number(&s->line[5], 4) >= 0; /* M, m */
    }
    answer->text[0] = letter;
    answer->count = (uint8_t)(at - answer->text);
    return true;
}

enum slcan_event slcan_parse(struct slcan *s, char byte, struct can_frame *frame, struct slcan_answer *answer)
{
    enum slcan_event event = SLCAN_NOTHING;
    answer->count = 0;
    if (byte == LF && s->count == 0) { /* of CR LF */
        return event;
    }
    if (byte != CR && byte != LF) {
        if (s->count < SLCAN_LINE) {
            s->line[s->count++] = byte;
        } else {
            s->count = SLCAN_LINE + 1;
        }
        return event;
    }
    if (s->count > 0 && s->open && is_foreign_frame(s->line[0])) {
        s->count = 0;
        return event;
    }
    bool good;
    if (s->count == 0) {
        good = true;
    } else if (s->count > SLCAN_LINE) {
        good = false;
    } else if (s->line[0] == 't' || s->line[0] == 'r') {
        good = read_frame(s, frame);
        event = good ? SLCAN_HAS_FRAME : event;
    } else {
        good = command(s, &event, answer);
    }
    s->count = 0;
    if (!good) {
        s->refused++;
        answer->count = 0;
        answer->text[answer->count++] = BEL;
        return SLCAN_NOTHING;
    }
    if (event != SLCAN_HAS_FRAME) {
        answer->text[answer->count++] = CR;
    }
    return event;
}

unsigned slcan_format(const struct slcan *s, const struct can_frame *frame, uint32_t ms, char *out)
{
    if (!s->open) {
        return 0;
    }
    char *at = out;
    *at++ = frame->rtr ? 'r' : 't';
    at = put(at, frame->id, 3);
    at = put(at, frame->len, 1);
    for (unsigned i = 0; i < frame->len && !frame->rtr; i++) {
        at = put(at, frame->data[i], 2);
    }
    if (s->stamps) {
        at = put(at, ms % STAMP_MS, 4);
    }
    *at++ = CR;
    return (unsigned)(at - out);
}
