#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Mutation test of the firmware: a small fault is put into a copy of a source file, and a C test has to fail.

    mutants.py TREE [ROOM ...] [--sample 200] [--seed 1] [--only TEXT] [--json FILE]

TREE is a build of the C tests (preset `mutants`). Of all mutants of the rooms (folders of firmware/) a seeded sample
is tried, or with `--only` those whose FILE:LINE contains the text. A mutant is compiled by itself, with sanitizers, and
linked before the objects of TREE, which stay as they are. Its tests run until one fails: the one of its name first,
then the fastest. One that takes ten times the processor time of before has failed.

Not counted: a mutant that does not compile, one whose machine code is that of the source, and one that mutants.toml
lists as equivalent: no input shows a difference, for the reason that stands there. Entries name the source text, so
that they stay right when lines move; one without `mutant` names all mutants of its line. The score is the part of the
others that was killed. Exit code 1 when it is below 95 %, or when mutants.toml has an entry that fits no mutant.

The operators are those of Offutt et al., "An experimental determination of sufficient mutant operators", 1996
(relational, arithmetic, logical), with constants, deleted statements and initialisers, and swapped axes.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from pathlib import Path

import tree_sitter_c
from tree_sitter import Language, Node, Parser

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
EQUIVALENT = ROOT / "tests/unit/mutants.toml"
LEAST = 0.95
LEFT_OUT = {"test_bitflip", "test_fuzz", "test_power_cut"}  # these take three quarters of the time of all tests
SANITIZERS = ["-fsanitize=address,undefined,bounds-strict", "-fno-sanitize-recover=all"]
SLOWER, ALLOWANCE_S = 10, 2  # processor time that a test may take: so many times that of before, and this more
RESULTS = ("killed", "survived", "equivalent", "same code", "does not compile")

PAIRS = ("== !=", "&& ||", "+ -", "* /", "& |", "<< >>", "++ --", "true false", "n_add n_sub", "n_mul n_div",
         "n_mad n_msub", "n_min n_max", "v2_add v2_sub")  # fmt: skip
OTHERS = {a: [b] for pair in PAIRS for a, b in (pair.split(), pair.split()[::-1])} | {
    "<": ["<=", ">="], "<=": ["<", ">"], ">": [">=", "<="], ">=": [">", "<"], "%": ["*"], "^": ["|"],
    "+=": ["-=", "="], "-=": ["+=", "="], "|=": ["="], "&=": ["="], "n_neg": [""], "n_abs": [""]}  # fmt: skip
DELETED = {"expression_statement": ";", "break_statement": ";", "continue_statement": ";", "initializer_pair": ""}


