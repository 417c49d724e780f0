# SPDX-License-Identifier: Apache-2.0
"""`tools/cost.py`: what may get worse and what may not, and the worst case of a stack."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cost
import pytest
import stack

from kontur.drive.controllers import CONTROLLERS
from kontur.errors import InputError

BEFORE = {"m4-f32": {"ccu": {"mean": 1000, "worst": 2000}}, "image": {"stack": {"all": 1000}}}
LOG = "# Changelog\n\n## 2 (unreleased)\n\n- News.{}\n\n## 1\n\n- m4-f32 ccu mean 9000 worst 9000\n"


def one_cost(mean: int, worst: int = 2000, depth: int = 1000) -> cost.Cost:
    return {"m4-f32": {"ccu": {"mean": mean, "worst": worst}}, "image": {"stack": {"all": depth}}}


@pytest.mark.parametrize("now", [one_cost(1000), one_cost(1030, 2060, 1030), one_cost(1, 1, 1)])
def test_up_to_3_percent_more_is_no_finding(now: cost.Cost) -> None:
    assert cost.findings(now, BEFORE, LOG.format("")) == []


def test_more_than_3_percent_is_a_finding_that_says_what_to_write() -> None:
    (finding,) = cost.findings(one_cost(1031, 2061), BEFORE, LOG.format(""))
    assert "m4-f32 ccu: mean 1031 worst 2061; was mean 1000 worst 2000" in finding
    (words,) = re.findall(r'with the words "(.*)"', finding)
    assert cost.findings(one_cost(1031, 2061), BEFORE, LOG.format(f" The tick does more: {words}.")) == []
    (finding,) = cost.findings(one_cost(1000, depth=1031), BEFORE, LOG.format(""))
    assert finding.startswith("image stack: all 1031")


def test_changelog_allows_what_it_names_and_no_more() -> None:
    named = LOG.format(" More: m4-f32 ccu mean 1100,\n  image stack all 1200.")
    assert cost.findings(one_cost(1133, depth=1236), BEFORE, named) == []
    assert len(cost.findings(one_cost(1134, depth=1236), BEFORE, named)) == 1
    assert len(cost.findings(one_cost(1133, depth=1237), BEFORE, named)) == 1
    assert len(cost.findings(one_cost(1133, worst=2061), BEFORE, named)) == 1


def test_figure_without_a_baseline_is_a_finding() -> None:
    now = {**one_cost(1000), "m9-f32": {"ccu": {"mean": 1}}}
    assert cost.findings(now, BEFORE, LOG.format("")) == [
        "m9-f32 ccu mean: not in the baseline: run `tools/cost.py --write`"
    ]


def test_baseline_is_only_ever_lowered() -> None:
    assert cost.lower(one_cost(900, 2500), BEFORE) == one_cost(900, 2000)
    assert cost.lower(one_cost(900), {}) == one_cost(900)


def test_page_has_every_table_and_the_baseline_every_figure() -> None:
    page = cost.PAGE.read_text()
    for name in ("cost", "stages", "stack", "sections"):
        assert re.search(
            rf"<!-- {name}: made by `tools/cost.py --write` -->\n\|(.|\n)*\|\n<!-- {name}: end -->\n", page
        ), name
    baseline = json.loads(cost.BASELINE.read_text())
    for target in cost.MACHINES:
        assert set(baseline[target]) == {*CONTROLLERS, "compensated"}
    assert set(baseline["image"]) == {"size", "stack", "drivers"}


# --- stack ---

CI = """graph: {{ title: "firmware/drive/a.c"
node: {{ title: "reset_irq" label: "reset_irq\\na.c:1:1\\n8 bytes (static)" }}
node: {{ title: "firmware/drive/a.c:work" label: "work\\na.c:2:1\\n100 bytes ({bound})" }}
node: {{ title: "small" label: "small\\na.c:3:1\\n16 bytes (static)" }}
edge: {{ sourcename: "reset_irq" targetname: "small" label: "a.c:1:1" }}
edge: {{ sourcename: "reset_irq" targetname: "__indirect_call" label: "firmware/drive/a.c:1:1" }}
edge: {{ sourcename: "small" targetname: "{small_calls}" label: "a.c:1:1" }}
}}
"""


def graph(folder: Path, monkeypatch: pytest.MonkeyPatch, **text: str) -> stack.Graph:
    monkeypatch.setattr(stack, "_disassembled", lambda elf, tools: stack.Graph({"memcpy": 4}, {"memcpy": set()}))
    source = folder / "firmware/drive/a.c"
    source.parent.mkdir(parents=True)
    source.write_text(text.pop("source", "hal->work(hal->ctx);\n.work = work,\n"))
    (folder / "a.ci").write_text(CI.format(**{"bound": "static", "small_calls": "memcpy", **text}))
    return stack.read(folder, folder, folder / "a.elf", "")


def test_deepest_call_counts_those_through_pointers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = graph(tmp_path, monkeypatch)
    assert found.deepest("reset_irq") == (108, ["reset_irq", "firmware/drive/a.c:work"])
    assert found.deepest("small") == (20, ["small", "memcpy"])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ({"small_calls": "reset_irq"}, "recursion, reset_irq -> small -> reset_irq"),
        ({"small_calls": "elsewhere"}, "nothing is known of elsewhere"),
        ({"bound": "dynamic"}, "the frame of firmware/drive/a.c:work has no bound"),
        ({"source": "call_it();\n"}, "targets are not known: call_it"),
    ],
)
def test_what_has_no_worst_case_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: dict[str, str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        graph(tmp_path, monkeypatch, **text).deepest("reset_irq")


def test_nothing_built_is_an_error_that_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="make firmware"):
        stack.read(tmp_path, tmp_path, tmp_path / "a.elf", "")


@pytest.mark.parametrize("name", ["all", "crash"])
def test_stack_that_leaves_less_than_15_percent_of_its_reserve_is_a_finding(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    baseline = tmp_path / "cost.json"
    baseline.write_text(json.dumps(BEFORE))
    monkeypatch.setattr(cost, "BASELINE", baseline)
    result = {"cost": one_cost(1), "stack": {"all": 850, "crash": 51}, "reserve": {"all": 1000, "crash": 60}}
    assert cost.check(result) == []
    result["reserve"][name] -= 1
    (finding,) = cost.check(result)
    assert finding.startswith(f"stack, {name}: ")


@pytest.mark.parametrize(
    ("mnemonic", "operands", "cycles"),
    [
        ("adds", "r0, #1", 1),
        ("vadd.f32", "s0, s1, s2", 1),
        ("ldr.w", "r0, [r1, #4]", 2),
        ("vldr", "s0, [r0]", 2),
        ("ldrd", "r0, r1, [r2]", 3),
        ("push", "{r4, r5, lr}", 4),
        ("stmdb", "sp!, {r4-r7, lr}", 6),
        ("vpush", "{d8-d15}", 9),
        ("vfma.f32", "s0, s1, s2", 3),
        ("vdiv.f32", "s0, s1, s2", 14),
        ("udiv", "r0, r1, r2", 12),
        ("beq.n", "8000100", 1),
    ],
)
def test_cycles_of_an_instruction_are_those_of_the_cortex_m4(mnemonic: str, operands: str, cycles: int) -> None:
    assert cost.cycles_of(mnemonic, operands) == cycles


def test_the_model_of_cycles_is_shown_and_not_held() -> None:
    estimated = {"m4-f32": {"ccu": {"mean": 1, "worst": 1, "model_mean": 3520, "model_worst": 4033}}}
    before = {"m4-f32": {"ccu": {"mean": 1, "worst": 1}}}
    assert cost.findings(estimated, before, "# C\n\n## 1\n") == []
    assert cost.lower(estimated, before) == before
