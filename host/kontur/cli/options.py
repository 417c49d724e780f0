# SPDX-License-Identifier: Apache-2.0
"""Options that several verbs share: which drive, which machine; progress; Ctrl-C."""

from __future__ import annotations

import configparser
import functools
import math
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.shell_completion import CompletionItem

from kontur import machine as machines
from kontur.can import EDS
from kontur.can.signals import RECORDED
from kontur.cli import EXIT_INTERRUPTED
from kontur.cli.live_page import panel, shown
from kontur.cli.output import console, print_warnings
from kontur.drive.controllers import NAMES, named
from kontur.errors import BusError, FileError, KonturError, NoAnswerError, ParameterError
from kontur.files import check_folder
from kontur.sim import NUMS

if TYPE_CHECKING:
    from kontur.can.bad_bus import BusFaults
    from kontur.cli.live_page import Panel
    from kontur.drive.device import Device
    from kontur.drive.target import Target

F = TypeVar("F", bound=Callable[..., Any])


class _KeyValue(click.ParamType[tuple[str, str]]):
    name = "name=value"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, str]:
        if isinstance(value, tuple):
            return value
        key, separator, text = str(value).partition("=")
        if not separator or not key or not text:
            self.fail(f"{value!r} is not NAME=VALUE; write {key or 'NAME'}=VALUE, without spaces", param, ctx)
        return key, text


KEY_VALUE = _KeyValue()


def parameter_names() -> list[str]:
    """The names of all parameters, as kontur.drive.objects takes them from the EDS, without python-canopen."""
    eds = configparser.RawConfigParser()
    eds.read(EDS)
    names: list[str] = []
    for section in eds.sections():
        if eds.get(section, "StorageLocation", fallback="") == "PARAMETER":
            index, of_record, _ = section.partition("sub")
            name = eds[section]["ParameterName"]
            names.append(f"{eds[index]['ParameterName']}.{name}" if of_record else name)
    return names


def parameters_of(file: Path) -> dict[str, float]:
    """The values of a parameter file by name. Raises FileError, also where a name is none of a parameter."""
    from kontur.drive import objects, parameter_file

    values, names = parameter_file.read(file), parameter_names()
    for name in values:
        if name not in names:
            raise FileError(file, objects.unknown(name, names), word=name)
    return values


def offered(words: Iterable[str], incomplete: str) -> list[CompletionItem]:
    """What Tab offers: the words that begin with what stands there."""
    return [CompletionItem(word) for word in words if word.startswith(incomplete)]


class _Parameter(click.types.StringParamType):
    """The name of a parameter, or of any other object, which Tab does not offer."""

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return offered(parameter_names(), incomplete)


class _ParameterValue(_KeyValue):
    """NAME=VALUE of a parameter."""

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return offered((f"{name}=" for name in parameter_names()), incomplete)


class _Signals(click.types.StringParamType):
    """Names of signals that the scope records, with commas between them."""

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        before, comma, _ = incomplete.rpartition(",")
        return offered((f"{before}{comma}{name}" for name in RECORDED), incomplete)


class _MachineFile(click.Path):
    """A machine file: any, or one that comes with the package."""

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        known = offered(map(str, sorted(machines.MACHINES.glob("*.toml"))), incomplete)
        return super().shell_complete(ctx, param, incomplete) + known  # bash drops what precedes files


PARAMETER, PARAMETER_VALUE, SIGNALS = _Parameter(), _ParameterValue(), _Signals()
MACHINE = _MachineFile(dir_okay=False)


