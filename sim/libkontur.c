/* SPDX-License-Identifier: Apache-2.0 */
/* libkontur.c: libkontur, the object of kontur_sim.h. It is
 * the HAL of the simulated machine, and it lets time pass. */
#include "sim/kontur_sim.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "device.h"
#include "drive/configuration.h"
#include "sim/flash.h"
#include "sim/plant.h"
#include "sim/wiring.h"

#define QUEUE_FRAMES 4096u

struct fifo {
    struct ks_frame frame[QUEUE_FRAMES];
    uint32_t head, count;
};

struct ks {
    struct device device;
    struct spline_ring ring;
    struct hal hal;
    struct plant plant;
    struct wiring wiring;
    struct sim_flash flash;
    struct hal_can_status can;
    uint8_t node_id;
    uint32_t entropy;
    double force_N[2];
    uint16_t digital, power; /* outputs beside the axes */
    struct fifo to_device, to_host;
    uint64_t tick;
    uint32_t overflows;
    struct ks_truth *truth;
    uint64_t truth_count, truth_capacity;
    int recording;
    int (*flash_ready)(void *ctx);
    void *flash_ready_ctx;
    void (*plant_step)(void *ctx, const double *force_N, double *pos_m); /* NULL: plant_step() of plant.h */
    void *plant_ctx;
};

static int push(struct fifo *f, const struct ks_frame *frame)
{
    if (f->count == QUEUE_FRAMES) {
        return 0;
    }
    f->frame[(f->head + f->count) % QUEUE_FRAMES] = *frame;
    f->count++;
    return 1;
}

static int pop(struct fifo *f, struct ks_frame *frame)
{
    if (f->count == 0) {
        return 0;
    }
    *frame = f->frame[f->head];
    f->head = (f->head + 1) % QUEUE_FRAMES;
    f->count--;
    return 1;
}

/* ---- the HAL of the simulated machine ---- */

static void drive_read(void *ctx, struct hal_drive_in *in)
{
    ks *s = ctx;
    *in = (struct hal_drive_in){0};
    plant_encoders(&s->plant, in->count);
    plant_scales(&s->plant, in->second);
    plant_switches(&s->plant, in->inputs);
    for (int i = 0; i < 2; i++) {
        in->index_pulses[i] = s->plant.index_pulses[i];
        in->index_count[i] = s->plant.index_count[i];
    }
    wiring_read(&s->wiring, in);
}

static void drive_write(void *ctx, const struct hal_drive_out *out)
{
    ks *s = ctx;
    for (int i = 0; i < 2; i++) {
        s->force_N[i] = wiring_force_N(&s->wiring, out, i);
    }
    s->digital = out->digital;
    s->power = out->power;
}

static void drive_wiring(void *ctx, const struct hal_axis_cfg cfg[AXES])
{
    ks *s = ctx;
    wiring_configure(&s->wiring, cfg);
}

static bool can_send(void *ctx, const struct can_frame *frame)
{
    ks *s = ctx;
    struct ks_frame f = {.id = frame->id, .len = frame->len, .rtr = frame->rtr, .tick = s->tick};
    memcpy(f.data, frame->data, sizeof f.data);
    if (!push(&s->to_host, &f)) {
        s->overflows++; /* a bus does not wait for a listener */
    }
    return true;
}

static bool can_receive(void *ctx, struct can_frame *frame)
{
    ks *s = ctx;
    struct ks_frame f;
    if (!pop(&s->to_device, &f)) {
        return false;
    }
    *frame = (struct can_frame){.id = (uint16_t)f.id, .len = f.len, .rtr = f.rtr != 0};
    memcpy(frame->data, f.data, sizeof frame->data);
    return true;
}

static void can_status(void *ctx, struct hal_can_status *status)
{
    const ks *s = ctx;
    *status = s->can;
}

/* The simulated bus has no bit rate, so it accepts every rate of CiA 301, table 1. */
static bool can_bitrate(void *ctx, uint16_t kbitps, bool change)
{
    static const uint16_t rates[] = {10, 20, 50, 125, 250, 500, 800, 1000};
    (void)ctx;
    (void)change;
    for (unsigned i = 0; i < sizeof rates / sizeof rates[0]; i++) {
        if (kbitps == rates[i]) {
            return true;
        }
    }
    return false;
}

static void flash_read(void *ctx, unsigned sector, uint32_t offset, void *data, uint32_t bytes)
{
    const ks *s = ctx;
    sim_flash_read(&s->flash, sector, offset, data, bytes);
}

