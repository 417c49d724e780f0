# SPDX-License-Identifier: Apache-2.0
"""A control law of your own in Python, on the simulated drive: a force each millisecond, by cyclic synchronous torque.

`python examples/own_law.py`; docs/own-law.md says when this is enough, and when the law belongs into the firmware.
"""

from __future__ import annotations

import struct

import can
import numpy as np

import kontur
from kontur.can.link import Link
from kontur.drive.device import Device

RADIUS_M, SPEED_MPS, RAMP_S, LAPS_S = 0.02, 0.05, 0.5, 3.0
CYCLE_S = 1e-3
Y = 0x800  # from an object of axis x to that of axis y
TORQUE, PER_MILLE = 10, 1000


class PD:
    """PD with feedforward of mass and friction, each axis for itself."""

    stiffness_Npm, damping_Nspm = 2.5e6, 2.5e4

    def __init__(self, machine: kontur.Machine) -> None:
        axes = (machine.x, machine.y)
        self.mass_kg = np.array([axis.mass_kg for axis in axes])
        self.viscous_Nspm = np.array([axis.viscous_Nspm for axis in axes])
        self.coulomb_N = np.array([axis.coulomb_N for axis in axes])
        self.last_m: np.ndarray | None = None

    def force_N(self, position_m: np.ndarray, wanted: tuple[np.ndarray, np.ndarray, np.ndarray]) -> np.ndarray:
        """Of one cycle, from where the axes are and the wanted position, velocity and acceleration."""
        last_m = position_m if self.last_m is None else self.last_m
        velocity_mps, self.last_m = (position_m - last_m) / CYCLE_S, position_m
        r_m, v_mps, a_mps2 = wanted
        feedforward_N = self.mass_kg * a_mps2 + self.viscous_Nspm * v_mps + self.coulomb_N * np.tanh(v_mps / 1e-3)
        return feedforward_N + self.stiffness_Npm * (r_m - position_m) + self.damping_Nspm * (v_mps - velocity_mps)


def circle(t_s: float, start_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity and acceleration on the circle, which speeds up smoothly in RAMP_S."""
    u = min(t_s / RAMP_S, 1.0)
    speed = SPEED_MPS * u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    change = SPEED_MPS / RAMP_S * 30.0 * (u * (1.0 - u)) ** 2
    way = SPEED_MPS * (RAMP_S * u**4 * (2.5 - 3.0 * u + u * u) + max(0.0, t_s - RAMP_S))
    c, s = np.cos(way / RADIUS_M), np.sin(way / RADIUS_M)
    radial, along = np.array([c, s]), np.array([-s, c])
    return (start_m + RADIUS_M * (radial - (1.0, 0.0)), speed * along,
            change * along - speed**2 / RADIUS_M * radial)  # fmt: skip


def main() -> None:
    """Run the law on the circle, and print the true contour error."""
    machine = kontur.load_machine()
    with can.Bus(interface="kontur", channel="sim", seed=1) as bus:
        link = Link(bus, 1)
        device, sdo = Device(link), link.node.sdo
        device.parameters.set(machine.parameters())
        sdo[0x1402][1].raw = 1 << 31 | 0x401  # the third RPDO: both forces, at SYNC
        sdo[0x1402][2].raw = 1
        sdo[0x1602][0].raw = 0
        sdo[0x1602][1].raw, sdo[0x1602][2].raw = 0x6071_0010, 0x6071_0010 + (Y << 16)
        sdo[0x1602][0].raw = 2
        sdo[0x1402][1].raw = 0x401
        rated_N = np.array([sdo[0x6076 + axis].raw for axis in (0, Y)]) * 1e-3
        for axis in (0, Y):
            sdo[0x60C2 + axis][1].raw = round(CYCLE_S * 1e3)
            sdo[0x6060 + axis].raw = TORQUE
        link.send(0, bytes([1, 1]))  # NMT: operational
        for word in (0x06, 0x07, 0x0F):
            sdo[0x6041].raw, sdo[0x6041 + Y].raw
            link.send(0x201, struct.pack("<HH", word, word))
            link.wait(lambda: False, 0.01)
        start_m, law = np.array(device.position_m()), PD(machine)
        bus.start_recording()  # type: ignore[attr-defined]
        for cycle in range(round((RAMP_S + LAPS_S) / CYCLE_S)):
            force_N = law.force_N(np.array(device.position_m()), circle(cycle * CYCLE_S, start_m))
            share = np.clip(np.rint(force_N / rated_N * PER_MILLE), -PER_MILLE, PER_MILLE).astype(int)
            link.send(0x401, struct.pack("<hh", *share))
            link.send(0x80, b"")
            link.wait(lambda: False, CYCLE_S)
        truth = bus.take_truth()  # type: ignore[attr-defined]
    off_um = (np.hypot(*(truth.pos_m - start_m + (RADIUS_M, 0.0)).T) - RADIUS_M) * 1e6
    off_um = np.abs(off_um[round(RAMP_S * 10_000) :])
    print(f"PD in Python: mean {off_um.mean():.3f} um, max {off_um.max():.3f} um")


if __name__ == "__main__":
    main()
