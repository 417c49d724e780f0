/* SPDX-License-Identifier: Apache-2.0 */
/* kontur_sim.h: the firmware and a simulated machine as one object, for any host language.
 *
 * One `ks` is one drive: the firmware of `firmware/` (core, drive, CANopen) wired to the plant of
 * `plant.h` through the HAL that a board fills. It has no thread, socket or clock of its own: time
 * passes in ks_step() only, one control period a step, so a run is a function of machine, seed and
 * the frames sent. Several may live side by side. Nothing here is thread safe.
 *
 * The lines between CDEF-BEGIN and CDEF-END are plain C declarations that cffi reads as they are.
 */
#ifndef KONTUR_SIM_H
#define KONTUR_SIM_H
#include <stdint.h>

/* CDEF-BEGIN */
/* A machine, SI units; index 0 is x, 1 is y. `friction_scale` is eq (32): from time_s[i] on, the
 * Coulomb friction is scale[i] times coulomb_N; it starts anew every repeat_s (0: never). */
struct ks_machine {
    double mass_kg[2];
    double viscous_Nspm[2];
    double coulomb_N[2];
    double breakaway[2];    /* breakaway force over Coulomb force, >= 1 */
    double stribeck_mps[2]; /* Stribeck velocity; used where breakaway > 1, > 0 */
    double force_limit_N[2];
    double force_noise_N[2]; /* standard deviation, one Gaussian draw a control period */
    double current_lag_s[2]; /* first-order lag of the force loop; 0: none */
    double encoder_m[2];     /* length of one encoder count */
    double travel_min_m[2];
    double travel_max_m[2]; /* mechanical end stops */
    double switch_m[2];     /* limit switches: active so near an end stop; 0: none */
    double index_m[2];      /* distance from index pulse to index pulse, one at 0; 0: none */
    double start_m[2];      /* position at power-on */
    int32_t delay_periods;  /* control periods from encoder reading to force, 1..4 */
    int32_t substeps;       /* integration steps a control period, >= 10 */
    int32_t schedule_count; /* used rows of the schedule, 0..16 */
    double schedule_time_s[16];
    double schedule_scale[16];
    double schedule_repeat_s;
};

/* One classic CAN frame; id with 11 bits. tick: control period at which the device sent it. */
struct ks_frame {
    uint32_t id;
    uint8_t len;
    uint8_t rtr;
    uint8_t data[8];
    uint64_t tick;
};

/* One row of the truth, taken each control period: what no encoder sees. */
struct ks_truth {
    double pos_m[2]; /* true position at the instant the encoders are read */
    double vel_mps[2];
    double force_N[2];    /* force the firmware asked for in this period, before delay and noise */
    double friction_N[2]; /* friction force that acted */
};

/* What the CAN controller tells the firmware of itself. */
enum { KS_CAN_ACTIVE, KS_CAN_WARNING, KS_CAN_PASSIVE, KS_CAN_OFF };
struct ks_can_status {
    uint32_t state;                /* KS_CAN_... */
    uint32_t tx_errors, rx_errors; /* its error counters, 0..255 */
    uint32_t rx_lost;              /* frames received for which there was no room, since power-on */
    uint32_t bus_offs;             /* since power-on */
};

typedef struct ks ks;

/* Power on a drive with node_id (1..31). NULL: no memory, or a machine out of range (ks_check). */
ks *ks_new(const struct ks_machine *machine, uint64_t seed, uint8_t node_id);
void ks_free(ks *s);
/* NULL when the machine is usable, else the name of the first field that is not. */
const char *ks_check(const struct ks_machine *machine);

/* Give the device one frame; it is handled (and answered) before this returns. 0, or -1: bad frame. */
int ks_send(ks *s, uint32_t id, uint8_t rtr, uint8_t len, const uint8_t *data);
/* Take the oldest frame the device has sent. 1: *out is filled; 0: there is none. */
int ks_recv(ks *s, struct ks_frame *out);
/* Let at most `periods` control periods pass; ends earlier, after a whole period, as soon as a frame
 * waits for ks_recv(). Returns the periods that passed (0 when a frame was waiting already). */
uint32_t ks_step(ks *s, uint32_t periods);
/* The same, whether or not frames wait. */
void ks_run(ks *s, uint32_t periods);

uint64_t ks_tick(const ks *s); /* control periods since power-on */
uint32_t ks_control_hz(const ks *s);
uint32_t ks_overflows(const ks *s); /* frames lost because nobody took them */
const char *ks_build(const ks *s);  /* firmware build id */
const char *ks_num(const ks *s);    /* numeric back end: "f32", "fix" or "chk" */

/* What the CAN controller tells from now on; at power-on it is error active, and nothing was lost. */
void ks_set_can_status(ks *s, const struct ks_can_status *status);

/* The flash that parameters are stored in (1010h): `*bytes` at the address returned. */
const void *ks_flash(const ks *s, uint32_t *bytes);
/* Put other contents, as many bytes, into the flash and power on with them. For a drive that has not been used yet. */
void ks_power_on_with(ks *s, const void *flash);

/* Tell in 2020h:4 that time passes with SYNC; letting it do so is the caller's. */
void ks_set_paced(ks *s, int by_sync);
/* Identifier of SYNC (1005h), and the time between two in us (1006h). */
uint32_t ks_sync_id(const ks *s);
uint32_t ks_sync_us(const ks *s);

/* Start the friction schedule now. */
void ks_start_schedule(ks *s);
/* Take the truth of each period from now on into memory of this object (0: stop). */
void ks_record(ks *s, int on);
uint64_t ks_record_count(const ks *s);
/* `ks_record_count` rows, valid until the next call that lets time pass, records anew or frees. */
const struct ks_truth *ks_record_data(const ks *s);

/* Hand knots to the queue without the wire, as the knot frame would (benchmark of the direct loop).
 * xy_nm: count absolute pairs. Returns how many were taken. */
uint32_t ks_push_knots(ks *s, const int32_t *xy_nm, uint32_t count);

/* What the firmware estimates of the contour error, (3)-(9), with default parameters but for `newton` and `lag_max_ms`
 * (1..1000); no drive is needed and no time passes. xy_nm: `knots` (1..1024) absolute pairs, one a ms, the path. For each
 * of `count` rows the reference is at path time path_s[i] and the axes are at position_m[2 i], [2 i + 1]; e_n1 (along
 * the path) and e_n2 (its normal: the contour error) go to e_n_m[2 i], [2 i + 1]. 0, or -1: knots or lag_max_ms out of
 * range. */
int ks_estimate(const int32_t *xy_nm, uint32_t knots, int newton, uint32_t lag_max_ms, uint32_t count,
                const double *path_s, const double *position_m, double *e_n_m);
/* CDEF-END */
#endif
