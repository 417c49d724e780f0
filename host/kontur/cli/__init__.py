# SPDX-License-Identifier: Apache-2.0
"""The command line: one module for each command, which parses options and prints. The rest is in the other rooms."""

from __future__ import annotations

import importlib
import sys
from typing import Any

import click

from kontur import __version__
from kontur.cli import terminal
from kontur.errors import KonturError

_VERBS = ("run", "jog", "home", "sim", "experiment", "info", "param", "scope", "log", "report", "bench", "demo")
EXIT_INTERRUPTED = 130


class _Verbs(click.Group):
    """Imports a command's module when it is used, and prints an error that the user can correct as one message."""

    def main(self, *args: Any, **extra: Any) -> Any:
        with terminal.guarded():
            return super().main(*args, **extra)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(_VERBS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _VERBS:
            return None
        command = importlib.import_module(f"kontur.cli.{cmd_name}").command
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
    context_settings={"help_option_names": ["-h", "--help"], "auto_envvar_prefix": "KONTUR", "max_content_width": 110},
)
@click.version_option(__version__)
def main() -> None:
    """Run paths on a Kontur drive, real or simulated, and measure the contour error.

    Without bus options (-i, can.conf, CAN_INTERFACE) the drive and its machine are simulated in this process. Each
    option can also be given as an environment variable, e.g. KONTUR_RUN_CONTROLLER.
    """
