/* SPDX-License-Identifier: Apache-2.0 */
#include "supervision/integrity.h"

/* Add a word to a checksum. A bit of `word` that flips changes the result. */
static uint32_t add(uint32_t sum, uint32_t word)
{
    return (sum << 5 | sum >> 27) + word;
}

static uint32_t sum_of(const uint8_t *bytes, size_t count)
{
    uint32_t sum = 0;
    for (size_t i = 0; i + 4u <= count; i += 4u) {
        sum = add(sum, bytes[i] | (uint32_t)bytes[i + 1u] << 8 | (uint32_t)bytes[i + 2u] << 16 |
                           (uint32_t)bytes[i + 3u] << 24);
    }
    return sum;
}

static uint32_t add_entry(uint32_t sum, const struct od_data *od, const struct od_entry *entry)
{
    return (entry->flags & OD_CONFIG) != 0 ? add(sum, (uint32_t)od_read(od, entry)) : sum;
}

static uint32_t parameters(const struct od_data *od)
{
    uint32_t sum = 0;
    for (uint16_t i = 0; i < od_table_len; i++) {
        sum = add_entry(sum, od, &od_table[i]);
    }
    return sum;
}

bool integrity_parameters_intact(const struct integrity *m, const struct od_data *od)
{
    return !m->corrupt && parameters(od) == m->parameters;
}

void integrity_seal(struct integrity *m, const void *cfg, size_t bytes, const struct od_data *od, bool reset)
{
    m->cfg = sum_of(cfg, bytes);
    m->parameters = parameters(od);
    m->sum = 0;
    m->at = 0;
    m->corrupt = m->corrupt && !reset;
}

bool integrity_intact(struct integrity *m, const void *cfg, size_t bytes, const struct od_data *od)
{
    for (unsigned i = 0; i < INTEGRITY_ENTRIES_MS && m->at < od_table_len; i++) {
        m->sum = add_entry(m->sum, od, &od_table[m->at]);
        m->at++;
    }
    if (m->at >= od_table_len) {
        m->corrupt = m->corrupt || m->sum != m->parameters;
        m->sum = 0;
        m->at = 0;
    }
    return !m->corrupt && sum_of(cfg, bytes) == m->cfg;
}
