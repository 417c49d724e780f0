/* SPDX-License-Identifier: Apache-2.0 */
/* The firmware on a simulated machine of which a test can pull every wire, with a CAN master. Node id 1. Time passes in
 * rig_run() only. A failed expectation of the rig fails the test that uses it. */
#ifndef DRIVE_RIG_H
#define DRIVE_RIG_H
#include "device.h"
#include "sim/flash.h"
#include "sim/plant.h"
#include "sim/wiring.h"
#include "unity.h"

enum { INBOX = 64, EMCY_MAX = 64 };

struct rig {
    struct device device;
    struct spline_ring ring;
    struct hal hal;
    struct plant plant;
    struct wiring wiring;
    struct sim_flash flash;
    uint16_t bitrate;                 /* last changed to */
    struct hal_drive_out out;         /* last written */
    uint8_t inputs[2];                /* enum hal_input, beside the limit switches of the plant */
    bool frozen[2];                   /* the encoder stands, whatever the axis does */
    int32_t frozen_count[2], lost[2]; /* where; counts that were lost, */
    int32_t second_lost[2];           /* and those of the second encoder */
    struct hal_health health;
    struct hal_can_status can;
    unsigned reads, writes; /* calls of the HAL */
    struct can_frame inbox[INBOX];
    unsigned inbox_count;
    /* what the master has seen */
    struct can_frame sdo;
    bool sdo_answered;
    uint16_t statusword[2], free, accepted;
    unsigned status_count, boot_ups, heartbeats;
    struct can_frame telemetry[4]; /* the last TPDO2 .. TPDO5, and when they came */
    uint32_t telemetry_ms[4];
    uint16_t emcy[EMCY_MAX];
    uint8_t emcy_reg[EMCY_MAX];
    unsigned emcy_count;
    uint32_t heartbeat_every_ms; /* of the master; 0: silent */
    bool busy;                   /* the background is: only the tick runs */
    uint32_t ms;
};

/* The HAL's can_send and can_receive, for a test that puts its own in front of them. ctx: struct rig */
bool rig_can_send(void *ctx, const struct can_frame *f);
bool rig_can_receive(void *ctx, struct can_frame *f);

/* The machine of Table 1 without noise, at the origin */
struct ks_machine rig_machine(void);
/* Power on, with the gains of Table 1. A reset brings back those that are stored, or the defaults. */
void rig_start(struct rig *r, const struct ks_machine *machine);
/* Switch TPDO2 to TPDO5 on. */
void rig_telemetry_on(struct rig *r);
/* Time passes: control periods, or milliseconds. */
void rig_run(struct rig *r, unsigned periods);
void rig_ms(struct rig *r, unsigned ms);

/* ---- the master ---- */

/* A frame, which is handled at once. */
void rig_send(struct rig *r, uint16_t id, uint8_t len, const uint8_t *data);

void rig_nmt(struct rig *r, uint8_t command);

/* Write by SDO; returns the abort code, 0 for success. */
uint32_t rig_write(struct rig *r, uint16_t index, uint8_t sub, uint8_t size, int64_t value);

uint32_t rig_read(struct rig *r, uint16_t index, uint8_t sub);

/* Both controlwords, at once. */
void rig_controlwords_at_once(struct rig *r, uint16_t x, uint16_t y);

/* Both controlwords. A command to enable waits until a master has seen the state that it leads on from. */
void rig_controlwords(struct rig *r, uint16_t x, uint16_t y);

void rig_knot(struct rig *r, uint8_t sequence, int32_t dx, int32_t dy);

/* States as the master sees them: mask 6Fh of the statusword */
enum {
    RIG_DISABLED = 0x40,
    RIG_READY = 0x21,
    RIG_SWITCHED_ON = 0x23,
    RIG_ENABLED = 0x27,
    RIG_QUICK_STOP = 0x07,
    RIG_REACTION = 0x0F,
    RIG_FAULT = 0x08
};

unsigned rig_state(const struct rig *r, int axis);

void rig_expect_states(const struct rig *r, unsigned x, unsigned y);

bool rig_bit(const struct rig *r, unsigned bit);

bool rig_had_emcy(const struct rig *r, uint16_t code);

/* Operational, both axes enabled, the master's heartbeat watched */
void rig_enable(struct rig *r);

/* A line of `length_nm` in the direction (4, 3)/5 in `count` knots */
struct rig_stream {
    unsigned count, sent; /* knots */
    double length_nm;
    int32_t x, y; /* start */
};

/* Distance from the start at knot i: a cosine in velocity */
int32_t rig_line(unsigned i, unsigned count, double length_nm);
struct knot rig_stream_knot(const struct rig_stream *s, unsigned i);
/* Begin a stream where the axes are. Returns the abort code. */
uint32_t rig_begin(struct rig *r, struct rig_stream *s);

/* Send knots up to `end`, as many as there is room for */
void rig_feed(struct rig *r, struct rig_stream *s, unsigned end);

/* Begin, fill, start, and be `ms` on the way */
void rig_go(struct rig *r, struct rig_stream *s, unsigned ms);

/* Distance of the true position from the line of s, nm */
double rig_off_line(const struct rig *r, const struct rig_stream *s);
#endif
