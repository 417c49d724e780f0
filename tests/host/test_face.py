# SPDX-License-Identifier: Apache-2.0
"""The face of the package: one import, which costs nothing, and names that are all there."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

import kontur
from kontur.cli import main
from kontur.drive.controllers import CONTROLLERS, NAMES, named
from kontur.errors import ParameterError


def loaded_after(statement: str) -> set[str]:
    """The modules that a fresh interpreter has loaded after `statement`."""
    program = f"import sys; {statement}; import json; print(json.dumps(sorted(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


def test_import_of_the_package_loads_nothing_of_it() -> None:
    assert {name for name in loaded_after("import kontur") if name.startswith(("kontur.", "numpy", "can."))} == set()


def test_every_name_of_the_face_is_there_and_documented() -> None:
    for name in kontur.__all__:
        assert getattr(kontur, name) is not None
        assert name in ("__version__", "CONTROLLERS") or getattr(kontur, name).__doc__, name
    assert set(dir(kontur)) == set(kontur.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        kontur.nothing  # noqa: B018


def test_drive_of_a_bus_is_reached_without_scipy_matplotlib_or_a_simulator() -> None:
    loaded = loaded_after("import kontur; kontur.open_drive; kontur.Target; kontur.stream; kontur.open_bus")
    assert not {"scipy", "matplotlib", "cffi", "kontur.sim.bus"} & loaded


def test_script_runs_a_shape_on_the_simulated_drive() -> None:
    machine = kontur.load_machine()
    trajectory = kontur.plan(kontur.shapes.circle(0.005, 0.05), kontur.limits(machine))
    result = kontur.run(trajectory, "contour-smc-compensated", kontur.Target(machine))
    assert result.completed
    assert result.log.meta["controller"] == "ccu"
    assert kontur.summary(result.log)["mean_um"] < 0.5


def test_drive_is_opened_and_tells_who_it_is() -> None:
    with kontur.open_drive(kontur.Target()) as drive:
        assert drive.info().node_id == 1


def test_controllers_have_the_papers_names_and_names_that_explain_themselves() -> None:
    assert [named(name) for name in CONTROLLERS] == list(CONTROLLERS)
    aliases = ("axis-smc", "contour-smc", "contour-smc-compensated", "cascade", "cross-coupled-cascade")
    assert tuple(named(alias) for alias in aliases) == CONTROLLERS
    assert set(NAMES) == {*CONTROLLERS, *aliases}
    with pytest.raises(ParameterError, match=r"'pid' is unknown; there are track \(axis-smc\), cc \(contour-smc\)"):
        named("pid")


def test_command_takes_either_name_and_logs_the_papers(tmp_path: Path) -> None:
    logs = []
    for name in ("ccc", "cross-coupled-cascade"):
        log = tmp_path / f"{name}.csv"
        args = ["run", "circle", "--radius", "5", "--feed", "50", "--controller", name, "--log", str(log)]
        assert CliRunner().invoke(main, args).exit_code == 0
        logs.append(log.read_bytes())
    assert logs[0] == logs[1]
    assert "cross-coupled-cascade" in CliRunner().invoke(main, ["run", "--help"]).output
    refused = CliRunner().invoke(main, ["run", "circle", "--feed", "50", "--controller", "pid"])
    assert refused.exit_code == 2
    assert "controller 'pid' is unknown" in refused.stderr
