/* SPDX-License-Identifier: Apache-2.0 */
/* slcan.h: CAN frames as lines of text over a serial line, the ASCII protocol of Lawicel's CAN232 ("CAN232 manual",
 * 2002), which python-can's `slcan`, Linux's slcand and most USB adapters speak. Here the drive itself is at the
 * other end of the line: frames written to it are frames that the node receives.
 *
 * A codec alone: bytes in, frames and answers out; no I/O, no allocation. Used by the Linux process on a TCP socket
 * or a pseudo-terminal and by a board on its USART. One user at a time, from the background loop.
 *
 * A line ends in CR; LF is passed over. Hex digits may be of either case.
 *   tiiildd..  riiil   data and remote frame, 11-bit identifier: taken when open, and not answered (the manual's `z`
 *                      costs a host up to half of its throughput, and none of them looks at it)
 *   T R                frames with 29-bit identifiers: refused, classic CANopen has none
 *   O L C              open, open to listen only (frames are sent to the host, none taken from it), close; also when
 *                      it is so already
 *   S0..S8, sxxyy      bit rate, bit timing: accepted when closed; there is no bus whose rate could be set
 *   F V N              status flags, version, serial number
 *   Z0 Z1              time stamps: milliseconds modulo 60000 behind each frame sent
 *   Mxxxxxxxx mxxxxxxxx  acceptance filter: accepted, without effect
 * An empty line is answered CR. What is understood is answered CR, anything else BEL, and counted. A line that is too
 * long is refused as a whole.
 *
 * Differences from the manual: no answer to frames (above); O, L, C and Z are accepted in any state, as hosts rely on
 * it.
 */
#ifndef KONTUR_SLCAN_H
#define KONTUR_SLCAN_H
#include <stdbool.h>
#include <stdint.h>

#include "hal/hal.h"

enum {
    SLCAN_LINE = 32,  /* longest line taken, CR not counted; the longest with a meaning has 21 */
    SLCAN_ANSWER = 6, /* most bytes that one byte in is answered with */
    SLCAN_FRAME = 26  /* most bytes of one frame out */
};

/* Status flags of the command F, which clears them. */
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
    uint8_t count; /* bytes of the line so far; SLCAN_LINE + 1: too many */
    bool open;
    bool listen_only;
    bool stamps;
    uint8_t flags;    /* enum slcan_flag; set by the owner */
    uint16_t serial;  /* answer to N */
    uint32_t refused; /* lines answered BEL */
};

struct slcan_answer {
    uint8_t count;
    char text[SLCAN_ANSWER];
};

/* As after power-on: closed, no stamps. */
void slcan_init(struct slcan *s, uint16_t serial);
/* Take one byte. Whatever it is, *answer holds what to write back (count 0: nothing). SLCAN_HAS_FRAME: *frame is a
 * valid frame. */
enum slcan_event slcan_take(struct slcan *s, char byte, struct can_frame *frame, struct slcan_answer *answer);
/* Write `frame` as a line to `out`, SLCAN_FRAME bytes; returns how many, 0 while closed. ms: time, for the stamp. */
unsigned slcan_line(const struct slcan *s, const struct can_frame *frame, uint32_t ms, char *out);
#endif
