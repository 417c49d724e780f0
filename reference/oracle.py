# SPDX-License-Identifier: Apache-2.0
"""The control loop of `firmware/core` once more, in NumPy double precision, written from the equations.

Why: a control law in float32 or fixed point needs something to be compared with that shares nothing with it.
This file is written from the paper's equations in the form in which the paper has them: angles, rotation matrices,
Q = R S R^T and its derivatives by the product rule, B-spline basis polynomials, exp() in (11), C1...C6 in (30). The
firmware uses none of these forms (it has tangents, scalars f and g, differences of knots, doubling formulas, the
product V I). Where both agree to float32 resolution, a slip of algebra in either is unlikely.

Source: "Adaptive Sliding Mode Contouring Control Design Based on Reference Adjustment and Uncertainty Compensation
for Feed Drive Systems"; numbers in brackets are its equations. Where the paper is singular, misprinted or silent, the
decision is the one named under "Differences from the source" in the firmware's headers, and is marked "decision" here.

Units: SI everywhere (m, s, N, kg, J); the units of the firmware's core (um, 5 ms) do not occur.
Vectors are arrays of shape (2,), matrices (2, 2); index 0 is x or the tangent, index 1 is y or the normal.

How it is meant: one function per equation, pure; `Servo.step` composes one control period, `Plant.step` is the
machine, and `Loop` joins the two, so that

    loop = Loop(Params(), knots_nm, seed=1)
    for _ in range(1000):
        loop.step()

is the closed loop as someone who studies the law would write it in NumPy: one Python step a control period (it is a
feedback loop: there is nothing to vectorise over time). `kontur bench sim` times this stepping.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

KNOT_S = 1e-3
"""Knot spacing of the trajectory, s."""
STANDSTILL_MPS = 4e-6
"""At or below this path speed there is no direction: the axis frame is taken, and it does not turn (decision)."""
TURNS = 4
"""Periods in which energy, adaptations, limit and friction of each axis come once (decision)."""
BLENDED_N = 2.5e-4
"""A switching offset below this is none (decision)."""
NU_MAX = 4.0
"""Limit of the foot point's rate |nu| (decision)."""
ELEMENTS = 8
"""Maxwell slip elements of an axis (decision)."""
ORDERS = np.array([1, 2, 6])
"""Periods a turn of the three harmonics of a screw (decision)."""
AHEAD = 3.0
"""Periods from an encoder reading to the middle of what the forces of the next two periods do (decision)."""
FRICTION_AHEAD = 5.5
"""Periods from an encoder reading to the middle of what the last force of the next TURNS does (decision)."""
CONTROLLERS = ("track", "cc", "ccu", "cascade", "ccc")

IDENTITY = np.eye(2)
I_E = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""I_e of (9): R'^T = theta' I_e R^T, and I_e commutes with every rotation."""
S = np.array([[0.0, 0.0], [0.0, 1.0]])
"""S of (7): keeps the normal component."""


def _pair(x: float, y: float) -> Array:
    return np.array([x, y])


@dataclass(frozen=True)
class Params:
    """Everything the loop needs, SI. The defaults are Table 1 and, where it is silent, values to compare with.

    Most of those are the drive's defaults (firmware/od/objects.toml), but not all.
    """

    dt_s: float = 1e-4
    # nominal plant (1)
    mass_kg: Array = field(default_factory=lambda: _pair(88.08, 97.90))
    viscous_Nspm: Array = field(default_factory=lambda: _pair(467.2, 631.0))
    coulomb_N: Array = field(default_factory=lambda: _pair(45.5, 54.8))
    force_max_N: Array = field(default_factory=lambda: _pair(600.0, 600.0))
    observer_radps: float = 1300.0
    # contour estimation (3)-(9)
    v_min_mps: float = 1e-4
    lag_max_s: float = 6e-3
    newton: bool = True
    # contouring law (10)-(16)
    lambda_1ps: float = 200.0
    gamma_1ps: float = 1.2
    beta: float = 6.0
    stiffness_1ps2: float = 0.0
    k_bar_1pm: float = 1e3
    e_max_m: float = 1e-3
    psi_printed: bool = False
    k_0_1ps: float = 100.0
    k_max_1ps: float = 400.0
    zeta_1ps: float = 100.0
    zeta_rate_1ps2: float = 100.0
    xi_1pms: float = 1e4
    epsilon_mps: float = 1e-3
    friction_speed_mps: float = 5e-5
    # uncertainty compensator (17)-(25)
    alpha_1ps: float = 60.0
    mu_0_mps2: float = 1.0
    mu_max_mps2: float = 4.0
    rho_1ps2: float = 0.5
    phi_mps: float = 1e-3
    dead_zone_mps: float = 1e-3
    mu_printed: bool = False
    input_printed: bool = False
    in_axes: bool = False
    # adaptive feedforward of friction and mass; not in the paper
    friction_rate_1ps: float = 40.0
    mass_rate_1ps: float = 20.0
    feedforward_acceleration_mps2: float = 0.5
    # friction at reversal, cogging and ripple; not in the paper, and off with these values
    presliding_m: Array = field(default_factory=lambda: _pair(0.0, 0.0))
    breakaway: Array = field(default_factory=lambda: _pair(1.0, 1.0))
    stribeck_mps: Array = field(default_factory=lambda: _pair(1e-3, 1e-3))
    force_delay_s: Array = field(default_factory=lambda: _pair(0.0, 0.0))
    lead_m: Array = field(default_factory=lambda: _pair(0.0, 0.0))
    cogging_cos_N: Array = field(default_factory=lambda: np.zeros((2, 3)))
    cogging_sin_N: Array = field(default_factory=lambda: np.zeros((2, 3)))
    ripple_cos: Array = field(default_factory=lambda: np.zeros((2, 3)))
    ripple_sin: Array = field(default_factory=lambda: np.zeros((2, 3)))
    # cascade and cross-coupled control
    k_p_1ps: float = 67.4
    k_v_1ps: float = 307.0
    k_i_1ps: float = 77.0
    coupling: float = 1.0
    integral_max_m: float = 1e-3
    # energy (26)-(30)
    force_constant_NpA: Array = field(default_factory=lambda: _pair(72.0, 72.0))
    impedance_ohm: Array = field(default_factory=lambda: _pair(2.5, 2.5))
    back_emf_Vspm: Array = field(default_factory=lambda: _pair(41.6, 41.6))
    power_factor: float = 0.9
    # force filters: rows (4, 4) of each axis are zero Hz, zero damping, pole Hz, pole damping; continuous limit
    sections: Array = field(default_factory=lambda: np.zeros((2, 4, 4)))
    continuous_N: Array = field(default_factory=lambda: np.zeros(2))
    thermal_s: Array = field(default_factory=lambda: _pair(10.0, 10.0))
    # switching of controllers
    blend: float = 0.995
    # the machine, where it is not the nominal plant
    encoder_m: float = 76.29e-9
    noise_N: float = 2.0
    schedule_time_s: tuple[float, ...] = (0.0, 1.6, 3.0, 4.4)
    schedule_scale: tuple[float, ...] = (1.0, 0.0, 0.5, 1.5)
    schedule_repeat_s: float = 5.6
    delay_periods: int = 1
    substeps: int = 10


def rotation(theta: float) -> Array:
    """R of (4), (2, 2): its columns are the unit tangent and the unit normal."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[c, -s], [s, c]])


