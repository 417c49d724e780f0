/* SPDX-License-Identifier: Apache-2.0 */
/* pace.c: the arithmetic of pace.h. */
#include "port/linux/pace.h"

#define NS_PER_S 1000000000u
#define NS_PER_MS 1000000u
#define US_PER_S 1000000u

/* Complete periods in `ns`. It does not overflow in 580 years. */
static uint64_t periods_in(const struct pace *pace, uint64_t ns)
{
    return ns / NS_PER_S * pace->hz + ns % NS_PER_S * pace->hz / NS_PER_S;
}

void pace_init(struct pace *pace, uint32_t hz, uint64_t now_ns)
{
    *pace = (struct pace){.hz = hz, .start_ns = now_ns};
}

uint32_t pace_due(struct pace *pace, uint64_t now_ns, uint64_t tick)
{
    const uint64_t most = (uint64_t)pace->hz * PACE_CATCH_UP_MS / 1000u;
    uint64_t now = periods_in(pace, now_ns - pace->start_ns);
    if (now > tick + most) {
        const uint64_t lost_ms = (now - tick - most) * 1000u / pace->hz + 1;
        pace->start_ns += lost_ms * NS_PER_MS;
        pace->lost_ms += lost_ms;
        now = periods_in(pace, now_ns - pace->start_ns);
    }
    return now > tick ? (uint32_t)(now - tick) : 0;
}

void pace_frame(struct pace *pace, uint64_t tick)
{
    pace->bus_free = tick + pace->hz / PACE_FRAME_HZ;
}

bool pace_bus_free(const struct pace *pace, uint64_t tick)
{
    return tick >= pace->bus_free;
}

uint64_t pace_bus_wait_ns(const struct pace *pace, uint64_t now_ns)
{
    const uint64_t second_ns = (pace->bus_free % pace->hz * NS_PER_S + pace->hz - 1u) / pace->hz;
    const uint64_t free_ns = pace->start_ns + pace->bus_free / pace->hz * NS_PER_S + second_ns;
    return free_ns > now_ns ? free_ns - now_ns : 0;
}

uint32_t pace_sync(struct pace *pace, uint32_t us)
{
    const uint64_t passed = (uint64_t)us * pace->hz + pace->remainder;
    pace->remainder = (uint32_t)(passed % US_PER_S);
    return (uint32_t)(passed / US_PER_S);
}
