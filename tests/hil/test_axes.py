# SPDX-License-Identifier: Apache-2.0
"""State machine of both axes and their faults (CiA 402), as the wire shows them. The axes have power here and stand."""

import time

import pytest
from rig import PATIENCE_S, Rig
from targets import Target, needs_clock

from kontur.can import wire
from kontur.drive.state_machine import DISABLE_VOLTAGE, ENABLE, FAULT_RESET, RUN_PATH, SHUTDOWN, SWITCH_ON
from kontur.drive.stream import stream
from kontur.errors import EmcyError

pytestmark = pytest.mark.motion

HEARTBEAT_LOST, OVERSPEED, KNOT_OUTSIDE = 0x8130, 0x8400, 0xFF11
EMCY = 0x80
STATE, ENABLED = 0x6F, 0x27  # of a statusword


def come_to(rig: Rig, controlword: int, state: str) -> None:
    rig.device.axes.controlwords(controlword, controlword)
    rig.device.wait(lambda: rig.device.axes.states() == (state, state), 2.0, f"does not come to {state!r}")


def assert_fault(rig: Rig, code: int) -> None:
    """Both axes are in fault without power, and tell the code everywhere; a fault reset ends it."""
    device = rig.device
    rig.link.wait(lambda: device.axes.states() == ("fault", "fault"), 2.0)
    assert device.axes.states() == ("fault", "fault")
    assert (device.read("error_code_x"), device.read("error_code_y")) == (code, code)
    assert device.read("error_register") & 1
    history = rig.link.node.sdo[0x1003]
    assert code in [history[i + 1].raw & 0xFFFF for i in range(history[0].raw)]
    come_to(rig, FAULT_RESET, "switch on disabled")
    messages = rig.link.node.emcy.log
    assert rig.link.wait(lambda: messages[-1].code == 0, 1.0), "no EMCY 0000h: error reset"
    assert (device.read("error_code_x"), device.read("error_code_y")) == (0, 0)
    assert device.read("error_register") == 0


def test_both_axes_go_through_all_states_up_and_down(rig: Rig) -> None:
    rig.link.node.nmt.state = "OPERATIONAL"
    for controlword, state in (
        (SHUTDOWN, "ready to switch on"),
        (SWITCH_ON, "switched on"),
        (ENABLE, "operation enabled"),
        (SWITCH_ON, "switched on"),
        (ENABLE, "operation enabled"),
        (SHUTDOWN, "ready to switch on"),
        (SWITCH_ON, "switched on"),
        (DISABLE_VOLTAGE, "switch on disabled"),
    ):
        come_to(rig, controlword, state)


def test_the_quickest_answer_to_a_statusword_is_taken(target: Target, clock_rig: Rig) -> None:
    """A master without a pause between a statusword and its controlword is refused nothing (FF1Ah)."""
    needs_clock(target)  # its line takes no time, and its ticks stand still while others have the processor
    bus, node_id = clock_rig.bus, clock_rig.drive.node_id
    answers = {0x21: SWITCH_ON, 0x23: ENABLE, ENABLED: DISABLE_VOLTAGE}
    enabled, answered, answered_s = 0, 0, 0.0
    told: set[int] = set()
    clock_rig.nmt(1)
    end_s = time.monotonic() + PATIENCE_S
    while enabled < 50 and time.monotonic() < end_s:
        message = bus.recv(0.1)
        if message is not None and message.arbitration_id == EMCY + node_id:
            told.add(int.from_bytes(message.data[:2], "little"))
        if message is None or message.arbitration_id != wire.TPDO1 + node_id:
            continue
        x, y = (word & STATE for word in wire.unpack_status(bytes(message.data)).statusword)
        if x == y and (x != answered or time.monotonic() - answered_s > 0.5):  # an axis that still moves is not enabled
            enabled += x == ENABLED
            answered, answered_s = x, time.monotonic()
            command = answers.get(x, SHUTDOWN)
            clock_rig.link.send(wire.RPDO1 + node_id, wire.pack_controlwords(command, command))
    assert enabled == 50
    assert told == set()


def test_enabled_axes_hold_their_position(rig: Rig) -> None:
    before = rig.device.position_nm()
    with rig.device.axes.enabled():
        rig.link.wait(lambda: False, 0.3)
        rig.device.faults.check()
        assert all(abs(a - b) < 5_000 for a, b in zip(rig.device.position_nm(), before, strict=True))


def test_silent_host_is_a_fault_of_both_axes(rig: Rig) -> None:
    rig.device.axes.enable()
    rig.fall_silent()
    with pytest.raises(EmcyError, match="8130h"):
        rig.device.wait(lambda: False, 2.0, "says nothing of the missing heartbeat")
    assert_fault(rig, HEARTBEAT_LOST)


def test_path_out_of_the_position_limit_is_refused_knot_by_knot(rig: Rig) -> None:
    knots_nm = rig.circle(1.0)
    rig.device.write("position_limit_x.min", int(knots_nm[:, 0].min()) + 200_000)
    rig.device.axes.enable()
    with pytest.raises(EmcyError, match="FF11h"):
        stream(rig.device, knots_nm)
    assert_fault(rig, KNOT_OUTSIDE)


def test_axis_that_is_too_fast_loses_its_power(rig: Rig) -> None:
    rig.device.write("limits.velocity", rig.feed_mps / 2)
    rig.device.axes.enable()
    with pytest.raises(EmcyError, match="8400h"):
        stream(rig.device, rig.circle(1.0))
    assert_fault(rig, OVERSPEED)


def test_parameters_are_refused_while_an_axis_has_power(rig: Rig) -> None:
    with rig.device.axes.enabled(), pytest.raises(Exception, match="the drive refuses"):
        rig.device.write("plant_x.mass", rig.device.read("plant_x.mass"))


def test_path_does_not_start_while_one_axis_is_off(rig: Rig) -> None:
    with rig.device.axes.enabled():
        rig.device.axes.controlwords(RUN_PATH, SWITCH_ON)
        rig.link.wait(lambda: rig.device.axes.states()[1] == "switched on", 1.0)
        assert rig.device.axes.states() == ("operation enabled", "switched on")
        assert rig.device.read("stream.state") == 0
