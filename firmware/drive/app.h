/* SPDX-License-Identifier: Apache-2.0 */
/* app.h: the firmware as one object: object dictionary, CANopen node, drive. A port calls
 *   app_init() once, app_tick() in the servo interrupt (CONTROL_HZ), app_poll() in the background loop.
 */
#ifndef KONTUR_APP_H
#define KONTUR_APP_H
#include "drive.h"
#include "node.h"
#include "settings.h"

struct app {
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
void app_init(struct app *app, const struct hal *hal, uint8_t node_id);
void app_tick(struct app *app);
/* Handle the frames received, and what is due each millisecond. Bounded: one pass over what is there. */
void app_poll(struct app *app);
#endif
