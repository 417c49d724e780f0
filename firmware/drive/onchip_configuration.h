/* SPDX-License-Identifier: Apache-2.0 */
/* drive/onchip_configuration.h: the machine that the drive simulates by itself (2103h, 210Eh), from the object dictionary.
 *
 * Background only: configuration.c calls it.
 */
#ifndef KONTUR_ONCHIP_CONFIGURATION_H
#define KONTUR_ONCHIP_CONFIGURATION_H
#include <stdbool.h>

#include "od/od.h"
#include "onchip/onchip_plant.h"

/* From values that fit together. */
void onchip_configuration(const struct od_data *od, struct onchip_plant_cfg *c);
/* Whether they do: friction stops no mass sooner than within a control period, travel is not negative, and a lag is none or
 * at least a control period. */
bool onchip_configuration_fits(const struct od_data *od);
#endif
