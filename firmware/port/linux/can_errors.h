/* SPDX-License-Identifier: Apache-2.0 */
/* can_errors.h: SocketCAN's error message frames (Linux: include/uapi/linux/can/error.h) as the state of a CAN
 * controller. */
#ifndef KONTUR_CAN_ERRORS_H
#define KONTUR_CAN_ERRORS_H
#include <linux/can.h>
#include <stdbool.h>

#include "sim/kontur_sim.h"

/* Bring *status up to date by an error frame (its id has CAN_ERR_FLAG). false: nothing changed. */
bool can_errors_apply(const struct can_frame *frame, struct ks_can_status *status);
#endif
