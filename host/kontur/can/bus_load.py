# SPDX-License-Identifier: Apache-2.0
"""The share of the bus that the default PDOs take while knots are streamed, in the worst case of bit stuffing.

A data frame with an 11-bit identifier and n bytes has 47 + 8 n bits, the three between frames included; of these
34 + 8 n are subject to stuffing, at worst one more for each four after the first: (34 + 8 n - 1) / 4. See Davis,
Burns, Bril, Lukkien, "Controller Area Network (CAN) schedulability analysis: refuted, revisited and revised", Real-Time
Systems 35 (2007), (1). Rates and lengths are those of the EDS.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kontur.can import EDS

BITRATE = 1_000_000
_RPDO, _TPDO = (0x1400, 0x1600), (0x1800, 0x1A00)  # CiA 301: first communication and mapping objects
_KNOTS = "knot"  # an RPDO that carries this object is sent once a knot
_RANGE = "telemetry.contour_error_least"  # a TPDO that carries this one is on in a circular test alone


@dataclass(frozen=True)
class Load:
    """One kind of frame: its rate, its data bytes, its bits in the worst case, and its share of the bus."""

    name: str
    rate_hz: float
    data_bytes: int
    bits: int
    share: float


def worst_case_bits(data_bytes: int) -> int:
    """Bits of a frame with an 11-bit identifier, with the most stuff bits possible, and of the gap after it."""
    return 47 + 8 * data_bytes + (34 + 8 * data_bytes - 1) // 4


def loads(bitrate: int = BITRATE, eds: str | Path = EDS) -> list[Load]:
    """Every kind of frame that is sent cyclically while knots are streamed and telemetry is on, by the EDS.

    SDO, EMCY and the TPDO1 of a change of state are not cyclic and not among them, nor is TPDO6 of a circular test.
    """
    import canopen

    from kontur.can.link import HEARTBEAT_S

    dictionary = canopen.import_od(str(eds), 1)
    knot_hz = 1e6 / dictionary["clock.knot_us"].default
    in_test = dictionary[_RANGE]
    range_address = in_test.index << 8 | in_test.subindex
    found: list[Load] = []

    def add(name: str, rate_hz: float, data_bytes: int) -> None:
        bits = worst_case_bits(data_bytes)
        found.append(Load(name, rate_hz, data_bytes, bits, rate_hz * bits / bitrate))

    for kind, (communication, mapping) in (("RPDO", _RPDO), ("TPDO", _TPDO)):
        for i in range(512):
            if communication + i not in dictionary:
                continue
            entries = [_value(dictionary, mapping + i, k + 1) for k in range(_value(dictionary, mapping + i, 0))]
            if kind == "TPDO":
                of_stream = all(entry >> 8 != range_address for entry in entries)
                event_ms = _value(dictionary, communication + i, 5)
                rate_hz = 1000.0 / event_ms if event_ms and of_stream else 0.0
            else:
                rate_hz = knot_hz if any(entry >> 16 == dictionary[_KNOTS].index for entry in entries) else 0.0
            if rate_hz:
                add(f"{kind}{i + 1}", rate_hz, sum(entry & 0xFF for entry in entries) // 8)
    add("heartbeat of the drive", 1000.0 / dictionary["heartbeat_producer"].default, 1)
    add("heartbeat of the host", 1.0 / HEARTBEAT_S, 1)
    return found


def _value(dictionary: Any, index: int, subindex: int) -> int:
    value: int = dictionary[index][subindex].default
    return value
