/* SPDX-License-Identifier: Apache-2.0 */
/* bus.h: what the loop of the process kontur-sim (main.c) needs of a CAN bus. socketcan_bus.c and slcan_bus.c
 * implement it. None of these functions blocks. */
#ifndef KONTUR_BUS_H
#define KONTUR_BUS_H
#include <poll.h>
#include <stdbool.h>
#include <stdint.h>

#include "sim/kontur_sim.h"

enum { BUS_FDS = 9 };

struct bus {
    void *ctx;
    char name[160]; /* python-can's interface and channel, separated by a space */
    /* Called before each poll(): write pending output, and fill `fds`. Returns how many of BUS_FDS are filled. */
    unsigned (*before_poll)(void *ctx, struct pollfd *fds);
    /* Called after each poll() with its results in `fds`. */
    void (*after_poll)(void *ctx, const struct pollfd *fds, unsigned count);
    /* Take the oldest frame received, at device time `ms`. false: there is none. */
    bool (*receive)(void *ctx, struct ks_frame *frame, uint32_t ms);
    /* Send a frame at device time `ms`, or drop and count it: a bus that nobody reads does not stop the drive. */
    void (*send)(void *ctx, const struct ks_frame *frame, uint32_t ms);
    /* The state of the CAN controller. false: it has not changed since the last call. NULL: there is no controller. */
    bool (*status)(void *ctx, struct ks_can_status *status);
    void (*close)(void *ctx);
};

/* Open a bus. A bus that cannot be opened ends the process with a message that says what to do. */
void bus_open_socketcan(struct bus *bus, const char *interface);
/* `address` is [HOST:]PORT. The default host is 127.0.0.1;
 * port 0 is any free port. Up to BUS_FDS - 1 clients share the bus. */
void bus_open_slcan_tcp(struct bus *bus, const char *address);
void bus_open_slcan_pty(struct bus *bus);
#endif
