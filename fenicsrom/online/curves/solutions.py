"""Curves of the solutions of any equations over a parameter, followed through their folds."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.curves.arc import LARGEST_STEP, ArcLength, Place, Values
from fenicsrom.online.curves.curve import Curve
from fenicsrom.online.curves.events import change_of_sign, turned_points

DIFFERENCE = 1e-6  # of a derivative by central differences, in parts of the size of x or of p


@dataclass(frozen=True, eq=False)
class Solution:
    """A solution of r(x, p) = 0.

    Attributes:
        s: x (n,).
        parameter: p.
        tangent: (n + 1,) direction of the curve in (x, p).
        sense: of the tangent, as `fenicsrom.online.curves.arc` has it.
    """

    s: Array
    parameter: float
    tangent: Array
    sense: float = 1.0


@dataclass(frozen=True, eq=False)
class Solutions:
    """The solutions of r(x, p) = 0 along a curve.

    Attributes:
        x: (K, n), in the order in which they were found.
        parameter: (K,) p.
        fold_x: (F, n) x where p turns back.
        fold_parameter: (F,) p there.
        reason: why the curve ends: "end of the range", "back at the start of the range", "closed",
            "number of points", "repeats itself" or "no convergence".
    """

    x: Array
    parameter: Array
    fold_x: Array
    fold_parameter: Array
    reason: str


class _Equations(ArcLength):
    """The curve of the solutions of some equations; arguments as `follow`."""

    def __init__(
        self, residual: Callable[[Array, float], ArrayLike], x: Array, low: float, high: float
    ):
        super().__init__(low, high, x)
        self._residual = residual

    def values(self, s: Array, parameter: float, *, derive: bool) -> Values | None:
        """The equations and, if asked for, their derivatives by central differences."""
        z = np.append(s, parameter)
        jacobian: Array = np.zeros((0, 0))
        if derive:
            steps = DIFFERENCE * np.append(np.full(s.size, self.size), self.range)
            ways = zip(steps, np.diag(steps), strict=True)
            slopes = [(self._of(z + h) - self._of(z - h)) / (2.0 * n) for n, h in ways]
            jacobian = np.column_stack(slopes)
        residual = self._of(z)
        finite = np.isfinite(residual).all() and np.isfinite(jacobian).all()
        return Values(residual, jacobian, None) if finite else None

    def _of(self, z: Array) -> Array:
        return np.atleast_1d(np.asarray(self._residual(z[:-1], float(z[-1])), dtype=np.float64))

    def point(self, place: Place, evaluations: tuple[int, int]) -> Solution:
        """The solution at a place."""
        return Solution(*self.variables(place.y), np.append(*self.variables(place.tangent)))

    def between(self, before: Any, found: Any) -> tuple[list[Any], list[Any]]:
        """Points that hide two folds between two points, and the folds."""
        path: Any = self  # its points are solutions, not motions
        points = [before, *turned_points(path, before, found), found]
        brackets = [
            change_of_sign(path, lambda point: float(point.tangent[-1]), a, b)
            for a, b in pairwise(points)
            if a.tangent[-1] * b.tangent[-1] < 0.0
        ]
        return points[1:-1], [bracket.nearest for bracket in brackets]


def follow(
    residual: Callable[[Array, float], ArrayLike],
    x0: ArrayLike,
    low: float,
    high: float,
    *,
    start: float | None = None,
    direction: float = 1.0,
    largest_step: float = LARGEST_STEP,
    points: int = 1000,
) -> Solutions:
    """Follow the solutions of n equations r(x, p) = 0 over p, through folds and corners.

    The equations may be piecewise smooth, as those of contact and friction are. The curve ends
    where p leaves the range, or where it comes back to its first point. No mesh is needed. The
    amplitude a of a Duffing oscillator, by one harmonic over the angular frequency w:

        def duffing(x, w):
            a = x[0]
            return ((1 - w**2 + 0.75 * a**2) ** 2 + (0.1 * w) ** 2) * a**2 - 0.3**2

        curve = fenicsrom.follow(duffing, [0.4], 0.5, 2.5)
        curve.fold_parameter                    # where the oscillator jumps: 1.773, 1.324

    Args:
        residual: gives r (n,) at x (n,) and p. Derivatives are taken by central differences, so it
            should be exact to rounding.
        x0: (n,) near the first solution.
        low: where the range of p starts.
        high: where it ends, above `low`.
        start: p of the first solution; `low` by default.
        direction: sign of the change of p at the first solution.
        largest_step: along the curve, in parts of the size of x and of the range of p.
        points: largest number of solutions.

    Raises:
        ValueError: the range is empty, or `start` lies outside of it.
        ConvergenceError: no solution was found near x0.
    """
    start = low if start is None else start
    if not low < high or not low <= start <= high:
        raise ValueError(f"start = {start:g} must lie in the range from {low:g} to {high:g}")
    x = np.atleast_1d(np.asarray(x0, dtype=np.float64))
    path = _Equations(residual, x, low, high)
    first = path.at_parameter(x, start)
    if first is None:
        raise ConvergenceError(f"no solution was found near x0 at p = {start:g}")
    found: Curve = path.run(first, direction, largest_step=largest_step, points=points)
    kept, folds = found.points, found.special
    return Solutions(
        np.array([point.s for point in kept]),
        np.array([point.parameter for point in kept]),
        np.array([point.s for point in folds]).reshape(len(folds), x.size),
        np.array([point.parameter for point in folds]),
        found.reason,
    )
