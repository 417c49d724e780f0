# SPDX-License-Identifier: Apache-2.0
"""The table of faults: what is committed is what it generates, every row is tested, and its mistakes are caught."""

import re
import sys
from pathlib import Path

import generate_faults
import pytest
from source import SourceError

from kontur.can.emcy import describe_emcy, faults

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / generate_faults.SOURCE

ROWS = generate_faults.load(SOURCE)
NAMES = [row.name for row in ROWS]


FILES = sorted((ROOT / "tests" / "unit").glob("test_faults_*.c"))
CHECKS = ("expect_reaction", "expect_clearing")


def checked_rows() -> set[str]:
    """Rows of which a test that is run, and is named after the row, checks what the row promises."""
    rows = set()
    for file in FILES:
        text = file.read_text("utf-8")
        for test, body in re.findall(r"^static void test_(\w+)\(void\)\n\{\n(.*?)^\}$", text, re.DOTALL | re.MULTILINE):
            if f"RUN_TEST(test_{test})" in text:
                found = [set(re.findall(rf"\b{check}\(ROW_(\w+)", body)) for check in CHECKS]
                rows |= {row.lower() for row in set.intersection(*found) if test.startswith(f"{row.lower()}_")}
    return rows


def without_test(names: list[str]) -> list[str]:
    return [name for name in names if name not in checked_rows()]


def test_every_row_has_a_test_of_all_that_it_promises() -> None:
    assert without_test(NAMES) == []


def test_new_row_without_a_test_is_found() -> None:
    assert without_test([*NAMES, "encoder_dirty"]) == ["encoder_dirty"]


def test_what_is_committed_is_what_the_source_generates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    committed = {"--docs": ROOT / "docs" / "faults.md", "--json": ROOT / "host" / "kontur" / "fault_table.json"}
    options = [word for option, path in committed.items() for word in (option, str(tmp_path / path.name))]
    monkeypatch.setattr(sys, "argv", ["generate_faults.py", str(tmp_path), *options])
    assert generate_faults.main() == 0
    for path in committed.values():
        assert (tmp_path / path.name).read_text("utf-8") == path.read_text("utf-8"), f"run make lib: {path.name}"


def test_host_tells_fault_cause_and_remedy_of_every_row() -> None:
    assert set(faults()) == {row.emcy for row in ROWS}
    for row in ROWS:
        text = describe_emcy(row.emcy)
        assert text.startswith(f"{row.emcy:04X}h: {row.fault}")
        assert row.cause in text
        assert row.remedy in text


def test_unknown_code_is_reported_as_such() -> None:
    assert describe_emcy(0x1234).startswith("1234h: unknown")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("emcy = 0x8400", "emcy = 0x8611", "8611h is the code of another row"),
        ('reaction = "path stop"', 'reaction = "hope"', "reaction is one of"),
        ('remedy = "see the amplifier\'s display and its cables"', "", "amplifier: .*remedy"),
        ("[fault.travel]", "[fault.Travel]", "Travel: a name is lower-case words"),
        (
            'remedy = "see the amplifier\'s display and its cables"',
            'remedy = "m\u00f6ve"',
            "faults.toml: 'ascii' codec",
        ),
        ("emcy = 0x8612", "emcy = 0", "travel: emcy is a code of 16 bits"),
        ("emcy = 0x8612", "emcy = 0x8612\nnode = true", "travel: what the node raises stops no axis"),
        ('delay = "3 control periods"', 'delay = "soon"', "overrun: delay counts control periods or ms"),
    ],
)
def test_mistake_in_the_table_is_refused_with_the_name_of_its_row(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    old: str,
    new: str,
    message: str,
) -> None:
    text = SOURCE.read_text("utf-8")
    assert old in text
    (tmp_path / "faults.toml").write_text(text.replace(old, new, 1), "utf-8")
    monkeypatch.setattr(generate_faults, "SOURCE", str(tmp_path / "faults.toml"))
    monkeypatch.setattr(sys, "argv", ["generate_faults.py", str(tmp_path / "out")])
    assert generate_faults.main() == 1
    assert re.search(message, capsys.readouterr().err)


def test_more_rows_than_a_word_has_bits_are_refused(tmp_path: Path) -> None:
    rows = "".join(
        f'[fault.{"a" * n}]\nfault="f"\ncause="c"\ndetection="d"\ndelay="1 ms"\nreaction="disable"\nemcy={n}\n'
        'register="generic"\nremedy="r"\n'
        for n in range(1, 34)
    )
    (tmp_path / "faults.toml").write_text(rows, "utf-8")
    with pytest.raises(SourceError, match="more than 32 rows"):
        generate_faults.load(tmp_path / "faults.toml")
