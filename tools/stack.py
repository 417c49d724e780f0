# SPDX-License-Identifier: Apache-2.0
"""Worst case of the image's stack, from GCC's call graph with stack usage (`-fcallgraph-info=su`: files *.ci).

A call through a pointer is resolved by its own source line, `hal->can_send(hal->ctx, ...)`: it may reach each function
that some source of the firmware assigns to a member `.can_send`. Functions of the compiler's and C library have no
*.ci; theirs is what they push, read from the disassembly.
"""

from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass, field
from pathlib import Path

from kontur.errors import InputError

# Cortex-M4F: r0-r3, r12, lr, pc, xPSR, s0-s15, FPSCR, a reserved word, and one to align (DDI 0403E, B1.5.6, B1.5.7)
EXCEPTION_BYTES = 8 * 4 + 18 * 4 + 4
BACKGROUND = "reset_irq"
# By priority: each may interrupt those above it in this table. crash_irq() has a stack of its own (kontur.ld).
INTERRUPTS = {
    "CAN": ("can_tx_irq", "can_rx_irq", "can_error_irq"),
    "servo tick": ("tick_irq",),
    "serial, supply": ("uart_irq", "supply_irq"),
    "clock failure": ("clock_failed_irq",),
}
CRASH, CRASH_RECORD = "crash_irq", "crash_record"  # the one goes on to the other in assembler

_NODE = re.compile(r'^node: \{ title: "([^"]*)" label: "[^"]*\\n(\d+) bytes \((\w+(?:,\w+)?)\)', re.MULTILINE)
_EDGE = re.compile(r'^edge: \{ sourcename: "([^"]*)" targetname: "([^"]*)" label: "([^"]*):(\d+):\d+"', re.MULTILINE)
_INDIRECT = "__indirect_call"


@dataclass
class Graph:
    """Bytes of each function's frame, and whom it calls."""

    frame: dict[str, int] = field(default_factory=dict)
    calls: dict[str, set[str]] = field(default_factory=dict)

    def deepest(self, function: str) -> tuple[int, list[str]]:
        """Bytes below `function`'s entry at worst, its own among them, and the calls that take them.

        Raises InputError: a function calls itself over others, which has no worst case, or is not known.
        """
        known: dict[str, tuple[int, list[str]]] = {}

        def visit(name: str, above: tuple[str, ...]) -> tuple[int, list[str]]:
            if name in above:
                raise InputError(f"stack: recursion, {' -> '.join((*above[above.index(name) :], name))}")
            if name not in self.frame:
                raise InputError(
                    f"stack: nothing is known of {name}, called by {' -> '.join(above)}: make firmware anew"
                )
            if name not in known:
                below = [visit(called, (*above, name)) for called in sorted(self.calls.get(name, ()))]
                bytes_below, path = max(below, default=(0, []))
                known[name] = (self.frame[name] + bytes_below, [name, *path])
            return known[name]

        return visit(function, ())


def _name(title: str) -> str:
    """GCC's title of a function without the temporary file of the link-time optimiser."""
    return title.rsplit(":", 1)[-1] if "ltrans" in title else title


def read(folder: Path, root: Path, elf: Path, tools: str) -> Graph:
    """The graph of an image built in `folder` from sources below `root`.

    Raises InputError: there is no call graph, a frame has no bound, or an indirect call cannot be resolved.
    """
    graph = Graph()
    texts = [file.read_text().replace(f"{root}/", "") for file in sorted(folder.rglob("*.ci"))]
    texts = [text for text in texts if not _of_a_source_that_is_gone(text, root)]
    if not texts:
        raise InputError(f"{folder}: no call graphs (*.ci) there: rm -r {folder}, then make firmware")
    for text in texts:
        for title, size, bound in _NODE.findall(text):
            if bound == "dynamic":
                raise InputError(f"stack: the frame of {_name(title)} has no bound")
            graph.frame[_name(title)] = int(size)
    members = _assigned(root, graph)
    for text in texts:
        for source, target, file, line in _EDGE.findall(text):
            called = {_name(target)} if target != _INDIRECT else _resolve(root / file, int(line), members)
            if target == _INDIRECT:
                called.discard(_name(source))  # what stands in front of a HAL calls the one behind it, not itself
            graph.calls.setdefault(_name(source), set()).update(called)
    library = _disassembled(elf, tools)
    for name in library.frame.keys() - graph.frame.keys():
        graph.frame[name] = library.frame[name]
        graph.calls[name] = library.calls[name] - {name}
    return graph


