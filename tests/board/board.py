# SPDX-License-Identifier: Apache-2.0
"""A board: a chip with an image, wired as docs/hardware.md says, and a CANopen master on its bus."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analog import Dac8563
from chip import Chip

IMAGES = Path(__file__).parents[2] / "build/firmware"
Pin = tuple[str, int]


@dataclass(frozen=True)
class Wiring:
    """Which pins and timers a board uses: (x, y)."""

    image: str
    control_hz: int
    crystal_hz: float
    enable: tuple[Pin, Pin]
    encoders: tuple[str, str]
    contacts: tuple[Pin, ...]  # inputs, closed to ground while all is well
    causes: dict[str, Pin]  # those of them that cut the power
    usart: str
    light: Pin
    alive: Pin
    spi: tuple[str, Pin]  # of the serial DAC, and its SYNC
    brake: tuple[Pin, Pin] | None = None
    outputs: tuple[Pin, ...] = ()  # the first of those beside the axes


_GENERAL = Wiring(
    "kontur", 10000, 8e6, (("B", 12), ("C", 8)), ("tim2", "tim5"),
    (*(("C", n) for n in range(6)), ("B", 1), ("A", 6)),
    {"amplifier x": ("C", 5), "amplifier y": ("B", 1), "stop": ("C", 4), "break": ("A", 6)},
    "usart1", ("C", 13), ("B", 0), ("spi3", ("C", 11)), (("D", 2), ("A", 3)),
    (("B", 11), ("B", 13), ("C", 14), ("C", 9), ("A", 7), ("C", 15)),
)  # fmt: skip
_FEATHER = Wiring(
    "kontur-feather", 10000, 12e6, (("C", 3), ("C", 2)), ("tim3", "tim4"),
    (("A", 6), ("C", 4), ("C", 5)), {"amplifier x": ("C", 4), "amplifier y": ("C", 5), "stop": ("A", 6)},
    "usart3", ("C", 1), ("A", 7), ("spi2", ("B", 14)),
)  # fmt: skip
WIRINGS = {
    "kontur": _GENERAL,
    "kontur-20khz": Wiring("kontur-20khz", 20000, *list(vars(_GENERAL).values())[2:]),
    "kontur-feather": _FEATHER,
    "kontur-feather-20khz": Wiring("kontur-feather-20khz", 20000, *list(vars(_FEATHER).values())[2:]),
}


class Board(Chip):
    def __init__(self, wiring: Wiring) -> None:
        self.wiring = wiring
        super().__init__(IMAGES / f"{wiring.image}.elf")
        self.rcc.crystal_hz = wiring.crystal_hz
        self.serial_dac = Dac8563(self)
        spi, (port, sync) = wiring.spi
        getattr(self, spi).receiver = self.serial_dac
        self.gpio(port).watch = {sync: self.serial_dac.sync}

    def power_on(self, *, after_loader: bool = False) -> None:
        super().power_on(after_loader=after_loader)
        self.serial_dac.power_on()
        for port, pin in self.wiring.contacts:
            self.gpio(port).outside[pin] = False

    def start(self, *, after_loader: bool = False) -> None:
        """Power on, and wait until it is up."""
        self.power_on(after_loader=after_loader)
        assert self.run_until(lambda: any(f[1] == 0x701 for f in self.can.sent), 200), self.state()
        self.run(3)  # the background looks at the health of the chip each millisecond

    def state(self) -> str:
        """For the message of a test that fails."""
        return f"t {self.now_ns / 1e6:.3f} ms, pc {self.pc():#x}, resets {self.resets}, broken {self.broken[:5]}"

    def enabled(self, axis: int) -> bool:
        port, pin = self.wiring.enable[axis]
        return self.gpio(port).level(pin) is True

    def released(self) -> tuple[bool, ...]:
        """Whether the brakes are."""
        return tuple(self.gpio(port).level(pin) is True for port, pin in self.wiring.brake or ())

    def powered(self) -> bool:
        return self.enabled(0) or self.enabled(1)

    def rises(self, since_ns: float) -> list[tuple[float, Pin]]:
        """Each time at which an enable, brake or switched output has gone high since then."""
        pins = (*self.wiring.enable, *(self.wiring.brake or ()), *self.wiring.outputs)
        return [
            (ns, (port, pin))
            for port, pin in pins
            for ns, edge, high in self.gpio(port).edges
            if edge == pin and high and ns > since_ns
        ]

    # ---- the master ----

    def send(self, identifier: int, data: bytes) -> None:
        self.can.receive(identifier, data)

    def _sdo(self, request: bytes) -> bytes:
        before = len(self.can.sent)
        self.send(0x601, request)

        def answers() -> list[bytes]:
            return [data for _, identifier, data in self.can.sent[before:] if identifier == 0x581]

        assert self.run_until(lambda: bool(answers()), 20), f"no answer to an SDO: {self.state()}"
        return answers()[0]

    def read(self, index: int, sub: int = 0) -> int:
        answer = self._sdo(bytes((0x40, index & 255, index >> 8, sub, 0, 0, 0, 0)))
        assert answer[0] != 0x80, f"{index:04X}h:{sub}: abort {answer[:3:-1].hex()}"
        return int.from_bytes(answer[4 : 4 + (4 - (answer[0] >> 2 & 3))], "little")

    def write(self, index: int, sub: int, value: int, size: int) -> None:
        answer = self._sdo(bytes((0x23 | (4 - size) << 2, index & 255, index >> 8, sub)) + value.to_bytes(4, "little"))
        assert answer[0] == 0x60, f"{index:04X}h:{sub}: abort {answer[:3:-1].hex()}"

    def command(self, word: int, ms: float = 3) -> None:
        """A controlword for both axes."""
        self.send(0x201, word.to_bytes(2, "little") * 2)
        self.run(ms)

    def statusword(self, axis: int = 0) -> int:
        return self.read(0x6041 + 0x800 * axis)

    def enable(self) -> None:
        """NMT start, and both axes to "operation enabled"."""
        self.send(0, b"\x01\x01")
        for word in (6, 7, 15):
            self.command(word)
        assert all(map(self.enabled, (0, 1))), f"statusword {self.statusword():04x}; {self.state()}"
