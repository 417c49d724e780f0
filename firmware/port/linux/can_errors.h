/* SPDX-License-Identifier: Apache-2.0 */
/* can_errors.h: the state of a CAN controller from SocketCAN's error message frames (Linux:
 * include/uapi/linux/can/error.h). socketcan_bus.c calls it in the process kontur-sim. */
#ifndef KONTUR_CAN_ERRORS_H
#define KONTUR_CAN_ERRORS_H
#include <linux/can.h>
#include <stdbool.h>

#include "sim/kontur_sim.h"

/* Update *status from an error frame, whose id has CAN_ERR_FLAG. false: nothing has changed. */
bool can_errors_apply(const struct can_frame *frame, struct ks_can_status *status);
#endif
