# SPDX-License-Identifier: Apache-2.0
"""What is searched for each controller, and the parameters of the drive that it stands for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

Gains = dict[str, float]

_MU_MPS2 = 6.0
_LEARNING_PER_S = 2.0  # of the adaptive feedforward: slow beside every loop that a machine with a mode allows
_SLOPE_MAX, _STIFFNESS_MAX = 2000.0, 16e6  # 1/s and 1/s2: what the objects allow


@dataclass(frozen=True)
class Searched:
    """A quantity that is searched for, on a logarithmic scale."""

    name: str
    least: float
    greatest: float


def _smc(law: Sequence[float]) -> Gains:
    """From the sum of the two poles of (15), and their product as a share of its square: above 1/4 they are complex."""
    total, share = law
    apart = math.sqrt(max(0.0, 1.0 - 4.0 * share))
    slope, gain = min(_SLOPE_MAX, total * (1.0 + apart) / 2.0), total * (1.0 - apart) / 2.0
    return {
        "smc.lambda": slope,
        "smc.k_0": gain,
        "smc.k_max": gain,
        "smc.zeta": gain,
        "smc.stiffness": min(_STIFFNESS_MAX, max(0.0, share - 0.25) * total**2),
    }


def _ccu(law: Sequence[float]) -> Gains:
    total, share, alpha, ratio = law
    return _smc((total, share)) | {
        "compensator.alpha": alpha,
        "compensator.mu_0": _MU_MPS2,
        "compensator.mu_max": _MU_MPS2,
        "compensator.phi": _MU_MPS2 / ratio,
        "compensator.dead_zone": _MU_MPS2 / ratio,
        "compensator.in_axes": 1.0,
        "feedforward.friction_rate": _LEARNING_PER_S,
        "feedforward.mass_rate": _LEARNING_PER_S,
    }


def _cascade(law: Sequence[float]) -> Gains:
    position, velocity, integral = law
    return {
        "cascade.position_gain": position,
        "cascade.velocity_gain": velocity,
        "cascade.integral_gain": integral,
    }


def _ccc(law: Sequence[float]) -> Gains:
    return _cascade(law[:3]) | {"cascade.coupling_gain": law[3]}


OBSERVER = Searched("observer.bandwidth", 60.0, 5000.0)  # rad/s
_SMC = (Searched("sum of poles", 10.0, 4000.0), Searched("product of poles", 0.03, 1.5))
_CASCADE = (Searched("K_p", 5.0, 1900.0), Searched("K_v", 20.0, 4900.0), Searched("K_i", 1.0, 1900.0))
_CCU = (
    _SMC[0],
    Searched("product of poles", 0.03, 5.0),
    Searched("alpha", 1.0, 1900.0),
    Searched("mu/phi", 6.0, 6000.0),
)
LAWS: dict[str, tuple[tuple[Searched, ...], Callable[[Sequence[float]], Gains]]] = {
    "track": (_SMC, _smc),
    "cc": (_SMC, _smc),
    "ccu": (_CCU, _ccu),
    "cascade": (_CASCADE, _cascade),
    "ccc": ((*_CASCADE, Searched("W", 0.1, 5.0)), _ccc),
}
_OBSERVERS = ((60.0, 600.0), (600.0, 5000.0))
_TWO_INTEGRATORS = {"product of poles": (0.03, 1.5), "alpha": (5.0, 1900.0), "mu/phi": (20.0, 6000.0)}
_LITTLE_OF_THEM = {"alpha": (1.0, 20.0), "mu/phi": (6.0, 200.0)}
_BASINS = tuple({OBSERVER.name: of} for of in _OBSERVERS)
BASINS: dict[str, tuple[Mapping[str, tuple[float, float]], ...]] = {
    **dict.fromkeys(LAWS, _BASINS),
    "ccu": (*(_TWO_INTEGRATORS | basin for basin in _BASINS), _LITTLE_OF_THEM),
}
"""What is searched each by itself: ranges of some quantities. The first two have a slow and a fast observer. The
cascade never has a second integrator, and where a gap or a mode is slow `ccu` may not have it either."""
KNOWN = {  # where a search begins besides: the two basins of the contouring law with compensator
    "ccu": ((300.0, 0.22, 60.0, 1000.0, 1120.0), (1435.0, 0.198, 1140.0, 1500.0, 250.0)),
}