def _of_a_source_that_is_gone(text: str, root: Path) -> bool:
    """Whether a call graph is left over from a source file that has been moved or deleted since."""
    title = re.match(r'graph: \{ title: "([^"]*\.c)"', text)
    return title is not None and not (root / title[1]).exists()


def _assigned(root: Path, graph: Graph) -> dict[str, set[str]]:
    """Functions by the member of a structure that they are assigned to, in what the image is made of.

    A function may come as an argument: `.fits = fits` in `settings_init(..., bool (*fits)(...))` is what callers pass.
    """
    files = [file for folder in ("", "*/", "port/stm32f405/") for file in root.glob(f"firmware/{folder}*.c")]
    texts = {str(file.relative_to(root)): file.read_text() for file in files}
    found: dict[str, set[str]] = {}
    for local, text in texts.items():
        pairs = re.findall(r"\.(\w+) = (\w+)\b", text)
        for taker, parameter in re.findall(r"^\w[^\n;]*?(\w+)\([^;{]*\(\*(\w+)\)\([^;{]*\{", text, re.MULTILINE):
            passed = [call for other in texts.values() for call in re.findall(rf"\b{taker}\(([^;{{]*)\);", other)]
            pairs += [(member, word) for member, value in pairs if value == parameter
                      for word in re.findall(r"\w+", " ".join(passed))]  # fmt: skip
        for member, function in pairs:
            for name in (f"{local}:{function}", function):
                if name in graph.frame:
                    found.setdefault(member, set()).add(name)
                    break
    return found


def _resolve(file: Path, line: int, members: dict[str, set[str]]) -> set[str]:
    text = file.read_text().splitlines()[line - 1]
    found = [members[m] for m in re.findall(r"(?:->|\.)(\w+)\(", text) if m in members]
    if not found:
        raise InputError(f"{file}:{line}: a call through a pointer of which the targets are not known: {text.strip()}")
    return set().union(*found)


def _disassembled(elf: Path, tools: str) -> Graph:
    """Of each function in the image: all that it pushes, summed up, and whom it branches to."""
    graph = Graph()
    name = ""
    command = [f"{tools}objdump", "-d", "--no-show-raw-insn", str(elf)]
    for line in subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines():
        if label := re.match(r"[0-9a-f]+ <(.+)>:", line):
            name = label[1]
            graph.frame[name], graph.calls[name] = 0, set()
        elif branch := re.search(r"\tb\S*\t.*<([^+>]+)>", line):
            graph.calls[name].add(branch[1])
        elif pushed := re.search(r"\t(?:push|stmdb)\S*\t(?:sp!, )?\{(.*)\}", line):
            graph.frame[name] += 4 * _registers(pushed[1])
        elif lowered := re.search(r"\tsub\S*\tsp, (?:sp, )?#(\d+)|\tstr\S*\t.*\[sp, #-(\d+)\]!", line):
            graph.frame[name] += int(lowered[1] or lowered[2])
    return graph


def _registers(text: str) -> int:
    """How many are in a list like `r4, r5, r6-r8, lr`."""
    total = 0
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        total += int(last[1:]) - int(first[1:]) + 1 if last else 1
    return total


def worst(graph: Graph) -> tuple[dict[str, int], dict[str, list[str]]]:
    """Bytes of the background and of each interrupt, exception frame included, `all` at once, and the calls of each.

    `crash` is crash_irq()'s on its own stack.
    """
    size, path = {}, {}
    size["background"], path["background"] = graph.deepest(BACKGROUND)
    for level, functions in INTERRUPTS.items():
        deepest, path[level] = max(graph.deepest(f) for f in functions)
        size[level] = EXCEPTION_BYTES + deepest
    known = {BACKGROUND, CRASH, *(f for functions in INTERRUPTS.values() for f in functions)}
    if others := {name for name in graph.frame if name.endswith("_irq")} - known:
        raise InputError(f"stack: interrupts that tools/stack.py does not list: {', '.join(sorted(others))}")
    size["all"] = sum(size.values())
    size["crash"], path["crash"] = graph.deepest(CRASH_RECORD)
    return size, path
