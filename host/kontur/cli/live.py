# SPDX-License-Identifier: Apache-2.0
"""`kontur live`: a page in the browser beside a command, or beside another program that commands the drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from kontur.cli.live_page import live_page, panel
from kontur.cli.options import drive_of, interruptible, target_options

if TYPE_CHECKING:
    from kontur.drive.target import Target
    from kontur.live.view import View

_POLL_S = 0.1
_OWN = ("port", "wait", "words")


@click.command(name="live", context_settings={"allow_interspersed_args": False})
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, show_default="a free one", help="TCP port of the page."
)
@click.option("--wait", is_flag=True, help="Start the command when the page is open.")
@click.argument("words", nargs=-1, type=click.UNPROCESSED, metavar="[COMMAND ...]")
@target_options
@click.pass_context
def command(ctx: click.Context, /, *, port: int, wait: bool, words: tuple[str, ...], target: Target) -> None:
    """Serve a page that shows what the drive does, and print its address.

    With a COMMAND (run, jog, home, commission, scope, ...) and its options, it runs that, and the page has its buttons.
    Without one it shows the drive on a bus (-i, -c) that another program commands, until Ctrl-C, and has no buttons
    then.

    The page is for browsers of this machine, and for who has its address, which holds a secret. It needs no network.
    """
    given = [name for name in ctx.params if ctx.get_parameter_source(name) not in (ParameterSource.DEFAULT, None)]
    if words and (wrong := [name for name in given if name not in _OWN]):
        raise click.UsageError(f"{', '.join(wrong)}: these options belong to {words[0]}; write them behind it")
    if words:
        page = ctx.with_resource(live_page(port))
        _run(ctx, words, page if wait else None)
        return
    panel().offers = ()
    with interruptible() as stop_requested, live_page(port), drive_of(target) as device:
        while not stop_requested():
            device.link.wait(lambda: False, _POLL_S)


def _run(ctx: click.Context, words: tuple[str, ...], page: View | None) -> None:
    """Run another command inside this one, when somebody looks at `page`."""
    assert ctx.parent is not None
    group = ctx.parent.command
    assert isinstance(group, click.Group)
    name, *rest = words
    if name == "live" or (verb := group.get_command(ctx.parent, name)) is None:
        raise click.UsageError(f"{name!r} is no command that moves axes; `kontur --help` lists them")
    with verb.make_context(name, rest, parent=ctx.parent) as inner:
        if page is not None:
            with interruptible() as stop_requested:
                while not page.opened.wait(_POLL_S):
                    if stop_requested():
                        raise KeyboardInterrupt
        verb.invoke(inner)
