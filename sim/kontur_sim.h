/* SPDX-License-Identifier: Apache-2.0 */
/* kontur_sim.h: the firmware and a simulated machine as one object, for any host language.
 *
 * One `ks` is one drive: the firmware of `firmware/` wired to the plant of `plant.h` through the HAL that a board
 * fills. It has no thread, socket or clock of its own. Time passes only in ks_step() and ks_run(), one control period
 * a step, so a run is a function of the machine, the seed and the frames sent. Several drives may exist side by side.
 * Nothing here is thread safe.
 *
 * Context: a host process. Python calls it through cffi (kontur.simlib), and so do the process kontur-sim and C tests.
 *
 * The lines between CDEF-BEGIN and CDEF-END are plain C declarations that cffi reads as they are.
 */
#ifndef KONTUR_SIM_H
#define KONTUR_SIM_H
#include <stdint.h>

/* CDEF-BEGIN */
/* A machine in SI units. Index 0 is x, index 1 is y. The schedule is eq (32): from schedule_time_s[i] on, the
 * Coulomb friction is schedule_scale[i] times coulomb_N. It starts again every schedule_repeat_s (0: never). */
struct ks_machine {
    double mass_kg[2];
    double viscous_Nspm[2];
    double coulomb_N[2];
    double breakaway[2];    /* breakaway force over Coulomb force, >= 1 */
    double stribeck_mps[2]; /* Stribeck velocity; used where breakaway > 1, > 0 */
    double force_limit_N[2];
    double force_noise_N[2]; /* standard deviation of the Gaussian force noise, one value for each control period */
    double current_lag_s[2]; /* time constant of the force loop, of first order; 0: no lag */
    double encoder_m[2];     /* length of one encoder count */
    double travel_min_m[2];
    double travel_max_m[2]; /* mechanical end stops */
    double switch_m[2];     /* limit switches are active within this distance of an end stop; 0: there are none */
    double index_m[2];      /* distance between index pulses, one of which is at 0; 0: there are none */
    double start_m[2];      /* position at power-on */
    int32_t delay_periods;  /* control periods from encoder reading to force, 1..4 */
    int32_t substeps;       /* integration steps in a control period, 10..1000 */
    int32_t schedule_count; /* used rows of the schedule, 0..16 */
    double schedule_time_s[16];
    double schedule_scale[16];
    double schedule_repeat_s;
    /* What a real machine has besides. 0: not there. */
    double resonance_Hz[2];           /* first mode of motor and table with both ends free; 0: rigid */
    double resonance_damping[2];      /* its damping ratio */
    double motor_share[2];            /* share of mass_kg at the motor, within 0..1 where there is a mode */
    int32_t encoder_at_table[2];      /* where the encoder is: 0 motor, 1 table */
    int32_t encoder_inverted[2];      /* 1: the encoders count down in the positive direction */
    int32_t force_inverted[2];        /* 1: the force acts against its sign */
    double scale_m[2];                /* length of a count of a second encoder, at the table */
    double backlash_m[2];             /* whole gap between motor and table */
    double presliding_m[2];           /* distance over which friction builds up after a reversal; 0: true stiction */
    double friction_share[2];         /* share of the friction, viscous too, at the table; the rest is at the motor */
    double friction_wave[2];          /* relative change of coulomb_N, as a sine with one wave over the travel, 0..1 */
    double screw_m[2];                /* lead of the screw: the period of what goes by angle */
    double cogging_N[2];              /* limit of the force by position, of three harmonics a turn */
    double ripple[2];                 /* limit of the relative change of force, of three harmonics a turn */
    double encoder_once_m[2];         /* amplitude of the encoder's error once a turn */
    double interpolation_m[2];        /* amplitude of the encoder's error within a signal period */
    double interpolation_period_m[2]; /* signal period */
    double force_bits[2];             /* resolution of +-force_limit_N in bits, a whole number */
    double continuous_force_N[2];     /* force that the amplifier limits to when its mean square exceeds it */
    double thermal_s[2];              /* time constant of that mean */
    double lead_error[2];             /* error of the screw, m per m of travel */
    double lead_once_m[2];            /* amplitude of the screw's error once a turn */
    double squareness_rad[2];         /* the other axis moves by this share of this one's travel; no sensor sees it */
    double crosstalk_s2[2];           /* the other axis moves by this times this one's acceleration; likewise */
    double cutting_force_N[2];        /* amplitude of a force on the table while the path runs */
    double cutting_Hz[2];             /* its frequency; 0: constant */
};

/* One classic CAN frame. `id` has 11 bits. `tick` is the control period in which the device sent it. */
struct ks_frame {
    uint32_t id;
    uint8_t len;
    uint8_t rtr;
    uint8_t data[8];
    uint64_t tick;
};

/* The true motion and forces in a control period, which no encoder measures. */
struct ks_truth {
    double pos_m[2]; /* true position at the instant the encoders are read */
    double vel_mps[2];
    double force_N[2];    /* force demand of the firmware in this period, before delay and noise */
    double friction_N[2]; /* friction force that acted */
    double digital;       /* the outputs beside the axes, 0..4095, in this period */
    double power;         /* 0..1 */
};

/* The state of the CAN controller, as the firmware sees it. */
enum { KS_CAN_ACTIVE, KS_CAN_WARNING, KS_CAN_PASSIVE, KS_CAN_OFF };
struct ks_can_status {
    uint32_t state;                /* KS_CAN_... */
    uint32_t tx_errors, rx_errors; /* its error counters, 0..255 */
    uint32_t rx_lost;              /* frames lost because there was no room for them, since power-on */
    uint32_t bus_offs;             /* since power-on */
};

