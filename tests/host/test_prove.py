# SPDX-License-Identifier: Apache-2.0
"""`kontur prove`: what it measures, its result, its report, and that the drive keeps what it has."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from kontur.cli import main
from kontur.commissioning import prove
from kontur.commissioning.prove import Candidate, Evidence, Proof
from kontur.drive.target import Target
from kontur.errors import EmcyError, HeldError, StreamError
from kontur.machine import MACHINES
from kontur.report import proof_page
from kontur.report.proof_page import Curve

DESIGN = MACHINES / "designs" / "ball_screw-ccu.toml"


def test_gains_are_proved_on_the_drive_and_the_report_can_be_filed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(prove, "_CIRCLES", ((0.004, 0.02),))
    monkeypatch.setattr(prove, "_POINTS", 7)
    report = tmp_path / "proof.html"
    machine = str(MACHINES / "ball_screw.toml")
    done = CliRunner().invoke(
        main,
        ["prove", "--machine", machine, "--untold", "--params", str(DESIGN), "--json", "-o", str(report)],
    )
    assert done.exit_code == 0, done.output
    result = json.loads(done.stdout)
    assert result["holds"] is True
    assert [one["case"] for one in result["proof"]] == ["r4@20 ccw", "r4@20 cw"]
    for one in result["proof"]:
        assert set(one) >= {"case", "controller", "before_um", "after_um", "ms_predicted", "ms_measured"}
        assert one["controller"] == "ccu"
        assert one["after_um"] < 0.2 * one["before_um"]
        assert one["iso_after_um"] < one["iso_before_um"]
        assert one["ms_measured"] == pytest.approx(one["ms_predicted"], rel=0.1)
    page = report.read_text()
    for words in ("The proof holds.", "build", "serial", "G(b) after", "Parameters that changed", "plant_x.mass"):
        assert words in page
    assert page.count("<img") == 2  # sensitivity and a polar plot


def curve() -> Curve:
    hz = np.array([10.0, 100.0])
    return Curve(hz, np.array([0.1, 1.5]), 0.1 * hz, hz, np.array([0.1, 1.4]))


def test_report_says_where_the_drive_stopped_and_shows_no_text_of_others_as_html(tmp_path: Path) -> None:
    file = tmp_path / "proof.html"
    row = Proof("r4@20 cw", "ccu", 1.0, None, 1.9, 2.4).as_json()
    proof_page.write_proof_report(
        file, "Not stored: <b>", {"machine": "<script>"}, [row], {"ccu": (curve(), curve())},
        {("ccu", "r4@20"): (None, None)}, [],
    )  # fmt: skip
    page = file.read_text()
    assert "the drive stopped" in page
    assert "Not stored: &lt;b&gt;" in page
    assert "<script>" not in page
    assert page.count("<img") == 1


@pytest.mark.parametrize(
    ("stops", "words"),
    [("fault", "on r4@20 ccw with the new gains, the drive stopped in ccw: FF1Fh"), ("high", "exceeds 2.2")],
)
def test_proof_that_does_not_hold_says_why_and_the_code_is_1(
    stops: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def measured(target: Target, candidates: Sequence[Candidate], *_: object) -> Evidence:
        good = Proof("r4@20 ccw", "ccu", 3.0, 1.0, 1.9, 2.0)
        stopped = replace(good, after_um=None, after_stopped="the drive stopped in ccw: FF1Fh")
        return Evidence([stopped if stops == "fault" else replace(good, ms_measured=2.3)])

    monkeypatch.setattr(prove, "candidate", lambda model, name, values: None)
    monkeypatch.setattr(prove, "prove", measured)
    done = CliRunner().invoke(main, ["prove", "--json"])
    assert done.exit_code == 1
    assert json.loads(done.stdout)["holds"] is False
    assert words in done.stderr


def test_circle_on_which_the_drive_stops_counts_and_a_drive_that_is_held_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(error: Exception) -> None:
        def circle_test(setup: object, feeds: object, bounds: object, target: object, progress: Any, *_: object) -> Any:
            progress("20 mm/s, cw", 0.0)
            raise error

        monkeypatch.setattr(prove, "circle_test", circle_test)

    _, setup = prove._circles(Target(), "ccu", 0.004, 0.02)
    fails(EmcyError(0x8611, 1, b"", "following"))
    found = prove._run(Target(), setup, 0.02, lambda text: None, lambda: False, None)
    assert found == (None, (None, None), "the drive stopped in cw: following")
    fails(HeldError("held"))
    with pytest.raises(HeldError):
        prove._run(Target(), setup, 0.02, lambda text: None, lambda: False, None)


@pytest.mark.parametrize(
    ("error", "tries"),
    [
        (EmcyError(0xFF10, 1, b"", "ran out of knots"), 3),
        (EmcyError(0x8130, 1, b"", "no heartbeat"), 3),
        (StreamError("no status for 2 s"), 3),
        (EmcyError(0xFF1F, 1, b"", "oscillated"), 1),
    ],
)
def test_circle_that_a_slow_host_has_ended_is_run_again(
    error: Exception, tries: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []
    runs = []

    def circle_test(*_: object) -> Any:
        runs.append(1)
        raise error

    monkeypatch.setattr(prove, "circle_test", circle_test)
    _, setup = prove._circles(Target(), "ccu", 0.004, 0.02)
    found = prove._run(Target(), setup, 0.02, said.append, lambda: False, None)
    assert found[2] == f"the drive stopped in ccw: {error}"
    assert len(runs) == tries
    assert said == [f"ccu: once more, since the drive stopped in ccw: {error}"] * (tries - 1)


def test_why_the_drive_stopped_is_in_the_text_the_json_and_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def circle_test(setup: Any, feeds: object, bounds: object, target: object, progress: Any, *_: object) -> Any:
        progress("20 mm/s, cw", 0.0)
        raise EmcyError(0xFF1F, 1, b"", "the drive reports FF1Fh: an axis oscillated. Remedy: lower the gains <i>")

    response = SimpleNamespace(hz=np.array([50.0]), sensitivity=np.array([1.5]), sensitivity_sigma=np.array([0.1]))
    monkeypatch.setattr(prove, "_CIRCLES", ((0.004, 0.02),))
    monkeypatch.setattr(prove, "_sensitivity", lambda *_: (response, response))
    monkeypatch.setattr(prove, "circle_test", circle_test)
    report = tmp_path / "proof.html"
    ask = ["prove", "--params", str(DESIGN), "-o", str(report)]
    done = CliRunner().invoke(main, [*ask, "--json"])
    assert done.exit_code == 1
    why = "the drive stopped in cw: the drive reports FF1Fh: an axis oscillated. Remedy: lower the gains <i>"
    row = json.loads(done.stdout)["proof"][0]
    assert (row["after_um"], row["before_stopped"], row["after_stopped"]) == (None, why, why)
    page = report.read_text()
    assert "<li>ccu, r4@20, after: the drive stopped in cw: the drive reports FF1Fh" in page
    assert page.count("lower the gains &lt;i&gt;") == 3  # the verdict, before and after
    done = CliRunner().invoke(main, ask)
    assert f"ccu: r4@20, after: {why}." in done.stderr
    assert "on r4@20 ccw with the new gains, the drive stopped in cw" in done.stderr
