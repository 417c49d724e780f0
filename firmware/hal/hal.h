/* SPDX-License-Identifier: Apache-2.0 */
/* hal.h: what a machine, real or simulated, offers the firmware.
 *
 * A port fills one `const struct hal`; every function gets `ctx` back as first argument. Nothing here
 * blocks. Called from the servo interrupt: drive.read, drive.write. From the background loop: the rest.
 */
#ifndef KONTUR_HAL_H
#define KONTUR_HAL_H
#include <stdbool.h>
#include <stdint.h>

enum { AXIS_X = 0, AXIS_Y = 1, AXES = 2 };

/* One classic CAN frame with an 11-bit identifier. */
struct can_frame {
    uint16_t id;      /* 0..7FFh */
    uint8_t len;      /* 0..8 */
    bool rtr;
    uint8_t data[8];
};

struct hal_drive_in {
    int32_t count[AXES];   /* encoder position in counts since power-on; wraps as int32 does */
    bool fault[AXES];      /* the amplifier reports a fault, or the encoder an illegal transition */
};

struct hal_drive_out {
    int32_t force_mN[AXES]; /* to be applied in the next control period; within the axis's force limit */
    bool enable[AXES];      /* power stage on */
};

struct hal {
    void *ctx;
    /* Sample both encoders at one instant and the fault inputs. */
    void (*drive_read)(void *ctx, struct hal_drive_in *in);
    /* Put out both forces at one instant. */
    void (*drive_write)(void *ctx, const struct hal_drive_out *out);
    /* Queue a frame for sending. false: no room; the frame is dropped, the caller may try again. */
    bool (*can_send)(void *ctx, const struct can_frame *frame);
    /* Take the oldest frame received. false: there is none. */
    bool (*can_receive)(void *ctx, struct can_frame *frame);
};
#endif
