# SPDX-License-Identifier: Apache-2.0
"""`kontur experiment`: defined experiments on the simulated drive."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click

from kontur import machine as machines
from kontur.cli.options import (
    CONTROLLER,
    MACHINE,
    check_output,
    parameter_option,
    parameter_values,
    progress_bar,
    simulated_target_options,
    simulation_options,
)
from kontur.cli.output import print_json, print_table
from kontur.cli.work_options import rows_file, work_options, write_table
from kontur.drive.controllers import CONTROLLERS, described
from kontur.experiments import COMPARED, REFERENCE
from kontur.experiments.circles import CASES, paper
from kontur.files import write_atomically
from kontur.machine import ALL, MACHINES, told_text

if TYPE_CHECKING:
    from kontur.drive.target import Target

_ESTIMATOR_HEADINGS = {
    "speed_mps": "mm/s",
    "lag_over_radius": "lag/radius up to",
    "newton_nm": "Newton nm",
    "paper_nm": "paper nm",
    "drive_nm": "drive's lag_max nm",
}

_ROBUST_HEADINGS = {
    "unstable": "unstable runs",
    "median_um": "median µm",
    "worst_um": "worst µm",
    "worst_seed": "at seed",
    "over_ccu_median": "mean over ccu: median",
    "over_ccu_worst": "least",
    "over_ccu_rms_worst": "least by rms",
    "over_ccu_max_worst": "least by max",
}

_DESIGNED = "full: the drive was told all of the machine; rigid: what a rigid axis has"


@click.group(name="experiment")
def command() -> None:
    """Run a defined experiment on the simulated drive."""


@command.command(name="paper")
@click.option("--case", "cases", type=click.Choice(list(CASES)), multiple=True, help="Only this circle (default: all).")
@click.option(
    "--controller",
    "controllers",
    type=CONTROLLER,
    multiple=True,
    default=["all"],
    show_default=True,
    help=f"Controller, by either name: {described()}.",
)
@click.option(
    "--seeds", type=click.IntRange(1, 1000), default=1, show_default=True, help="Number of seeds, from --seed on."
)
@parameter_option
@click.option("--picture", type=click.Path(dir_okay=False, path_type=Path),
              help="Save mean and greatest errors as a picture for a column of a paper (.svg, .pdf).")  # fmt: skip
@work_options
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@simulated_target_options
def paper_command(
    *,
    cases: tuple[str, ...],
    controllers: tuple[str, ...],
    seeds: int,
    parameters: tuple[tuple[str, str], ...],
    picture: Path | None,
    out: Path | None,
    workers: int | str | None,
    as_json: bool,
    target: Target,
) -> None:
    """Run the paper's circles: 4.488 mm/s r 4 mm (low), 100 mm/s r 20 mm (high), 100 mm/s r 4 mm (high-tight)."""
    check_output(picture, ".svg", ".pdf")
    if out is not None and out.suffix in (".svg", ".pdf"):
        raise click.UsageError(f"--out {out}: is the folder that keeps the runs; a picture goes to --picture {out}")
    cases, controllers = cases or tuple(CASES), CONTROLLERS if "all" in controllers else controllers
    kept = rows_file(out, "paper")
    with progress_bar("experiment paper") as progress:
        rows = paper(
            target,
            cases,
            controllers,
            range(target.seed, target.seed + seeds),
            parameter_values(parameters),
            kept,
            workers,
            progress,
        )
    if picture is not None:
        from kontur.report import column

        with column.column_style():
            write_atomically(picture, column.as_file(column.of_cases(rows), picture.suffix.lower()[1:]))
    if kept is not None:
        write_table(rows, kept)
    if as_json:
        print_json({"cases": rows})
    else:
        print_table(
            rows, f"True contour error of the tool; the drive was {told_text(target.told, target.compensation)}"
        )


@command.command(name="estimator")
@click.option(
    "--stretches", type=click.IntRange(2, 10_000), default=100, show_default=True, help="Places on each curve."
)
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@simulation_options
def estimator_command(*, stretches: int, as_json: bool, machine: str, seed: int, num: str) -> None:
    """Compare the drive's estimate of the contour error with the exact one, on seven curves, 1 to 200 mm/s."""
    from kontur.experiments.estimator import experiment, worst

    with progress_bar("experiment estimator") as progress:
        head, cells = experiment(machines.load(machine), num, seed=seed, stretches=stretches, progress=progress)
    rows = [asdict(cell) for cell in cells if cell.rows]
    if as_json:
        print_json(head | {"worst_nm": worst(cells), "cells": rows})
    else:
        for row in rows:
            row["speed_mps"] *= 1e3
        print_table(rows, "Worst |e_n2 - exact|", _ESTIMATOR_HEADINGS)
        click.echo(f"With the Newton step, lag up to 0.2 radii: at most {worst(cells):.3g} nm ({head['num_backend']})")