def sat(x: Array, width: float) -> Array:
    """Sign function with a boundary layer: x / width within +-1 (decision for (24) and the friction term)."""
    return np.clip(x / width, -1.0, 1.0)


# --- Trajectory -------------------------------------------------------------------------------------------------------

BASIS = np.array([[1.0, -3.0, 3.0, -1.0], [4.0, 0.0, -6.0, 3.0], [1.0, 3.0, 3.0, -3.0], [0.0, 0.0, 0.0, 1.0]]) / 6.0
"""Uniform cubic B-spline: weight of control point c_{i-1+j} is BASIS[j] . (1, u, u^2, u^3)."""


@dataclass(frozen=True)
class Point:
    """The curve at one path time: position and derivatives by path time, each of shape (2,)."""

    r: Array
    d1: Array
    d2: Array
    d3: Array


def spline(knots_m: Array, start_m: Array, t_s: float) -> Point:
    """The curve at path time t_s >= 0 from its control points knots_m (n, 2).

    Between knots i and i+1, u = t/h - i,

        r = sum_j c_{i-1+j} BASIS[j] . (1, u, u^2, u^3),

    and derivatives come from differentiating the powers and dividing by h. Before knot 0 the sequence goes on with
    start_m (2,), after the last knot with that knot.
    """
    i = int(np.floor(t_s / KNOT_S))
    u = t_s / KNOT_S - i
    last = len(knots_m) - 1
    c = np.array([knots_m[min(k, last)] if k >= 0 and last >= 0 else start_m for k in range(i - 1, i + 3)])
    powers = np.array(
        [
            [1.0, u, u * u, u * u * u],
            [0.0, 1.0, 2.0 * u, 3.0 * u * u],
            [0.0, 0.0, 2.0, 6.0 * u],
            [0.0, 0.0, 0.0, 6.0],
        ]
    )
    r, d1, d2, d3 = powers @ BASIS.T @ c
    return Point(r, d1 / KNOT_S, d2 / KNOT_S**2, d3 / KNOT_S**3)


# --- Contour error (3)-(9) --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Contour:
    """Output of contour_error(), SI; vectors (2,). On e_turning, a share of e_wn, the turning of the frame acts."""

    r: Array
    r_dot: Array
    r_ddot: Array
    e_w: Array
    e_w_dot: Array
    e_l: Array
    t_d: float
    tau_s: float
    t_s: float
    nu: float
    rotation: Array
    theta_dot: float
    theta_ddot: float
    rn: Array
    rn_dot: Array
    rn_ddot: Array
    e_wn: Array
    e_wn_dot: Array
    e_turning: Array
    e_n: Array
    e_n_dot: Array


def inclination(velocity: Array) -> float:
    """theta of (4): the angle of the velocity (2,), rad; 0 at standstill (decision)."""
    if np.hypot(*velocity) <= STANDSTILL_MPS:
        return 0.0
    return float(np.arctan2(velocity[1], velocity[0]))


def delay(e_lt: float, speed: float, p: Params) -> float:
    """(5), regularised (decision): t_d = -e_lt |r'| / (|r'|^2 + v_min^2), within +-lag_max; 0 at standstill."""
    if speed <= STANDSTILL_MPS:
        return 0.0
    return float(np.clip(-e_lt * speed / (speed**2 + p.v_min_mps**2), -p.lag_max_s, p.lag_max_s))


def foot_slope(point: Point, e: Array, p: Params) -> float:
    """-g'(tau) of the foot-point condition g(tau) = (q - r(tau)) . r'(tau) = 0.

    g' = -|r'|^2 + (q - r) . r''. It vanishes where q is the centre of curvature and g has no single root there; so
    -g' is kept above |r'|^2/4 and v_min^2 is added, as in (5) (decision).
    """
    speed2 = float(point.d1 @ point.d1)
    return max(speed2 - float(e @ point.d2), 0.25 * speed2) + p.v_min_mps**2


def frame_rates(point: Point, nu: float, p: Params) -> tuple[float, float]:
    """theta_a' and theta_a'' by time of the inclination theta(tau(t)) at the foot point.

    By path time, from tan theta = r_y'/r_x':

        theta'  = (r' x r'') / |r'|^2
        theta'' = (r' x r''') / |r'|^2 - 2 theta' (r' . r'') / |r'|^2      (since r'' x r'' = 0)

    and by the chain rule d/dt = nu d/dtau, with tau'' = 0 (decision). |r'|^2 gets v_min^2 as in (5).
    """
    if np.hypot(*point.d1) <= STANDSTILL_MPS:
        return 0.0, 0.0
    speed2 = float(point.d1 @ point.d1) + p.v_min_mps**2
    theta_1 = (point.d1[0] * point.d2[1] - point.d1[1] * point.d2[0]) / speed2
    theta_2 = (point.d1[0] * point.d3[1] - point.d1[1] * point.d3[0]) / speed2
    theta_2 -= 2.0 * theta_1 * float(point.d1 @ point.d2) / speed2
    return theta_1 * nu, theta_2 * nu**2


def adjusted_reference(
    r: tuple[Array, Array, Array], ra: tuple[Array, Array, Array], rot: Array, w: float, w_dot: float, share: float
) -> tuple[Array, Array, Array]:
    """(7) and (8): r_n = r + Q (r_a - r), Q = R S R^T, and its first two derivatives by time.

    r and ra are (position, velocity, acceleration). With R' = w R J, J = I_e^T, and J' = 0,

        R'' = R (w' J + w^2 J J) = R (w' J - w^2 I)
        Q'  = R' S R^T + R S R'^T
        Q'' = R'' S R^T + 2 R' S R'^T + R S R''^T

    Q' and Q'' act on a share of r_a - r (turning_share()).
    """
    j = I_E.T
    r1 = w * rot @ j
    r2 = rot @ (w_dot * j - w**2 * IDENTITY)
    q0 = rot @ S @ rot.T
    q1 = r1 @ S @ rot.T + rot @ S @ r1.T
    q2 = r2 @ S @ rot.T + 2.0 * r1 @ S @ r1.T + rot @ S @ r2.T
    gap, gap_dot, gap_ddot = (a - b for a, b in zip(ra, r, strict=True))
    return (
        r[0] + q0 @ gap,
        r[1] + share * q1 @ gap + q0 @ gap_dot,
        r[2] + share * q2 @ gap + 2.0 * q1 @ gap_dot + q0 @ gap_ddot,
    )


def turning_share(e_w: Array, point: Point, rot: Array, p: Params) -> float:
    """The share of an error that the turning of the frame acts on (decision).

    It is 1 while no component of e_w (2,) in the frame is larger than the error of which (5) makes lag_max, and beyond
    that the quotient of both. So noise in the direction of a path that is all but at rest has a bound.
    """
    speed = float(np.hypot(*point.d1))
    reach = p.lag_max_s * (speed**2 + p.v_min_mps**2) / speed
    return 1.0 / max(1.0, float(np.max(np.abs(rot.T @ e_w))) / reach)


