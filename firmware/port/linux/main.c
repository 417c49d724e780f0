/* SPDX-License-Identifier: Apache-2.0 */
/* main.c: kontur-sim, the firmware and a simulated machine as a process on a CAN bus. It is one loop without threads.
 * It waits in poll(), or for less than a millisecond until the bus is free.
 *
 * Paced by the wall clock, the loop lets the device time that is due advance in slices, and handles frames between
 * them, so that frames reach the device close to their time. Paced by SYNC, it handles frames as they come, and no
 * time passes but 1006h after each SYNC.
 */
#include <errno.h>
#include <getopt.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/random.h>
#include <sys/signalfd.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#include "port/linux/bus.h"
#include "port/linux/library.h"
#include "port/linux/machine_file.h"
#include "port/linux/message.h"
#include "port/linux/pace.h"
#include "port/linux/whole_file.h"

enum { SLICE_HZ = 1000, FRAMES_PER_PASS = 256, NS_PER_MS = 1000000 };

static const char usage[] =
    "usage: kontur-sim --machine FILE (--can INTERFACE | --slcan-tcp [HOST:]PORT | --slcan-pty)\n"
    "                  [--pace clock|sync] [--seed N] [--node ID] [--num f32|fix|chk] [--store FILE]\n"
    "                  [--record FILE] [--with-parent]\n"
    "The Kontur firmware and a simulated machine on a CAN bus. `kontur sim` starts it with a machine from a TOML\n"
    "file.\n"
    "  --machine FILE    machine file as plain text (firmware/port/linux/machine_file.h); -: standard input\n"
    "  --can INTERFACE   SocketCAN interface with classic frames, such as vcan0 or can0\n"
    "  --slcan-tcp PORT  slcan over TCP, on 127.0.0.1 unless HOST is given, for up to 8 clients that share one bus;\n"
    "                    0: any free port\n"
    "  --slcan-pty       slcan over a pseudo-terminal\n"
    "  --pace clock      device time follows the wall clock (default)\n"
    "  --pace sync       device time passes with SYNC only, by 1006h at each: every run is the same\n"
    "  --seed N          seed of the simulated noise (default 1)\n"
    "  --node ID         CANopen node id, 1..31 (default 1)\n"
    "  --num NUM         numeric back end of the firmware (default f32)\n"
    "  --store FILE      file of the parameters that the drive stores (1010h): read at the start, written when it "
    "stores\n"
    "  --record FILE     write the true motion at the end, a struct ks_truth for each control period since power-on\n"
    "  --with-parent     end when the process that started this one ends\n"
    "SIGINT and SIGTERM end the process.\n";

struct options {
    const char *machine, *can, *slcan_tcp, *num, *store, *record;
    bool slcan_pty, sync, with_parent;
    uint64_t seed;
    uint8_t node;
};

struct sim {
    struct library lib;
    struct bus bus;
    struct pace pace;
    ks *ks;
    const char *store; /* file of the flash; NULL: none */
    uint32_t stored;   /* operations of the flash that are in this file */
    bool sync;
    bool loss_reported;
    bool failed; /* the process has to end */
};

static uint64_t now_ns(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (uint64_t)t.tv_sec * 1000000000u + (uint64_t)t.tv_nsec;
}

static uint64_t integer_option(const char *name, const char *text, uint64_t least, uint64_t greatest)
{
    char *end = NULL;
    errno = 0;
    const unsigned long long value = strtoull(text, &end, 10);
    if (*text < '0' || *text > '9' || *end != '\0' || errno != 0 || value < least || value > greatest) {
        fatal("--%s %s: must be a whole number %llu..%llu", name, text, (unsigned long long)least,
              (unsigned long long)greatest);
    }
    return value;
}

