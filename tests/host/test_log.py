# SPDX-License-Identifier: Apache-2.0
"""Logs: what is written is read again, equal runs give equal bytes, and a bad file is named with its line."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF
from click.testing import CliRunner
from made_runs import made_run

from kontur.cli import main
from kontur.errors import FileError, LogError
from kontur.runs import log, sample

SUFFIXES = (".csv", ".mf4")


def test_csv_gives_back_meta_and_columns_to_the_digits_of_the_table(tmp_path: Path) -> None:
    run = made_run(rows=100)
    log.write(run, tmp_path / "a.csv")
    again = log.read(tmp_path / "a.csv")
    assert again.meta == run.meta
    assert list(again.columns) == list(run.columns)
    for column in (column for column in log.COLUMNS if column.name not in log.RANGE):
        np.testing.assert_allclose(
            again.columns[column.name], run.columns[column.name], rtol=0, atol=0.5000001 * 10.0**-column.digits
        )


def test_mf4_gives_back_meta_and_columns_exactly(tmp_path: Path) -> None:
    run = made_run(rows=100, program='5 < 6 & "7"')
    log.write(run, tmp_path / "a.mf4")
    again = log.read(tmp_path / "a.mf4")
    assert again.meta == run.meta
    for name, values in run.columns.items():
        np.testing.assert_array_equal(again.columns[name], values)


def test_mf4_is_one_group_with_units_for_any_reader(tmp_path: Path) -> None:
    log.write(made_run(rows=10), tmp_path / "a.mf4")
    with MDF(tmp_path / "a.mf4") as mdf:
        assert len(mdf.groups) == 1
        assert mdf.get("true_contour_error_um").unit == "um"
        assert mdf.get("force_x_N").unit == "N"
        assert list(mdf.get("tick").timestamps[:3]) == [0.0, 0.001, 0.002]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_equal_runs_give_equal_bytes_at_any_time_of_day(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    log.write(made_run(rows=50), tmp_path / f"a{suffix}")
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 12345.0)
    log.write(made_run(rows=50), tmp_path / f"b{suffix}")
    assert (tmp_path / f"a{suffix}").read_bytes() == (tmp_path / f"b{suffix}").read_bytes()


def test_csv_through_mf4_and_back_has_the_same_bytes(tmp_path: Path) -> None:
    log.write(made_run(rows=50), tmp_path / "a.csv")
    runner = CliRunner()
    for source, target in (("a.csv", "b.mf4"), ("b.mf4", "c.csv")):
        assert runner.invoke(main, ["log", "convert", str(tmp_path / source), str(tmp_path / target)]).exit_code == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "c.csv").read_bytes()


def test_an_unknown_value_is_an_empty_cell(tmp_path: Path) -> None:
    text = log.csv_text(made_run(rows=3)).splitlines()
    force = next(line for line in text if line.startswith("tick")).split(",").index("force_x_N")
    assert [line.split(",")[force] for line in text if line[0].isdigit()] == ["-0.0", "", "-0.2"]


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_columns_that_are_not_required_may_be_missing(tmp_path: Path, suffix: str) -> None:
    full = made_run(rows=20)
    few = log.RunLog(
        full.meta, {name: full.columns[name] for name in ("time_s", "tick", "contour_error_um", "tangential_error_um")}
    )
    log.write(few, tmp_path / f"a{suffix}")
    again = log.read(tmp_path / f"a{suffix}")
    assert list(again.columns) == ["tick", "time_s", "tangential_error_um", "contour_error_um"]
    assert not again.has_truth


def csv_lines() -> list[str]:
    """A log as it was written before logs grew: all of its head stands before the rows."""
    lines = log.csv_text(made_run(rows=5)).splitlines()
    head = [line for line in lines if line.startswith("#")]
    return [*head, *(line for line in lines if not line.startswith("#"))]


@pytest.mark.parametrize(
    ("spoil", "line", "says"),
    [
        (lambda lines: ["# something else", *lines[1:]], 1, "not a log of kontur"),
        (lambda lines: [lines[0], "# seed: one", *lines[1:]], 2, "not JSON"),
        (lambda lines: lines[:4], 4, "before the header row"),
        (lambda lines: [*lines[:-1], lines[-1] + ",1"], None, "23 cells where the header row has 22"),
        (lambda lines: [*lines[:-1], lines[-1].replace("704,", "704x,")], None, "not a number"),
        (lambda lines: [*lines, lines[-1]], None, "do not increase"),
        (
            lambda lines: [line.replace("true_contour_error_um", "contur_um") for line in lines],
            None,
            "contur_um is unknown",
        ),
        (lambda lines: [line.replace("contour_error_um", "position_x_mm") for line in lines], None, "twice"),
        (lambda lines: [line for line in lines if "controller" not in line], None, "lacks controller"),
        (lambda lines: [line.replace("interrupted", "late") for line in lines], None, "'late'"),
    ],
)
def test_a_bad_csv_is_refused_with_file_and_reason(tmp_path: Path, spoil, line: int | None, says: str) -> None:  # type: ignore[no-untyped-def]
    file = tmp_path / "bad.csv"
    file.write_text("\n".join(spoil(csv_lines())) + "\n")
    with pytest.raises(FileError, match=says) as caught:
        log.read(file)
    assert str(file) in str(caught.value)
    assert caught.value.line is not None
    if line is not None:
        assert caught.value.line == line


def test_a_cell_that_is_no_number_is_named_by_its_line(tmp_path: Path) -> None:
    lines = csv_lines()
    header = next(i for i, line in enumerate(lines) if line.startswith("tick"))
    lines[header + 3] = lines[header + 3].replace("702,", "7o2,")
    (tmp_path / "bad.csv").write_text("\n".join(lines))
    with pytest.raises(FileError) as caught:
        log.read(tmp_path / "bad.csv")
    assert caught.value.line == header + 4


@pytest.mark.parametrize(
    ("pattern", "put", "says"),
    [
        (r"# status: .*", '# status: "late"', "'late'"),
        (r"# seed: .*", '# seed: "one"', "seed is no number"),
        (r"702,", "nan,", "do not increase"),
        (r"702,", "701,", "do not increase"),
        (r"702,0.002000,[^,]*", "702,0.002000,1e13", "has a value beyond"),
    ],
)
@pytest.mark.parametrize("rows", [1, 1 << 14])
def test_a_value_that_cannot_be_is_named_by_its_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: int, pattern: str, put: str, says: str
) -> None:
    """Also where it begins another table of the rows that are read at once."""
    monkeypatch.setattr(log, "_ROWS", rows)
    lines = log.csv_text(made_run(rows=5)).splitlines()
    (at,) = (i for i, line in enumerate(lines) if re.match(pattern, line))
    lines[at] = re.sub(pattern, put, lines[at])
    (tmp_path / "bad.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(FileError, match=says) as caught:
        log.read(tmp_path / "bad.csv")
    assert caught.value.line == at + 1


@pytest.mark.parametrize("content", [b"", b"no MDF", b"\xff\xfe\x00", b"MDF     4.10    " + bytes(200)])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_is_no_log_is_refused(tmp_path: Path, suffix: str, content: bytes) -> None:
    file = tmp_path / f"bad{suffix}"
    file.write_bytes(content)
    with pytest.raises(FileError, match=file.name):
        log.read(file)


def test_a_truncated_mf4_is_refused_without_a_traceback(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    log.write(made_run(), tmp_path / "a.mf4")
    whole = (tmp_path / "a.mf4").read_bytes()
    for size in (100, 5000, len(whole) // 2, len(whole) - 100):
        (tmp_path / "b.mf4").write_bytes(whole[:size])
        with pytest.raises(FileError, match=r"b\.mf4"):
            log.read(tmp_path / "b.mf4")
    assert capfd.readouterr().err == ""


def test_an_mf4_of_something_else_is_refused(tmp_path: Path) -> None:
    with MDF() as mdf:
        mdf.save(tmp_path / "other.mf4")
    with pytest.raises(FileError, match="not a log of kontur"):
        log.read(tmp_path / "other.mf4")


def test_a_missing_file_a_foreign_suffix_and_a_missing_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"none\.csv"):
        log.read(tmp_path / "none.csv")
    with pytest.raises(LogError, match=r"\.csv or \.mf4"):
        log.write(made_run(rows=5), tmp_path / "a.txt")
    with pytest.raises(FileError, match="cannot be written"):
        log.write(made_run(rows=5), tmp_path / "none" / "a.csv")


def test_a_log_that_cannot_be_is_refused_when_it_is_made() -> None:
    run = made_run(rows=5)
    with pytest.raises(LogError, match="status"):
        log.RunLog({key: value for key, value in run.meta.items() if key != "status"}, run.columns)
    with pytest.raises(LogError, match="length"):
        log.RunLog(run.meta, {**run.columns, "position_x_mm": np.zeros(4)})
    with pytest.raises(LogError, match="contour_error_um"):
        log.RunLog(run.meta, {name: values for name, values in run.columns.items() if name != "contour_error_um"})


def test_log_show_says_what_was_run_and_how_large_it_got(tmp_path: Path) -> None:
    file = tmp_path / "a.csv"
    log.write(made_run(rows=1500), file)
    shown = CliRunner().invoke(main, ["log", "show", str(file)])
    assert shown.exit_code == 0
    assert "interrupted" in shown.output
    assert "2.000000" in shown.output  # the peak
    result = json.loads(CliRunner().invoke(main, ["log", "show", "--json", str(file)]).output)
    assert result["rows"] == 1500
    assert result["meta"]["controller"] == "ccu"
    assert result["columns"]["true_contour_error_um"]["max"] == 2.0
    assert result["columns"]["force_x_N"]["rows"] == 750


def test_a_bad_file_ends_the_command_with_one_message(tmp_path: Path) -> None:
    result = CliRunner().invoke(main, ["log", "show", str(tmp_path / "none.csv")])
    assert result.exit_code != 0
    assert result.output.startswith("Error: ")
    assert len(result.output.splitlines()) == 1


def test_a_log_that_is_cut_anywhere_is_read_up_to_its_last_whole_row(tmp_path: Path) -> None:
    run = made_run(rows=40)
    text = log.csv_text(run)
    file = tmp_path / "cut.csv"
    first = text.index("\n", text.index("\ntick,") + 1) + 1
    end = text.index("# status")
    for size in range(first, end, 37):
        file.write_text(text[:size])
        found = log.read(file)
        assert found.meta["status"] == "killed"
        assert len(found) == text[first:size].count("\n")
        np.testing.assert_allclose(found.columns["tick"], run.columns["tick"][: len(found)])


def test_a_killed_log_is_mended_into_one_that_says_so(tmp_path: Path) -> None:
    text = log.csv_text(made_run(rows=40))
    (tmp_path / "a-running.csv").write_text(text[: text.index("# status") - 20])
    runner = CliRunner()
    for target in ("a.csv", "a.mf4"):
        result = runner.invoke(main, ["log", "convert", str(tmp_path / "a-running.csv"), str(tmp_path / target)])
        assert result.exit_code == 0, result.output
        assert log.read(tmp_path / target).meta["status"] == "killed"
        assert len(log.read(tmp_path / target)) == 39
    assert '# status: "killed"' in (tmp_path / "a.csv").read_text()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_long_log_is_thinned_and_keeps_extremes_and_means(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sample, "ROWS_MAX", 1000)
    run = made_run(rows=1500)
    log.write(run, tmp_path / f"a{suffix}")
    whole = log.read(tmp_path / f"a{suffix}")
    thinned = log.read(tmp_path / f"a{suffix}", thinned=True)
    assert whole.even is None
    assert thinned.even is not None
    assert len(thinned) <= 1000
    assert thinned.meta == whole.meta
    for name, values in whole.columns.items():
        assert np.nanmax(thinned.columns[name]) == np.nanmax(values)
        assert np.nanmin(thinned.columns[name]) == np.nanmin(values)
        assert thinned.total(name).count == whole.total(name).count
        assert thinned.total(name).mean_abs == pytest.approx(whole.total(name).mean_abs)
        assert thinned.total(name).rms == pytest.approx(whole.total(name).rms)
    even_s = thinned.columns["time_s"][thinned.even]
    np.testing.assert_allclose(np.diff(even_s), np.diff(even_s)[0])
    shown = CliRunner().invoke(main, ["log", "show", "--json", str(tmp_path / f"a{suffix}")])
    assert json.loads(shown.output)["rows"] == 1500
