# SPDX-License-Identifier: Apache-2.0
"""A host in a process of its own, to be killed: streams knots and says "running" when half of them are executed and
WAITING of them are in the drive's queue.

python streamer.py BUS_OPTIONS_AS_JSON NODE KNOTS.npy WAITING FEED_OVERRIDE
"""

import json
import sys

import numpy as np

from kontur.can.bus import open_bus
from kontur.can.link import Link
from kontur.drive.device import Device
from kontur.drive.stream import Operator, stream

options, node_id, knots, waiting, override = sys.argv[1:]
with open_bus(json.loads(options)) as bus:
    device = Device(Link(bus, int(node_id)))
    told = False
    room = int(device.read("ip_buffer_x.size")) - int(waiting)

    def tell(share: float) -> None:
        global told
        status = device.link.status
        if share > 0.5 and not told and status is not None and status.free <= room:
            told = True
            print("running", flush=True)

    with device.axes.enabled():
        stream(device, np.load(knots), Operator(progress=tell, feed_override=lambda: float(override)))
