# SPDX-License-Identifier: Apache-2.0
"""The equations of the time law's solver, whose terms are rows that are shifted against one another."""

import numpy as np

from kontur.planning.barrier import Barrier
from kontur.planning.bounds import Limits

COUNT, STEP_S, WEIGHT = 12, 0.01, 2e-3


def barrier():
    """An uneven motion, whose axes have limits of their own, and a b that is not even."""
    random = np.random.default_rng(5)
    t = np.arange(COUNT) * STEP_S
    position = np.stack([0.01 * np.sin(9.0 * t), 0.006 * np.cos(13.0 * t) + 0.02 * t], axis=1)
    limits = Limits((0.2, 0.3), (3.0, 5.0), (150.0, 100.0))
    out = Barrier(position, STEP_S, np.full(COUNT, 0.15), limits, random.uniform(0.8, 1.0, (COUNT, 2)))
    out._take(out._b * random.uniform(0.8, 1.2, COUNT))
    assert min(float(np.min(slack)) for slack in out._slack) > 0.0
    return out


def merit(of, b):
    of._take(b)
    return of._duration - WEIGHT * of._logarithms


def differences(function, b):
    """The derivatives of a function of b (n,) by each of its values."""
    size = 1e-6 * b
    steps = np.diag(size)
    return np.array(
        [(function(b + step) - function(b - step)) / (2.0 * of) for step, of in zip(steps, size, strict=True)]
    )


def test_the_gradient_is_that_of_the_merit():
    of = barrier()
    b = of._b
    gradient, _ = of._equations(WEIGHT)
    np.testing.assert_allclose(gradient, differences(lambda at: merit(of, at), b), rtol=1e-6, atol=1e-9)


def test_the_bands_are_the_second_derivatives_but_for_the_bend_of_the_jerk_bound():
    """That bend would lower the diagonal. It is left out, so that the matrix is positive wherever b is."""
    of = barrier()
    b = of._b
    _, band = of._equations(WEIGHT)

    def gradient(at):
        of._take(at)
        return of._equations(WEIGHT)[0]

    second = differences(gradient, b)
    for row in (1, 2):
        np.testing.assert_allclose(band[row, : COUNT - row], np.diagonal(second, row), rtol=1e-5, atol=1e-7)
        np.testing.assert_array_equal(band[row, COUNT - row :], 0.0)
    of._take(b)
    bend = 0.75 * of._jerk * b[1:-1] ** -2.5 * WEIGHT * np.sum(1.0 / of._slack[1][1::2], axis=1)
    left_out = np.pad(np.sum(bend, axis=0), 1)
    np.testing.assert_allclose(band[0], np.diagonal(second) + left_out, rtol=1e-5, atol=1e-7)


def test_the_solution_is_within_its_bounds_and_shorter_than_any_near_it():
    of = barrier()
    first_s = of._duration
    b = of.solve(1e-4)
    assert of._duration < 0.9 * first_s
    assert min(float(np.min(slack)) for slack in of._slack) > 0.0
    assert np.min(of._top - 1.01 * b) < 0.0  # somewhere it is at the feed
