# SPDX-License-Identifier: Apache-2.0
"""Options of the verbs that read a path from a file."""

from __future__ import annotations

import click

from kontur.cli.options import POSITIVE

z_option = click.option(
    "--z",
    type=click.Choice(("pen", "ignore", "refuse")),
    default="pen",
    show_default=True,
    help="G-code's other axes. pen: z is a pen, which goes up and down while x and y stand or go rapidly (G0); z that "
    "changes while they cut is refused. ignore: x and y go as programmed, whatever the others do. refuse: no word of "
    "theirs is taken.",
)
interpreter_option = click.option(
    "--interpreter",
    is_flag=True,
    help="Read G-code by LinuxCNC's interpreter, the program rs274 of the Debian package linuxcnc-uspace: parameters, "
    "expressions, O words, cycles, cutter compensation.",
)
laser_option = click.option(
    "--laser",
    is_flag=True,
    help="S is the power of a laser: on while M3 or M4 is, in moves at a feed alone; with M4 it goes with the speed. "
    "Else it is the speed of a spindle.",
)
full_s_option = click.option(
    "--full-s",
    type=POSITIVE,
    default=1000.0,
    show_default=True,
    metavar="S",
    help="The value of S, or of Q of M67 and M68, at full power.",
)
