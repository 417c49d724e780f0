# SPDX-License-Identifier: Apache-2.0
"""The control core (C), float32 and fixed point, against the oracle (double, NumPy), and that against mathematics."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import oracle
import pytest
from core.binding import POS_PER_M, Core
from core.bounds import QUANTUM_M, READ, T0, UM, of_oracle, rounding, size
from oracle import Params
from scipy.interpolate import BSpline
from scipy.linalg import solve_banded
from scipy.signal import bilinear, freqz, lfilter

KNOTS = 300
P = Params()
SLOW, FAST = 4.488e-3, 0.1
# members of api_contour and what they are called in the oracle
CONTOUR = (
    *("r_dot", "r_ddot", "e_w", "e_w_dot", "e_l", "t_d", "tau", "nu", "t", "theta_dot", "theta_ddot"),
    *("e_wn", "e_n", "e_n_dot", "a_n"),
)


def frame_acceleration(
    rot: np.ndarray, w: float, w_dot: float, e_w: np.ndarray, e_w_dot: np.ndarray, r_ddot: np.ndarray
) -> np.ndarray:
    """Terms of (15) that are no feedback: r'' - theta'' I_e e_w + theta'^2 e_w - 2 theta' I_e e_w', in the frame."""
    i_e = oracle.I_E
    return rot.T @ (r_ddot - w_dot * i_e @ e_w + w**2 * e_w - 2.0 * w * i_e @ e_w_dot)


def knots_through(samples_m: np.ndarray) -> np.ndarray:
    """Knots (n, 2), nm, of the spline through samples_m (n, 2): its tridiagonal system, the ends at rest."""
    bands = np.array([[1.0], [4.0], [1.0]]) * np.ones(len(samples_m))
    right = 6.0 * samples_m
    right[0] -= samples_m[0]
    right[-1] -= samples_m[-1]
    return np.rint(solve_banded((1, 1), bands, right) * 1e9).astype(np.int32)


def travelled(speed_mps: float, count: int = KNOTS, ramp_s: float = 0.03) -> np.ndarray:
    """Path length (count,), m, a millisecond apart: from rest to speed_mps within ramp_s."""
    t = np.arange(count) * 1e-3
    x = np.minimum(t / ramp_s, 1.0)
    return speed_mps * ramp_s * (x**3 - 0.5 * x**4) + speed_mps * np.maximum(t - ramp_s, 0.0)


def circle(radius_m: float, speed_mps: float) -> np.ndarray:
    a = travelled(speed_mps) / radius_m
    return knots_through(radius_m * np.stack([np.cos(a), np.sin(a)], axis=1))


def reversal() -> np.ndarray:
    """Forth and back along a sloped line, through rest."""
    s = 1e-3 * np.sin(np.linspace(0.0, 6.0 * np.pi, KNOTS))
    return knots_through(np.stack([s, 0.3 * s], axis=1))


def eight() -> np.ndarray:
    """An eight of 20 mm at up to 0.2 m/s: curvature of both signs, speed that changes."""
    a = travelled(0.2) / 0.02
    return knots_through(np.stack([0.02 * np.sin(a), 0.01 * np.sin(2.0 * a)], axis=1))


def scattered(step_nm: int) -> np.ndarray:
    """Knots that follow no plan at all, 100 mm from the origin."""
    rng = np.random.default_rng(5)
    return (100_000_000 + np.cumsum(rng.integers(-step_nm, step_nm, size=(KNOTS, 2)), axis=0)).astype(np.int32)


PATHS = {
    "slow circle": circle(4e-3, SLOW),
    "fast circle": circle(20e-3, FAST),
    "tight fast circle": circle(4e-3, FAST),
    "reversal": reversal(),
    "eight": eight(),
    "scattered": scattered(6_000),
    "widely scattered": scattered(60_000),  # |r'''| of 1e5 m/s^3 and more
    "standstill": np.full((KNOTS, 2), [12_345_678, -87_654_321], dtype=np.int32),
}


def within_range(core: Core, inside: bool) -> None:
    """Fixed point has +-4096 um, um/T0, um/T0^2, um/T0^3, N: what lies outside of it saturates there."""
    if core.num == "fix" and not inside:
        pytest.skip("no case for fixed point: its inputs lie outside +-4096, where it saturates; f32 runs it")


def check(name: str, found: Any, expected: Any, bound: Any, what: str = "") -> None:
    error, bound = np.abs(np.asarray(found) - np.asarray(expected)), np.asarray(bound)
    assert np.all(error <= bound), f"{name} {what}: off by {error}, rounding allows {bound}; {found} for {expected}"


# --- The oracle against mathematics that it does not use --------------------------------------------------------------


def test_oracle_spline_is_scipys_uniform_cubic_spline() -> None:
    knots = PATHS["eight"] * 1e-9
    curve = BSpline(np.arange(-2, KNOTS + 2) * 1e-3, knots, 3)
    for t in np.random.default_rng(1).uniform(0.01, 0.29, 20):
        point = oracle.spline(knots, knots[0], t)
        for order, value in enumerate((point.r, point.d1, point.d2, point.d3)):
            np.testing.assert_allclose(value, curve(t, nu=order), rtol=1e-9, atol=1e-12 * 1e3**order)


