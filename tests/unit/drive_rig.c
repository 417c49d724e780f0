/* SPDX-License-Identifier: Apache-2.0 */
#include "drive_rig.h"

#include <math.h>
#include <string.h>

#include "table1.h"

static void drive_read(void *ctx, struct hal_drive_in *in)
{
    struct rig *r = ctx;
    r->reads++;
    *in = (struct hal_drive_in){0};
    plant_encoders(&r->plant, in->count);
    plant_scales(&r->plant, in->second);
    plant_switches(&r->plant, in->inputs);
    for (int i = 0; i < 2; i++) {
        in->index_pulses[i] = r->plant.index_pulses[i];
        in->index_count[i] = r->plant.index_count[i];
    }
    wiring_read(&r->wiring, in);
    for (int i = 0; i < 2; i++) {
        in->count[i] = r->frozen[i] ? r->frozen_count[i] : in->count[i] - r->lost[i];
        r->frozen_count[i] = in->count[i];
        in->second[i] -= r->second_lost[i];
        in->inputs[i] |= r->inputs[i];
    }
}

static void drive_write(void *ctx, const struct hal_drive_out *out)
{
    struct rig *r = ctx;
    r->writes++;
    r->out = *out;
}

static void drive_wiring(void *ctx, const struct hal_axis_cfg cfg[AXES])
{
    struct rig *r = ctx;
    wiring_configure(&r->wiring, cfg);
}

bool rig_can_send(void *ctx, const struct can_frame *f)
{
    struct rig *r = ctx;
    if (f->id == 0x581) {
        r->sdo = *f;
        r->sdo_answered = true;
    } else if (f->id == 0x181) {
        r->statusword[0] = (uint16_t)co_get(&f->data[0], 2);
        r->statusword[1] = (uint16_t)co_get(&f->data[2], 2);
        r->free = (uint16_t)co_get(&f->data[4], 2);
        r->accepted = (uint16_t)co_get(&f->data[6], 2);
        r->status_count++;
    } else if (f->id == 0x281) {
        r->telemetry[0] = *f;
        r->telemetry_ms[0] = r->ms;
    } else if (f->id == 0x381 || f->id == 0x481) {
        r->telemetry[f->id / 0x100 - 2] = *f;
        r->telemetry_ms[f->id / 0x100 - 2] = r->ms;
    } else if (f->id == 0x681) {
        r->telemetry[3] = *f;
        r->telemetry_ms[3] = r->ms;
    } else if (f->id == 0x081 && r->emcy_count < EMCY_MAX) {
        r->emcy_reg[r->emcy_count] = f->data[2];
        r->emcy[r->emcy_count++] = (uint16_t)co_get(&f->data[0], 2);
    } else if (f->id == 0x701) {
        r->boot_ups += f->data[0] == 0 ? 1 : 0;
        r->heartbeats += f->data[0] != 0 ? 1 : 0;
    }
    return true;
}

bool rig_can_receive(void *ctx, struct can_frame *f)
{
    struct rig *r = ctx;
    if (r->inbox_count == 0) {
        return false;
    }
    *f = r->inbox[0];
    r->inbox_count--;
    memmove(&r->inbox[0], &r->inbox[1], r->inbox_count * sizeof r->inbox[0]);
    return true;
}

static void can_status(void *ctx, struct hal_can_status *status)
{
    const struct rig *r = ctx;
    *status = r->can;
}

static void health(void *ctx, struct hal_health *health)
{
    const struct rig *r = ctx;
    *health = r->health;
}

static bool can_bitrate(void *ctx, uint16_t kbitps, bool change)
{
    struct rig *r = ctx;
    if (kbitps != 1000 && kbitps != 500 && kbitps != 125) {
        return false;
    }
    r->bitrate = change ? kbitps : r->bitrate;
    return true;
}

static void flash_read(void *ctx, unsigned sector, uint32_t offset, void *data, uint32_t bytes)
{
    const struct rig *r = ctx;
    sim_flash_read(&r->flash, sector, offset, data, bytes);
}

static bool flash_erase(void *ctx, unsigned sector)
{
    struct rig *r = ctx;
    return sim_flash_erase(&r->flash, sector);
}

static bool flash_write(void *ctx, unsigned sector, uint32_t offset, const void *data, uint32_t bytes)
{
    struct rig *r = ctx;
    return sim_flash_write(&r->flash, sector, offset, data, bytes);
}

void rig_send(struct rig *r, uint16_t id, uint8_t len, const uint8_t *data)
{
    struct can_frame f = {.id = id, .len = len};
    memcpy(f.data, data, len);
    TEST_ASSERT_TRUE(r->inbox_count < INBOX);
    r->inbox[r->inbox_count++] = f;
    device_poll(&r->device);
}