class NumberRange(click.FloatRange):
    """A finite number within bounds."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a number", param, ctx)
        return number


POSITIVE = NumberRange(min=0, min_open=True)


class _BusFaults(click.ParamType["BusFaults"]):
    name = "faults"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> BusFaults:
        from kontur.can.bad_bus import BUS_FAULT_NAMES, BusFaults

        if isinstance(value, BusFaults):
            return value
        given: dict[str, float] = {}
        for part in str(value).split(","):
            name, _, text = part.strip().partition("=")
            if name not in BUS_FAULT_NAMES:
                self.fail(f"{part.strip()!r} is not NAME=VALUE with one of {', '.join(BUS_FAULT_NAMES)}", param, ctx)
            try:
                given[name] = int(text) if name in ("seed", "flip_bits", "burst_frames", "txqueuelen") else float(text)
            except ValueError:
                self.fail(f"{name}: {text!r} is not a number", param, ctx)
        try:
            return BusFaults(**given)  # type: ignore[arg-type]
        except ValueError as error:
            self.fail(str(error), param, ctx)


BUS_FAULTS = _BusFaults()


class _Untold(click.Choice[str]):
    """`all`, or nothing: then the option's value is kontur.machine.LENGTHS."""

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        return "[all]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if value in ("", machines.LENGTHS):
            return machines.LENGTHS
        if value != "all":
            self.fail(f"{value!r} is not 'all'; write --untold behind the rest, or --untold all", param, ctx)
        return "all"


def told_options(otherwise: str = machines.ALL) -> tuple[Callable[[Any], Any], ...]:
    """--told, --untold, --untold all, --compensation; `otherwise`, one of kontur.machine.TOLD, where none is given."""
    default = {machines.ALL: " (the default)", machines.NOTHING: ""}[otherwise]
    return (
        click.option(
            "--told", is_flag=True, help=f"Set the simulated drive's parameters from the machine file{default}."
        ),
        click.option(
            "--untold",
            type=_Untold(["all"]),
            is_flag=False,
            flag_value=machines.LENGTHS,
            help="Leave them as they are from the factory, but for encoder lengths and soft limits; with `all`, "
            f"leave all of them{'' if default else ' (the default)'}.",
        ),
        click.option(
            "--compensation",
            type=click.Choice(machines.COMPENSATIONS),
            help="What --told sets: all that the drive has a parameter for, or what a rigid axis has (default: full).",
        ),
    )


def told_of(told: bool, untold: str | None, compensation: str | None, otherwise: str = machines.ALL) -> tuple[str, str]:
    """`told` and `compensation` of a Target. Raises UsageError where they contradict one another."""
    if told and untold is not None:
        raise click.UsageError("--told and --untold: which one?")
    what = machines.ALL if told else {"all": machines.NOTHING, None: otherwise}.get(untold, machines.LENGTHS)
    if compensation is not None and what != machines.ALL:
        raise click.UsageError("--compensation says what --told sets; the drive is not told that here")
    return what, compensation or machines.FULL


class _ControllerName(click.ParamType[str]):
    """A controller by either name, or "all"; the value is the paper's name."""

    name = "controller"

    def get_metavar(self, param: click.Parameter, ctx: click.Context) -> str:
        return "NAME|all"

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return offered([*NAMES, "all"], incomplete)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if value == "all":
            return "all"
        try:
            return named(str(value))
        except ParameterError as error:
            self.fail(str(error), param, ctx)


CONTROLLER = _ControllerName()


def grouped(name: str, build: Callable[..., Any], *options: Callable[[Any], Any]) -> Callable[[F], F]:
    """Give `options` to a verb together: it gets what `build` makes of their values as `name`."""

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def with_group(*args: Any, **kwargs: Any) -> Any:
            values = {key: kwargs.pop(key) for key in names}
            return function(*args, **{name: build(**values)}, **kwargs)

        others = list(getattr(function, "__click_params__", []))
        with_group.__click_params__ = list(others)  # type: ignore[attr-defined]
        decorated: Any = with_group
        for option in reversed(options):
            decorated = option(decorated)
        names = [str(param.name) for param in decorated.__click_params__[len(others) :]]
        result: F = decorated
        return result

    return decorate


