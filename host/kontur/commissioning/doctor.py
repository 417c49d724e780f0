# SPDX-License-Identifier: Apache-2.0
"""What a drive says of itself, its bus and its machine, and what of it is wrong: `kontur doctor`. Nothing moves.

It only reads: no axis gets power, the drive is not claimed, and no parameter changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import version as version_of
from typing import Any

from canopen.sdo import SdoAbortedError

from kontur.can.emcy import describe_emcy, faults
from kontur.can.link import DROPPED
from kontur.drive.axes import AXES
from kontur.drive.device import Device
from kontur.drive.pdos import COMMANDS, TELEMETRY
from kontur.errors import DeviceError, NoAnswerError

OK, WARNING, ERROR = "ok", "warning", "error"

_ABORTS_OF_ABSENT = (0x06020000, 0x06090011)  # CiA 301, table 22: no such object, no such sub-index
_CAN_STATES = ("error active", "error warning", "error passive", "off")
_RESETS = {4: "a watchdog", 5: "a crash of the firmware", 6: "a supply that was too low"}  # 2031h
_SUPPLY = (0x5110, 0x5200)  # EMCY codes: supply of the processor, crystal
_LOWER, _UPPER, _AMPLIFIER, _ENCODER, _STOP = 1, 2, 1 << 16, 1 << 17, 1 << 18  # bits of 60FDh
_CORE_HZ = 168e6  # of the STM32F405
_TICK_SHARE = 2.0 / 3.0  # of a period; the background needs the rest (docs/hardware.md)
_EDGES_PER_S = 10e6  # that a line receiver passes (docs/hardware.md)
_COUNTER = 2**31
_SLOW_S = 0.02  # an answer to an SDO; a serial adapter with a long latency takes 16 ms and more
_LOOKS, _LOOK_S = 25, 0.01
_CREEP_COUNTS, _CREEP_M = 40, 5e-6  # an axis at rest moves by less than the greater one
_FLASH_SHARE = 0.8


@dataclass(frozen=True)
class Finding:
    """What was looked at, how it is (OK, WARNING, ERROR), and what to do about it ("" where it is OK)."""

    check: str
    level: str
    text: str
    remedy: str = ""


def findings(device: Device) -> Iterator[Finding]:
    """All that the drive can be asked. Raises NoAnswerError where it stops to answer."""
    values: dict[str, Any] = {}
    yield from _firmware(device)
    yield from _dictionary(device, values)
    yield from _can(device)
    yield from _pdos(device)
    yield from _master(device)
    yield from _supply(device)
    yield from _faults(device)
    for axis in AXES:
        yield from _inputs(device, axis)
        yield from _wiring(axis, values)
        yield from _encoder(device, axis, values)
        yield from _limits(device, axis, values)
    yield from _at_rest(device, values)
    yield from _tick(device)
    yield from _flash(device)


# --- who it is --------------------------------------------------------------------------------------------------------
def _firmware(device: Device) -> Iterator[Finding]:
    version, build = str(device.read("software_version")), str(device.read("build_id"))
    what = (
        f"{device.read('device_name')} {version}, build {build}, numbers {device.read('num_backend')}, control at "
        f"{device.read('clock.control_hz')} Hz"
    )
    if version != (tools := version_of("kontur")):
        yield Finding(
            "firmware",
            WARNING,
            f"{what}; these tools are of version {tools}",
            "install the tools of the firmware's version, or flash the firmware of theirs",
        )
    else:
        yield Finding("firmware", OK, what)


def _dictionary(device: Device, values: dict[str, Any]) -> Iterator[Finding]:
    """Read all parameters into `values`, and see whether they are those of the EDS."""
    missing, outside = [], []
    for name, declared in device.declared.items():
        try:
            value = values[name] = device.read(name)
        except DeviceError as error:
            if isinstance(error.__cause__, SdoAbortedError) and error.__cause__.code in _ABORTS_OF_ABSENT:
                missing.append(name)
                continue
            raise
        if value < declared.least or value > declared.greatest:
            outside.append(name)
    revision, of_eds = int(device.read("identity.revision")), int(device.default("identity.revision"))
    if missing or outside or revision != of_eds:
        parts = [f"revision {revision:X}h, not {of_eds:X}h"] if revision != of_eds else []
        parts += [f"{len(missing)} parameters are missing, such as {missing[0]}"] if missing else []
        parts += [f"{len(outside)} have values that these tools do not know, such as {outside[0]}"] if outside else []
        yield Finding(
            "dictionary",
            ERROR,
            f"the object dictionary is not that of these tools: {'; '.join(parts)}",
            "firmware and tools must be of one version: flash the firmware again, or install its tools",
        )
    else:
        yield Finding("dictionary", OK, f"revision {revision:X}h, {len(values)} parameters, as these tools know them")


# --- the bus ----------------------------------------------------------------------------------------------------------
def _can(device: Device) -> Iterator[Finding]:
    state = int(device.read("can.state"))
    sent, received, lost, offs = (
        int(device.read(f"can.{n}")) for n in ("tx_errors", "rx_errors", "rx_lost", "bus_offs")
    )
    text = (
        f"the drive's CAN controller is {_CAN_STATES[state]}; error counters {sent} (sent) and {received} (received), "
        f"{lost} frames lost and {offs} times off the bus since power-on"
    )
    wires = "check termination (120 ohm at both ends), cable, ground and that all nodes have one bit rate"
    if state >= 2:
        yield Finding("bus errors", ERROR, text, wires)
    elif state or sent or received or lost or offs:
        yield Finding("bus errors", WARNING, text, wires)
    else:
        yield Finding("bus errors", OK, text)
    dropped = {reason: n for reason, n in device.link.dropped.items() if n and reason in DROPPED}
    if dropped:
        yield Finding(
            "frames",
            WARNING,
            f"frames that this program cannot use came in: {', '.join(f'{k} {n}' for k, n in dropped.items())}",
            "look at the bus with candump: other nodes, wrong bit rate, or a cable that picks up noise",
        )
    slow_s = device.link.round_trip_s
    if slow_s > _SLOW_S:
        yield Finding(
            "answers",
            WARNING,
            f"the drive answers in {slow_s * 1e3:.0f} ms; a stream of knots needs less than 20 ms",
            "lower the latency of the adapter (FTDI: latency_timer to 1), and leave the computer some processor time",
        )
    else:
        yield Finding("answers", OK, f"the drive answers in {slow_s * 1e3:.1f} ms")


def _pdos(device: Device) -> Iterator[Finding]:
    try:
        device.pdos.check(*COMMANDS, *TELEMETRY)
    except NoAnswerError:
        raise
    except DeviceError as error:
        yield Finding(
            "PDO mappings",
            ERROR,
            str(error).partition(" Another master")[0],
            "another master has changed them: --set-pdos sets them until the drive is reset",
        )
        return
    yield Finding("PDO mappings", OK, "as these tools need them")


def _master(device: Device) -> Iterator[Finding]:
    holder = int(device.read("master.holder"))
    if holder:
        yield Finding(
            "master",
            WARNING,
            f"node {holder} holds the drive: another program commands it",
            "stop that program before you move anything from here",
        )
    else:
        yield Finding("master", OK, "nobody holds the drive")


# --- the drive --------------------------------------------------------------------------------------------------------
def _supply(device: Device) -> Iterator[Finding]:
    cause, up_s = int(device.read("reset_cause")), int(device.read("clock.tick")) * 1e-3
    bad = [code for code in device.faults.errors() if code in _SUPPLY]
    if bad:
        yield Finding(
            "supply",
            ERROR,
            "; ".join(f"{code:04X}h: {faults()[code].fault}" for code in bad),
            "; ".join(faults()[code].remedy for code in bad),
        )
    elif cause in _RESETS:
        yield Finding(
            "supply",
            WARNING,
            f"the drive has restarted {up_s:.0f} s ago after {_RESETS[cause]}",
            "measure its 3.3 V with a scope while the amplifiers switch on; after a crash see object 2030h",
        )
    else:
        yield Finding(
            "supply",
            OK,
            f"the processor's supply and clock are good, for {up_s:.0f} s; the voltage of the "
            "amplifiers is not measured by the drive",
        )


def _faults(device: Device) -> Iterator[Finding]:
    codes = [code for code in device.faults.errors() if code not in _SUPPLY]
    known = faults()
    for code in codes:
        fault = known.get(code)
        text = f"{code:04X}h: {fault.fault}. Cause: {fault.cause}" if fault else describe_emcy(code)
        yield Finding(
            "faults",
            WARNING if fault and fault.warns else ERROR,
            text,
            fault.remedy if fault else "see docs/faults.md of the firmware's version",
        )
    if not codes:
        yield Finding("faults", OK, "none in effect")


def _inputs(device: Device, axis: str) -> Iterator[Finding]:
    check = f"inputs {axis}"
    inputs = int(device.read(f"digital_inputs_{axis}"))
    good = not inputs & (_LOWER | _UPPER | _AMPLIFIER | _ENCODER | _STOP)
    if inputs & _LOWER and inputs & _UPPER:
        yield Finding(
            check,
            ERROR,
            "both limit switches are active, which no position of the axis does",
            "check cable and connector of the switches: an open contact, or a broken wire, is active",
        )
    elif inputs & (_LOWER | _UPPER):
        end = "lower" if inputs & _LOWER else "upper"
        yield Finding(
            check,
            WARNING,
            f"the {end} limit switch is active",
            f"push the axis off its {end} end; if it stays active, the wire of the switch is broken",
        )
    for bit, what, remedy in (
        (
            _AMPLIFIER,
            "the amplifier reports a fault",
            "switch the amplifier on and read its display; an open wire is a "
            f"fault, too; an amplifier that is ready only while it is live needs wiring_{axis}.ready=1",
        ),
        (_ENCODER, "the encoder reports a fault", "check the encoder's cable and supply"),
        (
            _STOP,
            "the stop input is active: nothing can be enabled",
            "release the emergency stop; an open wire is a stop, too",
        ),
    ):
        if inputs & bit:
            yield Finding(check, ERROR, what, remedy)
    if good:
        yield Finding(check, OK, "no limit switch, no stop, amplifier and encoder report no fault")


def _wiring(axis: str, values: Mapping[str, Any]) -> Iterator[Finding]:
    check = f"wiring {axis}"
    limit_N, scale_N = values[f"plant_{axis}.force_limit"], values[f"wiring_{axis}.full_scale"]
    inverted = [f"invert_{what}" for what in ("force", "encoder") if values[f"wiring_{axis}.invert_{what}"]]
    output = ("analog, 12 bits", "PWM", "analog by a serial DAC")[int(values[f"wiring_{axis}.output"])]
    text = f"{output}, {scale_N:g} N at full command, force limit {limit_N:g} N" + "".join(f", {n}" for n in inverted)
    if values["onchip_plant.simulated"] and axis == "x":
        yield Finding(
            "wiring",
            WARNING,
            "the drive simulates its machine: its outputs are off and no input is read",
            "for a real machine: kontur param set onchip_plant.simulated=0, then kontur param save",
        )
    if limit_N > scale_N:
        yield Finding(
            check,
            WARNING,
            f"{text}: the command ends before the force limit",
            f"set wiring_{axis}.full_scale to the force at full command (current at 10 V times the force "
            f"constant), or plant_{axis}.force_limit to at most that",
        )
    else:
        yield Finding(check, OK, text)


def _encoder(device: Device, axis: str, values: Mapping[str, Any]) -> Iterator[Finding]:
    check = f"encoder {axis}"
    count_m = values[f"plant_{axis}.encoder"] * 1e-6
    per_s = values["limits.velocity"] / count_m
    low_m, high_m = (values[f"position_limit_{axis}.{end}"] * 1e-9 for end in ("min", "max"))
    index = values[f"wiring_{axis}.index_counts"]
    text = f"{count_m * 1e9:g} nm a count, {per_s / 1e6:.2g} million counts a second at limits.velocity"
    length = f"set plant_{axis}.encoder: travel of a turn over four times the lines of a turn"
    if (high_m - low_m) / count_m >= _COUNTER:
        yield Finding(check, ERROR, f"{text}: the soft limits are further apart than the counter counts", length)
    elif per_s > _EDGES_PER_S:
        yield Finding(
            check, WARNING, f"{text}: more than a line receiver passes", f"{length}, or lower limits.velocity"
        )
    elif count_m == device.declared[f"plant_{axis}.encoder"].default * 1e-6:
        yield Finding(
            check,
            WARNING,
            f"{text}: the length is that from the factory",
            f"if it is not that of your encoder, {length}",
        )
    else:
        yield Finding(check, OK, text)
    if index:
        yield Finding(f"index {axis}", OK, f"checked each {index:g} counts, {index * count_m * 1e3:.4g} mm")
    second_m = values[f"second_encoder_{axis}.length"] * 1e-6
    if second_m:
        yield Finding(f"second encoder {axis}", OK, f"{second_m * 1e9:g} nm a count")


def _limits(device: Device, axis: str, values: Mapping[str, Any]) -> Iterator[Finding]:
    low_m, high_m = (values[f"position_limit_{axis}.{end}"] * 1e-9 for end in ("min", "max"))
    at_m = int(device.read(f"position_actual_{axis}")) * 1e-9
    text = f"at {at_m * 1e3:.3f} mm, soft limits {low_m * 1e3:g} and {high_m * 1e3:g} mm"
    if not low_m <= at_m <= high_m:
        yield Finding(
            f"position {axis}",
            ERROR,
            f"{text}: the axis stands outside",
            f"home the axis (kontur home {axis}), or set position_limit_{axis}",
        )
    else:
        yield Finding(f"position {axis}", OK, text)


def _at_rest(device: Device, values: Mapping[str, Any]) -> Iterator[Finding]:
    """Both encoders for a quarter of a second, while the axes have no power."""
    if any(int(device.read(f"statusword_{axis}")) & 0x6F in (0x27, 0x07) for axis in AXES):
        yield Finding("at rest", OK, "not looked at: the axes have power")
        return
    seen: dict[str, list[int]] = {axis: [] for axis in AXES}
    for _ in range(_LOOKS):
        for axis in AXES:
            seen[axis].append(int(device.read(f"position_actual_{axis}")))
        device.link.wait(lambda: False, _LOOK_S)
    for axis, at_nm in seen.items():
        count_m = values[f"plant_{axis}.encoder"] * 1e-6
        moved_m = (max(at_nm) - min(at_nm)) * 1e-9
        text = f"without power the encoder counts {moved_m / count_m:.0f} counts ({moved_m * 1e6:.3g} µm) to and fro"
        if moved_m > max(_CREEP_COUNTS * count_m, _CREEP_M):
            yield Finding(
                f"at rest {axis}",
                ERROR,
                f"{text}: the axis moves, or its encoder picks up noise",
                "let the axis come to rest and hold it; then check the shield and the line receiver",
            )
        else:
            yield Finding(f"at rest {axis}", OK, text)


def _tick(device: Device) -> Iterator[Finding]:
    worst, hz = int(device.read("tick_cycles.worst")), int(device.read("clock.control_hz"))
    if not worst:
        yield Finding("load of the tick", OK, "not counted here (a simulator counts no cycles)")
        return
    share = worst * hz / _CORE_HZ
    text = f"the longest servo tick took {worst} cycles, {share:.0%} of a period"
    if share > _TICK_SHARE:
        yield Finding(
            "load of the tick",
            ERROR if share > 1.0 else WARNING,
            text,
            "use the image with 10 kHz, or switch compensations off; the background needs a third",
        )
    else:
        yield Finding("load of the tick", OK, text)


def _flash(device: Device) -> Iterator[Finding]:
    erased, bears = int(device.read("flash_wear.erases")), int(device.read("flash_wear.endurance"))
    text = f"{erased} of {bears} erasures"
    if erased >= _FLASH_SHARE * bears:
        yield Finding("flash", WARNING, text, "store parameters less often, and plan to replace the controller board")
    else:
        yield Finding("flash", OK, text)