def contour_error(
    knots_m: Array,
    start_m: Array,
    t_s: float,
    rate: float,
    rate_dot_1ps: float,
    q_m: Array,
    q_dot_mps: Array,
    p: Params,
) -> Contour:
    """(3)-(9) at path time t_s, which runs at `rate` (1: as programmed), for actual position and velocity (2,).

    The foot point. (6) takes tau = t - t_d; one Newton step on g(tau) = (q - r(tau)) . r'(tau) = 0 follows, unless
    p.newton is off. Its rate nu = d tau/dt from differentiating g = 0 by time (decision, instead of 1 - t_d'):

        (q' - nu r') . r' + nu (q - r) . r'' = 0   =>   nu = q' . r' / (|r'|^2 - (q - r) . r'')

    with v_min^2 in numerator (times the path's own rate) and denominator, so that nu -> rate towards standstill. A foot
    point that lag_max limits goes on at the path's rate (decision).

    r_a(tau(t)) then has velocity r' nu and acceleration r'' nu^2; as n . r' = 0, n . r_a'' = n . r'' nu^2 holds even
    where tau'' is not 0.

    Where the path stands still at the foot point it has no direction: r_n = r, plain tracking (decision).
    """
    ref = spline(knots_m, start_m, t_s)
    r_dot = rate * ref.d1
    r_ddot = rate**2 * ref.d2 + rate_dot_1ps * ref.d1
    e_w = q_m - ref.r  # (3)
    e_l = rotation(inclination(ref.d1)).T @ e_w  # (4)
    t_d = delay(e_l[0], float(np.hypot(*ref.d1)), p)  # (5)
    limited = abs(t_d) == p.lag_max_s
    tau = max(t_s - t_d, 0.0)
    foot = spline(knots_m, start_m, tau)  # (6)
    if p.newton and np.hypot(*foot.d1) > STANDSTILL_MPS:
        step = float((q_m - foot.r) @ foot.d1) / foot_slope(foot, q_m - foot.r, p)
        limited = abs(step) > p.lag_max_s
        tau = max(tau + float(np.clip(step, -p.lag_max_s, p.lag_max_s)), 0.0)
        foot = spline(knots_m, start_m, tau)

    still = bool(np.hypot(*foot.d1) <= STANDSTILL_MPS)
    nu = rate
    if not still and not limited:
        nu = (float(q_dot_mps @ foot.d1) + p.v_min_mps**2 * rate) / foot_slope(foot, q_m - foot.r, p)
        nu = float(np.clip(nu, -NU_MAX, NU_MAX))
    rot = rotation(inclination(foot.d1))
    w, w_dot = frame_rates(foot, nu, p)
    rn, rn_dot, rn_ddot = ref.r, r_dot, r_ddot
    share = 1.0
    if not still:
        share = turning_share(e_w, foot, rot, p)
        foot_motion = (foot.r, nu * foot.d1, _foot_acceleration(foot, rot, w, nu))
        rn, rn_dot, rn_ddot = adjusted_reference((ref.r, r_dot, r_ddot), foot_motion, rot, w, w_dot, share)
    e_wn, e_wn_dot = q_m - rn, q_dot_mps - rn_dot
    return Contour(
        r=ref.r,
        r_dot=r_dot,
        r_ddot=r_ddot,
        e_w=e_w,
        e_w_dot=q_dot_mps - r_dot,
        e_l=e_l,
        t_d=t_d,
        tau_s=tau,
        t_s=t_s,
        nu=nu,
        rotation=rot,
        theta_dot=w,
        theta_ddot=w_dot,
        rn=rn,
        rn_dot=rn_dot,
        rn_ddot=rn_ddot,
        e_wn=e_wn,
        e_wn_dot=e_wn_dot,
        e_turning=share * e_wn,
        e_n=rot.T @ e_wn,
        e_n_dot=rot.T @ (e_wn_dot + share * w * I_E @ e_wn),  # (9)
    )


def _foot_acceleration(foot: Point, rot: Array, w: float, nu: float) -> Array:
    """r_a'' = nu^2 r''. Its normal part is |r_a'| theta_a', which is used where v_min counts in theta_a' (decision).

    n . r'' = |r'| theta' exactly; with theta' regularised both must carry the same factor, or (8) would be
    inconsistent near standstill: f'' is the derivative of f' = n' . (r_a - r) + n . (r_a' - r') with n . r_a' = 0.
    """
    t, n = rot.T
    return nu**2 * float(t @ foot.d2) * t + nu * float(t @ foot.d1) * w * n


# --- Contouring law (10)-(16) -----------------------------------------------------------------------------------------


def psi(e: float, e_dot: float, p: Params) -> tuple[float, float]:
    """(11) and its derivative by time: psi = beta / cosh(k e~), or beta cosh(k e~) as printed (decision).

    e~ is e within +-e_max; beyond it psi is constant.
    """
    e_lim = float(np.clip(e, -p.e_max_m, p.e_max_m))
    x = p.k_bar_1pm * e_lim
    x_dot = p.k_bar_1pm * e_dot if abs(e) <= p.e_max_m else 0.0
    cosh = (np.exp(-x) + np.exp(x)) / 2.0
    sinh = (np.exp(x) - np.exp(-x)) / 2.0
    if p.psi_printed:
        return p.beta * cosh, p.beta * sinh * x_dot
    return p.beta / cosh, -p.beta * sinh / cosh**2 * x_dot


def friction(r_dot_mps: Array, p: Params) -> Array:
    """L sign(r'), N: of the programmed velocity, with a boundary layer (decision)."""
    return p.coulomb_N * sat(r_dot_mps, p.friction_speed_mps)


def feedforward_force(friction_N: Array, mass_kg: Array, direction: Array, r_ddot_mps2: Array) -> Array:
    """Force (2,) for the friction and the mass that are estimated beyond the nominal plant (decision)."""
    return friction_N * direction + mass_kg * r_ddot_mps2


def adapt_feedforward(
    friction_N: Array, mass_kg: Array, direction: Array, r_ddot_mps2: Array, u_N: Array, dt_s: float, p: Params
) -> tuple[Array, Array]:
    """One step dt_s of adapting friction and mass to what the compensator added, u (decision).

    The force that is missing is l d + m r'', where d is sign(r') or the shape of friction; the compensator supplies it.
    Gradient descent of u^2/2: dl/dt is proportional to u d, dm/dt to u a, the latter divided by a^2 + a_0^2 so that its
    speed does not depend on how hard the path accelerates.
    """
    regressor = r_ddot_mps2 / (r_ddot_mps2**2 + p.feedforward_acceleration_mps2**2)
    friction_N = friction_N + p.friction_rate_1ps * u_N * direction * dt_s
    mass_kg = mass_kg + p.mass_rate_1ps * u_N * regressor * dt_s
    return (
        np.clip(friction_N, -p.coulomb_N, 3.0 * p.coulomb_N),
        np.clip(mass_kg, -0.5 * p.mass_kg, p.mass_kg),
    )


