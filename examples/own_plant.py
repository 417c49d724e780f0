# SPDX-License-Identifier: Apache-2.0
"""A machine of your own in Python, from transfer functions of python-control, moved by the real firmware.

Each axis is 1 / (m s^2 + c s) with a resonance of 60 Hz that the drive is not told of.
`pip install control`, then `python examples/own_plant.py`; docs/own-plant.md explains it.
"""

from __future__ import annotations

import control
import numpy as np

import kontur

MASS_KG, VISCOUS_NSPM = 90.0, 400.0
RESONANCE_RADPS, DAMPING, SHARE = 2.0 * np.pi * 60.0, 0.05, 0.02


def axis() -> control.TransferFunction:
    """From force, N, to position, m."""
    s = control.tf("s")
    rigid = 1 / (MASS_KG * s**2 + VISCOUS_NSPM * s)
    mode = SHARE / MASS_KG / (s**2 + 2 * DAMPING * RESONANCE_RADPS * s + RESONANCE_RADPS**2)
    return rigid + mode


class Linear:
    """Two equal axes, exact for a force that is constant over a control period."""

    def __init__(self, start_m: tuple[float, float], period_s: float) -> None:
        system = control.sample_system(control.ss(axis()), period_s, "zoh")
        self.a, self.b, self.c = (np.asarray(part) for part in (system.A, system.B, system.C))
        self.state = np.zeros((len(self.a), 2))
        self.start_m = np.array(start_m)

    def step(self, force_N: tuple[float, float]) -> np.ndarray:
        """One control period under `force_N`; the positions after it."""
        self.state = self.a @ self.state + self.b @ np.array([force_N])
        return self.start_m + (self.c @ self.state)[0]


def main() -> None:
    """Run a circle on it under two controllers."""
    machine = kontur.load_machine()
    trajectory = kontur.plan(kontur.shapes.circle(0.005, 0.05), kontur.limits(machine))
    for controller in ("ccu", "cascade"):
        result = kontur.run(trajectory, controller, kontur.Target(machine, plant=Linear))
        figures = kontur.summary(result.log)
        print(f"{controller}: mean {figures['mean_um']:.3f} um, max {figures['max_um']:.3f} um")


if __name__ == "__main__":
    main()
