# SPDX-License-Identifier: Apache-2.0
"""`kontur sim`: the simulated drive as a process of its own, on a bus."""

from __future__ import annotations

import dataclasses
import signal
import subprocess
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import click

from kontur.cli.options import grouped, simulation_options, told_of, told_options
from kontur.errors import FileError
from kontur.machine import MACHINES, NOTHING, ON_CHIP, load, told_text

if TYPE_CHECKING:
    from kontur.drive.target import Target
    from kontur.sim.emulator import Emulator
    from kontur.sim.process import SimProcess

_POLL_S = 0.2
_NOT_OF_IMAGES = ("can", "slcan_tcp", "slcan_pty", "node", "record", "store", "num")


def _interrupt(_signal: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


@click.command(name="sim")
@click.option("--can", metavar="INTERFACE", help="Answer on a SocketCAN interface, e.g. vcan0 or can0.")
@click.option(
    "--slcan-tcp",
    metavar="[HOST:]PORT",
    help="Answer on slcan over TCP; port 0: any free one. This is the default, with port 0.",
)
@click.option("--slcan-pty", is_flag=True, help="Answer on slcan over a pseudo-terminal.")
@click.option(
    "--pace",
    type=click.Choice(["clock", "sync"]),
    default="clock",
    show_default=True,
    help="How the drive's time passes: with the wall clock, or with SYNC, which makes every run the same.",
)
@click.option("--node", type=click.IntRange(1, 31), default=1, show_default=True, help="CANopen node id.")
@click.option(
    "--record",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Write the true positions (struct ks_truth, each control period) to this file at the end.",
)
@click.option(
    "--store",
    type=click.Path(dir_okay=False, path_type=Path),
    help="File of the flash: what the drive stores (1010h) is there again in the next run.",
)
@click.option(
    "--image",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="ELF",
    help="Run this image of the chip's firmware in QEMU, on slcan; it simulates its machine by itself. `make firmware` "
    "makes build/firmware/kontur.elf.",
)
@grouped("told", partial(told_of, otherwise=NOTHING), *told_options(NOTHING))
@simulation_options
def command(
    *,
    can: str | None,
    slcan_tcp: str | None,
    slcan_pty: bool,
    pace: str,
    node: int,
    record: Path | None,
    store: Path | None,
    image: Path | None,
    machine: str,
    seed: int,
    num: str,
    told: tuple[str, str],
) -> None:
    """Simulate a drive on a bus, until Ctrl-C.

    The firmware and its machine run in a process of their own, for kontur in another terminal or any CANopen master.
    The drive is like a new one: it is told nothing of its machine. With --told it gets its parameters over its bus,
    before this command says that it answers; those win over what --store has.
    """
    from kontur.drive.target import Target, tell
    from kontur.sim import process

    signal.signal(signal.SIGTERM, _interrupt)
    if image is not None:
        _refuse_with_image(click.get_current_context())
        _run_image(image, Target(load(machine), seed=seed, told=told[0], compensation=told[1]), pace)
        return
    if (can is not None) + (slcan_tcp is not None) + slcan_pty > 1:
        raise click.UsageError("one bus at a time: --can, --slcan-tcp or --slcan-pty")
    if can is None and not slcan_pty:
        slcan_tcp = slcan_tcp or "0"
    plant = load(machine)
    with process.start(
        can=can,
        slcan_tcp=slcan_tcp,
        slcan_pty=slcan_pty,
        pace=pace,
        machine=plant,
        seed=seed,
        node_id=node,
        num=num,
        record=record,
        store=store,
    ) as sim:
        try:
            target = Target(plant, sim.options(), node, seed, told=told[0], compensation=told[1])
            if target.told != NOTHING:
                tell(target)
            _announce(sim, target)
            _wait(sim)
        except KeyboardInterrupt:
            pass


def _refuse_with_image(context: click.Context) -> None:
    """Raises UsageError where an option was given that an image in QEMU has not."""
    for parameter in context.command.params:
        name = str(parameter.name)
        if name in _NOT_OF_IMAGES and context.get_parameter_source(name) != click.core.ParameterSource.DEFAULT:
            raise click.UsageError(
                f"--image: the image answers on slcan at a free port, as node 1, with its own numbers; leave out "
                f"{parameter.opts[0]}"
            )


def _run_image(image: Path, target: Target, pace: str) -> None:
    from kontur.drive.target import tell_emulated
    from kontur.sim import emulator

    if target.machine.model != ON_CHIP:
        raise FileError(
            target.machine.name,
            'is no machine that the drive simulates by itself (model = "on_chip"); name one that is with --machine, '
            f"such as {MACHINES / 'ball_screw_on_chip.toml'}",
        )
    with emulator.start(image) as running:
        try:
            target = dataclasses.replace(target, bus=running.options())
            tell_emulated(target, pace)
            _announce(running, target)
            _wait(running)
        except KeyboardInterrupt:
            pass


def _announce(sim: SimProcess | Emulator, target: Target) -> None:
    node, options = target.node_id, sim.options()
    interface, channel = options["interface"], options["channel"]
    bus = f"-i {interface} -c {channel}" + (f" --node {node}" if node != 1 else "")
    click.echo(f"A drive answers on {interface} {channel}, node {node}. In another terminal:")
    click.echo(f"  kontur info {bus}")
    click.echo(f"  kontur run circle --radius 10 --feed 10 --approach {bus}")
    click.echo(f"It simulates {target.machine.name!r}, and is {told_text(target.told, target.compensation)}.")
    click.echo("Ctrl-C ends it.")


def _wait(sim: SimProcess | Emulator) -> None:
    """Wait until the process ends, and print its messages."""
    printed = 0
    ended = False
    while not ended:
        try:
            sim.process.wait(_POLL_S)
            ended = True
        except subprocess.TimeoutExpired:
            pass
        messages = sim.messages()
        if (
            not ended and len(messages) > printed
        ):  # the last messages of a process that has failed are raised as its error
            click.echo(messages[printed:], nl=False, err=True)
            printed = len(messages)
