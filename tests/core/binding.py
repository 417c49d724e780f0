# SPDX-License-Identifier: Apache-2.0
"""The control core, compiled on its own, with the parameters and units of the oracle."""

from __future__ import annotations

import os
import subprocess
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import cffi
import numpy as np
import oracle
from core.bounds import T0, UM

ROOT = Path(__file__).resolve().parents[2]
HEADER = ROOT / "tests/core/core_api.h"
FLAGS = ["-std=c11", "-O2", "-ffp-contract=off", "-fno-math-errno", "-Wall", "-Wextra", "-Werror", "-fPIC", "-shared"]
UNITS = {"s", "kg", "Nspm", "N", "radps", "mps", "1ps", "1pm", "m", "1ps2", "1pms", "mps2", "NpA", "ohm", "Vspm"}
POS_PER_M = 65536e9
KNOT_S = oracle.KNOT_S


NUMS = {"f32": ([], []), "fix": (["-DKONTUR_NUM_FIX"], ["-DBOUND_FIXED"])}
"""Flags of each numeric back end, and of the one that bounds its errors."""


def build(library: Path, flags: list[str]) -> Path:
    """Compile the core and its wrapper into `library`."""
    sources = [ROOT / "tests/core/core_api.c", *sorted((ROOT / "firmware/core").glob("*.c"))]
    include = [f"-I{ROOT / d}" for d in ("firmware", "tests/unit", "tests/core")]
    subprocess.run(
        [os.environ.get("CC", "gcc"), *FLAGS, *flags, *include, *map(str, sources), "-o", str(library), "-lm"],
        check=True,
    )
    return library


class Core:
    """The library of a back end. Vectors go in as sequences of two and come out as arrays (2,); SI units.

    `bound` is the same on the back end of num_bound.h: what it gives for the same input is not the result but how far
    rounding may have moved it.
    """

    def __init__(self, num: str, folder: Path):
        flags, bound_flags = NUMS[num]
        self.num = num
        self._load(build(folder / f"libcore_{num}.so", flags))
        self.bound = object.__new__(Core)
        self.bound.num = "bound"
        as_bound = ['-DKONTUR_NUM_HEADER="num_bound.h"', *bound_flags]
        self.bound._load(build(folder / f"libbound_{num}.so", as_bound))

    def _load(self, library: Path) -> None:
        self.ffi = cffi.FFI()
        self.ffi.cdef(HEADER.read_text().split("/* CDEF-BEGIN */")[1].split("/* CDEF-END */")[0])
        self.lib = self.ffi.dlopen(str(library))
        self.path_one = self.lib.api_path_one()

    def params(self, **changes: Any) -> oracle.Params:
        """The oracle's parameters, with control period and reference model as this back end has them."""
        p = oracle.Params()
        if self.num == "fix":

            def fixed(x: Any, unit: float) -> Any:
                return np.rint(x / unit * 2**19) * 2.0**-19 * unit

            mass, viscous = fixed(p.mass_kg, T0**2 / UM), fixed(p.viscous_Nspm, T0 / UM)
            p = replace(p, dt_s=float(fixed(p.dt_s, T0)), mass_kg=mass, viscous_Nspm=viscous)
        return replace(p, **changes)

    def path_time(self, t_s: float) -> int:
        """Path time t_s in the core's integers."""
        return round(t_s / KNOT_S * self.path_one)

    def seconds(self, s: int) -> float:
        """The exact path time of those integers, s."""
        return s / self.path_one * KNOT_S

    def drive(self, p: oracle.Params, knots_nm: Any = ((0, 0),), start_nm: Any = None) -> Drive:
        """A drive with these parameters, and at most as many knots as the ring holds."""
        knots = np.ascontiguousarray(knots_nm, dtype=np.int32)
        assert len(knots) <= 1024
        return Drive(self, p, knots, knots[0] if start_nm is None else np.asarray(start_nm, dtype=np.int32))


def values(struct: Any, ffi: cffi.FFI) -> dict[str, Any]:
    """The members of a C struct: arrays (2,) and numbers."""
    found = {}
    kind = ffi.typeof(struct)
    for name, member in (kind.item if kind.kind == "pointer" else kind).fields:
        value = getattr(struct, name)
        found[name] = np.array(list(value)) if member.type.kind == "array" else value
    return found


