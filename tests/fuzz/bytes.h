/* SPDX-License-Identifier: Apache-2.0 */
/* bytes.h: reads the input of a fuzzer as numbers. Behind its end it reads zeros. */
#ifndef FUZZ_BYTES_H
#define FUZZ_BYTES_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct bytes {
    const uint8_t *at;
    size_t left;
};

static inline uint8_t bytes_u8(struct bytes *b)
{
    if (b->left == 0) {
        return 0;
    }
    b->left--;
    return *b->at++;
}

/* Little-endian, `count` bytes. */
static inline uint32_t bytes_number(struct bytes *b, unsigned count)
{
    uint32_t value = 0;
    for (unsigned i = 0; i < count; i++) {
        value |= (uint32_t)bytes_u8(b) << (8 * i);
    }
    return value;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
#endif