# --- Friction at reversal, cogging and ripple -------------------------------------------------------------------------


def remembered(turns_m: list[float], x_m: float) -> list[float]:
    """The turning points that an axis at x_m still remembers, from 0, where it was without friction, to x_m.

    Prandtl's model wipes out what is smaller (Madelung's rules): a point that is passed in the same direction is no
    turning point, a loop that closes leaves no trace, and the first turn is forgotten where the axis goes further.
    """
    points = [*turns_m, x_m]
    while len(points) > 2:
        *_, a, b, c = points
        if (b - a) * (c - b) >= 0.0:
            del points[-2]
        elif len(points) > 3 and abs(c - b) >= abs(b - a):
            del points[-3:-1]
        elif len(points) == 3 and abs(c) >= abs(b):
            del points[-2]
        else:
            break
    return points


def slip(points_m: list[float], presliding_m: float) -> float:
    """Friction over Coulomb friction at the last of the points that are remembered, -1..1, by Masing's rules.

    The first branch is the virgin curve v(x) = mean of min(x / w_k, 1), w_k = k D / 2N, which N elements that yield one
    by one have. Each further branch is the same curve, twice as large, from the turning point on.
    """
    widths = np.arange(1, ELEMENTS + 1) * presliding_m / (2.0 * ELEMENTS)
    total = 0.0
    for i, length in enumerate(np.diff(points_m)):
        scale = 1.0 if i == 0 else 2.0
        total += scale * float(np.sign(length) * np.mean(np.minimum(abs(length) / scale / widths, 1.0)))
    return total


def stribeck(speed_mps: Array, p: Params) -> Array:
    """Friction in motion over Coulomb friction (2,): from breakaway at rest to 1."""
    return 1.0 + (p.breakaway - 1.0) * np.exp(-np.abs(speed_mps) / p.stribeck_mps)


def motor_force(demand_N: float, position_m: float, axis: int, p: Params) -> float:
    """What a motor gives for a demand, with ripple and cogging by the angle of the screw, in complex amplitudes."""
    turning = np.exp(2j * np.pi * ORDERS * position_m / p.lead_m[axis])
    ripple, cogging = (
        float(np.real(np.sum((cosine[axis] - 1j * sine[axis]) * turning)))
        for cosine, sine in ((p.ripple_cos, p.ripple_sin), (p.cogging_cos_N, p.cogging_sin_N))
    )
    return demand_N * (1.0 + ripple) + cogging


def screw_demand(force_N: Array, position_m: Array, p: Params) -> Array:
    """The demand (2,) for which motor_force() is force_N (2,): motor_force() is a straight line of the demand."""
    demand = np.array(force_N, dtype=np.float64)
    for i in (0, 1):
        if p.lead_m[i] > 0.0:
            at_0, at_1 = (motor_force(u, position_m[i], i, p) for u in (0.0, 1.0))
            demand[i] = (force_N[i] - at_0) / (at_1 - at_0)
    return demand


def surface(e: Array, e_dot: Array, p: Params) -> tuple[Array, Array, Array]:
    """(10): s_bar = A e + e', with A = diag(lambda + psi gamma); B = A' + stiffness (not in the paper)."""
    (psi_1, psi_1_dot), (psi_2, psi_2_dot) = (psi(e[j], e_dot[j], p) for j in (0, 1))
    a = np.diag([p.lambda_1ps + psi_1 * p.gamma_1ps, p.lambda_1ps + psi_2 * p.gamma_1ps])
    b = np.diag([psi_1_dot * p.gamma_1ps, psi_2_dot * p.gamma_1ps]) + p.stiffness_1ps2 * np.eye(2)
    return a @ e + e_dot, a, b


def contouring_law(
    rot: Array,
    w: float,
    w_dot: float,
    e_w: Array,
    e_w_dot: Array,
    e: Array,
    e_dot: Array,
    r_ddot: Array,
    q_dot: Array,
    k_hat: Array,
    p: Params,
) -> tuple[Array, Array]:
    """(15) without its friction term: (force N, s_bar m/s).

    The law is what makes s_bar' = A e' + B e + e'' = -K s_bar: from (9),
    R e'' = e_w'' + 2 w I_e e_w' + w' I_e e_w - w^2 e_w, and M (r'' + e_w'') + C q' is the force of plant (2).
    """
    s_bar, a, b = surface(e, e_dot, p)
    acceleration = (
        r_ddot
        - rot @ (a @ e_dot + b @ e + np.diag(k_hat) @ s_bar)
        - w_dot * I_E @ e_w
        + w**2 * e_w
        - 2.0 * w * I_E @ e_w_dot
    )
    return p.mass_kg * acceleration + p.viscous_Nspm * q_dot, s_bar


def adapt_k(k_hat: Array, s_bar: Array, dt_s: float, p: Params) -> Array:
    """(16) over dt_s: k' = xi |s| sign(|s| - epsilon) above zeta, a constant rate below; within 0..k_max."""
    size = np.abs(s_bar)
    rate = np.where(k_hat > p.zeta_1ps, p.xi_1pms * size * np.where(size > p.epsilon_mps, 1.0, -1.0), p.zeta_rate_1ps2)
    return np.clip(k_hat + rate * dt_s, 0.0, p.k_max_1ps)


# --- Uncertainty compensator (2), (17)-(25) ---------------------------------------------------------------------------


def reference_model(q_bar: Array, q_bar_dot: Array, u_bar: Array, p: Params) -> tuple[Array, Array]:
    """(2) over one period: M q'' + C q' = u_bar, velocity by Euler's rule, position by the trapezium."""
    velocity = q_bar_dot + p.dt_s * (u_bar - p.viscous_Nspm * q_bar_dot) / p.mass_kg
    return q_bar + p.dt_s * 0.5 * (q_bar_dot + velocity), velocity


def compensation(
    z: Array, z_dot: Array, rot: Array, w: float, mu: Array, p: Params
) -> tuple[Array, Array, Array, Array]:
    """(17)-(24) with desired z = 0: (z_n m, s m/s, v m/s^2 in the frame, force M R v in N).

    z_n = R^T z, z_n' = R^T (z' + w I_e z), or R^T z' (in_axes, not in the paper); s = alpha z_n + z_n' (21);
    v = -alpha z_n' - mu sat(s/phi) (24).
    """
    z_n = rot.T @ z
    z_n_dot = rot.T @ (z_dot if p.in_axes else z_dot + w * I_E @ z)
    s = p.alpha_1ps * z_n + z_n_dot
    v = -p.alpha_1ps * z_n_dot - mu * sat(s, p.phi_mps)
    return z_n, s, v, p.mass_kg * (rot @ v)


