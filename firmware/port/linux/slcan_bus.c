/* SPDX-License-Identifier: Apache-2.0 */
/* slcan_bus.c: a bus (bus.h) of slcan lines (slcan.h) over a TCP socket, which one client at a time may use, or over a
 * pseudo-terminal. The loop of the process kontur-sim calls it. */
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <termios.h>
#include <unistd.h>

#include "port/linux/bus.h"
#include "port/linux/message.h"
#include "port/slcan.h"

/* OUT_BYTES is one second of telemetry. A client that leaves
 * more unread than this and the kernel's buffer loses frames. */
enum { IN_BYTES = 4096, OUT_BYTES = 131072, SOCKET_BYTES = 131072 };

struct slcan_bus {
    struct slcan codec;
    int listener; /* -1: the bus is a pseudo-terminal */
    int client;   /* -1: none */
    int slave;    /* open as long as the process runs, so that the terminal outlives its users */
    uint32_t dropped;
    unsigned in_at, in_count, out_count;
    char in[IN_BYTES], out[OUT_BYTES];
};

static void reset_session(struct slcan_bus *s)
{
    if (s->dropped > 0) {
        print_message("%u frames were dropped, since the client did not read them", s->dropped);
    }
    slcan_init(&s->codec, 0);
    s->dropped = 0;
    s->in_at = s->in_count = s->out_count = 0;
}

static void hang_up(struct slcan_bus *s)
{
    close(s->client);
    s->client = -1;
    reset_session(s);
}

static void flush_output(struct slcan_bus *s)
{
    while (s->client >= 0 && s->out_count > 0) {
        const ssize_t done = write(s->client, s->out, s->out_count);
        if (done < 0) {
            if (errno == EINTR) {
                continue;
            }
            if (errno != EAGAIN && s->listener >= 0) {
                hang_up(s);
            }
            return;
        }
        s->out_count -= (unsigned)done;
        memmove(s->out, &s->out[done], s->out_count);
    }
}

/* Append a line to the output completely, or not at all: false. */
static bool append_output(struct slcan_bus *s, const char *text, unsigned count)
{
    if (s->out_count + count > OUT_BYTES) {
        flush_output(s);
    }
    if (s->client < 0 || s->out_count + count > OUT_BYTES) {
        return false;
    }
    memcpy(&s->out[s->out_count], text, count);
    s->out_count += count;
    return true;
}

static unsigned before_poll(void *ctx, struct pollfd *fds)
{
    struct slcan_bus *s = ctx;
    unsigned count = 0;
    flush_output(s);
    if (s->listener >= 0) {
        fds[count++] = (struct pollfd){.fd = s->listener, .events = POLLIN};
    }
    if (s->client >= 0) {
        const short out = s->out_count > 0 ? POLLOUT : 0;
        fds[count++] = (struct pollfd){.fd = s->client, .events = (short)(POLLIN | POLLRDHUP | out)};
    }
    return count;
}

