/* SPDX-License-Identifier: Apache-2.0 */
/* can_errors.c: SocketCAN's error frames, can_errors.h. */
#include "port/linux/can_errors.h"

#include <linux/can/error.h>
#include <string.h>

#ifndef CAN_ERR_CNT /* kernel headers before 5.19 */
#define CAN_ERR_CNT 0x00000200U
#endif

/* The state from the flags of CAN_ERR_CRTL in byte 1, of which the worst counts. No flag leaves the state `now`. */
static uint32_t state_of(uint8_t control, uint32_t now)
{
    if (control & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) {
        return KS_CAN_PASSIVE;
    }
    if (control & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) {
        return KS_CAN_WARNING;
    }
    return (control & CAN_ERR_CRTL_ACTIVE) != 0 ? KS_CAN_ACTIVE : now;
}

bool can_errors_apply(const struct can_frame *frame, struct ks_can_status *status)
{
    const struct ks_can_status before = *status;
    const canid_t what = frame->can_id;
    if (what & CAN_ERR_CRTL) {
        status->state = state_of(frame->data[1], status->state);
        status->rx_lost += (frame->data[1] & CAN_ERR_CRTL_RX_OVERFLOW) != 0;
    }
    if (what & CAN_ERR_CNT) {
        status->tx_errors = frame->data[6];
        status->rx_errors = frame->data[7];
    }
    if (what & CAN_ERR_RESTARTED) {
        status->state = KS_CAN_ACTIVE;
    }
    if ((what & CAN_ERR_BUSOFF) && status->state != KS_CAN_OFF) {
        status->state = KS_CAN_OFF;
        status->bus_offs++;
    }
    return memcmp(&before, status, sizeof before) != 0;
}
