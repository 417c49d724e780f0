# SPDX-License-Identifier: Apache-2.0
"""The numeric back ends of the firmware: fixed point is as good as float32, has no float in it, and is checked."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from kontur import machine
from kontur.drive.controllers import CONTROLLERS
from kontur.drive.target import Target
from kontur.experiments.circles import CASES, paper
from kontur.path import programs
from kontur.planning.bounds import limits
from kontur.planning.planner import plan
from kontur.runs.runner import run

ROOT = Path(__file__).resolve().parents[2]
MACHINE = machine.load()
COUNT_UM = MACHINE.axes[0].encoder_m * 1e6


@pytest.mark.parametrize("case", CASES)
def test_contour_error_in_fixed_point_is_within_an_encoder_count_of_that_in_float32(case: str) -> None:
    rows = {num: list(paper(Target(machine=MACHINE, num=num), [case], CONTROLLERS, [1])) for num in ("f32", "fix")}
    for one, other in zip(rows["f32"], rows["fix"], strict=True):
        assert (one["num"], other["num"]) == ("f32", "fix")
        assert other["mean_um"] == pytest.approx(one["mean_um"], abs=COUNT_UM), one["controller"]
        assert other["max_um"] == pytest.approx(one["max_um"], abs=COUNT_UM), one["controller"]


@pytest.mark.parametrize("case", CASES)
def test_distance_from_the_circle_in_fixed_point_is_that_in_float32_all_along_the_path(case: str) -> None:
    """A count that is read a period earlier or later makes the two runs differ by some nm for a while."""
    trajectory = plan(CASES[case].program(), limits(MACHINE))
    radius = []
    for num in ("f32", "fix"):
        truth = run(trajectory, "ccu", Target(machine=MACHINE, num=num)).truth
        assert truth is not None
        radius.append(np.hypot(*truth.pos_m.T) * 1e6)
    assert np.abs(radius[0] - radius[1]).max() < COUNT_UM


def test_part_runs_under_the_checking_back_end() -> None:
    """It ends the process at the first overflow or loss of precision, so that this test cannot go on."""
    trajectory = plan(programs.load(ROOT / "examples/part.ngc"), limits(MACHINE))
    for controller in CONTROLLERS:
        result = run(trajectory, controller, Target(machine=MACHINE, num="chk"))
        assert result.log.meta["num"] == "chk"
        assert result.log.meta["status"] == "complete"


def test_circles_run_under_the_checking_back_end() -> None:
    assert len(list(paper(Target(machine=MACHINE, num="chk"), CASES, CONTROLLERS, [1]))) == len(CASES) * len(
        CONTROLLERS
    )


def floats_in(objects: list[Path]) -> list[str]:
    """Floating-point registers that the objects use, and functions for floats that they call."""
    names = subprocess.run(["nm", "-u", *map(str, objects)], capture_output=True, text=True, check=True).stdout
    code = subprocess.run(["objdump", "-d", *map(str, objects)], capture_output=True, text=True, check=True).stdout
    registers = re.findall(r"%(?:[xyz]mm\d+|st\b)|\b[vsdq]\d+\.\d[sd]\b", code)
    return registers + re.findall(r"U (__\w*[sdxt]f\w*|sqrtf?|hypotf?|fabsf?|coshf?|sinhf?)$", names, re.MULTILINE)


@pytest.mark.skipif(shutil.which("objdump") is None, reason="needs objdump: apt-get install binutils")
def test_fixed_point_firmware_has_no_float_in_it(tmp_path: Path) -> None:
    objects = sorted((ROOT / "build/host-fix/firmware").rglob("*.o"))
    assert len(objects) > 20
    assert floats_in(objects) == []
    planted = tmp_path / "planted.c"
    planted.write_text("void half(int *x, float *y) { *y = (float)*x * 0.5f; }\n")
    compiled = planted.with_suffix(".o")
    build = ["gcc", "-O2", "-c", str(planted), "-o", str(compiled)]
    subprocess.run(build, check=True)
    assert "%xmm0" in floats_in([compiled])
    assert subprocess.run([*build, "-mgeneral-regs-only"], capture_output=True).returncode != 0
