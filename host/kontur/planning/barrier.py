# SPDX-License-Identifier: Apache-2.0
"""The fastest b(t), the square of the rate of a motion's time, within the limits: Newton's method with a logarithmic
barrier.

kontur.planning.time_law says what b is, and what bounds it. Many parts of a program are some hundred samples long, and
then a call of NumPy costs more than the numbers in it. So all bounds of both axes are rows of one array, and what the
samples before, at and behind one add to an equation are rows that are shifted against one another.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import as_strided
from scipy.linalg.lapack import dpbsv

from kontur.path.geometry import FloatArray
from kontur.planning.bounds import Limits, accelerations

_RATE_MAX = 4.0  # its square
_START, _DROP = 0.05, 0.05  # weight of the barrier at first, and from round to round
_NEWTON_MAX = 25  # steps of a round
_ACCELERATION, _JERK = slice(0, None, 2), slice(1, None, 2)  # of the bounds: those of x, then those of y
_SQUARES = 3  # for each axis: both bounds of the acceleration, and either of the jerk


class Barrier:
    """The bounds on b of a motion `position` (n, 2) in m, sampled each `step` in s, by `feed` (n,) in m/s and `limits`,
    of whose acceleration and jerk `shares` (n, 2) count. n is at least 4."""

    def __init__(self, position: FloatArray, step: float, feed: FloatArray, limits: Limits, shares: FloatArray) -> None:
        self._step = step
        p = np.pad(position, ((2, 2), (0, 0)), mode="edge")
        first = (p[3:-1] - p[1:-3]) / (2.0 * step)
        second = (p[3:-1] - 2.0 * p[2:-2] + p[1:-3]) / step**2
        third = (p[4:] - 2.0 * p[3:-1] + 2.0 * p[1:-3] - p[:-4]) / (2.0 * step**3)
        with np.errstate(divide="ignore", invalid="ignore"):
            speed = np.minimum(
                (feed / np.hypot(first[:, 0], first[:, 1])) ** 2,
                np.min((np.array(limits.velocity_mps) / first) ** 2, axis=1),
            )
        self._top = np.fmin(speed, _RATE_MAX)
        upper, lower = (shares[:, :1] * most for most in accelerations(first, limits))
        jerk = shares[:, 1:] * np.array(limits.jerk_mps3)
        least = max(
            float(np.max(1.0 / self._top)),
            float(np.max(np.maximum(second / upper, -second / lower))),
            float(np.max(np.abs(third) / jerk)) ** (2.0 / 3.0),
        )
        inner = slice(1, -1)
        self._most = np.empty((4, 2, len(position) - 2))  # upwards and downwards; the jerk's is by b
        self._most[_ACCELERATION, 0], self._most[_ACCELERATION, 1] = upper[inner].T, lower[inner].T
        self._jerk = np.ascontiguousarray(jerk[inner].T)
        self._half_jerk = 0.5 * self._jerk
        self._set_forms(first[inner].T, second[inner].T, third[inner].T)
        self._set_rows(len(position))
        self._take(np.full(len(position), 0.5 / least))

    def _set_forms(self, p1: FloatArray, p2: FloatArray, p3: FloatArray) -> None:
        """The bounds' weights (4, 3, n - 2) of b before, at and behind a sample, and those of the squares in Newton's
        matrix (2, 3, 3, n - 2), from the derivatives (2, n - 2) of the axes."""
        step = self._step
        self._form = form = np.empty((4, 3, p1.shape[1]))
        form[_ACCELERATION, 0], form[_ACCELERATION, 1], form[_ACCELERATION, 2] = -0.25 * p1 / step, p2, 0.25 * p1 / step
        swing, curve = 0.75 * p2 / step, 0.5 * p1 / step**2
        form[_JERK, 0], form[_JERK, 1], form[_JERK, 2] = curve - swing, p3 - 2.0 * curve, curve + swing
        of_axes = form.reshape(2, 2, 3, -1)
        self._squared = np.ascontiguousarray(of_axes[:, [0, 1, 1]])
        self._behind = self._squared[:, :, 2] ** 2

    def _set_rows(self, count: int) -> None:
        """Rows that add up to the gradient and to the three lower bands of the matrix, for `count` samples. What is at
        the sample before one, at it and behind it stands shifted by one each; zeros are beside it."""

        def rows(number: int, begin: int, shape: tuple[int, ...], steps: tuple[int, ...]) -> tuple[FloatArray, ...]:
            whole = np.zeros((number, count))
            of_samples = (*(8 * step for step in steps), 8)
            return whole, as_strided(whole.reshape(-1)[begin:], (*shape, count - 2), of_samples)

        each = count + 1  # a row on, and a sample
        self._gradient, self._of_forms = rows(15, count, (2, 2, 3), (7 * count, 3 * count, each))
        self._of_falls = self._gradient[7::7, 1:-1]
        self._band_0, self._of_band_0 = rows(19, count, (2, _SQUARES, 3), (9 * count, 3 * count, each))
        self._band_1, self._of_band_1 = rows(12, 0, (2, _SQUARES, 2), (6 * count, 2 * count, each))
        self._band_2, self._of_band_2 = rows(6, 0, (2, _SQUARES), (3 * count, count))
        self._new, self._of_new = rows(1, 0, (3,), (1,))
        self._weighted = np.empty((2, _SQUARES, 3, count - 2))
        self._terms = np.empty_like(self._form)

    def solve(self, gap: float) -> FloatArray:
        """The fastest b (n,), whose duration is less than about a share `gap` above the least one."""
        count = len(self._b)
        weight = _START * self._step * float(np.mean(self._root))
        while True:
            for _ in range(_NEWTON_MAX):
                gain = self._newton(weight)
                if gain < 0.3 * weight * max(1.0, 3e-3 * count):
                    break
            if weight * count <= gap * self._duration:
                return self._b
            weight *= _DROP

    def _take(self, b: FloatArray) -> None:
        """Go on from `b` (n,), which is within the bounds."""
        self._new[0] = b
        self._b, self._root = b, b**-0.5
        self._slack = self._top - b, self._slacks(self._root)
        self._duration, self._logarithms = self._step * float(np.sum(self._root)), _logarithms(*self._slack)

    def _slacks(self, root: FloatArray) -> FloatArray:
        """How far (4, 2, n - 2) acceleration and jerk are below their bounds at the new b, which is `root` to the power
        of -2."""
        np.multiply(self._jerk[:, None], root[1:-1], out=self._most[_JERK])
        np.multiply(self._form, self._of_new, out=self._terms)
        now = np.add.reduce(self._terms, axis=1)
        out = np.empty_like(self._most)
        np.subtract(self._most[:, 0], now, out=out[:, 0])
        np.add(self._most[:, 1], now, out=out[:, 1])
        return out

    def _equations(self, weight: float) -> tuple[FloatArray, FloatArray]:
        """The gradient (n,) of the merit, and the lower bands (3, n) of its second derivatives."""
        b, step, (slack_top, slack) = self._b, self._step, self._slack
        power = b**-1.5
        np.multiply(-0.5 * step, power, out=self._gradient[0])
        self._gradient[0] += weight / slack_top
        push = weight / slack
        of_axes = self._form.reshape(2, 2, 3, -1)
        np.multiply(of_axes, (push[:, 0] - push[:, 1]).reshape(2, 2, 1, -1), out=self._of_forms)
        fall = self._half_jerk * power[1:-1]
        np.multiply(push[_JERK, 0] + push[_JERK, 1], fall, out=self._of_falls)

        np.multiply(0.75 * step, b**-2.5, out=self._band_0[0])
        self._band_0[0] += weight / slack_top**2
        form, weighted = self._squared, self._weighted
        at = self._form[_JERK, 1]
        np.add(at, fall, out=form[:, 1, 1])
        np.subtract(at, fall, out=form[:, 2, 1])
        square, push = weighted[:, :, 2], push**2
        np.add(push[_ACCELERATION, 0], push[_ACCELERATION, 1], out=square[:, 0])
        square[:, 1:] = push[_JERK]
        square /= weight
        np.multiply(square[:, :, None], form[:, :, :2], out=weighted[:, :, :2])
        np.multiply(weighted[:, :, :2], form[:, :, :2], out=self._of_band_0[:, :, :2])
        np.multiply(square, self._behind, out=self._of_band_0[:, :, 2])
        np.multiply(weighted[:, :, :2], form[:, :, 1:], out=self._of_band_1)
        np.multiply(weighted[:, :, 0], form[:, :, 2], out=self._of_band_2)
        band = np.stack([np.add.reduce(rows, axis=0) for rows in (self._band_0, self._band_1, self._band_2)])
        return np.add.reduce(self._gradient, axis=0), band

    def _newton(self, weight: float) -> float:
        """One step; returns by how much a full one would lower the merit, 0 where none does."""
        gradient, band = self._equations(weight)
        _, solution, info = dpbsv(band, gradient, lower=1)
        if info != 0:
            raise np.linalg.LinAlgError(f"row {info} of Newton's matrix is not positive")
        step = -solution.reshape(-1)
        gain = -float(gradient @ step)
        merit, size = self._duration - weight * self._logarithms, 1.0
        b, new = self._b, self._new[0]
        while size > 1e-8:
            np.multiply(size, step, out=new)
            new += b
            slack_top = self._top - new
            if new.min() > 0.0 and slack_top.min() > 0.0:  # most steps that are too long are so by this
                root = new**-0.5
                slack = self._slacks(root)
                if slack.min() > 0.0:
                    duration, logarithms = self._step * float(np.sum(root)), _logarithms(slack_top, slack)
                    if duration - weight * logarithms <= merit - 0.1 * size * gain:
                        self._b, self._root, self._slack = new.copy(), root, (slack_top, slack)
                        self._duration, self._logarithms = duration, logarithms
                        return gain
            size *= 0.5
        return 0.0


def _logarithms(top: FloatArray, slack: FloatArray) -> float:
    """The sum of the logarithms of all slacks."""
    product = np.multiply.reduce(slack.reshape(2, 4, -1), axis=1)
    return float(np.sum(np.log(top)) + np.sum(np.log(product[0] * product[1])))
