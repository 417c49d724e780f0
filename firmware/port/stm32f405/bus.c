/* SPDX-License-Identifier: Apache-2.0 */
/* bus.c: CAN or slcan as the bus of the node, bus.h. */
#include "port/stm32f405/bus.h"

#include "port/slcan.h"
#include "port/stm32f405/can.h"
#include "port/stm32f405/uart.h"

static struct slcan serial;

void bus_init(void)
{
    slcan_init(&serial, 1);
    uart_init();
}

/* The next frame in the bytes received. */
static bool receive_serial(struct can_frame *frame)
{
    char byte;
    while (uart_get(&byte)) {
        struct slcan_answer answer;
        const enum slcan_event event = slcan_parse(&serial, byte, frame, &answer);
        (void)uart_put(answer.text, answer.count);
        if (event == SLCAN_HAS_FRAME) {
            return true;
        }
    }
    return false;
}

bool bus_receive(struct can_frame *frame)
{
    if (receive_serial(frame)) {
        return true;
    }
    struct can_frame discarded; /* while the serial channel is open, CAN's ring must not fill with old frames */
    struct can_frame *to = serial.open ? &discarded : frame;
    return can_receive(to) && !serial.open;
}

bool bus_send(const struct can_frame *frame)
{
    if (!serial.open) {
        return can_send(frame);
    }
    char line[SLCAN_FRAME];
    const unsigned count = slcan_format(&serial, frame, 0, line);
    return uart_put(line, count);
}

void bus_status(struct hal_can_status *status)
{
    can_status(status);
    if (serial.open) {
        *status = (struct hal_can_status){
            .state = HAL_CAN_ACTIVE, .rx_lost = uart_lost() + serial.refused, .bus_offs = status->bus_offs};
    }
}
