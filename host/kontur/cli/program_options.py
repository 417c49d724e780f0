# SPDX-License-Identifier: Apache-2.0
"""Options of the verbs that take a path: a file, or a shape with its sizes."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.shell_completion import CompletionItem

from kontur.cli.options import POSITIVE, NumberRange, grouped, offered
from kontur.cli.path_options import interpreter_option, z_option
from kontur.errors import FileError
from kontur.path.sizes import DEFAULT_FEED_MPS, SHAPES, shape

if TYPE_CHECKING:
    from kontur.path.gcode_words import Refusals
    from kontur.path.geometry import Program

F = TypeVar("F", bound=Callable[..., Any])

_MAY_BE_0 = ("corner_radius", "inner")


@dataclass(frozen=True)
class Source:
    """The path of the file `name`, or of a shape with its `sizes` in mm; `feed` in mm/s. `z` and `interpreter` as in
    kontur.path.programs."""

    name: str
    feed: float | None
    z: str
    interpreter: bool
    sizes: dict[str, float]

    def load(self) -> Program:
        """Raises FileError: anything that the file is refused for."""
        program, refusals = self.check()
        if refusals:
            raise refusals.error()
        return program

    def check(self) -> tuple[Program, Refusals]:
        """The program, and all that the file is refused for. Raises FileError: of the whole file."""
        from kontur.path import programs
        from kontur.path.gcode_words import Refusals

        feed_mps = DEFAULT_FEED_MPS if self.feed is None else self.feed * 1e-3
        if self.name in SHAPES:
            return shape(self.name, self.sizes, feed_mps), Refusals(self.name)
        if not os.path.exists(self.name):  # Path.exists() raises OSError for a name that is too long
            raise FileError(self.name, f"no such file, and no shape either; shapes are {', '.join(SHAPES)}")
        return programs.check(self.name, None if self.feed is None else feed_mps, self.z, self.interpreter)

    def notes(self) -> list[str]:
        """What is taken since nothing was said."""
        if self.feed is not None or self.name not in SHAPES:
            return []
        return [f"No --feed was given, so it is {DEFAULT_FEED_MPS * 1e3:g} mm/s."]


def _source(source: str, feed: float | None, z: str, interpreter: bool, **sizes: float | None) -> Source:
    given = {name: value for name, value in sizes.items() if value is not None}
    for name in given:
        if name not in SHAPES.get(source, {}):
            raise click.UsageError(f"--{name.replace('_', '-')} does not belong to {source}")
    return Source(source, feed, z, interpreter, given)


class _Source(click.types.StringParamType):
    """A file or the name of a shape."""

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return [CompletionItem(incomplete, type="file"), *offered(SHAPES, incomplete)]  # bash drops what precedes files


def _shape_option(name: str, text: str) -> Callable[[F], F]:
    shapes_with = [f"{shape} {defaults[name]:g}" for shape, defaults in SHAPES.items() if name in defaults]
    unit = "" if name == "laps" else ", mm"
    kind = NumberRange(min=0) if name in _MAY_BE_0 else POSITIVE
    return click.option(
        f"--{name.replace('_', '-')}", type=kind, help=f"{text}{unit} (default: {', '.join(shapes_with)})."
    )


program_options = grouped(
    "source",
    _source,
    click.argument("source", type=_Source(), metavar=f"FILE|{'|'.join(SHAPES)}"),
    click.option(
        "--feed",
        type=POSITIVE,
        metavar="MM_PER_S",
        help=f"Speed along a shape (default: {DEFAULT_FEED_MPS * 1e3:g}) or a CSV path of x,y.",
    ),
    z_option,
    interpreter_option,
    _shape_option("radius", "Radius"),
    _shape_option("half_width", "Half axis along x"),
    _shape_option("half_height", "Half axis along y"),
    _shape_option("size", "Width"),
    _shape_option("side", "Side"),
    _shape_option("corner_radius", "Radius of the corners"),
    _shape_option("inner", "Inner radius"),
    _shape_option("outer", "Outer radius"),
    _shape_option("pitch", "Distance from turn to turn"),
    _shape_option("laps", "Laps"),
)
