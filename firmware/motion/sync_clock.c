/* SPDX-License-Identifier: Apache-2.0 */
#include "motion/sync_clock.h"

/* a b of two Q32, |a| < 2^37 and |b| < 2^25 */
static int64_t product(int64_t a, int64_t b)
{
    return a * b / SYNC_CYCLE;
}

static int64_t clamp(int64_t x, int64_t most)
{
    return x > most ? most : x < -most ? -most : x;
}

int64_t sync_clock_since(const struct sync_clock *c, uint32_t now)
{
    const uint32_t most = c->period * 2u * SYNC_GONE_AFTER;
    const uint32_t passed = now - c->at;
    const int64_t cycles = (int64_t)(passed > most ? most : passed) * SYNC_CYCLE / (int64_t)c->period;
    return c->late + cycles + product(cycles, c->drift);
}

bool sync_clock_locked(const struct sync_clock *c, uint32_t now)
{
    return c->count >= SYNC_LOCKED && now - c->at <= SYNC_GONE_AFTER * c->period;
}

void sync_clock_sync(struct sync_clock *c, uint32_t now, uint32_t period)
{
    if (c->count == 0 || period != c->period || now - c->at > SYNC_GONE_AFTER * period) {
        *c = (struct sync_clock){.count = 1, .cycle = c->cycle + 1u, .period = period, .at = now};
        return;
    }
    const int64_t since = sync_clock_since(c, now);
    const int64_t cycles = (since + SYNC_CYCLE / 2) / SYNC_CYCLE; /* late > -1/2: not below 0 */
    const int64_t error = clamp(cycles * SYNC_CYCLE - since, SYNC_CYCLE / 2);
    c->count += c->count < SYNC_MEMORY ? 1u : 0u;
    const int64_t n = c->count;
    const int64_t square = n * (n + 1);
    c->cycle += (uint32_t)cycles;
    c->at = now;
    c->late = since - cycles * SYNC_CYCLE + error * (4 * n - 2) / square;
    if (n > SYNC_LOCKED) {
        c->drift = clamp(c->drift + error * 6 / square, SYNC_CYCLE / SYNC_DRIFT);
    }
}
