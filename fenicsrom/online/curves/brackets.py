"""Changes of sign of a function of the points along a curve."""

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

import numpy as np

EVALUATIONS = 60
"""Bisection alone needs about 20."""

Point = TypeVar("Point")


class Bracket(NamedTuple, Generic[Point]):
    """Two points of a curve between which a function changes its sign.

    Attributes:
        before: the point that comes first.
        after: the other one.
        values: values of the function at both.
    """

    before: Point
    after: Point
    values: tuple[float, float]

    @property
    def nearest(self) -> Point:
        """The point at which the function is nearer to zero."""
        return self.before if abs(self.values[0]) <= abs(self.values[1]) else self.after


def bracketed(
    between: Callable[[list[Point], list[float], float], Point | None],
    test: Callable[[Point], float],
    a: Point,
    b: Point,
    length: float,
    narrow: float,
    lost: float = 0.0,
) -> Bracket[Point] | None:
    """Bracket the change of sign of a function between two points of a curve.

    The secant method keeps a distance from the ends of the bracket, so that both ends come near.
    The value at an end that stays twice is halved (Illinois), and a bracket that three evaluations
    did not halve is bisected. If the next evaluation does not halve it either, it is bisected twice
    as often before the secant method is tried again: a function that jumps needs bisections only.

    Args:
        between: gives the point of the curve at a distance from a, between two points at two
            distances; None if it is not found.
        test: the function; its signs at a and b differ. It may jump.
        a: a point.
        b: the next point.
        length: its distance from a.
        narrow: width of the final bracket.
        lost: width of a bracket that is returned as it is if it did not become narrow.

    Returns:
        The bracket; None if it is wider than both widths.
    """
    points, values, weights = [a, b], [test(a), test(b)], [1.0, 1.0]
    ends, slow, width, moved = [0.0, length], 0, length, -1
    often, left = 1, 0  # bisections of the next series, and of the present one
    for _ in range(EVALUATIONS):
        if ends[1] - ends[0] <= narrow:
            break
        low, high = (value * weight for value, weight in zip(values, weights, strict=True))
        if slow >= 3 and not left:
            left, often = often, 2 * often
        bisects = left > 0 or low == high
        if bisects:
            arc = 0.5 * (ends[0] + ends[1])
        else:
            near = 0.45 * narrow
            arc = ends[0] + (ends[1] - ends[0]) * low / (low - high)
            arc = min(max(arc, ends[0] + near), ends[1] - near)
        point = between(points, ends, arc)
        if point is None:
            break
        value = test(point)
        side = 1 if value * np.sign(values[1]) > 0.0 else 0
        points[side], values[side], ends[side] = point, value, arc
        weights[side] = 1.0
        if side == moved:
            weights[1 - side] *= 0.5
        moved = side
        left, slow = max(left - bisects, 0), slow + (not bisects)
        if ends[1] - ends[0] <= 0.5 * width:
            width = ends[1] - ends[0]
            slow = 2 if bisects else 0
    if ends[1] - ends[0] > max(narrow, lost):
        return None
    return Bracket(points[0], points[1], (values[0], values[1]))
