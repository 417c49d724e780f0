/* SPDX-License-Identifier: Apache-2.0 */
/* drive/configuration.h: from the object dictionary (integers in wire units) to the servo's configuration (core units). */
#ifndef KONTUR_PARAMS_H
#define KONTUR_PARAMS_H
#include "core/servo.h"
#include "hal/hal.h"
#include "od/od.h"
#include "onchip/onchip_plant.h"

/* Whether parameters fit together, each within the dictionary's range: k_bar e_max <= 4, k_0 <= k_max, mu_0 <= mu_max,
 * 607Dh min <= max, and viscous friction of the simulated machine that does not stop it within a control period. */
bool configuration_fits(const struct od_data *od);
/* The configuration that parameters which fit make. */
struct servo_cfg configuration_servo(const struct od_data *od);
struct onchip_plant_cfg configuration_onchip_plant(const struct od_data *od);
#endif
