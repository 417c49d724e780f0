# SPDX-License-Identifier: Apache-2.0
"""A planning that waits on its way until a test lets it go on, and a drive that outlives the runs."""

import threading

import pytest

from kontur import machine
from kontur.drive import knot_sender
from kontur.drive.state_machine import BIT_PATH_RUNS
from kontur.drive.target import Target, open_drive
from kontur.errors import PathError
from kontur.path.smoothing import TOLERANCE_M
from kontur.planning.ahead import Ahead
from kontur.planning.bounds import limits
from kontur.planning.planner import Planning
from kontur.sim import process as sim_process

MACHINE = machine.load()
LIMITS = limits(MACHINE)
_WAITING = 2  # knots whose outputs are not known before the next ones


class Gate:
    """A planning that waits after the step that has brought so many `knots`, `waits` until `opened` is set; `fails`
    then."""

    def __init__(self, program, fails=False, knots=0):
        self.planning = Planning(program, LIMITS, tolerance_m=TOLERANCE_M)
        self.waits, self.opened, self.fails, self.knots = threading.Event(), threading.Event(), fails, knots
        self.steps = self.planning.steps
        self.planning.steps = self._steps

    def _steps(self):
        for _ in self.steps():
            yield
            if self.planning.rows.count >= self.knots and not self.waits.is_set():
                self.waits.set()
                assert self.opened.wait(300.0)
                if self.fails:
                    raise PathError("p.ngc:7: it cannot be planned")


def opened_on_the_way(gate, monkeypatch):
    """The path of a gate that opens when the drive moves, and has accepted all that is planned; and a list of the
    stream's total before that."""
    written = []
    advance = knot_sender.KnotSender.advance

    def advanced(sender):
        moves = sender.device.axes.both(BIT_PATH_RUNS)
        if moves and sender.accepted >= len(planned_so_far) - _WAITING and not gate.opened.is_set():
            written.append(sender.device.read_stable("stream.total"))
            gate.opened.set()
            ahead.ended()
        advance(sender)

    monkeypatch.setattr(knot_sender.KnotSender, "advance", advanced)
    ahead = Ahead(gate.planning)
    assert gate.waits.wait(300.0)
    planned_so_far = ahead.knots_nm
    return ahead, written


def all_planned_when_it_moves(started, monkeypatch):
    """The drive's time, which passes with SYNC, waits for the planning of the last path of `started` when that moves:
    on a busy machine it would run out of knots."""
    advance = knot_sender.KnotSender.advance

    def advanced(sender):
        if sender.device.axes.both(BIT_PATH_RUNS):
            started[-1].ended()
        advance(sender)

    monkeypatch.setattr(knot_sender.KnotSender, "advance", advanced)


def kept_drive():
    """A drive as a process, which stays when a run has ended; its time passes with SYNC."""
    if not sim_process.PROGRAM.exists():
        pytest.skip("kontur-sim is not built; run `make lib`")
    with sim_process.start(slcan_tcp="0", pace="sync", machine=MACHINE) as sim:
        target = Target(machine=MACHINE, bus={"interface": sim.interface, "channel": sim.channel})
        with open_drive(target) as device, device.master.held():
            device.parameters.set(MACHINE.parameters(1))
        yield target
