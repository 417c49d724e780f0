# SPDX-License-Identifier: Apache-2.0
"""The hand-written pages: lines of at most 120 characters, links that lead somewhere, commands that exist."""

import importlib
import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from kontur.cli import main
from kontur.cli.options import parameter_names

ROOT = Path(__file__).parents[2]
WIDTH = 120
GENERATED = {"faults.md", "objects.md", "paper.md", "signals.md"}  # in docs/; each says in its head what makes it
PAGES = sorted(
    page
    for page in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), *ROOT.glob("tests/**/README.md")]
    if not (page.parent == ROOT / "docs" and page.name in GENERATED)
)

# A link or picture: [text](target), where text may hold one pair of brackets
_LINK = re.compile(r"\[(?:[^\[\]]|\[[^\]]*\])*\]\(([^()\s]+)\)")
_FENCE = re.compile(r"^\s*```")
_MADE = re.compile(r"^<!-- [\w ]+: (?:made by|begin)")
_MADE_END = re.compile(r"^<!-- [\w ]+: end -->")


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


def hand_written_lines(page: Path) -> Iterator[tuple[int, str]]:
    """Numbered lines of a page, without what a command writes between two marks."""
    made = False
    for number, line in enumerate(page.read_text("utf-8").splitlines(), 1):
        made = made or bool(_MADE.match(line))
        if not made:
            yield number, line
        made = made and not _MADE_END.match(line)


def prose_and_code(page: Path) -> tuple[str, str]:
    """The text outside and inside fenced code; a backslash at the end of a line of code joins the next one to it."""
    prose, code = [], []
    fenced = False
    for line in page.read_text("utf-8").splitlines():
        if _FENCE.match(line):
            fenced = not fenced
        else:
            (code if fenced else prose).append(line)
    return "\n".join(prose), "\n".join(code).replace("\\\n", " ")


def anchors(page: Path) -> set[str]:
    """The anchors that the headings of a page get: lower case, without punctuation, hyphens for blanks."""
    prose, _ = prose_and_code(page)
    headings = re.findall(r"^#+ +(.*?)\s*$", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def dead_links(page: Path) -> list[str]:
    """Relative links of a page that lead to no file, or to no heading of one."""
    prose, _ = prose_and_code(page)
    dead = []
    for target in _LINK.findall(prose):
        path, _, anchor = target.partition("#")
        if re.match(r"[a-z]+:", path):
            continue
        file = (page.parent / path).resolve() if path else page
        if not file.exists() or (anchor and anchor not in anchors(file)):
            dead.append(target)
    return dead


def kontur_commands(page: Path) -> list[list[str]]:
    """The calls of `kontur` in the fenced code of a page, and inline in its text, as words."""
    prose, code = prose_and_code(page)
    calls = re.findall(r"^(?:\.venv/bin/)?kontur (.*)$", code, re.MULTILINE)
    if page.name != "CHANGELOG.md":  # which names old commands inline
        calls += re.findall(r"`(?:\.venv/bin/)?kontur ([^`]+)`", prose)
    return [shlex.split(call, comments=True) for call in calls]


def unknown_to_cli(words: list[str]) -> str | None:
    """The first word of a call that the command line does not know: a command, an option or the value of one."""
    command: click.Command = main
    rest = list(words)
    while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
        word = rest.pop(0)
        found = command.get_command(click.Context(command), word)
        if found is None:
            return word
        command = found
    verbs = main.list_commands(click.Context(main))
    inside = next((at for at, word in enumerate(rest) if word in verbs), None) if words[0] == "live" else None
    if inside is not None:  # `kontur live` runs another command
        return unknown_to_cli(["live", *rest[:inside]]) or unknown_to_cli(rest[inside:])
    options = {option: parameter for parameter in command.params for option in parameter.opts}
    parameters = parameter_names()
    for word, value in zip(rest, [*rest, ""][1:], strict=True):
        if words[:2] == ["param", "set"] and re.match(r"[a-z_]+\.\w+=", word):
            if word.partition("=")[0] not in parameters:
                return word
            continue
        if word in ("--help", "-h") or not re.match(r"--?[a-z]", word):
            continue
        if word not in options:
            return word
        parameter = options[word]
        if not isinstance(parameter, click.Option) or parameter.is_flag or isinstance(parameter.type, click.Path):
            continue
        try:
            parameter.type.convert(value, parameter, click.Context(command))
        except click.BadParameter:
            return f"{word} {value}"
    return None


def make_targets(text: str) -> set[str]:
    """The targets of `make` that a page calls, inline or at the start of a line of code."""
    return set(re.findall(r"(?:`|^)make ([a-z][a-z-]*)", text, re.MULTILINE))


def presets(text: str) -> set[str]:
    """The CMake presets that a page calls."""
    return set(re.findall(r"(?:cmake|ctest)[^`\n]* --preset[ =]([a-z][\w-]*)", text))


def missing_imports(code: str) -> list[str]:
    """What the examples in Python take from kontur and is not there."""
    face = importlib.import_module("kontur")
    used = re.findall(r"(?<![\w/])kontur\.(\w+)", re.sub(r"^from .*", "", code, flags=re.MULTILINE))
    missing = [f"kontur.{name}" for name in used if "import kontur\n" in code and not hasattr(face, name)]
    for module, names in re.findall(r"^from (kontur[\w.]*) import ([\w, ]+)$", code, re.MULTILINE):
        found = importlib.import_module(module)
        missing += [f"{module}.{name}" for name in re.split(r", *", names) if not hasattr(found, name)]
    return missing


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_lines_are_at_most_120_characters(page: Path) -> None:
    # A line without a blank, such as a long link, cannot be broken.
    long = [number for number, line in hand_written_lines(page) if len(line) > WIDTH and " " in line.strip("-* ")]
    assert not long, f"{name_of(page)}: lines {long} are longer than {WIDTH} characters"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_relative_links_lead_to_a_file_and_its_heading(page: Path) -> None:
    assert not dead_links(page)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_and_options_exist(page: Path) -> None:
    assert not [word for call in kontur_commands(page) if (word := unknown_to_cli(call))]


# The changelog names the old commands, too.
@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=name_of)
def test_targets_of_make_exist(page: Path) -> None:
    known = set(re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE))
    assert make_targets(page.read_text("utf-8")) <= known


