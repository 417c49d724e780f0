# SPDX-License-Identifier: Apache-2.0
"""What `kontur bode` shows of a measured response: rows, margins, CSV."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from kontur.commissioning.response import Response

MARGINS = {
    "gain": "gain margin",
    "phase_deg": "phase margin °",
    "delay_ms": "delay margin ms",
    "crossover_Hz": "crossover Hz",
    "bandwidth_Hz": "|S| < 1/2 up to Hz",
}


def margins(found: Response) -> dict[str, float | None]:
    """Margins of the measured loop, between its points; None where the band does not show one.

    `ms`, `ms_at_Hz`: largest sensitivity. `gain`: factor to instability, upwards. `phase_deg`, `delay_ms`: least of all
    crossovers. `crossover_Hz`: the highest frequency with |L| = 1. `bandwidth_Hz`: up to it |S| < 1/2.
    """
    from kontur.design import loop

    open_loop = found.open_loop
    m = loop.margins(loop.Grid.at(found.hz, round(4.0 * float(found.hz[-1]))), open_loop[None, :], ((1.0, 1.0),))
    values = {
        "ms": m.ms,
        "ms_at_Hz": m.ms_at_Hz,
        "gain": m.gain,
        "phase_deg": m.phase_deg,
        "delay_ms": m.delay_s * 1e3,
        "crossover_Hz": m.crossover_Hz,
        "bandwidth_Hz": m.bandwidth_Hz,
    }
    return {name: value if math.isfinite(value) and value > 0.0 else None for name, value in values.items()}


def points(found: Response) -> list[dict[str, Any]]:
    """One row a frequency: complex numbers as [real, imaginary], with their standard deviations."""
    second = bool(np.any(found.plant[1]))
    rows = []
    for i, hz in enumerate(found.hz):
        row = {
            "hz": float(hz),
            "plant_m_per_N": _pair(found.plant[0, i]),
            "plant_sigma": float(found.plant_sigma[0, i]),
            "sensitivity": _pair(found.sensitivity[i]),
            "sensitivity_sigma": float(found.sensitivity_sigma[i]),
            "loop": _pair(found.open_loop[i]),
            "loop_sigma": float(found.open_loop_sigma[i]),
            "coherence": float(found.coherence[i]),
        }
        if second:
            row |= {"second_m_per_N": _pair(found.plant[1, i]), "second_sigma": float(found.plant_sigma[1, i])}
        rows.append(row)
    return rows


def rows(found: Response) -> list[dict[str, float]]:
    """The same for people."""
    phase = np.degrees(np.unwrap(np.angle(found.plant[0])))
    return [
        {
            "hz": float(hz),
            "plant_um_per_N": abs(complex(found.plant[0, i])) * 1e6,
            "plant_deg": float(phase[i]),
            "plant_error": float(found.plant_sigma[0, i] / abs(found.plant[0, i])) * 100.0,
            "sensitivity": abs(complex(found.sensitivity[i])),
            "sensitivity_error": float(found.sensitivity_sigma[i]),
            "loop": abs(complex(found.open_loop[i])),
            "coherence": float(found.coherence[i]),
        }
        for i, hz in enumerate(found.hz)
    ]


def table(found: Response) -> str:
    """The points as CSV, SI units."""
    lines: list[str] = []
    for row in points(found):
        flat: dict[str, float] = {}
        for name, value in row.items():
            flat |= {f"{name}_re": value[0], f"{name}_im": value[1]} if isinstance(value, list) else {name: value}
        if not lines:
            lines.append(",".join(flat))
        lines.append(",".join(f"{value:.9g}" for value in flat.values()))
    return "\n".join(lines) + "\n"


def _pair(value: complex) -> list[float]:
    return [float(value.real), float(value.imag)]
