/* SPDX-License-Identifier: Apache-2.0 */
/* rig.h: the servo tick in closed loop with the simulated machine of onchip/onchip_plant.h, on the knots of a part,
 * without host or bus. The programs of this folder call it.
 */
#ifndef KONTUR_RIG_H
#define KONTUR_RIG_H
#include "drive/drive.h"

struct rig {
    struct hal hal;
    struct servo_loop loop;
    struct spline_ring ring;
    struct onchip_plant onchip_plant; /* the machine behind the HAL */
    struct onchip_plant_cfg onchip_plant_cfg;
    struct hal_drive_in in; /* what it shows to the next tick */
    struct hal_drive_out out;
};

/* Start with default parameters and both axes enabled at the first knot. Path time runs from the first tick on.
 * `compensated`: with every compensation on, and as much of each as a machine may have. */
void rig_init(struct rig *r, enum controller controller, bool compensated);
/* Before a tick: append knots to the ring, as the background loop does. */
void rig_feed(struct rig *r);
/* After a tick: let the machine move. */
void rig_move(struct rig *r);
#endif
