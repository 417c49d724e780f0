# SPDX-License-Identifier: Apache-2.0
"""The STM32F405 image in QEMU, the same ELF that a board gets, and the files made of it."""

import shutil
import signal
import struct
import subprocess
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from gdb import PC, SP, set_registers
from test_cli_sim import ended, kontur_sim

from kontur import machine as machines
from kontur.can.bus import open_bus
from kontur.drive.device import Device, connected
from kontur.drive.target import Target
from kontur.errors import SimulatorError
from kontur.path import shapes
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.runner import RunOptions, run
from kontur.sim.emulator import PROGRAM, Emulator, start

ROOT = Path(__file__).parents[2]
IMAGE = ROOT / "build/firmware/kontur.elf"
PORT = ROOT / "firmware/port/stm32f405"
STORE = range(0x08004000, 0x0800C000)
WATCHDOG_OR_CRASH = 0x6010
CRASH = 5
RESET_NODE = 129
PATIENCE_S = 120.0
NOWHERE = 0x60000000  # external memory, which is not there

pytestmark = [
    pytest.mark.skipif(not IMAGE.is_file(), reason=f"{IMAGE} is not there: make firmware"),
    pytest.mark.skipif(shutil.which(PROGRAM) is None, reason=f"{PROGRAM} is missing: apt-get install qemu-system-arm"),
]


@pytest.fixture
def emulator() -> Iterator[Emulator]:
    with start(IMAGE) as running:
        yield running


def talk(emulator: Emulator, what: Callable[[Device], object]) -> object:
    with connected(open_bus(emulator.options()), 1) as device:
        return what(device)


def test_image_boots_and_tells_version_build_and_numbers_over_slcan(emulator: Emulator) -> None:
    def ask(device: Device) -> None:
        info = device.info()
        assert (info.name, info.num, info.control_hz) == ("Kontur", "f32", 10000)
        assert device.read("software_version") not in ("", "0.0.0")
        assert device.read("build_id") == info.build != "unknown"
        assert info.state == ("switch on disabled", "switch on disabled")

    talk(emulator, ask)
    talk(emulator, ask)  # and again, for the next host


def test_kontur_info_works_on_the_image_as_on_a_drive(emulator: Emulator) -> None:
    channel = emulator.options()["channel"]
    command = [sys.executable, "-m", "kontur.cli", "info", "-i", "slcan", "-c", channel]
    result = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert result.returncode == 0, result.stderr
    assert "numbers f32, control 10000 Hz" in result.stdout


def test_kontur_sim_runs_the_image_whose_parameters_outlive_a_reset() -> None:
    options = ["--image", str(IMAGE), "--machine", str(machines.MACHINES / "ball_screw_on_chip.toml"), "--pace", "sync"]
    with kontur_sim(*options, "--untold") as (process, lines):
        assert lines[-2].endswith("is told only encoder lengths and soft limits of its machine.")
        channel = next(line.split()[5] for line in lines if line.strip().startswith("kontur info"))
        bus = open_bus({"interface": "slcan", "channel": channel})
        with connected(bus, 1) as device:
            device.link.send(0, bytes([RESET_NODE, 1]))
            assert device.link.wait_for_answer(lambda: device.link.node.nmt.state != "INITIALISING", PATIENCE_S)
            assert device.read("clock.pace") == 1
            assert device.read("onchip_axis_x.resonance") == pytest.approx(90.0)
            assert device.read("plant_x.encoder") == pytest.approx(0.07629)
            assert device.read("plant_x.mass") != 100.0
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 0
        assert ended(channel)


def test_file_that_is_no_image_is_named() -> None:
    words = r"objects\.toml does not run in QEMU: .*make firmware"
    with pytest.raises(SimulatorError, match=words), start(ROOT / "firmware/od/objects.toml"):
        pass


def test_healthy_image_starts_without_a_fault_and_its_time_passes(emulator: Emulator) -> None:
    def ask(device: Device) -> None:
        assert device.read("error_register") == 0
        assert device.read("crash.count") == 0
        first = device.read("clock.tick")
        device.link.wait(lambda: device.read("clock.tick") > first, PATIENCE_S)
        assert device.read("clock.tick") > first

    talk(emulator, ask)


