# SPDX-License-Identifier: Apache-2.0
"""Opens a bus by python-can's options. A simulated drive is a python-can plugin like any other interface.

Everyone who talks to a drive comes through `open_bus`; nothing here imports a simulator.
"""

from __future__ import annotations

import configparser
import errno
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import can
import can.util

from kontur.errors import BusError, FileError, KonturError

_READY_AT_ONCE = ("socket://", "/dev/pts/")
_OF_KONTUR = ("kontur", "kontur-bad-bus")
"""Interfaces that python-can's configuration says nothing about."""
_SECTION, _CONFIG = "default", "CAN_CONFIG"
_IN_USE = (errno.EBUSY, errno.EAGAIN)


def open_bus(options: Mapping[str, Any]) -> can.BusABC:
    """Open a bus by python-can's options; what they leave open is python-can's configuration.

    Its `channel_info` names it in messages and logs. Raises BusError; FileError for a configuration that cannot be
    read; of the simulated drive, the reason why it does not start.
    """
    ours = options.get("interface") in _OF_KONTUR
    options = dict(options) if ours else {**configured(), **options}
    interface = options.get("interface", "?")
    named = f"{interface} {options.get('channel', '(no channel)')}"
    if interface == "slcan":
        ready = str(options.get("channel")).startswith(_READY_AT_ONCE)
        # python-can waits for adapters that start when they are opened
        options = {**({"sleep_after_open": 0} if ready else {}), **options, "interface": "kontur-slcan"}
    try:
        bus = can.Bus(ignore_config=ours, **options)
    except Exception as error:  # python-can's interfaces are drivers of many makers, which raise what they like
        if isinstance(error, KonturError):
            raise
        if isinstance(error.__cause__, KonturError):
            raise error.__cause__ from error
        why = "it needs a channel" if isinstance(error, TypeError) and "channel" not in options else error
        raise BusError(f"bus {named} cannot be opened: {why}. {_remedy(error, options)}") from error
    if bus.channel_info == can.BusABC.channel_info:  # python-can's slcan and some others leave it "unknown"
        bus.channel_info = named
    return bus


def configured() -> dict[str, Any]:
    """python-can's options from its configuration: files (can.conf), environment (CAN_...) and `can.rc`.

    Raises FileError, or BusError for the environment, when it cannot be read.
    """
    options: dict[str, Any] = {}
    for file in _files():
        parser = _parsed(file)
        try:
            options |= dict(parser.items(_SECTION)) if parser.has_section(_SECTION) else {}
        except configparser.InterpolationError as error:
            raise FileError(file, f"{_one_line(error)}; write %% for a percent sign") from error
    try:
        return options | can.util.load_environment_config() | can.rc
    except (ValueError, TypeError, RecursionError) as error:
        why = "it is no object" if isinstance(error, TypeError) else _one_line(error)
        raise BusError(
            f'environment variable {_CONFIG}: not JSON as {{"interface": "socketcan", "channel": "can0"}}: {why}'
        ) from error


def configured_interface() -> str | None:
    """The interface that python-can's configuration names; None where nothing is configured.

    Raises FileError, BusError when it cannot be read, or names none: then a bus is meant, and which one is not known.
    """
    options = configured()
    if interface := options.get("interface"):
        return str(interface)
    otherwise = "name one there or with -i, or simulate the drive with -i kontur"
    for file in _files():
        parser = _parsed(file)
        if not parser.has_section(_SECTION) and (parser.sections() or parser.defaults()):
            raise FileError(file, f"has no section [{_SECTION}], so no interface is known; {otherwise}")
    if not options:
        return None
    if "bustype" in options:
        otherwise = f'"bustype" is its old name there: rename it to "interface" (bustype = {options["bustype"]})'
    where = [str(file) for file in _files()] + sorted(name for name in os.environ if name.startswith("CAN_"))
    raise BusError(
        f"python-can's configuration ({', '.join(where) or 'can.rc'}) has {', '.join(sorted(options))}, but no "
        f"interface; {otherwise}"
    )


def _files() -> list[Path]:
    files = [Path(os.path.expanduser(name)) for name in can.util.CONFIG_FILES]
    return [file for file in files if file.is_file()]


def _parsed(file: Path) -> configparser.ConfigParser:
    """The file as python-can reads it, but with a message for what is wrong with it."""
    parser = configparser.ConfigParser()
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    try:
        parser.read_string(file.read_text(encoding="utf-8"), source=str(file))
    except (OSError, UnicodeDecodeError, configparser.Error) as error:
        raise FileError(
            file,
            f"{_one_line(error)}; python-can's configuration is a section [{_SECTION}] with one line a key, as in "
            '"interface = socketcan"',
        ) from error
    return parser


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())


def _remedy(error: Exception, options: Mapping[str, Any]) -> str:
    """What to do about it."""
    cause = error.__cause__ or error
    number = getattr(cause, "errno", None)
    if number in _IN_USE:
        return f"Another program uses it: stop that program; `fuser -v {options.get('channel', '')}` shows which it is"
    if number == errno.EACCES:
        return f"Your user may not use it: `ls -l {options.get('channel', '')}` shows the group that may"
    return (
        "Check -i, -c and -b (python-can's interface, channel, bitrate), or leave them out to use the simulated drive"
    )
