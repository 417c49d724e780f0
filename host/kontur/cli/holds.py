# SPDX-License-Identifier: Apache-2.0
"""The operator at a hold of the path (M0, M1, M6): Enter, SIGUSR2 or the live page let it go on."""

from __future__ import annotations

import os
import select
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from kontur.cli.live_page import Panel

if TYPE_CHECKING:
    from kontur.path.geometry import Program


@dataclass
class Release:
    """Operator.release of a run along `program`; with `yes` no hold waits."""

    program: Program
    panel: Panel
    yes: bool
    asked: int | None = None

    def __call__(self, hold: int) -> bool:
        if self.yes:
            return True
        if self.asked != hold:
            from kontur.planning.outputs import held

            self.asked, self.panel.held = hold, True
            event = held(self.program)[hold]
            while sys.stdin is not None and sys.stdin.isatty() and _entered():
                pass  # typed before the path was held, so not meant for this hold
            click.echo(
                f"\nThe path is held at {event.word} in line {event.line}. "
                f"Press Enter to go on (from another terminal: kill -USR2 {os.getpid()}), Ctrl-C to stop.",
                err=True,
            )
        if _entered():
            self.panel.held = False
        return not self.panel.held


def _entered() -> bool:
    """Whether a line has come from the terminal, or from what stands in for it."""
    if sys.stdin is None:  # closed
        return False
    try:
        ready, _, _ = select.select([sys.stdin], [], [], 0.0)
    except (OSError, ValueError):  # no file that can be waited for
        return False
    return bool(ready) and sys.stdin.readline() != ""
