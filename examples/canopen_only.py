#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""A Kontur drive in the hands of any CANopen master: python-canopen, python-can and the EDS, nothing else.

Brings both axes to operation enabled, drives a circle by 60C1h/68C1h (interpolated position) and one by the lossless
knot stream, reads the EMCY history, and switches off. Without options it runs against the simulated drive.

    python examples/canopen_only.py -i socketcan -c can0

The axes move: a circle of 4 mm diameter to the left of where they stand.
"""

import argparse
import logging
import math
import struct
import sys
import threading
import time
import zlib
from pathlib import Path

import canopen
from canopen.profiles.p402 import BaseNode402

EDS = Path(__file__).resolve().parents[1] / "host" / "kontur" / "kontur.eds"
HOST_NODE_ID = 127
RADIUS_NM = 2_000_000
LAP_S = 2.0
REST = 3  # equal points at both ends: a path starts and ends at rest
RECORD_MS = 10
RECORD_LAG_MS = 600  # a thread of Python is late now and then, by much on a busy machine; 600 is the most
WINDOW = 63  # knots on their way: their numbers count to 256
RESEND_S = 0.1
STATE_S, MOTION_S = 5.0, 60.0  # longer than these nothing is waited for

ENABLE, ENABLE_IP = 0x0F, 0x1F  # controlwords; bit 4 lets the path run
IP_ACTIVE, TARGET_REACHED = 1 << 12, 1 << 10  # bits of the statuswords


class TwoAxes(BaseNode402):
    """BaseNode402 knows one axis, at 6040h/6041h; the other one is 800h further on, in the same PDOs.

    Both axes get every controlword, and the statusword that counts is that of the axis that is behind.
    """

    @property
    def controlword(self):
        raise RuntimeError("write-only")

    @controlword.setter
    def controlword(self, value):
        pdo = self.rpdo[1]
        pdo["controlword_x"].raw = pdo["controlword_y"].raw = value
        pdo.transmit()

    @property
    def statusword(self):
        x, y = self.tpdo_values[0x6041], self.tpdo_values[0x6841]
        return y if x & 0x6F == 0x27 else x

    def path_runs(self):
        return bool(self.tpdo_values[0x6041] & self.tpdo_values[0x6841] & IP_ACTIVE)

    def path_is_done(self):
        return bool(self.tpdo_values[0x6041] & self.tpdo_values[0x6841] & TARGET_REACHED)


class Progress:
    """Free slots and accepted knots, from TPDO1."""

    def __init__(self, pdo):
        self.came = threading.Event()
        self.free = self.accepted = 0
        pdo.add_callback(self._on_pdo)

    def _on_pdo(self, pdo):
        self.free, self.accepted = pdo["stream.free"].raw, pdo["stream.accepted16"].raw
        self.came.set()

    def next(self):
        self.came.clear()
        if not self.came.wait(1.0):
            raise TimeoutError("no TPDO1 for 1 s: is the drive still there, and operational?")


def wait_for(condition, seconds, what):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(f"{what}, {seconds:g} s waited")
        time.sleep(0.005)


def circle(start_nm, period_s):
    """One lap, a point each `period_s`, that starts and ends at rest at `start_nm`."""
    count = round(LAP_S / period_s)
    points = [start_nm] * REST
    for i in range(1, count):
        u = i / count
        angle = 2.0 * math.pi * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
        points.append(
            (
                start_nm[0] + round(RADIUS_NM * (math.cos(angle) - 1.0)),
                start_nm[1] + round(RADIUS_NM * math.sin(angle)),
            )
        )
    return points + [start_nm] * (REST + 1)


def crc8(data):
    """CRC-8/AUTOSAR."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x2F) & 0xFF if crc & 0x80 else crc << 1
    return crc ^ 0xFF


def knot_frames(points, start_nm):
    """Sequence, CRC, and the differences to the point before, 24 bits each."""
    frames = []
    for i, ((x, y), (x0, y0)) in enumerate(zip(points, [start_nm, *points[:-1]], strict=True)):
        body = (x - x0).to_bytes(3, "little", signed=True) + (y - y0).to_bytes(3, "little", signed=True)
        sequence = bytes([i & 0xFF])
        frames.append(sequence + bytes([crc8(sequence + body)]) + body)
    return frames


def by_records(node, progress, start_nm):
    """60C1h/68C1h: absolute points, one each RECORD_MS; the drive's queue has room for a second of them."""
    for axis in ("x", "y"):
        node.sdo[f"ip_period_{axis}"]["value"].raw = RECORD_MS
    pdo = node.rpdo[3]

    def send(point):
        progress.next()
        end = time.monotonic() + MOTION_S
        while progress.free < 8 * RECORD_MS:  # those on their way are not counted yet
            if time.monotonic() > end:
                raise TimeoutError("the drive takes no more records")
            progress.next()
        pdo["ip_record_x.position"].raw, pdo["ip_record_y.position"].raw = point
        pdo.transmit()

    ahead = 100  # records; the path starts with a second of them
    for i, point in enumerate(circle(start_nm, RECORD_MS * 1e-3)):
        send(point)
        if i == ahead:
            node.controlword = ENABLE_IP
            wait_for(node.path_runs, STATE_S, "the path does not start")
    stream = node.sdo["stream"]
    stream["total"].raw = stream["accepted"].raw  # that was all: such a path has no end of its own
    wait_for(node.path_is_done, MOTION_S, "the circle does not end")
    node.controlword = ENABLE


