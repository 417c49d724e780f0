/* SPDX-License-Identifier: Apache-2.0 */
/* What both directions of the SDO block transfer are tested with. */
#ifndef TEST_CANOPEN_BLOCK_H
#define TEST_CANOPEN_BLOCK_H
#include "test_canopen_bus.h"

static struct bus bus;

/* CiA 301, 7.2.4.3.16 */
static uint16_t crc16(const char *data, size_t count)
{
    uint16_t crc = 0;
    for (size_t i = 0; i < 8 * count; i++) { /* bit by bit, as a shift register */
        const unsigned in = (unsigned)(uint8_t)data[i / 8] >> (7 - i % 8) & 1u;
        const unsigned out = (crc >> 15 & 1u) ^ in;
        crc = (uint16_t)(crc << 1);
        crc = out != 0 ? crc ^ 0x1021 : crc;
    }
    return crc;
}

/* A request that has no answer at once. */
static void give(const char *request)
{
    bus_clear(&bus);
    bus_give(&bus, 0x600 + NODE, request);
    TEST_ASSERT_EQUAL_UINT(0, bus.count);
}

#endif
