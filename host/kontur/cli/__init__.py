# SPDX-License-Identifier: Apache-2.0
"""The command line: one module for each command, which parses options and prints. The rest is in the other rooms."""

from __future__ import annotations

import importlib
import os
import sys
from types import ModuleType
from typing import Any

import click
from click.shell_completion import CompletionItem

from kontur.cli import terminal
from kontur.errors import KonturError

# The list in `kontur --help`, which imports none of them.
_VERBS = {
    "run": "Run a path, and report the contour error.",
    "check": "Check a file without moving: refusals, extent, time, slowest places.",
    "live": "Show on a page what a command does, or what a drive on a bus does.",
    "circle-test": "Run circles in both senses, and show the figures of ISO 230-4.",
    "jog": "Move the axes with constant speed for a time.",
    "home": "Home an axis, so that positions count from its home point.",
    "sim": "Simulate a drive on a bus, until Ctrl-C.",
    "design": "Find parameters for a machine, under margins.",
    "commission": "Identify, tune, prove and store: from an unknown machine to a proven one.",
    "identify": "Measure mass, friction, first mode and lag of both axes.",
    "tune": "Find gains for a machine as it was identified.",
    "prove": "Measure sensitivity and circles, before and after, for the file.",
    "bode": "Measure the frequency response of an axis: machine, loop, margins.",
    "sweep": "Run many inputs on simulated machines, into one table.",
    "experiment": "Run a defined experiment on the simulated drive.",
    "info": "Show the drive that answers, and its state.",
    "doctor": "Look for what is wrong with bus, drive and wiring; nothing moves.",
    "param": "List, read, set and store parameters.",
    "scope": "Record signals of the servo tick.",
    "log": "Show or convert a log of a run.",
    "report": "Compare the runs of logs in one page.",
    "bench": "Measure the speed of simulation and streaming on this machine.",
    "demo": "Cut the demo part under every controller.",
}
EXIT_INTERRUPTED = 130


class _NoMf4(ModuleType):
    """Stands for python-can's readers of MF4 files, which would import asammdf and pandas (0.3 s) in every command.

    kontur.runs.log reads and writes MF4 by itself.
    """

    MF4Reader = MF4Writer = None


sys.modules.setdefault("can.io.mf4", _NoMf4("can.io.mf4"))
# NumPy's BLAS reads it when it is loaded. The matrices here are small: threads of its own only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


class _Verbs(click.Group):
    """Imports a command's module when it is used, and prints an error that the user can correct as one message."""

    def main(self, *args: Any, **extra: Any) -> Any:
        if "_KONTUR_COMPLETE" in os.environ:  # click writes bytes to a shell, and nothing from outside
            return super().main(*args, **extra)
        with terminal.guarded():
            return super().main(*args, **extra)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_VERBS)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(_VERBS.items()))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        verbs = [CompletionItem(name, help=text) for name, text in _VERBS.items() if name.startswith(incomplete)]
        return verbs + click.Command.shell_complete(self, ctx, incomplete)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _VERBS:
            return None
        command = importlib.import_module(f"kontur.cli.{cmd_name.replace('-', '_')}").command
        assert isinstance(command, click.Command)
        return command

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except KonturError as error:
            raise click.ClickException(str(error)) from error
        except KeyboardInterrupt:
            click.echo("Interrupted.", err=True)
            sys.exit(EXIT_INTERRUPTED)


@click.command(
    cls=_Verbs,
    context_settings={
        "help_option_names": ["-h", "--help"],
        "auto_envvar_prefix": "KONTUR",
        "max_content_width": 110,
        "color": True,  # click would remove escape sequences that go into a pipe; kontur.cli.terminal shows them
    },
)
@click.version_option(package_name="kontur")
def main() -> None:
    """Run paths on a Kontur drive, real or simulated, and measure the contour error.

    Without bus options (-i, can.conf, CAN_INTERFACE) the drive and its machine are simulated in this process. Each
    option can also be given as an environment variable, e.g. KONTUR_RUN_CONTROLLER.
    """
