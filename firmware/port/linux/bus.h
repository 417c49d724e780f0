/* SPDX-License-Identifier: Apache-2.0 */
/* bus.h: what the process's main loop asks of a bus. Nothing here blocks. */
#ifndef KONTUR_BUS_H
#define KONTUR_BUS_H
#include <poll.h>
#include <stdbool.h>
#include <stdint.h>

#include "sim/kontur_sim.h"

enum { BUS_FDS = 2 };

struct bus {
    void *ctx;
    char name[160]; /* python-can's interface and channel, with a space between */
    /* Write what waits and fill `fds` with what to wait for; returns how many of BUS_FDS. Called before each poll(). */
    unsigned (*watch)(void *ctx, struct pollfd *fds);
    /* After poll(): fds as it left them. */
    void (*ready)(void *ctx, const struct pollfd *fds, unsigned count);
    /* Take the oldest frame received. false: there is none now. */
    bool (*receive)(void *ctx, struct ks_frame *frame);
    /* Send a frame, or drop and count it: a bus that nobody reads does not stop the drive. ms: device time. */
    void (*send)(void *ctx, const struct ks_frame *frame, uint32_t ms);
    /* State of the CAN controller; false: as at the last call. NULL: there is no controller. */
    bool (*status)(void *ctx, struct ks_can_status *status);
    void (*close)(void *ctx);
};

/* Each ends the program with a message that tells how to mend it when it cannot be opened. */
void bus_open_socketcan(struct bus *bus, const char *interface);
/* [HOST:]PORT; without a host 127.0.0.1, port 0: any that is free. One client at a time. */
void bus_open_slcan_tcp(struct bus *bus, const char *address);
void bus_open_slcan_pty(struct bus *bus);
#endif
