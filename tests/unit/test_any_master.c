/* SPDX-License-Identifier: Apache-2.0 */
/* What any master may send, which knows nothing of this drive: the whole firmware on a simulated machine. */
#include <string.h>

#include "test_device.h"

enum { CONFIG_ENABLED = 0xFF18, MEMORY = 0x5510 };

static struct can_frame lss_answer;

static bool keep_lss(void *ctx, const struct can_frame *frame)
{
    if (frame->id == 0x7E4) {
        lss_answer = *frame;
    }
    return rig_can_send(ctx, frame);
}

/* ---- LSS writes 2001h, over which there is a checksum ---- */

/* A request of LSS, and the first bytes of its answer: command, error, specific error */
static void lss(uint8_t command, uint8_t a, uint8_t b, const uint8_t answer[3])
{
    const uint8_t data[8] = {command, a, b};
    rig.hal.can_send = keep_lss;
    lss_answer = (struct can_frame){0};
    rig_send(&rig, 0x7E5, 8, data);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(answer, lss_answer.data, 3);
}

static const uint8_t no_answer[3];

static void test_lss_configuration_without_power_is_no_memory_fault(void)
{
    rig_nmt(&rig, 1);
    lss(0x04, 1, 0, no_answer);
    lss(0x11, 9, 0, (const uint8_t[]){0x11, 0, 0});
    rig_ms(&rig, 100);
    lss(0x13, 0, 2, (const uint8_t[]){0x13, 0, 0});
    rig_ms(&rig, 100);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    TEST_ASSERT_EQUAL_UINT32(9, rig_read(&rig, 0x2001, 1));
    TEST_ASSERT_EQUAL_UINT32(500, rig_read(&rig, 0x2001, 2));
    rig_enable(&rig);
}

static void test_lss_configuration_is_refused_while_an_axis_has_power(void)
{
    static const uint8_t refused[] = {0x11, 0xFF, 1}, refused_rate[] = {0x13, 0xFF, 1};
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2001, 2, 2, 500));
    rig_enable(&rig);
    rig_go(&rig, &stream, 300);
    lss(0x04, 1, 0, no_answer);
    lss(0x11, 9, 0, refused);
    lss(0x13, 0, 4, refused_rate);
    lss(0x15, 10, 0, no_answer); /* activate bit timing */
    const unsigned told = rig.status_count;
    rig_ms(&rig, 100);
    TEST_ASSERT_TRUE_MESSAGE(rig.status_count > told, "it is silent");
    TEST_ASSERT_EQUAL_UINT32(1, rig_read(&rig, 0x2001, 1));
    TEST_ASSERT_EQUAL_UINT32(500, rig_read(&rig, 0x2001, 2));
    TEST_ASSERT_EQUAL_UINT(1000, rig.bitrate);
    TEST_ASSERT_TRUE(rig_had_emcy(&rig, CONFIG_ENABLED));
    TEST_ASSERT_FALSE(rig_had_emcy(&rig, MEMORY));
    rig_expect_states(&rig, RIG_ENABLED, RIG_ENABLED);
    TEST_ASSERT_EQUAL_UINT32(RUNNING, stream_state());
}

/* ---- heartbeats ---- */

static void test_claim_of_a_holder_that_falls_silent_without_power_ends_and_is_no_fault(void)
{
    rig.heartbeat_every_ms = 50;
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x2140, 2, 4, 127));
    rig_nmt(&rig, 1);
    rig_ms(&rig, 200);
    TEST_ASSERT_EQUAL_UINT32(127, rig_read(&rig, 0x2140, 1));
    rig.heartbeat_every_ms = 0;
    rig_ms(&rig, 600);
    TEST_ASSERT_EQUAL_UINT32(0, rig_read(&rig, 0x2140, 1));
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count);
    rig_enable(&rig);
}

/* ---- RPDOs as a PLC maps them ---- */

/* Map entries (index << 16 | sub << 8 | bits, up to the first 0) into RPDO `number`, as in pre-operational. */
static void map_rpdo(unsigned number, const uint32_t map[8], uint8_t type)
{
    unsigned count = 0;
    uint32_t abort = 0;
    for (uint8_t sub = 1; sub <= 8; sub++) {
        const struct od_entry *e = od_find((uint16_t)(OBJ_RPDO1_MAP + number - 1u), sub, &abort);
        od_write(&rig.device.od, e, map[sub - 1]);
        count += map[sub - 1] != 0 ? 1u : 0u;
    }
    od_write(&rig.device.od, od_find((uint16_t)(OBJ_RPDO1_MAP + number - 1u), 0, &abort), count);
    od_write(&rig.device.od, od_find((uint16_t)(OBJ_RPDO1 + number - 1u), SUB_RPDO1_TYPE, &abort), type);
    co_pdo_refresh(&rig.device.node.pdo);
}

