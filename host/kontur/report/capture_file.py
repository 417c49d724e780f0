# SPDX-License-Identifier: Apache-2.0
"""A capture of the drive's scope as a file: a picture (.png, .svg) or a table (.csv, .mf4)."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np

from kontur.can.signals import Signal
from kontur.drive.scope import Capture
from kontur.errors import FileError
from kontur.files import write_atomically
from kontur.runs.log import Mf4Channel, mf4_bytes

SUFFIXES = (".png", ".svg", ".csv", ".mf4")


def save(capture: Capture, file: str | Path) -> None:
    """Write as picture (.png, .svg) or table (.csv, .mf4). Raises FileError."""
    path = Path(file)
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise FileError(path, f"must end in {', '.join(SUFFIXES)}")
    if suffix == ".csv":
        write_atomically(path, csv_text(capture).encode())
    elif suffix == ".mf4":
        write_atomically(path, _mf4_bytes(capture))
    else:
        from kontur.report.scope_figure import picture  # brings matplotlib along

        write_atomically(path, picture(capture, suffix[1:]))


def csv_text(capture: Capture) -> str:
    """`# key: JSON` lines, a header row, one row a frame; time from the trigger."""
    head = ["# kontur scope 1", *(f"# {key}: {json.dumps(value)}" for key, value in _meta(capture).items())]
    head.append(",".join(["period", "time_s", *(signal.column_name for signal in capture.signals)]))
    period = capture.first_period + capture.periods * np.arange(len(capture.values))
    formats = ["%d", "%.6f", *(_number_format(signal) for signal in capture.signals)]
    out = io.StringIO()
    np.savetxt(out, np.column_stack([period, capture.time_s, capture.values]), fmt=formats, delimiter=",")
    return "\n".join(head) + "\n" + out.getvalue()


def _mf4_bytes(capture: Capture) -> bytes:
    channels = [Mf4Channel(s.name, s.unit, s.description) for s in capture.signals]
    return mf4_bytes("scope", _meta(capture), "scope", capture.time_s, channels, capture.values)


def _meta(capture: Capture) -> dict[str, object]:
    return {
        "control_hz": capture.control_hz,
        "trigger_period": capture.trigger_period,
        "trigger_frame": capture.trigger_frame,
        "fault": f"{capture.fault:04X}h" if capture.fault else None,
    }


def _number_format(signal: Signal) -> str:
    return f"%.{max(0, -int(np.floor(np.log10(signal.factor))))}f"