static void after_poll(void *ctx, const struct pollfd *fds, unsigned count)
{
    struct slcan_bus *s = ctx;
    if (s->listener < 0 || count == 0 || fds[0].revents == 0) {
        return;
    }
    if (count > 1 && (fds[1].revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0) {
        return; /* the client before has gone, but its last frames are not read yet: the next client waits */
    }
    const int client = accept4(s->listener, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (client < 0) {
        return;
    }
    if (s->client >= 0) {
        static const char busy[] = "kontur-sim: another client is connected; there can be one at a time\r\n";
        (void)!write(client, busy, sizeof busy - 1);
        close(client);
        return;
    }
    const int on = 1, bytes = SOCKET_BYTES;
    setsockopt(client, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    setsockopt(client, SOL_SOCKET, SO_SNDBUF, &bytes, sizeof bytes);
    s->client = client;
}

/* Read what the client has sent. false: there is nothing to read. */
static bool read_input(struct slcan_bus *s)
{
    if (s->client < 0) {
        return false;
    }
    const ssize_t got = read(s->client, s->in, sizeof s->in);
    if (got <= 0) {
        if (s->listener >= 0 && (got == 0 || (errno != EAGAIN && errno != EINTR))) {
            hang_up(s);
        }
        return false;
    }
    if (s->listener >= 0) {
        /* A client that writes frame by frame (pyserial) waits for each acknowledgement (Nagle's algorithm), which must
         * therefore not be delayed. */
        const int on = 1;
        setsockopt(s->client, IPPROTO_TCP, TCP_QUICKACK, &on, sizeof on);
    }
    s->in_at = 0;
    s->in_count = (unsigned)got;
    return true;
}

static bool receive(void *ctx, struct ks_frame *frame)
{
    struct slcan_bus *s = ctx;
    for (;;) {
        while (s->in_at < s->in_count) {
            struct can_frame got;
            struct slcan_answer answer;
            const enum slcan_event event = slcan_parse(&s->codec, s->in[s->in_at++], &got, &answer);
            if (event == SLCAN_OPENED || event == SLCAN_CLOSED) {
                s->out_count = 0; /* frames that were meant for the user before */
                if (s->listener < 0) {
                    tcflush(s->slave, TCIFLUSH);
                }
            }
            (void)append_output(s, answer.text, answer.count);
            if (event == SLCAN_HAS_FRAME) {
                *frame = (struct ks_frame){.id = got.id, .len = got.len, .rtr = got.rtr};
                memcpy(frame->data, got.data, sizeof frame->data);
                return true;
            }
        }
        if (!read_input(s)) {
            return false;
        }
    }
}

static void send_frame(void *ctx, const struct ks_frame *frame, uint32_t ms)
{
    struct slcan_bus *s = ctx;
    struct can_frame out = {.id = (uint16_t)frame->id, .len = frame->len, .rtr = frame->rtr != 0};
    char line[SLCAN_FRAME];
    memcpy(out.data, frame->data, sizeof out.data);
    const unsigned count = slcan_format(&s->codec, &out, ms, line);
    if (count > 0 && !append_output(s, line, count)) {
        s->codec.flags |= SLCAN_TX_FULL;
        s->dropped++;
    }
}

static void close_bus(void *ctx)
{
    struct slcan_bus *s = ctx;
    flush_output(s);
    reset_session(s);
    if (s->listener >= 0) {
        close(s->listener);
    } else {
        close(s->slave);
    }
    if (s->client >= 0) {
        close(s->client);
    }
}

static struct slcan_bus *start(struct bus *bus, int listener, int client, int slave)
{
    static struct slcan_bus s;
    s.listener = listener;
    s.client = client;
    s.slave = slave;
    reset_session(&s);
    bus->ctx = &s;
    bus->before_poll = before_poll;
    bus->after_poll = after_poll;
    bus->receive = receive;
    bus->send = send_frame;
    bus->close = close_bus;
    return &s;
}

void bus_open_slcan_tcp(struct bus *bus, const char *address)
{
    char host[128] = "127.0.0.1", bound_host[64], bound_port[16];
    const char *colon = strrchr(address, ':');
    const char *port = colon == NULL ? address : colon + 1;
    char *end = NULL;
    const unsigned long number = strtoul(port, &end, 10);
    if (*port < '0' || *port > '9' || *end != '\0' || number > 65535 ||
        (colon != NULL && colon - address >= (int)sizeof host)) {
        fatal("--slcan-tcp %s: must be [HOST:]PORT with a port of 0..65535", address);
    }
    if (colon != NULL) {
        snprintf(host, sizeof host, "%.*s", (int)(colon - address), address);
    }
    const struct addrinfo hints = {.ai_family = AF_INET, .ai_socktype = SOCK_STREAM, .ai_flags = AI_PASSIVE};
    struct addrinfo *found = NULL;
    const int unknown = getaddrinfo(host, port, &hints, &found);
    if (unknown != 0) {
        fatal("--slcan-tcp %s: %s: %s", address, host, gai_strerror(unknown));
    }
    const int on = 1;
    const int listener = socket(AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (listener < 0 || setsockopt(listener, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on) != 0 ||
        bind(listener, found->ai_addr, found->ai_addrlen) != 0 || listen(listener, 4) != 0) {
        switch (errno) {
        case EADDRINUSE:
            fatal("port %s is in use: end what uses it, take another one, or 0 for any that is free", port);
        case EACCES: fatal("port %s: no permission; take one above 1023, or 0 for any that is free", port);
        case EADDRNOTAVAIL: fatal("%s is no address of this machine; leave it out to listen on 127.0.0.1", host);
        default: fatal("--slcan-tcp %s: %s", address, strerror(errno));
        }
    }
    freeaddrinfo(found);
    struct sockaddr_in bound = {0};
    socklen_t length = sizeof bound;
    getsockname(listener, (struct sockaddr *)&bound, &length);
    getnameinfo((struct sockaddr *)&bound, length, bound_host, sizeof bound_host, bound_port, sizeof bound_port,
                NI_NUMERICHOST | NI_NUMERICSERV);
    snprintf(bus->name, sizeof bus->name, "slcan socket://%s:%s", bound_host, bound_port);
    start(bus, listener, -1, -1);
}

void bus_open_slcan_pty(struct bus *bus)
{
    const int master = posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (master < 0 || grantpt(master) != 0 || unlockpt(master) != 0) {
        fatal("no pseudo-terminal can be had: %s; use --slcan-tcp instead", strerror(errno));
    }
    const char *name = ptsname(master);
    const int slave = open(name, O_RDWR | O_NOCTTY | O_CLOEXEC);
    struct termios raw;
    if (slave < 0 || tcgetattr(slave, &raw) != 0) {
        fatal("%s cannot be opened: %s; use --slcan-tcp instead", name, strerror(errno));
    }
    cfmakeraw(&raw);
    tcsetattr(slave, TCSANOW, &raw);
    fcntl(master, F_SETFL, O_NONBLOCK);
    snprintf(bus->name, sizeof bus->name, "slcan %s", name);
    start(bus, -1, master, slave);
}