def adapt_mu(mu: Array, s: Array, dt_s: float, p: Params) -> Array:
    """(25) over dt_s: mu' = rho |s| outside the dead zone (printed: everywhere), up to mu_max (decision)."""
    size = np.abs(s)
    grow = np.full(2, True) if p.mu_printed else size > p.dead_zone_mps
    return np.where(grow, np.minimum(mu + p.rho_1ps2 * size * dt_s, p.mu_max_mps2), mu)


# --- Observer ---------------------------------------------------------------------------------------------------------


def observer_gains(bandwidth_radps: float, dt_s: float) -> Array:
    """Gains (3,) (-, 1/s, 1/s^2) that put all three poles of the estimation error at p = (1 - x)/(1 + x), x = wo dt/2.

    With F the constant-acceleration transition and H = (1, 0, 0) the error obeys e+ = (I - L H) F e. Comparing its
    characteristic polynomial with (z - p)^3 gives L = (1 - p^3, 3/2 (1-p)^2 (1+p)/dt, (1-p)^3/dt^2).
    """
    x = 0.5 * bandwidth_radps * dt_s
    p = (1.0 - x) / (1.0 + x)
    return np.array([1.0 - p**3, 1.5 * (1.0 - p) ** 2 * (1.0 + p) / dt_s, (1.0 - p) ** 3 / dt_s**2])


def transition(dt_s: float) -> Array:
    """(3, 3): position, velocity, acceleration after dt at constant acceleration."""
    return np.array([[1.0, dt_s, 0.5 * dt_s**2], [0.0, 1.0, dt_s], [0.0, 0.0, 1.0]])


def observe(x: Array, measured_m: Array, force_N: Array, p: Params, gains: Array) -> tuple[Array, Array]:
    """One period of the extended state observer of both axes: (new states (3, 2), predicted acceleration (2,)).

    Rows of x: position, velocity, acceleration that the nominal linear plant m a + c v = u does not explain.
    Predict with the force that acted, correct by the innovation.
    """
    explained = (force_N - p.viscous_Nspm * x[1]) / p.mass_kg
    acceleration = explained + x[2]
    ahead = transition(p.dt_s) @ np.array([x[0], x[1], acceleration])
    predicted = np.array([ahead[0], ahead[1], x[2]])
    return predicted + np.outer(gains, measured_m - ahead[0]), acceleration


# --- Geometry: the tool from the encoders (not in the paper) ----------------------------------------------------------


@dataclass(frozen=True)
class Machine:
    """What lies between encoders and tool, SI. A map of each axis is (positions, errors), empty where there is none.

    `once_m` is the error once a turn of a screw of lead `screw_m`, as cosine less j times sine.
    """

    lead: tuple[tuple[Array, Array], tuple[Array, Array]]
    screw_m: Array
    once_m: Array
    squareness_rad: Array
    stiffness_Npm: Array
    mass_kg: Array
    coulomb_N: Array
    viscous_Nspm: Array
    backlash_m: Array
    side_radps: Array
    mass_before_kg: Array


@dataclass(frozen=True)
class Transmission:
    """State of the geometry, (2,) each; `bridge_m` is what is left of a change of the user's zero."""

    placed_m: Array
    bridge_m: Array
    turn_m: Array
    turn_bridge_m: Array
    deflection_m: Array
    target: Array
    side: Array
    side_1ps: Array


def geometry(
    m: Machine, x: Transmission, user_m: Array, r_dot: Array, r_ddot: Array, direction: Array, moved: bool, dt_s: float
) -> tuple[Array, Array, Array, Array, Transmission]:
    """Corrections of both axes by position, by the angle of the screw and by force, (2,) m each, the force (2,) N that
    moves the mass before the gap across it, and the new state.

    `user_m` are the encoders' positions from the user's zero; `moved`: this zero is not that of the last period.
    Decisions: a deflection changes by 2 mm/s at most, the correction of a new zero comes at 0.2 mm/s, and the side of
    the gap is a second-order low-pass with two poles at `side_radps`, by the semi-implicit Euler rule.
    """
    angles = np.array([[0.0, m.squareness_rad[1]], [m.squareness_rad[0], 0.0]])
    lead = [np.interp(p, *m.lead[i]) if len(m.lead[i][0]) else 0.0 for i, p in enumerate(user_m)]
    placed = angles @ user_m + lead
    turn = (m.once_m * np.exp(2j * np.pi * user_m / m.screw_m)).real
    bridge = x.bridge_m + moved * (x.placed_m - placed)
    turn_bridge = x.turn_bridge_m + moved * (x.turn_m - turn)
    bridge, turn_bridge = (b - np.clip(b, -2e-4 * dt_s, 2e-4 * dt_s) for b in (bridge, turn_bridge))

    force = m.mass_kg * r_ddot + m.coulomb_N * direction + m.viscous_Nspm * r_dot
    change = force / m.stiffness_Npm - x.deflection_m
    deflection = x.deflection_m + np.clip(change, -2e-3 * dt_s, 2e-3 * dt_s)
    push = force + 0.01 * direction
    target = np.where(np.abs(push) < 0.005, x.target, np.sign(push))
    w = m.side_radps
    away, rate = x.side - target, (1.0 - 2.0 * w * dt_s) * x.side_1ps - w**2 * dt_s * (x.side - target)
    gap_force = m.mass_before_kg * 0.5 * m.backlash_m * (rate - x.side_1ps) / dt_s
    side = target + away + dt_s * rate
    state = Transmission(placed, bridge, turn, turn_bridge, deflection, target, side, rate)
    return placed + bridge, turn + turn_bridge, -deflection - 0.5 * m.backlash_m * side, gap_force, state


def dual_feedback(
    encoders_m: Array, offset_m: float, crossover_radps: float, tolerance_m: float, dt_s: float
) -> tuple[float, bool]:
    """New offset of the position from the first encoder, and whether both agree, for positions (2,) of both.

    The offset is the difference of the encoders through a first-order low-pass (explicit Euler).
    """
    weight = np.array([1.0 - crossover_radps * dt_s, crossover_radps * dt_s])
    difference = encoders_m[1] - encoders_m[0]
    return float(weight @ [offset_m, difference]), bool(abs(difference) <= tolerance_m)


# --- Watch for oscillation (not in the paper) -------------------------------------------------------------------------


@dataclass(frozen=True)
class Watch:
    """What the watch for oscillation looks for: SI, and control periods.

    `share` of the way to the force is what the slow part goes in a period: 1 - exp(-2 pi f_c dt). `count_N` moves the
    mass by a count of the encoder where a half wave lasts `half_wave`; `force_max_N` counts at any frequency.
    """

    limit_N: float
    count_N: float
    force_max_N: float
    share: float
    half_wave: int
    lasts: int


