/* SPDX-License-Identifier: Apache-2.0 */
/* A stop is obeyed within two control periods, in every mode, among whatever frames: the whole firmware on a simulated
 * machine, and a master that sends nonsense. The environment variable FRAMES says how many of its frames there are. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "test_axis_modes.h"

enum { FRAMES = 100000, SLICE = 60 /* frames between a begin and its stop, at most */ };
enum { BEGINS = 9 };

static const uint8_t no_data[1];
static struct rig begins[BEGINS];
static const int8_t begin_modes[BEGINS] = {1, 3, 6, 7, 7, 8, 9, 8, 10};
static uint64_t random_state;

static uint32_t draw(uint32_t below)
{
    uint64_t z = (random_state += 0x9E3779B97F4A7C15u); /* splitmix64 */
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return (uint32_t)((z ^ (z >> 31)) >> 32) % below;
}

static void map(uint8_t number, uint32_t first, uint32_t second, uint8_t type)
{
    const uint32_t cob_id = 0x101u + 0x100u * number;
    const uint16_t communication = (uint16_t)(0x13FF + number), mapping = (uint16_t)(0x15FF + number);
    set(0, communication, 1, 4, (int64_t)cob_id | 0x80000000);
    set(0, mapping, 0, 1, 0);
    set(0, mapping, 1, 4, first);
    set(0, mapping, 2, 4, second);
    set(0, mapping, 0, 1, 2);
    set(0, communication, 2, 1, type);
    set(0, communication, 1, 4, cob_id);
}

static void send_pair(uint16_t id, int32_t x, int32_t y)
{
    uint8_t data[8];
    co_put(&data[0], (uint32_t)x, 4);
    co_put(&data[4], (uint32_t)y, 4);
    rig_send(&rig, id, 8, data);
}

/* On the way with 20 mm/s in a mode; of 8 also at rest */
static void begin(unsigned n)
{
    setUp();
    static const uint32_t entries[BEGINS] = {[6] = 0x60FF0020, [8] = 0x60710010};
    const uint32_t entry = entries[n] != 0 ? entries[n] : 0x607A0020;
    map(3, entry, entry + 0x08000000u, 1);
    map(2, 0x60600008, 0x68600008, 254);
    rig_enable(&rig);
    if (n == 3) {
        struct rig_stream s = {.count = 2000, .length_nm = 60e6};
        TEST_ASSERT_EQUAL_HEX32(0, rig_begin(&rig, &s));
        return;
    }
    for (int i = 0; i < 2; i++) {
        mode(i, begin_modes[n]);
    }
    switch (n) {
    case 0:
        set(0, 0x607A, 0, 4, 30000000);
        set(1, 0x607A, 0, 4, -30000000);
        rig_controlwords(&rig, RUN, RUN);
        break;
    case 1:
        velocity(0, 20000);
        velocity(1, -20000);
        break;
    case 2:
        set(0, 0x6098, 0, 1, 17);
        set(1, 0x6098, 0, 1, 18);
        rig_ms(&rig, 1);
        rig_controlwords(&rig, RUN, RUN);
        break;
    case 4:
        rig_controlwords(&rig, RUN, RUN);
        for (int i = 0; i < 300; i++) {
            const int32_t nm = i < 100 ? i * i * 100 : 1000000 + (i - 100) * 20000;
            TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60C1, 1, 4, nm));
            TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68C1, 1, 4, nm));
            rig_ms(&rig, 1);
        }
        break;
    case 8:
        for (int i = 0; i < 300; i++) {
            static const uint8_t force[4] = {110, 0, 0x80, 0xFF}; /* 66 and -77 N, hardly more than friction */
            rig_send(&rig, 0x401, 4, force);
            rig_send(&rig, 0x80, 0, no_data);
            rig_ms(&rig, 1);
        }
        break;
    default:
        for (int i = 0; i < 300; i++) {
            const int32_t nm = i < 100 ? i * i * 100 : 1000000 + (i - 100) * 20000;
            const int32_t umps = i < 100 ? i * 200 : 20000;
            const int32_t value = n == 7 ? 0 : n == 6 ? umps : nm;
            send_pair(0x401, value, -value);
            rig_send(&rig, 0x80, 0, no_data);
            rig_ms(&rig, 1);
        }
        break;
    }
    rig_ms(&rig, n < 3 ? 250 : 1);
}

