# SPDX-License-Identifier: Apache-2.0
"""The package as users install it: checkout, source package and wheel, into empty environments (`make test-install`).

A wheel is for any Python 3, so it is installed on each version that this machine has. It is built once: what it takes
to build it is tried on the oldest and on the newest Python.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MINORS = (10, 11, 12, 13)
COMPILER = ("cc", "as", "ld", "ar", "ranlib")
LIBRARIES = {f"kontur/lib/{name}" for name in ("kontur-sim", "kontur_sim.h")} | {
    f"kontur/lib/libkontur_{num}.so" for num in ("f32", "fix", "chk")
}
WAYS = [".venv/bin", *(f".pyenv/versions/3.{minor}.*/bin" for minor in MINORS), ".local/share/uv/python/*/bin"]


def python(minor: int) -> Path | None:
    """A Python 3.`minor` of this machine: in PATH, or where pyenv and uv put theirs."""
    name = f"python3.{minor}"
    found = [shutil.which(name), *sorted(file for way in WAYS for file in Path.home().glob(f"{way}/{name}"))]
    if sys.version_info[1] == minor:
        found.insert(0, sys.executable)
    for file in filter(None, found):
        if subprocess.run([file, "-c", "import ensurepip"], capture_output=True).returncode == 0:
            return Path(file)
    return None


PYTHONS = {minor: found for minor in MINORS if (found := python(minor))}


def environment(path: Path) -> dict[str, str]:
    """The environment of a program that finds nothing but what is in the folder `path`."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "KONTUR", "VIRTUAL"))}
    return kept | {"PATH": str(path), "MPLBACKEND": "Agg"}


def call(*command: object, env: Mapping[str, str], cwd: Path) -> str:
    """Output of a program that has to succeed."""
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, env=env, cwd=cwd)
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@dataclass(frozen=True)
class Installed:
    """The package in an environment of its own: the folder of its programs, and an empty folder to work in."""

    programs: Path
    folder: Path

    def kontur(self, *arguments: str) -> str:
        """Output of the command line, which has no compiler and nothing else of this machine."""
        return call(self.programs / "kontur", *arguments, env=environment(self.programs), cwd=self.folder)


@contextmanager
def installed(source: Path, minor: int, path: Path, *options: str, extras: str = "") -> Iterator[Installed]:
    """`source` with `extras` in an empty environment, where `pip` finds what is in the folder `path` only."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name, "work")
        folder.mkdir()
        call(PYTHONS[minor], "-m", "venv", Path(name, "env"), env=environment(path), cwd=folder)
        programs = Path(name, "env", "bin")
        call(programs / "pip", "install", "--quiet", *options, f"{source}{extras}", env=environment(path), cwd=folder)
        yield Installed(programs, folder)


def check_it_works(package: Installed) -> None:
    """The demo, in process, with its report and logs; and the drive as a process of its own."""
    package.kontur("demo")
    made = {file.name for file in (package.folder / "kontur-demo").iterdir()}
    assert {"report.html", "summary.json", "ccu.csv", "ccu.mf4"} <= made
    figures = json.loads((package.folder / "kontur-demo" / "summary.json").read_text())
    assert figures["ccu"]["mean_um"] < figures["track"]["mean_um"]
    assert json.loads(package.kontur("bench", "stream", "--knots", "2000", "--json"))["error"] is None
    for num in ("fix", "chk"):
        assert json.loads(package.kontur("info", "--num", num, "--json"))["num"].startswith(num)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The source package and, made of it, the wheel, by the suffixes of their names."""
    out = tmp_path_factory.mktemp("built")
    call(sys.executable, "-m", "build", "--outdir", out, ROOT, env=os.environ, cwd=out)
    return {file.suffix: file for file in out.iterdir()}


@pytest.fixture
def nothing(tmp_path: Path) -> Path:
    """A folder without any program."""
    folder = tmp_path / "nothing"
    folder.mkdir()
    return folder


