/* SPDX-License-Identifier: Apache-2.0 */
/* inputs.h: limit switches, amplifier faults, emergency stop. Each is active once three reads in a row have seen it so
 * (0.3 ms at 10 kHz), which a bounce or a spike on the line is not. Servo interrupt: inputs_read(). */
#ifndef KONTUR_INPUTS_H
#define KONTUR_INPUTS_H
#include "hal/hal.h"

void inputs_init(void);
/* Adds what is active to `inputs`. */
void inputs_read(struct hal_drive_in *in);
#endif
