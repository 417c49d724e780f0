# SPDX-License-Identifier: Apache-2.0
"""The sources keep to docs/architecture.md: rooms, arrows, contexts, the order of the drive step, the walks.

The page is the one source. This test reads its tables of rooms and its numbered lists of functions, and says what in
the sources is otherwise. source_graph.py finds what uses what.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest
from source_graph import CFile, CSources, calls, circles, python_arrows

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "architecture.md"
GENERATORS = {"generate_objects": "od", "generate_signals": ".", "generate_faults": "supervision"}  # and their folders
PARTS = {r"core/num_\w+": "core/num"}  # modules that count as parts of another one
_NAME = re.compile("`([^`]+)`")
CONTEXTS = {"tick", "background", "both", "wires"}
WALKS = ("The way of a setpoint", "The way of a controlword", "One tick")
# What a program need not load to talk to a real drive.
NOT_FOR_A_DRIVE = ("kontur.sim", "kontur.runs", "kontur.report", "kontur.cli", "matplotlib", "scipy", "cffi")


# --- what the page says -----------------------------------------------------------------------------------------------
def section(title: str) -> str:
    """The text below a heading, up to the next one of the same level or a higher one."""
    found = re.search(rf"^(##+) {re.escape(title)}\n(.*?)(?=^##?#? |\Z)", PAGE.read_text(), re.MULTILINE | re.DOTALL)
    assert found, f"docs/architecture.md has no section {title!r}"
    return found[2]


@dataclass(frozen=True)
class Room:
    """A row of a table of rooms. `both`: files, without suffix, of a room of the background that the tick uses, too."""

    context: str
    both: frozenset[str]
    may_include: frozenset[str]


def rooms(title: str) -> dict[str, Room]:
    """The rooms of a table, from the lowest to the highest; those of one row may include each other."""
    text = section(title)
    lists = {
        room: frozenset(_NAME.findall(files)) for room, files in re.findall("^- `([^`]+)`: (.+)", text, re.MULTILINE)
    }
    found: dict[str, Room] = {}
    for line in re.findall(r"^\| (`.*) \|$", text, re.MULTILINE):
        cells = line.split(" | ")
        names, listed = _NAME.findall(cells[0]), set(_NAME.findall(cells[-1]))
        allowed = set(found) - listed if cells[-1].startswith("all above") else listed
        wrong = allowed - set(found) - set(names)
        assert not wrong, f"{names}: a room may include rooms above it only, not {wrong}"
        for name in names:
            found[name] = Room(cells[1].split()[0], lists.get(name, frozenset()), frozenset(allowed | set(names)))
    assert found, f"no table of rooms in {title!r}"
    assert set(lists) <= set(found)
    return found


@dataclass(frozen=True)
class Step:
    """A function of a walk. `via`: how it reaches the next one where it does not call it: a word in its body and one in
    the next one's file. `called_by`: the earlier function that calls it, where that is not the one before."""

    file: str
    function: str
    via: tuple[str, str] | None
    called_by: str | None

    def __str__(self) -> str:
        return f"{self.file}:{self.function}"


def steps(title: str) -> list[Step]:
    """The functions of a numbered list."""
    found = []
    for item in re.findall(r"^\d+\. (.*?)(?=^\d+\. |^\S|\Z)", section(title) + "\n", re.MULTILINE | re.DOTALL):
        item = " ".join(item.split())
        place = re.match(r"`([\w/.]+):([\w.]+)`", item)
        assert place, f"{title}: an item does not begin with `file:function`: {item}"
        via = re.search(r"via (?:the \w+ )?`([^`]+)`(?: to `([^`]+)`)?", item)
        called_by = re.search(r"called by `(\w+)`", item)
        found.append(
            Step(place[1], place[2], via and (via[1], via[2] or via[1]), called_by and called_by[1])  # type: ignore[arg-type]
        )
    assert found, f"docs/architecture.md: {title!r} has no numbered list"
    return found


def nothing(found: Iterable[object]) -> None:
    """Fail with all that was found."""
    if lines := [str(one) for one in found]:
        pytest.fail("\n  ".join(["docs/architecture.md says otherwise:", *lines]), pytrace=False)


