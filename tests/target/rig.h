/* SPDX-License-Identifier: Apache-2.0 */
/* rig.h: the servo tick in closed loop with the simulated machine of onchip/onchip_plant.h, on the knots of a part: no host, no wire. */
#ifndef KONTUR_RIG_H
#define KONTUR_RIG_H
#include "drive/drive.h"

struct rig {
    struct hal hal;
    struct servo_loop loop;
    struct spline_ring ring;
    struct onchip_plant onchip_plant; /* behind the HAL */
    struct onchip_plant_cfg machine_cfg;
    struct hal_drive_out out;
};

/* Default parameters, both axes powered at the first knot, path time runs from the first tick on. */
void rig_init(struct rig *r, enum controller controller);
/* Before a tick: hand over knots as the background does. */
void rig_feed(struct rig *r);
/* After a tick: let the machine move. */
void rig_move(struct rig *r);
#endif
