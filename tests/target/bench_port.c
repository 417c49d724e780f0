/* SPDX-License-Identifier: Apache-2.0 */
/* bench_port.c: a program for QEMU that prints, as JSON, the instructions of the board's drivers in a servo tick,
 * with both axes enabled and a force at the analog output. QEMU's registers are not those of an encoder or a DAC, but
 * the drivers execute what they execute on a chip.
 */
#include <stdio.h>

#include "port/stm32f405/encoder.h"
#include "port/stm32f405/inputs.h"
#include "port/stm32f405/output.h"
#include "target.h"

enum { STEPS = 1000 };

int main(void)
{
    const struct hal_axis_cfg one = {.full_scale_mN = 600000, .jump_counts = UINT32_MAX, .pwm.hz = 40000};
    const struct hal_axis_cfg cfg[AXES] = {one, one};
    uint32_t worst = 0;
    uint64_t sum = 0;
    output_init(); /* without cpu_detect_emulator(), so that the drivers take this for a chip */
    inputs_init();
    encoder_init();
    encoder_configure(cfg);
    output_configure(cfg);
    count_start();
    const uint32_t start = count_now();
    const uint32_t overhead = count_now() - start; /* of reading the counter */
    for (int32_t i = 0; i < STEPS; i++) {
        const struct hal_drive_out out = {.force_mN = {i, -i}, .enable = {true, true}};
        const uint32_t from = count_now();
        struct hal_drive_in in = {0};
        encoder_read(&in);
        inputs_read(&in);
        output_write(&out);
        const uint32_t n = count_now() - from - overhead;
        sum += n;
        worst = n > worst ? n : worst;
    }
    printf("{\"mean\": %lu, \"worst\": %lu}\n", (unsigned long)(sum / STEPS), (unsigned long)worst);
    return 0;
}
