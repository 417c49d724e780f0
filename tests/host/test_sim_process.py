# SPDX-License-Identifier: Apache-2.0
"""The simulated drive as a process (kontur-sim): buses, signals, clients that go, messages that say what to do."""

import contextlib
import dataclasses
import os
import re
import shutil
import signal
import socket
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pytest

from kontur import machine as machines
from kontur.can import link, wire
from kontur.can.bus import open_bus
from kontur.drive import pdos
from kontur.drive.device import Device, connected
from kontur.drive.stream import Operator, stream
from kontur.drive.target import Target, tell
from kontur.errors import DeviceError, LibraryError, NoAnswerError, SimulatorError
from kontur.machine import Machine
from kontur.path import shapes
from kontur.path.geometry import Line, Move, Program
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs import log
from kontur.runs.runner import RunOptions, run
from kontur.sim import process as sim_process
from kontur.sim.library import Sim
from kontur.sim.process import PROGRAM, SimProcess, plain_machine, start

TIMEOUT_S = 60.0
FAULT = 1 << 3


@pytest.fixture
def machine() -> Machine:
    return machines.load()


@pytest.fixture
def sim() -> Iterator[SimProcess]:
    with start(slcan_tcp="0") as process:
        yield process


def kontur_sim(*arguments: str, machine: str | None = None) -> subprocess.CompletedProcess[str]:
    """Run the program itself, to its end."""
    text = plain_machine(machines.load()) if machine is None else machine
    return subprocess.run(
        [PROGRAM, *arguments], input=text, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )


def refused(*arguments: str, machine: str | None = None) -> str:
    result = kontur_sim("--machine", "-", "--slcan-tcp", "0", *arguments, machine=machine)
    assert result.returncode == 1
    assert result.stdout == ""
    return result.stderr


def port_of(sim: SimProcess) -> int:
    return int(sim.channel.rpartition(":")[2])


def talk(sim: SimProcess) -> Device:
    with connected(open_bus(sim.options()), 1) as device:
        assert device.info().state == ("switch on disabled", "switch on disabled")
    return device


def test_drive_answers_over_tcp_and_again_after_a_disconnect(sim: SimProcess) -> None:
    for _ in range(3):
        talk(sim)


def test_drive_answers_on_a_pseudo_terminal_and_again_after_it_was_closed() -> None:
    with start(slcan_pty=True) as sim:
        assert Path(sim.channel).is_char_device()
        for _ in range(2):
            talk(sim)


def test_node_seed_back_end_and_machine_arrive(machine: Machine) -> None:
    # noise moves an axis without power, by as much as the test is late
    quiet = dataclasses.replace(
        machine,
        x=dataclasses.replace(machine.x, force_noise_N=0.0),
        y=dataclasses.replace(machine.y, force_noise_N=0.0),
    )
    with (
        start(slcan_tcp="0", node_id=7, num="fix", machine=quiet.starting_at((0.01, -0.02))) as sim,
        connected(open_bus(sim.options()), 7) as device,
    ):
        assert device.info().num == "fix"
        assert device.position_m() == pytest.approx((0.01, -0.02), abs=1e-7)


def test_plain_machine_is_read_back_to_the_last_bit(machine: Machine, tmp_path: Path) -> None:
    """Process and library, given the same machine and seed, do the same thing."""
    with start(slcan_tcp="0", machine=machine, seed=5, record=tmp_path / "truth") as process:
        talk(process)
    truth = sim_process.read_record(tmp_path / "truth")
    in_process = Sim(machine, 5)
    in_process.record(True)
    in_process.run(len(truth.pos_m))
    assert len(truth.pos_m) > 100
    np.testing.assert_array_equal(truth.pos_m, in_process.truth().pos_m)
    in_process.close()


def test_what_is_stored_is_there_at_the_next_power_on(tmp_path: Path) -> None:
    store = tmp_path / "flash"
    with start(slcan_tcp="0", store=store) as sim, connected(open_bus(sim.options()), 1) as device:
        device.write("smc.lambda", 150.0)
        device.link.node.sdo.download(0x1010, 1, b"save")
        device.write("smc.lambda", 170.0)
    with start(slcan_tcp="0", store=store) as sim, connected(open_bus(sim.options()), 1) as device:
        assert device.read("smc.lambda") == 150.0
    with start(slcan_tcp="0") as sim, connected(open_bus(sim.options()), 1) as device:
        assert device.read("smc.lambda") == 22.0


