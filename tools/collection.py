# SPDX-License-Identifier: Apache-2.0
"""What becomes of a collection of G-code programs: how many run, and what the others are refused for.

`python tools/collection.py FOLDER...` reads each different program below the folders, as `kontur check` does, and plans
nothing. With --interpreter each is read by rs274, too, and compared with what rs274 by itself takes.
"""

from __future__ import annotations

import hashlib
import json
import re
import shutil
import subprocess
import tempfile
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import click

from kontur.errors import FileError, KonturError
from kontur.path import gcode_words, programs

TABLE, BEYOND = "words of the table alone", "other words, #, [ ], O"
RUNS, SPACE, REFUSED = "run", "refused as a move in three dimensions, or rotary", "refused otherwise"
_COMMENT = re.compile(r"\([^()]*\)|;.*")
_SPACE = re.compile("z changes while x and y cut|a rotary axis|arcs lie in the plane|centre is given by I and J")
_NO_PROGRAM = "there is no motion in this file"
_RS274_S = 60.0


@dataclass
class Counted:
    """How many programs there are of each sort and outcome, and of each kind of refusal with a file to look at."""

    programs: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    refusals: Counter[str] = field(default_factory=Counter)
    example: dict[str, str] = field(default_factory=dict)

    def add(self, sort: str, file: Path, errors: list[KonturError]) -> None:
        space = all(_SPACE.search(str(error)) for error in errors)
        outcome = RUNS if not errors else SPACE if space else REFUSED
        self.programs[sort][outcome] += 1
        if outcome == REFUSED:
            for name in {f"{sort}: {kind(error)}" for error in errors}:
                self.refusals[name] += 1
                self.example.setdefault(name, str(file))


def problem(error: KonturError) -> str:
    return error.problem if isinstance(error, FileError) else str(error)


def kind(error: KonturError) -> str:
    """The problem without its figures; with the code that it is about, or the call of rs274."""
    text = re.sub(r"[-+]?(?<![A-Z])\b[0-9.]*[0-9]", "0", problem(error))
    word = error.word if isinstance(error, FileError) and error.word else ""
    return f"{word} {text}" if re.fullmatch(r"[GMgm][0-9.]+|[A-Z_]{3,}", word) else text


def files(folders: Iterable[Path]) -> Iterator[Path]:
    """The programs of which no other file has the same bytes."""
    seen = set()
    for folder in folders:
        for file in sorted(folder.rglob("*")):
            if file.suffix.lower() in programs.GCODE_SUFFIXES and file.is_file():
                digest = hashlib.sha256(file.read_bytes()).digest()
                if digest not in seen:
                    seen.add(digest)
                    yield file


def sort_of(text: str) -> str:
    """TABLE, if each word is a number with a letter or code that docs/paths.md lists."""
    for line in text.splitlines():
        code = re.sub(r"\s", "", _COMMENT.sub("", line)).upper().removeprefix("/")
        if code == "%" or re.fullmatch(r"[O:][0-9]+", code):
            continue
        words = re.findall(r"([A-Z])([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))", code)
        known = all(gcode_words.known(letter, float(number)) for letter, number in words)
        if not known or sum(map(len, map("".join, words))) != len(code):
            return BEYOND
    return TABLE


def refused(file: Path, interpreter: bool) -> list[KonturError]:
    """Why Kontur does not take it."""
    try:
        _, refusals = programs.check(file, interpreter=interpreter)
    except KonturError as error:
        return [error]
    return [error for error, _ in refusals]


def rs274_takes(file: Path) -> bool:
    """Whether rs274 by itself reads it to its end, with tools 1 to 99 that have no size, and goes somewhere."""
    with tempfile.TemporaryDirectory() as folder:
        tools = "".join(f"T{tool} P{tool} D0 Z0\n" for tool in range(1, 100))
        Path(folder, "tools.tbl").write_text(tools)
        Path(folder, "parameters.var").touch()
        command = ["rs274", "-g", "-t", f"{folder}/tools.tbl", "-v", f"{folder}/parameters.var", str(file.absolute())]
        try:
            done = subprocess.run(
                command, capture_output=True, cwd=file.parent, env={"HOME": folder}, timeout=_RS274_S, check=False
            )
        except subprocess.TimeoutExpired:
            return False
    moved = re.search(rb"STRAIGHT_(TRAVERSE|FEED)|ARC_FEED", done.stdout) is not None
    return done.returncode == 0 and moved and set(done.stderr.split()) <= {b"executing"}


@click.command()
@click.argument("folders", nargs=-1, required=True, type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--interpreter", is_flag=True, help="Read the programs that rs274 takes by rs274, too.")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def main(*, folders: tuple[Path, ...], interpreter: bool, as_json: bool) -> None:
    """Tell what becomes of the programs below FOLDERS."""
    if interpreter and shutil.which("rs274") is None:
        raise click.ClickException("rs274 is not installed: apt-get install linuxcnc-uspace (80 MB)")
    counted, count = Counted(), 0
    for file in files(folders):
        try:
            text = file.read_text()
        except (OSError, UnicodeDecodeError):
            text = "#"
        errors = refused(file, False)
        if any(_NO_PROGRAM in problem(error) for error in errors) and len(errors) == 1:
            continue
        count += 1
        counted.add(sort_of(text), file, errors)
        if interpreter and rs274_takes(file):
            counted.add("taken by rs274, read by it", file, refused(file, True))
    if as_json:
        click.echo(json.dumps({"programs": count} | asdict(counted), indent=1))
        return
    click.echo(f"{count} programs that differ and move something\n")
    click.echo(f"| programs of | {RUNS} | {SPACE} | {REFUSED} | run or in space % |\n|---|---|---|---|---|")
    for sort, outcomes in sorted(counted.programs.items()):
        run, space, other = (outcomes[name] for name in (RUNS, SPACE, REFUSED))
        click.echo(f"| {sort} | {run} | {space} | {other} | {100.0 * (run + space) / (run + space + other):.1f} |")
    click.echo("\n| files | refused otherwise for | such as |\n|---|---|---|")
    for name, times in counted.refusals.most_common():
        click.echo(f"| {times} | {name} | {counted.example[name]} |")


if __name__ == "__main__":
    main()