# --- what the sources are ---------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def sources(tmp_path_factory) -> CSources:
    """All C modules, those that are generated among them."""
    generated = tmp_path_factory.mktemp("gen")
    for tool, folder in GENERATORS.items():
        subprocess.run([sys.executable, ROOT / f"tools/{tool}.py", generated / folder], cwd=ROOT, check=True)
    for table in generated.rglob("*.c"):  # a module of its own: its types are of those who use the header
        table.rename(table.with_suffix(".c.c"))
    roots = {ROOT / "firmware": [ROOT / "firmware"], ROOT: [ROOT / "sim"], generated: [generated]}
    supplied = _NAME.findall(section("Firmware").rpartition("leaves")[2])
    return CSources(roots, PARTS, supplied)


def room_of(module: str, table: Mapping[str, Room]) -> str:
    """The room of a module: the longest folder of its path that is one."""
    folders = [module, *(parent.as_posix() for parent in Path(module).parents)]
    found = next((folder for folder in folders if folder in table), None)
    assert found, f"{module} is in no room of docs/architecture.md"
    return found


def forbidden(arrows: Mapping[str, set[str]], table: Mapping[str, Room]) -> list[str]:
    """Arrows between rooms that the page does not allow."""
    found = []
    for module, used in sorted(arrows.items()):
        room = room_of(module, table)
        for other in sorted(used):
            if room_of(other, table) not in table[room].may_include:
                found.append(f"{module} -> {other}")
    return found


def context_of(module: str, table: Mapping[str, Room]) -> str:
    """In which context a C module runs."""
    room = table[room_of(module, table)]
    return "both" if module.rpartition("/")[2] in room.both else room.context


@cache
def functions(file: str) -> dict[str, str]:
    """Bodies of the functions of a C or Python file; of a method the name is Class.method."""
    path = ROOT / file
    assert path.exists(), f"docs/architecture.md names {file}, which is not there"
    text = path.read_text()
    if path.suffix != ".py":
        return CFile.parse(text).functions

    def inside(body: list[ast.stmt], prefix: str) -> Iterator[tuple[str, str]]:
        for node in body:
            if isinstance(node, ast.FunctionDef):
                yield f"{prefix}{node.name}", "\n".join(ast.unparse(statement) for statement in node.body)
            elif isinstance(node, ast.ClassDef):
                yield from inside(node.body, f"{node.name}.")

    return dict(inside(ast.parse(text).body, ""))


def body(step: Step) -> str:
    """The body of a step's function."""
    found = functions(step.file)
    assert step.function in found, f"docs/architecture.md names {step}, but there is no such function"
    return found[step.function]


def calls_step(caller: Step, callee: Step) -> bool:
    """Whether a step's function calls another one's; in Python through whatever object."""
    name = callee.function.rpartition(".")[2]
    if caller.file.endswith(".py"):
        return re.search(rf"\b{name}\(", body(caller)) is not None
    return calls(body(caller), name)


def passage(step: Step) -> str:
    """The room that a step is in, with the side of the bus."""
    host = "host/kontur/"
    if step.file.startswith(host):
        return host + room_of(step.file.removeprefix(host).removesuffix(".py"), rooms("Host"))
    module = re.sub(r"\.[ch]$", "", step.file.removeprefix("firmware/"))
    return "firmware/" + room_of(module, rooms("Firmware"))


# --- rooms ------------------------------------------------------------------------------------------------------------
def test_no_circle_among_modules_in_c(sources):
    nothing(" <-> ".join(circle) for circle in circles(sources.arrows()))


def test_arrows_between_rooms_in_c_are_those_of_the_page(sources):
    nothing(forbidden(sources.arrows(), rooms("Firmware")))


def test_each_room_of_the_page_has_modules(sources):
    table = rooms("Firmware")
    assert set(table) == {room_of(module, table) for module in sources.modules}
    for name, room in table.items():
        assert room.context in CONTEXTS, name
        files = {module.rpartition("/")[2] for module in sources.modules if room_of(module, table) == name}
        assert room.both <= files, f"{name}: the page names files that are not there: {room.both - files}"


def test_what_the_tick_may_call_includes_nothing_of_the_background(sources):
    table = rooms("Firmware")
    bad = [
        f"{module} includes {other}"
        for module, used in sources.includes().items() if context_of(module, table) in ("tick", "both")
        for other in used if context_of(other, table) == "background"
    ]  # fmt: skip
    nothing(bad)


@pytest.mark.parametrize(
    ("entry", "other_context"), [("device_tick", "background"), ("device_poll", "tick"), ("device_init", "tick")]
)
def test_a_context_calls_nothing_of_the_other(sources, entry, other_context):
    table = rooms("Firmware")
    reached = sources.reached("device", entry)
    bad = [
        f"{module}: {function}(), called by {caller[1]}()"
        for (module, function), caller in sorted(reached.items()) if context_of(module, table) == other_context
    ]  # fmt: skip
    assert len(reached) > 1
    nothing(bad)


