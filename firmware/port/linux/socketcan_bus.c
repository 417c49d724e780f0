/* SPDX-License-Identifier: Apache-2.0 */
/* socketcan_bus.c: a bus (bus.h) of classic CAN frames on a SocketCAN interface (Linux:
 * Documentation/networking/can.rst). The loop of the process kontur-sim calls it. When the interface goes down or
 * away, the drive goes on without a bus, loses the host's heartbeat, and uses the interface again when it is back.
 */
#include <errno.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "port/linux/bus.h"
#include "port/linux/can_errors.h"
#include "port/linux/message.h"

enum { OUT_FRAMES = 256, RECEIVE_BYTES = 1 << 20, RETRY_MS = 100 };

struct socketcan_bus {
    char interface[IFNAMSIZ];
    int socket; /* -1: the interface is down or away */
    int64_t retry_ms;
    uint32_t dropped, kernel_dropped;
    struct ks_can_status status;
    bool changed;
    struct can_frame out[OUT_FRAMES]; /* frames for which the kernel had no room, oldest first */
    unsigned out_count;
};

static int64_t now_ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

/* Returns a bound socket, or -1 with a message in `problem` that says what is wrong and what to do. */
static int open_socket(const char *interface, char *problem, size_t bytes)
{
    struct ifreq request = {0};
    struct sockaddr_can address = {.can_family = AF_CAN};
    const struct can_filter base_format = {.can_id = 0, .can_mask = CAN_EFF_FLAG};
    const can_err_mask_t errors = CAN_ERR_MASK;
    const int size = RECEIVE_BYTES, on = 1;
    int fd = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (fd < 0) {
        if (errno == EAFNOSUPPORT || errno == EPROTONOSUPPORT) {
            snprintf(problem, bytes,
                     "this kernel has no CAN: `modprobe can-raw` as root, or use --slcan-tcp 0 instead");
        } else {
            snprintf(problem, bytes, "no CAN socket is available: %s; use --slcan-tcp 0 instead", strerror(errno));
        }
        return -1;
    }
    memcpy(request.ifr_name, interface, strnlen(interface, IFNAMSIZ - 1));
    if (strlen(interface) >= IFNAMSIZ || ioctl(fd, SIOCGIFINDEX, &request) != 0) {
        snprintf(problem, bytes, "there is no interface %s: `ip link add dev %s type vcan` as root makes a virtual one",
                 interface, interface);
        goto failed;
    }
    address.can_ifindex = request.ifr_ifindex;
    if (ioctl(fd, SIOCGIFHWADDR, &request) == 0 && request.ifr_hwaddr.sa_family != ARPHRD_CAN) {
        snprintf(problem, bytes, "%s is no CAN interface; `ip -br link show type can` and `type vcan` list those",
                 interface);
        goto failed;
    }
    if (ioctl(fd, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) == 0) {
        snprintf(problem, bytes,
                 "%s is down: `ip link set up %s` as root (a real one: `ip link set %s up type can bitrate 1000000`)",
                 interface, interface, interface);
        goto failed;
    }
    setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, &base_format, sizeof base_format);
    setsockopt(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors);
    setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &size, sizeof size);
    setsockopt(fd, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
    if (bind(fd, (const struct sockaddr *)&address, sizeof address) != 0) {
        snprintf(problem, bytes, "%s: %s", interface, strerror(errno));
        goto failed;
    }
    return fd;
failed:
    close(fd);
    return -1;
}

static void interface_lost(struct socketcan_bus *s)
{
    if (s->socket < 0) {
        return;
    }
    print_message("%s is down or gone; the drive goes on without a bus and waits for it: `ip link set up %s` as root",
                  s->interface, s->interface);
    close(s->socket);
    s->socket = -1;
    s->out_count = 0;
    s->retry_ms = now_ms() + RETRY_MS;
}

static void try_to_reopen(struct socketcan_bus *s)
{
    char problem[256];
    if (now_ms() < s->retry_ms) {
        return;
    }
    s->retry_ms = now_ms() + RETRY_MS;
    s->socket = open_socket(s->interface, problem, sizeof problem);
    if (s->socket >= 0) {
        print_message("%s is back", s->interface);
        s->kernel_dropped = 0;
        s->status.state = KS_CAN_ACTIVE;
        s->changed = true;
    }
}

/* false: the kernel has no room, or there is no bus. */
static bool write_frame(struct socketcan_bus *s, const struct can_frame *frame)
{
    if (s->socket < 0) {
        return false;
    }
    if (write(s->socket, frame, sizeof *frame) == sizeof *frame) {
        return true;
    }
    if (errno != EAGAIN && errno != ENOBUFS && errno != EINTR) {
        interface_lost(s);
    }
    return false;
}