class Drive:
    """One drive of the library: knots, parameters, states."""

    def __init__(self, core: Core, p: oracle.Params, knots: np.ndarray, start: np.ndarray):
        self.core, self.ffi, self.lib = core, core.ffi, core.lib
        params = self.ffi.new("struct api_params *")
        members = {name for name, _ in self.ffi.typeof("struct api_params").fields}
        for f in fields(p):
            stem, _, unit = f.name.rpartition("_")
            name = stem if unit in UNITS else f.name
            if name in members:
                value = getattr(p, f.name)
                setattr(params, name, value.tolist() if isinstance(value, np.ndarray) else value)
                members.remove(name)
        assert not members, f"parameters of the core that the oracle does not know: {members}"
        knot_data = self.ffi.cast("int32_t *", knots.ctypes.data)
        start_data = self.ffi.new("int32_t[2]", [int(v) for v in start])
        handle = self.lib.api_new(params, knot_data, len(knots), start_data)
        if handle == self.ffi.NULL:
            raise ValueError("force filters that cannot be had")
        self.handle = self.ffi.gc(handle, self.lib.api_free)

    def _path(self, s: int, rate: float, rate_dot: float) -> Any:
        return self.ffi.new("struct api_path *", [s, rate, rate_dot])

    def cosh(self, x: float) -> tuple[float, float]:
        """(cosh x, sinh x)"""
        out = self.ffi.new("double[2]")
        self.lib.api_trig_cosh(x, out)
        return out[0], out[1]

    def decay(self, x: float) -> float:
        """exp(-x)"""
        return float(self.lib.api_trig_decay(x))

    def circle(self, phase: int) -> tuple[float, float]:
        """(cosine, sine) of phase 2^-32 turns"""
        out = self.ffi.new("double[2]")
        self.lib.api_trig_circle(phase, out)
        return out[0], out[1]

    def spline(self, s: int) -> dict[str, Any]:
        """r, d1, d2, d3 at path time s."""
        out = self.ffi.new("struct api_point *")
        self.lib.api_spline(self.handle, s, out)
        return values(out, self.ffi)

    def contour(self, s: int, rate: float, rate_dot: float, q: Any, q_dot: Any) -> dict[str, Any]:
        """contour_step at actual position q (core integers) and velocity."""
        out = self.ffi.new("struct api_contour *")
        position = self.ffi.new("int64_t[2]", [int(v) for v in q])
        velocity = self.ffi.new("double[2]", list(q_dot))
        self.lib.api_contour(self.handle, self._path(s, rate, rate_dot), position, velocity, out)
        return values(out, self.ffi)

    def law(self, k_hat: Any, **inputs: Any) -> dict[str, Any]:
        """smc_step; `inputs` are the members of api_law_in; the result has k_hat, too."""
        out = self.ffi.new("struct api_law_out *")
        state = self.ffi.new("double[2]", list(k_hat))
        given = self.ffi.new("struct api_law_in *", {name: list(value) for name, value in inputs.items()})
        self.lib.api_law(self.handle, given, state, out)
        return values(out, self.ffi) | {"k_hat": np.array(list(state))}

    def compensation(self, t: Any, w: float, q: Any, q_dot: Any, q_bar: Any, q_bar_dot: Any, mu: Any) -> dict[str, Any]:
        """compensator_step; the result has the new q_bar (core integers) and mu, too."""
        out = self.ffi.new("struct api_compensation *")
        position = self.ffi.new("int64_t[2]", [int(v) for v in q])
        model = self.ffi.new("int64_t[2]", [int(v) for v in q_bar])
        gain = self.ffi.new("double[2]", list(mu))
        frame = self.ffi.new("struct api_frame *", [list(t), w])
        self.lib.api_compensation(self.handle, frame, position, list(q_dot), model, list(q_bar_dot), gain, out)
        return values(out, self.ffi) | {"q_bar": list(model), "mu": np.array(list(gain))}

    def model(self, u_bar: Any, q_bar: Any, q_bar_dot: Any) -> tuple[list[int], np.ndarray]:
        """compensator_model: new position (core integers) and velocity."""
        position = self.ffi.new("int64_t[2]", [int(v) for v in q_bar])
        velocity = self.ffi.new("double[2]", list(q_bar_dot))
        self.lib.api_model(self.handle, list(u_bar), position, velocity)
        return list(position), np.array(list(velocity))

    def observe(self, axis: int, measured: int, force: float, pos: int, vel: float, rest: float) -> list[float]:
        """observer_step: new position (core integers), velocity, unexplained acceleration, predicted acceleration."""
        position = self.ffi.new("int64_t *", int(pos))
        state = self.ffi.new("double[3]", [vel, rest, 0.0])
        self.lib.api_observe(self.handle, axis, int(measured), force, position, state)
        return [position[0], *state]

    def geometry(self, axes: Any, encoder: Any) -> list[dict[str, Any]]:
        """geometry_step of both axes at encoder positions (core integers): members of api_geometry_axis."""
        given = self.ffi.new("struct api_geometry_axis[2]", axes)
        self.lib.api_geometry(self.handle, given, [int(v) for v in encoder])
        return [values(given[i], self.ffi) for i in (0, 1)]

    def dual_feedback(
        self, crossover_radps: float, tolerance_m: float, offset_m: float, encoder: Any
    ) -> tuple[float, bool]:
        """dual_feedback_step at positions of both encoders (core integers): new offset, m, and whether they agree."""
        agree = self.ffi.new("int *")
        given = [int(v) for v in encoder]
        offset = self.lib.api_dual_feedback(self.handle, crossover_radps, tolerance_m, offset_m, given, agree)
        return offset, bool(agree[0])

    def oscillations(
        self, axis: int, w: oracle.Watch, net_N: Any, r_dot_mps: Any, r_ddot_mps2: Any
    ) -> list[tuple[int, float, float]]:
        """oscillation_step() over all periods: period, frequency and amplitude of each oscillation, at most 100."""
        at, hz, size = self.ffi.new("int[100]"), self.ffi.new("double[100]"), self.ffi.new("double[100]")
        given = [self.ffi.new("double[]", list(x)) for x in (net_N, r_dot_mps, r_ddot_mps2)]
        watch = (w.limit_N, w.count_N, w.force_max_N, w.share, w.half_wave, w.lasts)
        found = self.lib.api_oscillations(self.handle, axis, *watch, len(net_N), *given, 100, at, hz, size)
        return [(at[k], hz[k], size[k]) for k in range(found)]

    def cascade(self, errors: dict[str, Any], coupled: bool, integral: Any) -> tuple[np.ndarray, np.ndarray]:
        """cascade_step: force and new integrals (x, y, coupled); `errors` are members of api_contour."""
        given = self.ffi.new("struct api_contour *", {name: list(value) for name, value in errors.items()})
        state = self.ffi.new("double[3]", list(integral))
        force = self.ffi.new("double[2]")
        self.lib.api_cascade(self.handle, given, coupled, state, force)
        return np.array(list(force)), np.array(list(state))

    def force_filter(self, axis: int, state: Any, force: float) -> tuple[float, np.ndarray]:
        """force_filter_step of one axis: filtered force and new state (4, 2), N."""
        after = self.ffi.new("double[4][2]", np.asarray(state).tolist())
        filtered = self.lib.api_force_filter(self.handle, axis, after, force)
        return filtered, np.array([list(section) for section in after])

    def force_limit(self, heat: Any, force: Any) -> tuple[np.ndarray, np.ndarray]:
        """force_limit_step: new heat and limits."""
        after, limit = self.ffi.new("double[2]", list(heat)), self.ffi.new("double[2]")
        self.lib.api_force_limit(self.handle, after, list(force), limit)
        return np.array(list(after)), np.array(list(limit))

    def friction(self, r_dot: Any) -> np.ndarray:
        """friction_step: the shape (2,). The state is the drive's."""
        shape = self.ffi.new("double[2]")
        self.lib.api_friction(self.handle, list(r_dot), shape)
        return np.array(list(shape))

    def screw(self, at: Any, demand: Any) -> np.ndarray:
        """screw_cancel at encoder positions (core integers): the demand (2,)."""
        u = self.ffi.new("double[2]")
        self.lib.api_screw(self.handle, [int(v) for v in at], list(demand), u)
        return np.array(list(u))

    def power(self, axis: int, velocity: float, acceleration: float) -> float:
        """energy_step's power, W."""
        return self.lib.api_power(self.handle, axis, velocity, acceleration)

    def reset(self, measured: Any) -> None:
        """servo_reset at encoder positions (core integers)."""
        self.lib.api_servo_reset(self.handle, [int(v) for v in measured])

    def step(
        self, s: int, measured: Any, controller: str, rate: float = 1.0, rate_dot: float = 0.0, enabled: bool = True
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """servo_step: (force, velocity, e_n, energy so far)."""
        force, velocity, e_n = (self.ffi.new("double[2]") for _ in range(3))
        energy = self.ffi.new("double *")
        number = oracle.CONTROLLERS.index(controller)
        path = self._path(s, rate, rate_dot)
        position = [int(v) for v in measured]
        self.lib.api_servo_step(self.handle, path, position, number, enabled, force, velocity, e_n, energy)
        return np.array(list(force)), np.array(list(velocity)), np.array(list(e_n)), energy[0]