/* A frame that any node may send, but no stop: those of NMT that stop, and controlwords, are left to the test. */
static void nonsense(void)
{
    static const uint16_t ids[] = {0x301, 0x401, 0x601, 0x601, 0x601, 0x080, 0x77F, 0x7E5};
    static const uint16_t objects[] = {0x6060, 0x607A, 0x60FF, 0x6081, 0x6083, 0x6085, 0x605A, 0x605D,
                                       0x60C1, 0x60C2, 0x60B1, 0x607D, 0x6065, 0x2131, 0x2200, 0x6098,
                                       0x607F, 0x6067, 0x2000, 0x1006, 0x6071, 0x60B2};
    uint8_t data[8];
    for (int i = 0; i < 8; i++) {
        data[i] = (uint8_t)draw(256);
    }
    const uint16_t id = ids[draw(8)];
    uint8_t len = (uint8_t)(draw(4) == 0 ? draw(9) : 8);
    if (id == 0x601 && draw(4) != 0) {
        const uint16_t index = (uint16_t)(objects[draw(22)] + (draw(2) != 0 ? 0x800u : 0u));
        const uint8_t size = (uint8_t)(1u << draw(3));
        data[0] = (uint8_t)(draw(3) == 0 ? 0x40 : 0x23 | (4 - size) << 2);
        co_put(&data[1], index, 2);
        data[3] = (uint8_t)draw(3);
        co_put(&data[4], draw(2) == 0 ? draw(12) : draw(UINT32_MAX), 4);
        len = 8;
    }
    if (id == 0x401 && draw(3) == 0) { /* forces */
        co_put(&data[0], draw(400) - 200u, 2);
        co_put(&data[2], draw(400) - 200u, 2);
        len = 4;
    }
    if (id == 0x401 && draw(2) == 0) { /* a set-point that might be true */
        co_put(&data[0], 5000000u + draw(200000), 4);
    }
    const bool knot_of_mode = id == 0x301 && draw(2) == 0;
    if (knot_of_mode) {
        data[0] = (uint8_t)draw(10);
        len = 2;
    }
    rig_send(&rig, id, id == 0x080 ? 0 : len, data);
}

struct stop {
    uint16_t word;
    bool off; /* the power goes at once */
    uint8_t nmt;
};

static const struct stop stops[] = {{0x00, true, 0},  {QUICK_STOP, false, 0}, {SHUTDOWN, false, 0},
                                    {0x07, false, 0}, {HALT | RUN, false, 0}, {0, false, 0x02},
                                    {0, false, 0x80}, {0, true, 0x81}};

/* What the drive wants of the axes: no movement that is not a stop */
static void expect_stopping(const struct stop *stop)
{
    const struct drive *d = &rig.device.drive;
    for (int i = 0; i < 2; i++) {
        const bool halted = (stop->word & HALT) != 0;
        TEST_ASSERT_TRUE(halted || !cia402_enabled(&d->axis[i]));
        TEST_ASSERT_FALSE(d->path.modes.cyclic.axis[i].follows || d->path.modes.torque[i].follows);
        TEST_ASSERT_TRUE(!d->path.modes.generating || d->path.modes.axis[i].target.target_umps == 0);
    }
    TEST_ASSERT_EQUAL_HEX32(0, atomic_load(&d->loop.command.forced));
    TEST_ASSERT_TRUE(d->path.modes.generating || !atomic_load(&d->loop.command.run));
}

/* In fault reaction active, which ends in fault, CiA 402-2 has no command to disable voltage. */
static bool already_stopping(void)
{
    const struct cia402 *axis = rig.device.drive.axis;
    return axis[0].state == CIA402_FAULT_REACTION_ACTIVE || axis[1].state == CIA402_FAULT_REACTION_ACTIVE;
}

static void give(const struct stop *stop)
{
    if (stop->nmt != 0) {
        rig_nmt(&rig, stop->nmt);
    } else {
        rig_controlwords_at_once(&rig, stop->word, stop->word);
    }
}

static void test_every_stop_is_obeyed_within_two_periods_in_every_mode_among_any_frames(void)
{
    const char *told = getenv("FRAMES");
    const unsigned frames = told != NULL ? (unsigned)strtoul(told, NULL, 10) : FRAMES;
    unsigned sent = 0, given = 0, moved = 0;
    random_state = 1;
    for (unsigned n = 0; n < BEGINS; n++) {
        begin(n);
        begins[n] = rig;
    }
    while (sent < frames) {
        rig = begins[draw(BEGINS)];
        for (unsigned k = draw(SLICE); k > 0; k--, sent++) {
            nonsense();
            rig_run(&rig, draw(8));
        }
        const struct stop *stop = &stops[draw(8)];
        const double speed = hypot(mmps(0), mmps(1));
        const bool off = stop->off && (stop->nmt != 0 || !already_stopping());
        give(stop);
        rig_run(&rig, 2);
        TEST_ASSERT_TRUE(!off || (!rig.out.enable[0] && !rig.out.enable[1]));
        rig_run(&rig, stop->nmt != 0 ? 9 : 0); /* what the axes do after an NMT command is decided in the next ms */
        expect_stopping(stop);
        for (unsigned k = draw(10); k > 0; k--, sent++) {
            nonsense();
            rig_run(&rig, draw(8));
            TEST_ASSERT_TRUE(hypot(mmps(0), mmps(1)) < speed + 80); /* knots that are made may have 3 ms of 20 m/s2 */
        }
        moved += speed > 5 ? 1 : 0;
        given++;
    }
    TEST_ASSERT_TRUE(given > frames / SLICE);
    TEST_ASSERT_TRUE(moved > given / 4);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_every_stop_is_obeyed_within_two_periods_in_every_mode_among_any_frames);
    return UNITY_END();
}