parameter_option = click.option(
    "--set",
    "parameters",
    type=PARAMETER_VALUE,
    multiple=True,
    metavar="NAME=VALUE",
    help="Set a parameter before; `kontur param list` lists all.",
)
_SIMULATION = (
    click.option(
        "--machine",
        type=MACHINE,
        default=str(machines.DEFAULT),
        show_default="Table 1 of the paper",
        help="Machine file (TOML): what is simulated, and the limits that motion is planned for.",
    ),
    click.option(
        "--seed", type=click.IntRange(0, 2**63 - 1), default=1, show_default=True, help="Seed of the simulated noise."
    ),
    click.option(
        "--num",
        type=click.Choice(NUMS),
        default="f32",
        show_default=True,
        help="Numeric back end of the simulated firmware.",
    ),
)


def simulation_options(function: F) -> F:
    """--machine, --seed, --num."""
    decorated: Any = function
    for option in reversed(_SIMULATION):
        decorated = option(decorated)
    result: F = decorated
    return result


def _target(
    interface: str | None,
    channel: str | None,
    bitrate: int | None,
    bus: tuple[tuple[str, str], ...],
    bus_faults: BusFaults | None,
    node: int,
    set_pdos: bool,
    machine: str,
    seed: int,
    num: str,
    told: bool = False,
    untold: str | None = None,
    compensation: str | None = None,
) -> Target:
    from kontur.drive.target import Target

    what, compensated = told_of(told, untold, compensation)
    target = Target(
        bus=_bus_config(interface, channel, bitrate, bus),
        node_id=node,
        machine=machines.load(machine),
        seed=seed,
        num=num,
        faults=bus_faults,
        set_pdos=set_pdos,
        told=what,
        compensation=compensated,
    )
    if not target.in_process and (told or untold or compensation):
        raise click.UsageError(
            "--told, --untold, --compensation: a drive on a bus has its own parameters, which `kontur param` sets. "
            "Leave these options out; `kontur sim --told` is a drive on a bus that is told"
        )
    return target


_TARGET = (
    click.option(
        "-i",
        "--interface",
        help="python-can's interface, e.g. socketcan, slcan. Without one the drive is simulated.",
    ),
    click.option("-c", "--channel", help="python-can's channel, e.g. can0."),
    click.option("-b", "--bitrate", type=click.IntRange(min=1), help="Bit rate of the bus, bit/s."),
    click.option(
        "--bus", type=KEY_VALUE, multiple=True, metavar="NAME=VALUE", help="Any other option of python-can's bus."
    ),
    click.option(
        "--bus-faults",
        type=BUS_FAULTS,
        metavar="NAME=VALUE,...",
        help="Make the bus a bad one. Shares of the frames to drop, duplicate, delay, reorder or flip bits of; burst, "
        "bus_off; seed. E.g. drop=0.02,flip=0.005,seed=1.",
    ),
    click.option("--node", type=click.IntRange(1, 31), default=1, show_default=True, help="CANopen node id."),
    click.option(
        "--set-pdos",
        is_flag=True,
        help="Set the PDOs that kontur needs where another master has changed them, until the drive is reset.",
    ),
    *_SIMULATION,
)
target_options = grouped("target", _target, *_TARGET, *told_options())
"""Bus and simulation options, given to the verb together as `target`, a kontur.drive.target.Target."""
bus_options = grouped("target", _target, *_TARGET)
"""The same for a verb whose simulated drive is told what it says itself."""


def _simulated_target(
    machine: str, seed: int, num: str, told: bool, untold: str | None, compensation: str | None
) -> Target:
    from kontur.drive.target import Target

    what, compensated = told_of(told, untold, compensation)
    return Target(machine=machines.load(machine), seed=seed, num=num, told=what, compensation=compensated)


simulated_target_options = grouped("target", _simulated_target, *_SIMULATION, *told_options())
"""Machine, seed, numbers and what the drive is told, given to the verb together as `target`, simulated in process."""