def oscillations(w: Watch, beyond_path_N: Array, dt_s: float) -> list[tuple[int, float, float]]:
    """Period, frequency (Hz) and amplitude (N) of each oscillation in a force (n,) beyond what the path needs.

    The slow part is the sum of the forces before, weighted by share (1 - share)^age. A half wave is (beginning, sign,
    peak) of the forces beyond the limit; it goes on until one of half its peak or more to the other side. Decision: the
    seventh one or a later one, `lasts` after the first, makes an oscillation if
    - each began within `half_wave` of the one before,
    - no swing, of two half waves, was below 70 % of the largest one (what decays is looked at anew from there),
    - each of the last four that have ended was as large (90 %) and as long (a fifth of the period) as the one a period
      before, and
    - the last swing moves the mass by a count, or is beyond force_max_N.
    """
    weights = w.share * (1.0 - w.share) ** np.arange(len(beyond_path_N))
    slow = np.convolve(beyond_path_N, weights)[: len(beyond_path_N)]
    fast = beyond_path_N - np.concatenate([[0.0], slow[:-1]])
    found: list[tuple[int, float, float]] = []
    waves: list[tuple[int, float, float]] = []
    first = 0  # of the waves that are looked at
    swings: list[float] = []  # to compare with
    for k in np.flatnonzero(np.abs(fast) > w.limit_N):
        sign, size = float(np.sign(fast[k])), float(abs(fast[k]))
        if waves and k - waves[-1][0] > w.half_wave:
            waves, first = [], 0
        if waves and waves[-1][1] == sign:
            waves[-1] = (waves[-1][0], sign, max(size, waves[-1][2]))
            continue
        if len(waves) - first > 1 and size < 0.5 * waves[-1][2]:
            continue
        if not waves:
            swings = []
        elif len(waves) - first > 1:
            swing = waves[-2][2] + waves[-1][2]
            if swing < 0.7 * max(swings, default=0.0):
                first, swings = len(waves), []
            swings.append(swing)
        waves.append((int(k), sign, size))
        periods, count = int(k) - waves[first][0], len(waves) - first
        if count >= 7 and periods >= w.lasts and _repeats(waves[-7:]) and _moves(w, waves[-3:]):
            found.append((int(k), (count - 1) / (2.0 * periods * dt_s), max(swings) / 2.0))
            waves, first = [], 0
    return found


def _repeats(waves: list[tuple[int, float, float]]) -> bool:
    """Whether each of the four half waves before the last one of seven was like the one a period before."""
    begins, peaks = [wave[0] for wave in waves], [wave[2] for wave in waves]
    return all(
        peaks[k] >= 0.9 * peaks[k - 2]
        and abs((begins[k + 1] - begins[k]) - (begins[k - 1] - begins[k - 2])) <= (begins[k + 1] - begins[k - 1]) // 5
        for k in range(2, 6)
    )


def _moves(w: Watch, waves: list[tuple[int, float, float]]) -> bool:
    """Whether the period that the last one of three half waves ends moves the mass by a count."""
    amplitude_N = (waves[0][2] + waves[1][2]) / 2.0
    period = (waves[2][0] - waves[0][0]) / (2.0 * w.half_wave)
    return amplitude_N * period**2 >= w.count_N or amplitude_N >= w.force_max_N


# --- Cascade and cross-coupled control --------------------------------------------------------------------------------


def cascade(
    c: Contour, integral: Array, coupled_integral: float, coupled: bool, p: Params
) -> tuple[Array, Array, float]:
    """P position, PI velocity with feedforward; cross-coupled control on top: (force N, integral (2,), its integral).

    e_v = r' + K_p (r - q) - q', w = -(e_n2' + K_p e_n2),
    u = M (r'' + K_v (e_v + K_i integral e_v) + n W K_v (w + K_i integral w)) + C r'. No friction feedforward.
    """
    e_v = -c.e_w_dot - p.k_p_1ps * c.e_w
    integral = np.clip(integral + e_v * p.dt_s, -p.integral_max_m, p.integral_max_m)
    acceleration = c.r_ddot + p.k_v_1ps * (e_v + p.k_i_1ps * integral)
    if coupled:
        w = -(c.e_n_dot[1] + p.k_p_1ps * c.e_n[1])
        coupled_integral = float(np.clip(coupled_integral + w * p.dt_s, -p.integral_max_m, p.integral_max_m))
        acceleration += c.rotation[:, 1] * p.coupling * p.k_v_1ps * (w + p.k_i_1ps * coupled_integral)
    else:
        coupled_integral = 0.0
    return p.mass_kg * acceleration + p.viscous_Nspm * c.r_dot, integral, coupled_integral


# --- Force filters and continuous limit -------------------------------------------------------------------------------


def force_filter(sections: Array, state: Array, force_N: float, p: Params) -> tuple[float, Array]:
    """One period of the sections (4, 4) of one axis: (filtered force, new state (4, 2) of the trapezoidal integrators).

    In units of the pole frequency a section is x' = A x + B u, y = C x + D u with x = (band-pass, low-pass). The
    trapezoidal rule over a period of 2 g, g = tan(pi f_p/f_s), is x = (I - g A)^-1 (s + g B u), s+ = 2 x - s.
    """
    after = state.copy()
    u = force_N
    for n, (zero_Hz, zero_damping, pole_Hz, pole_damping) in enumerate(sections):
        if pole_Hz == 0.0:
            continue
        g, k = np.tan(np.pi * pole_Hz * p.dt_s), 2.0 * pole_damping
        r = g / np.tan(np.pi * zero_Hz * p.dt_s) if zero_Hz else 0.0
        x = np.linalg.solve(np.eye(2) - g * np.array([[-k, -1.0], [1.0, 0.0]]), state[n] + g * np.array([u, 0.0]))
        after[n] = 2.0 * x - state[n]
        acceleration = u - k * x[0] - x[1]
        u = float(r**2 * acceleration + 2.0 * zero_damping * r * x[0] + x[1])
    return u, after


def force_filter_at(force_N: float) -> Array:
    """State (4, 2) of the filters of one axis that has been at this force for long."""
    return np.tile([0.0, force_N], (4, 1))


def force_limit(heat: Array, force_N: Array, p: Params) -> tuple[Array, Array]:
    """Heat (2,) after TURNS periods with this force, and the limits (2,), N, that it leaves (I2t; decision).

    The heat is the mean square of the force over that of the continuous force. From 95 % of it to 100 % the limit falls
    from the peak to the continuous force.
    """
    on = p.continuous_N > 0.0
    continuous = np.where(on, p.continuous_N, np.inf)
    after = heat + ((force_N / continuous) ** 2 - heat) * TURNS * p.dt_s / p.thermal_s
    ends = np.stack([p.force_max_N, p.continuous_N])
    lowered = np.array([np.interp(after[i], [0.95, 1.0], ends[:, i]) for i in (0, 1)])
    return after, np.where(on, np.minimum(lowered, p.force_max_N), p.force_max_N)


# --- Energy (26)-(30) -------------------------------------------------------------------------------------------------


