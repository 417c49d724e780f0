/* SPDX-License-Identifier: Apache-2.0 */
/* slcan_bus.c: a bus (bus.h) of slcan lines (slcan.h) over TCP, or over a pseudo-terminal. The clients of the TCP socket
 * share one bus: each receives the frames of the drive and of the others. None can keep the others from it: each has its
 * turn to send a frame, one that does not read loses frames, and one more than there are places for takes the place of
 * the client that has been silent longest. The loop of the process kontur-sim calls it. */
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
enum { CLIENTS = BUS_FDS - 1, IN_BYTES = 4096, OUT_BYTES = 131072, SOCKET_BYTES = 131072 };

struct client {
    struct slcan codec;
    int fd;         /* -1: none */
    uint64_t heard; /* when it has connected or sent something last */
    uint32_t dropped;
    unsigned in_at, in_count, out_count;
    char in[IN_BYTES], out[OUT_BYTES];
};

struct slcan_bus {
    int listener;   /* -1: the bus is a pseudo-terminal, whose user is the first client */
    int slave;      /* open as long as the process runs, so that the terminal outlives its users */
    uint64_t heard; /* counts what is heard of clients */
    unsigned turn;  /* of this client */
    struct client client[CLIENTS];
};

static void reset_session(struct client *c)
{
    if (c->dropped > 0) {
        print_message("%u frames were dropped, since the client did not read them", c->dropped);
    }
    slcan_init(&c->codec, 0);
    c->dropped = 0;
    c->in_at = c->in_count = c->out_count = 0;
}

static void hang_up(struct client *c)
{
    close(c->fd);
    c->fd = -1;
    reset_session(c);
}

static void flush_output(const struct slcan_bus *s, struct client *c)
{
    while (c->fd >= 0 && c->out_count > 0) {
        const ssize_t done = write(c->fd, c->out, c->out_count);
        if (done < 0) {
            if (errno == EINTR) {
                continue;
            }
            if (errno != EAGAIN && s->listener >= 0) {
                hang_up(c);
            }
            return;
        }
        c->out_count -= (unsigned)done;
        memmove(c->out, &c->out[done], c->out_count);
    }
}

/* Append a line to the output completely, or not at all: false. */
static bool append_output(const struct slcan_bus *s, struct client *c, const char *text, unsigned count)
{
    if (c->out_count + count > OUT_BYTES) {
        flush_output(s, c);
    }
    if (c->fd < 0 || c->out_count + count > OUT_BYTES) {
        return false;
    }
    memcpy(&c->out[c->out_count], text, count);
    c->out_count += count;
    return true;
}

/* Send a frame to all clients but `sender`. NULL: it is the drive's. */
static void put_frame(struct slcan_bus *s, const struct client *sender, const struct can_frame *frame, uint32_t ms)
{
    for (struct client *c = s->client; c < &s->client[CLIENTS]; c++) {
        char line[SLCAN_FRAME];
        const unsigned count = c != sender && c->fd >= 0 ? slcan_format(&c->codec, frame, ms, line) : 0;
        if (count > 0 && !append_output(s, c, line, count)) {
            c->codec.flags |= SLCAN_TX_FULL;
            c->dropped++;
        }
    }
}

static unsigned before_poll(void *ctx, struct pollfd *fds)
{
    struct slcan_bus *s = ctx;
    unsigned count = 0;
    if (s->listener >= 0) {
        fds[count++] = (struct pollfd){.fd = s->listener, .events = POLLIN};
    }
    for (struct client *c = s->client; c < &s->client[CLIENTS]; c++) {
        flush_output(s, c);
        if (c->fd >= 0) {
            const short out = c->out_count > 0 ? POLLOUT : 0;
            fds[count++] = (struct pollfd){.fd = c->fd, .events = (short)(POLLIN | POLLRDHUP | out)};
        }
    }
    return count;
}

/* A place for a new client: a free one, or that of the client that has been silent longest. */
static struct client *make_place(struct slcan_bus *s)
{
    static const char told[] =
        "kontur-sim: a new client takes the place of this one, which has been silent longest\r\n";
    struct client *longest = s->client;
    for (struct client *c = s->client; c < &s->client[CLIENTS]; c++) {
        if (c->fd < 0) {
            return c;
        }
        if (c->heard < longest->heard) {
            longest = c;
        }
    }
    (void)!write(longest->fd, told, sizeof told - 1);
    hang_up(longest);
    return longest;
}

