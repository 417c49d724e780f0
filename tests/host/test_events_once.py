# SPDX-License-Identifier: Apache-2.0
"""After any stops, goings-on and feed overrides each event of a path has happened once, in its order, and no hold has
been passed over; what is passed while the path comes to a stop gets no power."""

import random

import numpy as np
import pytest

from kontur import machine
from kontur.can.link import Link
from kontur.drive.device import Device
from kontur.drive.stream import Operator, stream
from kontur.path import gcode
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.bounds import limits
from kontur.planning.outputs import Tool, of_words, words
from kontur.planning.planner import plan
from kontur.sim.bus import KonturBus

MACHINE = machine.load()
PLACES = 12


@pytest.mark.parametrize("seed", range(4))
def test_each_event_happens_once_whatever_stops_the_path(seed: int) -> None:
    """Each place of the path has a power of its own, rising, so the powers that are seen tell what has happened."""
    rng = random.Random(seed)
    hold = rng.randrange(2, PLACES - 2)
    lines = "".join(
        f"{'M0' if i == hold else ''} M67 E0 Q{50 * (i + 1)}\nG1 X{1.5 * (i + 1):g}\n" for i in range(PLACES)
    )
    t = plan(gcode.parse("G64 P0.01\nF3000\n" + lines, "a.ngc"), limits(MACHINE), tolerance_m=TOLERANCE_M)
    outputs = of_words(words(t, Tool(1000.0)))
    (at,) = outputs.holds
    stops = sorted([*rng.sample(range(60, len(t.knots_nm) - 60), 2), at - rng.randrange(40)])  # one around the hold
    asked, held_at = {"rate": 1.0}, set()

    def rate() -> float:
        if rng.random() < 0.02:
            asked["rate"] = rng.choice([0.0, 0.3, 0.7, 1.0, 1.2])
        return asked["rate"]

    def release(hold: int) -> bool:
        held_at.add(device.read("outputs.hold"))
        return rng.random() < 0.2

    with KonturBus(machine=MACHINE.starting_at((0.0, 0.0))) as bus:
        device = Device(Link(bus, 1))
        device.parameters.set({"limits.start_window": 1000.0})  # axes without power creep
        bus.sim.record(True)
        for number, stop in enumerate(stops):
            stopping = Operator(
                stop_requested=lambda s=stop: device.read("stream.executed") >= s,  # type: ignore[misc]
                feed_override=rate,
                release=release,
            )
            try:
                with device.axes.enabled():
                    result = stream(device, t.knots_nm, stopping, outputs=outputs, resume=number > 0)
                assert not result.completed
            except KeyboardInterrupt:  # the stop was asked for where the path is held
                assert device.read("outputs.hold") == at + 1
        with device.axes.enabled():
            going = Operator(feed_override=rate, release=release)
            assert stream(device, t.knots_nm, going, outputs=outputs, resume=True).completed
        assert device.read("outputs.changes") == len(outputs) == PLACES + 1
        assert device.read("outputs.checksum") == outputs.checksum
        assert held_at == {at + 1}
        truth = bus.sim.truth()
    power = np.rint(truth.power * 1000.0).astype(int)
    seen = power[power > 0]
    began = seen[np.insert(np.diff(seen) != 0, 0, True)]
    assert np.all(np.diff(began) > 0), began  # none comes twice
    assert power[-1] == 0
    off_mm = 1e3 * truth.pos_m[power == 0, 0]
    for place in range(PLACES):
        if 50 * (place + 1) not in began:  # it was passed while the path came to a stop: no power then (adr 70)
            for end_mm in (1.5 * place, 1.5 * (place + 1)):
                assert np.min(np.abs(off_mm - end_mm)) < 0.1, place