def by_knots(node, progress, start_nm):
    """The lossless stream: go back to the knot that the drive expects when it does not get on."""
    points = circle(start_nm, 1e-3)
    stream = node.sdo["stream"]
    stream["total"].raw = len(points)
    stream["start_x"].raw, stream["start_y"].raw = start_nm
    stream["command"].raw = 1
    frames, cob_id = knot_frames(points, start_nm), node.rpdo[2].cob_id
    accepted = sent = 0
    running = False
    heard = time.monotonic()
    progress.next()
    while accepted < len(frames):
        for frame in frames[sent : min(accepted + min(progress.free, WINDOW), sent + 16)]:
            node.network.send_message(cob_id, frame)
            sent += 1
        progress.next()
        newly = progress.accepted - accepted & 0xFFFF
        if 0 < newly <= sent - accepted:
            accepted += newly
            heard = time.monotonic()
        elif time.monotonic() - heard > RESEND_S:
            sent, heard = accepted, time.monotonic()  # lost, or no room: the queue is full before the path runs
        if not running and (progress.free == 0 or accepted >= 500):
            node.controlword = ENABLE_IP
            running = True
    wait_for(node.path_is_done, MOTION_S, "the circle does not end")
    node.controlword = ENABLE
    want = zlib.crc32(b"".join(struct.pack("<ii", *point) for point in points))
    if (stream["executed"].raw, stream["checksum"].raw) != (len(points), want):
        raise RuntimeError("the drive went through other knots than were sent")


def stand(node):
    return node.sdo["stream"]["end_x"].raw, node.sdo["stream"]["end_y"].raw


def drive(network, node_id, eds):
    node = TwoAxes(node_id, str(eds))
    network.add_node(node)
    node.sdo.RESPONSE_TIMEOUT = 2.0  # a slow machine is no reason to give up
    emergencies = []
    node.emcy.add_callback(emergencies.append)

    network.send_periodic(0x700 + HOST_NODE_ID, [5], 0.1)  # our heartbeat: when it ceases, the drive stops on the path
    node.nmt.state = "PRE-OPERATIONAL"
    print(f"{node.sdo[0x1008].raw}, firmware {node.sdo['build_id'].raw}")
    node.setup_402_state_machine()
    node.sdo["heartbeat_consumer"][1].raw = HOST_NODE_ID << 16 | 500
    node.sdo["record_lag"].raw = RECORD_LAG_MS
    progress = Progress(node.tpdo[1])
    node.nmt.state = "OPERATIONAL"
    progress.next()

    node.op_mode = "INTERPOLATED POSITION"
    node.sdo["mode_y"].raw = node.sdo["mode_x"].raw
    node.state = "OPERATION ENABLED"
    print(f"both axes: {node.state.lower()}")
    try:
        for name, way in (("60C1h/68C1h", by_records), ("knots", by_knots)):
            way(node, progress, stand(node))
            print(f"circle by {name}: done, {node.sdo['stream']['executed'].raw} ms of path")
    finally:
        node.controlword = 0x07  # stops on the path, if one runs, then switches off
        node.state = "SWITCH ON DISABLED"
        node.sdo["heartbeat_consumer"][1].raw = 0
        print(f"both axes: {node.state.lower()}")
        history = [node.sdo["error_history"][i + 1].raw for i in range(node.sdo["error_history"][0].raw)]
        print("EMCY received:", ", ".join(f"{e.code:04X}h" for e in emergencies) or "none")
        print("EMCY history: ", ", ".join(f"{entry & 0xFFFF:04X}h" for entry in history) or "none")


def main():
    logging.getLogger("canopen").setLevel(logging.ERROR)  # that modes go by SDO is meant
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-i", "--interface", default="kontur", help="python-can's interface (default: simulated drive)")
    parser.add_argument("-c", "--channel", default="sim", help="python-can's channel")
    parser.add_argument("-b", "--bitrate", type=int, default=1_000_000)
    parser.add_argument("--node", type=int, default=1, help="CANopen node id")
    parser.add_argument("--eds", type=Path, default=EDS)
    arguments = parser.parse_args()
    options = {"interface": arguments.interface, "channel": arguments.channel, "bitrate": arguments.bitrate}
    if arguments.interface == "kontur":
        options["pace"] = "clock"  # python-canopen receives in a thread of its own
    network = canopen.Network()
    network.connect(**options)
    try:
        drive(network, arguments.node, arguments.eds)
    finally:
        network.disconnect()


if __name__ == "__main__":
    sys.exit(main())
