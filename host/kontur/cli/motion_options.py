# SPDX-License-Identifier: Apache-2.0
"""Options of the verbs that run a path: its limits, parameters of the drive, and the way to the start."""

from __future__ import annotations

from pathlib import Path

import click

from kontur.cli.options import POSITIVE, NumberRange

accel_option = click.option(
    "--accel", type=POSITIVE, metavar="M_PER_S2", help="Acceleration limit of both axes instead of the machine's."
)
jerk_option = click.option(
    "--jerk", type=POSITIVE, metavar="M_PER_S3", help="Jerk limit of both axes instead of the machine's."
)
tolerance_option = click.option(
    "--tolerance",
    type=NumberRange(0.0, 1.0),
    metavar="MM",
    help="How far the path may be from the file's, so that short lines become a smooth curve and corners are gone "
    "round. 0: exact, with a stop at each corner.  [default: what the file says by G61 or G64 P, else 0.01]",
)
params_option = click.option(
    "--params",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="PARAMS.toml",
    help="Set the parameters of this file before, as `kontur design` and `kontur param dump` write it; --set comes "
    "after it.",
)
approach_option = click.option(
    "--approach",
    is_flag=True,
    help="Let a real drive go to the start of the path first, or back to it, in a straight line.",
)
