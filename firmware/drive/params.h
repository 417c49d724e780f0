/* SPDX-License-Identifier: Apache-2.0 */
/* params.h: from the object dictionary (integers in wire units) to the servo's configuration (core units). */
#ifndef KONTUR_PARAMS_H
#define KONTUR_PARAMS_H
#include "od.h"
#include "servo.h"

#define CONTROL_HZ 10000u

/* Builds the configuration of the parameters in od. Ranges are the dictionary's; what they cannot say (two
 * parameters that must fit together) is checked here: false, and *cfg unchanged, when they do not. */
bool params_to_cfg(const struct od_data *od, struct servo_cfg *cfg);
#endif