static bool flash_ready(const ks *s)
{
    return s->flash_ready == NULL || s->flash_ready(s->flash_ready_ctx) != 0;
}

static bool flash_erase(void *ctx, unsigned sector)
{
    ks *s = ctx;
    return flash_ready(s) && sim_flash_erase(&s->flash, sector);
}

static bool flash_write(void *ctx, unsigned sector, uint32_t offset, const void *data, uint32_t bytes)
{
    ks *s = ctx;
    return flash_ready(s) && sim_flash_write(&s->flash, sector, offset, data, bytes);
}

static uint32_t entropy(void *ctx)
{
    const ks *s = ctx;
    return s->entropy;
}

/* ---- the interface ---- */

const char *ks_check(const struct ks_machine *machine)
{
    return plant_check(machine);
}

ks *ks_new(const struct ks_machine *machine, uint64_t seed, uint8_t node_id)
{
    if (plant_check(machine) != NULL || node_id < 1 || node_id > 31) {
        return NULL;
    }
    ks *s = calloc(1, sizeof *s);
    if (s == NULL) {
        return NULL;
    }
    s->hal = (struct hal){.ctx = s,
                          .drive_read = drive_read,
                          .drive_write = drive_write,
                          .drive_configure = drive_wiring,
                          .can_send = can_send,
                          .can_receive = can_receive,
                          .can_status = can_status,
                          .can_bitrate = can_bitrate,
                          .flash_read = flash_read,
                          .flash_erase = flash_erase,
                          .flash_write = flash_write,
                          .entropy = entropy};
    s->node_id = node_id;
    sim_flash_init(&s->flash, seed);
    plant_init(&s->plant, machine, seed, 1.0 / CONTROL_HZ);
    device_init(&s->device, &s->hal, &s->ring, node_id);
    s->device.od.hardware_version = "libkontur simulated machine";
    return s;
}

void ks_free(ks *s)
{
    if (s != NULL) {
        free(s->truth);
        free(s);
    }
}

int ks_send(ks *s, uint32_t id, uint8_t rtr, uint8_t len, const uint8_t *data)
{
    struct ks_frame f = {.id = id, .len = len, .rtr = rtr};
    if (id > 0x7FF || len > 8) {
        return -1;
    }
    memcpy(f.data, data, len);
    if (!push(&s->to_device, &f)) {
        return -1;
    }
    device_poll(&s->device);
    return 0;
}

int ks_recv(ks *s, struct ks_frame *out)
{
    return pop(&s->to_host, out);
}

/* Append the true position and velocity at the start of a control period. */
static void record_truth(ks *s)
{
    if (s->truth_count == s->truth_capacity) {
        const uint64_t capacity = s->truth_capacity == 0 ? 65536 : 2 * s->truth_capacity;
        struct ks_truth *more = realloc(s->truth, capacity * sizeof *more);
        if (more == NULL) {
            s->recording = 0;
            return;
        }
        s->truth = more;
        s->truth_capacity = capacity;
    }
    struct ks_truth *row = &s->truth[s->truth_count++];
    const struct servo_loop *loop = &s->device.drive.loop;
    plant_tool(&s->plant, row->pos_m);
    for (int i = 0; i < 2; i++) {
        if (servo_loop_simulated(loop)) {
            row->pos_m[i] =
                (double)loop->onchip.plant.axis[i].part[ONCHIP_TABLE].pos * 0x1p-32 * s->plant.machine.encoder_m[i];
            row->vel_mps[i] = /* um/T0 */
                (double)n_to_q32(loop->onchip.plant.axis[i].part[ONCHIP_TABLE].vel) * 0x1p-32 * 2e-4;
            continue;
        }
        row->vel_mps[i] = s->plant.vel_mps[i];
    }
}

