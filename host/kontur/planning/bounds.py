# SPDX-License-Identifier: Apache-2.0
"""Limits of the axes, and the bounds of speed, acceleration and jerk for each piece of a path that follow from them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from kontur.errors import PathError, shown
from kontur.machine import Axis, Machine
from kontur.path.geometry import KNOT_S, Arc, Curve, Dwell, FloatArray, Line, Move, Program, Segment

CORNER_RAD = 2e-3  # a change of direction beyond this is a corner, where the motion stops

# Shares of the limits that are planned with. They leave room for the spline's response to jumps, and for rounding.
_VELOCITY_SHARE = 0.999
_ACCELERATION_SHARE = 0.98
_JERK_SHARE = 0.95
_FORCE_SHARE = 0.98
_ALONG_SHARE = 0.05  # of the force, along a bend that takes the rest
_FORCE_LEFT = 0.1  # of the force: what friction has to leave at the greatest speed
_STEP_SHARE = 0.35  # of the acceleration limit: greatest step, where curvature or direction jumps
_BUILD_UP_S = 4.0 * KNOT_S  # shortest time to build up the acceleration: knots could not follow a shorter one
_CENTRIPETAL_SHARE = 0.8  # of the acceleration may be centripetal; the rest is left for changes of speed
_BEND_SHARE = 0.7  # of the jerk may come from following the bend at constant speed
_TANGENTIAL_SHARES = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.98)
_KNOT_RAD = 0.2  # greatest turn of the path from one knot to the next
_CELL_M = 2e-4  # samples of a curve are this far apart, or closer where it turns more than _CELL_RAD between them
_CELL_RAD = 0.05
_CELLS_MAX = 1 << 17
_RADIUS_MIN_M = 2e-6
_EVEN_RAD, _EVEN_PER_M = 1e-7, 1e-4  # turn and change of curvature that do not count: at 1 m/s a jerk of 0.1 m/s3


AXIS_SPEED = "the speed of an axis (velocity_mps)"
BEND_LIMITS = (
    "the centripetal acceleration in the bend (acceleration_mps2, --accel)",
    "the jerk in the bend (jerk_mps3, --jerk)",
    "the distance of the knots in the bend",
)
"""What bounds the speed of a piece."""
LIMIT_RANGE = (1e-6, 1e9)
AVERAGE_MAX_S = 1.0


@dataclass(frozen=True)
class Force:
    """What moves an axis of `mass_kg`: `limit_N` at most, less friction: `coulomb_N`, and `viscous_Nspm` times the
    speed. For long it bears `continuous_N`, as a mean square over the time constant `thermal_s`; 0: as much as ever."""

    limit_N: float
    mass_kg: float
    viscous_Nspm: float
    coulomb_N: float
    continuous_N: float = 0.0
    thermal_s: float = 0.0

    def gaining_mps2(self, speed_mps: FloatArray) -> FloatArray:
        """The greatest acceleration (n,) that raises the speeds (n,), which are no less than 0."""
        return np.asarray((self.limit_N - self.coulomb_N - self.viscous_Nspm * speed_mps) / self.mass_kg)

    def ramp_mps2(self, along: float, speed_mps: float, jerk_mps3: float, bend_mps2: float = 0.0) -> float:
        """The greatest acceleration along a line, of which this axis has the share `along`, up to `speed_mps`, or in
        a bend whose centripetal acceleration is `bend_mps2` there.

        It falls by `jerk_mps3` before that speed is reached. So it is greatest, a, up to a speed of v - a^2/2j, where
        m a + c (v - a^2/2j) is what the force has left.
        """
        if along == 0.0:
            return math.inf
        moving_N = math.sqrt(max((self.limit_N - self.coulomb_N) ** 2 - (self.mass_kg * bend_mps2) ** 2, 0.0))
        left_N = moving_N / along - self.viscous_Nspm * speed_mps
        per_a2 = 0.5 * self.viscous_Nspm / jerk_mps3
        under_root = self.mass_kg**2 - 4.0 * per_a2 * left_N
        return 2.0 * left_N / (self.mass_kg + math.sqrt(under_root)) if under_root >= 0.0 else math.inf

    def bending_mps2(self, speed_mps: float) -> float:
        """The greatest centripetal acceleration at up to `speed_mps`, which leaves something along the path."""
        along_N = self.viscous_Nspm * speed_mps + _ALONG_SHARE * self.limit_N
        return math.sqrt(max((self.limit_N - self.coulomb_N) ** 2 - along_N**2, 0.0)) / self.mass_kg

    def braking_mps2(self) -> float:
        """The greatest one that lowers the speed, if friction does not help."""
        return self.limit_N / self.mass_kg


@dataclass(frozen=True)
class Limits:
    """What the axes may do, (x, y) each, and the step of acceleration allowed where the path's curvature jumps.

    `force`: what the axes have for it; None: enough.

    `average_s`: distance travelled is averaged over this time, in whole ms, so that the snap is bounded where an axis
    has a mode of this period; the path stays what it is. 0: not averaged.

    Raises PathError: a limit beyond LIMIT_RANGE, in its SI unit, or an average beyond AVERAGE_MAX_S.
    """

    velocity_mps: tuple[float, float] = (0.3, 0.3)
    acceleration_mps2: tuple[float, float] = (5.0, 5.0)
    jerk_mps3: tuple[float, float] = (100.0, 100.0)
    centripetal_step_mps2: float = 1.0
    average_s: float = 0.0
    force: tuple[Force, Force] | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.average_s <= AVERAGE_MAX_S:
            raise PathError(f"limit average_s is {self.average_s:g}; it must be 0..{AVERAGE_MAX_S:g}")
        for name, values in vars(self).items():
            if name in ("average_s", "force"):
                continue
            for value in values if isinstance(values, tuple) else (values,):
                if not LIMIT_RANGE[0] <= value <= LIMIT_RANGE[1]:
                    raise PathError(f"limit {name} is {value:g}; it must be {LIMIT_RANGE[0]:g}..{LIMIT_RANGE[1]:g}")

    def slower(self, share: float) -> Limits:
        """The same with a `share` of the velocity, and its square of the acceleration."""
        return replace(
            self,
            velocity_mps=(share * self.velocity_mps[0], share * self.velocity_mps[1]),
            acceleration_mps2=(share**2 * self.acceleration_mps2[0], share**2 * self.acceleration_mps2[1]),
        )


def _swing_Hz(axis: Axis) -> float:
    """The frequency at which an axis with a mode goes on to swing while its encoder is held."""
    return axis.resonance_Hz * (math.sqrt(axis.motor_share) if axis.encoder_at == "motor" else 1.0)


def limits(machine: Machine, acceleration_mps2: float | None = None, jerk_mps3: float | None = None) -> Limits:
    """The planner's limits for `machine`, with another acceleration or jerk for both axes where given.

    Distance is averaged over a period in which the table swings behind a motor that its encoder holds, or, where the
    encoder is at the table, over one of the first mode; of two axes the longer one.
    """
    x, y = machine.axes
    modes_Hz = [_swing_Hz(axis) for axis in machine.axes if axis.resonance_Hz > 0.0]
    return Limits(
        velocity_mps=(x.velocity_mps, y.velocity_mps),
        acceleration_mps2=(x.acceleration_mps2, y.acceleration_mps2)
        if acceleration_mps2 is None
        else (acceleration_mps2,) * 2,
        jerk_mps3=(x.jerk_mps3, y.jerk_mps3) if jerk_mps3 is None else (jerk_mps3,) * 2,
        centripetal_step_mps2=machine.centripetal_step_mps2,
        average_s=min(math.ceil(1.0 / (min(modes_Hz) * KNOT_S)) * KNOT_S, AVERAGE_MAX_S) if modes_Hz else 0.0,
        force=(_force(x), _force(y)),
    )


def _force(axis: Axis) -> Force:
    return Force(
        axis.force_limit_N,
        axis.mass_kg,
        axis.viscous_Nspm,
        axis.coulomb_N,
        axis.continuous_force_N,
        axis.thermal_s,
    )


@dataclass(slots=True)
class Piece:
    """A length of path with bounds of speed, tangential acceleration and tangential jerk."""

    length: float
    v: float
    a: float
    j: float
    limit: str = ""  # what bounds the speed, where it is not the feed
    entry: float = math.inf  # bound of the speed at its start; 0 is a stop
    dwell: float = 0.0  # dwell before it, s
    jump: bool = False  # curvature or direction jumps at its start
    fastest: float = 0.0  # duration at the bounds of what was merged into it, s


def planned(limits: Limits) -> Limits:
    """The limits to plan with. Raises PathError: an axis whose friction takes its force."""
    ax, ay = (_ACCELERATION_SHARE * a for a in limits.acceleration_mps2)
    jx, jy = limits.jerk_mps3
    x, y = (_VELOCITY_SHARE * v for v in limits.velocity_mps)
    if limits.force is not None:
        x, y = min(x, _fastest("x", limits.force[0])), min(y, _fastest("y", limits.force[1]))
    return Limits(
        velocity_mps=(x, y),
        acceleration_mps2=(ax, ay),
        jerk_mps3=(min(_JERK_SHARE * jx, ax / _BUILD_UP_S), min(_JERK_SHARE * jy, ay / _BUILD_UP_S)),
        centripetal_step_mps2=min(limits.centripetal_step_mps2, _STEP_SHARE * min(ax, ay)),
        average_s=limits.average_s,
        force=limits.force,
    )


def _fastest(axis: str, force: Force) -> float:
    """The speed at which friction leaves _FORCE_LEFT of the force."""
    left_N = (_FORCE_SHARE - _FORCE_LEFT) * force.limit_N - force.coulomb_N
    if left_N <= 0.0:
        raise PathError(
            f"force of axis {axis}: {force.limit_N:g} N (force_limit_N) less the friction of "
            f"{force.coulomb_N:g} N leaves too little to accelerate {force.mass_kg:g} kg; see the machine file"
        )
    return left_N / force.viscous_Nspm if force.viscous_Nspm > 0.0 else math.inf


def clipped(limits: Limits) -> list[str]:
    """Which of `limits` are not planned with as they are, since others do not let them: a sentence each."""
    plan, jerk, step = planned(limits), min(limits.jerk_mps3), limits.centripetal_step_mps2
    out = []
    for axis, v, limit in zip("xy", plan.velocity_mps, limits.velocity_mps, strict=True):
        if v < _VELOCITY_SHARE * limit:
            out.append(
                f"Axis {axis} is planned with {v * 1e3:.4g} mm/s at most instead of {limit * 1e3:.4g}: its force "
                "(force_limit_N) does not do more against its friction."
            )
    if min(plan.jerk_mps3) < _JERK_SHARE * jerk:
        out.append(
            f"A jerk of {min(plan.jerk_mps3):.4g} m/s³ is planned instead of {jerk:.4g}: the acceleration takes "
            f"{_BUILD_UP_S * 1e3:g} ms at least to build up."
        )
    if plan.centripetal_step_mps2 < step:
        out.append(
            f"Where the curvature jumps, a step of acceleration of {plan.centripetal_step_mps2:.4g} m/s² is planned "
            f"instead of {step:.4g}, in proportion to the acceleration limit."
        )
    return out


def accelerations(velocity: FloatArray, limits: Limits) -> tuple[FloatArray, FloatArray]:
    """The greatest accelerations (n, 2) of the axes at `velocity` (n, 2), upwards and downwards, both above zero."""
    upper = np.tile(np.array(limits.acceleration_mps2), (len(velocity), 1))
    lower = upper.copy()
    if limits.force is not None:
        for axis, force in enumerate(limits.force):
            v = velocity[:, axis]
            gaining = np.maximum(force.gaining_mps2(np.abs(v)), 1e-3 * force.braking_mps2())
            upper[:, axis] = np.minimum(upper[:, axis], np.where(v >= 0.0, gaining, force.braking_mps2()))
            lower[:, axis] = np.minimum(lower[:, axis], np.where(v <= 0.0, gaining, force.braking_mps2()))
    return upper, lower


def pieces_of(program: Program, limits: Limits, report: Callable[[float], None]) -> list[Piece]:
    """The pieces of the path in order; one that begins with a stop has `entry` 0. The last one is empty: the end."""
    if limits.force is not None:
        x, y = (replace(force, limit_N=_FORCE_SHARE * force.limit_N) for force in limits.force)
        limits = replace(limits, force=(x, y))
    pieces: list[Piece] = []
    entry, dwell = (0.0, False), 0.0
    for i, (item, after) in enumerate(itertools.zip_longest(program.items, program.items[1:])):
        if isinstance(item, Dwell):
            dwell += item.duration_s
            continue
        leaving = _entry(item.segment, after.segment, limits) if isinstance(after, Move) else (0.0, False)
        alone = entry[0] == 0.0 and leaving[0] == 0.0
        first, *others = _cut(item, limits, program.where(item.line), alone)
        first.entry, first.jump = entry
        first.dwell = dwell
        entry, dwell = leaving, 0.0
        for piece in (first, *others):
            if not (pieces and _merged(pieces[-1], piece)):
                pieces.append(piece)
        if i % 256 == 0:
            report(0.4 * i / len(program.items))
    return [*pieces, Piece(0.0, 1.0, 1.0, 1.0, entry=0.0, dwell=dwell)]


def _cut(move: Move, limits: Limits, where: str, alone: bool) -> list[Piece]:
    """The pieces of a move, which is `alone` between two stops or not."""
    segment = move.segment
    if isinstance(segment, Line):
        along = np.abs(segment.tangent(np.zeros(1))[0])

        def most(limit: tuple[float, float]) -> float:
            with np.errstate(divide="ignore"):
                return float(np.min(np.array(limit) / along))

        top, a, j = most(limits.velocity_mps), most(limits.acceleration_mps2), most(limits.jerk_mps3)
        v = min(top, move.feed_mps)
        reached = min(v, _reached(segment.length_m, a, j)) if alone else v
        for force, share in zip(limits.force or (), along.tolist(), strict=False):
            a = min(a, force.ramp_mps2(share, reached, j))
        return [_piece(segment.length_m, v, a, j, AXIS_SPEED if top < move.feed_mps else "")]
    v = min(move.feed_mps, *limits.velocity_mps)
    if limits.force is not None:  # it has to do for the bend, and some more along it
        most_a = min(force.bending_mps2(v) for force in limits.force) / _CENTRIPETAL_SHARE
        x, y = (min(a, most_a) for a in limits.acceleration_mps2)
        limits = replace(limits, acceleration_mps2=(x, y))
    limit = AXIS_SPEED if v < move.feed_mps else ""
    if isinstance(segment, Arc):
        return [_bent(segment.length_m, v, 1.0 / segment.radius_m, 0.0, limits, limit)]
    assert isinstance(segment, Curve)
    return _cut_curve(segment, v, limits, where, limit)


def _reached(length: float, a: float, j: float) -> float:
    """The greatest speed from rest to rest."""
    if 0.5 * length * j**2 <= a**3:
        return float((0.5 * length * math.sqrt(j)) ** (2.0 / 3.0))
    return 0.5 * a * (math.sqrt((a / j) ** 2 + 4.0 * length / a) - a / j)


def _cut_curve(segment: Curve, v: float, limits: Limits, where: str, limit: str) -> list[Piece]:
    """Pieces as long as it takes to stop: short enough to follow a changing bound, long enough to change speed in.

    Raises PathError: a bend of less than _RADIUS_MIN_M.
    """
    s, bend = sampled(segment, where)
    change = np.abs(np.diff(bend)) / np.diff(s)
    change = np.maximum(change, np.maximum(np.append(change[1:], 0.0), np.append(0.0, change[:-1])))
    bend = np.maximum(np.abs(bend[1:]), np.abs(bend[:-1]))
    bound = np.minimum(v, _bend_speed(bend, change, limits))
    wanted = np.sqrt(bound**3 / min(limits.jerk_mps3))
    pieces = []
    start, cells = 0, len(bend)
    while start < cells:
        end = max(start + 1, int(np.searchsorted(s, s[start] + wanted[start], side="right")) - 1)
        shortest = s[start] + np.min(wanted[start:end])
        end = min(cells, max(start + 1, int(np.searchsorted(s, shortest, side="right")) - 1))
        tightest, steepest = float(np.max(bend[start:end])), float(np.max(change[start:end]))
        pieces.append(_bent(s[end] - s[start], v, tightest, steepest, limits, limit))
        start = end
    return pieces


def sampled(segment: Curve, where: str) -> tuple[FloatArray, FloatArray]:
    """Distances (n,) along a curve, close enough that it turns little from one to the next, and its curvature there."""

    def shape(s: FloatArray) -> tuple[FloatArray, FloatArray]:
        tangent = segment.tangent(s)
        return segment.curvature(s), np.arctan2(tangent[:, 1], tangent[:, 0])

    s = np.linspace(0.0, segment.length_m, int(np.clip(segment.length_m / _CELL_M, 64, _CELLS_MAX)) + 1)
    s = np.unique(np.append(s, segment.edges_m))
    s = np.append(0.0, s[1:][np.diff(s) > _CELL_RAD * _RADIUS_MIN_M])
    s = np.append(s[: max(1, len(s) - 1)], segment.length_m)  # of a very short curve nothing else is left
    bend, angle = shape(s)
    while True:
        turn = np.abs((np.diff(angle) + np.pi) % (2.0 * np.pi) - np.pi)
        size = np.diff(s)
        coarse = np.flatnonzero(np.maximum(turn, np.maximum(np.abs(bend[1:]), np.abs(bend[:-1])) * size) > _CELL_RAD)
        if not coarse.size:
            return s, bend
        if np.min(size[coarse]) < _CELL_RAD * _RADIUS_MIN_M:
            x, y = 1e3 * segment.point(s[coarse[:1]])[0]
            raise PathError(
                f"{where}: the curve bends with less than {_RADIUS_MIN_M * 1e3:g} mm radius near x = {shown(x)}, "
                f"y = {shown(y)} mm; its points must lie on a smooth curve"
            )
        middle = s[coarse] + 0.5 * size[coarse]
        more_bend, more_angle = shape(middle)
        s = np.insert(s, coarse + 1, middle)
        bend, angle = np.insert(bend, coarse + 1, more_bend), np.insert(angle, coarse + 1, more_angle)


def _bent(length: float, v: float, bend: float, change: float, limits: Limits, limit: str) -> Piece:
    """Bounds on a piece with curvature up to `bend` (1/m) that changes by up to `change` (1/m2). Its speed is bounded
    to `v` by `limit`, or lower by the bend.

    Along a curve p(s(t)) with unit tangent t and normal n, curvature k and k' = dk/ds,
    acceleration = t s'' + n k s'^2 and jerk = t (s''' - k^2 s'^3) + n (3 k s' s'' + k' s'^3).
    Either vector may point along either axis, so its length stays within the weaker axis' limit.
    """
    a, j = min(limits.acceleration_mps2), min(limits.jerk_mps3)
    bounds = [float(bound) for bound in _bend_speeds(np.array(bend), np.array(change), limits)]
    if min(bounds) < v:
        v, limit = min(bounds), BEND_LIMITS[bounds.index(min(bounds))]
    along = bend**2 * v**3
    a_left = math.sqrt(a**2 - (bend * v**2) ** 2)
    choices = []
    for share in _TANGENTIAL_SHARES:  # of the jerk that is left along the path; what s'' may be depends on it
        j_s = share * (j - along)
        across = math.sqrt(j**2 - (j_s + along) ** 2) - change * v**3
        a_s = min(a_left, max(across, 0.0) / (3.0 * bend * v)) if bend > 0.0 else a_left
        for force in limits.force or ():
            a_s = min(a_s, force.ramp_mps2(1.0, v, j_s, bend * v**2))
        if a_s > 0.0:
            choices.append((v / a_s + a_s / j_s, a_s, j_s))
    _, a_s, j_s = min(choices)  # the fastest from rest to the greatest speed
    return _piece(length, v, a_s, j_s, limit)


def _bend_speed(bend: FloatArray, change: FloatArray, limits: Limits) -> FloatArray:
    """Greatest constant speed on such a bend."""
    return np.asarray(np.minimum.reduce(_bend_speeds(bend, change, limits)))


def _bend_speeds(bend: FloatArray, change: FloatArray, limits: Limits) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The same by each of BEND_LIMITS."""
    a, j = min(limits.acceleration_mps2), min(limits.jerk_mps3)
    with np.errstate(divide="ignore"):
        by_acceleration = np.sqrt(_CENTRIPETAL_SHARE * a / bend)
        by_jerk = np.cbrt(_BEND_SHARE * j / np.hypot(bend**2, change))
        by_knots = _KNOT_RAD / KNOT_S / bend
    return by_acceleration, by_jerk, by_knots


