# SPDX-License-Identifier: Apache-2.0
"""What the firmware costs on the microcontroller: instructions of a servo tick, stack, flash and RAM.

Instructions are counted in QEMU, of programs that `make test-target` builds (tests/target/bench_step.c): by the
program's own timer and, for each stage of the tick, by a plugin (tests/target/stages.c). Each instruction belongs to
the innermost inlined function whose source file names a stage. The two counts must agree to the instruction.
"""

from __future__ import annotations

import json
import re
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import click
import stack

from kontur.cli.output import print_json, print_table
from kontur.drive.controllers import CONTROLLERS
from kontur.errors import InputError, KonturError, SimulatorError

ROOT = Path(__file__).resolve().parents[1]
IMAGE = ROOT / "build/image"  # the trees of these presets
PROGRAMS = ROOT / "build"
PLUGIN = PROGRAMS / "host-f32/libstages.so"
BASELINE = ROOT / "tests/target/cost.json"
CHANGELOG = ROOT / "CHANGELOG.md"
PAGE = ROOT / "docs/performance.md"
TOOLS = "arm-none-eabi-"
DRIVERS = PROGRAMS / "m4-f32/bench_port.elf"
MACHINES = {"m4-f32": "netduinoplus2", "m4-fix": "netduinoplus2", "m3-fix": "netduino2"}
# By function, and by source file where no function is named; what is inlined from other files, and library functions,
# belong to their caller. The last stage is what is left.
STAGES = {
    "encoders, inputs": ("encoder_step", "encoder_scale", "latch_edges", "drive_read"),
    "observer": ("observer.c", "energy.c"),
    "path, spline": ("step_path", "change_path", "wanted_rate", "spline_prefetch", "path_clock.c", "spline.c"),
    "contour": ("contour.c",),
    "law": ("smc.c", "cascade.c"),
    "geometry, force filters": ("geometry.c", "force_filter.c", "force_limit.c", "dual_feedback.c"),
    "compensator, feedforward": ("compensator.c", "feedforward.c", "friction.c", "screw.c"),
    "watch for oscillation": ("oscillation.c",),
    "supervision": ("supervise", "supervise_in_detail", "supervise_axis", "supervise_inputs"),
    "telemetry, scope": (
        *("publish", "widen_range", "contour_range.c", "contour_range.h"),
        *("telemetry.c", "telemetry_gen.h", "scope_runs", "scope.c"),
    ),
    "composing, output": (
        *("servo_loop.c", "servo.c", "onchip_plant.c", "configuration.c"),
        *("rig.c", "bench_step.c", "semihost.c"),
    ),
}
TICKS = (*CONTROLLERS, "compensated")  # ccu with every compensation on
WORSE = 1.03
FREE = 0.15  # of each stack
MODEL = ("model_mean", "model_worst")  # cycles by the model of tests/target/stages.c: estimates, not held
_RUN_S = 300.0
_FLASH, _RAM = (".boot", ".text", ".data"), (".stack", ".noinit", ".data", ".bss", ".ccm")

# What is measured: by what (a target, "image"), of what (a controller, "size", "stack"), figure.
Cost = dict[str, dict[str, dict[str, int]]]


def measure() -> dict[str, Any]:
    """All figures: `cost`, `stages` {target: {controller: {stage: {mean, worst}}}}, `sections`,
    `stack` {level: bytes}, `stack_path` {level: calls}, `reserve` of the stacks.

    Raises InputError: something is not built, or a stack has no bound; SimulatorError: a program fails in QEMU.
    """
    for file in (PLUGIN, IMAGE / "kontur.elf", DRIVERS, *(PROGRAMS / n / "bench_step.elf" for n in MACHINES)):
        if not file.is_file():
            raise InputError(f"{file}: not built: run `make test-target` in a checkout of the source")
    with ThreadPoolExecutor(2) as pool:
        ran = dict(zip(MACHINES, pool.map(_instructions, MACHINES), strict=True))
    sections = _sections(IMAGE / "kontur.elf")
    used, path = stack.worst(stack.read(IMAGE, ROOT, IMAGE / "kontur.elf", TOOLS))
    cost: Cost = {target: ticks for target, (ticks, _) in ran.items()}
    cost["image"] = {
        "size": {"flash": sum(sections[s] for s in _FLASH), "RAM": sum(sections[s] for s in _RAM)},
        "stack": {"background": used["background"], "tick": used["servo tick"], "all": used["all"]},
        "drivers": _printed(_run(DRIVERS, "m4-f32"), DRIVERS),
    }
    return {
        "cost": cost,
        "stages": {target: stages for target, (_, stages) in ran.items()},
        "sections": sections,
        "stack": used,
        "stack_path": path,
        "reserve": _reserve(IMAGE / "kontur.elf"),
    }


