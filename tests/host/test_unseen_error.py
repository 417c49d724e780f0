# SPDX-License-Identifier: Apache-2.0
"""`tools/unseen_error.py`: what is seen, what is not, and the ratio that is left."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import unseen_error

from kontur.experiments import machines
from kontur.path import shapes
from kontur.runs.log import RunLog

CCU = {"smc.lambda": 60.0, "smc.k_0": 60.0, "smc.k_max": 60.0, "smc.zeta": 60.0, "observer.bandwidth": 2000.0}
CASCADE = {"cascade.position_gain": 60.0, "cascade.velocity_gain": 150.0, "observer.bandwidth": 2000.0}


def test_an_error_is_split_into_what_the_drive_sees_and_the_rest() -> None:
    columns = {
        "tick": np.arange(5.0),
        "time_s": np.arange(5.0) * 1e-3,
        "tangential_error_um": np.zeros(5),
        "contour_error_um": np.array([9.0, 1.0, -1.0, 0.0, 5.0]),
        "true_contour_error_um": np.array([9.0, 3.0, -2.0, 1.0, np.nan]),
    }
    log = RunLog({"program": "p", "controller": "ccu", "status": "complete"}, columns)
    assert unseen_error.split(log, 0.5e-3) == pytest.approx((2.0, 2.0 / 3.0, 4.0 / 3.0))


def test_the_table_has_the_errors_of_runs_and_the_ratio_that_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    short = {"short": machines.Case(shapes.circle(0.002, 0.05, duration_s=0.3), 0.1)}
    monkeypatch.setattr(machines, "cases", lambda: short)
    machine = machines.packaged()[1]
    file = tmp_path / "machines.json"
    designs = {"ccu full": {"gains": CCU}, "cascade full": {"gains": CASCADE}}
    file.write_text(json.dumps({"machines": [{"name": machine.name, "designs": designs}]}))
    assert unseen_error.main([str(file)]) == 0
    cells = [cell.strip() for cell in capsys.readouterr().out.splitlines()[-1].strip("|").split("|")]
    assert cells[:2] == [machine.name, "short"]
    ccu, cascade = ([float(um) for um in cell.split(",")] for cell in cells[2:4])
    values = machine.parameters() | CCU
    expected_um = machines._drive(machine, short["short"], "ccu", values, "f32")["mean_um"]
    assert ccu[0] == pytest.approx(expected_um, rel=2e-2)  # at the control rate, and not once a millisecond
    assert cascade[2] < cascade[0] + cascade[1]
    assert [float(cell) for cell in cells[4:]] == pytest.approx(
        [cascade[0] / ccu[0], cascade[0] / min(ccu[2], cascade[2])], rel=2e-2
    )


def test_a_drive_that_stops_has_no_ratio() -> None:
    fast = dict(CASCADE, **{"cascade.velocity_gain": 4000.0, "cascade.position_gain": 2000.0})
    machine = machines.packaged()[1]
    case = machines.Case(shapes.circle(0.002, 0.05, duration_s=0.3))
    assert unseen_error.driven(machine, case, "cascade", fast) is None


def test_a_file_that_is_no_result_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert unseen_error.main([str(tmp_path / "none.json")]) == 2
    assert "none.json" in capsys.readouterr().err
