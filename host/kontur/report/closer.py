# SPDX-License-Identifier: Apache-2.0
"""The part of a report to look closer: time and path linked, zoom, values, runs on and off. The rows are in the page.

A run has at most ROWS_MAX / runs rows there: beyond that, of each stretch of time those with the least and the greatest
error. Rows are differences of int32 from row to row, column by column, deflated, in base64.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kontur.report.figures import Entry, thinned

ROWS_MAX = 80_000
_UNKNOWN = np.iinfo(np.int32).min
_COLUMNS = (
    ("time", 1e-4),
    ("x", 1e-5),
    ("y", 1e-5),
    ("error", 1e-4),
    ("along", 1e-3),
    ("force_x", 0.1),
    ("force_y", 0.1),
)
"""Names, and the value of one: s, mm, mm, µm, µm, N, N."""

_SCRIPT = Path(__file__).with_name("closer.js")
_SECTION = """<section id="closer" hidden><h2>Look closer</h2>
<p class="note">Point at a spike in time to see it on the path, or at the path to see it in time. Drag in time to zoom
in, double-click for the whole run. Keys: arrows, + and -, Escape.</p>
<div class="look"><label>Signal <select id="closer-signal"></select> <span id="closer-unit"></span></label>
<span id="closer-runs"></span><button id="closer-whole" type="button">Whole run</button></div>
<canvas id="closer-time" tabindex="0" role="img" aria-label="signal over time"></canvas>
<div class="pair"><div><p class="note"><span id="closer-scale"></span></p>
<canvas id="closer-path" tabindex="0" role="img" aria-label="path with magnified error"></canvas></div>
<div><p class="note" id="closer-at"></p><div class="scroll"><table class="values"><thead><tr><th></th>
<th>error µm</th><th>along µm</th><th>force x N</th><th>force y N</th><th>x mm</th><th>y mm</th></tr></thead>
<tbody id="closer-values"></tbody></table></div></div></div></section>
"""


def closer(entries: Sequence[Entry]) -> str:
    """The HTML of the section, for runs whose logs have the path."""
    runs = [
        {"label": entry.label, "colour": entry.colour, "count": len(keep), "rows": _packed(entry, keep)}
        for entry in entries
        for keep in [thinned(entry.log.columns["time_s"], entry.error_um, ROWS_MAX // len(entries) // 2 - 1)
                     if len(entry.log) > ROWS_MAX // len(entries) else np.arange(len(entry.log))]
    ]  # fmt: skip
    data = json.dumps({"columns": _COLUMNS, "runs": runs}).replace("<", "\\u003c")
    packed = f'<script type="application/json" id="closer-data">{data}</script>'
    return f'{_SECTION}{packed}\n<script id="closer-script">{script()}</script>'


def script() -> str:
    """The script of the section."""
    return _SCRIPT.read_text("utf-8")


def script_hash() -> str:
    """What a Content-Security-Policy allows it by."""
    return f"sha256-{base64.b64encode(sha256(script().encode()).digest()).decode()}"


def _packed(entry: Entry, keep: NDArray[np.intp]) -> str:
    columns = entry.log.columns
    nothing = np.full(len(entry.log), np.nan)
    along = "true_tangential_error_um" if entry.summary.truth else "tangential_error_um"
    values = (
        columns["time_s"],
        columns["reference_x_mm"],
        columns["reference_y_mm"],
        entry.error_um,
        *(columns.get(name, nothing) for name in (along, "force_x_N", "force_y_N")),
    )
    table = [
        np.where(np.isfinite(value), np.clip(np.rint(value / unit), _UNKNOWN + 1, -_UNKNOWN - 1), _UNKNOWN)
        for value, (_, unit) in zip((value[keep] for value in values), _COLUMNS, strict=True)
    ]
    counts = np.array(table, dtype=np.int64)
    differences = np.diff(counts, axis=1, prepend=0).astype(
        np.uint32, casting="unsafe"
    )  # modulo 2**32, as in JavaScript
    return base64.b64encode(zlib.compress(differences.astype("<u4").tobytes(), 9)).decode()