static void after_poll(void *ctx, const struct pollfd *fds, unsigned count)
{
    struct slcan_bus *s = ctx;
    if (s->listener < 0 || count == 0 || fds[0].revents == 0) {
        return;
    }
    for (unsigned i = 1; i < count; i++) {
        if ((fds[i].revents & (POLLRDHUP | POLLHUP | POLLERR)) != 0) {
            return; /* this client has gone, but its last frames are not read yet: the next client waits */
        }
    }
    const int fd = accept4(s->listener, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd < 0) {
        return;
    }
    const int on = 1, bytes = SOCKET_BYTES;
    setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &bytes, sizeof bytes);
    struct client *c = make_place(s);
    c->fd = fd;
    c->heard = ++s->heard;
}

/* Read what the client has sent. false: there is nothing to read. */
static bool read_input(struct slcan_bus *s, struct client *c)
{
    if (c->fd < 0) {
        return false;
    }
    const ssize_t got = read(c->fd, c->in, sizeof c->in);
    if (got <= 0) {
        if (s->listener >= 0 && (got == 0 || (errno != EAGAIN && errno != EINTR))) {
            hang_up(c);
        }
        return false;
    }
    if (s->listener >= 0) {
        /* A client that writes frame by frame (pyserial) waits for each acknowledgement (Nagle's algorithm), which must
         * therefore not be delayed. */
        const int on = 1;
        setsockopt(c->fd, IPPROTO_TCP, TCP_QUICKACK, &on, sizeof on);
    }
    c->heard = ++s->heard;
    c->in_at = 0;
    c->in_count = (unsigned)got;
    return true;
}

/* The next frame in what the client has sent; answers go back to it. It reads once at most, so that a client whose text
 * has no end, and no frames, does not keep the others waiting. */
static bool next_frame(struct slcan_bus *s, struct client *c, struct can_frame *frame)
{
    if (c->in_at == c->in_count && !read_input(s, c)) {
        return false;
    }
    while (c->in_at < c->in_count) {
        struct slcan_answer answer;
        const enum slcan_event event = slcan_parse(&c->codec, c->in[c->in_at++], frame, &answer);
        if (s->listener < 0 && (event == SLCAN_OPENED || event == SLCAN_CLOSED)) {
            c->out_count = 0; /* frames that were meant for the user before */
            tcflush(s->slave, TCIFLUSH);
        }
        (void)append_output(s, c, answer.text, answer.count);
        if (event == SLCAN_HAS_FRAME) {
            return true;
        }
    }
    return false;
}

static bool receive(void *ctx, struct ks_frame *frame, uint32_t ms)
{
    struct slcan_bus *s = ctx;
    for (unsigned i = 0; i < CLIENTS; i++) {
        struct client *c = &s->client[s->turn];
        struct can_frame got;
        s->turn = (s->turn + 1) % CLIENTS;
        if (next_frame(s, c, &got)) {
            put_frame(s, c, &got, ms);
            *frame = (struct ks_frame){.id = got.id, .len = got.len, .rtr = got.rtr};
            memcpy(frame->data, got.data, sizeof frame->data);
            return true;
        }
    }
    return false;
}

static void send_frame(void *ctx, const struct ks_frame *frame, uint32_t ms)
{
    struct can_frame out = {.id = (uint16_t)frame->id, .len = frame->len, .rtr = frame->rtr != 0};
    memcpy(out.data, frame->data, sizeof out.data);
    put_frame(ctx, NULL, &out, ms);
}

static void close_bus(void *ctx)
{
    struct slcan_bus *s = ctx;
    for (struct client *c = s->client; c < &s->client[CLIENTS]; c++) {
        flush_output(s, c);
        if (c->fd >= 0) {
            hang_up(c);
        }
    }
    close(s->listener >= 0 ? s->listener : s->slave);
}

static void start(struct bus *bus, int listener, int client, int slave)
{
    static struct slcan_bus s;
    s.listener = listener;
    s.slave = slave;
    for (unsigned i = 0; i < CLIENTS; i++) {
        s.client[i].fd = -1;
        reset_session(&s.client[i]);
    }
    s.client[0].fd = client;
    bus->ctx = &s;
    bus->before_poll = before_poll;
    bus->after_poll = after_poll;
    bus->receive = receive;
    bus->send = send_frame;
    bus->close = close_bus;
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