static void jog(void)
{
    rig_nmt(&rig, 1);
    for (uint16_t axis = 0; axis <= 0x800; axis = (uint16_t)(axis + 0x800)) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, (uint16_t)(0x6060u + axis), 0, 1, 3));
    }
    rig_enable(&rig);
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x60FF, 0, 4, 20000));
    TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, 0x68FF, 0, 4, -20000));
    rig_ms(&rig, 200);
    TEST_ASSERT_TRUE(rig.plant.vel_mps[0] > 0.01 && rig.plant.vel_mps[1] < -0.01);
}

static const uint32_t words_and_modes[8] = {0x60400010, 0x60600008, 0x68400010, 0x68600008};

static void test_zeroed_outputs_of_a_plc_stop_a_jog(void)
{
    const uint8_t zeros[8] = {0};
    jog();
    map_rpdo(1, words_and_modes, 254);
    rig_send(&rig, 0x201, 6, zeros);
    rig_run(&rig, 2);
    expect_power(false, false);
    rig_ms(&rig, 10);
    rig_expect_states(&rig, RIG_DISABLED, RIG_DISABLED);
    TEST_ASSERT_EQUAL_UINT(0, rig.emcy_count); /* mode 0 is no change */
    TEST_ASSERT_EQUAL_INT8(3, (int8_t)rig_read(&rig, 0x6061, 0));
}

static void test_value_that_is_refused_is_refused_alone_and_told_once(void)
{
    jog();
    map_rpdo(1, words_and_modes, 254);
    const uint8_t wrong[8] = {ENABLE, 0, 4, HALT & 0xFF, HALT >> 8, 6}; /* there is no mode 4 */
    for (int i = 0; i < 5; i++) {
        rig_send(&rig, 0x201, 6, wrong);
        rig_ms(&rig, 10);
    }
    TEST_ASSERT_EQUAL_UINT(1, rig.emcy_count);
    TEST_ASSERT_EQUAL_HEX16(0x8200, rig.emcy[0]);
    TEST_ASSERT_EQUAL_UINT32(5, rig_read(&rig, 0x2200, 20));
    TEST_ASSERT_EQUAL_INT8(3, (int8_t)rig_read(&rig, 0x6060, 0));
    TEST_ASSERT_EQUAL_INT8(6, (int8_t)rig_read(&rig, 0x6860, 0));
    rig_ms(&rig, 300);
    TEST_ASSERT_TRUE(rig.plant.vel_mps[0] > 0.01);
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 0, rig.plant.vel_mps[1]);
    const uint8_t right[8] = {ENABLE, 0, 3, HALT & 0xFF, HALT >> 8, 6};
    rig_send(&rig, 0x201, 6, right);
    TEST_ASSERT_EQUAL_UINT(2, rig.emcy_count);
    TEST_ASSERT_EQUAL_HEX16(0, rig.emcy[1]);
}

/* ---- every mapping in every order ---- */

enum { CASES = 20000, WRITABLE_MAX = 64 };
enum begin { AT_REST, JOGGING, ON_THE_PATH, STOPPING_QUICKLY, HOMING, BEGINS };

static struct rig begins[BEGINS];
static uint64_t random_state;

static uint32_t draw(uint32_t below)
{
    uint64_t z = (random_state += 0x9E3779B97F4A7C15u); /* splitmix64 */
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return (uint32_t)((z ^ (z >> 31)) >> 32) % below;
}

static void home(void)
{
    rig_nmt(&rig, 1);
    for (uint16_t axis = 0; axis <= 0x800; axis = (uint16_t)(axis + 0x800)) {
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, (uint16_t)(0x6060u + axis), 0, 1, 6));
        TEST_ASSERT_EQUAL_HEX32(0, rig_write(&rig, (uint16_t)(0x6098u + axis), 0, 1, 17));
    }
    rig_enable(&rig);
    rig_controlwords(&rig, RUN, RUN);
    rig_ms(&rig, 100);
}

static void make_begins(void)
{
    for (enum begin b = AT_REST; b < BEGINS; b++) {
        setUp();
        switch (b) {
        case JOGGING: jog(); break;
        case HOMING: home(); break;
        case AT_REST: rig_enable(&rig); break;
        default:
            rig_enable(&rig);
            rig_go(&rig, &stream, 400);
            break;
        }
        if (b == STOPPING_QUICKLY) {
            rig_controlwords(&rig, QUICK_STOP, QUICK_STOP);
            rig_ms(&rig, 5);
            rig_expect_states(&rig, RIG_QUICK_STOP, RIG_QUICK_STOP);
        }
        begins[b] = rig;
    }
}

/* What can be mapped into an RPDO, the gaps included: index << 16 | sub << 8 | bits. */
static unsigned writable(uint32_t map[WRITABLE_MAX])
{
    static const uint8_t gap_bits[] = {8, 16, 32, 8, 16, 32}; /* 0002h to 0007h */
    unsigned count = 0;
    for (uint32_t i = 0; i < sizeof gap_bits; i++) {
        map[count++] = (i + 2u) << 16 | gap_bits[i];
    }
    for (uint16_t i = 0; i < od_table_len && count < WRITABLE_MAX; i++) {
        const struct od_entry *e = &od_table[i];
        if ((e->flags & OD_PDO) != 0 && (e->flags & OD_WRITE) != 0) {
            map[count++] = (uint32_t)e->index << 16 | (uint32_t)e->sub << 8 | 8u * od_size(e);
        }
    }
    return count;
}

