/* SPDX-License-Identifier: Apache-2.0 */
/* stages.c: a plugin of QEMU (qemu-plugin.h of its manual, "TCG plugins") that counts, by stage of the servo tick,
 * the instructions between one call of count_now() and the next. `tools/cost.py` runs it.
 *
 * Its argument is table=FILE. The first line of the table is "ADDRESS STAGES", the address
 * of count_now() in hex and the number of stages. Each further line is "ADDRESS STAGE" for
 * an address of the program that belongs to a stage, ascending. An address that is not in
 * the table, a function of the compiler's library, belongs to the stage that called it. "= ADDRESS CYCLES" is what the
 * core takes for an instruction that it has fetched; without that it is 1.
 *
 * The program reads the counter in pairs. A pair without anything between its calls begins a series; each further
 * pair is a servo tick. At the end the plugin prints a line for each series: the number of ticks, for each stage the
 * sum and the maximum of its instructions, and sum and maximum of the cycles that a model makes of them. The
 * instructions of the empty pair are subtracted from the last stage.
 *
 * The model is an STM32F405 at 168 MHz. Its flash has five wait states and gives lines of 16 bytes; 64 of them are in
 * the instruction cache, and the next one is fetched ahead (RM0090 3.5.2). A branch that is taken costs two cycles more.
 * Literals hit the data cache, nobody else uses the bus, and the cache is that of the tick before, as the background
 * leaves it: empty.
 */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Declarations of qemu-plugin.h. */
typedef uint64_t qemu_plugin_id_t;
struct qemu_info;
struct qemu_plugin_tb;
struct qemu_plugin_insn;
typedef void (*on_translate)(qemu_plugin_id_t id, struct qemu_plugin_tb *tb);
typedef void (*on_execute)(unsigned vcpu, void *data);
typedef void (*on_exit_of)(qemu_plugin_id_t id, void *data);
void qemu_plugin_register_vcpu_tb_trans_cb(qemu_plugin_id_t id, on_translate call);
void qemu_plugin_register_vcpu_tb_exec_cb(struct qemu_plugin_tb *tb, on_execute call, int flags, void *data);
void qemu_plugin_register_atexit_cb(qemu_plugin_id_t id, on_exit_of call, void *data);
size_t qemu_plugin_tb_n_insns(const struct qemu_plugin_tb *tb);
struct qemu_plugin_insn *qemu_plugin_tb_get_insn(const struct qemu_plugin_tb *tb, size_t i);
uint64_t qemu_plugin_insn_vaddr(const struct qemu_plugin_insn *insn);
size_t qemu_plugin_insn_size(const struct qemu_plugin_insn *insn);
int qemu_plugin_install(qemu_plugin_id_t id, const struct qemu_info *info, int argc, char **argv);
extern int qemu_plugin_version;

__attribute__((visibility("default"))) int qemu_plugin_version = QEMU_PLUGIN_VERSION;

enum { STAGES = 16, ADDRESSES = 1 << 19, SERIES = 32, INHERITED = 255 };
enum { LINE_BYTES = 16, LINES = 64, FETCH = 6, BRANCH = 2, BLOCK_LINES = 1024 };

/* A block that QEMU has translated: the number of its instructions in each stage. */
struct block {
    uint32_t count[STAGES], inherited;
    uint8_t last;
    bool marks;
    uint64_t from, to; /* addresses; `to` is that of the next instruction */
    unsigned lines;
    uint32_t *cycles; /* of the instructions in each line of the flash */
};

static struct {
    uint64_t line[LINES], next,
        at; /* the cache, in turn; the line at hand; the address that follows without a branch */
    unsigned turn;
    uint64_t cycles, since; /* of this pair; of the line at hand */
} core;

static uint8_t cycles_at[ADDRESSES]; /* by (address - flash) / 2; 0 is 1 */
static uint8_t stage_at[ADDRESSES];  /* by (address - flash) / 2 */
static uint32_t mark, stages;
static uint64_t now[STAGES], overhead; /* instructions of this pair; instructions of an empty pair */
static unsigned current, calls;        /* stage that executes; calls of count_now() so far */
static struct series {
    uint64_t ticks, sum[STAGES], worst[STAGES], cycles, worst_cycles;
} series[SERIES], *at = series;

static unsigned stage_of(uint64_t address)
{
    const uint64_t i = (address - 0x08000000u) / 2;
    return i < ADDRESSES ? stage_at[i] : INHERITED;
}

/* count_now() is called: a pair starts or ends. */
static void pair_boundary(void)
{
    if (calls++ % 2 == 1) {
        uint64_t all = 0;
        for (unsigned s = 0; s < stages; s++) {
            all += now[s];
        }
        if (all < 12) { /* the pair is empty */
            at = at->ticks > 0 && at < &series[SERIES - 1] ? at + 1 : at;
            overhead = all;
        } else {
            now[stages - 1] -= overhead;
            at->ticks++;
            at->cycles += core.cycles;
            at->worst_cycles = core.cycles > at->worst_cycles ? core.cycles : at->worst_cycles;
            for (unsigned s = 0; s < stages; s++) {
                at->sum[s] += now[s];
                at->worst[s] = now[s] > at->worst[s] ? now[s] : at->worst[s];
            }
        }
    }
    memset(now, 0, sizeof now);
    memset(&core, 0, sizeof core);
}

