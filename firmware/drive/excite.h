/* SPDX-License-Identifier: Apache-2.0 */
/* drive/excite.h: begin and end an excitation of an axis (core/excitation.h), and report what it measures: objects 2150h to
 * 2154h.
 *
 * Context: background. drive.c decides when an axis may be excited; device_objects.c reports. The servo tick does the rest
 * (servo_loop.c). It ends an excitation by itself after its last window, when the axis is not enabled any more, at a fault
 * that stops, and when the force is at its limit.
 */
#ifndef KONTUR_EXCITE_H
#define KONTUR_EXCITE_H
#include "drive/servo_loop.h"
#include "od/od.h"

/* Begin, while none runs: SDO_OK, or SDO_ABORT_INCOMPATIBLE where it would exceed what 2150h and 2151h say. */
uint32_t excite_begin(struct servo_loop *loop, const struct od_data *od);
/* End the one that runs, if any. */
void excite_end(struct servo_loop *loop);
/* Bring the objects up to date. */
void excite_report(const struct servo_loop *loop, struct od_data *od);
#endif
