# SPDX-License-Identifier: Apache-2.0
"""What a user should know of a G-code program that can be run."""

from __future__ import annotations

from collections.abc import Sequence

from kontur.path.events import Events
from kontur.path.geometry import Dwell, Move
from kontur.path.moves import dwells_in

_LONG_DWELL_S = 10.0


def notes(items: Sequence[Move | Dwell], events: Events) -> tuple[str, ...]:
    """Sentences on words that do nothing here, and on long dwells."""
    found = []
    ignored = {kind: found for kind, found in events.kinds().items() if kind in "TABC"}
    if ignored:
        words = ", ".join(word if count == 1 else f"{word} ×{count}" for word, (count, _) in ignored.items())
        first = next(iter(ignored.values()))[1].line
        found.append(f"Not executed, since the machine has no such thing: {words}; first in line {first}.")
    long = [dwell for _, dwell in dwells_in(items) if dwell.duration_s > _LONG_DWELL_S]
    if long:
        how_many = "1 dwell waits" if len(long) == 1 else f"{len(long)} dwells wait"
        where = f"in line {long[0].line}" if len(long) == 1 else f"the first in line {long[0].line} and the longest"
        longest = max(item.duration_s for item in long)
        found.append(
            f"{how_many} for more than {_LONG_DWELL_S:g} s, {where} for {longest:g} s: P is in seconds. "
            "Some programs mean milliseconds."
        )
    return tuple(found)
