# SPDX-License-Identifier: Apache-2.0
"""The folder of `kontur commission` belongs to one drive and machine; what it asks, and the time that it takes.

What a step finds is made up, as in test_commission_ends.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import click
import pytest
from click.testing import CliRunner
from test_commission_ends import Steps, commission, on

from kontur.cli import main
from kontur.cli.commission import _ask
from kontur.errors import InputError
from kontur.machine import MACHINES
from kontur.sim import process

BALL = ["--machine", str(MACHINES / "ball_screw.toml"), "--untold"]
STIFF = ["--machine", str(MACHINES / "stiff_scale.toml"), "--untold"]


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def test_finished_folder_is_not_taken_for_another_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = Steps(monkeypatch)
    assert commission(tmp_path, *BALL).exit_code == 0
    before = contents(tmp_path)
    steps.did.clear()
    done = commission(tmp_path, *STIFF)
    assert done.exit_code == 1
    assert "progress.json: is of a commissioning that was finished with another machine" in done.stderr
    assert "name another folder with --out, or delete this file to overwrite what is in this one" in done.stderr
    assert json.loads(done.stdout)["saved"] is False
    assert steps.did == []
    assert contents(tmp_path) == before
    assert commission(tmp_path, *BALL).exit_code == 0  # its own machine is commissioned anew
    (tmp_path / "progress.json").unlink()
    assert commission(tmp_path, *STIFF).exit_code == 0


def test_folder_is_not_taken_for_another_node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Steps(monkeypatch)
    with process.start(slcan_tcp="0", pace="sync", machine=MACHINES / "ball_screw.toml") as drive:
        assert commission(tmp_path, *on(drive)).exit_code == 0
        assert commission(tmp_path, *on(drive)).exit_code == 0  # what it has stored makes it no other drive
    with process.start(slcan_tcp="0", pace="sync", machine=MACHINES / "ball_screw.toml", node_id=2) as drive:
        done = commission(tmp_path, *on(drive), "--node", "2")
    assert "was finished with another drive" in done.stderr


def test_drive_that_does_not_answer_leaves_the_record_of_an_earlier_commissioning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Steps(monkeypatch)
    assert commission(tmp_path, *BALL).exit_code == 0
    before = contents(tmp_path)
    done = commission(tmp_path, "-i", "slcan", "-c", "socket://127.0.0.1:1", *BALL[:2])
    assert done.exit_code == 1
    assert contents(tmp_path) == before


@pytest.mark.parametrize(
    ("answer", "code", "words"),
    [
        ("", 1, "nobody can answer this question, since the standard input has ended"),
        ("n\n", 1, "Not gone on. Nothing was stored"),
        ("y\n", 1, "nobody can answer"),  # for the next step
    ],
)
def test_question_without_an_answer_and_no_say_what_to_do(
    answer: str, code: int, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Steps(monkeypatch)
    done = CliRunner().invoke(main, ["commission", "--json", "--out", str(tmp_path), *BALL], input=answer)
    assert done.exit_code == code
    assert words in done.stderr
    assert "Aborted" not in done.stderr
    assert words in json.loads(done.stdout)["diagnosis"]["text"]
    assert (tmp_path / "commission.json").exists() == (answer == "y\n")  # with nothing found there is no record


def test_ctrl_c_at_a_question_interrupts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*_: object) -> str:
        raise KeyboardInterrupt

    Steps(monkeypatch)
    monkeypatch.setattr("click.termui._readline_prompt", interrupted)
    done = CliRunner().invoke(main, ["commission", "--out", str(tmp_path), *BALL])
    assert done.exit_code == 130
    assert "Interrupted: the axes have slowed down, and the parameters are as they were." in done.stderr


def test_standard_input_that_is_closed_is_the_same_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(InputError, match="nobody can answer this question"):
        _ask(lambda: click.confirm("Go on?"))


def test_time_of_all_steps_is_summed_over_a_break(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def result() -> Any:
        return json.loads((tmp_path / "commission.json").read_text())["time"]

    steps = Steps(monkeypatch, "prove", KeyboardInterrupt)

    def identify(device: Any, *rest: Any) -> Any:
        device.link.wait(lambda: False, 0.25)
        return steps.identify(device, *rest)

    monkeypatch.setattr("kontur.commissioning.session.identify", identify)
    commission(tmp_path, *BALL)
    first = result()
    assert set(first["steps"]) == {"identify", "tune"}
    assert first["steps"]["identify"]["drive_s"] == pytest.approx(0.5, abs=0.1)  # two axes
    Steps(monkeypatch)
    done = CliRunner().invoke(main, ["commission", "--yes", "--out", str(tmp_path), *BALL])
    assert done.exit_code == 0
    taken = result()
    assert taken["steps"]["identify"] == first["steps"]["identify"]
    assert set(taken["steps"]) == {"identify", "tune", "prove"}
    for name in ("drive_s", "computing_s"):
        assert taken[name] == pytest.approx(sum(step[name] for step in taken["steps"].values()), abs=2e-3)
    assert f"It took {taken['drive_s']:.0f} s of the drive's time" in done.stderr


def test_machine_file_of_the_user_is_not_overwritten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    steps = Steps(monkeypatch)
    mine = tmp_path / "machine.toml"
    mine.write_text((MACHINES / "ball_screw.toml").read_text())
    before = contents(tmp_path)
    done = commission(tmp_path, "--machine", str(mine), "--untold")
    assert done.exit_code == 1
    assert "machine.toml: is of no commissioning in this folder, and would be overwritten" in done.stderr
    assert steps.did == []
    assert contents(tmp_path) == before