/* One control period: the servo tick, the background loop, and then the movement of the plant. */
static void period(ks *s)
{
    if (s->recording) {
        record_truth(s);
    }
    device_tick(&s->device);
    s->tick++;
    device_poll(&s->device);
    s->plant.cutting = s->device.od.stream.state == STREAM_RUNNING;
    if (s->plant_step == NULL) {
        plant_step(&s->plant, s->force_N);
    } else {
        double pos_m[2] = {s->plant.pos_m[0], s->plant.pos_m[1]};
        s->plant_step(s->plant_ctx, s->force_N, pos_m);
        plant_follow(&s->plant, pos_m);
    }
    if (s->recording) {
        struct ks_truth *row = &s->truth[s->truth_count - 1];
        memcpy(row->force_N, s->force_N, sizeof row->force_N);
        memcpy(row->friction_N, s->plant.friction_N, sizeof row->friction_N);
        row->digital = s->digital;
        row->power = s->power / 65535.0;
        for (int i = 0; servo_loop_simulated(&s->device.drive.loop) && i < 2; i++) {
            row->force_N[i] = (double)n_to_q32(s->device.drive.loop.onchip.plant.axis[i].demand[0]) * 0x1p-32;
            row->friction_N[i] = 0.0; /* this model does not output its friction */
        }
    }
}

uint32_t ks_step(ks *s, uint32_t periods)
{
    uint32_t n = 0;
    while (n < periods && s->to_host.count == 0) {
        period(s);
        n++;
    }
    return n;
}

void ks_run(ks *s, uint32_t periods)
{
    for (uint32_t n = 0; n < periods; n++) {
        period(s);
    }
}

uint64_t ks_tick(const ks *s)
{
    return s->tick;
}

uint32_t ks_control_hz(const ks *s)
{
    (void)s;
    return CONTROL_HZ;
}

uint32_t ks_overflows(const ks *s)
{
    return s->overflows;
}

const char *ks_build(const ks *s)
{
    return s->device.od.build_id;
}

const char *ks_num(const ks *s)
{
    return s->device.od.num_backend;
}

void ks_set_can_status(ks *s, const struct ks_can_status *status)
{
    s->can = (struct hal_can_status){.state = (enum hal_can_state)status->state,
                                     .tx_errors = (uint8_t)status->tx_errors,
                                     .rx_errors = (uint8_t)status->rx_errors,
                                     .rx_lost = status->rx_lost,
                                     .bus_offs = status->bus_offs};
}

const void *ks_flash(const ks *s, uint32_t *bytes)
{
    *bytes = sizeof s->flash.word;
    return s->flash.word;
}

uint32_t ks_flash_operations(const ks *s)
{
    return s->flash.operations;
}

void ks_on_flash(ks *s, int (*ready)(void *ctx), void *ctx)
{
    s->flash_ready = ready;
    s->flash_ready_ctx = ctx;
}

void ks_power_on_with(ks *s, const void *flash)
{
    memcpy(s->flash.word, flash, sizeof s->flash.word);
    s->to_host.count = 0;
    wiring_init(&s->wiring);
    device_init(&s->device, &s->hal, &s->ring, s->node_id);
}

void ks_set_entropy(ks *s, uint32_t noise)
{
    s->entropy = noise;
}

void ks_set_paced(ks *s, int by_sync)
{
    s->device.od.clock.pace = by_sync != 0;
}

uint32_t ks_sync_id(const ks *s)
{
    return s->device.od.sync_cob_id & 0x7FFu;
}

uint32_t ks_sync_us(const ks *s)
{
    return device_sync_us(&s->device);
}

void ks_start_schedule(ks *s)
{
    s->plant.schedule_start = s->plant.period;
}

void ks_set_plant(ks *s, void (*step)(void *ctx, const double *force_N, double *pos_m), void *ctx)
{
    s->plant_step = step;
    s->plant_ctx = ctx;
}

void ks_record(ks *s, int on)
{
    s->recording = on;
    if (on) {
        s->truth_count = 0;
    }
}

uint64_t ks_record_count(const ks *s)
{
    return s->truth_count;
}

const struct ks_truth *ks_record_data(const ks *s)
{
    return s->truth;
}

uint32_t ks_push_knots(ks *s, const int32_t *xy_nm, uint32_t count)
{
    for (size_t i = 0; i < count; i++) {
        const struct knot knot = {{xy_nm[2 * i], xy_nm[2 * i + 1]}};
        if (path_push(&s->device.drive.path, knot) != QUEUE_ACCEPTED) {
            return (uint32_t)i;
        }
    }
    return count;
}