# --- what CMake builds ------------------------------------------------------------------------------------------------
def cmake_rooms() -> dict[str, dict[str, list[str]]]:
    """The arguments of kontur_room() in the CMakeLists.txt of the firmware, by room and keyword."""
    found: dict[str, dict[str, list[str]]] = {}
    for path in sorted((ROOT / "firmware").glob("**/CMakeLists.txt")):
        for words in re.findall(r"^kontur_room\(([^)]*)\)", path.read_text(), re.MULTILINE):
            name, *rest = words.split()
            found[name] = {key: [] for key in ("SOURCES", "TICK", "USES")}
            for word in rest:
                if word in found[name]:
                    key = word
                else:
                    found[name][key].append(word)
    return found


@pytest.mark.parametrize(("name", "words"), cmake_rooms().items())
def test_cmake_knows_rooms_and_the_tick_as_the_page_does(name, words):
    table = rooms("Firmware")
    uses = [f"{name} uses {other}" for other in words["USES"] if other not in table[name].may_include]
    files = [f"{name}/{Path(source).stem}" for source in words["TICK"]]
    ticks = [f"{file} is compiled for the tick" for file in files if context_of(file, table) == "background"]
    nothing([*uses, *ticks])


# --- the host ---------------------------------------------------------------------------------------------------------
def host_arrows() -> dict[str, set[str]]:
    """Modules of the package by their paths below host/kontur; the package itself is `__init__`."""

    def path(module: str) -> str:
        return module.removeprefix("kontur").lstrip(".").replace(".", "/") or "__init__"

    return {
        path(name): {path(other) for other in used} for name, used in python_arrows(ROOT / "host", "kontur").items()
    }


def test_no_circle_among_modules_in_python():
    nothing(" <-> ".join(circle) for circle in circles(host_arrows()))


def test_arrows_between_rooms_in_python_are_those_of_the_page():
    nothing(forbidden(host_arrows(), rooms("Host")))


def test_talking_to_a_real_drive_loads_no_simulator():
    modules = [f"kontur.{name.replace('/', '.')}" for name in host_arrows() if name.split("/")[0] in ("can", "drive")]
    assert modules
    code = f"import sys, {', '.join(modules)}; print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    nothing(name for name in loaded if name.startswith(NOT_FOR_A_DRIVE))


# --- walks ------------------------------------------------------------------------------------------------------------
def unconnected(walk: list[Step]) -> list[str]:
    """Steps of a walk that are not reached from the one before in the way that the page says."""
    found = []
    for number, (before, step) in enumerate(pairwise(walk), 1):
        if step.called_by is not None:
            callers = [earlier for earlier in walk[:number] if earlier.function.endswith(step.called_by)]
            reached = any(calls_step(caller, step) for caller in callers)
        elif before.via is not None:
            text = (ROOT / step.file).read_text()
            reached = all(re.search(rf"\b{re.escape(name)}\b", where)
                          for name, where in zip(before.via, (body(before), text), strict=True))  # fmt: skip
        else:
            reached = calls_step(before, step)
        if not reached:
            found.append(f"{before} -> {step}")
    return found


@pytest.mark.parametrize("title", WALKS)
def test_each_function_of_a_walk_reaches_the_next(title):
    walk = steps(title)
    for step in walk:
        body(step)
    nothing(unconnected(walk))


@pytest.mark.parametrize("title", WALKS)
def test_a_walk_enters_no_room_twice(title):
    passages = [passage(step) for step in steps(title)]
    entered = [room for before, room in zip([None, *passages], passages, strict=False) if room != before]
    nothing(room for number, room in enumerate(entered) if room in entered[:number])


def test_the_drive_step_calls_its_parts_in_the_order_of_the_page():
    first, *parts = steps("One drive step")
    text = body(first)
    places = [re.search(rf"\b{part.function}\(", text) for part in parts]
    nothing(f"{first} does not call {part}" for part, place in zip(parts, places, strict=True) if place is None)
    starts = [(place.start(), part) for place, part in zip(places, parts, strict=True) if place is not None]
    nothing(f"{first} calls {later[1]} before {one[1]}" for one, later in pairwise(starts) if one[0] > later[0])
    for part in parts:
        body(part)
