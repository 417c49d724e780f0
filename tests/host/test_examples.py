# SPDX-License-Identifier: Apache-2.0
"""The examples do what they say, as a user runs them."""

import re
import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCRIPT = EXAMPLES / "canopen_only.py"


def test_python_canopen_alone_enables_both_axes_and_drives_circles_by_records_and_by_knots() -> None:
    done = subprocess.run([sys.executable, SCRIPT], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    lines = done.stdout.splitlines()
    assert lines[1] == "both axes: operation enabled"
    assert re.fullmatch(r"circle by 60C1h/68C1h: done, 20\d\d ms of path", lines[2])
    assert lines[3] == "circle by knots: done, 2006 ms of path"
    assert lines[4:] == ["both axes: switch on disabled", "EMCY received: none", "EMCY history:  none"]


def test_example_uses_nothing_of_kontur_but_the_eds() -> None:
    imported = re.findall(r"^(?:import|from) (\w+)", SCRIPT.read_text(), flags=re.MULTILINE)
    assert "canopen" in imported
    assert "kontur" not in imported