@dataclass(frozen=True)
class Mutant:
    """Bytes `begin` to `end` of a file become `text`. `source` and `mutant` are the line before and after."""

    file: str
    line: int
    function: str
    source: str
    mutant: str
    begin: int = field(repr=False)
    end: int = field(repr=False)
    text: str = field(repr=False)

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What an entry of mutants.toml names."""
        return *self.line_key, self.mutant

    @property
    def line_key(self) -> tuple[str, str, str]:
        """What an entry of mutants.toml without `mutant` names."""
        return self.file, self.function, self.source

    def toml(self) -> str:
        """The entry of mutants.toml."""
        source, mutant = (f"'{t}'" if "'" not in t else json.dumps(t) for t in (self.source, self.mutant))
        place = f'[[equivalent]]\nfile = "{self.file}"\nfunction = "{self.function}"\n'
        return f'{place}source = {source}\nmutant = {mutant}\nreason = ""'

    def applied(self, code: bytes) -> bytes:
        """The file with the fault in it."""
        return code[: self.begin] + self.text.encode() + code[self.end :]


def text_of(node: Node | None) -> str:
    """The source of a node."""
    return (node.text or b"").decode() if node is not None else ""


def around(node: Node, *kinds: str) -> Node | None:
    """The innermost node of these kinds around this one."""
    found = node.parent
    while found is not None and found.type not in kinds:
        found = found.parent
    return found


def changes(node: Node) -> Iterator[tuple[Node, str]]:
    """What to put in place of the node, or of a part of it."""
    text, kind = text_of(node), node.type
    operator, condition = node.child_by_field_name("operator"), node.child_by_field_name("condition")
    if operator is not None and kind in ("binary_expression", "assignment_expression", "update_expression"):
        yield from ((operator, other) for other in OTHERS.get(operator.type, ()))
    elif kind in ("true", "false") or (
        kind == "identifier" and node.parent is not None and node.parent.type == "call_expression"
    ):
        yield from ((node, other) for other in OTHERS.get(text, ()))
    elif kind == "number_literal" and node.parent is not None and node.parent.type != "array_declarator":
        large = re.match(r"\d{5}", text)  # of these one more is less than a rounding
        yield from ((node, other) for other in ([f"(2 * {text})"] if large else [f"({text} + 1)", f"({text} - 1)"]))
    elif kind == "unary_expression" and text[0] in "!-~":
        yield node, text[1:]
    elif kind in DELETED:
        yield node, DELETED[kind]
    elif kind == "subscript_expression" and is_axis(index := node.child_by_field_name("index"), node):
        assert index is not None
        yield index, f"1 - {text_of(index)}"
    if kind in ("identifier", "field_identifier") and re.fullmatch(r"[xy]|\w+_[xy]", text):
        yield node, text[:-1] + ("y" if text[-1] == "x" else "x")
    if condition is not None and kind != "preproc_if":
        yield condition, f"(!({text_of(condition)}))"


def is_axis(index: Node | None, node: Node) -> bool:
    """Whether the index of an array is the number of an axis: of a loop over both, or an argument."""
    place = around(node, "for_statement", "function_definition")
    if text_of(index) not in ("i", "axis") or place is None:
        return False
    if place.type == "for_statement":
        return re.search(r"i < (2|AXES)\b", text_of(place.child_by_field_name("condition"))) is not None
    return re.search(r"\bint (i|axis)\b", text_of(place).split("{")[0]) is not None


def function_of(node: Node) -> str:
    """The name of the function around the node."""
    name = around(node, "function_definition")
    while name is not None and name.type != "identifier":
        name = name.child_by_field_name("declarator")
    return text_of(name)


def mutants_of(code: bytes, file: str) -> list[Mutant]:
    """All mutants of the functions of a source file."""
    found = []
    nodes = [Parser(Language(tree_sitter_c.language())).parse(code).root_node]
    while nodes:
        node = nodes.pop()
        nodes += reversed(node.named_children)
        for part, text in changes(node):
            begin, end = part.start_byte, part.end_byte
            first, last = code.rfind(b"\n", 0, begin) + 1, code.find(b"\n", end)
            source = " ".join(code[first:last].decode().split())
            mutant = " ".join((code[first:begin] + text.encode() + code[end:last]).decode().split())
            line = code.count(b"\n", 0, begin) + 1
            found.append(Mutant(file, line, function_of(part), source, mutant, begin, end, text))
    return [m for m in found if m.function]


def limit_cpu(seconds: float) -> None:
    """In the child: end it after so much processor time, which does not depend on what else runs."""
    resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 1))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


class Tests:
    """The test programs of a tree: which objects each of them links, and the processor time that it takes."""

    def __init__(self, tree: Path) -> None:
        self.tree = tree
        entries = json.loads((tree / "compile_commands.json").read_text())
        self.commands = {str(Path(e["file"]).resolve()): shlex.split(e["command"]) for e in entries}
        self.link = ["cc", "-fuse-ld=gold"] if shutil.which("ld.gold") else ["cc"]  # gold is faster
        self.unity = next(str(p) for p in tree.glob("**/unity.c.o"))
        self.originals: dict[str, bytes | None] = {}
        programs = [p for p in sorted(tree.glob("tests/unit/test_*")) if p.is_file() and os.access(p, os.X_OK)]
        names = [p.name for p in programs if p.name not in LEFT_OUT]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            learned = list(pool.map(self._learn, names))
        self.members = {name: members for name, (members, _) in zip(names, learned, strict=True)}
        self.seconds = {name: seconds for name, (_, seconds) in zip(names, learned, strict=True)}

    def _objects(self, name: str) -> list[str]:
        unit = self.tree / "tests/unit"
        libraries = [str(unit / f"lib{library}.a") for library in ("kontur_drive_rig", "kontur_tested")]
        return [str(unit / f"CMakeFiles/{name}.dir/{name}.c.o"), self.unity, *libraries, "-lm"]

    def _learn(self, name: str) -> tuple[set[str], float]:
        with tempfile.TemporaryDirectory(dir=self.tree) as folder:
            command = ["cc", "-Wl,--trace,--trace", *self._objects(name), "-o", f"{folder}/{name}"]
            linked = subprocess.run(command, capture_output=True, text=True, check=True)
            command = [sys.executable, "-c", TIMED, f"{folder}/{name}"]
            done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
        if done.returncode != 0:
            sys.exit(f"{name} fails without a mutant: {self.tree}")
        return set(re.findall(r"(\w+)\.c\.o\b", linked.stdout)), float(done.stderr.split()[-1])

    def compile(self, file: str, code: bytes, folder: Path, *flags: str) -> bytes | None:
        """The object of a source file, without debug information; None when it does not compile."""
        (folder / Path(file).name).write_bytes(code)
        command = self.commands[str(ROOT / file)]
        command = [*command[: command.index("-o")], "-g0", "-w", *flags, "-c", Path(file).name, "-o", "mutant.o"]
        done = subprocess.run(command, cwd=folder, capture_output=True, check=False)
        return (folder / "mutant.o").read_bytes() if done.returncode == 0 else None

    def killer(self, file: str, folder: Path) -> str:
        """The name of the first test that fails with mutant.o; empty when all pass."""
        stem = Path(file).stem
        for name in sorted(self.seconds, key=lambda n: (n != f"test_{stem}", self.seconds[n])):
            if stem not in self.members[name]:
                continue
            command = [
                *self.link,
                *SANITIZERS,
                str(folder / "mutant.o"),
                *self._objects(name),
                "-o",
                f"{folder}/{name}",
            ]
            subprocess.run(command, capture_output=True, check=True)
            seconds = self.seconds[name] * SLOWER + ALLOWANCE_S
            try:
                done = subprocess.run([folder / name], capture_output=True, check=False, cwd=folder,
                                      timeout=20 * seconds, preexec_fn=lambda s=seconds: limit_cpu(s))  # fmt: skip
            except subprocess.TimeoutExpired:
                return name
            if done.returncode != 0:
                return name
            (folder / name).unlink()
        return ""


# Runs a program and says how much processor time it took.
TIMED = """
import resource, subprocess, sys
code = subprocess.run([sys.argv[1]], stdout=subprocess.DEVNULL).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, file=sys.stderr)
sys.exit(code != 0)
"""


def judge(tests: Tests, mutant: Mutant, listed: set[tuple[str, ...]]) -> str:
    """`killed by NAME`, or another one of RESULTS."""
    code = (ROOT / mutant.file).read_bytes()
    with tempfile.TemporaryDirectory(dir=tests.tree) as name:
        folder = Path(name)
        if mutant.file not in tests.originals:
            tests.originals[mutant.file] = tests.compile(mutant.file, code, folder)
        made = tests.compile(mutant.file, mutant.applied(code), folder)
        if made is None or made == tests.originals[mutant.file]:
            return "does not compile" if made is None else "same code"
        tests.compile(mutant.file, mutant.applied(code), folder, *SANITIZERS)
        killer = tests.killer(mutant.file, folder)
        unseen = "equivalent" if {mutant.key, mutant.line_key} & listed else "survived"
        return f"killed by {killer}" if killer else unseen


def read_equivalent() -> set[tuple[str, ...]]:
    """The entries of mutants.toml: a mutant's key, or that of its line."""
    entries = tomllib.loads(EQUIVALENT.read_text()).get("equivalent", [])
    return {tuple(e[k] for k in ("file", "function", "source", "mutant") if k in e) for e in entries}


