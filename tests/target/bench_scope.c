/* SPDX-License-Identifier: Apache-2.0 */
/* bench_scope.c: a program for QEMU that prints, as JSON, the instructions
 * of a servo tick under ccu with the scope in different states. */
#include <stdio.h>

#include "rig.h"
#include "target.h"

#define STEPS 8000

static void tick(const char *name, uint8_t channels, uint32_t interval_us, enum scope_trigger trigger, const char *end)
{
    static const int32_t no_origin[2];
    static struct rig r;
    static struct od_data od;
    uint32_t worst = 0;
    uint64_t sum = 0;
    rig_init(&r, CONTROLLER_CCU, false);
    od = od_defaults;
    if (channels > 0) {
        for (uint8_t i = 0; i < SCOPE_CHANNELS; i++) {
            od.scope_channels[i] = i < channels ? (uint8_t)(SIGNAL_TANGENTIAL_ERROR + i) : 0;
        }
        od.scope.interval = interval_us;
        od.scope.trigger = (uint8_t)trigger;
        od.scope.source = SIGNAL_CONTOUR_ERROR;
        od.scope.level = INT32_MAX;
        (void)scope_arm(&r.loop.scope, &od, no_origin);
    }
    const uint32_t start = count_now();
    const uint32_t overhead = count_now() - start; /* of reading the counter */
    for (uint32_t i = 0; i < STEPS; i++) {
        rig_feed(&r);
        const uint32_t from = count_now();
        servo_loop_tick(&r.loop);
        const uint32_t n = count_now() - from - overhead;
        rig_move(&r);
        sum += n;
        worst = n > worst ? n : worst;
    }
    printf("\"%s\": {\"mean\": %lu, \"worst\": %lu}%s", name, (unsigned long)(sum / STEPS), (unsigned long)worst, end);
}

int main(void)
{
    count_start();
    printf("{");
    tick("off", 0, 0, SCOPE_FAULT, ", ");
    tick("5 signals each 0.8 ms, fault", 5, 800, SCOPE_FAULT, ", ");
    tick("3 signals each period, level", 3, 0, SCOPE_RISING, ", ");
    tick("8 signals each period, level", 8, 0, SCOPE_RISING, "}\n");
    return 0;
}