static struct options parse(int argc, char **argv)
{
    enum { MACHINE, CAN, TCP, PTY, PACE, SEED, NODE, NUM, STORE, RECORD, PARENT, HELP };
    static const struct option known[] = {
        {"machine", required_argument, NULL, MACHINE},
        {"can", required_argument, NULL, CAN},
        {"slcan-tcp", required_argument, NULL, TCP},
        {"slcan-pty", no_argument, NULL, PTY},
        {"pace", required_argument, NULL, PACE},
        {"seed", required_argument, NULL, SEED},
        {"node", required_argument, NULL, NODE},
        {"num", required_argument, NULL, NUM},
        {"store", required_argument, NULL, STORE},
        {"record", required_argument, NULL, RECORD},
        {"with-parent", no_argument, NULL, PARENT},
        {"help", no_argument, NULL, HELP},
        {NULL, 0, NULL, 0},
    };
    struct options o = {.num = "f32", .seed = 1, .node = 1};
    int option;
    while ((option = getopt_long(argc, argv, "", known, NULL)) != -1) {
        switch (option) {
        case MACHINE: o.machine = optarg; break;
        case CAN: o.can = optarg; break;
        case TCP: o.slcan_tcp = optarg; break;
        case PTY: o.slcan_pty = true; break;
        case PACE:
            o.sync = strcmp(optarg, "sync") == 0;
            if (!o.sync && strcmp(optarg, "clock") != 0) {
                fatal("--pace %s: must be clock or sync", optarg);
            }
            break;
        case SEED: o.seed = integer_option("seed", optarg, 0, UINT64_MAX); break;
        case NODE: o.node = (uint8_t)integer_option("node", optarg, 1, 31); break;
        case NUM: o.num = optarg; break;
        case STORE: o.store = optarg; break;
        case RECORD: o.record = optarg; break;
        case PARENT: o.with_parent = true; break;
        case HELP: fputs(usage, stdout); exit(0);
        default: fputs(usage, stderr); exit(2);
        }
    }
    if (optind != argc || o.machine == NULL || (o.can != NULL) + (o.slcan_tcp != NULL) + o.slcan_pty != 1) {
        fputs(usage, stderr);
        exit(2);
    }
    return o;
}

static uint32_t device_ms(const struct sim *s, uint64_t tick)
{
    return (uint32_t)(tick * 1000u / s->pace.hz);
}

static bool write_flash(const struct sim *s)
{
    uint32_t bytes;
    const void *flash = s->lib.ks_flash(s->ks, &bytes);
    if (!whole_file_write(s->store, flash, bytes)) {
        print_message("--store %s cannot be written: %s; make room, or name another file", s->store, strerror(errno));
        return false;
    }
    return true;
}

/* Before the first change of the flash, see whether the disk has room for it: the flash as it is is written once more.
 * If it has not, the change fails, and the device says that it has not saved. */
static int store_ready(void *ctx)
{
    const struct sim *s = ctx;
    return s->lib.ks_flash_operations(s->ks) != s->stored || write_flash(s);
}

/* Bring the flash to the disk if the device has changed it. false: that is not possible. */
static bool write_store(struct sim *s)
{
    const uint32_t operations = s->lib.ks_flash_operations(s->ks);
    if (s->store == NULL || operations == s->stored) {
        return true;
    }
    s->stored = operations;
    return write_flash(s);
}

/* Send the frames that the device has put out. true: there was at least one. The store is on the disk before, since
 * one of them may say so; if it cannot be, none is sent, and the process ends. */
static bool send_pending(struct sim *s)
{
    struct ks_frame frame;
    bool sent = false;
    s->failed = s->failed || !write_store(s);
    while (!s->failed && s->lib.ks_recv(s->ks, &frame)) {
        s->bus.send(s->bus.ctx, &frame, device_ms(s, frame.tick));
        pace_frame(&s->pace, frame.tick);
        sent = true;
    }
    return sent;
}

/* Let control periods pass, and send the frames that the device puts out in them. */
static void advance(struct sim *s, uint32_t periods)
{
    while (periods > 0) {
        periods -= s->lib.ks_step(s->ks, periods);
        (void)send_pending(s);
    }
}