/* Give RPDO3 this mapping and these bytes. Where the type is synchronous, a SYNC follows. */
static void give(const uint32_t map[8], uint8_t len, const uint8_t data[8], uint8_t type)
{
    map_rpdo(3, map, type);
    rig_send(&rig, 0x401, len, data);
    if (type <= PDO_SYNC_MAX) {
        rig_send(&rig, 0x80, 0, data);
    }
}

/* A mapping with a controlword of at least one axis in any place, and bytes for it. Returns the length. */
static uint8_t draw_rpdo(uint32_t map[8], uint8_t data[8])
{
    static const uint16_t stops[] = {0x00, 0x02, SHUTDOWN, SWITCH_ON, HALT, QUICK_STOP, 0x01, 0x8F};
    uint32_t all[WRITABLE_MAX];
    const unsigned count = writable(all);
    const uint32_t commands[2] = {0x60400010, 0x68400010};
    uint8_t len = 0, entries = 0, commanded = 0;
    memset(map, 0, 8 * sizeof *map);
    for (int tries = 0; tries < 40 && entries < 8; tries++) {
        const bool word = draw(3) == 0;
        const uint32_t entry = word ? commands[draw(2)] : all[draw(count)];
        const uint8_t bytes = (uint8_t)((entry & 0xFFu) / 8u);
        const bool is_word = entry == commands[0] || entry == commands[1];
        if (len + bytes > 8 || (commanded == 0 && !is_word && len + bytes > 6)) {
            continue;
        }
        const uint32_t value = is_word ? stops[draw(8)] : draw(3) == 0 ? 0u : draw(UINT32_MAX);
        co_put(&data[len], value, bytes);
        map[entries++] = entry;
        len = (uint8_t)(len + bytes);
        commanded = (uint8_t)(commanded + (is_word ? 1 : 0));
    }
    return len;
}

/* The twin: the controlwords alone, with gaps in place of all else. false: it has more than eight entries. */
static bool twin_of(const uint32_t map[8], uint32_t twin[8])
{
    unsigned count = 0;
    memset(twin, 0, 8 * sizeof *twin);
    for (unsigned i = 0; i < 8 && map[i] != 0; i++) {
        const unsigned bits = map[i] & 0xFFu;
        if (count + (bits == 24 ? 2u : 1u) > 8) {
            return false;
        }
        if ((map[i] & 0xF7FF0000u) == 0x60400000) {
            twin[count++] = map[i];
            continue;
        }
        if (bits == 24) {
            twin[count++] = 0x00050008;
        }
        twin[count++] = bits == 8 ? 0x00050008u : bits == 32 ? 0x00070020u : 0x00060010u;
    }
    return true;
}

static void test_after_any_rpdo_its_controlwords_have_had_their_effect(void)
{
    unsigned off = 0, twins = 0;
    random_state = 1;
    make_begins();
    for (unsigned n = 0; n < CASES; n++) {
        uint32_t map[8], words[8];
        uint8_t data[8] = {0};
        const uint8_t len = draw_rpdo(map, data);
        const struct rig *begin = &begins[draw(BEGINS)];
        const uint8_t type = (uint8_t)(draw(3) == 0 ? draw(3) : 254);
        if (!twin_of(map, words)) {
            continue;
        }
        rig = *begin;
        give(words, len, data, type);
        const struct cia402 twin[2] = {rig.device.drive.axis[0], rig.device.drive.axis[1]};
        rig = *begin;
        give(map, len, data, type);
        for (int i = 0; i < 2; i++) {
            const struct cia402 *axis = &rig.device.drive.axis[i];
            TEST_ASSERT_EQUAL_HEX16(twin[i].controlword, axis->controlword);
            TEST_ASSERT_EQUAL(twin[i].state, axis->state);
            TEST_ASSERT_EQUAL(twin[i].standing, axis->standing);
        }
        rig_run(&rig, 2);
        for (int i = 0; i < 2; i++) {
            const bool disabled = rig.device.drive.axis[i].state == CIA402_SWITCH_ON_DISABLED;
            TEST_ASSERT_TRUE(!disabled || !rig.out.enable[i]);
            off += disabled ? 1u : 0u;
        }
        twins++;
    }
    TEST_ASSERT_TRUE(twins > CASES / 2 && off > CASES / 8);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_lss_configuration_without_power_is_no_memory_fault);
    RUN_TEST(test_lss_configuration_is_refused_while_an_axis_has_power);
    RUN_TEST(test_claim_of_a_holder_that_falls_silent_without_power_ends_and_is_no_fault);
    RUN_TEST(test_zeroed_outputs_of_a_plc_stop_a_jog);
    RUN_TEST(test_value_that_is_refused_is_refused_alone_and_told_once);
    RUN_TEST(test_after_any_rpdo_its_controlwords_have_had_their_effect);
    return UNITY_END();
}