def power(velocity: Array, acceleration: Array, p: Params) -> Array:
    """Integrand of (30) for both axes, W: sqrt(3) P_f (C1 a^2 + C2 v^2 + C3 v sign + C4 + C5 a sign + C6 v a).

    From I = (l sign + c v + m a)/K and V = I Z + K_E v by multiplying out V I; sign stands for sat(v / v_s) (decision),
    so that C4 comes with sign^2.
    """
    m, c, coulomb = p.mass_kg, p.viscous_Nspm, p.coulomb_N
    k, z, k_e = p.force_constant_NpA, p.impedance_ohm, p.back_emf_Vspm
    sign = sat(velocity, p.friction_speed_mps)
    c1 = m**2 * z / k**2
    c2 = c * (z * c / k**2 + k_e / k)
    c3 = coulomb * (2.0 * z * c / k**2 + k_e / k)
    c4 = coulomb**2 * z / k**2
    c5 = 2.0 * coulomb * m * z / k**2
    c6 = m * (2.0 * z * c / k**2 + k_e / k)
    v, a = velocity, acceleration
    return (
        np.sqrt(3.0)
        * p.power_factor
        * (c1 * a**2 + c2 * v**2 + c3 * v * sign + c4 * sign**2 + c5 * a * sign + c6 * v * a)
    )


# --- One control period -----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class History:
    """What was asked for in one period, N, (2,) each: force, its part against friction, its part for the model (2)."""

    force: Array
    balance: Array
    model: Array


@dataclass
class State:
    """What the next period needs. Rows of `observer` (3, 2): position, velocity, unexplained acceleration.

    `turns_m`: of each axis, the turning points of the reference that its friction remembers, and where it is.
    """

    observer: Array
    k_hat: Array
    q_bar: Array
    q_bar_dot: Array
    mu: Array
    integral: Array
    coupled_integral: float
    offset: Array
    last: list[History]
    energy_J: Array
    feedforward_friction_N: Array
    feedforward_mass_kg: Array
    filters: list[Array]
    filtering: Array
    heat: Array
    limit_N: Array
    shape: Array
    shape_change: Array
    turns_m: list[list[float]]
    screw_N: Array
    lead_N: Array
    saturated: bool = False
    turn: int = 0
    controller: str | None = None
    enabled: bool = False


class Servo:
    """One drive: observer, contour error, law, force filters, limits, in the firmware's order."""

    def __init__(self, p: Params, knots_nm: npt.NDArray[np.int32], measured_m: Array, start_m: Array | None = None):
        """At rest at measured_m (2,); knots_nm (n, 2); start_m (2,): position before knot 0, by default that knot."""
        self.p = p
        self.knots_m = np.asarray(knots_nm, dtype=np.float64) * 1e-9
        self.start_m = self.knots_m[0] if start_m is None else start_m
        self.gains = observer_gains(p.observer_radps, p.dt_s)
        zero = np.zeros(2)
        self.state = State(
            observer=np.array([measured_m, zero, zero]),
            k_hat=zero,
            q_bar=zero,
            q_bar_dot=zero,
            mu=zero,
            integral=zero,
            coupled_integral=0.0,
            offset=zero,
            last=[History(zero, zero, zero)] * 2,
            energy_J=zero,
            feedforward_friction_N=zero,
            feedforward_mass_kg=zero,
            filters=[force_filter_at(0.0)] * 2,
            filtering=zero,
            heat=zero,
            limit_N=p.force_max_N,
            shape=zero,
            shape_change=zero,
            turns_m=[[0.0], [0.0]],
            screw_N=zero,
            lead_N=zero,
        )
        self._reset_laws(measured_m, zero)
        self.contour: Contour | None = None

    def _reset_laws(self, q: Array, q_dot: Array) -> None:
        s, p = self.state, self.p
        s.k_hat = np.full(2, p.k_0_1ps)
        s.q_bar, s.q_bar_dot = q, q_dot
        s.mu = np.full(2, 0.0 if p.mu_printed else p.mu_0_mps2)
        s.integral, s.coupled_integral = np.zeros(2), 0.0
        s.offset = np.zeros(2)

    def step(
        self,
        measured_m: Array,
        t_s: float,
        controller: str = "ccu",
        rate: float = 1.0,
        rate_dot_1ps: float = 0.0,
        enabled: bool = True,
    ) -> Array:
        """Force (2,) in N for encoder positions measured_m (2,) at path time t_s.

        The force demand of a period acts in the next one: the observer gets the force of two calls ago, and
        so does the reference model. The observer's is without the feedforward against friction, which moves nothing
        (decision).
        """
        p, s = self.p, self.state
        s.turn = (s.turn + 1) % TURNS  # energy, adaptation or feedforward of one axis a period, for all turns
        limited = np.arange(2) == s.turn - 2
        heat, limit_N = force_limit(s.heat, s.last[0].force, p)
        s.heat, s.limit_N = np.where(limited, heat, s.heat), np.where(limited, limit_N, s.limit_N)
        s.observer, acceleration = observe(s.observer, measured_m, s.last[1].force - s.last[1].balance, p, self.gains)
        q, q_dot = s.observer[0], s.observer[1]
        turn = np.arange(2) == s.turn
        s.energy_J = s.energy_J + np.where(turn, power(q_dot, acceleration, p) * TURNS * p.dt_s, 0.0)
        c = contour_error(self.knots_m, self.start_m, t_s, rate, rate_dot_1ps, q, q_dot, p)
        self.contour = c
        screw, ahead = s.screw_N, s.screw_N + s.lead_N

        now = History(np.zeros(2), np.zeros(2), np.zeros(2))
        saturated = False
        if enabled:
            fresh, switched = not s.enabled, controller != s.controller
            s.q_bar, s.q_bar_dot = reference_model(s.q_bar, s.q_bar_dot, s.last[1].model, p)
            if fresh or switched:
                self._reset_laws(q, q_dot)
            u, balance, linear = self._law(controller, c, q, q_dot)
            u, balance = u + ahead, balance + ahead
            s.offset = s.last[0].force - s.filtering - u if switched and not fresh else p.blend * s.offset
            if not switched and np.all(np.abs(s.offset) < BLENDED_N):
                s.offset = np.zeros(2)
            demand = u + s.offset
            if fresh:
                s.filters = [force_filter_at(force) for force in demand]
            wanted, s.filters = self._filter(demand)
            s.filtering = wanted - demand
            force = np.clip(wanted, -s.limit_N, s.limit_N)
            saturated = bool(np.any(wanted != force))
            now = History(force, balance, linear + s.offset - (demand - force))
        s.enabled, s.controller, s.saturated = enabled, controller, saturated
        s.last = [now, s.last[0]]
        self._predict(c, measured_m, q_dot, now.force - screw if enabled else np.zeros(2), enabled)
        jerk = rate**3 * spline(self.knots_m, self.start_m, t_s).d3  # but for what a change of the rate adds (decision)
        lead = p.force_delay_s * (p.mass_kg * jerk + p.viscous_Nspm * c.r_ddot) if enabled else np.zeros(2)
        s.lead_N = np.where(np.arange(2) == s.turn - 2, lead, s.lead_N)
        return now.force

    def _filter(self, force: Array) -> tuple[Array, list[Array]]:
        """Filtered force (2,), and the new states of its filters."""
        each = [force_filter(self.p.sections[i], self.state.filters[i], float(force[i]), self.p) for i in (0, 1)]
        return np.array([y for y, _ in each]), [state for _, state in each]

    def _predict(self, c: Contour, measured_m: Array, q_dot: Array, force_N: Array, enabled: bool) -> None:
        """Friction of one axis in TURNS periods, cogging and ripple of one a period, where their forces act (decision).

        Friction moves evenly to what it is when the last of these forces acts.
        """
        p, s = self.p, self.state
        if s.turn < 2:
            i = s.turn
            v = c.r_dot + (FRICTION_AHEAD * p.dt_s + p.force_delay_s) * c.r_ddot
            along = float(sat(v, p.friction_speed_mps)[i])
            x = s.turns_m[i][-1] + float(v[i]) * TURNS * p.dt_s
            s.turns_m[i] = remembered(s.turns_m[i], x) if enabled else [0.0]
            if p.presliding_m[i] > 0.0:
                along = slip(s.turns_m[i], float(p.presliding_m[i]))
            turn = np.arange(2) == i
            s.shape = np.where(turn & (not enabled), 0.0, s.shape)
            then = float(enabled) * along * stribeck(v, p)
            s.shape_change = np.where(turn, (then - s.shape) / TURNS, s.shape_change)
        s.shape = s.shape + s.shape_change
        turn = np.arange(2) == s.turn % 2
        there_m = measured_m + AHEAD * p.dt_s * q_dot
        s.screw_N = np.where(turn, screw_demand(force_N, there_m, p) - force_N, s.screw_N)

    def _law(self, controller: str, c: Contour, q: Array, q_dot: Array) -> tuple[Array, Array, Array]:
        """Force of the law, its part that balances friction and the mass error, its part that drives (2), N."""
        p, s = self.p, self.state
        shaped = bool(np.any(p.presliding_m > 0.0) or np.any(p.breakaway > 1.0))
        sign = sat(c.r_dot, p.friction_speed_mps)
        direction = s.shape if shaped else sign
        balance = p.coulomb_N * direction
        if controller in ("cascade", "ccc"):
            linear, s.integral, s.coupled_integral = cascade(c, s.integral, s.coupled_integral, controller == "ccc", p)
            return linear + balance, balance, linear
        if controller == "track":  # R = I, r_n = r
            linear, s_bar = contouring_law(
                IDENTITY, 0.0, 0.0, c.e_w, c.e_w_dot, c.e_w, c.e_w_dot, c.r_ddot, q_dot, s.k_hat, p
            )
        else:
            linear, s_bar = contouring_law(
                c.rotation,
                c.theta_dot,
                c.theta_ddot,
                c.e_turning,
                c.e_wn_dot,
                c.e_n,
                c.e_n_dot,
                c.rn_ddot,
                q_dot,
                s.k_hat,
                p,
            )
        turn = np.arange(2) == s.turn
        s.k_hat = np.where(turn, adapt_k(s.k_hat, s_bar, TURNS * p.dt_s, p), s.k_hat)
        u = linear + balance
        if controller != "ccu":
            return u, balance, linear
        if p.input_printed:  # (2) as printed
            linear = u
        z_max = p.phi_mps / p.alpha_1ps
        z = np.clip(q - s.q_bar, -z_max, z_max)  # beyond it sat() is full and z would only wind up (decision)
        s.q_bar = q - z
        _, surface_s, _, compensator = compensation(z, q_dot - s.q_bar_dot, c.rotation, c.theta_dot, s.mu, p)
        s.mu = np.where(turn, adapt_mu(s.mu, surface_s, TURNS * p.dt_s, p), s.mu)
        feedforward = feedforward_force(s.feedforward_friction_N, s.feedforward_mass_kg, direction, c.r_ddot)
        if not s.saturated:  # a force that was not given teaches nothing
            turn = np.arange(2) + 2 == s.turn
            along = direction * sign**2 if shaped else sign  # a reference at rest teaches nothing about friction
            friction_N, mass_kg = adapt_feedforward(
                s.feedforward_friction_N, s.feedforward_mass_kg, along, c.r_ddot, compensator, TURNS * p.dt_s, p
            )
            s.feedforward_friction_N = np.where(turn, friction_N, s.feedforward_friction_N)
            s.feedforward_mass_kg = np.where(turn, mass_kg, s.feedforward_mass_kg)
        return u + compensator + feedforward, balance + feedforward, linear


