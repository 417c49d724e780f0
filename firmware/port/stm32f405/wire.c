/* SPDX-License-Identifier: Apache-2.0 */
#include "port/stm32f405/wire.h"

#include "port/slcan.h"
#include "port/stm32f405/can.h"
#include "port/stm32f405/uart.h"

static struct slcan serial;

void wire_init(void)
{
    slcan_init(&serial, 1);
    uart_init();
}

/* The next frame out of the bytes that have come. */
static bool receive_serial(struct can_frame *frame)
{
    char byte;
    while (uart_get(&byte)) {
        struct slcan_answer answer;
        const enum slcan_event event = slcan_take(&serial, byte, frame, &answer);
        (void)uart_put(answer.text, answer.count);
        if (event == SLCAN_HAS_FRAME) {
            return true;
        }
    }
    return false;
}

bool wire_receive(struct can_frame *frame)
{
    if (receive_serial(frame)) {
        return true;
    }
    struct can_frame other;
    struct can_frame *to =
        serial.open ? &other : frame; /* taken and dropped: its ring must not fill with what is old */
    return can_receive(to) && !serial.open;
}

bool wire_send(const struct can_frame *frame)
{
    if (!serial.open) {
        return can_send(frame);
    }
    char line[SLCAN_FRAME];
    const unsigned count = slcan_line(&serial, frame, 0, line);
    return uart_put(line, count);
}

void wire_status(struct hal_can_status *status)
{
    can_status(status);
    if (serial.open) {
        *status = (struct hal_can_status){
            .state = HAL_CAN_ACTIVE, .rx_lost = uart_lost() + serial.refused, .bus_offs = status->bus_offs};
    }
}
