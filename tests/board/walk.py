# SPDX-License-Identifier: Apache-2.0
"""A random walk over all that a board meets, and what must hold between any two servo ticks of it.

    python tests/board/walk.py --board kontur --seeds 1..50 [--ms 400]

- No force without power: an analog command is at its middle, and PWM at no force, while the enable line is low.
- No brake is released without power.
- No power while something lasts that cuts it: a fault of an amplifier, a stop for longer than its reaction may take, a
  low supply, a crystal that has just stopped, a break of PWM; nor after 3.3 ms of a halt.
- No force before an amplifier that says "ready" has said so, and no power when it has not in its time. Some of them
  never do, and some contacts stick.
- Both watchdogs are fed in time: a reset has a reason.
- No rule of the models is broken.

A walk is its seed: the same one fails at the same place.
"""

from __future__ import annotations

import argparse
import random
import sys
from collections.abc import Callable

from analog import MID_SCALE
from board import WIRINGS, Board
from wires import FRAMING, NOISE

DAC, PWM, SERIAL = range(3)  # 2104h:1
ENABLE_DELAY_MS = 10  # of amplifiers that say "ready"
NEVER = 1e9  # ms
FILTER_TICKS = 4  # an input counts after three equal reads
STOP_MS = 300  # a quick stop takes 2130h:2, then the brake its time
SAFE_MS = 0.02  # what makes the outputs safe by an interrupt
START_MS = 8.0  # after a reset, or the halt that it came in: until the image has configured the serial DAC
HALT_MS = 3.3


class Amplifier:
    """One that says "ready" only while it is live: its contact is open until some time after it is enabled, and again
    when it fails. Or its contact sticks."""

    def __init__(self, walk: Walk, axis: int) -> None:
        self.walk, self.axis = walk, axis
        self.port, self.pin = walk.board.wiring.causes[f"amplifier {'xy'[axis]}"]
        self.sticks = walk.random.random() < 0.3
        self.enabled_ms: float | None = None
        self.takes_ms = self.fails_ms = NEVER

    def follow(self, now_ms: float) -> None:
        """Its contact opens or closes."""
        if not self.walk.board.enabled(self.axis):
            self.enabled_ms = None
        elif self.enabled_ms is None:
            self.enabled_ms = now_ms
            self.takes_ms = self.walk.random.choice((1.0, 1.0, 4.0, 4.0, 8.0, NEVER))
            self.fails_ms = self.walk.random.choice((15.0, 40.0, NEVER))
        if not self.sticks:
            since_ms = -1.0 if self.enabled_ms is None else now_ms - self.enabled_ms
            self.walk.board.gpio(self.port).outside[self.pin] = not self.takes_ms <= since_ms < self.fails_ms

    def may_have_force(self, now_ms: float, tick_ms: float) -> bool:
        least_ms = ENABLE_DELAY_MS - tick_ms if self.sticks else self.takes_ms
        return self.enabled_ms is not None and now_ms - self.enabled_ms >= least_ms

    def may_have_power(self, now_ms: float, filter_ms: float) -> bool:
        most_ms = ENABLE_DELAY_MS + 2.0 if self.takes_ms == NEVER else self.fails_ms
        return self.sticks or self.enabled_ms is None or now_ms - self.enabled_ms < most_ms + filter_ms


