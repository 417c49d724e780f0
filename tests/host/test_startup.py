# SPDX-License-Identifier: Apache-2.0
"""Commands import what they need when they need it, which decides how long they take to start; and completion.

Times are no property of the source, so the tests hold the modules that are loaded.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import click
import pytest

from kontur.can.signals import RECORDED
from kontur.cli import main
from kontur.drive.controllers import NAMES
from kontur.drive.objects import Objects
from kontur.drive.target import Target, open_drive
from kontur.machine import MACHINES

# Packages that take a notable time to import.
HEAVY = {"asammdf", "can", "canopen", "cffi", "matplotlib", "numpy", "pandas", "rich", "scipy", "serial"}
COMMANDS = [[name] for name in main.list_commands(click.Context(main))]
SUBCOMMANDS = [["bench", "bus"], ["experiment", "paper"], ["log", "show"], ["param", "list"]]


def loaded_by(arguments: Sequence[str], environment: dict[str, str] | None = None) -> set[str]:
    """Which of the heavy packages one call of the command line loads."""
    program = (
        "import atexit, sys; from kontur.cli import main\n"
        "atexit.register(lambda: print(*sys.modules, file=sys.stderr)); main(prog_name='kontur')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        capture_output=True, text=True, env=os.environ | (environment or {}),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return HEAVY & set(done.stderr.splitlines()[-1].split())


def completions(line: str) -> list[str]:
    """What Tab offers at the end of `line`, by click's protocol for fish: words and "file" for names of files."""
    words, _, last = line.rpartition(" ")
    environment = {"_KONTUR_COMPLETE": "fish_complete", "COMP_WORDS": words, "COMP_CWORD": last}
    done = subprocess.run(
        [sys.executable, "-c", "from kontur.cli import main; main(prog_name='kontur')"],
        capture_output=True, text=True, check=True, env=os.environ | environment,
    )  # fmt: skip
    return [text.split(",", 1)[1].split("\t")[0] if text.startswith("plain,") else "file"
            for text in done.stdout.splitlines() if text.startswith(("plain,", "file,"))]  # fmt: skip


def in_new_process(program: str, **environment: str) -> str:
    kept = {key: value for key, value in os.environ.items() if key != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, env=kept | environment
    )  # fmt: skip
    return done.stdout.strip()


def test_arrays_are_multiplied_without_threads_of_their_own() -> None:
    assert in_new_process("import os, kontur.cli, numpy; print(len(os.listdir('/proc/self/task')))") == "1"


def test_who_asks_for_threads_keeps_them() -> None:
    program = "import os, kontur.cli; print(os.environ['OPENBLAS_NUM_THREADS'])"
    assert in_new_process(program, OPENBLAS_NUM_THREADS="2") == "2"


@pytest.mark.parametrize("words", [[], *COMMANDS, *SUBCOMMANDS], ids=" ".join)
def test_help_loads_nothing_that_takes_time(words: list[str]) -> None:
    assert loaded_by([*words, "--help"]) == set()


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_completion_loads_nothing_that_takes_time(words: list[str]) -> None:
    line = {"_KONTUR_COMPLETE": "bash_complete", "COMP_WORDS": " ".join(["kontur", *words, "--"]), "COMP_CWORD": "2"}
    assert loaded_by([], line) == set()


def test_info_of_a_drive_on_a_bus_loads_no_simulator_no_mathematics_and_no_pictures() -> None:
    from kontur.sim import process

    with process.start(slcan_tcp="0") as drive:
        loaded = loaded_by(["info", "-i", drive.interface, "-c", drive.channel])
    assert loaded == {"can", "canopen", "numpy", "serial"}


def test_info_of_a_simulated_drive_loads_the_simulator_and_no_more() -> None:
    assert loaded_by(["info"]) == {"can", "canopen", "cffi", "numpy"}


def test_run_writes_mf4_although_python_can_does_not_load_asammdf(tmp_path: Path) -> None:
    log = tmp_path / "run.mf4"
    assert "asammdf" in loaded_by(["run", "circle", "--radius", "2", "--feed", "50", "--log", str(log)])
    assert loaded_by(["log", "show", str(log)]) >= {"asammdf"}


def test_tab_completes_shapes_files_and_options() -> None:
    assert completions("kontur run ci") == ["file", "circle"]
    assert set(completions("kontur run ")) == {"circle", "ellipse", "eight", "square", "spiral", "file"}
    assert completions("kontur run circle --corner-r") == ["--corner-radius"]


def test_tab_completes_in_bash_by_the_script_that_click_writes() -> None:
    program = (
        'eval "$(_KONTUR_COMPLETE=bash_source kontur)"; complete -p kontur; COMP_CWORD=2\n'
        "for line in 'kontur run ell' 'kontur bench s'; do\n"
        '  COMP_WORDS=($line); COMPREPLY=(); _kontur_completion kontur; echo "${COMPREPLY[@]}"\ndone'
    )
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(["bash", "-c", program], capture_output=True, text=True, env=os.environ | {"PATH": path})
    lines = done.stdout.splitlines()
    assert lines[0].endswith("-F _kontur_completion kontur"), done.stderr
    assert lines[1].split()[0] == "ellipse"
    assert lines[2] == "sim stream"


def test_tab_completes_controllers_by_either_name() -> None:
    assert set(completions("kontur run circle --controller ")) == {*NAMES, "all"}
    assert completions("kontur experiment paper --controller cross") == ["cross-coupled-cascade"]


def test_tab_completes_every_parameter_that_a_drive_has() -> None:
    with open_drive(Target()) as device:
        names = set(Objects(device.link).declared)
    assert set(completions("kontur param get ")) == names
    assert set(completions("kontur param set ")) == {f"{name}=" for name in names}
    assert completions("kontur run circle --set smc.lamb") == ["smc.lambda="]


def test_tab_completes_each_signal_of_a_list() -> None:
    assert set(completions("kontur run circle --scope ")) == set(RECORDED)
    assert completions("kontur scope --signals force_x,contour_error_r") == ["force_x,contour_error_rate"]


def test_tab_completes_machine_files_that_come_with_the_package() -> None:
    offered = completions("kontur run circle --machine ")
    assert {Path(name).name for name in offered} == {"file", *(file.name for file in MACHINES.glob("*.toml"))}
