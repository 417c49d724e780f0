# SPDX-License-Identifier: Apache-2.0
"""A log as a MAT file (version 5, by SciPy), which MATLAB and Octave load."""

from __future__ import annotations

import io
import json
from pathlib import Path

import scipy.io

from kontur.files import write_atomically
from kontur.runs.log import RunLog

_HEADER = b"MATLAB 5.0 MAT-file, a log of kontur".ljust(116)  # SciPy puts the date there


def write(run: RunLog, path: str | Path) -> None:
    """Write each column as a vector (n, 1) of its name, and `meta` as JSON text. Raises FileError."""
    out = io.BytesIO()
    scipy.io.savemat(out, {**run.columns, "meta": json.dumps(dict(run.meta))}, long_field_names=True, oned_as="column")  # type: ignore[arg-type]
    write_atomically(Path(path), _HEADER + out.getvalue()[len(_HEADER) :])
