/* SPDX-License-Identifier: Apache-2.0 */
/* slcan.h: CAN frames as lines of text over a serial line. This is the ASCII protocol of Lawicel's CAN232 ("CAN232
 * manual", 2002), which python-can's `slcan`, Linux's slcand and most USB adapters use. Here the drive itself is at
 * the other end of the line: a frame written to the line is a frame that the drive receives.
 *
 * It is a codec: bytes in, frames and answers out, without I/O or allocation.
 *
 * Context: the process kontur-sim uses it on a TCP socket or a pseudo-terminal (linux/slcan_bus.c), and a board on
 * its serial port, in the background loop (stm32f405/bus.c). A struct slcan has one user at a time.
 *
 * A line ends in CR, LF, or both. Hex digits may be of either case.
 *   tiiildd..  riiil   data and remote frame with an 11-bit identifier: received while the channel is open, and not
 *                      answered (the manual's answer `z` costs a host up to half of its throughput; hosts ignore it)
 *   T R  d D b B       frames with 29-bit identifiers, and of CAN FD: ignored while the channel is open, as on a bus,
 *                      because classic CANopen has none; what they say is not looked at
 *   O L C              open, open to listen only (frames are sent to the host, none is received from it), and close;
 *                      accepted in every state
 *   S0..S8, sxxyy      bit rate and bit timing: accepted while closed, without effect, because the line has no bus
 *   F V N              status flags, version, serial number
 *   Z0 Z1              time stamps off or on: milliseconds modulo 60000 at the end of each frame sent
 *   Mxxxxxxxx mxxxxxxxx  acceptance filter: accepted, without effect
 * The answer to an empty line and to an accepted command is CR. The answer to anything else is BEL, and it is
 * counted. A line that is too long gets one BEL.
 *
 * Differences from the manual: frames are not answered (see above); O, L, C and Z are accepted in every state,
 * because hosts rely on it.
 */
#ifndef KONTUR_SLCAN_H
#define KONTUR_SLCAN_H
#include <stdbool.h>
#include <stdint.h>

#include "hal/hal.h"

enum {
    SLCAN_LINE = 32,  /* longest line without its CR; the longest command or frame has 21 bytes */
    SLCAN_ANSWER = 6, /* longest answer to a byte */
    SLCAN_FRAME = 26  /* longest line of a frame sent */
};

/* Status flags. The command F reads and clears them. */
enum slcan_flag {
    SLCAN_RX_FULL = 0x01,
    SLCAN_TX_FULL = 0x02,
    SLCAN_WARNING = 0x04,
    SLCAN_OVERRUN = 0x08,
    SLCAN_PASSIVE = 0x20,
    SLCAN_BUS_ERROR = 0x80,
};

enum slcan_event { SLCAN_NOTHING, SLCAN_HAS_FRAME, SLCAN_OPENED, SLCAN_CLOSED };

struct slcan {
    char line[SLCAN_LINE];
    uint8_t count; /* bytes of the line so far; SLCAN_LINE + 1: the line is too long */
    bool open;
    bool listen_only;
    bool stamps;
    uint8_t flags;    /* enum slcan_flag; the user sets them */
    uint16_t serial;  /* answer to N */
    uint32_t refused; /* lines answered BEL */
};

struct slcan_answer {
    uint8_t count;
    char text[SLCAN_ANSWER];
};

/* Start closed and without time stamps. */
void slcan_init(struct slcan *s, uint16_t serial);
/* Parse one byte of the line. *answer is the text to write back; its
 * count may be 0. With SLCAN_HAS_FRAME, *frame is a frame received. */
enum slcan_event slcan_parse(struct slcan *s, char byte, struct can_frame *frame, struct slcan_answer *answer);
/* Format `frame` as a line in `out`, which has SLCAN_FRAME bytes. `ms` is the time for the stamp. Returns the
 * length of the line, which is 0 while the channel is closed. */
unsigned slcan_format(const struct slcan *s, const struct can_frame *frame, uint32_t ms, char *out);
#endif
