# SPDX-License-Identifier: Apache-2.0
"""`kontur bench bus` and `kontur bench stream`."""

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from kontur.can import EDS, bus_load
from kontur.cli import main
from kontur.sim import process as sim_process

IN_PROCESS = ("-i", "kontur", "-c", "sim")


def bench(*arguments: str) -> dict[str, Any]:
    result = CliRunner().invoke(main, ["bench", *arguments, "--json"])
    assert result.exit_code == 0, result.output
    found: dict[str, Any] = json.loads(result.stdout)
    return found


# --- bench bus ---


@pytest.mark.parametrize(("data_bytes", "bits"), [(8, 135), (0, 55), (1, 65), (4, 95)])
def test_frame_is_as_long_as_the_literature_has_it(data_bytes: int, bits: int) -> None:
    assert bus_load.worst_case_bits(data_bytes) == bits


def test_default_stream_with_telemetry_takes_no_more_than_45_percent_of_the_bus() -> None:
    result = bench("bus")
    shares = {frame["name"]: frame["share"] for frame in result["frames"]}
    assert result["share"] == pytest.approx(sum(shares.values()))
    assert result["share"] <= 0.45
    assert shares["RPDO2"] == pytest.approx(0.135)
    assert {name for name in shares if name.startswith("TPDO")} == {"TPDO1", "TPDO2", "TPDO3", "TPDO4", "TPDO5"}


def test_share_follows_the_event_timers_and_mappings_of_the_eds(tmp_path: Path) -> None:
    text = EDS.read_text()
    section = text.index("[1803sub5]")
    changed = tmp_path / "changed.eds"
    changed.write_text(text[:section] + text[section:].replace("DefaultValue=0xA", "DefaultValue=0x1", 1))
    more = sum(load.share for load in bus_load.loads(eds=changed)) - sum(load.share for load in bus_load.loads())
    assert more == pytest.approx(900 * 135 / 1e6)


def test_half_the_bit_rate_is_twice_the_share() -> None:
    assert bench("bus", "-b", "500000")["share"] == pytest.approx(2 * bench("bus")["share"])


# --- bench stream ---


def test_clean_bus_loses_no_knot_and_sends_none_twice() -> None:
    result = bench("stream", "--knots", "5000", *IN_PROCESS)
    assert {"knots", "lost", "retransmitted", "underruns", "knots_per_s", "host_cpu_us_per_frame"} < set(result)
    assert result["knots"] == 5000
    assert (result["lost"], result["retransmitted"], result["underruns"]) == (0, 0, 0)
    assert result["checksum_ok"] is True
    assert result["error"] is None


def test_bad_bus_loses_no_knot_and_its_faults_are_reported() -> None:
    result = bench("stream", "--knots", "3000", "--bus-faults", "drop=0.02,flip=0.005,seed=2", *IN_PROCESS)
    assert (result["lost"], result["underruns"], result["checksum_ok"]) == (0, 0, True)
    assert result["retransmitted"] > 0
    assert result["faults"]["to_drive"]["lost"] > 0


@pytest.mark.skipif(not sim_process.PROGRAM.exists(), reason="kontur-sim is not built; run `make lib`")
def test_without_bus_options_the_drive_is_a_process_paced_by_sync() -> None:
    result = bench("stream", "--knots", "1000")
    assert result["bus"].startswith("slcan socket://")
    assert (result["lost"], result["underruns"], result["checksum_ok"]) == (0, 0, True)


def test_stream_that_fails_is_an_error_with_its_figures() -> None:
    arguments = ["bench", "stream", "--knots", "3000", "--bus-faults", "bus_off=0.001,seed=1", *IN_PROCESS, "--json"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code != 0
    assert "8130h" in result.output


def test_fault_that_does_not_exist_is_refused() -> None:
    result = CliRunner().invoke(main, ["info", "--bus-faults", "drop=0.1,melt=0.1"])
    assert result.exit_code == 2
    assert "'melt=0.1' is not NAME=VALUE" in result.output