@command.command(name="on-chip")
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@click.option(
    "--num", type=click.Choice(("f32", "fix")), default="f32", show_default=True, help="Numbers of the drive."
)
def on_chip_command(*, as_json: bool, num: str) -> None:
    """Compare the machine that the drive simulates (onchip_plant) with the simulator's, on four circles."""
    from kontur.experiments import on_chip

    with progress_bar("experiment on-chip") as progress:
        rows = on_chip.compare(machines.load(MACHINES / "table1_on_chip.toml"), num, progress=progress)
    if as_json:
        print_json(rows)
    else:
        headings = {"radius_mm": "radius mm", "feed_mm_s": "mm/s", "mean_nm": "mean nm", "max_nm": "max nm"}
        print_table(
            rows, f"Distance of the true positions, at the control rate; both drives were {told_text(ALL)}", headings
        )


@command.command(name="robust")
@click.option(
    "--seeds", type=click.IntRange(1, 10_000), default=20, show_default=True, help="Number of draws, from --seed on."
)
@click.option(
    "--controller",
    "controllers",
    type=CONTROLLER,
    multiple=True,
    default=list(COMPARED),
    show_default=True,
    help=f"Controller, by either name: {described()}. {REFERENCE} always runs: the others are compared with it.",
)
@parameter_option
@work_options
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
@simulation_options
def robust_command(
    *,
    seeds: int,
    controllers: tuple[str, ...],
    parameters: tuple[tuple[str, str], ...],
    out: Path | None,
    workers: int | str | None,
    as_json: bool,
    machine: str,
    seed: int,
    num: str,
) -> None:
    """Run controllers on random machines, of which the drive is told encoder lengths and force limits alone: all else
    it knows, its gains too, is of --machine."""
    from kontur.experiments.robust import robust, summarise

    kept = rows_file(out, "robust")
    with progress_bar("experiment robust") as progress:
        rows = robust(
            machines.load(machine),
            range(seed, seed + seeds),
            num,
            parameter_values(parameters),
            CONTROLLERS if "all" in controllers else controllers,
            kept,
            workers,
            progress,
        )
    if kept is not None:
        write_table(rows, kept)
    found = summarise(rows)
    if as_json:
        print_json(found | {"draws": rows})
        return
    print_table(
        [{"controller": name} | found["controllers"][name] for name in found["controllers"]],
        f"{seeds} draws from seed {seed} on: mean of the true contour error, draw by draw; the drive was told encoder "
        "lengths and force limits of the drawn machine, and all else of --machine",
        _ROBUST_HEADINGS,
    )


@command.command(name="machines")
@click.option(
    "--seeds",
    type=click.IntRange(0, 1000),
    default=4,
    show_default=True,
    help="Number of drawn machines, from --seed on.",
)
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="First seed of the drawn machines.")
@click.option("--machine", "files", type=MACHINE, multiple=True, help="A machine besides; may be given several times.")
@click.option("--factory", is_flag=True, help="Every controller with factory gains, in place of designs.")
@work_options
@click.option("--json", "as_json", is_flag=True, help="Print the result as JSON.")
def machines_command(
    *,
    seeds: int,
    seed: int,
    files: tuple[str, ...],
    factory: bool,
    out: Path | None,
    workers: int | str | None,
    as_json: bool,
) -> None:
    """Design ccu and cascade for real machines, and compare the true errors of the tool on four paths.

    The machines are the four of this program and drawn ones from the ranges of practice. One takes some minutes.
    """
    from kontur.experiments import machines as experiment

    work = [*experiment.packaged(), *map(machines.load, files), *map(experiment.draw, range(seed, seed + seeds))]
    kept = rows_file(out, "machines")
    with progress_bar("experiment machines") as progress:
        rows = experiment.compare(work, factory, rows_file=kept, workers=workers, progress=progress)
    if kept is not None:
        write_table(rows, kept)
    found = experiment.summarise(rows)
    if as_json:
        print_json(found)
        return
    print_table(
        [
            {"machine": row["name"], "case": case}
            | {name: one["mean_um"] if one["mean_um"] is not None else one["ended"] for name, one in made.items()}
            for row in rows
            for case, made in row["runs"].items()
        ],
        "Mean of the true contour error of the tool, µm, " + ("with factory gains" if factory else _DESIGNED),
    )
    counts = ", ".join(f"{what} {found[what]}" for what in ("unstable", "oscillating", "tripped", "no_design"))
    ratios = ", ".join(
        f"{name.replace('_', ' ')} {found[name]:.2f}" for name in found if name.startswith("ratio") and found[name]
    )
    click.echo(f"Runs: {counts}. {ratios}")
