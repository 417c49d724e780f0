/* SPDX-License-Identifier: Apache-2.0 */
/* Instructions of the board's drivers in a servo tick, both axes with power and a force at the analog output: JSON. QEMU's
 * registers are no encoder's and no DAC's, but the way through the drivers is the ordinary one. */
#include <stdio.h>

#include "port/stm32f405/encoder.h"
#include "port/stm32f405/inputs.h"
#include "port/stm32f405/output.h"
#include "target.h"

enum { STEPS = 1000 };

int main(void)
{
    const struct hal_axis_cfg cfg[AXES] = {{.full_scale_mN = 600000, .jump_counts = UINT32_MAX},
                                           {.full_scale_mN = 600000, .jump_counts = UINT32_MAX}};
    uint32_t worst = 0;
    uint64_t sum = 0;
    output_init(); /* without cpu_detect_emulator(): to them this is a chip */
    inputs_init();
    encoder_init();
    encoder_configure(cfg);
    output_configure(cfg);
    count_start();
    const uint32_t begin = count_now();
    const uint32_t reading = count_now() - begin; /* of the counter itself */
    for (int32_t i = 0; i < STEPS; i++) {
        const struct hal_drive_out out = {.force_mN = {i, -i}, .enable = {true, true}};
        const uint32_t from = count_now();
        struct hal_drive_in in = {0};
        encoder_read(&in);
        inputs_read(&in);
        output_write(&out);
        const uint32_t n = count_now() - from - reading;
        sum += n;
        worst = n > worst ? n : worst;
    }
    printf("{\"mean\": %lu, \"worst\": %lu}\n", (unsigned long)(sum / STEPS), (unsigned long)worst);
    return 0;
}
