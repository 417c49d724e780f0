# SPDX-License-Identifier: Apache-2.0
"""Kontur: host tools of a contouring drive. This is the face: what a script needs, by one import.

    import kontur

    machine = kontur.load_machine()
    program = kontur.load_path("examples/part.ngc")
    trajectory = kontur.plan(program, kontur.limits(machine), travel_m=machine.soft_limits_m)
    result = kontur.run(trajectory, "ccu", kontur.Target(machine))
    print(kontur.summary(result.log))

Names are imported when they are first used, so `import kontur` costs nothing. All errors are `kontur.KonturError`s.

docs/python.md shows how it is used. The rest is in rooms. docs/architecture.md says what each room holds and which
others it may import.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from kontur.can.bad_bus import BusFaults as BusFaults
    from kontur.can.bus import open_bus as open_bus
    from kontur.can.emcy import describe_emcy as describe_emcy
    from kontur.drive.controllers import CONTROLLERS as CONTROLLERS
    from kontur.drive.device import Device as Device
    from kontur.drive.scope import Capture as Capture
    from kontur.drive.scope import Setup as ScopeSetup
    from kontur.drive.scope import trigger as scope_trigger
    from kontur.drive.stream import Operator as Operator
    from kontur.drive.stream import stream as stream
    from kontur.drive.target import Target as Target
    from kontur.drive.target import open_drive as open_drive
    from kontur.errors import KonturError as KonturError
    from kontur.machine import Machine as Machine
    from kontur.machine import load as load_machine
    from kontur.path import shapes as shapes
    from kontur.path.geometry import Arc as Arc
    from kontur.path.geometry import Curve as Curve
    from kontur.path.geometry import Dwell as Dwell
    from kontur.path.geometry import Line as Line
    from kontur.path.geometry import Move as Move
    from kontur.path.geometry import Program as Program
    from kontur.path.programs import load as load_path
    from kontur.planning.bounds import Limits as Limits
    from kontur.planning.bounds import limits as limits
    from kontur.planning.planner import Trajectory as Trajectory
    from kontur.planning.planner import plan as plan
    from kontur.report.capture_file import save as write_capture
    from kontur.report.page import write_report as write_report
    from kontur.runs.log import RunLog as RunLog
    from kontur.runs.log import read as read_log
    from kontur.runs.log import write as write_log
    from kontur.runs.runner import RunOptions as RunOptions
    from kontur.runs.runner import RunResult as RunResult
    from kontur.runs.runner import run as run
    from kontur.runs.summary import summary as summary

    __version__: str

# Where each name is defined: module, and the name there if it is another one.
_WHERE = {
    "CONTROLLERS": "kontur.drive.controllers",
    "Arc": "kontur.path.geometry",
    "BusFaults": "kontur.can.bad_bus",
    "Capture": "kontur.drive.scope",
    "Curve": "kontur.path.geometry",
    "Device": "kontur.drive.device",
    "Dwell": "kontur.path.geometry",
    "KonturError": "kontur.errors",
    "Limits": "kontur.planning.bounds",
    "Line": "kontur.path.geometry",
    "Machine": "kontur.machine",
    "Move": "kontur.path.geometry",
    "Operator": "kontur.drive.stream",
    "Program": "kontur.path.geometry",
    "RunLog": "kontur.runs.log",
    "RunOptions": "kontur.runs.runner",
    "RunResult": "kontur.runs.runner",
    "ScopeSetup": "kontur.drive.scope:Setup",
    "Target": "kontur.drive.target",
    "Trajectory": "kontur.planning.planner",
    "describe_emcy": "kontur.can.emcy",
    "limits": "kontur.planning.bounds",
    "load_machine": "kontur.machine:load",
    "load_path": "kontur.path.programs:load",
    "open_bus": "kontur.can.bus",
    "open_drive": "kontur.drive.target",
    "plan": "kontur.planning.planner",
    "read_log": "kontur.runs.log:read",
    "run": "kontur.runs.runner",
    "scope_trigger": "kontur.drive.scope:trigger",
    "shapes": "kontur.path",
    "stream": "kontur.drive.stream",
    "summary": "kontur.runs.summary",
    "write_capture": "kontur.report.capture_file:save",
    "write_log": "kontur.runs.log:write",
    "write_report": "kontur.report.page",
}

__all__ = [
    "CONTROLLERS",
    "Arc",
    "BusFaults",
    "Capture",
    "Curve",
    "Device",
    "Dwell",
    "KonturError",
    "Limits",
    "Line",
    "Machine",
    "Move",
    "Operator",
    "Program",
    "RunLog",
    "RunOptions",
    "RunResult",
    "ScopeSetup",
    "Target",
    "Trajectory",
    "__version__",
    "describe_emcy",
    "limits",
    "load_machine",
    "load_path",
    "open_bus",
    "open_drive",
    "plan",
    "read_log",
    "run",
    "scope_trigger",
    "shapes",
    "stream",
    "summary",
    "write_capture",
    "write_log",
    "write_report",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("kontur")
    if name not in _WHERE:
        raise AttributeError(f"module 'kontur' has no attribute {name!r}")
    module, _, original = _WHERE[name].partition(":")
    if module == "kontur.path":
        return importlib.import_module(f"{module}.{name}")
    return getattr(importlib.import_module(module), original or name)


def __dir__() -> list[str]:
    return __all__
