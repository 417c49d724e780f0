/* SPDX-License-Identifier: Apache-2.0 */
/* wiring.h: what stands between the HAL and the simulated plant: the wiring of 2104h and 210Ah, as the board's port applies it
 * (port/stm32f405/encoder.c, output.c).
 *
 * The plant itself is wired right, so an inverted encoder or force is wrong here, and both together are a drive whose
 * positive direction is the other one. Not simulated: `output` and `full_scale`. The simulated amplifier takes a force.
 *
 * Context: a host process; the HAL of libkontur.c and of tests calls it.
 */
#ifndef KONTUR_WIRING_H
#define KONTUR_WIRING_H
#include "hal/hal.h"

struct wiring {
    struct wiring_axis {
        bool invert_force, invert_encoder, invert_second;
        uint32_t index_counts;
        bool index_seen; /* index_count belongs to a pulse since the last wiring_configure() */
        uint8_t index_pulses;
        int32_t index_count;
        int32_t last; /* the plant's count at the last read */
        uint32_t count;
        int32_t last_second; /* the same of the second encoder */
        uint32_t second;
    } axis[AXES];
};

/* Power on; a struct that is zero has been, too. The first count read is that of the plant. */
void wiring_init(struct wiring *w);
/* The HAL's drive_configure. A count goes on from where it is. */
void wiring_configure(struct wiring *w, const struct hal_axis_cfg cfg[AXES]);
/* Turn what the plant reads into what the HAL reads. HAL_ENCODER_FAULT: two index pulses are no multiple of index_counts
 * apart. */
void wiring_read(struct wiring *w, struct hal_drive_in *in);
/* The force on the plant, N */
double wiring_force_N(const struct wiring *w, const struct hal_drive_out *out, int axis);
#endif
