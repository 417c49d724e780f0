# SPDX-License-Identifier: Apache-2.0
import hashlib
import struct

import numpy as np
import pytest
from knot_spline import spline

from kontur.errors import PathError
from kontur.planning import knots


def motion():
    """Half a lap on a circle of 10 mm, quintic in time, with a rest of 8 ms at both ends; m, one row a ms."""
    tau = np.clip((np.arange(516) - 8) / 500.0, 0.0, 1.0)
    angle = np.pi * tau**3 * (10.0 - 15.0 * tau + 6.0 * tau**2)
    return 0.010 * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def test_the_spline_of_the_rounded_knots_passes_its_samples_to_a_nanometre():
    position = motion()
    knots_nm = knots.to_nm(knots.control_points(position))
    off_nm = spline(knots_nm)(np.arange(len(position))) - position * 1e9
    assert np.max(np.abs(off_nm)) <= 1.0


def test_before_rounding_the_spline_passes_its_samples_exactly():
    position = motion()
    at_samples = spline(knots.control_points(position), start=position[0])(np.arange(len(position)))
    np.testing.assert_allclose(at_samples, position, atol=1e-16)


def test_a_path_at_rest_at_its_ends_starts_and_ends_with_equal_knots():
    knots_nm = knots.to_nm(knots.control_points(motion()))
    assert knots_nm[:3].tolist() == [[10_000_000, 0]] * 3
    assert knots_nm[-3:].tolist() == [[-10_000_000, 0]] * 3


@pytest.mark.parametrize(
    ("far", "message"), [([[0.0, 0.0], [0.0, 2.2]], "2.147 m"), ([[0.0, 0.0], [0.0084, 0.0]], "8.3 m/s")]
)
def test_what_the_wire_cannot_carry_is_refused(far, message):
    with pytest.raises(PathError, match=message):
        knots.to_nm(np.array(far))


def test_the_digest_is_the_sha256_of_the_bytes_on_the_wire():
    knots_nm = np.array([[1, -2], [3, 1 << 30]], dtype=np.int32)
    assert knots.digest(knots_nm) == hashlib.sha256(struct.pack("<4i", 1, -2, 3, 1 << 30)).hexdigest()
