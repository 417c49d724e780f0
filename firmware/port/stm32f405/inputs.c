/* SPDX-License-Identifier: Apache-2.0 */
/* inputs.c: the digital inputs, inputs.h. */
#include "port/stm32f405/inputs.h"

#include "port/stm32f405/board.h"

static const struct board_axis axes[AXES] = {BOARD_X, BOARD_Y};
static const struct board_input stop = BOARD_STOP;
static uint8_t previous[AXES][2]; /* inputs of the last read and of the one before */

static void setup(const struct board_input *input)
{
    pin_setup(input->pin, PIN_INPUT, (enum pin_pull)input->pull, 0);
}

static unsigned active(const struct board_input *input, unsigned bit)
{
    return input->pin != PIN_NONE && pin_read(input->pin) == input->active_high ? bit : 0u;
}

void inputs_init(void)
{
    setup(&stop);
    for (int i = 0; i < AXES; i++) {
        setup(&axes[i].limit_min);
        setup(&axes[i].limit_max);
        setup(&axes[i].amplifier_fault);
        previous[i][0] = previous[i][1] = 0;
    }
}

void inputs_read(struct hal_drive_in *in)
{
    for (int i = 0; i < AXES; i++) {
        const uint8_t now = (uint8_t)(active(&stop, HAL_STOP) | active(&axes[i].limit_min, HAL_LIMIT_MIN) |
                                      active(&axes[i].limit_max, HAL_LIMIT_MAX) |
                                      active(&axes[i].amplifier_fault, HAL_AMPLIFIER_FAULT));
        in->inputs[i] = (uint8_t)(in->inputs[i] | (now & previous[i][0] & previous[i][1]));
        previous[i][1] = previous[i][0];
        previous[i][0] = now;
    }
}