def test_store_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "flash").write_bytes(b"something else")
    assert "holds no store" in refused("--store", str(tmp_path / "flash"))
    assert "remove this one" in refused("--store", str(tmp_path))


def test_store_is_on_the_disk_when_the_drive_says_that_it_is_saved(tmp_path: Path) -> None:
    """After SIGKILL, and after a loss of power since the file has been synchronised."""
    store = tmp_path / "flash"
    with start(slcan_tcp="0", store=store) as sim, connected(open_bus(sim.options()), 1) as device:
        device.write("smc.lambda", 150.0)
        device.link.node.sdo.download(0x1010, 1, b"save")
        kept = store.read_bytes()
    with start(slcan_tcp="0", store=store) as sim, connected(open_bus(sim.options()), 1) as device:
        assert device.read("smc.lambda") == 150.0
        device.write("smc.lambda", 160.0)
        device.link.node.sdo.download(0x1010, 1, b"save")
        assert store.read_bytes() != kept
    assert [path.name for path in tmp_path.iterdir()] == ["flash"]


@contextlib.contextmanager
def system_calls(sim: SimProcess, tmp_path: Path) -> Iterator[None]:
    """strace writes the system calls of the process to the file "calls", until the process ends or something fails."""
    if shutil.which("strace") is None:
        assert "CI" not in os.environ, "strace is missing"
        pytest.skip("strace is not installed: apt-get install strace")
    command = ["strace", "-qq", "-y", "-o", tmp_path / "calls", "-p", str(sim.process.pid)]
    with subprocess.Popen(command, stderr=subprocess.PIPE) as tracer:
        try:
            end_s = time.monotonic() + TIMEOUT_S
            while not (tmp_path / "calls").exists() or not (tmp_path / "calls").stat().st_size:
                assert tracer.poll() is None, "strace does not start"
                assert time.monotonic() < end_s, "strace does not start"
                time.sleep(0.01)
            yield
            tracer.wait(TIMEOUT_S)
        finally:
            tracer.terminate()


def test_saved_is_answered_after_file_and_folder_are_synchronised(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with (
        start(slcan_tcp="0", store=tmp_path / "folder" / "flash") as sim,
        connected(open_bus(sim.options()), 1) as device,
        system_calls(sim, tmp_path),
    ):
        device.parameters.save()
        sim.process.terminate()
        sim.process.wait(TIMEOUT_S)
    lines = (tmp_path / "calls").read_text().splitlines()
    steps = [
        re.compile(pattern)
        for pattern in (r"fsync\(\d+<\S*\.part>", r"^rename\(", r"fsync\(\d+<\S*/folder>", r"\bt5818(60|20)101003")
    ]
    at = [max(i for i, line in enumerate(lines) if step.search(line)) for step in steps]
    assert at == sorted(at), [lines[i] for i in at]


def test_store_that_cannot_be_written_is_reported_at_the_start(tmp_path: Path) -> None:
    assert "--store /dev/full: " in refused("--store", "/dev/full")
    assert "--store /proc/flash cannot be written" in refused("--store", "/proc/flash")
    assert Path("/dev/full").is_char_device()


def test_drive_refuses_to_save_while_the_store_cannot_be_written_and_goes_on(tmp_path: Path) -> None:
    """The disk is full, or here: the folder is gone."""
    (tmp_path / "folder").mkdir()
    store = tmp_path / "folder" / "flash"
    with start(slcan_tcp="0", store=store) as sim:
        with connected(open_bus(sim.options()), 1) as device:
            device.write("smc.lambda", 150.0)
            kept = store.read_bytes()
            store.unlink()
            store.parent.rmdir()
            for _ in range(2):
                with pytest.raises(DeviceError, match="its flash reports an error"):
                    device.parameters.save()
            device.link.node.nmt.send_command(129)
            device.link.wait(lambda: False, 0.5)
            assert device.read("smc.lambda") == 22.0
            device.write("smc.lambda", 150.0)
            store.parent.mkdir()
            device.parameters.save()
            assert store.read_bytes() != kept
        assert f"--store {store} cannot be written: No such file" in sim.messages()
    with start(slcan_tcp="0", store=store) as sim, connected(open_bus(sim.options()), 1) as device:
        assert device.read("smc.lambda") == 150.0


@pytest.mark.parametrize("option", ["store", "record"])
def test_files_of_the_process_are_written_beside_and_links_are_kept(tmp_path: Path, option: str) -> None:
    (tmp_path / "victim").write_bytes(b"mine")
    (tmp_path / "file.part").symlink_to("victim")
    (tmp_path / "target").write_bytes(b"")
    (tmp_path / "target").chmod(0o600)
    (tmp_path / "file").symlink_to("target")
    with start(slcan_tcp="0", pace="sync", **{option: tmp_path / "file"}) as sim:  # type: ignore[arg-type]
        talk(sim)
    assert (tmp_path / "file").is_symlink()
    assert (tmp_path / "target").stat().st_size > 0
    assert stat.S_IMODE((tmp_path / "target").stat().st_mode) == 0o600
    assert (tmp_path / "victim").read_bytes() == b"mine"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "file.part", "target", "victim"]