def smooth_state(knots: np.ndarray, t: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A position within 20 um of the path and a velocity within 5 mm/s of the programmed one."""
    point = oracle.spline(knots, knots[0], t)
    return point.r + rng.uniform(-2e-5, 2e-5, 2), point.d1 + rng.uniform(-5e-3, 5e-3, 2)


# Without regularisation, and with Newton's step, (3)-(9) are exact but for what one step leaves of the foot point.
EXACT = replace(P, v_min_mps=1e-9, force_max_N=np.array([1e9, 1e9]))


@pytest.mark.parametrize("path", ["fast circle", "tight fast circle", "eight"])
def test_oracle_rates_are_derivatives_of_what_they_are_rates_of(path: str) -> None:
    knots, rng, h = PATHS[path] * 1e-9, np.random.default_rng(2), 1e-6
    for t in (rng.integers(50, 280, 10) + rng.uniform(0.4, 0.6, 10)) * 1e-3:
        q, q_dot = smooth_state(knots, t, rng)

        def at(dt: float, t: float = t, q: np.ndarray = q, q_dot: np.ndarray = q_dot) -> oracle.Contour:
            return oracle.contour_error(knots, knots[0], t + dt, 1.0, 0.0, q + q_dot * dt, q_dot, EXACT)

        c, before, after = at(0.0), at(-h), at(h)

        def rate(member: str, a: oracle.Contour = after, b: oracle.Contour = before) -> Any:
            return (getattr(a, member) - getattr(b, member)) / (2.0 * h)

        angle = np.arctan2(after.rotation[1, 0], after.rotation[0, 0]) - np.arctan2(
            before.rotation[1, 0], before.rotation[0, 0]
        )
        assert rate("tau_s") == pytest.approx(c.nu, rel=1e-5)
        assert angle / (2.0 * h) == pytest.approx(c.theta_dot, rel=1e-5)
        np.testing.assert_allclose(rate("rn"), c.rn_dot, atol=1e-5 * size(c.rn_dot))
        np.testing.assert_allclose(rate("e_n"), c.e_n_dot, atol=1e-5 * size(c.rn_dot))


@pytest.mark.parametrize("path", ["fast circle", "tight fast circle", "eight"])
@pytest.mark.parametrize("printed", [False, True])
def test_oracle_law_makes_the_contour_error_slide_on_its_surface(path: str, printed: bool) -> None:
    """(15) is right when it does what it was derived for: s_bar' = -K s_bar on the plant M q'' + C q' = u.

    The derivative is taken by differences along the motion that the law's force gives, so (8)-(11) and (15) are all in
    it. The normal component is free of the one approximation, tau'' = 0.
    """
    p = replace(EXACT, psi_printed=printed, k_bar_1pm=1e5, gamma_1ps=20.0)
    knots, rng, h = PATHS[path] * 1e-9, np.random.default_rng(3), 1e-6
    k_hat = np.array([80.0, 120.0])
    for t in (rng.integers(50, 280, 10) + rng.uniform(0.4, 0.6, 10)) * 1e-3:
        q, q_dot = smooth_state(knots, t, rng)
        c = oracle.contour_error(knots, knots[0], t, 1.0, 0.0, q, q_dot, p)
        u, s_bar = oracle.contouring_law(
            *(c.rotation, c.theta_dot, c.theta_ddot, c.e_turning, c.e_wn_dot, c.e_n, c.e_n_dot, c.rn_ddot),
            *(q_dot, k_hat, p),
        )
        q_ddot = (u - p.viscous_Nspm * q_dot) / p.mass_kg

        def s_at(dt: float, t: float = t, q: Any = q, q_dot: Any = q_dot, q_ddot: Any = q_ddot) -> np.ndarray:
            moved, velocity = q + q_dot * dt + 0.5 * q_ddot * dt**2, q_dot + q_ddot * dt
            later = oracle.contour_error(knots, knots[0], t + dt, 1.0, 0.0, moved, velocity, p)
            return oracle.surface(later.e_n, later.e_n_dot, p)[0]

        s_dot = (s_at(h) - s_at(-h)) / (2.0 * h)
        scale = p.lambda_1ps * size(c.e_n_dot) + k_hat[1] * size(s_bar)
        assert abs(s_dot[1] + k_hat[1] * s_bar[1]) < 1e-4 * scale


def test_oracle_error_with_stiffness_decays_with_the_poles_of_its_polynomial() -> None:
    """e'' + (A + K) e' + (A K + B) e = 0 on a straight path: of a pair of complex poles here, and stable.

    V = (s_bar^2 + B e^2) / 2 falls: V' = -K s_bar^2 - A B e^2 (docs/adr/0084).
    """
    p = replace(P, beta=0.0, lambda_1ps=80.0, stiffness_1ps2=2e4)
    k, still, mass = np.array([60.0, 60.0]), np.zeros(2), p.mass_kg
    state, dt = np.array([1e-5, 0.0]), 1e-6
    lyapunov, size_um = [], []
    for _ in range(40_000):
        e, e_dot = np.array([state[0], 0.0]), np.array([state[1], 0.0])
        force, s_bar = oracle.contouring_law(np.eye(2), 0.0, 0.0, e, e_dot, e, e_dot, still, still, k, p)
        lyapunov.append(0.5 * (s_bar[0] ** 2 + p.stiffness_1ps2 * state[0] ** 2))
        size_um.append(state[0] * 1e6)
        half = state[1] + 0.5 * dt * force[0] / mass[0]
        state = np.array([state[0] + dt * half, state[1] + dt * force[0] / mass[0]])
    pole = complex(np.roots([1.0, 80.0 + 60.0, 80.0 * 60.0 + 2e4])[0])
    assert abs(pole.imag) > 100.0
    t = dt * np.arange(len(size_um))
    expected = 10.0 * np.exp(pole.real * t) * (np.cos(pole.imag * t) - pole.real / pole.imag * np.sin(pole.imag * t))
    np.testing.assert_allclose(size_um, expected, atol=2e-3)
    assert np.all(np.diff(lyapunov) < 0.0)


@pytest.mark.parametrize("in_axes", [False, True])
def test_oracle_compensator_in_the_axes_is_stable_whatever_the_frames_turning(in_axes: bool) -> None:
    """z'' = R v with v of (24) in its boundary layer: in the frame it grows where alpha mu/phi < theta'^2."""
    p = replace(P, alpha_1ps=5.0, phi_mps=1.0, in_axes=in_axes)  # mu/phi is 10 1/s below
    z, z_dot, dt, w = np.array([1e-6, 0.0]), np.zeros(2), 1e-4, 27.0  # r 3 mm at 80 mm/s
    for k in range(20_000):
        force = oracle.compensation(z, z_dot, oracle.rotation(w * k * dt), w, np.array([10.0, 10.0]), p)[3]
        z_dot = z_dot + dt * force / p.mass_kg
        z = z + dt * z_dot
    assert (size(z) < 1e-9) == in_axes


def test_oracle_observer_has_a_triple_pole_where_the_bandwidth_puts_it() -> None:
    dt, bandwidth = 1e-4, 1300.0
    gains = oracle.observer_gains(bandwidth, dt)
    error = (np.eye(3) - np.outer(gains, [1.0, 0.0, 0.0])) @ oracle.transition(dt)
    pole = np.exp(-bandwidth * dt)
    np.testing.assert_allclose(np.poly(error), np.poly([pole] * 3), rtol=2e-3)  # bilinear: p = exp(-x) (1 + x^3/12...)


def test_oracle_power_is_voltage_times_current() -> None:
    v, a = np.array([0.03, -0.2]), np.array([-2.0, 1.5])
    force = P.coulomb_N * np.sign(v) + P.viscous_Nspm * v + P.mass_kg * a
    current = force / P.force_constant_NpA
    voltage = current * P.impedance_ohm + P.back_emf_Vspm * v
    np.testing.assert_allclose(oracle.power(v, a, P), np.sqrt(3.0) * 0.9 * voltage * current, rtol=1e-12)


def test_oracle_loop_keeps_the_axes_on_the_circle() -> None:
    loop = oracle.Loop(replace(P, noise_N=0.0), PATHS["slow circle"], seed=1)
    distance = []
    for _ in range(1500):
        loop.step()
        distance.append(abs(np.hypot(*loop.plant.position_m) - 4e-3))
    assert np.mean(distance) < 0.5e-6


SECTIONS = {
    "notch": (170.0, 0.05, 170.0, 0.7),
    "shallow notch": (62.5, 0.3, 62.5, 0.8),
    "low-pass": (0.0, 0.0, 800.0, 0.7),
    "slow low-pass": (0.0, 0.0, 10.0, 1.0),
    "fast low-pass": (0.0, 0.0, 4500.0, 0.7),
    "lead": (100.0, 1.0, 300.0, 1.0),
    "lag": (200.0, 0.5, 70.0, 0.6),
    "general": (900.0, 0.02, 350.0, 0.1),
    "high notch": (4900.0, 0.1, 4900.0, 0.5),
}
"""zero Hz, zero damping, pole Hz, pole damping"""


def of_scipy(section: tuple[float, ...], rate_Hz: float = 1e4) -> tuple[Any, Any]:
    """b, a of SciPy's bilinear() of H(s), its zeros and poles prewarped."""
    zero_Hz, zero_damping, pole_Hz, pole_damping = section

    def polynomial(f_Hz: float, damping: float) -> list[float]:
        w = 2.0 * rate_Hz * np.tan(np.pi * f_Hz / rate_Hz)
        return [w**-2, 2.0 * damping / w, 1.0]

    return bilinear(polynomial(zero_Hz, zero_damping) if zero_Hz else [1.0], polynomial(pole_Hz, pole_damping), rate_Hz)


def one_section(section: tuple[float, ...]) -> Params:
    """Parameters with this section on x and y."""
    sections = np.zeros((2, 4, 4))
    sections[:, 0] = section
    return replace(P, sections=sections)


def forces(count: int = 1500) -> np.ndarray:
    """A step, a sine sweep, noise."""
    rng, t = np.random.default_rng(21), np.arange(count) * 1e-4
    return np.where(t < 0.03, 100.0, 150.0 * np.sin(2.0 * np.pi * 6000.0 * t**2) + rng.normal(0.0, 20.0, count))


@pytest.mark.parametrize("name", SECTIONS)
def test_oracle_filter_is_scipys_bilinear_of_the_section(name: str) -> None:
    p, state = one_section(SECTIONS[name]), np.zeros((4, 2))
    found = []
    for u in forces():
        y, state = oracle.force_filter(p.sections[0], state, u, p)
        found.append(y)
    np.testing.assert_allclose(found, lfilter(*of_scipy(SECTIONS[name]), forces()), atol=1e-8)


@pytest.mark.parametrize("name", SECTIONS)
def test_section_has_its_zeros_and_poles_exactly_at_their_frequencies(name: str) -> None:
    """What SciPy makes of it is H(s) at the pole's and at the zero's frequency, each prewarped by itself."""
    zero_Hz, zero_damping, pole_Hz, pole_damping = SECTIONS[name]
    b, a = of_scipy(SECTIONS[name])
    numerator, denominator = (np.polyval(c, np.exp(1j * np.pi * 1e-4 * 2 * f)) for c, f in ((b, zero_Hz), (a, pole_Hz)))
    assert freqz(b, a, [0.0])[1][0] == pytest.approx(1.0)
    for f, damping, polynomial, value in (
        (zero_Hz, zero_damping, b, numerator),
        (pole_Hz, pole_damping, a, denominator),
    ):
        at_rest = np.polyval(polynomial, 1.0)
        # (2 j zeta) ((z + 1) / 2)^2 in place of 2 j zeta
        z = np.exp(2j * np.pi * 1e-4 * f)
        assert value / at_rest == pytest.approx((2j * damping if f else 1.0) * ((z + 1) / 2) ** 2, abs=1e-9)


# --- Every module of the core against the oracle ----------------------------------------------------------------------


@pytest.mark.parametrize("path", PATHS)
def test_spline_is_the_oracles_but_for_rounding(core: Core, path: str) -> None:
    within_range(core, path != "widely scattered")
    drive, limit, knots = core.drive(P, PATHS[path]), core.bound.drive(P, PATHS[path]), PATHS[path] * 1e-9
    end_s = 0.31 if core.num == "f32" else 0.29  # at the end some paths stop within a knot
    for t in np.random.default_rng(4).uniform(0.0, end_s, 200):
        s = core.path_time(t)
        expected = oracle.spline(knots, knots[0], core.seconds(s))
        found, allowed = drive.spline(s), limit.spline(s)
        for order, name in enumerate(("r", "d1", "d2", "d3")):
            bound = allowed[name] + of_oracle(expected.r, order)
            check(name, found[name], getattr(expected, name), bound, f"at {t * 1e3:.6f} ms")


def test_spline_starts_from_the_start_position_and_rests_on_the_last_knot(core: Core) -> None:
    knots, start = np.array([[1000, -2000], [4000, 500], [7000, 900]]), np.array([-3000, 600])
    drive, limit = core.drive(P, knots, start), core.bound.drive(P, knots, start)
    for t in (0.0, 0.4e-3, 1.3e-3, 2.5e-3, 3.7e-3, 0.1):
        s, expected = core.path_time(t), oracle.spline(knots * 1e-9, start * 1e-9, t)
        check("r", drive.spline(s)["r"], expected.r, limit.spline(s)["r"] + of_oracle(expected.r, 0), f"at {t} s")
    check("r", drive.spline(core.path_time(0.5))["r"], knots[-1] * 1e-9, QUANTUM_M)


def compare_contour(
    core: Core, knots_nm: np.ndarray, p: Params, t: float, off_m: Any, slip_mps: Any, rate: float, rate_dot: float
) -> None:
    knots, s = knots_nm * 1e-9, core.path_time(t)
    t_s = core.seconds(s)
    ref = oracle.spline(knots, knots[0], t_s)
    q = np.rint((ref.r + off_m) * POS_PER_M)
    q_dot = rate * ref.d1 + slip_mps
    found = core.drive(p, knots_nm).contour(s, rate, rate_dot, q, q_dot)
    c = oracle.contour_error(knots, knots[0], t_s, rate, rate_dot, q / POS_PER_M, q_dot, p)
    allowed = core.bound.drive(p, knots_nm).contour(s, rate, rate_dot, q, q_dot)
    # where a path turns back, the rates of its direction leave the range of fixed point
    a_n = frame_acceleration(c.rotation, c.theta_dot, c.theta_ddot, c.e_turning, c.e_wn_dot, c.rn_ddot)
    turning = core.num == "fix" and (abs(c.theta_ddot) * T0**2 > 4096 or size(a_n) * T0**2 / UM > 4096)
    named = {"t": c.rotation[:, 0], "tau": c.tau_s, "a_n": a_n}
    for name in CONTOUR if not turning else set(CONTOUR) - {"theta_ddot", "a_n"}:
        order = 2 if name.endswith("_ddot") or name == "a_n" else 1 if name.endswith("_dot") else 0
        own = of_oracle(ref.r, order) / (1.0 if name[0] in "rea" else size(ref.d1) + p.v_min_mps)
        expected = named[name] if name in named else getattr(c, name)
        check(name, found[name], expected, allowed[name] + own, f"at {t * 1e3:.6f} ms, off {off_m}, rate {rate}")


@pytest.mark.parametrize("newton", [True, False])
@pytest.mark.parametrize("path", PATHS)
def test_contour_is_the_oracles_but_for_rounding(core: Core, path: str, newton: bool) -> None:
    within_range(core, path != "widely scattered")
    p, rng = replace(P, newton=newton), np.random.default_rng(6)
    for off_m in (0.0, 1e-7, 2e-6, 5e-5):
        for t in rng.uniform(0.05, 0.28, 12):
            off = rng.uniform(-off_m, off_m, 2)
            compare_contour(core, PATHS[path], p, t, off, rng.uniform(-5e-3, 5e-3, 2), 1.0, 0.0)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize(("rate", "rate_dot"), [(0.0, 0.0), (0.3, -20.0), (1.0, 20.0), (1.2, 0.0)])
def test_contour_follows_a_path_time_that_runs_slower_or_faster(
    core: Core, path: str, rate: float, rate_dot: float
) -> None:
    within_range(core, path != "widely scattered")
    rng = np.random.default_rng(7)
    for t in rng.uniform(0.05, 0.28, 12):
        compare_contour(
            core, PATHS[path], P, t, rng.uniform(-2e-6, 2e-6, 2), rng.uniform(-1e-3, 1e-3, 2), rate, rate_dot
        )


@pytest.mark.parametrize("path", ["slow circle", "fast circle", "reversal", "standstill"])
@pytest.mark.parametrize("off_mm", [(4.0, 4.0), (-4.0, 0.5), (0.0, -4.0)])
def test_contour_far_off_the_path_is_clamped_as_the_oracle_is(core: Core, path: str, off_mm: Any) -> None:
    """At the edge of the signal range, +-4096 um along and across the path: every clamp of the foot point is full."""
    within_range(core, path != "reversal")
    off_m = np.array(off_mm) * (0.7e-3 if core.num == "fix" else 1e-3)
    for t in np.random.default_rng(8).uniform(0.05, 0.28, 10):
        compare_contour(core, PATHS[path], P, t, off_m, np.array([0.1, -0.1]), 1.0, 0.0)


@pytest.mark.parametrize("x", [0.0, 1e-6, -1e-3, 0.1, -0.5, 1.0, 2.0, -3.3, 4.0])
def test_cosh_and_sinh_keep_their_promise(core: Core, x: float) -> None:
    """1e-6 and 2e-5 of cosh x; the rounding of x is of the same kind, and its derivatives are sinh x and cosh x."""
    promise = (1e-6 if core.num == "f32" else 2e-5) * np.cosh(x) + rounding(core.num, x, 1.0) * np.cosh(x) + READ
    check("cosh, sinh", core.drive(P).cosh(x), (np.cosh(x), np.sinh(x)), promise)


@pytest.mark.parametrize("x", [0.0, 1e-5, 0.3, 1.0, 2.5, 7.0, 16.0])
def test_decay_keeps_its_promise(core: Core, x: float) -> None:
    check("exp(-x)", core.drive(P).decay(x), np.exp(-x), 3e-6 if core.num == "f32" else 5e-5)


def test_cosine_and_sine_keep_their_promise(core: Core) -> None:
    for phase in [*np.random.default_rng(15).integers(0, 2**32, 200), *(i * 2**29 for i in range(8))]:
        angle = phase / 2**31 * np.pi
        promise = 5e-7 if core.num == "f32" else 1e-5
        check("cosine, sine", core.drive(P).circle(int(phase)), (np.cos(angle), np.sin(angle)), promise)


REAL = replace(
    P,
    presliding_m=np.array([20e-6, 0.0]),
    breakaway=np.array([1.25, 1.4]),
    stribeck_mps=np.array([4e-3, 1e-3]),
    lead_m=np.array([5e-3, 20e-3]),
    cogging_cos_N=np.array([[3.0, -1.0, 0.5], [0.0, 2.0, -0.7]]),
    cogging_sin_N=np.array([[-1.0, 0.3, 0.9], [1.0, -2.0, 0.2]]),
    ripple_cos=np.array([[0.01, -0.02, 0.005], [0.0, 0.03, -0.01]]),
    ripple_sin=np.array([[-0.01, 0.01, 0.002], [0.02, 0.0, 0.004]]),
)


def test_friction_is_the_oracles_but_for_rounding(core: Core) -> None:
    """Back and forth by all distances about the presliding one; what is remembered differs from turn to turn."""
    drive, limit, rng = core.drive(REAL), core.bound.drive(REAL), np.random.default_rng(16)
    turns, steps, most = [0.0], 0, 0.0
    for k in range(80):
        v = (-1) ** k * 10.0 ** rng.uniform(-4.0, -1.5)
        distance = 10.0 ** rng.uniform(-7.0, -4.0)
        for _ in range(min(int(np.ceil(distance / v / P.dt_s * (-1) ** k)), 40)):
            r_dot = np.array([v, v])
            found, allowed = drive.friction(r_dot), limit.friction(r_dot)
            turns = oracle.remembered(turns, turns[-1] + v * P.dt_s)
            along = np.array([oracle.slip(turns, REAL.presliding_m[0]), oracle.sat(r_dot, P.friction_speed_mps)[1]])
            steps += 1
            # Where an element begins to slip, the other back end may do so later, by a rounding a step.
            late = steps * sum(rounding(core.num, 1e-5, UM) / (1e-5 * n) for n in range(1, 9))
            check(
                "shape",
                found,
                along * oracle.stribeck(r_dot, REAL),
                allowed + np.array([2.0 * late + 1e-5, 1e-5]),
                f"step {steps}",
            )
            most = max(most, len(turns))
    assert most > 4


def test_cogging_and_ripple_are_cancelled_as_the_oracle_does(core: Core) -> None:
    drive, limit, rng = core.drive(REAL), core.bound.drive(REAL), np.random.default_rng(17)
    for _ in range(200):
        at, force = rng.integers(-(10**14), 10**14, 2), rng.uniform(-600.0, 600.0, 2)
        expected = oracle.screw_demand(force, at / POS_PER_M, REAL)
        angle = 12.0 * np.pi * (np.max(np.abs(at)) * 2.0**-65 + 2.0**-32)  # of the factor, half a step; of the phase
        check("demand", drive.screw(at, force), expected, limit.screw(at, force) + 60.0 * angle + 1e-4)


def test_oracle_motor_gives_the_force_that_was_wanted() -> None:
    rng = np.random.default_rng(18)
    for _ in range(20):
        force, at = rng.uniform(-600.0, 600.0, 2), rng.uniform(-1.0, 1.0, 2)
        demand = oracle.screw_demand(force, at, REAL)
        np.testing.assert_allclose([oracle.motor_force(demand[i], at[i], i, REAL) for i in (0, 1)], force)


def law_inputs(rng: np.random.Generator, e_m: float, e_dot_mps: float) -> dict[str, np.ndarray]:
    scale = {"e_w": e_m, "e_w_dot": e_dot_mps, "e": e_m, "e_dot": e_dot_mps, "r_ddot": 5.0, "q_dot": 0.3, "r_dot": 1e-4}
    return {name: rng.uniform(-v, v, 2) for name, v in scale.items()}


@pytest.mark.parametrize("stiffness", [0.0, 3e4])
@pytest.mark.parametrize("printed", [False, True])
@pytest.mark.parametrize(
    ("e_m", "e_dot_mps"), [(0.0, 0.0), (1e-7, 1e-5), (1e-5, 1e-3), (2e-4, 0.02), (9e-4, 0.1), (4e-3, 0.8)]
)
def test_law_is_the_oracles_but_for_rounding(
    core: Core, e_m: float, e_dot_mps: float, printed: bool, stiffness: float
) -> None:
    within_range(core, e_m < 9e-4)
    p, rng = replace(P, psi_printed=printed, stiffness_1ps2=stiffness), np.random.default_rng(9)
    drive, limit = core.drive(p), core.bound.drive(p)
    for k_hat in ([100.0, 150.0], [399.99, 99.0], [120.0, 110.0]) * 10:
        angle, w, w_dot = rng.uniform(-4.0, 4.0), rng.uniform(-30.0, 30.0), rng.uniform(-500.0, 500.0)
        c, k = law_inputs(rng, e_m, e_dot_mps), np.array(k_hat)
        rot = oracle.rotation(angle)
        given = {name: c[name] for name in ("e", "e_dot", "q_dot", "r_dot")} | {
            "t": rot[:, 0],
            "a_n": frame_acceleration(rot, w, w_dot, c["e_w"], c["e_w_dot"], c["r_ddot"]),
        }
        found, allowed = (d.law(k, **given) for d in (drive, limit))
        force, s_bar = oracle.contouring_law(
            *(rot, w, w_dot, c["e_w"], c["e_w_dot"], c["e"], c["e_dot"], c["r_ddot"], c["q_dot"], k, p)
        )
        expected = {
            "s_bar": s_bar,
            "u_linear": force,
            "u_friction": oracle.friction(c["r_dot"], p),
            "k_hat": oracle.adapt_k(k, s_bar, p.dt_s, p),
        }
        for name, value in expected.items():
            check(name, found[name], value, allowed[name])


@pytest.mark.parametrize("in_axes", [False, True])
@pytest.mark.parametrize("printed", [False, True])
@pytest.mark.parametrize(("z_m", "z_dot_mps"), [(0.0, 0.0), (1e-7, 1e-5), (1e-5, 1e-3), (2e-3, 0.1)])
def test_compensator_is_the_oracles_but_for_rounding(
    core: Core, z_m: float, z_dot_mps: float, printed: bool, in_axes: bool
) -> None:
    p, rng = replace(P, mu_printed=printed, in_axes=in_axes), np.random.default_rng(10)
    drive, limit, z_max = core.drive(p), core.bound.drive(p), P.phi_mps / P.alpha_1ps
    for mu in ([1.0, 2.0], [3.9999999, 0.5]) * 15:
        rot, w = oracle.rotation(rng.uniform(-4.0, 4.0)), rng.uniform(-30.0, 30.0)
        q = rng.integers(-(10**12), 10**12, 2)
        q_bar = q - np.rint(rng.uniform(-z_m, z_m, 2) * POS_PER_M).astype(np.int64)
        q_dot = rng.uniform(-0.2, 0.2, 2)
        q_bar_dot = q_dot - rng.uniform(-z_dot_mps, z_dot_mps, 2)
        found, allowed = (d.compensation(rot[:, 0], w, q, q_dot, q_bar, q_bar_dot, mu) for d in (drive, limit))
        z = np.clip((q - q_bar) / POS_PER_M, -z_max, z_max)
        z_n, s, v, force = oracle.compensation(z, q_dot - q_bar_dot, rot, w, np.array(mu), p)
        expected = {"z_n": z_n, "s": s, "v": v, "u": force, "mu": oracle.adapt_mu(np.array(mu), s, p.dt_s, p)}
        for name, value in expected.items():
            check(name, found[name], value, allowed[name])
        check("q_bar", (q - found["q_bar"]) / POS_PER_M, z, np.array(allowed["q_bar"]) / POS_PER_M + QUANTUM_M)


def test_reference_model_is_the_oracles_but_for_rounding(core: Core) -> None:
    drive, limit, rng = core.drive(P), core.bound.drive(P), np.random.default_rng(11)
    for _ in range(50):
        q_bar, velocity, u = rng.integers(-(10**12), 10**12, 2), rng.uniform(-0.3, 0.3, 2), rng.uniform(-600, 600, 2)
        (pos, after), (d_pos, d_after) = (d.model(u, q_bar, velocity) for d in (drive, limit))
        expected_pos, expected = oracle.reference_model(q_bar / POS_PER_M, velocity, u, P)
        moved, expected_moved = (np.array(pos) - q_bar) / POS_PER_M, expected_pos - q_bar / POS_PER_M
        check("velocity", after, expected, d_after)
        check("position", moved, expected_moved, np.array(d_pos) / POS_PER_M + of_oracle(expected_pos, 0))


def test_observer_is_the_oracles_but_for_rounding(core: Core) -> None:
    drive, limit, rng = core.drive(P), core.bound.drive(P), np.random.default_rng(12)
    gains = oracle.observer_gains(P.observer_radps, P.dt_s)
    for _ in range(50):
        for miss_m in (0.0, 1e-7, 5e-4 if core.num == "fix" else 1e-3):
            pos = rng.integers(-(10**12), 10**12, 2)
            vel, rest, force = rng.uniform(-0.3, 0.3, 2), rng.uniform(-3.0, 3.0, 2), rng.uniform(-600.0, 600.0, 2)
            measured = pos + np.rint((vel * P.dt_s + rng.uniform(-miss_m, miss_m, 2)) * POS_PER_M).astype(np.int64)
            x, acceleration = oracle.observe(
                np.array([pos / POS_PER_M, vel, rest]), measured / POS_PER_M, force, P, gains
            )
            for i in (0, 1):
                state = (i, measured[i], force[i], pos[i], vel[i], rest[i])
                (at, *found), (d_at, *allowed) = drive.observe(*state), limit.observe(*state)
                bound = d_at / POS_PER_M + of_oracle(x[0], 0)
                check("position", (at - pos[i]) / POS_PER_M, x[0, i] - pos[i] / POS_PER_M, bound)
                unseen = of_oracle(x[0], 0) * gains * [0.0, 1.0, 1.0]
                check("velocity, rest", found[:2], x[1:, i], allowed[:2] + unseen[1:])
                check("acceleration", found[2], acceleration[i], allowed[2])


def test_watch_for_oscillation_sees_what_the_oracle_sees(core: Core) -> None:
    """Each draw: a swing of some frequency that grows or decays, steps, and noise, over a path of 30 Hz."""
    drive, rng, seen = core.drive(P), np.random.default_rng(27), 0
    p, t = core.params(), np.arange(5000) * 1e-4
    for trial in range(40):
        axis = trial % 2
        count_N = float(rng.choice([0.0, 0.5, 2.0]))
        watch = oracle.Watch(30.0, count_N, 200.0, float(rng.uniform(0.01, 0.06)), int(rng.integers(100, 400)), 600)
        swing = rng.uniform(10.0, 90.0) * np.exp(rng.uniform(-8.0, 3.0) * t) * np.sin(rng.uniform(150.0, 2500.0) * t)
        steps = rng.choice([0.0, 60.0]) * np.sign(np.sin(rng.uniform(30.0, 200.0) * t))
        beyond = np.clip(swing + steps + rng.normal(0.0, 3.0, len(t)), -600.0, 600.0)
        r_dot, r_ddot = 0.1 * np.cos(190.0 * t), rng.uniform(-4.0, 4.0) * np.sin(190.0 * t)
        net = beyond + p.mass_kg[axis] * r_ddot + p.viscous_Nspm[axis] * r_dot
        expected = oracle.oscillations(watch, beyond, 1e-4)
        found = drive.oscillations(axis, watch, net, r_dot, r_ddot)
        assert [at for at, _, _ in found] == [at for at, _, _ in expected]
        np.testing.assert_allclose([f[1:] for f in found], [e[1:] for e in expected], rtol=1e-3)
        seen += len(found)
    assert seen > 30


def a_map(rng: np.random.Generator, points: int) -> dict[str, Any]:
    return {
        "points": points,
        "start_nm": int(rng.integers(-(10**8), 10**8)),
        "step_nm": int(rng.integers(10**6, 10**7)),
        "lead": list(rng.integers(-300_000, 300_000, points) * 1e-9),
    }


GEOMETRY_STATE = ("placed", "bridge", "turn", "turn_bridge", "deflection", "target", "side", "side_rate")


@pytest.mark.parametrize("points", [0, 2, 64])
def test_geometry_is_the_oracles_but_for_rounding(core: Core, points: int) -> None:
    drive, limit, rng = core.drive(P), core.bound.drive(P), np.random.default_rng(15)
    dt = core.params().dt_s
    for trial in range(200):
        given = [
            a_map(rng, points)
            | {
                "origin_nm": int(rng.integers(-(10**8), 10**8)),
                "screw": rng.choice([5e-3, 20e-3]),
                "error_cos": rng.uniform(-2e-5, 2e-5),
                "error_sin": rng.uniform(-2e-5, 2e-5),
                "squareness": rng.uniform(-1e-3, 1e-3),
                "compliance": rng.uniform(0.0, 1e-6),
                "mass": rng.uniform(0.0, 200.0),
                "coulomb": rng.uniform(0.0, 100.0),
                "viscous": rng.uniform(0.0, 1000.0),
                "backlash": rng.uniform(0.0, 50e-6),
                "side_bandwidth": rng.uniform(100.0, 900.0),
                "mass_before": rng.choice([0.0, rng.uniform(0.0, 100.0)]),
                "r_dot": rng.uniform(-0.3, 0.3) * (trial % 3 > 0),
                "r_ddot": rng.uniform(-5.0, 5.0) * (trial % 3 > 0),
                "direction": rng.uniform(-1.0, 1.0) * (trial % 3 > 0),
                "placed": rng.uniform(-1e-4, 1e-4),
                "bridge": rng.choice([0.0, 1e-9, -5e-5, 5e-5]),
                "turn": rng.uniform(-2e-5, 2e-5),
                "turn_bridge": rng.choice([0.0, 1e-9, -2e-5, 2e-5]),
                "deflection": rng.uniform(-2e-5, 2e-5),
                "target": rng.choice([-1.0, 0.0, 1.0]),
                "side": rng.uniform(-1.0, 1.0),
                "side_rate": rng.uniform(-300.0, 300.0),
            }
            for _ in range(2)
        ]
        for axis in given:
            axis["last_origin_nm"] = axis["origin_nm"] - trial % 2
        encoder = np.rint(rng.uniform(-0.3, 0.3, 2) * POS_PER_M).astype(np.int64)

        def both(name: str, axes: Any = given) -> np.ndarray:
            return np.array([axis[name] for axis in axes])

        lead = [((a["start_nm"] + a["step_nm"] * np.arange(points)) * 1e-9, np.array(a["lead"])) for a in given]
        with np.errstate(divide="ignore"):
            machine = oracle.Machine(
                (lead[0], lead[1]), both("screw"), both("error_cos") - 1j * both("error_sin"), both("squareness"),
                1.0 / both("compliance"), both("mass"), both("coulomb"), both("viscous"), both("backlash"),
                both("side_bandwidth"), both("mass_before"),
            )  # fmt: skip
        before = oracle.Transmission(*(both(name) for name in GEOMETRY_STATE))
        user = np.rint(encoder / 65536.0) * 1e-9 + both("origin_nm") * 1e-9
        reference = both("r_dot"), both("r_ddot"), both("direction")
        *corrections, after = oracle.geometry(machine, before, user, *reference, trial % 2 > 0, dt)
        found, allowed = drive.geometry(given, encoder), limit.geometry(given, encoder)
        state = dict(zip(GEOMETRY_STATE, vars(after).values(), strict=True))
        results = "by_position", "by_angle", "by_force", "gap_force"
        expected = state | dict(zip(results, corrections, strict=True))
        # screw_turns() is rounded to half a step of 2^-48 / lead, and a sine to 5e-7, or 1e-5 (core/trig.h)
        angle = 2.0 * np.pi * np.abs(user) * 1e9 / 2.0**49 + {"f32": 5e-7, "fix": 1e-5}[core.num]
        turn = angle * (np.abs(both("error_cos")) + np.abs(both("error_sin")))
        for name, x in expected.items():
            unseen = turn if name in ("turn", "turn_bridge", "by_angle") else 0.0
            check(name, both(name, found), x, both(name, allowed) + of_oracle(user, 0) + unseen)


def test_dual_feedback_is_the_oracles_but_for_rounding(core: Core) -> None:
    drive, limit, rng = core.drive(P), core.bound.drive(P), np.random.default_rng(16)
    dt, agreed = core.params().dt_s, set()
    for _ in range(200):
        crossover, offset, tolerance = rng.uniform(1.0, 6000.0), rng.uniform(-1e-3, 1e-3), rng.uniform(1e-6, 4e-3)
        first = rng.integers(-(10**13), 10**13)
        encoders = first, first + round(rng.uniform(-2e-3, 2e-3) * POS_PER_M)
        expected, agree = oracle.dual_feedback(np.array(encoders) / POS_PER_M, offset, crossover, tolerance, dt)
        found, agrees = drive.dual_feedback(crossover, tolerance, offset, encoders)
        allowed, _ = limit.dual_feedback(crossover, tolerance, offset, encoders)
        check("offset", found, expected, allowed + of_oracle(np.array(encoders) / POS_PER_M, 0))
        assert agrees == agree
        agreed.add(agree)
    assert agreed == {False, True}


@pytest.mark.parametrize("coupled", [False, True])
def test_cascade_is_the_oracles_but_for_rounding(core: Core, coupled: bool) -> None:
    p = replace(P, coupling=0.7)
    drive, limit, rng = core.drive(p), core.bound.drive(p), np.random.default_rng(13)
    knots = PATHS["eight"] * 1e-9
    for off_m in (0.0, 1e-6, 1e-4, 5e-4 if core.num == "fix" else 4e-3):
        for _ in range(20):
            t = rng.uniform(0.05, 0.28)
            q, q_dot = smooth_state(knots, t, rng)
            c = oracle.contour_error(knots, knots[0], t, 1.0, 0.0, q + rng.uniform(-off_m, off_m, 2), q_dot, P)
            integral = rng.uniform(-1e-3, 1e-3, 3)
            names = ("r_dot", "r_ddot", "e_w", "e_w_dot", "e_n", "e_n_dot")
            given = {name: getattr(c, name) for name in names} | {"t": c.rotation[:, 0]}
            (force, after), (d_force, d_after) = (d.cascade(given, coupled, integral) for d in (drive, limit))
            expected, ints, coupled_int = oracle.cascade(c, integral[:2], float(integral[2]), coupled, p)
            check("force", force, expected, d_force)
            check("integral", after, [*ints, coupled_int], d_after)


@pytest.mark.parametrize("axis", [0, 1])
def test_force_filter_is_the_oracles_but_for_rounding(core: Core, axis: int) -> None:
    rng, kinds = np.random.default_rng(22), list(SECTIONS.values())
    for first in range(len(kinds)):
        sections = np.zeros((2, 4, 4))
        used = [n for n in range(4) if n != first % 5]  # 5: a section that is off is left out, also between two
        for n, row in enumerate(used):
            sections[axis, row] = kinds[(first + n) % len(kinds)]
        p = replace(P, sections=sections)
        for scale in (1e-3, 1.0, 100.0):
            state, u = np.zeros((4, 2)), rng.uniform(-scale, scale)
            state[used] = rng.uniform(-scale, scale, (len(used), 2))
            expected, after = oracle.force_filter(sections[axis], state, u, p)
            packed = np.zeros((4, 2))
            packed[: len(used)] = state[used]
            (found, found_after), (d, d_after) = (
                lib.drive(p).force_filter(axis, packed, u) for lib in (core, core.bound)
            )
            check("force", found, expected, d, f"section {first}")
            check("state", found_after[: len(used)], after[used], d_after[: len(used)], f"section {first}")


@pytest.mark.parametrize("name", SECTIONS)
def test_force_filter_gives_scipys_forces_over_a_run(core: Core, name: str) -> None:
    """Each period errs by what the bound says of it, and the section carries that on as it does its states."""
    p = one_section(SECTIONS[name])
    drive, limit, u = core.drive(p), core.bound.drive(p), forces()
    unit = [oracle.force_filter(p.sections[0], np.vstack([e, np.zeros((3, 2))]), 0.0, p) for e in np.eye(2)]
    a, c = np.array([after[0] for _, after in unit]).T, np.array([y for y, _ in unit])
    carried, power = np.zeros(2), np.eye(2)
    for _ in range(len(u)):
        carried, power = carried + np.abs(c @ power), a @ power
    state, found, error, d_state = np.zeros((4, 2)), [], 0.0, np.zeros(2)
    for force in u:
        d, d_after = limit.force_filter(0, state, force)
        error, d_state = max(error, d), np.maximum(d_state, d_after[0])
        y, state = drive.force_filter(0, state, force)
        found.append(y)
    check("force", found, lfilter(*of_scipy(SECTIONS[name]), u), error + carried @ d_state, name)


@pytest.mark.parametrize("force", [0.0, 123.456, -599.0])
def test_force_filter_at_its_steady_state_changes_nothing(core: Core, force: float) -> None:
    p = replace(P, sections=np.tile([list(SECTIONS[k]) for k in ("notch", "low-pass", "lead", "lag")], (2, 1, 1)))
    start = oracle.force_filter_at(float(core.bound.num == "f32") * force or np.float32(force))
    y, after = core.drive(p).force_filter(1, start, float(start[0, 1]))
    assert y == pytest.approx(float(start[0, 1]), abs=2.0**-19 if core.num == "fix" else 0.0)
    np.testing.assert_allclose(after, start, atol=2.0**-19 if core.num == "fix" else 0.0)


@pytest.mark.parametrize(
    "section",
    [
        (0.0, 0.0, 4900.001, 0.7),
        (0.0, 0.0, 5000.0, 0.7),
        (0.0, 0.0, 0.999, 0.7),
        (4900.001, 0.7, 800.0, 0.7),
        (0.999, 0.7, 1.0, 0.7),
        (50.0, 0.7, 510.0, 0.7),
    ],
)
def test_force_filter_that_cannot_be_had_is_refused(core: Core, section: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="cannot be had"):
        core.drive(one_section(section))


def test_force_limit_is_the_oracles_but_for_rounding(core: Core) -> None:
    rng = np.random.default_rng(23)
    for continuous in ([200.0, 350.0], [60.0, 0.0], [0.0, 601.0], [12.0, 590.0]):
        p = replace(P, continuous_N=np.array(continuous), thermal_s=np.array([0.5, 200.0]))
        drive, limit = core.drive(p), core.bound.drive(p)
        for heat in (0.0, 0.5, 0.9499, 0.951, 0.97, 0.9999, 1.001, 1.3):
            force = rng.uniform(-600.0, 600.0, 2)
            expected_heat, expected = oracle.force_limit(np.full(2, heat), force, p)
            (found_heat, found), (d_heat, d) = (x.force_limit([heat, heat], force) for x in (drive, limit))
            check("heat", found_heat, expected_heat, d_heat)
            check("limit", found, expected, d, f"continuous {continuous}, heat {heat}")


def test_power_is_the_oracles_but_for_rounding(core: Core) -> None:
    drive, limit, rng = core.drive(P), core.bound.drive(P), np.random.default_rng(14)
    for scale in (1e-6, 1e-4, 1e-2, 0.3):
        for _ in range(20):
            v, a = rng.uniform(-scale, scale, 2), rng.uniform(-5.0, 5.0, 2)
            expected = oracle.power(v, a, P)
            for i in (0, 1):
                check("power", drive.power(i, v[i], a[i]), expected[i], limit.power(i, v[i], a[i]))


# --- The whole servo --------------------------------------------------------------------------------------------------

STEPS = 2000


def force_bound(num: str, controller: str, p: Params, speed: float, acceleration: float) -> float:
    """What 2,000 steps of rounding may do to the force, N.

    The observer is stable: of each step's roundings, 4 of the velocity, it keeps the sum over its memory of
    3/(1 - p) steps. The law multiplies velocity errors by M (A + K), the compensator by M (alpha + mu/phi), the
    cascade by M K_v (twice if coupled); (8) brings r_n'' with some 12 roundings of A + w^2 F, F within 2 K_v of e'.
    The reference model of `ccu` has no innovation: over the run the velocity walks at random by 1/sqrt(3) rounding a
    step, and half of that again by each of u_bar/M dt; 3 sigma of it enter with M (alpha + mu/phi).
    In fixed point a rounding is not relative, and what has a large factor counts: in the observer the innovation's 2
    roundings by its gains, and the gains' own, which (1 - p)/dt carries, by an innovation of one encoder count; in
    (8), (15) those of theta' by the speed, 4 times. These last, so that what the compensator
    makes of them is adapted as friction and mass.
    """
    gains = oracle.observer_gains(p.observer_radps, p.dt_s)
    memory = 3.0 / (1.0 - (1.0 - gains[0]) ** (1.0 / 3.0))
    mass = float(np.max(p.mass_kg))
    roundings, of_acceleration = 4.0, 12.0
    if num == "fix":
        dt, r = p.dt_s / T0, 3.0 / memory / p.dt_s * T0
        roundings += 2.0 * T0 * (gains[1] + gains[2] * p.dt_s * memory)
        roundings += (6.0 * r + 3.0 * r**2 * dt * memory) * p.encoder_m / UM
        of_acceleration += 4.0 * speed / (UM / T0)
    d_velocity = roundings * rounding(num, speed, UM / T0) * memory
    a = p.lambda_1ps + p.beta * p.gamma_1ps
    gain = {"cascade": p.k_v_1ps, "ccc": 2.0 * p.k_v_1ps}.get(controller, a + p.k_max_1ps)
    bound = mass * (gain * d_velocity + of_acceleration * rounding(num, acceleration, UM / T0**2))
    adapted = 1.0 + (p.friction_rate_1ps + p.mass_rate_1ps) * STEPS * p.dt_s
    compensator = mass * (p.alpha_1ps + p.mu_max_mps2 / p.phi_mps) * (adapted if num == "fix" else 1.0)
    if controller == "ccu":
        walk = 3.0 * np.sqrt(STEPS) * rounding(num, speed, UM / T0) / np.sqrt(3.0)
        bound += compensator * (d_velocity + walk)
    return bound


@pytest.mark.parametrize("controller", oracle.CONTROLLERS)
@pytest.mark.parametrize(("path", "speed"), [("slow circle", SLOW), ("tight fast circle", FAST)])
def test_servo_gives_the_oracles_forces_on_the_same_encoder_readings(
    core: Core, controller: str, path: str, speed: float
) -> None:
    p = core.params()
    loop, drive = oracle.Loop(p, PATHS[path], seed=1, controller=controller), core.drive(p, PATHS[path])
    drive.reset(np.rint(loop.plant.encoder() * POS_PER_M))
    bound = force_bound(core.num, controller, p, 1.1 * speed, (1.1 * speed) ** 2 / 4e-3 + 3.0)
    biggest = 0.0
    for k in range(STEPS):
        measured = np.rint(loop.plant.encoder() * POS_PER_M)
        expected = loop.step()
        force, *_, energy = drive.step(core.path_time(k * p.dt_s), measured, controller)
        check("force", force, expected, bound, f"at step {k}")
        biggest = max(biggest, size(expected))
    assert biggest > 50.0
    # mJ: the power errs by 14 U of itself and by what an error of the acceleration makes of it
    assert energy == pytest.approx(loop.servo.state.energy_J.sum(), rel=1e-5)


def test_servo_gives_the_oracles_forces_when_controllers_and_path_rate_change(core: Core) -> None:
    """Every 100 steps another controller; the path slows down, stands still and goes on; the drive is off a while."""
    p, knots = core.params(), PATHS["fast circle"]
    plant = oracle.Plant(p, knots[0] * 1e-9, seed=2)
    servo, drive = oracle.Servo(p, knots, plant.encoder()), core.drive(p, knots)
    drive.reset(np.rint(plant.encoder() * POS_PER_M))
    bound = max(force_bound(core.num, c, p, 0.11, 4.0) for c in oracle.CONTROLLERS)
    s, rate = 0, 0.0
    for k in range(STEPS):
        rate_dot = 10.0 if k < 1000 or k > 1600 else -30.0
        enabled = not 1350 <= k < 1500
        rate = min(max(rate + rate_dot * p.dt_s, 0.0), 1.2)
        rate_dot = rate_dot if 0.0 < rate < 1.2 else 0.0
        s += int(rate * core.path_one / 10)
        controller = oracle.CONTROLLERS[(k // 100) * 3 % 5]
        measured = plant.encoder()
        expected = servo.step(measured, core.seconds(s), controller, rate, rate_dot, enabled)
        force, *_ = drive.step(s, np.rint(measured * POS_PER_M), controller, rate, rate_dot, enabled)
        check("force", force, expected, bound, f"at step {k}, {controller}")
        plant.step(expected)


def filter_gain(p: Params) -> float:
    """The largest that filters make of forces within +-1: the sum of their impulse response."""
    gains = []
    for sections in p.sections:
        state, total = np.zeros((4, 2)), 0.0
        for k in range(STEPS):
            y, state = oracle.force_filter(sections, state, float(k == 0), p)
            total += abs(y)
        gains.append(total)
    return max(gains)


def test_servo_gives_the_oracles_forces_with_force_filters(core: Core) -> None:
    """The controller changes and the drive is off a while, as it is where filters start anew."""
    sections = np.zeros((2, 4, 4))
    sections[0, :2] = SECTIONS["shallow notch"], SECTIONS["low-pass"]
    sections[1, 2] = SECTIONS["notch"]
    p = core.params(sections=sections)
    loop, drive = oracle.Loop(p, PATHS["fast circle"], seed=4), core.drive(p, PATHS["fast circle"])
    drive.reset(np.rint(loop.plant.encoder() * POS_PER_M))
    bound = max(force_bound(core.num, c, p, 0.15, 10.0) for c in ("cc", "cascade")) * filter_gain(p)
    for k in range(STEPS):
        controller = "cc" if k // 300 % 2 else "cascade"
        enabled = not 1000 <= k < 1200
        measured = loop.plant.encoder()
        expected = loop.servo.step(measured, core.seconds(core.path_time(k * p.dt_s)), controller, enabled=enabled)
        force, *_ = drive.step(core.path_time(k * p.dt_s), np.rint(measured * POS_PER_M), controller, enabled=enabled)
        check("force", force, expected, bound, f"at step {k}")
        loop.plant.step(expected)


def test_servo_gives_the_oracles_forces_at_a_limit_that_its_heat_lowers(core: Core) -> None:
    peak, continuous = P.force_max_N[0], 225.0
    p = core.params(continuous_N=np.array([0.0, continuous]), thermal_s=np.array([10.0, 0.1]))
    loop, drive = (
        oracle.Loop(p, PATHS["tight fast circle"], seed=4, controller="cascade"),
        core.drive(p, PATHS["tight fast circle"]),
    )
    drive.reset(np.rint(loop.plant.encoder() * POS_PER_M))
    # The heat errs by 8 roundings, those of 1 / continuous, and those of the force; the limit by 20 (peak - continuous)
    # times as much.
    bound = force_bound(core.num, "cascade", p, 0.15, 10.0)
    of_heat = 8.0 * rounding(core.num, 1.0, 1.0) + 2.0 * continuous * rounding(core.num, 1.0 / continuous, 1.0)
    bound += 20.0 * (peak - continuous) * (of_heat + 2.0 * bound / continuous)
    limited = []
    for k in range(STEPS):
        measured = np.rint(loop.plant.encoder() * POS_PER_M)
        expected = loop.step()
        force, *_ = drive.step(core.path_time(k * p.dt_s), measured, "cascade")
        check("force", force, expected, bound, f"at step {k}")
        if loop.servo.state.saturated:
            limited.append(abs(expected[1]))
    assert len(limited) > 50
    assert continuous <= min(limited) < max(limited) < peak


@pytest.mark.parametrize("controller", oracle.CONTROLLERS)
def test_servo_gives_the_oracles_forces_with_friction_cogging_and_ripple(core: Core, controller: str) -> None:
    """On a path with reversals, and off for a while. The bound grows by what the tests above allow."""
    on = {name: getattr(REAL, name) for name in ("presliding_m", "breakaway", "stribeck_mps", "lead_m")}
    on |= {name: getattr(REAL, name) for name in ("cogging_cos_N", "cogging_sin_N", "ripple_cos", "ripple_sin")}
    p = core.params(**on)
    plant = oracle.Plant(p, PATHS["slow circle"][0] * 1e-9, seed=4)
    servo, drive = oracle.Servo(p, PATHS["slow circle"], plant.encoder()), core.drive(p, PATHS["slow circle"])
    drive.reset(np.rint(plant.encoder() * POS_PER_M))
    bound = force_bound(core.num, controller, p, 1.1 * SLOW, 3.0) + (0.02 if core.num == "f32" else 0.1)
    for k in range(STEPS):
        measured, enabled = plant.encoder(), not 900 <= k < 1000
        expected = servo.step(measured, k * p.dt_s, controller, enabled=enabled)
        force, *_ = drive.step(core.path_time(k * p.dt_s), np.rint(measured * POS_PER_M), controller, enabled=enabled)
        check("force", force, expected, bound, f"at step {k}")
        plant.step(expected)
    assert size(servo.state.shape) > 1.0


@pytest.mark.parametrize("controller", ["ccu", "cascade"])
@pytest.mark.parametrize("shaped", [False, True])
def test_servo_gives_the_oracles_forces_where_they_act_late(core: Core, controller: str, shaped: bool) -> None:
    """At another rate of the path, and off for a while."""
    shape = {name: getattr(REAL, name) for name in ("presliding_m", "breakaway", "stribeck_mps")} if shaped else {}
    p, path, rate = core.params(force_delay_s=np.array([1.2e-3, 0.4e-3]), **shape), PATHS["fast circle"], 0.75
    plant = oracle.Plant(p, path[0] * 1e-9, seed=4)
    servo, drive = oracle.Servo(p, path, plant.encoder()), core.drive(p, path)
    drive.reset(np.rint(plant.encoder() * POS_PER_M))
    bound = force_bound(core.num, controller, p, 0.15, 10.0) + (0.02 if core.num == "f32" else 0.1)
    most = 0.0
    for k in range(STEPS):
        measured, enabled = plant.encoder(), not 900 <= k < 1000
        s = core.path_time(rate * k * p.dt_s)
        expected = servo.step(measured, core.seconds(s), controller, rate, enabled=enabled)
        force, *_ = drive.step(s, np.rint(measured * POS_PER_M), controller, rate, enabled=enabled)
        check("force", force, expected, bound, f"at step {k}")
        plant.step(expected)
        most = max(most, size(servo.state.lead_N))
    assert most > 5.0


def test_servo_takes_the_printed_forms_where_they_are_selected(core: Core) -> None:
    p = core.params(psi_printed=True, mu_printed=True, input_printed=True, newton=False, rho_1ps2=50.0)
    loop, drive = oracle.Loop(p, PATHS["slow circle"], seed=3), core.drive(p, PATHS["slow circle"])
    drive.reset(np.rint(loop.plant.encoder() * POS_PER_M))
    bound = force_bound(core.num, "ccu", p, 1.1 * SLOW, 3.0)
    for k in range(500):
        measured = np.rint(loop.plant.encoder() * POS_PER_M)
        expected = loop.step()
        force, *_ = drive.step(core.path_time(k * p.dt_s), measured, "ccu")
        check("force", force, expected, bound, f"at step {k}")
