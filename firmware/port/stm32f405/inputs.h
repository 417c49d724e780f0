/* SPDX-License-Identifier: Apache-2.0 */
/* inputs.h: limit switches, amplifier faults and emergency stop. An input becomes active when three reads in a row
 * have seen it so (0.3 ms at 10 kHz), which filters bounce and spikes.
 *
 * Context: inputs_read() in the servo tick, inputs_init() at power-on.
 */
#ifndef KONTUR_INPUTS_H
#define KONTUR_INPUTS_H
#include "hal/hal.h"

/* Configure the pins. */
void inputs_init(void);
/* Add the active inputs of both axes to `inputs`. */
void inputs_read(struct hal_drive_in *in);
#endif