/* Give received frames to the device, at most FRAMES_PER_PASS so that a flood of frames does not stop time. true:
 * there may be more. By the wall clock it returns after a frame that the device has answered, since the next frame
 * may be the host's reply to that answer and must not reach the device at the same time. */
static bool receive_frames(struct sim *s)
{
    struct ks_frame frame;
    struct ks_can_status status;
    if (s->bus.status != NULL && s->bus.status(s->bus.ctx, &status)) {
        s->lib.ks_set_can_status(s->ks, &status);
    }
    for (unsigned i = 0; i < FRAMES_PER_PASS; i++) {
        if (!s->bus.receive(s->bus.ctx, &frame, device_ms(s, s->lib.ks_tick(s->ks)))) {
            return false;
        }
        pace_frame(&s->pace, s->lib.ks_tick(s->ks));
        (void)s->lib.ks_send(s->ks, frame.id, frame.rtr, frame.len, frame.data);
        if (send_pending(s) && !s->sync) {
            return true;
        }
        if (s->sync && !frame.rtr && frame.id == s->lib.ks_sync_id(s->ks)) {
            advance(s, pace_sync(&s->pace, s->lib.ks_sync_us(s->ks)));
        }
    }
    return true;
}

/* Let a slice of the device time that is due pass. true: more is due. */
static bool follow_clock(struct sim *s)
{
    const uint64_t tick = s->lib.ks_tick(s->ks);
    const uint32_t due = pace_due(&s->pace, now_ns(), tick);
    const uint32_t slice = s->pace.hz / (pace_bus_free(&s->pace, tick) ? SLICE_HZ : PACE_FRAME_HZ);
    if (s->pace.lost_ms > 0 && !s->loss_reported) {
        print_message(
            "this machine does not keep up with the wall clock: %llu ms of device time are lost (reported once); close "
            "other programs, or use --pace sync, which does not need the clock",
            (unsigned long long)s->pace.lost_ms);
        s->loss_reported = true;
    }
    advance(s, due < slice ? due : slice);
    return due > slice;
}

static int timer_each_ms(void)
{
    const int fd = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
    const struct itimerspec each = {.it_interval = {.tv_nsec = 1000000}, .it_value = {.tv_nsec = 1000000}};
    if (fd < 0 || timerfd_settime(fd, 0, &each, NULL) != 0) {
        fatal("no timer is available: %s", strerror(errno));
    }
    return fd;
}

/* A descriptor that becomes readable when a signal asks the
 * process to end. SIGPIPE of a client that has gone is ignored. */
static int end_signals(void)
{
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGINT);
    sigaddset(&set, SIGTERM);
    sigaddset(&set, SIGHUP);
    sigprocmask(SIG_BLOCK, &set, NULL);
    signal(SIGPIPE, SIG_IGN);
    const int fd = signalfd(-1, &set, SFD_NONBLOCK | SFD_CLOEXEC);
    if (fd < 0) {
        fatal("signals cannot be received: %s", strerror(errno));
    }
    return fd;
}

static void run(struct sim *s, int signals)
{
    const int timer = timer_each_ms();
    bool more = false, frames = false; /* more time is due; there may be frames to receive */
    while (!s->failed) {
        struct pollfd fds[2 + BUS_FDS] = {{.fd = signals, .events = POLLIN}, {.fd = timer, .events = POLLIN}};
        const unsigned count = s->bus.before_poll(s->bus.ctx, &fds[2]);
        if (poll(fds, 2 + count, more || frames ? 0 : -1) < 0 && errno != EINTR) {
            fatal("poll: %s", strerror(errno));
        }
        if (fds[0].revents != 0) {
            break;
        }
        if (fds[1].revents != 0) {
            uint64_t expirations;
            (void)!read(timer, &expirations, sizeof expirations);
        }
        s->bus.after_poll(s->bus.ctx, &fds[2], count);
        more = !s->sync && follow_clock(s); /* before the frames, so that they are handled at the present time */
        for (unsigned i = 0; i < count; i++) {
            frames = frames || fds[2 + i].revents != 0;
        }
        if (s->sync || pace_bus_free(&s->pace, s->lib.ks_tick(s->ks))) {
            frames = receive_frames(s);
        } else if (frames && !more) {
            const uint64_t ns = pace_bus_wait_ns(&s->pace, now_ns());
            const struct timespec wait = {.tv_nsec = ns < NS_PER_MS ? (long)ns : NS_PER_MS};
            (void)nanosleep(&wait, NULL);
        }
    }
    close(timer);
}