class Walk:
    def __init__(self, board: Board, seed: int, ready: bool | None = None) -> None:
        self.board = board
        self.random = random.Random(f"{board.wiring.image} {seed}")
        self.name = f"{board.wiring.image}, seed {seed}"
        self.done: list[str] = []
        self.output = self.random.choice((DAC, SERIAL) if board.wiring.brake is None else (DAC, PWM, SERIAL))
        self.antiphase = self.output == PWM and self.random.random() < 0.5
        self.tick_ms = 1e3 / board.wiring.control_hz
        self.since: dict[str, float] = {}  # ms at which something began that cuts the power
        self.expected_resets = 1
        ready = self.random.random() < 0.4 if ready is None else ready  # 2104h:7
        self.amplifiers = [Amplifier(self, axis) for axis in (0, 1)] if ready else []
        self.frame_may_break = False  # of the serial DAC, without effect: safe outputs do not wait for its end
        self.released_ms = 0.0  # when the last halt ended
        self.with_power = self.with_force = 0  # checks

    # ---- what must hold ----

    def _now_ms(self) -> float:
        return self.board.now_ns / 1e6

    def _idle(self, axis: int) -> bool:
        """Whether this axis has no force by any output."""
        board = self.board
        if self.output == PWM and board.powered():
            return board.tim8.duty(axis + 1) == (0.5 if self.antiphase else 0.0)
        serial_counts = self._now_ms() - max(board.resets[-1][0] / 1e6, self.released_ms) > START_MS
        return board.dac.codes()[axis] in (None, 2048) and not (
            serial_counts and board.serial_dac.codes[axis] != MID_SCALE
        )

    def check(self) -> None:
        board = self.board
        released = board.released()
        self.with_power += board.powered()
        self.with_force += not (self._idle(0) and self._idle(1))
        for axis in (0, 1):
            if not board.enabled(axis):
                assert self._idle(axis), self._told(f"a force without power on axis {axis}")
                assert not any(released[axis : axis + 1]), self._told(f"brake {axis} is released without power")
        for amplifier in self.amplifiers:
            axis, filter_ms = amplifier.axis, self._allowed_ms("amplifier")
            ready = amplifier.may_have_force(self._now_ms(), self.tick_ms)
            assert ready or self._idle(axis), self._told(f"a force before the amplifier of axis {axis} is ready")
            assert amplifier.may_have_power(self._now_ms(), filter_ms), self._told(f"power on axis {axis} not ready")
        if board.powered():
            for cause, since_ms in self.since.items():
                assert self._now_ms() - since_ms < self._allowed_ms(cause), self._told(f"power in spite of {cause}")

    def _allowed_ms(self, cause: str) -> float:
        slow = {"stop": STOP_MS, "supply": SAFE_MS, "crystal": SAFE_MS, "break": 2 * self.tick_ms + SAFE_MS}
        return slow.get(cause, (FILTER_TICKS + 2) * self.tick_ms)

    def _told(self, what: str) -> str:
        board = self.board
        return (
            f"{self.name}: {what} at {self._now_ms():.3f} ms; {board.state()}; enabled {board.enabled(0)},"
            f" {board.enabled(1)}; dac {board.dac.codes()}, serial {board.serial_dac.codes}; since {self.since};"
            f" last steps {self.done[-12:]}"
        )

    def _run(self, ms: float) -> None:
        """Let time pass, and look between the servo ticks."""
        board = self.board
        end_ns = board.now_ns + ms * 1e6
        while board.now_ns < end_ns:
            board.run(min(self.tick_ms / 2, (end_ns - board.now_ns) / 1e6 + 1e-6))
            for amplifier in self.amplifiers:
                amplifier.follow(self._now_ms())
            assert len(board.resets) <= self.expected_resets, self._told(f"a reset without a reason: {board.resets}")
            if not board.active:
                self.check()
        if self.frame_may_break:
            board.broken = [line for line in board.broken if "SYNC rises after" not in line]
        assert not board.broken, self._told("a rule is broken")

    # ---- steps ----

    def _controlwords(self) -> None:
        words = self.random.choice(((6, 7, 15), (0x80, 6, 7, 15), *((n,) for n in (0x80, 0, 2, 7, 11, 6, 31, 271))))
        for word in words:
            pair = (word, self.random.choice((word, word, word, self.random.getrandbits(16))))
            self.board.send(0x201, b"".join(w.to_bytes(2, "little") for w in pair))
            self._run(self.random.choice((0.1, 1.0, 3.0)))

    def _enable(self) -> None:
        self.board.send(0, b"\x01\x01")
        for word in (0, 0x80, 6, 7, 15):
            self.board.send(0x201, word.to_bytes(2, "little") * 2)
            self._run(3)
        self._push()

    def _push(self) -> None:
        """Both axes away from where they are held, so that there is a force."""
        for encoder in self.board.wiring.encoders:
            getattr(self.board, encoder).move(self.random.choice((-20, 20)))
        self._run(self.tick_ms * self.random.uniform(0, 20))

    def _contact(self) -> None:
        theirs = {(amplifier.port, amplifier.pin) for amplifier in self.amplifiers}
        port, pin = self.random.choice([c for c in self.board.wiring.contacts if c not in theirs])
        outside = self.board.gpio(port).outside
        outside[pin] = not outside[pin]
        self._note_causes()
        self._run(self.random.choice((0.05, 0.2, 1.0, 5.0)))
        if self.random.random() < 0.8:
            outside[pin] = False
            self._note_causes()

    def _note_causes(self) -> None:
        """Which contacts are open, and since when."""
        for cause, (port, pin) in self.board.wiring.causes.items():
            if self.amplifiers and cause.startswith("amplifier"):
                continue
            if self.board.gpio(port).outside.get(pin) and (cause != "break" or self.output == PWM):
                self.since.setdefault(cause, self._now_ms())
            else:
                self.since.pop(cause, None)

    def _supply(self) -> None:
        self._push()
        self.frame_may_break = True
        low = self.random.random() < 0.6
        was_low = self.board.pwr.low
        self.board.pwr.set_supply(self.random.uniform(2.5, 2.9) if low else self.random.uniform(2.95, 3.3))
        if self.board.pwr.low and not was_low:
            self.expected_resets += 1
            self.since["supply"] = self._now_ms()
        self._run(self.random.choice((0.05, 1.0, 20.0)))
        self.board.pwr.set_supply(3.3)
        self.since.pop("supply", None)
        self._run(30)

    def _crystal(self) -> None:
        """It stops for good, at any instruction."""
        self._push()
        if self.board.rcc.crystal_hz is None:
            return
        self.frame_may_break = True
        self.board.rcc.fail_crystal()
        self.since["crystal"] = self._now_ms()
        self._run(self.random.choice((0.05, 1.0)))
        del self.since["crystal"]
        self._run(20)

    def _halt(self) -> None:
        board = self.board
        self._push()
        self.frame_may_break = True
        if self.random.random() < 0.5:
            board.dbgmcu.words[8] = board.dbgmcu.words.get(8, 0) | 1 << 12 | 1 << 11  # as a debugger that connects
            self._run(1)
        ms = self.random.choice((0.01, 1.0, 4.0))
        self.expected_resets += 1
        board.halted = True
        board.run(ms)
        assert not (ms > HALT_MS and board.powered()), self._told("a halt keeps the power")
        board.halted = False
        self.released_ms = self._now_ms()
        self._run(25)

    def _encoder(self) -> None:
        encoder = getattr(self.board, self.random.choice(self.board.wiring.encoders))
        for _ in range(self.random.randrange(1, 20)):
            encoder.move(round(self.random.gauss(0, 1) * 10 ** self.random.uniform(0, self.random.choice((1, 2, 4)))))
            self._run(self.tick_ms * self.random.randrange(1, 5))

    def _bus(self) -> None:
        can = self.board.can
        what = self.random.randrange(4)
        if what == 0:
            can.bus_off()
        elif what == 1:
            can.acknowledged = False
            self._run(self.random.uniform(0, 10))
            can.acknowledged = True
        else:
            for _ in range(self.random.randrange(1, 30)):
                known = (0, 0x80, 0x201, 0x301, 0x401, 0x601, 0x7E5, 0x77F, self.random.getrandbits(11))
                identifier = self.random.choice(known)
                data = self.random.randbytes(self.random.choice((0, 1, 2, 4, 8, 8)))
                if identifier == 0 and self.random.random() < 0.7:
                    data = bytes((self.random.choice((1, 2, 0x80, 0x81, 0x82)), self.random.choice((0, 1))))
                self.board.send(identifier, data)
                self._run(self.random.uniform(0.05, 0.3))
        self._run(2)

    def _serial(self) -> None:
        usart = getattr(self.board, self.board.wiring.usart)
        if usart.BRR not in usart.words:
            return  # it is not up yet
        data = self.random.choice((b"O\r", b"C\r", b"t20140F000F00\r", b"\r" * 5, self.random.randbytes(20)))
        usart.receive(data, self.random.choice((0, 0, FRAMING, NOISE)))
        self._run(1)
        usart.receive(b"\rC\r")
        self._run(1)

    def _wait(self) -> None:
        self._run(self.random.choice((1.0, 10.0)))

    STEPS: tuple[tuple[int, Callable[[Walk], None]], ...] = (
        (12, _enable), (4, _controlwords), (4, _contact), (1, _supply), (1, _halt), (1, _crystal), (5, _encoder),
        (3, _bus), (2, _serial), (2, _wait), (5, _push),
    )  # fmt: skip

    def run(self, ms: float) -> None:
        """Power on, set it up in one of its ways, and walk for so long."""
        board = self.board
        board.start()
        for axis in (0, 0x800):
            board.write(0x2104 + axis, 1, self.output, 1)
            delay_ms = ENABLE_DELAY_MS if self.amplifiers else self.random.choice((0, 0, 3, 10))
            board.write(0x2104 + axis, 6, delay_ms, 2)
            board.write(0x2104 + axis, 7, int(bool(self.amplifiers)), 1)
            board.write(0x2160 + axis, 1, self.random.choice((0, 5)), 2)
            board.write(0x2160 + axis, 2, self.random.choice((0, 5)), 2)
        if self.output == PWM:
            board.write(0x2163, 2, int(self.antiphase), 1)
        self._run(3)
        self._enable()
        weights, steps = zip(*self.STEPS, strict=True)
        end_ms = self._now_ms() + ms
        while self._now_ms() < end_ms:
            step = self.random.choices(steps, weights)[0]
            self.done.append(f"{step.__name__} {self._now_ms():.1f}")
            step(self)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--board", choices=WIRINGS, action="append")
    parser.add_argument("--seeds", default="1..10", help="FIRST..LAST")
    parser.add_argument("--ms", type=float, default=400)
    options = parser.parse_args()
    first, last = map(int, options.seeds.split(".."))
    failed = 0
    for seed in range(first, last + 1):
        for name in options.board or WIRINGS:
            walk = Walk(Board(WIRINGS[name]), seed)
            try:
                walk.run(options.ms)
                ready = ", ready" if walk.amplifiers else ""
                print(
                    f"{walk.name}{ready}: {walk.with_power} checks with power, {walk.with_force} with force", flush=True
                )
            except AssertionError as error:
                failed += 1
                print(error, flush=True)
    print(f"{failed} failed")
    sys.exit(bool(failed))


if __name__ == "__main__":
    main()
