# SPDX-License-Identifier: Apache-2.0
"""What a commissioning leaves to be filed: who the drive is, and the report of the proof."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib.metadata import version
from pathlib import Path

import numpy as np

from kontur.commissioning.prove import Candidate, Evidence, stops
from kontur.drive.device import Device
from kontur.drive.target import Target
from kontur.machine import told_text
from kontur.report.proof_page import Curve, write_proof_report


def facts(target: Target, device: Device) -> dict[str, str]:
    """Date, drive, firmware, bus, machine."""
    return {
        "date": datetime.now().astimezone().isoformat(timespec="seconds"),
        "drive": f"{device.read('device_name')}, node {target.node_id}, serial {device.read('identity.serial')}",
        "firmware": f"{device.read('software_version')}, build {device.read('build_id')}, numbers "
        f"{device.read('num_backend')}, control at {device.read('clock.control_hz')} Hz",
        "tools": version("kontur"),
        "bus": str(device.link.bus.channel_info),
        "machine": target.machine.name
        + (f" (simulated; the drive is {told_text(target.told)})" if target.in_process else ""),
    }


def write_report(
    path: Path,
    verdict: str,
    about: Mapping[str, str],
    evidence: Evidence,
    candidates: Sequence[Candidate],
    before: Mapping[str, float],
) -> None:
    """Write the report of a proof. `before`: parameters that the drive had. Raises FileError."""
    curves = {}
    for one in candidates:
        pair = []
        for measured, axis in zip(evidence.sensitivity[one.controller], one.axes, strict=True):
            predicted = 1.0 / np.abs(1.0 + axis.loops[0])
            pair.append(
                Curve(measured.hz, np.abs(measured.sensitivity), measured.sensitivity_sigma, axis.hz, predicted)
            )
        curves[one.controller] = (pair[0], pair[1])
    changed = [
        {"parameter": name, "before": before.get(name, "-"), "after": value}
        for name, value in candidates[0].parameters.items()
        if before.get(name) != value
    ]
    rows = [
        {key: value for key, value in one.as_json().items() if not key.endswith("_stopped")} for one in evidence.proof
    ]
    write_proof_report(path, verdict, about, rows, curves, evidence.circles, changed, stops(evidence.proof))