def _bus_config(
    interface: str | None, channel: str | None, bitrate: int | None, more: tuple[tuple[str, str], ...]
) -> dict[str, Any] | None:
    import can.util

    from kontur.can.bus import configured_interface

    given: dict[str, Any] = {
        key: value
        for key, value in {"interface": interface, "channel": channel, "bitrate": bitrate}.items()
        if value is not None
    }
    given |= {key: can.util.cast_from_string(value) for key, value in more}
    if found := given.get("interface") or configured_interface():
        return given | {"interface": found}
    if given:
        raise click.UsageError(
            f"{', '.join(given)}: which interface? Name it with -i, or give none to simulate the drive"
        )
    return None


def check_output(file: Path | None, *suffixes: str) -> None:
    """Check an output file before anything moves. Raises FileError: another suffix, or its folder does not exist."""
    if file is None:
        return
    if file.suffix.lower() not in suffixes:
        raise FileError(file, f"must end in {' or '.join(suffixes)}")
    check_folder(file)


def parameter_values(pairs: tuple[tuple[str, str], ...]) -> dict[str, float]:
    """NAME=VALUE pairs as numbers. Raises ParameterError."""
    values: dict[str, float] = {}
    for name, text in pairs:
        try:
            values[name] = float(text)
        except ValueError as error:
            raise ParameterError(f"{name}: {text!r} is not a number") from error
    return values


@contextmanager
def drive_of(target: Target) -> Iterator[Device]:
    """open_drive(); at the end, after an error too, the drive's warnings are printed to stderr."""
    from kontur.drive.target import open_drive

    with open_drive(target) as device:
        try:
            with shown(device):
                yield device
        except (BusError, NoAnswerError):
            raise
        except BaseException:
            with suppress(KonturError):  # the first error is the one to report
                print_warnings(device.faults.warnings())
            raise
        print_warnings(device.faults.warnings())


@contextmanager
def progress_bars() -> Iterator[Callable[[str, float], None]]:
    """A bar on a terminal, nothing when piped; yields a function that takes the name of a step and its share done."""
    if not sys.stderr.isatty():
        yield lambda what, share: None
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description:<22}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console(stderr=True), transient=True) as progress:
        task = progress.add_task("", total=1.0)
        doing = ""

        def update(what: str, share: float) -> None:
            nonlocal doing
            if what != doing:
                doing = what
                progress.reset(task, description=what)
            progress.update(task, completed=share)

        yield update


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[float], None]]:
    """A progress bar of one step: the function takes the share alone."""
    with progress_bars() as update:
        yield lambda share: update(what, share)


@contextmanager
def held_by_signals(held: Panel) -> Iterator[None]:
    """SIGUSR1 requests feed hold by `held`, SIGUSR2 ends it."""

    def ask(number: int, _frame: FrameType | None) -> None:
        held.held = number == signal.SIGUSR1

    if not hasattr(signal, "SIGUSR1"):  # Windows
        yield
        return
    before = [(number, signal.signal(number, ask)) for number in (signal.SIGUSR1, signal.SIGUSR2)]
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)


class StopRequest:
    """Tells when it is called whether a signal, or a live page, has requested a stop. `exit_code`: of the program."""

    def __init__(self) -> None:
        self.signal = 0
        self._panel = panel()

    def __call__(self) -> bool:
        return self.signal != 0 or self._panel.stop

    @property
    def exit_code(self) -> int:
        return 128 + self.signal if self.signal else EXIT_INTERRUPTED


@contextmanager
def interruptible() -> Iterator[StopRequest]:
    """The first Ctrl-C, SIGTERM or SIGHUP (the terminal was closed) requests a stop, which the yielded object tells; a
    second Ctrl-C interrupts immediately. A signal that is ignored, as SIGHUP under nohup, stays so."""
    request = StopRequest()

    def request_stop(number: int, _frame: FrameType | None) -> None:
        request.signal = request.signal or number
        signal.signal(signal.SIGINT, signal.default_int_handler)

    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = [
        (number, signal.signal(number, request_stop))
        for number in numbers
        if signal.getsignal(number) is not signal.SIG_IGN
    ]
    try:
        yield request
    finally:
        for number, handler in before:
            signal.signal(number, handler)
