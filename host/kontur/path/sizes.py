# SPDX-License-Identifier: Apache-2.0
"""The shapes by name, and the sizes that each takes, for who asks a user for them. Loads no mathematics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from kontur.errors import PathError

if TYPE_CHECKING:
    from kontur.path.geometry import Program

# Sizes of each shape, in mm (laps: turns), and their defaults.
SHAPES: dict[str, dict[str, float]] = {
    "circle": {"radius": 20.0, "laps": 1.0},
    "ellipse": {"half_width": 30.0, "half_height": 15.0, "laps": 1.0},
    "eight": {"size": 40.0, "laps": 1.0},
    "square": {"side": 40.0, "corner_radius": 5.0},
    "spiral": {"inner": 0.0, "outer": 20.0, "pitch": 5.0},
}
DEFAULT_FEED_MPS = 0.02


def shape(name: str, sizes: Mapping[str, float], feed_mps: float) -> Program:
    """The program of a shape; `sizes` in mm and turns, the others have their defaults. Raises PathError: a size does
    not belong to the shape, or is not possible."""
    from kontur.path import shapes

    for size in sizes:
        if size not in SHAPES[name]:
            raise PathError(f"{size} does not belong to {name}; it has {', '.join(SHAPES[name])}")
    values = {
        (size if size == "laps" else f"{size}_m"): value * (1.0 if size == "laps" else 1e-3)
        for size, value in (SHAPES[name] | dict(sizes)).items()
    }
    program: Program = getattr(shapes, name)(**values, feed_mps=feed_mps)
    return program
