# SPDX-License-Identifier: Apache-2.0
"""`kontur scope`: record signals of the servo at the control rate in the drive, around a trigger, and read them."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from kontur.can.emcy import describe_emcy
from kontur.can.signals import CHANNELS, DEFAULT_SIGNALS, RECORDED
from kontur.cli.options import SIGNALS, NumberRange, check_output, drive_of, interruptible, progress_bar, target_options
from kontur.cli.output import print_json, print_table
from kontur.errors import DeviceError, KonturError

if TYPE_CHECKING:
    from kontur.drive.device import Device
    from kontur.drive.scope import Capture, Setup
    from kontur.drive.target import Target


@click.command(name="scope")
@click.option("--signals", type=SIGNALS, default=",".join(DEFAULT_SIGNALS), show_default=True, metavar="NAME,...",
              help=f"What to record, {CHANNELS} at most; --list shows all signals.")  # fmt: skip
@click.option("--trigger", default="fault", show_default=True, metavar="now|fault|NAME>LEVEL|NAME<LEVEL",
              help="What triggers the capture; LEVEL in the signal's unit. A fault always triggers.")  # fmt: skip
@click.option("--pre", type=float, default=0.5, show_default=True, help="Share of the capture before the trigger.")
@click.option("--divider", type=click.IntRange(1, 10_000), default=1, show_default=True,
              help="Control periods from one frame to the next.")  # fmt: skip
@click.option("--wait", "wait_s", type=NumberRange(min=0.0), default=60.0, show_default=True, metavar="SECONDS",
              help="How long to wait for the trigger.")  # fmt: skip
@click.option("--last", is_flag=True, help="Read the capture that the drive holds, e.g. of a fault, without arming it.")
@click.option("-o", "--output", "outputs", multiple=True, type=click.Path(dir_okay=False, path_type=Path),
              help="Save as picture (.png, .svg) or table (.csv, .mf4). Can be repeated.")  # fmt: skip
@click.option("--list", "list_signals", is_flag=True, help="List all signals.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@target_options
def command(
    *,
    target: Target,
    signals: str,
    trigger: str,
    pre: float,
    divider: int,
    wait_s: float,
    last: bool,
    outputs: tuple[Path, ...],
    list_signals: bool,
    as_json: bool,
) -> None:
    """Record signals of the servo at the control rate around a trigger, read them out, save and show them.

    The capture of a fault stays in the drive until the fault is reset; --last reads it. To record during a run, use
    `kontur run --scope`.
    """
    if list_signals:
        rows = [{"name": s.name, "unit": s.unit, "": s.description} for s in RECORDED.values()]
        print_json(rows) if as_json else print_table(rows)
        return
    from kontur.drive import scope
    from kontur.report import capture_file

    for path in outputs:
        check_output(path, *capture_file.SUFFIXES)
    setup = scope.Setup(scope.names(signals), scope.trigger(trigger), pre, divider)
    with drive_of(target) as device, _armed_at_the_end(device):
        capture = _last(device) if last else _record(device, setup, wait_s)
        for path in outputs:
            capture_file.save(capture, path)
    show(capture, as_json)


@contextmanager
def _armed_at_the_end(device: Device) -> Iterator[None]:
    """Arm the scope for faults at the end, as at power-on, unless it holds the capture of a fault."""
    from kontur.drive import scope

    try:
        yield
    finally:
        with suppress(KonturError):  # the first error is the one to report
            if not device.read("error_code_x"):
                scope.release(device)


def _last(device: Device) -> Capture:
    from kontur.drive import scope

    with progress_bar("reading") as progress:
        capture = scope.held(device, progress)
    if capture is None:
        raise DeviceError(
            "the drive holds no capture: nothing has triggered its scope since power-on or the last fault reset"
        )
    return capture


def _record(device: Device, setup: Setup, wait_s: float) -> Capture:
    from kontur.drive import scope

    scope.arm(device, setup)
    with interruptible() as stop_requested:
        done = scope.wait(device, wait_s, stop_requested)
        if not done and stop_requested():
            click.echo("Interrupted: there was no trigger.", err=True)
            sys.exit(stop_requested.exit_code)
    if not done:
        raise DeviceError(
            f"no trigger ({setup.trigger}) has come within {wait_s:g} s; wait longer (--wait), or check the level"
        )
    with progress_bar("reading") as progress:
        return scope.read(device, progress)


def show(capture: Capture, as_json: bool) -> None:
    """Print the range of each signal, and its value at the trigger."""
    at = min(capture.trigger_frame, len(capture.values) - 1)
    rows: list[dict[str, Any]] = [
        {
            "signal": s.name,
            "unit": s.unit,
            "min": float(capture[s.name].min()),
            "at trigger": float(capture[s.name][at]),
            "max": float(capture[s.name].max()),
        }
        for s in capture.signals
    ]
    facts = {
        "frames": len(capture.values),
        "interval_s": capture.periods / capture.control_hz,
        "trigger_frame": capture.trigger_frame,
        "trigger_period": capture.trigger_period,
        "fault": f"{capture.fault:04X}h" if capture.fault else None,
    }
    if as_json:
        print_json({**facts, "signals": rows})
        return
    span = f"{capture.time_s[0] * 1e3:.1f} to {capture.time_s[-1] * 1e3:.1f} ms"
    print_table(rows, f"{facts['frames']} frames, {span} from the trigger")
    if capture.fault:
        click.echo(f"Triggered by {describe_emcy(capture.fault)}.")