/* Power on with the flash of the last run, if its file exists and is not empty. */
static void load_store(const struct sim *s)
{
    static char flash[1 << 20];
    uint32_t bytes;
    (void)s->lib.ks_flash(s->ks, &bytes);
    const ssize_t got = whole_file_read(s->store, flash, sizeof flash);
    if (got == 0 || (got < 0 && errno == ENOENT)) {
        return;
    }
    if (got != (ssize_t)bytes) {
        fatal("--store %s: %s; name another file, or remove this one to start with an empty store", s->store,
              got < 0 ? strerror(errno) : "holds no store of this program");
    }
    s->lib.ks_power_on_with(s->ks, flash);
}

static bool write_record(const struct sim *s, const char *path)
{
    const uint64_t bytes = s->lib.ks_record_count(s->ks) * sizeof(struct ks_truth);
    const bool ok = whole_file_write(path, s->lib.ks_record_data(s->ks), bytes);
    if (!ok) {
        print_message("--record %s cannot be written: %s", path, strerror(errno));
    }
    return ok;
}

/* Tickets are no other run's. */
static void draw_entropy(struct sim *s)
{
    uint32_t noise = 0;
    if (getrandom(&noise, sizeof noise, GRND_NONBLOCK) != (ssize_t)sizeof noise) {
        noise = (uint32_t)now_ns();
    }
    s->lib.ks_set_entropy(s->ks, noise);
}

int main(int argc, char **argv)
{
    static struct sim s;
    struct ks_machine machine;
    const struct options options = parse(argc, argv);
    const int signals = end_signals();
    if (options.with_parent) {
        prctl(PR_SET_PDEATHSIG, SIGTERM);
    }
    library_load(&s.lib, options.num);
    machine_file_read(options.machine, &machine);
    const char *field = s.lib.ks_check(&machine);
    if (field != NULL) {
        fatal("machine %s: %s is out of range (sim/kontur_sim.h)", options.machine, field);
    }
    s.ks = s.lib.ks_new(&machine, options.seed, options.node);
    if (s.ks == NULL) {
        fatal("not enough memory");
    }
    s.store = options.store;
    if (s.store != NULL) {
        load_store(&s);
        s.stored = ~s.lib.ks_flash_operations(s.ks);
        if (!write_store(&s)) { /* rather now than when something is to be stored */
            return 1;
        }
        s.lib.ks_on_flash(s.ks, store_ready, &s);
    }
    s.sync = options.sync;
    s.lib.ks_set_paced(s.ks, s.sync);
    if (!s.sync) { /* every run by SYNC is the same */
        draw_entropy(&s);
    }
    if (options.can != NULL) {
        bus_open_socketcan(&s.bus, options.can);
    } else if (options.slcan_pty) {
        bus_open_slcan_pty(&s.bus);
    } else {
        bus_open_slcan_tcp(&s.bus, options.slcan_tcp);
    }
    if (options.record != NULL) {
        s.lib.ks_record(s.ks, 1);
    }
    pace_init(&s.pace, s.lib.ks_control_hz(s.ks), now_ns());
    printf("kontur-sim: ready on %s\n", s.bus.name);
    fflush(stdout);
    run(&s, signals);
    s.bus.close(s.bus.ctx);
    if (options.record != NULL) {
        s.failed = !write_record(&s, options.record) || s.failed;
    }
    s.lib.ks_free(s.ks);
    return s.failed ? 1 : 0;
}
