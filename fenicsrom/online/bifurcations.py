"""Bifurcations of periodic motions: their test functions, and where these are zero on a curve.

Where the tangent has no component along the parameter the curve folds. Period doubling and torus
bifurcations are zeros of functions of the Floquet multipliers. All are located by the secant
method, safeguarded by bisection, on the curve itself.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.curve import CurvePoint, hermite, replaced

LOCATED = 1e-6  # of the range of the parameter: how closely bifurcations are located


def _fold(point: CurvePoint) -> float:
    return float(point.tangent[-1])


def _period_doubling(point: CurvePoint) -> float:
    """The product of all multipliers plus one: it changes sign where a real one passes -1."""
    return float(np.prod(point.multipliers + 1.0).real)


def _torus(point: CurvePoint) -> float:
    """How far the largest complex pair is outside of the unit circle; NaN without one."""
    pairs = point.multipliers[point.multipliers.imag > 1e-9]
    return float(np.max(np.abs(pairs)) - 1.0) if pairs.size else np.nan


TESTS: dict[str, Callable[[CurvePoint], float]] = {
    "fold": _fold,
    "period doubling": _period_doubling,
    "torus": _torus,
}


class Path(Protocol):
    """What a bifurcation is located with: a `fenicsrom.online.continuation.Continuation`.

    Attributes:
        range: width of the range of the parameter.
    """

    range: float

    def correct(self, y: Array, along: Array) -> CurvePoint | None:
        """The point of the curve on the hyperplane through y normal to `along`."""

    def place(self, point: CurvePoint) -> Array:
        """The unknowns y (N + 1,) of a point."""


def locate(path: Path, a: CurvePoint, b: CurvePoint) -> list[CurvePoint]:
    """The bifurcations between two points whose tangents point along the path."""
    found = []
    for kind, test in TESTS.items():
        first, second = test(a), test(b)
        if np.isfinite(first) and np.isfinite(second) and first * second < 0.0:
            point = _zero(path, test, a, b, first, second)
            if point is not None:
                found.append(replaced(point, kind=kind))
    return found


def _zero(
    path: Path,
    test: Callable[[CurvePoint], float],
    a: CurvePoint,
    b: CurvePoint,
    first: float,
    second: float,
) -> CurvePoint | None:
    """Where a test function is zero between two points, by regula falsi (Illinois)."""
    ya, yb = path.place(a), path.place(b)
    ta, tb = a.tangent, b.tangent
    low, high, best = 0.0, 1.0, None
    chord = (yb - ya) / np.linalg.norm(yb - ya)
    length = float(np.linalg.norm(yb - ya))
    for _ in range(40):
        share = low + (high - low) * first / (first - second)
        guess = hermite(ya, yb, ta, tb, length, share)
        point = path.correct(guess, chord)
        if point is None:
            return best
        sign = np.sign(np.dot(point.tangent, ta)) or 1.0
        point = replaced(point, tangent=sign * point.tangent)
        value = test(point)
        close = best is not None and abs(point.parameter - best.parameter) <= (
            0.1 * LOCATED * path.range
        )
        best = point
        if close or value == 0.0 or (high - low) * length <= 0.1 * LOCATED:
            return best
        if value * second > 0.0:
            high, second = share, value
            first *= 0.5
        else:
            low, first = share, value
            second *= 0.5
    return best