def test_new_file_of_the_process_has_the_mode_of_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        with start(slcan_tcp="0", pace="sync", store=tmp_path / "flash"):
            pass
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "flash").stat().st_mode) == 0o640


def test_record_into_a_device_leaves_the_device() -> None:
    with start(slcan_tcp="0", pace="sync", record=Path("/dev/null")):
        pass
    assert Path("/dev/null").is_char_device()
    with (
        pytest.raises(SimulatorError, match="--record /dev/full cannot be written: No space"),
        start(slcan_tcp="0", pace="sync", record=Path("/dev/full")) as sim,
    ):
        talk(sim)


def test_pipe_as_store_is_refused_and_does_not_hang(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    assert "name another file" in refused("--store", str(tmp_path / "pipe"))


def test_control_characters_of_a_name_are_shown_and_not_sent_to_the_terminal() -> None:
    assert "--num \\x1b[31mf32\\x07\\x9b\u00b5: there" in refused("--num", "\x1b[31mf32\x07\x9b\u00b5")


def test_time_that_the_machine_did_not_give_is_lost_and_said_once(sim: SimProcess) -> None:
    with connected(open_bus(sim.options()), 1) as device:
        for _ in range(2):
            before = device.read("clock.tick")
            sim.process.send_signal(signal.SIGSTOP)
            time.sleep(0.4)  # the stall itself
            sim.process.send_signal(signal.SIGCONT)
            assert device.link.wait(lambda before=before: device.read("clock.tick") > before + 200, TIMEOUT_S)  # type: ignore[misc]
    assert sim.messages().count("does not keep up with the wall clock") == 1


def test_time_follows_the_wall_clock_and_is_never_ahead() -> None:
    """Counted from before power-on: a process that was kept from running makes up for that, so the time between two
    reads may be longer than the wall clock's."""
    begin_s = time.monotonic()
    with start(slcan_tcp="0") as sim, connected(open_bus(sim.options()), 1) as device:
        now_ms = begin_ms = device.read("clock.tick")
        while now_ms < begin_ms + 1000 and time.monotonic() < begin_s + TIMEOUT_S:
            now_ms = device.read("clock.tick")
            assert now_ms <= (time.monotonic() - begin_s) * 1e3
        assert now_ms >= begin_ms + 1000


def test_short_path_by_the_wall_clock(sim: SimProcess, machine: Machine) -> None:
    """All knots fit the queue: however little this machine lets the host run, none is missing."""
    there = Program("line", (Move(Line((0.0, 0.0), (0.004, 0.002)), 0.02),), (0.0, 0.0))
    with connected(open_bus(sim.options()), 1) as device:
        device.link.node.sdo[0x1016][1].raw = (
            wire.HOST_NODE_ID << 16 | 60_000
        )  # ms that a busy machine may be silent for
        with device.axes.enabled():
            assert stream(device, plan(there, limits(machine)).knots_nm).completed


@pytest.fixture
def by_sync() -> Iterator[SimProcess]:
    with start(slcan_tcp="0", pace="sync") as process:
        yield process


def test_time_stands_still_without_sync_and_sdos_take_none(by_sync: SimProcess) -> None:
    with connected(open_bus(by_sync.options()), 1) as device:
        assert device.link.by_device_time
        device.parameters.dump()
        assert device.read("clock.tick") == 0
        device.link.wait(lambda: False, 0.25)
        assert device.read("clock.tick") == 250
        assert device.link.time_s == pytest.approx(0.25)


def test_each_sync_lets_the_communication_cycle_pass(by_sync: SimProcess) -> None:
    with connected(open_bus(by_sync.options()), 1) as device:
        device.write("sync_period", 2500)
        for _ in range(4):
            device.link.send(wire.SYNC, b"")
        assert device.read("clock.tick") == 10
    with pytest.raises(DeviceError, match="whole ms"), connected(open_bus(by_sync.options()), 1):
        pass


def test_longer_cycles_are_followed(by_sync: SimProcess) -> None:
    with connected(open_bus(by_sync.options()), 1) as device:
        device.write("sync_period", 10_000)
    with connected(open_bus(by_sync.options()), 1) as device, device.axes.enabled():
        before_s = device.link.time_s
        device.link.poll(0.0)
        assert device.link.time_s == pytest.approx(before_s + 0.01)


def test_a_drive_paced_by_the_clock_says_so(sim: SimProcess) -> None:
    with connected(open_bus(sim.options()), 1) as device:
        assert device.read("clock.pace") == 0
        assert not device.link.by_device_time


def test_circle_over_tcp_is_as_good_as_in_process(machine: Machine) -> None:
    there = machine.starting_at((0.005, 0.0))
    trajectory = plan(shapes.circle(0.005, 0.05), limits(machine))
    with start(slcan_tcp="0", pace="sync", machine=there) as sim:
        tell(Target(machine, bus=sim.options()))
        over_tcp = run(trajectory, "ccu", Target(machine, bus=sim.options())).log
    in_process = run(trajectory, "ccu", Target(machine)).log
    assert over_tcp.meta["frames_lost"] == 0
    assert len(over_tcp.columns["tick"]) == len(in_process.columns["tick"])
    assert (
        np.abs(over_tcp.columns["contour_error_um"]).max() < 2.0 * np.abs(in_process.columns["contour_error_um"]).max()
    )


def test_two_runs_paced_by_sync_give_equal_bytes(machine: Machine, tmp_path: Path) -> None:
    trajectory = plan(shapes.circle(0.005, 0.05), limits(machine))
    port, logs, truths = "0", [], []
    for name in ("a", "b"):
        with start(slcan_tcp=port, pace="sync", record=tmp_path / f"{name}.truth") as process:
            port = process.channel.rpartition(":")[2]  # the log has the name of the channel
            target = Target(machine, bus=process.options())
            log.write(
                run(trajectory, "ccu", target, RunOptions(approach=limits(machine))).log, tmp_path / f"{name}.csv"
            )
        logs.append((tmp_path / f"{name}.csv").read_bytes())
        truths.append((tmp_path / f"{name}.truth").read_bytes())
    assert logs[0] == logs[1]
    assert truths[0] == truths[1]


class _BadBus:
    """Every so many frames one is lost, one is doubled. `syncs`: SYNCs that arrive at the drive."""

    def __init__(self, bus: can.BusABC) -> None:
        self._send, self._recv = bus.send, bus.recv
        self._sent = self._received = self.syncs = 0
        self._again: can.Message | None = None
        bus.send, bus.recv = self.send, self.recv  # type: ignore[method-assign]

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        self._sent += 1
        for _ in range(0 if self._sent % 97 == 0 else 2 if self._sent % 11 == 0 else 1):
            self.syncs += message.arbitration_id == wire.SYNC
            self._send(message, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self._again is not None:
            message, self._again = self._again, None
            return message
        message = self._recv(timeout)
        self._received += message is not None
        if message is None or self._received % 89 == 0:
            return None
        self._again = message if self._received % 13 == 0 else None
        return message


def test_sync_rounds_hold_on_a_bad_bus(by_sync: SimProcess, machine: Machine) -> None:
    """Neither SYNCs that are lost or doubled nor lost ticks part the host's time from the drive's."""
    there = Program("line", (Move(Line((0.0, 0.0), (0.02, 0.01)), 0.05),), (0.0, 0.0))
    with connected(open_bus(by_sync.options()), 1) as device:
        bus = _BadBus(device.link.bus)
        late_ms: list[int] = []
        with device.axes.enabled():
            streamed = stream(
                device,
                plan(there, limits(machine)).knots_nm,
                Operator(progress=lambda share: late_ms.append(bus.syncs - round(device.link.time_s * 1e3))),
            )
        assert streamed.completed
        assert 0 < max(late_ms) < 20


def test_silence_of_a_drive_paced_by_sync_is_an_error(by_sync: SimProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(link, "_SILENCE_S", 0.0)
    with connected(open_bus(by_sync.options()), 1) as device:
        monkeypatch.setattr(device.link.bus, "recv", lambda timeout: None)
        with pytest.raises(NoAnswerError, match="is silent"):
            device.link.poll(1.0)


HOST_THAT_IS_KILLED = """
import sys
import kontur

table = kontur.load_machine()
operator = kontur.Operator(progress=lambda share: share > 0.6 and print("half way", flush=True))
circle = kontur.plan(kontur.shapes.circle(0.005, 0.01), kontur.limits(table))
kontur.run(circle, "ccu", kontur.Target(table, bus={"interface": "slcan", "channel": sys.argv[1]}), operator=operator)
"""


def test_host_killed_on_the_way_stops_the_drive_on_the_path(machine: Machine, tmp_path: Path) -> None:
    on_circle = dataclasses.replace(machine.starting_at((0.005, 0.0)), friction_schedule=())
    record = tmp_path / "truth"
    with start(slcan_tcp="0", pace="sync", machine=on_circle, record=record) as sim:
        with subprocess.Popen([sys.executable, "-c", HOST_THAT_IS_KILLED, sim.channel], stdout=subprocess.PIPE) as host:
            assert host.stdout is not None
            assert host.stdout.readline() == b"half way\n"
            host.kill()
        with connected(open_bus(sim.options()), 1) as device:
            killed = device.read("clock.tick")
            while device.read("statusword_x") & 0x4F != FAULT and device.read("clock.tick") < killed + 1000:
                device.link.send(wire.SYNC, b"")  # time passes, and no heartbeat comes
            assert device.read("error_code_x") == device.read("error_code_y") == 0x8130
            assert device.read("stream.executed") > 1000
            assert 490 <= device.read("clock.tick") - killed <= 700  # 500 from the last heartbeat on, and the stop
    truth = sim_process.read_record(record)
    error_m = np.abs(np.hypot(*truth.pos_m.T) - 0.005)
    assert error_m[10 * killed :].max() <= error_m[: 10 * killed].max() + machine.x.encoder_m
    assert np.abs(truth.vel_mps[10 * killed]).max() > 0.005
    np.testing.assert_array_equal(truth.vel_mps[-1], 0.0)


def test_drive_notices_by_the_heartbeat_that_its_client_has_gone(sim: SimProcess) -> None:
    with connected(open_bus(sim.options()), 1) as device:
        device.axes.enable()
    with connected(open_bus(sim.options()), 1) as device:
        device.link.stop_heartbeat()  # this client sends none
        assert device.link.wait(lambda: device.read("error_code_x") == 0x8130, TIMEOUT_S)


def connect(sim: SimProcess) -> socket.socket:
    return socket.create_connection(("127.0.0.1", port_of(sim)), TIMEOUT_S)


def read_until(client: socket.socket, end: bytes) -> bytes:
    text = b""
    while end not in text:
        more = client.recv(4096)
        assert more, f"the connection was closed after {text!r}"
        text += more
    return text


def test_clients_that_say_nothing_lock_nobody_out(sim: SimProcess) -> None:
    with contextlib.ExitStack() as idle:
        for _ in range(3):
            idle.enter_context(connect(sim))
        talk(sim)


def test_clients_see_the_frames_of_the_drive_and_of_each_other_as_on_one_bus(sim: SimProcess) -> None:
    with connect(sim) as one, connect(sim) as other, connect(sim) as closed:
        for client in (one, other):
            client.sendall(b"O\r")
            read_until(client, b"\r")
        one.sendall(b"t60184000100000000000\r")
        assert b"t60184000100000000000\r" in (text := read_until(other, b"t5818"))
        assert text.index(b"t601") < text.index(b"t5818")
        assert b"t601" not in read_until(one, b"t5818"), "its own frame came back"
        closed.sendall(b"O\r")  # what was before it opened its channel is not for it
        assert b"t5818" not in read_until(closed, b"t701")


def test_two_programs_use_one_drive_at_the_same_time(by_sync: SimProcess) -> None:
    """Paced by SYNC: both hosts are in this process, so one sends no heartbeat while the other connects."""
    with connected(open_bus(by_sync.options()), 1) as device:
        device.axes.enable()
        with connected(open_bus(by_sync.options()), 1) as looker:
            assert looker.info().state == ("operation enabled", "operation enabled")
        seen = device.link.status_count
        assert device.link.wait(lambda: device.link.statuswords_since(seen), TIMEOUT_S)
        assert device.axes.states() == ("operation enabled", "operation enabled")


def test_when_there_is_no_place_the_client_that_has_been_silent_longest_is_told_and_goes(sim: SimProcess) -> None:
    with connected(open_bus(sim.options()), 1) as device, contextlib.ExitStack() as idle:
        clients = []
        for _ in range(20):
            clients.append(idle.enter_context(connect(sim)))
            device.read("clock.tick")  # a host that works is not silent
        for client in clients[:13]:
            assert b"has been silent longest" in client.makefile("rb").read()
        for client in clients[13:]:
            client.sendall(b"V\r")
            assert read_until(client, b"\r") == b"V1010\r"
        device.info()


def test_client_that_never_reads_blocks_no_other_one(sim: SimProcess) -> None:
    with connect(sim) as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.sendall(b"O\r")
        with connected(open_bus(sim.options()), 1) as device:
            device.pdos.require(*pdos.TELEMETRY)
            device.link.send(wire.NMT, bytes([wire.NMT_START, 1]))
            before = device.link.frames
            assert device.link.wait(lambda: device.link.frames > before + 20_000, TIMEOUT_S)  # 400 kB for each client
            device.info()
        deaf.shutdown(socket.SHUT_WR)
        end_s = time.monotonic() + TIMEOUT_S
        while "frames were dropped, since the client did not read them" not in sim.messages():
            assert time.monotonic() < end_s
            time.sleep(0.01)


def test_client_that_floods_the_line_blocks_no_other_one(sim: SimProcess) -> None:
    """Neither with frames nor with what is none."""
    with contextlib.ExitStack() as flood:
        stop = threading.Event()
        for text in (b"y\r" * 500, b"y" * 1000, b"t7E00\r" * 100):
            client = flood.enter_context(connect(sim))
            client.sendall(b"O\r")
            writer = threading.Thread(target=_flood, args=(client, text, stop))
            writer.start()
            flood.callback(writer.join)
        flood.callback(stop.set)
        talk(sim)


def _flood(client: socket.socket, text: bytes, stop: threading.Event) -> None:
    client.settimeout(0.05)
    while not stop.is_set():
        with contextlib.suppress(TimeoutError):
            client.send(text)
        with contextlib.suppress(TimeoutError):
            client.recv(65536)


def test_client_that_does_not_read_does_not_stop_the_drive() -> None:
    with start(slcan_tcp="0", pace="sync") as sim:
        with socket.create_connection(("127.0.0.1", port_of(sim)), TIMEOUT_S) as deaf:
            switch_on = b"".join(b"t6018230%d1801%02X0%d0000\r" % (n, 0x81, n + 1) for n in (1, 2))  # TPDO2, 3
            deaf.sendall(b"O\r" + switch_on + b"t00020101\r" + b"t0800\r" * 20_000)  # 20 s of telemetry, 1 MB
            deaf.shutdown(socket.SHUT_WR)
            end_s = time.monotonic() + TIMEOUT_S
            while "frames were dropped, since the client did not read them" not in sim.messages():
                assert time.monotonic() < end_s, "it says nothing of frames that were dropped"
                time.sleep(0.01)
        talk(sim)


def test_noise_on_the_line_is_survived(sim: SimProcess) -> None:
    noise = np.random.default_rng(1).bytes(200_000)
    with socket.create_connection(("127.0.0.1", port_of(sim)), TIMEOUT_S) as client:
        client.sendall(b"O\r")
        for i in range(0, len(noise), 1000):
            client.sendall(noise[i : i + 1000])
            client.recv(65536)
    talk(sim)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_signals_end_it_cleanly(sim: SimProcess, number: signal.Signals) -> None:
    sim.process.send_signal(number)
    assert sim.process.wait(TIMEOUT_S) == 0
    assert sim.messages() == ""


def test_port_in_use_is_said_with_the_remedy(sim: SimProcess) -> None:
    with pytest.raises(SimulatorError, match=r"in use.*or 0 for any"), start(slcan_tcp=str(port_of(sim))):
        pass


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--num", "f64"], "choose f32, fix or chk"),
        (["--node", "32"], "--node 32: must be a whole number 1..31"),
        (["--seed", "-1"], "--seed -1: must be a whole number"),
        (["--slcan-tcp", "70000"], "--slcan-tcp 70000: must be"),
        (["--slcan-tcp", "nowhere.invalid:1"], "nowhere.invalid"),
        (["--slcan-tcp", "192.0.2.1:0"], "no address of this machine"),
    ],
)
def test_bad_options_get_one_line(arguments: list[str], message: str) -> None:
    text = refused(*arguments)
    assert text.count("\n") == 1
    assert message in text


def kernel_has_can() -> bool:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


@pytest.mark.skipif(kernel_has_can(), reason="needs a kernel without CAN; with one, tests/hil has more")
def test_kernel_without_can_is_said_with_what_to_use_instead() -> None:
    with pytest.raises(SimulatorError, match=r"kernel has no CAN.*--slcan-tcp"), start(can="vcan0"):
        pass


@pytest.mark.skipif(not kernel_has_can(), reason="needs a kernel with CAN: modprobe can-raw, or `make test-hil`")
@pytest.mark.parametrize(
    ("interface", "message"),
    [("kontur-none", "ip link add dev kontur-none type vcan"), ("x" * 30, "no interface"), ("lo", "no CAN interface")],
)
def test_missing_can_interface_is_said_with_the_remedy(interface: str, message: str) -> None:
    with pytest.raises(SimulatorError, match=message), start(can=interface):
        pass


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass_kg 88.08 97.9", "mass_kg 88.08", "mass_kg: has 1 of 2 values"),
        ("mass_kg 88.08 97.9", "mass_kg 88.08 heavy", "mass_kg: heavy: not a number"),
        ("mass_kg 88.08 97.9", "mass_kg 88.08 97.9 1", "mass_kg: 1: not a number that belongs here"),
        ("mass_kg 88.08 97.9", "mass_kg 88.08 -1", "mass_kg is out of range"),
        ("mass_kg", "mess_kg", "mess_kg: no such field"),
        ("substeps 10", "# none", "substeps is missing"),
        ("substeps 10", "substeps 10.5", "substeps: 10.5: not a number"),
    ],
)
def test_bad_machine_is_refused_with_the_field(old: str, new: str, message: str) -> None:
    text = plain_machine(machines.load())
    assert old in text
    answer = refused(machine=text.replace(old, new))
    assert message in answer
    assert answer.count("\n") == 1


def test_usage_without_a_bus() -> None:
    result = kontur_sim("--machine", "-")
    assert result.returncode == 2
    assert result.stderr.startswith("usage: kontur-sim")
    assert kontur_sim("--help").stdout.startswith("usage: kontur-sim")


def test_program_that_is_not_built_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sim_process, "PROGRAM", tmp_path / "kontur-sim")
    with pytest.raises(LibraryError, match="make lib"), start(slcan_tcp="0"):
        pass


def test_open_bus_does_not_wait_for_the_process(sim: SimProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[dict[str, object]] = []
    monkeypatch.setattr(can, "Bus", lambda **options: opened.append(options) or can.BusABC)
    open_bus({"interface": "slcan", "channel": sim.channel})
    open_bus({"interface": "slcan", "channel": "/dev/ttyACM0"})
    assert [options.get("sleep_after_open") for options in opened] == [0, None]
