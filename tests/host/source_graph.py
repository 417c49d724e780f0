# SPDX-License-Identifier: Apache-2.0
"""What the sources use of each other: includes and calls in C, imports in Python. For test_architecture.py.

A C module is a .c file with its header: `drive/cia402`. A module uses another one when it includes its header, or when
it calls a function that is defined there, under whichever header that is declared. A Python module is a file; only
what is imported by name counts, so `from kontur.can import link` uses `kontur.can.link`.

The C code is laid out by clang-format, so no parser is needed: a function's body begins with a "{" alone in its line.
"""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

Arrows = dict[str, set[str]]

_COMMENT_OR_STRING = re.compile(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'', re.DOTALL)
_INCLUDE = re.compile(r'^#include "([^"]+)"', re.MULTILINE)
_FUNCTION = re.compile(r"^([A-Za-z_][^{};#]*?)\n\{\n(.*?)^\}", re.MULTILINE | re.DOTALL)
_CALLED = re.compile(r"(?<![\w.>])(\w+)\s*\(")  # by name, not through a pointer in a struct
_ATTRIBUTE = re.compile(r"__attribute__\(\(.*?\)\)")


@dataclass
class CFile:
    """`functions`: bodies by name; `external`: the names that other files can call."""

    includes: list[str]
    functions: dict[str, str]
    external: set[str]
    text: str

    @classmethod
    def parse(cls, text: str) -> CFile:
        """Read one source file or header."""
        includes = _INCLUDE.findall(text)
        code = _COMMENT_OR_STRING.sub(" ", text)
        functions, external = {}, set()
        for head, body in _FUNCTION.findall(code):
            head = _ATTRIBUTE.sub("", head)
            named = re.search(r"(\w+)\s*\(", head)
            if named is None:
                continue
            functions[named[1]] = body
            if "static" not in head.split("(")[0].split():
                external.add(named[1])
        return cls(includes, functions, external, code)


def calls(body: str, name: str) -> bool:
    """Whether a body of C calls a function by its name."""
    return name in _CALLED.findall(body)


@dataclass
class CModule:
    """The files of a module by their paths."""

    files: dict[Path, CFile] = field(default_factory=dict)

    @property
    def functions(self) -> dict[str, str]:
        """Bodies of all functions by name."""
        return {name: body for file in self.files.values() for name, body in file.functions.items()}


class CSources:
    """The C modules below some include roots; names are paths below the root, without suffix.

    `parts`: patterns of modules that count as part of another one. `supplied`: functions that a module leaves to the
    program that uses it; to call them makes no arrow.
    """

    def __init__(
        self, roots: Mapping[Path, Iterable[Path]], parts: Mapping[str, str] = {}, supplied: Iterable[str] = ()
    ) -> None:
        self._parts = parts
        self._supplied = frozenset(supplied)
        self.modules: dict[str, CModule] = defaultdict(CModule)
        for root, folders in roots.items():
            for folder in folders:
                for path in sorted(folder.rglob("*.[ch]")):
                    name = path.relative_to(root).with_suffix("").as_posix()
                    self.modules[self._whole(name)].files[path] = CFile.parse(path.read_text())

    def _whole(self, name: str) -> str:
        return next((whole for part, whole in self._parts.items() if re.fullmatch(part, name)), name)

    @cached_property
    def _definers(self) -> Mapping[str, set[str]]:
        """Modules that define an external function, by its name; a port is one of several that define the same."""
        found: dict[str, set[str]] = defaultdict(set)
        for name, module in self.modules.items():
            for file in module.files.values():
                for function in file.external:
                    found[function].add(name)
        return found

    def defining(self, module: str, function: str) -> str | None:
        """The module whose `function` a call in `module` reaches, None where it is not one of these modules'."""
        if function in self.modules[module].functions:
            return module
        definers = self._definers.get(function, set())
        return next(iter(definers)) if len(definers) == 1 else None

    def _called(self, module: str, body: str) -> set[tuple[str, str]]:
        """Modules and names of the functions that a body in `module` calls."""
        names = set(_CALLED.findall(body)) - self._supplied
        reached = ((self.defining(module, name), name) for name in names)
        return {(definer, name) for definer, name in reached if definer is not None}

    def includes(self) -> Arrows:
        """The modules whose headers each module includes."""
        found: Arrows = {}
        for name, module in self.modules.items():
            included = {include for file in module.files.values() for include in file.includes}
            used = {self._whole(include.removesuffix(".h")) for include in included}
            found[name] = {other for other in used if other in self.modules} - {name}
        return found

    def arrows(self) -> Arrows:
        """The modules that each module uses, by includes and by calls."""
        found = self.includes()
        for name, module in self.modules.items():
            for body in module.functions.values():
                found[name] |= {definer for definer, _ in self._called(name, body)} - {name}
        return found

    def reached(self, module: str, function: str) -> dict[tuple[str, str], tuple[str, str]]:
        """All functions that one calls, directly or not; each with one that calls it."""
        found = {(module, function): (module, function)}
        waiting = [(module, function)]
        while waiting:
            caller = waiting.pop()
            for callee in self._called(caller[0], self.modules[caller[0]].functions[caller[1]]):
                if callee not in found:
                    found[callee] = caller
                    waiting.append(callee)
        return found


def _imported(tree: ast.Module, package: str) -> Iterable[str]:
    """Names of modules, or of what is in them, that a file of `package` imports."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.rsplit(".", node.level - 1)[0] if node.level else ""
            base = ".".join(part for part in (above, node.module) if part)
            yield from (f"{base}.{alias.name}" for alias in node.names)


def python_arrows(root: Path, package: str) -> Arrows:
    """The modules that each module of a package imports, at whatever place in its text."""
    modules = {}
    for path in sorted((root / package).rglob("*.py")):
        parts = path.relative_to(root).with_suffix("").parts
        modules[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    found: Arrows = {}
    for name, path in modules.items():
        inside = name if path.name == "__init__.py" else name.rpartition(".")[0]
        used = set()
        for imported in _imported(ast.parse(path.read_text()), inside):
            while imported and imported not in modules:
                imported = imported.rpartition(".")[0]
            used.add(imported)
        found[name] = used - {name, ""}
    return found


def circles(arrows: Arrows) -> list[list[str]]:
    """Groups of modules that use each other, directly or not (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        index[node] = low[node] = len(index)
        stack.append(node)
        for other in sorted(arrows.get(node, ())):
            if other not in index:
                visit(other)
                low[node] = min(low[node], low[other])
            elif other in stack:
                low[node] = min(low[node], index[other])
        if low[node] == index[node]:
            at = stack.index(node)
            group = sorted(stack[at:])
            del stack[at:]
            if len(group) > 1:
                found.append(group)

    for node in sorted(arrows):
        if node not in index:
            visit(node)
    return found
