# SPDX-License-Identifier: Apache-2.0
"""The live page of a command: `kontur run --live`, and `kontur live` around any other command."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from kontur.errors import KonturError

if TYPE_CHECKING:
    from kontur.drive.device import Device
    from kontur.live.view import View

_PANEL, _VIEW = "kontur.panel", "kontur.view"  # in click's meta, which all contexts of a call share


@dataclass
class Panel:
    """What the operator of a command asks for. Signals and the live page write it, and the command reads it.

    `percent`: feed override in %, 0.1 to 120. `offers`: which of hold, resume, stop and override the command obeys.
    """

    held: bool = False
    percent: float = 100.0
    stop: bool = False
    offers: Sequence[str] = ("stop",)

    def rate(self) -> float:
        """The feed override as a factor, 0 to hold."""
        return 0.0 if self.held else self.percent / 100.0


def panel() -> Panel:
    """The one of this command."""
    context = click.get_current_context(silent=True)
    found: Panel = Panel() if context is None else context.meta.setdefault(_PANEL, Panel())
    return found


def view() -> View | None:
    """What the live page of this command shows; None where there is no page."""
    context = click.get_current_context(silent=True)
    found: View | None = None if context is None else context.meta.get(_VIEW)
    return found


@contextmanager
def live_page(port: int = 0) -> Iterator[View]:
    """Serve a live page, whose address is printed to stderr. Inside another one it is that one."""
    if (there := view()) is not None:
        yield there
        return
    if importlib.util.find_spec("aiohttp") is None:
        raise KonturError("the live page needs aiohttp, which is not installed: pip install 'kontur[live]'")
    from kontur.live.server import serving
    from kontur.live.view import View

    page = View(panel())
    with serving(page, port) as address:
        click.echo(f"Live page: {address}", err=True)
        click.get_current_context().meta[_VIEW] = page
        try:
            yield page
        finally:
            page.end()


@contextmanager
def shown(device: Device) -> Iterator[None]:
    """Show on the live page, if there is one, what the telemetry of `device` says inside."""
    if (page := view()) is None:
        yield
        return
    from kontur.live.follow import following

    try:
        with following(device, page, click.get_current_context().command_path):
            yield
    except KonturError as error:
        page.end(str(error))
        raise
