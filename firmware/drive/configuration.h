/* SPDX-License-Identifier: Apache-2.0 */
/* drive/configuration.h: from the object dictionary (integers in wire units) to the configuration of the servo tick (core
 * units) and of the machine.
 *
 * Context: background. drive.c calls it when parameters have changed, and device.c before one is written. All functions
 * are pure.
 */
#ifndef KONTUR_CONFIGURATION_H
#define KONTUR_CONFIGURATION_H
#include "drive/servo_loop.h"
#include "hal/hal.h"
#include "od/od.h"

/* Whether parameters, each of which is within the dictionary's range, fit together: k_bar e_max <= 4, k_0 <= k_max, mu_0 <= mu_max,
 * 607Dh min <= max, the plant on the chip (onchip_configuration.h), force filters (force_filter_design()), a continuous force of 0 or at least 1 / FORCE_LIMIT_RATIO of the force limit, and a map
 * of the screw that has not just 1 point and changes by at most half a step from each to the next (it is monotonic). */
bool configuration_fits(const struct od_data *od);
/* Compute a configuration from parameters that fit together: of the law, of the servo tick (which contains that and the
 * plant on the chip), and of the machine's wiring. */
struct servo_cfg configuration_servo(const struct od_data *od);
void configuration_servo_loop(const struct od_data *od, struct servo_loop_cfg *c);
/* Change what may change while the configuration is in use (servo_loop.h). */
void configuration_live(const struct od_data *od, struct servo_loop_cfg *c);
/* Of an excitation. Returns false where it would exceed what 2150h and 2151h say. */
bool configuration_excitation(const struct od_data *od, struct excitation_cfg *c);
void configuration_hal(const struct od_data *od, struct hal_axis_cfg cfg[AXES]);
#endif
