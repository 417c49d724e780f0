/* SPDX-License-Identifier: Apache-2.0 */
/* What the tests of the drive (test_drive*.c) share: drive and servo tick out of step, as on a chip, where the tick comes
 * when it likes. */
#ifndef TEST_DRIVE_H
#define TEST_DRIVE_H
#include <string.h>

#include "drive/drive.h"
#include "num_test.h"
#include "unity.h"

static struct drive drive;
static struct spline_ring knots;
static struct od_data od;
static struct hal_drive_in wires;
static struct hal_drive_out out;
static struct hal hal;

static void drive_read(void *ctx, struct hal_drive_in *in)
{
    (void)ctx;
    *in = wires;
}

static void drive_write(void *ctx, const struct hal_drive_out *written)
{
    (void)ctx;
    out = *written;
}

static inline void tick(unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        servo_loop_tick(&drive.loop);
    }
}

static inline void step(unsigned received)
{
    drive_step(&drive, &(struct drive_in){.received = received});
}

static inline void ms(unsigned count)
{
    for (unsigned i = 0; i < count; i++) {
        tick(10);
        step(0);
    }
}

/* Controlwords of a master that knows the present state of the axes. */
static inline void command(uint16_t x, uint16_t y)
{
    for (int i = 0; i < 2; i++) {
        drive_statusword_sent(&drive, i);
    }
    command_guard_drained(&drive.command_guard, drive_now(&drive) - COMMAND_GUARD_PERIODS);
    od.axis[0].controlword = x;
    od.axis[1].controlword = y;
    step(3);
}

static inline void enable(void)
{
    ms(3);
    command(0x06, 0x06);
    command(0x0F, 0x0F);
    TEST_ASSERT_TRUE(cia402_enabled(&drive.axis[0]) && cia402_enabled(&drive.axis[1]));
}

/* A stream of `total` knots that stands still, `given` of them there */
static inline void begin(uint32_t total, uint32_t given)
{
    od.stream.total = total;
    od.stream.start_x = od.stream.start_y = 0;
    TEST_ASSERT_EQUAL_HEX32(0, drive_stream_command(&drive, 1));
    for (uint32_t i = 0; i < given; i++) {
        TEST_ASSERT_EQUAL(QUEUE_ACCEPTED, path_push(&drive.path, (struct knot){{0, 0}}));
    }
}

void setUp(void)
{
    wires = (struct hal_drive_in){0};
    hal = (struct hal){.drive_read = drive_read, .drive_write = drive_write};
    od_init(&od, 1);
    memset(&drive, 0xA5, sizeof drive);
    drive_init(&drive, &od, &hal, &knots);
}

void tearDown(void)
{
}
#endif
