/* SPDX-License-Identifier: Apache-2.0 */
/* test_flash.h: a parameter store on a simulated flash whose power can fail, for the tests of the store. */
#ifndef TEST_FLASH_H
#define TEST_FLASH_H
#include "od/store.h"
#include "sim/flash.h"
#include "unity.h"

enum { NODE = 5, ALL = STORE_COMMUNICATION | STORE_APPLICATION | STORE_NODE };

static struct sim_flash flash;
static struct hal hal;
static struct store store;

static void flash_read(void *ctx, unsigned sector, uint32_t offset, void *data, uint32_t bytes)
{
    sim_flash_read(ctx, sector, offset, data, bytes);
}

static bool flash_erase(void *ctx, unsigned sector)
{
    return sim_flash_erase(ctx, sector);
}

static bool flash_write(void *ctx, unsigned sector, uint32_t offset, const void *data, uint32_t bytes)
{
    return sim_flash_write(ctx, sector, offset, data, bytes);
}

static void flash_start(void)
{
    sim_flash_init(&flash, 1);
    hal = (struct hal){.ctx = &flash, .flash_read = flash_read, .flash_erase = flash_erase, .flash_write = flash_write};
}
#endif