def _piece(length: float, v: float, a: float, j: float, limit: str) -> Piece:
    return Piece(float(length), v, a, j, limit, fastest=float(length) / v)


def _entry(before: Segment, after: Segment, limits: Limits) -> tuple[float, bool]:
    """Bound of the speed where `after` follows `before`, and whether curvature or direction jumps there by more than
    rounding.

    A change of direction by `turn` is spread over one knot by the spline: an acceleration of speed times turn a knot.
    """
    end, start = np.array([before.length_m]), np.zeros(1)
    (x0, y0), (x1, y1) = before.tangent(end)[0], after.tangent(start)[0]
    turn = abs(math.atan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1))
    if turn > CORNER_RAD:
        return 0.0, False
    jump = abs(float(after.curvature(start)[0] - before.curvature(end)[0]))
    kick = turn / KNOT_S
    step = limits.centripetal_step_mps2
    root = kick + math.sqrt(kick**2 + 4.0 * jump * step)
    if turn <= _EVEN_RAD and jump <= _EVEN_PER_M:
        return math.inf, False
    return 2.0 * step / root, True


def _merged(into: Piece, piece: Piece) -> bool:
    """Merge `piece` into the one before it if their bounds are much the same: fewer points without acceleration."""
    v, a, j = min(into.v, piece.v), min(into.a, piece.a), min(into.j, piece.j)
    length, fastest = into.length + piece.length, into.fastest + piece.fastest
    alike = length / v <= 1.05 * fastest and a >= 0.5 * max(into.a, piece.a) and j >= 0.5 * max(into.j, piece.j)
    if not alike or piece.entry < v or piece.jump:
        return False
    into.limit = into.limit if into.v <= piece.v else piece.limit
    into.length, into.v, into.a, into.j, into.fastest = length, v, a, j, fastest
    return True