def _tool(name: str, *arguments: str, stdin: str | None = None) -> str:
    ran = subprocess.run([TOOLS + name, *arguments], check=True, capture_output=True, text=True, input=stdin)
    return ran.stdout


def _sections(elf: Path) -> dict[str, int]:
    """Bytes of each section that takes memory."""
    rows = (line.split() for line in _tool("size", "-A", str(elf)).splitlines())
    return {r[0]: int(r[1]) for r in rows if len(r) == 3 and r[0].startswith(".") and int(r[2]) >= 0x08000000}


def _reserve(elf: Path) -> dict[str, int]:
    """Bytes of the stack of all, and of crash_irq()'s own above it (kontur.ld)."""
    at = {name: int(address, 16) for address, _, name in re.findall(r"^(\w+) (\w) (\w+)$", _tool("nm", str(elf)), re.M)}
    top = at["kontur_stack_top"]
    return {"all": top - at["kontur_stack_bottom"], "crash": at["kontur_crash_stack"] - top}


def cycles_of(mnemonic: str, operands: str) -> int:
    """Cycles of an instruction that the Cortex-M4 has fetched, without the refill of a branch that is taken.

    ARM, Cortex-M4 technical reference manual (100166), 3.3 and 7.2: a load or store takes 2, one of several registers 1
    and as many; a division by its worst, 12 and 14; a fused product 3.
    """
    name = mnemonic.split(".")[0]
    if re.match(r"v?(ldm|stm|push|pop)", name) or name in ("ldrd", "strd"):
        registers = operands[operands.find("{") :] if "{" in operands else "a, b"
        ranges = re.findall(r"[a-z](\d+)-[a-z](\d+)", registers)
        return 1 + registers.count(",") + 1 + sum(int(last) - int(first) for first, last in ranges)
    if re.match(r"v?(ldr|str)", name):
        return 2
    if name in ("udiv", "sdiv"):
        return 12
    if name in ("vdiv", "vsqrt"):
        return 14
    return 3 if re.match(r"vf?n?m(la|ls|a|s)$", name) else 1


def stage_table(elf: Path) -> str:
    """What the plugin reads: the address of count_now() and the number of stages, then address and stage, then "=",
    address and cycles."""
    of = {name: i for i, names in enumerate(STAGES.values()) for name in names}
    lines_of = _tool("objdump", "-d", "--no-show-raw-insn", str(elf))
    code = re.findall(r"^ *([0-9a-f]+):\t(\S+)(?:\t([^\n]*))?", lines_of, re.MULTILINE)
    addresses = [address for address, _, _ in code]
    (mark,) = re.findall(r"^([0-9a-f]+) T count_now$", _tool("nm", str(elf)), re.MULTILINE)
    rows = [f"{mark} {len(STAGES)}"]
    lines = _tool("addr2line", "-i", "-f", "-a", "-e", str(elf), stdin="\n".join(addresses))
    for address, *inlined in (block.split("\n") for block in lines.removeprefix("0x").split("\n0x")):
        # innermost first: function, file:line, function, ...
        names = (line.rsplit(":", 1)[0].rsplit("/", 1)[-1].split(".constprop")[0] for line in inlined)
        stage = next((of[name] for name in names if name in of), None)
        if stage is not None:
            rows.append(f"{address} {stage}")
    costs = ((address, cycles_of(mnemonic, operands)) for address, mnemonic, operands in code)
    rows += [f"= {address} {cycles}" for address, cycles in costs if cycles > 1]
    return "\n".join(rows) + "\n"


def _run(elf: Path, target: str, *options: str) -> subprocess.CompletedProcess[str]:
    command = ["qemu-system-arm", "-display", "none", "-monitor", "none", "-serial", "none"]
    command += ["-icount", "shift=0,sleep=off", "-semihosting-config", "enable=on,target=native"]
    command += ["-machine", MACHINES[target], *options, "-kernel", str(elf)]
    try:
        return subprocess.run(
            command, check=True, capture_output=True, text=True, stdin=subprocess.DEVNULL, timeout=_RUN_S
        )
    except FileNotFoundError:
        raise SimulatorError("qemu-system-arm is missing: apt-get install qemu-system-arm") from None
    except subprocess.SubprocessError as error:
        raise SimulatorError(f"{elf}: QEMU: {error}: {getattr(error, 'stderr', '') or ''}".strip()) from None