@pytest.fixture
def compiler(tmp_path: Path) -> Path:
    """A folder with a C compiler and nothing else."""
    folder = tmp_path / "compiler"
    folder.mkdir()
    for name in COMPILER:
        found = shutil.which(name)
        assert found, f"{name} is not there; apt-get install gcc"
        (folder / name).symlink_to(found)
    return folder


def test_wheel_has_the_tag_of_its_platform_and_everything_that_is_needed(built: dict[str, Path]) -> None:
    wheel = zipfile.ZipFile(built[".whl"])
    assert "py3-none-linux_" in built[".whl"].name
    assert {name for name in wheel.namelist() if name.startswith("kontur/lib/")} == LIBRARIES
    examples = (file for file in (ROOT / "examples").rglob("*") if file.is_file() and file.suffix != ".pyc")
    assert {f"kontur/{file.relative_to(ROOT)}" for file in examples} <= set(wheel.namelist())
    assert {
        "kontur/kontur.eds", "kontur/kontur-units.eds", "kontur/py.typed", "kontur/machines/table1.toml",
        "kontur/live/page.html", "kontur/report/closer.js",
    } <= set(wheel.namelist())  # fmt: skip


def test_wheel_has_no_multiply_add_which_older_processors_lack(built: dict[str, Path], tmp_path: Path) -> None:
    library = zipfile.ZipFile(built[".whl"]).extract("kontur/lib/libkontur_f32.so", tmp_path)
    code = call("objdump", "-d", "--no-show-raw-insn", library, env=os.environ, cwd=tmp_path)
    assert "servo_step" in code
    assert "vfmadd" not in code


@pytest.mark.parametrize("minor", MINORS, ids="3.{}".format)
def test_wheel_installs_without_a_compiler_and_runs_the_demo_in_any_folder(
    minor: int, built: dict[str, Path], nothing: Path
) -> None:
    if minor not in PYTHONS:
        pytest.skip(f"this machine has no Python 3.{minor}")
    with installed(built[".whl"], minor, nothing, "--only-binary", ":all:") as package:
        check_it_works(package)


@pytest.mark.parametrize(
    ("what", "minor"),
    [("sdist", min(PYTHONS)), ("checkout", max(PYTHONS))],
    ids=[f"sdist-3.{min(PYTHONS)}", f"checkout-3.{max(PYTHONS)}"],
)
def test_source_installs_with_a_compiler_alone_and_runs_the_demo_in_any_folder(
    what: str, minor: int, built: dict[str, Path], compiler: Path
) -> None:
    with installed(ROOT if what == "checkout" else built[".gz"], minor, compiler) as package:
        check_it_works(package)


def test_the_extra_sweep_is_enough_for_parquet_and_for_a_dask_cluster(built: dict[str, Path], nothing: Path) -> None:
    with installed(built[".whl"], max(PYTHONS), nothing, "--only-binary", ":all:", extras="[sweep]") as package:
        (package.folder / "sweep.toml").write_text("radius = 1\nfeed = 50\nseed = [1, 2]\n")
        package.kontur("sweep", "sweep.toml", "-o", "a.csv")
        assert (package.folder / "a.parquet").read_bytes().startswith(b"PAR1")
        program = f"""
import distributed, subprocess
if __name__ == "__main__":
    with distributed.LocalCluster(n_workers=1, dashboard_address=None) as cluster:
        command = [{str(package.programs / "kontur")!r}, "sweep", "sweep.toml", "-o", "b.csv", "--workers"]
        subprocess.run([*command, cluster.scheduler_address], check=True)
"""
        (package.folder / "cluster.py").write_text(program)
        call(package.programs / "python", "cluster.py", env=environment(package.programs), cwd=package.folder)
        assert (package.folder / "b.csv").read_bytes() == (package.folder / "a.csv").read_bytes()
