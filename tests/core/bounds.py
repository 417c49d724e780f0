# SPDX-License-Identifier: Apache-2.0
"""How far float32 may be from the oracle: forward error bounds to first order, not tuned.

Every float32 operation errs by at most U times its result, every input by U times itself. A sum of products with N
roundings on its longest way errs by at most N U times the sum of the magnitudes of its terms, plus, for each factor
that is itself in error, that error times the magnitude of what it is multiplied with. Where the core makes a rounded
step in path time, everything evaluated there moves by its own rate times the error of that time. Vectors count with
their lengths, and a length that is the sum of two is counted as the sum: so a bound is some two to thirty times the
error that is seen, never less.

Positions do not count: they are integers of 2^-16 nm, and are subtracted as such.
"""

from __future__ import annotations

import numpy as np
import oracle

U = 2.0**-24
"""Relative error of one rounding."""
DOUBLE = 2.0**-53
"""The same in double."""
QUANTUM_M = 2.0**-17 * 1e-9
"""Error of rounding a position, m."""
READ = 2.0**-33
"""Error of reading a value out of the core, in the core's units."""
COSH = 1e-6
"""Relative error of trig_cosh(), as its header promises."""
UM, T0 = 1e-6, 5e-3


def size(v: object) -> float:
    """Length of a vector, magnitude of a number."""
    return float(np.linalg.norm(v))


def point(p: oracle.Point) -> tuple[float, float, float, float]:
    """Errors of r, d1, d2, d3 from the Taylor form in differences of knots (integers, exact; /1000 rounds once).

    v = (c2 - c0)/2 and the second differences a0, a1 are rounded once, u twice. d2 = a0 + u (a1 - a0) takes 5 more,
    d1 = v + u/2 (a0 + d2) 8, r - c1 = a0/6 + u (v + u/2 (a0 + u/3 (a1 - a0))) 10. In terms of the point itself:
    |a0|, |a1| <= (|d2| + |d3| h) h^2 and |v| <= (|d1| + |d2| h + |d3| h^2) h. Last, the oracle's own error: it sums
    absolute positions in double.
    """
    h = oracle.KNOT_S
    own = 8 * DOUBLE * size(p.r)
    a = size(p.d2) + size(p.d3) * h
    v = size(p.d1) + a * h
    read = READ * UM
    return (
        10 * U * v * h + QUANTUM_M + read + own,
        8 * U * (v + 2 * a * h) + read / T0 + own / h,
        6 * U * 3 * a + read / T0**2 + own / h**2,
        4 * U * 2 * a / h + read / T0**3 + own / h**3,
    )


