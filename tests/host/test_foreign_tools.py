# SPDX-License-Identifier: Apache-2.0
"""EDS and DBC in the hands of tools that others wrote: dcf-tools (Lely), which ROS 2 generates its masters with, and
canmatrix, which converts databases of CAN."""

from __future__ import annotations

import configparser
import logging
import subprocess
import sys
from pathlib import Path

import pytest

EDS = Path(__file__).resolve().parents[2] / "host" / "kontur" / "kontur.eds"
BUS = """\
master:
  node_id: 127
  baudrate: 1000
  heartbeat_consumer: true
kontur:
  dcf: "{eds}"
  node_id: 1
  heartbeat_producer: 100
"""


def _run(tool: str, *arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    program = Path(sys.executable).with_name(tool)
    if not program.exists():
        pytest.skip(f"{tool} is not there: pip install dcf-tools 'setuptools<81'")
    return subprocess.run([program, *arguments], cwd=folder, capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize("options", [(), ("-n", "31")])
def test_dcfchk_accepts_the_eds(tmp_path: Path, options: tuple[str, ...]) -> None:
    done = _run("dcfchk", *options, str(EDS), folder=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_domain_has_no_keys_that_it_has_not_in_cia_306() -> None:
    """npm's canopen reads no EDS that says whether a domain can be mapped."""
    eds = configparser.ConfigParser()
    eds.read(EDS)
    domains = [section for section in eds.values() if section.get("ObjectType") == "0x2"]
    assert domains
    assert not {"pdomapping", "lowlimit", "highlimit"} & {key for section in domains for key in section}


def test_dcfgen_makes_a_master_of_the_eds_without_an_option(tmp_path: Path) -> None:
    (tmp_path / "bus.yml").write_text(BUS.format(eds=EDS))
    done = _run("dcfgen", "bus.yml", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "invalid" not in done.stderr
    assert (tmp_path / "master.dcf").stat().st_size > 0


@pytest.mark.parametrize("form", ["dbc", "kcd", "sym", "json", "arxml"])
def test_signs_of_the_dbc_survive_a_conversion(tmp_path: Path, form: str) -> None:
    formats = pytest.importorskip("canmatrix.formats", reason="canmatrix is not there: pip install canmatrix")
    logging.getLogger("canmatrix").setLevel(logging.CRITICAL)
    there = formats.loadp_flat(str(EDS.with_suffix(".dbc")))
    file = tmp_path / f"kontur.{form}"
    formats.dumpp({"": there}, str(file))
    back = formats.loadp_flat(str(file))

    def signs(database: object) -> dict[tuple[int, int], bool]:
        """By identifier and place; the bytes of an SDO, which are one of several kinds, apart."""
        return {
            (frame.arbitration_id.id, signal.start_bit): signal.is_signed
            for frame in database.frames  # type: ignore[attr-defined]
            for signal in frame.signals
            if not 0x580 <= frame.arbitration_id.id < 0x680
        }

    assert sum(signs(there).values()) >= 8
    assert signs(back) == signs(there)
