"""Curves of the solutions of equations that need no mesh, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import fenicsrom
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.curves.curve import END


def duffing(x: np.ndarray, w: float) -> float:
    """One harmonic of a'' + 0.1 a' + a + a^3 = 0.3 cos(w t)."""
    a = x[0]
    return ((1.0 - w**2 + 0.75 * a**2) ** 2 + (0.1 * w) ** 2) * a**2 - 0.3**2


def test_circle_is_followed_through_both_folds_until_it_closes() -> None:
    found = fenicsrom.follow(lambda x, p: x**2 + p**2 - 1.0, 1.0, -2.0, 2.0, start=0.0)
    assert found.reason == "closed"
    np.testing.assert_allclose(np.hypot(found.x[:, 0], found.parameter), 1.0, rtol=1e-7)
    np.testing.assert_allclose(found.fold_parameter, [1.0, -1.0], atol=1e-9)
    np.testing.assert_allclose(found.fold_x, 0.0, atol=1e-5)


def test_duffing_curve_jumps_where_its_equation_has_double_roots() -> None:
    """For each w the equation is a cubic in a^2, with a double root at a fold.

    The upper fold is a hairpin: the steps before and behind its tip are below it.
    """
    found = fenicsrom.follow(duffing, [0.4], 0.5, 2.5)
    assert found.reason == END
    assert found.parameter[0] == 0.5 and found.parameter[-1] == pytest.approx(2.5)

    def discriminant(w: float) -> float:
        a, b = 0.5625, 1.5 * (1.0 - w**2)
        c, d = (1.0 - w**2) ** 2 + (0.1 * w) ** 2, -0.09
        return 18 * a * b * c * d - 4 * b**3 * d + (b * c) ** 2 - 4 * a * c**3 - 27 * (a * d) ** 2

    assert len(found.fold_parameter) == 2
    for w in found.fold_parameter:
        assert discriminant(w * (1.0 - 1e-6)) * discriminant(w * (1.0 + 1e-6)) < 0.0
    for x, w in zip(found.x, found.parameter, strict=True):
        assert abs(duffing(x, w)) < 1e-6


def test_start_that_cannot_be_used_is_refused() -> None:
    with pytest.raises(ValueError, match="start = 3"):
        fenicsrom.follow(duffing, [0.4], 0.5, 2.5, start=3.0)
    with pytest.raises(ConvergenceError, match="x0"):
        fenicsrom.follow(lambda x, p: x**2 + 1.0, [0.4], 0.0, 1.0)