# --- The machine ------------------------------------------------------------------------------------------------------


class Plant:
    """(1) with true stiction, schedule (32), Gaussian force noise, encoder and delay; both axes at once.

    An axis at rest stays at rest while the force on it is within the Coulomb level; friction stops a moving axis and
    does not turn it round.
    """

    def __init__(self, p: Params, start_m: Array, seed: int):
        self.p = p
        self.position_m = np.array(start_m, dtype=np.float64)
        self.velocity_mps = np.zeros(2)
        self.asked_N = [np.zeros(2) for _ in range(p.delay_periods + 1)]
        self.rng = np.random.default_rng(seed)
        self.period = 0

    def encoder(self) -> Array:
        """Positions (2,) as the encoder has them, m: the nearest count."""
        return np.rint(self.position_m / self.p.encoder_m) * self.p.encoder_m

    def friction_scale(self) -> float:
        """(32) at this period."""
        t = self.period * self.p.dt_s
        if self.p.schedule_repeat_s > 0.0:
            t = t % self.p.schedule_repeat_s
        row = int(np.searchsorted(self.p.schedule_time_s, t, side="right")) - 1
        return self.p.schedule_scale[row] if row >= 0 else 1.0

    def step(self, force_N: Array) -> None:
        """Let one control period pass with force_N (2,) asked for at its start."""
        p = self.p
        self.asked_N = [np.clip(force_N, -p.force_max_N, p.force_max_N), *self.asked_N[:-1]]
        force = self.asked_N[p.delay_periods] + p.noise_N * self.rng.standard_normal(2)
        level = p.coulomb_N * self.friction_scale()
        h = p.dt_s / p.substeps
        for _ in range(p.substeps):
            v = self.velocity_mps
            direction = np.where(v != 0.0, np.sign(v), np.sign(force))
            stuck = (v == 0.0) & (np.abs(force) <= level)
            after = v + h * (force - p.viscous_Nspm * v - direction * level) / p.mass_kg
            after = np.where(stuck | (after * direction < 0.0), 0.0, after)
            self.position_m = self.position_m + 0.5 * h * (v + after)
            self.velocity_mps = after
        self.period += 1


class Loop:
    """Servo and plant, closed: `step()` is one control period."""

    def __init__(self, params: Params, knots_nm: npt.NDArray[np.int32], seed: int, controller: str = "ccu"):
        """At rest at the first knot of knots_nm (n, 2)."""
        start = np.asarray(knots_nm[0], dtype=np.float64) * 1e-9
        self.controller = controller
        self.plant = Plant(params, start, seed)
        self.servo = Servo(params, knots_nm, self.plant.encoder())
        self.periods = 0

    def step(self) -> Array:
        """Let one control period pass; returns the force (2,) asked for in it, N."""
        t_s = self.periods * self.servo.p.dt_s
        force = self.servo.step(self.plant.encoder(), t_s, self.controller)
        self.plant.step(force)
        self.periods += 1
        return force
