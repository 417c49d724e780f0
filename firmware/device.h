/* SPDX-License-Identifier: Apache-2.0 */
/* device.h: the firmware as one object: object dictionary, CANopen node, drive. A port calls
 *   device_init() once, device_tick() in the servo interrupt (CONTROL_HZ), device_poll() in the background loop.
 */
#ifndef KONTUR_DEVICE_H
#define KONTUR_DEVICE_H
#include "canopen/node.h"
#include "drive/drive.h"
#include "od/settings.h"

struct device {
    struct od_data od;
    struct co_node node;
    struct drive drive;
    struct settings settings;
    const struct hal *hal;
    uint32_t ms;            /* snapshots handled */
    uint16_t statusword[2]; /* last sent */
    uint32_t announced;     /* FAULT_BIT()s told by EMCY */
    uint8_t health;         /* enum hal_health_bit, last seen */
};

/* node_id: 1..31, where none is stored. The boot-up message is sent. */
void device_init(struct device *device, const struct hal *hal, uint8_t node_id);
void device_tick(struct device *device);
/* Handle the frames received, and what is due each millisecond. Bounded: one pass over what is there. */
void device_poll(struct device *device);
#endif
