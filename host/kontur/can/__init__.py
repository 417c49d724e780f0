# SPDX-License-Identifier: Apache-2.0
"""What goes over the bus: opening one, the connection to one node, frames and their scaling, EMCY codes, a bad bus.

It imports nothing but the ground floor, so a real drive's bus brings no simulator along.
"""

from pathlib import Path

EDS = Path(__file__).parents[1] / "kontur-units.eds"  # kontur.eds, and the units, which CiA 306 has no key for
