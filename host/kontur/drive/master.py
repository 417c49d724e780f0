# SPDX-License-Identifier: Apache-2.0
"""Which host commands the drive: one master claims it and sends its heartbeat, others only read (`device.master`).

The drive watches the heartbeat of the master that holds it. When it ceases, the drive stops on the path and switches
off, and the claim ends. docs/protocol.md, Masters, has the rules.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

from kontur.can import wire
from kontur.can.link import RESEND_S
from kontur.drive.objects import Objects, refused_in_this_state
from kontur.errors import DeviceError, HeldError, KonturError, NoAnswerError

_HEARTBEAT_TIMEOUT_MS = 500  # of the drive, for the heartbeat of the master that holds it
_KEY_BITS = 24
CHANNELS = range(0x6C0, 0x6E0, 2)
"""Requests of a holder's own SDO channel; the answers have the next identifier. No service of CiA 301 has these, nor
TPDO5 and TPDO6."""
_UNUSED = 1 << 31
_ATTEMPTS = 5
_STOP_TIMEOUT_S = 5.0  # limits.path_stop_time is at most 1 s


class Master:
    """This host as the master of a drive. `is_stopping` tells whether the drive is in a fault reaction."""

    def __init__(self, objects: Objects, is_stopping: Callable[[], bool]) -> None:
        self._objects = objects
        self._is_stopping = is_stopping
        self._key = 1 + secrets.randbelow((1 << _KEY_BITS) - 1)  # another one than that of any other host
        self._nested = 0

    @property
    def is_held(self) -> bool:
        """Whether the program is inside a `held()`."""
        return self._nested > 0

    @contextmanager
    def held(self) -> Iterator[None]:
        """The drive is this host's alone inside, as long as its heartbeat comes: wait by `link`, not otherwise.

        Raises HeldError when another program holds it. May be nested.
        """
        self.claim()
        self._nested += 1
        try:
            yield
        finally:
            self._nested -= 1
            if not self._nested:
                with suppress(KonturError):  # the first error is the one to report
                    self.release()
                self._objects.link.use_default_channel()
                self._objects.link.stop_heartbeat()  # this ends the claim even if the release is lost

    def claim(self) -> None:
        """Hold the drive: it watches this host's heartbeat from now on. Raises HeldError when another program does."""
        link = self._objects.link
        end_s = link.time_s + 2e-3 * _HEARTBEAT_TIMEOUT_MS
        while True:
            try:
                self._objects.write("master.claim", self._key << 8 | wire.HOST_NODE_ID)
            except DeviceError as error:
                if not refused_in_this_state(error):
                    raise
                raise self._held_by(int(self._objects.read("master.holder"))) from error
            if self._objects.read("master.holder") == wire.HOST_NODE_ID:
                link.send_heartbeat()
                if not link.has_own_channel:
                    self._open_channel()
                return
            if link.time_s > end_s:  # a corrupted request has claimed it for a node that does not exist
                raise DeviceError("the drive cannot be claimed: master.holder reads differently from what was written")
            link.wait(lambda: False, RESEND_S)

    def _open_channel(self) -> None:
        """Let the drive take SDO writes by a channel that is this host's alone, so that it refuses those of others."""
        request = CHANNELS[self._key % len(CHANNELS)]
        for _ in range(_ATTEMPTS):
            with suppress(DeviceError):  # refused: the answer was lost, and the channel is open
                self._objects.write("sdo_server_2.cob_id_response", request + 1)
                self._objects.write("sdo_server_2.cob_id_request", request)
            ids = [int(self._objects.read_stable(f"sdo_server_2.cob_id_{way}")) for way in ("request", "response")]
            if max(ids) < _UNUSED:
                self._objects.link.use_channel(*ids)
                return
        raise DeviceError("the drive opens no SDO channel (1201h) for the master that holds it")

    def release(self) -> None:
        """Hold the drive no longer, and send no heartbeat. Raises DeviceError while an axis is enabled."""
        self._objects.link.wait(lambda: not self._is_stopping(), _STOP_TIMEOUT_S)
        self._objects.write("master.claim", self._key << 8)
        self._objects.link.use_default_channel()
        self._objects.link.stop_heartbeat()

    def allow_enabling(self) -> None:
        """Let the drive be enabled by the controlwords of the next second (`master.arm`).

        When a frame of this is lost, nothing is raised: the caller repeats it.
        """
        try:
            self._objects.write("master.arm", self._objects.read("master.ticket"))
        except NoAnswerError:
            raise
        except DeviceError:
            pass

    def _held_by(self, holder: int) -> HeldError:
        drive = f"drive {self._objects.link.node_id} on {self._objects.link.bus.channel_info}"
        if not holder:
            return HeldError(
                f"{drive} has power for a master that has not claimed it: switch it off there, or reset the drive"
            )
        return HeldError(
            f"{drive} is held by master {holder}, another program that commands it: stop that program, or wait until "
            f"its heartbeat has been gone for {_HEARTBEAT_TIMEOUT_MS} ms"
        )
