# SPDX-License-Identifier: Apache-2.0
"""Kontur: host tools of a contouring drive.

Rooms, and what each may import; `errors`, `files` and `machine` are for all of them.

    path          -
    can           -
    planning      path, can
    sim           can
    drive         can, planning
    runs          path, can, planning, drive
    report        can, drive, runs
    experiments   path, can, planning, sim, drive, runs, report
    cli           path, can, planning, sim, drive, runs, report, experiments
"""

from importlib.metadata import version

__version__ = version("kontur")