int ks_estimate(const int32_t *xy_nm, uint32_t knots, int newton, uint32_t lag_max_ms, uint32_t count,
                const double *path_s, const double *position_m, double *e_n_m)
{
    if (knots == 0 || knots > SPLINE_RING || lag_max_ms == 0 || lag_max_ms > 1000) {
        return -1;
    }
    struct spline_ring ring = {.start = {{xy_nm[0], xy_nm[1]}}};
    for (size_t i = 0; i < knots; i++) {
        ring.knot[i] = (struct knot){{xy_nm[2 * i], xy_nm[2 * i + 1]}};
    }
    struct od_data od;
    od_init(&od, 1);
    struct contour_cfg cfg = configuration_servo(&od).contour;
    cfg.newton = newton != 0;
    cfg.lag_max = n_ratio(lag_max_ms, 5);
    for (size_t i = 0; i < count; i++) {
        struct path_state path = {.rate = NUM(1), .rate_dot = NUM(0), .count = knots};
        path_set(&path, llround(path_s[i] * 1e3 * (double)PATH_ONE));
        pos_t q[2];
        for (int k = 0; k < 2; k++) {
            q[k] = llround(position_m[2 * i + (size_t)k] * 1e9 * POS_PER_NM);
        }
        struct spline_cache cache = {0};
        struct contour_out out;
        contour_step(&cfg, &cache, &ring, &path, q, v2(NUM(0), NUM(0)), &out);
        e_n_m[2 * i] = (double)n_to_q32(out.e_n.x) * 1e-6 / 4294967296.0;
        e_n_m[2 * i + 1] = (double)n_to_q32(out.e_n.y) * 1e-6 / 4294967296.0;
    }
    return 0;
}

/* ---- the law without a drive ---- */

/* The servo tick between two encoders, which a caller sets, and forces that act on nothing. */
struct bench {
    struct od_data od;
    struct servo_loop loop;
    struct spline_ring ring;
    struct hal hal;
    int32_t count[2]; /* of the first and the second encoders */
};

static void bench_read(void *ctx, struct hal_drive_in *in)
{
    const struct bench *b = ctx;
    *in = (struct hal_drive_in){.count = {b->count[0], b->count[0]}, .second = {b->count[1], b->count[1]}};
}

static void bench_write(void *ctx, const struct hal_drive_out *out)
{
    (void)ctx;
    (void)out; /* whole mN: the tick's state has the force itself */
}

static bool set_object(struct od_data *od, uint32_t address, int64_t value)
{
    uint32_t abort;
    const struct od_entry *entry = od_find((uint16_t)(address >> 8), (uint8_t)address, &abort);
    if (address > 0xFFFFFFu || entry == NULL || (entry->flags & OD_WRITE) == 0 || od_size(entry) == 0 ||
        od_check(entry, value) != SDO_OK) {
        return false;
    }
    od_write(od, entry, value);
    return true;
}

static void respond(struct bench *b, uint32_t controller, bool second, int32_t counts, uint32_t periods,
                    double *force_N)
{
    b->hal = (struct hal){.ctx = b, .drive_read = bench_read, .drive_write = bench_write};
    servo_loop_init(&b->loop, &b->hal, &b->ring);
    configuration_servo_loop(&b->od, &b->loop.cfg[0]);
    b->loop.command.controller = (uint8_t)controller;
    for (unsigned k = 0; k < SERVO_SLOTS; k++) { /* the axes take turns to find what cancels their cogging */
        servo_loop_tick(&b->loop);
    }
    b->loop.command.powered[0] = b->loop.command.powered[1] = SERVO_LOOP_ON;
    for (int k = 0; k < 16; k++) { /* until all parts have begun */
        servo_loop_tick(&b->loop);
    }
    const vec2 at_rest = b->loop.servo.force; /* it holds against cogging */
    b->count[second] = counts;
    for (size_t k = 0; k < periods; k++) {
        servo_loop_tick(&b->loop);
        b->count[second] = 0;
        const vec2 change = v2_sub(b->loop.servo.force, at_rest);
        force_N[2 * k] = (double)n_to_q32(change.x) * 0x1p-32;
        force_N[2 * k + 1] = (double)n_to_q32(change.y) * 0x1p-32;
    }
}

int ks_response(uint32_t count, const uint32_t *address, const int64_t *value, uint32_t controller, int second,
                int32_t counts, uint32_t periods, double *force_N)
{
    struct bench *b = controller < CONTROLLERS ? calloc(1, sizeof *b) : NULL;
    if (b == NULL) {
        return -1;
    }
    od_init(&b->od, 1);
    bool good = true;
    for (uint32_t i = 0; i < count; i++) {
        good = good && set_object(&b->od, address[i], value[i]);
    }
    good = good && configuration_fits(&b->od);
    if (good) {
        respond(b, controller, second != 0, counts, periods, force_N);
    }
    free(b);
    return good ? 0 : -1;
}