void rig_run(struct rig *r, unsigned periods)
{
    for (unsigned i = 0; i < periods; i++) {
        device_tick(&r->device);
        const double force_N[2] = {wiring_force_N(&r->wiring, &r->out, 0), wiring_force_N(&r->wiring, &r->out, 1)};
        if (!r->busy) {
            device_poll(&r->device);
        }
        plant_step(&r->plant, force_N);
        if (r->plant.period % 10 == 0) {
            r->ms++;
            if (r->heartbeat_every_ms != 0 && r->ms % r->heartbeat_every_ms == 0) {
                const uint8_t operational = 5;
                rig_send(r, 0x77F, 1, &operational);
            }
        }
    }
}

void rig_ms(struct rig *r, unsigned ms)
{
    rig_run(r, 10 * ms);
}

struct ks_machine rig_machine(void)
{
    return (struct ks_machine){
        .mass_kg = {88.08, 97.90},
        .viscous_Nspm = {467.2, 631.0},
        .coulomb_N = {45.5, 54.8},
        .breakaway = {1, 1},
        .stribeck_mps = {0.001, 0.001},
        .force_limit_N = {600, 600},
        .encoder_m = {76.29e-9, 76.29e-9},
        .travel_min_m = {-0.2, -0.2},
        .travel_max_m = {0.2, 0.2},
        .delay_periods = 1,
        .substeps = 10,
    };
}

void rig_start(struct rig *r, const struct ks_machine *machine)
{
    memset(r, 0, sizeof *r);
    r->hal = (struct hal){.ctx = r,
                          .drive_read = drive_read,
                          .drive_write = drive_write,
                          .drive_configure = drive_wiring,
                          .can_send = rig_can_send,
                          .can_receive = rig_can_receive,
                          .can_status = can_status,
                          .can_bitrate = can_bitrate,
                          .health = health,
                          .flash_read = flash_read,
                          .flash_erase = flash_erase,
                          .flash_write = flash_write};
    sim_flash_init(&r->flash, 1);
    TEST_ASSERT_NULL(plant_check(machine));
    plant_init(&r->plant, machine, 1, 1e-4);
    device_init(&r->device, &r->hal, &r->ring, 1);
    table1_gains(&r->device.od);
    drive_configure(&r->device.drive, false);
}

void rig_telemetry_on(struct rig *r)
{
    static const uint16_t ids[] = {0x281, 0x381, 0x481, 0x681};
    for (unsigned i = 0; i < sizeof ids / sizeof ids[0]; i++) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(r, (uint16_t)(0x1801u + i), 1, 4, ids[i]));
    }
}

void rig_nmt(struct rig *r, uint8_t command)
{
    const uint8_t data[2] = {command, 1};
    rig_send(r, 0, 2, data);
}

uint32_t rig_write(struct rig *r, uint16_t index, uint8_t sub, uint8_t size, int64_t value)
{
    uint8_t data[8] = {(uint8_t)(0x23 | (4 - size) << 2), (uint8_t)index, (uint8_t)(index >> 8), sub};
    co_put(&data[4], (uint32_t)value, size);
    r->sdo_answered = false;
    rig_send(r, 0x601, 8, data);
    TEST_ASSERT_TRUE_MESSAGE(r->sdo_answered, "no SDO answer");
    return r->sdo.data[0] == 0x80 ? co_get(&r->sdo.data[4], 4) : 0;
}

uint32_t rig_read(struct rig *r, uint16_t index, uint8_t sub)
{
    const uint8_t data[8] = {0x40, (uint8_t)index, (uint8_t)(index >> 8), sub};
    r->sdo_answered = false;
    rig_send(r, 0x601, 8, data);
    TEST_ASSERT_TRUE_MESSAGE(r->sdo_answered, "no SDO answer");
    TEST_ASSERT_NOT_EQUAL_HEX8(0x80, r->sdo.data[0]);
    return co_get(&r->sdo.data[4], (uint8_t)(4 - ((r->sdo.data[0] >> 2) & 3)));
}

void rig_controlwords_at_once(struct rig *r, uint16_t x, uint16_t y)
{
    uint8_t data[4];
    co_put(&data[0], x, 2);
    co_put(&data[2], y, 2);
    rig_send(r, 0x201, 4, data);
}

static bool knows_state(const struct rig *r, int axis)
{
    const struct drive *d = &r->device.drive;
    return command_guard_permits(&d->command_guard, axis, d->axis[axis].changes, false, drive_now(d));
}

