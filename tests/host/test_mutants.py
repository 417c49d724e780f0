# SPDX-License-Identifier: Apache-2.0
"""tests/unit/mutants.py: which faults it puts into C, and that the list of equivalent ones is true."""

from __future__ import annotations

import sys
from pathlib import Path

UNIT = Path(__file__).resolve().parents[1] / "unit"
sys.path.insert(0, str(UNIT))
import mutants  # noqa: E402


def faults(line: str, head: str = "int f(int i)") -> set[str]:
    """The line with each fault in it."""
    return {m.mutant for m in mutants.mutants_of(f"{head}\n{{\n    {line}\n}}\n".encode(), "a.c") if m.line == 3}


def test_comparison_is_moved_by_one_and_turned_round() -> None:
    assert faults("return a < b;") == {"return a <= b;", "return a >= b;"}


def test_axis_of_an_index_and_of_a_name_is_swapped() -> None:
    assert faults("return a[i];") == {"return a[1 - i];"}
    assert faults("return a[k];") == set()
    assert faults("return q.x + mass_y;") >= {"return q.y + mass_y;", "return q.x + mass_x;"}


def test_index_of_a_loop_over_something_else_than_axes_is_not_swapped() -> None:
    assert "{ s = a[1 - i]; }" not in " ".join(faults("for (int i = 0; i < 9; i++) { s = a[i]; }"))
    assert any("a[1 - i]" in fault for fault in faults("for (int i = 0; i < 2; i++) { s = a[i]; }", "int f(void)"))


def test_condition_is_negated_and_statement_and_field_are_left_out() -> None:
    assert "if (!((a))) { g(); }" in faults("if (a) { g(); }")
    assert "if (a) { ; }" in faults("if (a) { g(); }")
    assert "return (struct s){.a = 1, };" in faults("return (struct s){.a = 1, .b = c};")


def test_arithmetic_of_num_counts_as_arithmetic() -> None:
    assert faults("return n_add(a, b);") == {"return n_sub(a, b);"}


def test_a_mutant_changes_its_place_alone() -> None:
    code = b"int f(void)\n{\n    return 1;\n}\n"
    assert {m.applied(code) for m in mutants.mutants_of(code, "a.c")} == {
        b"int f(void)\n{\n    return (1 + 1);\n}\n",
        b"int f(void)\n{\n    return (1 - 1);\n}\n",
    }


def test_each_entry_of_the_list_of_equivalent_mutants_fits_a_mutant() -> None:
    entries = mutants.tomllib.loads(mutants.EQUIVALENT.read_text()).get("equivalent", [])
    assert all(entry["reason"] for entry in entries)
    keys = {
        key
        for file in {e["file"] for e in entries}
        for m in mutants.mutants_of((mutants.ROOT / file).read_bytes(), file)
        for key in (m.key, m.line_key)
    }
    assert mutants.read_equivalent() <= keys
