"""Newton's method: what it notes and logs of its iterations."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from fenicsrom.online.step.statics import newton

Array = NDArray[np.float64]


def correct(u: Array) -> tuple[Array, float]:
    """The correction of arctan(u) = 0; Newton's method converges from |u| < 1.3917 only."""
    residual, slope = math.atan(u[0]), 1.0 / (1.0 + u[0] ** 2)
    change = -residual / slope
    return np.array([change]), abs(residual * change)


def small(u: Array, decrement: float, first: float, last: float) -> bool:
    return decrement < 1e-20


def iterates(u: float, count: int) -> list[float]:
    """The decrements arctan²(u) (1 + u²) of the first iterations from u."""
    found = []
    for _ in range(count):
        found.append(math.atan(u) ** 2 * (1.0 + u**2))
        u -= math.atan(u) * (1.0 + u**2)
    return found


def test_decrements_are_those_of_the_last_attempt() -> None:
    noted = [7.0]
    assert newton(np.array([2.0]), correct, small, 5, 1e3, decrements=noted) is None
    np.testing.assert_allclose(noted, iterates(2.0, len(noted)), rtol=1e-12)
    assert noted[-1] > 1e3 * noted[0]  # it diverged
    found = newton(np.array([1.0]), correct, small, 10, 1e3, decrements=noted)
    assert found is not None and abs(found[0]) < 1e-10
    np.testing.assert_allclose(noted[:4], iterates(1.0, 4), rtol=1e-12)
