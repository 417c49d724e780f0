/* SPDX-License-Identifier: Apache-2.0 */
#include "canopen/frame.h"

void co_put(uint8_t *data, uint32_t value, uint8_t count)
{
    for (unsigned i = 0; i < count; i++) {
        data[i] = (uint8_t)(value >> (8 * i));
    }
}

uint32_t co_get(const uint8_t *data, uint8_t count)
{
    uint32_t value = 0;
    for (unsigned i = 0; i < count; i++) {
        value |= (uint32_t)data[i] << (8 * i);
    }
    return value;
}
