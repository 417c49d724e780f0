/* SPDX-License-Identifier: Apache-2.0 */
/* Instructions of a complete servo tick, encoder counts to force words, under each controller: JSON. */
#include <stdio.h>

#include "rig.h"
#include "target.h"

enum { STEPS = 20000 };

static bool step(enum controller controller, const char *name, const char *separator)
{
    static struct rig r;
    uint32_t worst = 0;
    uint64_t sum = 0;
    rig_init(&r, controller);
    const uint32_t begin = count_now();
    const uint32_t reading = count_now() - begin; /* of the counter itself */
    rig_feed(&r); /* the first tick takes the configuration over, which happens without power only */
    servo_loop_tick(&r.loop);
    rig_move(&r);
    for (uint32_t i = 0; i < STEPS; i++) {
        rig_feed(&r);
        const uint32_t from = count_now();
        servo_loop_tick(&r.loop);
        const uint32_t n = count_now() - from - reading;
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
    static const char *const name[CONTROLLERS] = {"track", "cc", "ccu", "cascade", "ccc"};
    bool good = true;
    count_start();
    for (unsigned c = 0; c < CONTROLLERS; c++) {
        good = step((enum controller)c, name[c], c == 0 ? "{" : ", ") && good;
    }
    printf("}\n");
    return good ? 0 : 1;
}