def _printed(ran: subprocess.CompletedProcess[str], elf: Path) -> Any:
    """What the program has printed, which QEMU's semihosting puts on standard error."""
    try:
        return json.loads(ran.stderr)
    except ValueError:
        raise SimulatorError(f"{elf}: its output cannot be read: {ran.stderr.strip()}") from None


def _instructions(target: str) -> tuple[dict[str, dict[str, int]], dict[str, dict[str, dict[str, float]]]]:
    """Of a tick by controller, and by controller and stage."""
    elf = PROGRAMS / target / "bench_step.elf"
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "stages"
        table.write_text(stage_table(elf))
        ran = _run(elf, target, "-plugin", f"{PLUGIN},table={table}")
        ticks: dict[str, dict[str, int]] = _printed(ran, elf)
        series = [[int(word) for word in line.split()] for line in ran.stdout.splitlines()]
    if tuple(ticks) != TICKS or len(series) != len(TICKS):
        raise SimulatorError(f"{elf}: not the rows that were expected: {', '.join(ticks)}")
    stages = {}
    for controller, (count, *numbers) in zip(ticks, series, strict=True):
        *numbers, cycles, worst = numbers
        ticks[controller] |= {"model_mean": cycles // count, "model_worst": worst}
        if sum(numbers[::2]) // count != ticks[controller]["mean"]:
            raise SimulatorError(
                f"{elf}: {controller}: stages make {sum(numbers[::2]) // count} instructions,"
                f" the timer has counted {ticks[controller]['mean']}"
            )
        stages[controller] = {
            stage: {"mean": round(numbers[2 * i] / count, 1), "worst": numbers[2 * i + 1]}
            for i, stage in enumerate(STAGES)
        }
    return ticks, stages


# --- what is written down ---


def named(changelog: str) -> Cost:
    """Figures that the newest section of the changelog names: "m4-f32 ccu mean 2251 worst 2800"."""
    newest = changelog.split("\n## ")[1]
    found: Cost = {}
    for by, of, figures in re.findall(r"\b(m\d-\w+|image)\s+(\w+)((?:\s+\w+\s+\d+)+)", newest):
        for figure, value in re.findall(r"(\w+)\s+(\d+)", figures):
            found.setdefault(by, {}).setdefault(of, {})[figure] = int(value)
    return found


def findings(cost: Cost, before: Cost, changelog: str) -> list[str]:
    """What costs more than 3 % above what is written down in the baseline and in the changelog, a line each."""
    allowed = named(changelog)
    found = []
    for by, group in cost.items():
        for of, figures in group.items():
            worse = {}
            for figure, value in figures.items():
                if figure in MODEL:
                    continue
                least = before.get(by, {}).get(of, {}).get(figure)
                limit = max(least or 0, allowed.get(by, {}).get(of, {}).get(figure, 0))
                if least is None:
                    found.append(f"{by} {of} {figure}: not in the baseline: run `tools/cost.py --write`")
                elif value > WORSE * limit:
                    worse[figure] = (value, least)
            if worse:
                now = " ".join(f"{figure} {value}" for figure, (value, _) in worse.items())
                was = " ".join(f"{figure} {value}" for figure, (_, value) in worse.items())
                found.append(
                    f"{by} {of}: {now}; was {was}: make it cheaper again, or write into CHANGELOG.md what it is for,"
                    f' with the words "{by} {of} {now}"'
                )
    return found


def lower(cost: Cost, before: Cost) -> Cost:
    """The new baseline: a figure only ever goes down; what may be above it, the changelog says."""
    return {
        by: {
            of: {f: min(v, before.get(by, {}).get(of, {}).get(f, v)) for f, v in figures.items() if f not in MODEL}
            for of, figures in group.items()
        }
        for by, group in cost.items()
    }


def check(result: dict[str, Any]) -> list[str]:
    """What has got worse than is written down, and what the image's stack reserve does not hold."""
    cost: Cost = result["cost"]
    found = findings(cost, json.loads(BASELINE.read_text()), CHANGELOG.read_text())
    used = result["stack"]
    for name in ("all", "crash"):
        if used[name] > (1 - FREE) * result["reserve"][name]:
            found.append(
                f"stack, {name}: {used[name]} bytes at worst; {FREE:.0%} of the {result['reserve'][name]} reserved"
                " must be free (kontur.ld)"
            )
    return found


def write(result: dict[str, Any]) -> None:
    """Baseline and tables of docs/performance.md."""
    before = json.loads(BASELINE.read_text()) if BASELINE.exists() else {}
    BASELINE.write_text(json.dumps(lower(result["cost"], before), indent=2) + "\n")
    page = PAGE.read_text()
    for name, rows in tables(result).items():
        begin, end = f"<!-- {name}: made by `tools/cost.py --write` -->\n", f"<!-- {name}: end -->\n"
        if begin not in page or end not in page:
            raise InputError(f"{PAGE}: the lines {begin.strip()} and {end.strip()} are missing")
        head, rest = page.split(begin)
        page = head + begin + _markdown(rows) + end + rest.split(end)[1]
    PAGE.write_text(page)


Rows = list[list[str]]


def tables(result: dict[str, Any]) -> dict[str, Rows]:
    """The page's tables: `cost`, `stages`, `stack`, `sections`; the first row is the heading."""
    cost: Cost = result["cost"]
    kinds = [(n, kind) for n in MACHINES for kind in ("mean", "worst")] + [("m4-f32", f) for f in MODEL]
    ticks: Rows = [["controller", *(f"{n} {kind}".replace("model_", "cycles ") for n, kind in kinds)]]
    for c in TICKS:
        ticks.append([c, *(str(cost[n][c][kind]) for n, kind in kinds)])
    drivers = cost["image"]["drivers"]
    ticks.append(["+ the board's drivers", str(drivers["mean"]), str(drivers["worst"]), *[""] * (len(ticks[0]) - 3)])
    stages: Rows = [["target", "controller", *STAGES, "sum of means", "whole tick"]]
    for target in MACHINES:
        for c in TICKS:
            by_stage = result["stages"][target][c]
            stages.append(
                [
                    *(target, c),
                    *(f"{s['mean']:.0f} / {s['worst']}" for s in by_stage.values()),
                    f"{sum(s['mean'] for s in by_stage.values()):.0f}",
                    str(cost[target][c]["mean"]),
                ]
            )
    used = result["stack"]
    depth: Rows = [["what", "bytes", "deepest calls"]]
    for level, path in result["stack_path"].items():
        names = ", ".join(name.rsplit(":", 1)[-1] for name in path)
        depth.append([level, str(used[level]), names])
    depth.append(["all but the crash, of the reserve", f"{used['all']} of {result['reserve']['all']}", ""])
    depth.append(["crash, of its own", f"{used['crash']} of {result['reserve']['crash']}", ""])
    sections: Rows = [["section", "flash", "RAM"]]
    for name, size in result["sections"].items():
        sections.append([name, str(size) if name in _FLASH else "", str(size) if name in _RAM else ""])
    size_of = cost["image"]["size"]
    sections.append(["all", str(size_of["flash"]), str(size_of["RAM"])])
    return {"cost": ticks, "stages": stages, "stack": depth, "sections": sections}


def _markdown(rows: Rows) -> str:
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([lines[0], "|---" * len(rows[0]) + "|", *lines[1:]]) + "\n"


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option("--check", "checks", is_flag=True, help="Fail when a figure is over 3 % above what is written down.")
@click.option(
    "--write", "writes", is_flag=True, help="Write the figures down: tests/target/cost.json, docs/performance.md."
)
def main(*, as_json: bool, checks: bool, writes: bool) -> None:
    """What the firmware costs on the microcontroller: instructions of a servo tick, stack, flash and RAM.

    Counted in QEMU and read from the image; `make test-target` builds what that needs.
    """
    try:
        result = measure()
        if writes:
            write(result)
    except KonturError as error:
        raise click.ClickException(str(error)) from error
    if as_json:
        print_json(result)
    elif not checks:
        for name, (heading, *rows) in tables(result).items():
            print_table([dict(zip(heading, row, strict=True)) for row in rows], title=name)
    if checks:
        if found := check(result):
            raise click.ClickException("\n".join(found))
        click.echo("cost of the firmware: nothing above what is written down", err=as_json)


if __name__ == "__main__":
    main()
