/* SPDX-License-Identifier: Apache-2.0 */
/* device.h: the firmware as one object: object dictionary, CANopen node, drive.
 *
 * A port calls device_init() once, device_tick() in the servo interrupt (CONTROL_HZ), and device_poll() in the background
 * loop. The two contexts meet in the drive's servo loop only (drive/servo_loop.h).
 */
#ifndef KONTUR_DEVICE_H
#define KONTUR_DEVICE_H
#include "canopen/node.h"
#include "device_objects.h"
#include "drive/drive.h"
#include "od/settings.h"

struct device {
    struct od_data od;
    struct co_node node;
    struct drive drive;
    struct settings settings;
    struct device_objects objects;
    const struct hal *hal;
    uint32_t ms;            /* snapshots handled */
    uint16_t statusword[2]; /* sent last */
    uint32_t announced;     /* FAULT_BIT()s that an EMCY has reported */
    uint8_t health;         /* enum hal_health_bit, last seen */
    bool record_of_x;       /* 60C1h of x has come, and that of y has not */
    uint16_t one_axis_ms;   /* since a master has commanded one axis alone in mode 7 */
};

/* Power-on; sends the boot-up message. *ring: memory of the knots, which may be of another kind than that of *device.
 * node_id: 1..31, in use where none is stored. The caller must not move *device and *ring: parts of it point to each other. */
void device_init(struct device *device, const struct hal *hal, struct spline_ring *ring, uint8_t node_id);
/* One control period: servo_loop_tick(). */
void device_tick(struct device *device);
/* Time that passes at each SYNC where it passes with SYNC alone (2020h:4): 1006h, or 1000 us. */
uint32_t device_sync_us(const struct device *device);
/* Handle the frames that have come and the milliseconds that have passed since the last call. The time is bounded: frames
 * and milliseconds that come meanwhile wait for the next call. */
void device_poll(struct device *device);
#endif