typedef struct ks ks;

/* Power on a drive with node_id (1..31). NULL: there is no
 * memory, or node_id or the machine is out of range (ks_check()). */
ks *ks_new(const struct ks_machine *machine, uint64_t seed, uint8_t node_id);
void ks_free(ks *s);
/* NULL when the machine is usable, else the name of the first field that is out of range. */
const char *ks_check(const struct ks_machine *machine);

/* Give the device one frame, which it handles and answers
 * before this returns. Returns 0, or -1 for an invalid frame. */
int ks_send(ks *s, uint32_t id, uint8_t rtr, uint8_t len, const uint8_t *data);
/* Take the oldest frame that the device has sent. Returns 1 with *out filled, or 0 when there is none. */
int ks_recv(ks *s, struct ks_frame *out);
/* Let up to `periods` control periods pass. It ends after the period in which the device sends a frame for ks_recv().
 * Returns the number of periods that have passed, which is 0 when a frame was waiting before. */
uint32_t ks_step(ks *s, uint32_t periods);
/* Let `periods` control periods pass, whether or not frames wait. */
void ks_run(ks *s, uint32_t periods);

uint64_t ks_tick(const ks *s); /* control periods since power-on */
uint32_t ks_control_hz(const ks *s);
uint32_t ks_overflows(const ks *s); /* frames lost because ks_recv() was not called in time */
const char *ks_build(const ks *s);  /* firmware build id */
const char *ks_num(const ks *s);    /* numeric back end: "f32", "fix" or "chk" */

/* Set the state of the CAN controller. At power-on it is error active, and no frame is lost. */
void ks_set_can_status(ks *s, const struct ks_can_status *status);

/* The flash in which the drive stores parameters (1010h): `*bytes` bytes at the address returned. */
const void *ks_flash(const ks *s, uint32_t *bytes);
/* Number of words written to the flash and of sectors erased, so far. */
uint32_t ks_flash_operations(const ks *s);
/* Call `ready` with `ctx` before each change of the flash. 0: the change fails, like one of a flash that is broken. */
void ks_on_flash(ks *s, int (*ready)(void *ctx), void *ctx);
/* Set the contents of the flash, as many bytes, and power on with them. Call it for a new drive only. */
void ks_power_on_with(ks *s, const void *flash);

/* Set 2020h:4, by which the drive reports that its time passes
 * with SYNC. The caller then lets time pass after each SYNC. */
void ks_set_paced(ks *s, int by_sync);
/* Set what tickets (2140h:3) are drawn with, so that they are no other run's. Without it each run draws the same ones. */
void ks_set_entropy(ks *s, uint32_t noise);
/* Identifier of SYNC (1005h), and its period in us (1006h). */
uint32_t ks_sync_id(const ks *s);
uint32_t ks_sync_us(const ks *s);

/* Let `step` be the machine from now on, in place of the one of ks_new(). It is called with `ctx` once a control period:
 * from the force demand of the firmware it makes the true positions at the end of the period. pos_m holds those before.
 * Encoders, switches and index pulses stay those of ks_new(). */
void ks_set_plant(ks *s, void (*step)(void *ctx, const double *force_N, double *pos_m), void *ctx);

/* Start the friction schedule at the present time. */
void ks_start_schedule(ks *s);
/* Record a struct ks_truth in each period from now on, in memory of this object. 0 ends the recording. */
void ks_record(ks *s, int on);
/* Number of periods recorded. */
uint64_t ks_record_count(const ks *s);
/* The periods recorded. They are valid until the next ks_step(), ks_run(), ks_record() or ks_free(). */
const struct ks_truth *ks_record_data(const ks *s);

/* Give knots to the queue without CAN frames (for a benchmark of the direct loop). xy_nm has `count` absolute
 * pairs. Returns the number of knots accepted. */
uint32_t ks_push_knots(ks *s, const int32_t *xy_nm, uint32_t count);

/* The contour error as the firmware estimates it, (3)-(9), with default parameters except `newton` and
 * `lag_max_ms` (1..1000). It needs no drive, and no time passes. The path is xy_nm, `knots` (1..1024) absolute
 * pairs, one for each millisecond. In each of `count` rows the reference is at path time path_s[i] and the axes
 * are at position_m[2 i] and [2 i + 1]; e_n1 (along the path) and e_n2 (along its normal, the contour error) are
 * written to e_n_m[2 i] and [2 i + 1]. Returns 0, or -1 when knots or lag_max_ms is out of range. */
int ks_estimate(const int32_t *xy_nm, uint32_t knots, int newton, uint32_t lag_max_ms, uint32_t count,
                const double *path_s, const double *position_m, double *e_n_m);

/* The law as a linear system: what the servo tick of a drive at rest, with power on, makes of encoders that show
 * `counts` in one control period, both at once, and 0 before and after it; with `second` it is the second encoders that
 * do. It needs no drive. Parameters are the defaults but for `count` objects: address[i] is index << 8 | sub-index,
 * value[i] in units of the wire. force_N[2 k] and [2 k + 1] are the changes of the forces of x and y in the k-th of
 * `periods` periods from that one on. Along x is along the path, and y is normal to it, since a path at rest lies along
 * x. Returns 0, or -1: an object that is no number or out of range, parameters that do not fit together, an unknown
 * controller, no memory. */
int ks_response(uint32_t count, const uint32_t *address, const int64_t *value, uint32_t controller, int second,
                int32_t counts, uint32_t periods, double *force_N);
/* CDEF-END */
#endif