@pytest.mark.parametrize("page", [page for page in PAGES if presets(page.read_text("utf-8"))], ids=name_of)
def test_presets_of_cmake_exist(page: Path) -> None:
    described = json.loads((ROOT / "CMakePresets.json").read_text("utf-8"))
    known = {preset["name"] for kind in described if kind.endswith("Presets") for preset in described[kind]}
    assert presets(page.read_text("utf-8")) <= known


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_examples_in_python_import_what_exists(page: Path) -> None:
    assert not missing_imports(prose_and_code(page)[1])


def test_pages_are_found_and_marked_tables_are_left_out() -> None:
    assert {ROOT / "README.md", ROOT / "docs" / "protocol.md"} <= set(PAGES)
    page = ROOT / "docs" / "performance.md"
    assert len(list(hand_written_lines(page))) < len(page.read_text("utf-8").splitlines())


def test_a_dead_link_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# One heading\n[a](#one-heading) [b](#two) [c](other.md) [d [e]](page.md#one-heading)\n")
    assert dead_links(page) == ["#two", "other.md"]


def test_an_unknown_command_is_found() -> None:
    assert unknown_to_cli(["run", "circle", "--radius", "4"]) is None
    assert unknown_to_cli(["run", "circle", "--size-of-it", "4"]) == "--size-of-it"
    assert unknown_to_cli(["run", "circle", "--controller", "fastest"]) == "--controller fastest"
    assert unknown_to_cli(["bench", "nothing"]) == "nothing"
    assert unknown_to_cli(["param", "set", "plant_x.mass=1", "plant_x.weight=1"]) == "plant_x.weight=1"


def test_a_command_inline_is_read_over_the_end_of_its_line(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("Try `kontur run circle\n--size 4`, then\n```\nkontur info\n```\n")
    assert kontur_commands(page) == [["info"], ["run", "circle", "--size", "4"]]
