/* SPDX-License-Identifier: Apache-2.0 */
/* stages.c: a plugin of QEMU (qemu-plugin.h of its manual, "TCG plugins") that counts the instructions between one call
 * of count_now() and the next by stage of the servo tick.
 *
 * -plugin libstages.so,table=FILE: lines "ADDRESS STAGE" in hex and decimal for each address of the program that
 * belongs to a stage, ascending, and first a line "ADDRESS STAGES" of count_now() and the number of stages. An address that is not
 * in the table, a helper of the compiler's library, belongs to the stage that called it.
 *
 * The program reads the counter in pairs; a pair that has nothing between it, the first, begins a series, and each
 * further pair is a tick. Written to standard error at the end: for each series a line of the ticks' number, and the
 * sum and the worst of each stage. The first pair's instructions come off the last stage.
 */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* of qemu-plugin.h */
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
int qemu_plugin_install(qemu_plugin_id_t id, const struct qemu_info *info, int argc, char **argv);
extern int qemu_plugin_version;

__attribute__((visibility("default"))) int qemu_plugin_version = QEMU_PLUGIN_VERSION;

enum { STAGES = 16, ADDRESSES = 1 << 19, SERIES = 32, INHERITED = 255 };

struct block { /* that QEMU has translated: how many instructions of which stage */
    uint32_t count[STAGES], inherited;
    uint8_t last;
    bool marks;
};

static uint8_t stage_at[ADDRESSES]; /* by (address - flash) / 2 */
static uint32_t mark, stages;
static uint64_t now[STAGES], reading;
static unsigned current, calls; /* where execution is; calls of count_now() so far */
static struct series {
    uint64_t ticks, sum[STAGES], worst[STAGES];
} series[SERIES], *at = series;

static unsigned stage_of(uint64_t address)
{
    const uint64_t i = (address - 0x08000000u) / 2;
    return i < ADDRESSES ? stage_at[i] : INHERITED;
}

/* count_now() is called: a pair begins or ends. A series has 1 + ticks pairs; the program's gap makes the first. */
static void marked(void)
{
    if (calls++ % 2 == 1) {
        uint64_t all = 0;
        for (unsigned s = 0; s < stages; s++) {
            all += now[s];
        }
        if (all < 12) { /* nothing in it */
            at = at->ticks > 0 && at < &series[SERIES - 1] ? at + 1 : at;
            reading = all;
        } else {
            now[stages - 1] -= reading;
            at->ticks++;
            for (unsigned s = 0; s < stages; s++) {
                at->sum[s] += now[s];
                at->worst[s] = now[s] > at->worst[s] ? now[s] : at->worst[s];
            }
        }
    }
    memset(now, 0, sizeof now);
}

static void execute(unsigned vcpu, void *data)
{
    const struct block *b = data;
    (void)vcpu;
    if (b->marks) {
        marked();
    }
    now[current] += b->inherited;
    for (unsigned s = 0; s < stages; s++) {
        now[s] += b->count[s];
    }
    current = b->last == INHERITED ? current : b->last;
}

static void translate(qemu_plugin_id_t id, struct qemu_plugin_tb *tb)
{
    struct block *b = calloc(1, sizeof *b); /* for as long as QEMU runs */
    (void)id;
    b->last = INHERITED;
    for (size_t i = 0; i < qemu_plugin_tb_n_insns(tb); i++) {
        const uint64_t address = qemu_plugin_insn_vaddr(qemu_plugin_tb_get_insn(tb, i));
        const unsigned s = stage_of(address);
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
        fprintf(stdout, "\n");
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
    fclose(table);
    qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
    qemu_plugin_register_atexit_cb(id, end, NULL);
    return 0;
}
