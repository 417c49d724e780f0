/* SPDX-License-Identifier: Apache-2.0 */
/* bench_step.c: a program for QEMU that prints, as JSON, the instructions of a complete servo tick under each
 * controller, and under ccu with every compensation on, from encoder counts to force words. */
#include <stdio.h>

#include "rig.h"
#include "target.h"

enum { STEPS = 20000 };

static bool step(enum controller controller, bool compensated, const char *name, const char *separator)
{
    static struct rig r;
    uint32_t worst = 0;
    uint64_t sum = 0;
    rig_init(&r, controller, compensated);
    const uint32_t start = count_now();
    const uint32_t overhead = count_now() - start; /* of reading the counter */
    rig_feed(&r); /* the first tick takes over the configuration, which it does only without power */
    servo_loop_tick(&r.loop);
    rig_move(&r);
    for (uint32_t i = 0; i < STEPS; i++) {
        rig_feed(&r);
        const uint32_t from = count_now();
        servo_loop_tick(&r.loop);
        const uint32_t n = count_now() - from - overhead;
        rig_move(&r);
        sum += n;
        worst = n > worst ? n : worst;
    }
    printf("%s\"%s\": {\"mean\": %lu, \"worst\": %lu}", separator, name, (unsigned long)(sum / STEPS),
           (unsigned long)worst);
    return r.loop.faults == 0;
}

int main(void)
{
#define NAME(id, name, alias, description) name,
    static const char *const name[CONTROLLERS] = {CONTROLLER_TABLE(NAME)};
    bool good = true;
    count_start();
    for (unsigned c = 0; c < CONTROLLERS; c++) {
        good = step((enum controller)c, false, name[c], c == 0 ? "{" : ", ") && good;
    }
    good = step(CONTROLLER_CCU, true, "compensated", ", ") && good;
    printf("}\n");
    return good ? 0 : 1;
}