static bool cached(uint64_t line)
{
    for (unsigned i = 0; i < LINES; i++) {
        if (core.line[i] == line) {
            return true;
        }
    }
    core.line[core.turn++ % LINES] = line;
    return false;
}

/* The core comes to a line: it waits unless the line is in the cache, or the rest of the wait if it was fetched ahead. */
static void fetch(uint64_t line)
{
    if (line == core.next - 1) {
        return;
    }
    if (!cached(line)) {
        const uint64_t ahead = line == core.next && core.since < FETCH ? core.since : line == core.next ? FETCH : 0;
        core.cycles += FETCH - ahead;
    }
    core.next = line + 1;
    core.since = 0;
}

static void pass(const struct block *b)
{
    core.cycles += b->from == core.at ? 0 : BRANCH;
    for (unsigned i = 0; i < b->lines; i++) {
        fetch(b->from / LINE_BYTES + i);
        core.cycles += b->cycles[i];
        core.since += b->cycles[i];
    }
    core.at = b->to;
}

static void execute(unsigned vcpu, void *data)
{
    const struct block *b = data;
    (void)vcpu;
    if (b->marks) {
        pair_boundary();
    }
    pass(b);
    now[current] += b->inherited;
    for (unsigned s = 0; s < stages; s++) {
        now[s] += b->count[s];
    }
    current = b->last == INHERITED ? current : b->last;
}

static void translate(qemu_plugin_id_t id, struct qemu_plugin_tb *tb)
{
    struct block *b = calloc(1, sizeof *b); /* never freed: QEMU needs it as long as it runs */
    (void)id;
    b->last = INHERITED;
    b->from = qemu_plugin_insn_vaddr(qemu_plugin_tb_get_insn(tb, 0));
    b->cycles = calloc(BLOCK_LINES, sizeof *b->cycles);
    for (size_t i = 0; i < qemu_plugin_tb_n_insns(tb); i++) {
        const uint64_t address = qemu_plugin_insn_vaddr(qemu_plugin_tb_get_insn(tb, i));
        const unsigned s = stage_of(address);
        const uint64_t where = (address - 0x08000000u) / 2;
        const unsigned line = (unsigned)(address / LINE_BYTES - b->from / LINE_BYTES) % BLOCK_LINES;
        b->cycles[line] += where < ADDRESSES && cycles_at[where] != 0 ? cycles_at[where] : 1u;
        b->lines = line + 1;
        b->to = address + qemu_plugin_insn_size(qemu_plugin_tb_get_insn(tb, i));
        b->marks = b->marks || address == mark;
        if (s != INHERITED) {
            b->last = (uint8_t)s;
            b->count[s]++;
        } else if (b->last != INHERITED) {
            b->count[b->last]++;
        } else {
            b->inherited++;
        }
    }
    qemu_plugin_register_vcpu_tb_exec_cb(tb, execute, 0, b);
}

static void end(qemu_plugin_id_t id, void *data)
{
    (void)id;
    (void)data;
    for (const struct series *s = series; s <= at; s++) {
        fprintf(stdout, "%llu", (unsigned long long)s->ticks);
        for (unsigned i = 0; i < stages; i++) {
            fprintf(stdout, " %llu %llu", (unsigned long long)s->sum[i], (unsigned long long)s->worst[i]);
        }
        fprintf(stdout, " %llu %llu\n", (unsigned long long)s->cycles, (unsigned long long)s->worst_cycles);
    }
}

__attribute__((visibility("default"))) int qemu_plugin_install(qemu_plugin_id_t id, const struct qemu_info *info,
                                                               int argc, char **argv)
{
    (void)info;
    unsigned long address;
    unsigned stage;
    FILE *table = argc == 1 && strncmp(argv[0], "table=", 6) == 0 ? fopen(argv[0] + 6, "r") : NULL;
    memset(stage_at, INHERITED, sizeof stage_at);
    if (table == NULL || fscanf(table, "%lx %u", &address, &stages) != 2 || stages == 0 || stages > STAGES) {
        return 1;
    }
    mark = (uint32_t)address;
    while (fscanf(table, "%lx %u", &address, &stage) == 2) {
        if (address >= 0x08000000u && (address - 0x08000000u) / 2 < ADDRESSES && stage < stages) {
            stage_at[(address - 0x08000000u) / 2] = (uint8_t)stage;
        }
    }
    while (fscanf(table, " = %lx %u", &address, &stage) == 2) {
        if (address >= 0x08000000u && (address - 0x08000000u) / 2 < ADDRESSES) {
            cycles_at[(address - 0x08000000u) / 2] = (uint8_t)stage;
        }
    }
    fclose(table);
    qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
    qemu_plugin_register_atexit_cb(id, end, NULL);
    return 0;
}
