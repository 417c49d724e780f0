# SPDX-License-Identifier: Apache-2.0
"""A circle over a bus that loses, repeats, swaps, delays and corrupts frames in both directions."""

import dataclasses

import pytest
from rig import Rig, checksum, moving
from targets import MACHINE, Target

from kontur.can.bad_bus import BadBus, BusFaults
from kontur.drive.stream import stream

pytestmark = pytest.mark.motion

MIX = BusFaults(drop=0.02, duplicate=0.01, reorder=0.01, flip=0.005, seed=1)
WORSE = dataclasses.replace(MIX, delay=0.01, burst=0.0005, burst_frames=3, seed=2)
LAPS = 6.0
START_S = 3.0
# Without noise its error is the same at any time.
QUIET = dataclasses.replace(
    MACHINE, **{axis: dataclasses.replace(getattr(MACHINE, axis), force_noise_N=0.0) for axis in "xy"}
)


def errors_of_circle(target: Target, faults: BusFaults) -> tuple[float, float] | None:
    """Run it; greatest and mean distance in m from the circle, where the drive's time is the host's: the true one, or
    where nobody knows that, the drive's own estimate."""
    with target.power_on(plant=QUIET if target.simulated else MACHINE) as drive, Rig(drive) as rig:
        knots_nm = rig.circle(LAPS)
        bus = BadBus(inner=rig.bus, faults=faults)
        rig.connect(bus)

        def wait() -> None:
            if drive.stepped:
                assert rig.link.time_s < START_S
                rig.link.wait(lambda: rig.link.time_s >= START_S, START_S)

        with rig.device.axes.enabled():
            result = stream(rig.device, knots_nm, before_start=wait)
            assert result.completed
            assert result.executed == len(knots_nm)
            assert rig.device.read_stable("stream.checksum") == checksum(knots_nm)
        if faults != BusFaults():
            assert sum(result.rejected.values()) > 0
            assert result.retransmitted > 0
            assert min(bus.to_drive.lost, bus.to_host.lost, bus.to_drive.flipped, bus.to_host.flipped) > 0
        if not drive.stepped:
            return None
        if drive.truth_m is None:
            return rig.device.read_stable("estimated_contour_error.max"), rig.device.read_stable(
                "estimated_contour_error.mean"
            )
        position_m, step_s = rig.positions_m()
        position_m = position_m[round(START_S / step_s) :]
        position_m = position_m[: moving(position_m, step_s)[-1]]  # to the end of the path, whenever power went
        off_m = rig.off_circle_m(position_m[moving(position_m, step_s)[0] :])
        return float(off_m.max()), float(off_m.mean())


@pytest.fixture(scope="module")
def clean(target: Target) -> tuple[float, float] | None:
    return errors_of_circle(target, BusFaults())


@pytest.mark.parametrize("faults", [MIX, WORSE], ids=["mix", "worse"])
def test_circle_on_a_bad_bus_is_that_on_a_clean_one(
    target: Target, clean: tuple[float, float] | None, faults: BusFaults
) -> None:
    bad = errors_of_circle(target, faults)
    if clean is not None and bad is not None:
        count_m = MACHINE.x.encoder_m
        assert bad[0] <= clean[0] + count_m
        assert bad[1] == pytest.approx(clean[1], abs=0.02 * count_m)