void rig_controlwords(struct rig *r, uint16_t x, uint16_t y)
{
    const bool enabled = cia402_enabled(&r->device.drive.axis[0]) && cia402_enabled(&r->device.drive.axis[1]);
    if (((x | y) & CW_ENABLE_OPERATION) != 0 && !enabled && !(knows_state(r, 0) && knows_state(r, 1))) {
        rig_ms(r, 1);
    }
    rig_controlwords_at_once(r, x, y);
}

void rig_knot(struct rig *r, uint8_t sequence, int32_t dx, int32_t dy)
{
    const struct od_knot knot = {.sequence = sequence, .dx = dx, .dy = dy};
    uint8_t data[8] = {sequence, queue_crc8(&knot)};
    co_put(&data[2], (uint32_t)dx, 3);
    co_put(&data[5], (uint32_t)dy, 3);
    rig_send(r, 0x301, 8, data);
}

unsigned rig_state(const struct rig *r, int axis)
{
    const unsigned word = r->statusword[axis];
    return word & ((word & 0x4F) == 0x40 || (word & 0x4F) == 0x08 || (word & 0x4F) == 0x0F ? 0x4Fu : 0x6Fu);
}

void rig_expect_states(const struct rig *r, unsigned x, unsigned y)
{
    TEST_ASSERT_EQUAL_HEX16(x, rig_state(r, 0));
    TEST_ASSERT_EQUAL_HEX16(y, rig_state(r, 1));
}

bool rig_bit(const struct rig *r, unsigned bit)
{
    return (r->statusword[0] >> bit & 1u) != 0 && (r->statusword[1] >> bit & 1u) != 0;
}

bool rig_had_emcy(const struct rig *r, uint16_t code)
{
    for (unsigned i = 0; i < r->emcy_count; i++) {
        if (r->emcy[i] == code) {
            return true;
        }
    }
    return false;
}

void rig_enable(struct rig *r)
{
    rig_nmt(r, 1);
    r->heartbeat_every_ms = 50;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(r, 0x1016, 1, 4, 127 << 16 | 200));
    rig_ms(r, 3);
    rig_controlwords(r, 0x06, 0x06);
    rig_controlwords(r, 0x07, 0x07);
    rig_controlwords(r, 0x0F, 0x0F);
    rig_ms(r, 2);
    rig_expect_states(r, RIG_ENABLED, RIG_ENABLED);
}

/* A way of `length_nm` along the direction (4, 3)/5 from where a stream starts, in `count` knots: cos^2 in speed */
int32_t rig_line(unsigned i, unsigned count, double length_nm)
{
    const double first = 5, u = i <= first ? 0 : i >= count - 6 ? 1 : (i - first) / (count - 11);
    return (int32_t)lround(length_nm * (u - sin(2 * 3.14159265358979 * u) / (2 * 3.14159265358979)));
}

struct knot rig_stream_knot(const struct rig_stream *s, unsigned i)
{
    const int32_t d = rig_line(i, s->count, s->length_nm);
    return (struct knot){{s->x + d / 5 * 4, s->y + d / 5 * 3}};
}

uint32_t rig_begin(struct rig *r, struct rig_stream *s)
{
    s->x = (int32_t)rig_read(r, 0x6064, 0);
    s->y = (int32_t)rig_read(r, 0x6864, 0);
    s->sent = 0;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(r, 0x2200, 4, 4, s->count));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(r, 0x2200, 2, 4, s->x));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(r, 0x2200, 3, 4, s->y));
    return rig_write(r, 0x2200, 1, 1, 1);
}

void rig_feed(struct rig *r, struct rig_stream *s, unsigned end)
{
    while (s->sent < end && s->sent < s->count && rig_read(r, 0x2200, 6) > 0) {
        const struct knot now = rig_stream_knot(s, s->sent);
        const struct knot before = s->sent == 0 ? (struct knot){{s->x, s->y}} : rig_stream_knot(s, s->sent - 1);
        rig_knot(r, (uint8_t)s->sent, now.nm[0] - before.nm[0], now.nm[1] - before.nm[1]);
        s->sent++;
    }
}

void rig_go(struct rig *r, struct rig_stream *s, unsigned ms)
{
    TEST_ASSERT_EQUAL_HEX32(0, rig_begin(r, s));
    rig_feed(r, s, s->count);
    rig_controlwords(r, 0x1F, 0x1F);
    for (unsigned i = 0; i < ms; i++) {
        rig_ms(r, 1);
        if (i % 100 == 0) {
            rig_feed(r, s, s->count);
        }
    }
}

double rig_off_line(const struct rig *r, const struct rig_stream *s)
{
    return fabs((r->plant.pos_m[0] * 1e9 - s->x) * 0.6 - (r->plant.pos_m[1] * 1e9 - s->y) * 0.8);
}