static unsigned before_poll(void *ctx, struct pollfd *fds)
{
    struct socketcan_bus *s = ctx;
    unsigned written = 0;
    if (s->socket < 0) {
        try_to_reopen(s);
    }
    while (written < s->out_count && write_frame(s, &s->out[written])) {
        written++;
    }
    if (written > 0 && written <= s->out_count) {
        s->out_count -= written;
        memmove(s->out, &s->out[written], s->out_count * sizeof *s->out);
    }
    if (s->socket < 0) {
        return 0;
    }
    /* Pending frames are tried again before each poll(). The loop's timer ends each poll() after 1 ms. */
    fds[0] = (struct pollfd){.fd = s->socket, .events = POLLIN};
    return 1;
}

static void after_poll(void *ctx, const struct pollfd *fds, unsigned count)
{
    (void)ctx;
    (void)fds;
    (void)count;
}

/* The kernel reports its count of frames dropped on this socket together with the frames. */
static void count_lost(struct socketcan_bus *s, struct msghdr *message)
{
    for (struct cmsghdr *c = CMSG_FIRSTHDR(message); c != NULL; c = CMSG_NXTHDR(message, c)) {
        uint32_t dropped;
        if (c->cmsg_level == SOL_SOCKET && c->cmsg_type == SO_RXQ_OVFL) {
            memcpy(&dropped, CMSG_DATA(c), sizeof dropped);
            if (dropped != s->kernel_dropped) {
                s->status.rx_lost += dropped - s->kernel_dropped;
                s->kernel_dropped = dropped;
                s->changed = true;
            }
        }
    }
}

static void handle_error_frame(struct socketcan_bus *s, const struct can_frame *frame)
{
    const uint32_t bus_offs = s->status.bus_offs;
    s->changed = can_errors_apply(frame, &s->status) || s->changed;
    if (s->status.bus_offs != bus_offs) {
        print_message(
            "%s is bus-off: check cable, termination and bit rate; as root, `ip link set %s type can restart` "
            "restarts it once, and `restart-ms 100` in place of `restart` after every bus-off",
            s->interface, s->interface);
    }
}

static bool receive(void *ctx, struct ks_frame *out, uint32_t ms)
{
    struct socketcan_bus *s = ctx;
    (void)ms;
    while (s->socket >= 0) {
        struct can_frame frame;
        union {
            struct cmsghdr align;
            char bytes[CMSG_SPACE(sizeof(uint32_t))];
        } control;
        struct iovec io = {&frame, sizeof frame};
        struct msghdr message = {
            .msg_iov = &io, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
        const ssize_t got = recvmsg(s->socket, &message, 0);
        if (got < 0) {
            if (errno != EAGAIN && errno != EINTR) {
                interface_lost(s);
            }
            return false;
        }
        count_lost(s, &message);
        if (got != sizeof frame) {
            continue;
        }
        if (frame.can_id & CAN_ERR_FLAG) {
            handle_error_frame(s, &frame);
            continue;
        }
        *out = (struct ks_frame){
            .id = frame.can_id & CAN_SFF_MASK, .len = frame.can_dlc, .rtr = (frame.can_id & CAN_RTR_FLAG) != 0};
        memcpy(out->data, frame.data, sizeof out->data);
        return true;
    }
    return false;
}

static void send_frame(void *ctx, const struct ks_frame *frame, uint32_t ms)
{
    struct socketcan_bus *s = ctx;
    struct can_frame out = {.can_id = frame->id | (frame->rtr ? CAN_RTR_FLAG : 0u), .can_dlc = frame->len};
    (void)ms;
    memcpy(out.data, frame->data, sizeof out.data);
    if (s->out_count == 0 && write_frame(s, &out)) {
        return;
    }
    if (s->socket >= 0 && s->out_count < OUT_FRAMES) {
        s->out[s->out_count++] = out;
    } else if (s->socket >= 0) {
        s->dropped++;
    }
}

static bool status(void *ctx, struct ks_can_status *out)
{
    struct socketcan_bus *s = ctx;
    const bool changed = s->changed;
    s->changed = false;
    *out = s->status;
    return changed;
}

static void close_bus(void *ctx)
{
    struct socketcan_bus *s = ctx;
    if (s->dropped > 0) {
        print_message("%u frames were dropped, since %s had no room for them", s->dropped, s->interface);
    }
    if (s->socket >= 0) {
        close(s->socket);
    }
}

void bus_open_socketcan(struct bus *bus, const char *interface)
{
    static struct socketcan_bus s;
    char problem[256];
    s.socket = open_socket(interface, problem, sizeof problem);
    if (s.socket < 0) {
        fatal("--can %s: %s", interface, problem);
    }
    memcpy(s.interface, interface, strlen(interface) + 1);
    snprintf(bus->name, sizeof bus->name, "socketcan %s", interface);
    bus->ctx = &s;
    bus->before_poll = before_poll;
    bus->after_poll = after_poll;
    bus->receive = receive;
    bus->send = send_frame;
    bus->status = status;
    bus->close = close_bus;
}