def print_table(results: dict[Mutant, str]) -> float:
    """Counts and score of each room and of all. Returns the last."""
    score = 0.0
    print("\n" + "".join(f"{head:>18}" for head in ("room", *RESULTS, "score")))
    for room in [*sorted({str(Path(m.file).parent) for m in results}), ""]:
        of_room = [result for m, result in results.items() if room in ("", str(Path(m.file).parent))]
        count = [sum(result.startswith(kind) for result in of_room) for kind in RESULTS]
        score = count[0] / max(count[0] + count[1], 1)
        print(f"{room.removeprefix('firmware/') or 'all':>18}" + "".join(f"{c:18}" for c in count) + f"{score:18.1%}")
    return score


def main() -> int:
    """Try the sample and print what survived."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("tree", type=Path)
    parser.add_argument("rooms", nargs="*", default=["core", "drive"])
    parser.add_argument("--sample", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", metavar="TEXT", help="all of those whose FILE:LINE contains this")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write each mutant with its result")
    options = parser.parse_args()
    paths = [p for room in options.rooms for p in sorted((ROOT / "firmware" / room).glob("*.c"))]
    every = [m for p in paths for m in mutants_of(p.read_bytes(), str(p.relative_to(ROOT)))]
    if options.only is not None:
        chosen = [m for m in every if options.only in f"{m.file}:{m.line}"]
    else:
        chosen = random.Random(options.seed).sample(every, min(options.sample, len(every)))
    listed, files = read_equivalent(), {m.file for m in every}
    stale = sorted(e for e in listed - {k for m in every for k in (m.key, m.line_key)} if e[0] in files)
    tests = Tests(options.tree.resolve())
    print(f"{len(chosen)} of {len(every)} mutants, seed {options.seed}, {len(tests.seconds)} tests", flush=True)
    results = {}
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for m, result in zip(chosen, pool.map(lambda m: judge(tests, m, listed), chosen), strict=True):
            results[m] = result
            if result == "survived":
                print(f"\n# {m.file}:{m.line}\n{m.toml()}", flush=True)
    score = print_table(results)
    if options.json is not None:
        options.json.write_text(json.dumps([asdict(m) | {"result": r} for m, r in results.items()], indent=1))
    for entry in stale:
        print(f"mutants.toml: no mutant fits the entry {entry}")
    return 1 if score < LEAST or stale else 0


if __name__ == "__main__":
    sys.exit(main())