def crashed(emulator: Emulator) -> None:
    """Until the image, started anew, has taken a crash down."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        try:
            if talk(emulator, lambda device: device.read("reset_cause")) == CRASH:
                return
        except Exception as error:  # it is just starting anew: the channel is closed, and nobody answers
            last = error
    raise AssertionError("no crash was taken down") from last


def test_hard_fault_resets_and_its_record_and_fault_are_reported(emulator: Emulator) -> None:
    set_registers(emulator.gdb_port, {PC: NOWHERE})
    crashed(emulator)

    def ask(device: Device) -> None:
        assert device.read("crash.pc") == NOWHERE
        assert device.read("crash.cfsr") != 0
        assert device.read("crash.hfsr") == 1 << 30  # escalated: DDI 0403E, HFSR.FORCED
        assert device.read("crash.count") == 1
        assert device.read("error_register") & 1
        assert device.read("error_code_x") == device.read("error_code_y") == WATCHDOG_OR_CRASH

    talk(emulator, ask)


def test_stack_overflow_is_a_crash_and_not_a_hang(emulator: Emulator) -> None:
    set_registers(emulator.gdb_port, {SP: 0x20000010})
    crashed(emulator)
    assert talk(emulator, lambda device: device.read("crash.pc")) == 0


def test_crashes_are_counted(emulator: Emulator) -> None:
    for count in (1, 2):
        set_registers(emulator.gdb_port, {PC: NOWHERE})
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            crashed(emulator)
            if talk(emulator, lambda device: device.read("crash.count")) == count:
                break
        else:
            raise AssertionError(f"crash {count} was not counted")


def test_time_passes_with_sync_alone_when_commanded_to(emulator: Emulator) -> None:
    talk(emulator, lambda device: device.write("pace_select", 1))

    def ask(device: Device) -> None:
        assert device.link.by_device_time
        before = device.read("clock.tick")
        for _ in range(100):
            device.link.poll(0.0)
        assert device.read("clock.tick") == before + 100
        assert device.read("clock.tick") == before + 100  # and stands

    talk(emulator, ask)


@pytest.mark.parametrize(
    ("name", "usart", "control_hz"),
    [
        ("kontur", 1, 10000),
        ("kontur-20khz", 1, 20000),
        ("kontur-feather", 3, 10000),
        ("kontur-feather-20khz", 3, 20000),
    ],
)
def test_circle_runs_on_the_simulated_machine_of_the_image(name: str, usart: int, control_hz: int) -> None:
    image = IMAGE.with_name(f"{name}.elf")
    if not image.is_file():
        pytest.skip(f"{image} is not there: make firmware")
    with start(image, usart) as emulator:
        assert talk(emulator, lambda device: device.info().control_hz) == control_hz
        assert_circle_runs(emulator, control_hz)


def assert_circle_runs(emulator: Emulator, control_hz: int) -> None:
    """Its references are those of the drive in the process, but for the control period that lies before a record."""
    talk(emulator, lambda device: device.write("pace_select", 1))
    machine = machines.load()
    there = machine.gains | {"onchip_plant.start_x": 0.004, "onchip_plant.simulated": 1}
    trajectory = plan(shapes.circle(0.004, 0.1), limits(machine))
    target = Target(machine, bus=emulator.options(), place_at_start=False)
    log = run(trajectory, "ccu", target, RunOptions(parameters=there)).log
    assert log.meta["frames_lost"] == 0
    assert np.abs(log.columns["contour_error_um"]).max() < 1.5
    in_process = run(trajectory, "ccu", Target(machine)).log
    assert len(log.columns["tick"]) == len(in_process.columns["tick"])
    later_mm = 100.0 * (1e-4 - 1.0 / control_hz)
    apart_mm = log.columns["reference_x_mm"] - in_process.columns["reference_x_mm"]
    assert np.abs(apart_mm).max() <= 1.001 * later_mm


def test_stored_parameters_are_in_force_after_a_crash(emulator: Emulator) -> None:
    def change(device: Device) -> None:
        device.write("smc.lambda", 150.5)
        device.link.node.sdo.download(0x1010, 1, b"save")

    talk(emulator, change)
    set_registers(emulator.gdb_port, {PC: NOWHERE})
    crashed(emulator)
    assert talk(emulator, lambda device: device.read("smc.lambda")) == 150.5


def parts_of(dfu: bytes) -> dict[int, bytes]:
    """Address and contents of the elements of a DfuSe file (UM0391)."""
    assert dfu[:6] == b"DfuSe\1"
    assert struct.unpack("<I", dfu[6:10])[0] == len(dfu) - 16
    (count,) = struct.unpack("<I", dfu[11 + 270 : 11 + 274])
    parts, at = {}, 11 + 274
    for _ in range(count):
        address, size = struct.unpack("<II", dfu[at : at + 8])
        parts[address] = dfu[at + 8 : at + 8 + size]
        at += 8 + size
    assert at == len(dfu) - 16
    return parts


def test_dfu_file_leaves_the_parameters_alone_and_is_the_image() -> None:
    dfu = IMAGE.with_suffix(".dfu").read_bytes()
    binary = IMAGE.with_suffix(".bin").read_bytes()
    assert struct.unpack("<HHHH3sB", dfu[-16:-4]) == (0xFFFF, 0xDF11, 0x0483, 0x011A, b"UFD", 16)
    assert struct.unpack("<I", dfu[-4:])[0] == zlib.crc32(dfu[:-4]) ^ 0xFFFFFFFF
    parts = parts_of(dfu)
    assert set(parts) == {0x08000000, 0x08010000}
    for address, data in parts.items():
        assert not set(range(address, address + len(data))) & set(STORE)
        assert binary[address - 0x08000000 :][: len(data)] == data
    assert sum(map(len, parts.values())) <= 0.85 * (1024 - 48) * 1024


def check(source: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """check_image.py on a program of one file."""
    (folder / "a.c").write_text(source)
    compiler = [
        "arm-none-eabi-gcc",
        "-mcpu=cortex-m4",
        "-mthumb",
        "-mfpu=fpv4-sp-d16",
        "-mfloat-abi=hard",
        "-nostartfiles",
    ]
    script = [f"-Wl,-T,{folder / 'a.ld'}", f"-Wl,-Map={folder / 'a.map'}", "--specs=nano.specs", "--specs=nosys.specs"]
    (folder / "a.ld").write_text(
        "SECTIONS { .text 0x08000000 : { *(.text* .rodata*) }"
        " .data 0x20000000 : { *(.data*) } .bss : { *(.bss*) } end = .; }"
    )
    elf = folder / "a.elf"
    subprocess.run(
        [*compiler, *script, "-Wl,-e,run", str(folder / "a.c"), "-o", str(elf), "-lm"],
        check=True,
        stderr=subprocess.DEVNULL,
    )
    command = [sys.executable, str(PORT / "check_image.py"), str(elf), "--map", str(folder / "a.map")]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("source", "finding"),
    [
        ("double run(double x, double y) { return x * y; }", "double-precision helper"),
        ("double run(float x) { return x; }", "double-precision helper"),
        ("#include <stdlib.h>\nvoid *run(unsigned x) { return malloc(x); }", "heap"),
        ("#include <stdio.h>\nvoid run(int x) { printf(\"%d\", x); }", "printf"),
        ("#include <math.h>\nfloat run(float x) { return sinf(x); }", "libm"),
        ("int run(int x) { static char much[112000]; return much[x]++; }", "RAM"),
        ("int run(int x) { static const char much[850000] = {1}; return much[x]; }", "flash"),
    ],
)  # fmt: skip
def test_what_must_not_be_in_an_image_is_found(source: str, finding: str, tmp_path: Path) -> None:
    result = check(source, tmp_path)
    assert result.returncode == 1
    assert finding in result.stdout


def test_an_image_without_any_of_it_passes(tmp_path: Path) -> None:
    result = check("float run(float x) { return x * 3.0f; }", tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