def contour(
    c: oracle.Contour,
    foot: oracle.Point,
    ref: oracle.Point,
    q: np.ndarray,
    q_dot: np.ndarray,
    rate: float,
    rate_dot: float,
    p: oracle.Params,
) -> dict[str, float]:
    """Errors of the members of api_contour, by the chain of (3)-(9) as contour.c evaluates it."""
    r_r, r_1, r_2, _ = point(ref)
    f_r, f_1, f_2, f_3 = point(foot)
    V, A, J = size(foot.d1), size(foot.d2), size(foot.d3)
    E, F, G = size(q - foot.r), size(c.e_w), size(foot.r - ref.r)
    qd, R = size(q_dot), size(c.r_dot)
    v2 = p.v_min_mps**2
    slope = oracle.foot_slope(foot, q - foot.r, p)
    speed2 = V**2 + v2
    d_q = U * qd

    # (3)-(5) at the reference
    b: dict[str, float] = {}
    b["r_dot"] = rate * r_1 + 2 * U * R
    b["r_ddot"] = rate**2 * r_2 + 3 * U * rate**2 * size(ref.d2) + abs(rate_dot) * (r_1 + 3 * U * size(ref.d1))
    b["e_w"] = r_r + 3 * U * F
    b["e_w_dot"] = d_q + b["r_dot"] + U * (qd + R)
    t_ref = min(2.0, 2 * r_1 / max(size(ref.d1), 1e-30)) + 4 * U
    b["e_l"] = b["e_w"] + F * (t_ref + 2 * U)
    ref2 = size(ref.d1) ** 2 + v2
    b["t_d"] = b["e_l"] * size(ref.d1) / ref2 + F * r_1 / ref2 + abs(c.t_d) * (2 * r_1 * size(ref.d1) / ref2 + 6 * U)

    # (6): a path time in error moves everything at the foot point. Newton forgets its start's error to second order.
    d_slope = 2 * V * f_1 + E * f_2 + A * (f_r + 3 * U * E) + 6 * U * (V**2 + E * A + v2)
    if p.newton:
        step = abs(c.tau_s - max(c_start(c, ref, p), 0.0))
        tau = (E * f_1 + V * (f_r + 3 * U * E) + 3 * U * E * V) / slope + step * (d_slope / slope + 2 * U)
        tau += b["t_d"] * min(1.0, (step * 3 * V * A + step * E * J) / slope)
    else:
        tau = b["t_d"]
    tau += 2.0**-29 * T0 * 2  # of path_shift()
    b["tau"] = tau
    f_1 += A * tau + J * tau**2
    f_2 += J * tau
    d_e = f_r + 3 * U * E + V * tau
    d_slope = 2 * V * f_1 + E * f_2 + A * d_e + 6 * U * (V**2 + E * A + v2)

    # the frame and its rates
    t = min(2.0, 2 * f_1 / max(V, 1e-30)) + 4 * U
    if V <= oracle.STANDSTILL_MPS:
        t = 0.0
    b["t"] = t
    theta_1 = A * V / speed2
    d_theta_1 = (f_1 * A + V * f_2 + 3 * U * V * A) / speed2 + theta_1 * (2 * V * f_1 / speed2 + 3 * U)
    theta_2 = V * J / speed2 + 2 * theta_1 * V * A / speed2
    d_theta_2 = (
        (f_1 * J + V * f_3 + 3 * U * V * J) / speed2
        + 2 * (d_theta_1 * V * A + theta_1 * (f_1 * A + V * f_2 + 3 * U * V * A)) / speed2
        + theta_2 * (2 * V * f_1 / speed2 + 5 * U)
    )
    nu = abs(c.nu)
    d_nu = (qd * f_1 + V * d_q + 3 * U * (qd * V + v2 * rate)) / slope + nu * (d_slope / slope + 2 * U)
    b["nu"] = min(d_nu, 8.0)
    w, w_dot = abs(c.theta_dot), abs(c.theta_ddot)
    d_w = d_theta_1 * nu + theta_1 * d_nu + U * w
    d_w_dot = d_theta_2 * nu**2 + 2 * theta_2 * nu * d_nu + 2 * U * theta_2 * nu**2
    b["theta_dot"] = d_w
    b["theta_ddot"] = d_w_dot

    # (7), (8) with f = n . (r_a - r), g = t . (r_a - r)
    A_r = size(c.r_ddot)
    d_f = r_r + f_r + 3 * U * G + G * t
    d_g = d_f + V * tau
    d_rdot, d_rddot = b["r_dot"] + R * (t + 2 * U), b["r_ddot"] + A_r * (t + 2 * U)
    speed = V * nu
    d_f_dot = d_w * G + w * d_g + d_rdot + 4 * U * (w * G + R)
    g_dot = w * G + speed + R
    d_g_dot = f_1 * nu + V * d_nu + d_rdot + d_w * G + w * d_f + 5 * U * g_dot
    f_dot = w * G + R * min(1.0, size(foot.d1 / max(V, 1e-30) - ref.d1 / max(size(ref.d1), 1e-30)) + t_ref + t)
    f_ddot = w_dot * G + w * (g_dot + R) + A_r
    d_f_ddot = d_w_dot * G + w_dot * d_g + d_w * (g_dot + R) + w * (d_g_dot + d_rdot) + d_rddot + 6 * U * f_ddot
    b["rn_dot"] = b["r_dot"] + d_f_dot + f_dot * t + G * d_w + w * d_f + G * w * t + 4 * U * (R + f_dot + G * w)
    along = G * w_dot + 2 * f_dot * w
    d_along = d_f * w_dot + G * d_w_dot + 2 * (d_f_dot * w + f_dot * d_w) + 4 * U * along
    d_bend = d_f * w**2 + 2 * G * w * d_w + 3 * U * G * w**2
    b["rn_ddot"] = (
        b["r_ddot"]
        + d_f_ddot
        + d_bend
        + d_along
        + (f_ddot + G * w**2 + along) * t
        + 6 * U * (A_r + f_ddot + G * w**2 + along)
    )
    b["e_wn"] = b["e_w"] + d_f + G * t + 3 * U * (F + G)
    b["e_wn_dot"] = d_q + b["rn_dot"] + U * (qd + size(c.rn_dot))

    # (9)
    b["e_n"] = max(b["e_w"] + F * (t + 2 * U), f_r + E * (t + 3 * U))
    e_dot = size(c.e_wn_dot) + w * size(c.e_wn)
    b["e_n_dot"] = b["e_wn_dot"] + w * b["e_wn"] + d_w * size(c.e_wn) + e_dot * (t + 5 * U)
    units = {"t_d": T0, "tau": T0, "nu": 1.0, "t": 1.0, "theta_dot": 1 / T0, "theta_ddot": 1 / T0**2}
    order = {k: 2 if k.endswith("_ddot") else 1 if k.endswith("_dot") else 0 for k in b}
    return {k: v + READ * units.get(k, UM / T0 ** order[k]) for k, v in b.items()}


def c_start(c: oracle.Contour, ref: oracle.Point, p: oracle.Params) -> float:
    """Path time at which Newton's step started, s: the reference's own, less t_d."""
    return c.t_s - c.t_d


def law(c: dict[str, np.ndarray], w: float, w_dot: float, k_hat: np.ndarray, p: oracle.Params) -> tuple[float, float]:
    """Errors of (s_bar m/s, u_linear N): 6 roundings for s_bar, 20 for the force, and COSH in psi."""
    e, e_dot = size(c["e"]), size(c["e_dot"])
    psi = p.beta * (np.cosh(min(p.k_bar_1pm * p.e_max_m, 4.0)) if p.psi_printed else 1.0) * p.gamma_1ps
    a = p.lambda_1ps + psi
    b = psi * p.k_bar_1pm * e_dot
    k = float(np.max(k_hat))
    s_bar = 6 * U * (a * e + e_dot) + COSH * psi * e
    terms = size(c["r_ddot"]) + a * e_dot + b * e + k * (a * e + e_dot)
    terms += (abs(w_dot) + w**2) * size(c["e_w"]) + 2 * abs(w) * size(c["e_w_dot"])
    mass, viscous = float(np.max(p.mass_kg)), float(np.max(p.viscous_Nspm))
    force = 20 * U * (mass * terms + viscous * size(c["q_dot"]))
    return s_bar + READ * UM / T0, force + mass * COSH * psi * (e_dot + k * e) + mass * 3 * COSH * b * e
