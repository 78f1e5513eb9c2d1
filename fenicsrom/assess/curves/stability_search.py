"""Where the stability on a curve is compared with a richer basis, besides at spread points.

A stretch that only the richer basis finds unstable may lie between two compared motions that both
bases find stable. Such a stretch shows by a multiplier of the richer basis that comes near the unit
circle. A gap between two compared motions is divided in two cases: the size |mu| of the largest
multiplier is within `NEAR` of 1 at one of them, or |mu| changes between them by 1 - |mu| or more.
The gap with the largest ratio

    length / (1 - |mu| - change),    |mu| the larger one of both ends,    (1)

is divided first, in at most `EXTRA` points of a curve. A lightly damped vibration without such a
stretch has |mu| near 1 everywhere; the points then are distributed evenly. A stretch of which no
compared motion has a sign is not found.

Contact events of a curve that its time steps do not resolve.

A body that only just reaches a surface touches it for less than a step. Whether an instant of the
steps falls into this time depends on the phase of the motion, so that along a curve the touch seems
to come and go. The trial normal force N0 - k_n gap is then, at its turning point, nearer to zero
than it changes within a step. With steps of the phase 2 pi / n, the turning point of the k-th
harmonic of range R is missed by less than R (k pi / n)^2 / 4.
"""

from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.curves.curve import Curve, CurvePoint, Piece

EXTRA = 12
"""Largest number of these points of a curve."""

NEAR = 0.05
"""Distance of |mu| from 1. A vibration at the frequency of the load with a damping ratio below
0.8 % is as near."""

SHORTEST = 1e-4
"""Shortest gap that is divided, in parts of the range of the curve."""

FLOOR = 1e-3
"""Least denominator of (1): gaps that may reach 1 differ by their lengths only."""


class _Place(NamedTuple):
    """A point of a curve.

    Attributes:
        point: the point.
        at: its distance along its part of the curve, relative to the extent of the curve.
        size: |mu| of the richer basis; NaN if it is not known, None if it was not asked for.
    """

    point: CurvePoint
    at: float
    size: float | None

    @property
    def is_known(self) -> bool:
        """Whether |mu| is known and below 1, and the point is stable."""
        return self.size is not None and self.size < 1.0 and self.point.stable


def lengths_along(pieces: Sequence[Piece]) -> list[Array]:
    """The distances of the points of each piece from its first one.

    They are measured in the plane of the parameter and the amplitude, relative to both extents.
    """
    points = [point for piece in pieces for point in piece.points]
    width = float(np.ptp([point.parameter for point in points])) if points else 0.0
    height = max((float(point.amplitude.max()) for point in points), default=0.0)
    found = []
    for piece in pieces:
        steps = [0.0]
        for before, point in pairwise(piece.points):
            across = (point.parameter - before.parameter) / (width or 1.0)
            up = float(np.max(np.abs(point.amplitude - before.amplitude))) / (height or 1.0)
            steps.append(float(np.hypot(across, up)))
        found.append(np.cumsum(steps[: len(piece.points)]))
    return found


def divide_gaps(
    pieces: Sequence[Piece],
    sizes: dict[CurvePoint, float],
    between: Callable[[CurvePoint, CurvePoint], CurvePoint | None],
    compare: Callable[[CurvePoint], float],
    most: int = EXTRA,
) -> None:
    """Compare more points where a stretch may be hidden.

    Args:
        pieces: the parts of the curve.
        sizes: compared point -> |mu| of the richer basis, NaN if it is not known.
        between: computes a stable point of the curve between two neighbours; None if there is none.
        compare: compares a point and gives |mu| of the richer basis, NaN if it is not known.
        most: largest number of these points.
    """
    rows = [
        [_Place(p, float(at), sizes.get(p)) for p, at in zip(piece.points, along, strict=True)]
        for piece, along in zip(pieces, lengths_along(pieces), strict=True)
    ]
    closed: set[tuple[CurvePoint, CurvePoint]] = set()
    for _ in range(most):
        gap = _most_urgent(rows, closed)
        if gap is None:
            return
        row, first, last = gap
        ends = row[first], row[last]
        middle = 0.5 * (ends[0].at + ends[1].at)
        if inside := _inside(row, first, last):
            chosen = min(inside, key=lambda k: abs(row[k].at - middle))
        else:
            point = between(ends[0].point, ends[1].point)
            if point is None:
                closed.add((ends[0].point, ends[1].point))
                continue
            chosen = last
            row.insert(chosen, _Place(point, middle, None))
        row[chosen] = row[chosen]._replace(size=compare(row[chosen].point))


def _most_urgent(
    rows: Sequence[list[_Place]], closed: set[tuple[CurvePoint, CurvePoint]]
) -> tuple[list[_Place], int, int] | None:
    """The gap to be divided next, by its row and its ends; None if there is none."""
    best, chosen = 0.0, None
    for row in rows:
        known = [k for k, place in enumerate(row) if place.is_known]
        for first, last in pairwise(known):
            if (row[first].point, row[last].point) in closed:
                continue
            divisible = last == first + 1 or _inside(row, first, last)
            if divisible and all(place.point.stable for place in row[first:last]):
                urgency = _urgency(row[first], row[last])
                if urgency > best:
                    best, chosen = urgency, (row, first, last)
    return chosen


def _inside(row: Sequence[_Place], first: int, last: int) -> list[int]:
    """The points of the curve between two places that were not compared yet."""
    return [k for k in range(first + 1, last) if row[k].size is None]


def _urgency(a: _Place, b: _Place) -> float:
    """The ratio (1) of the gap between two places; 0 if it is not to be divided."""
    assert a.size is not None and b.size is not None
    left, change = 1.0 - max(a.size, b.size), abs(a.size - b.size)
    length = b.at - a.at
    if length < SHORTEST or (left > NEAR and change < left):
        return 0.0
    return length / max(left - change, FLOOR)


HARMONIC = 4  # up to which the steps resolve the turning point of the normal force
FIELDS = {"touch": "touch", "lift-off": "lift_off"}  # events -> fields of `Extremes`


def resolved_events(curve: Curve, steps: int) -> list[CurvePoint]:
    """The special points of a curve without pairs of events that the time steps do not resolve.

    A pair is a contact event and the next one of the opposite sense at the same contact point. It
    is left out if the normal force is within the error of its turning point at both events and at
    all points of the curve between them. If the number of such events is odd, the last one stays.

    Args:
        curve: the curve.
        steps: number of steps in a period.
    """
    left_out = set(_unresolved(curve, (0.5 * HARMONIC * np.pi / steps) ** 2))
    return [point for point in curve.special if point not in left_out]


def _unresolved(curve: Curve, share: float) -> Iterator[CurvePoint]:
    """The events that are left out; `share` of the range of the normal force is not resolved."""
    if len(curve.points) < 2:
        return
    places = _places(curve.points, curve.points)
    for what, field in FIELDS.items():
        events = [point for point in curve.special if point.kind.endswith(what)]
        for contact in sorted({point.contact for point in events}):
            before: CurvePoint | None = None
            begin = 0
            for event in (point for point in events if point.contact == contact):
                end = _segment(places, _places([event], curve.points)[0])
                motions = [event, *([before, *curve.points[begin + 1 : end + 1]] if before else [])]
                small = all(_is_small(motion, field, contact, share) for motion in motions)
                if before is not None and before.kind != event.kind and small:
                    yield before
                    yield event
                    before = None
                else:
                    before, begin = event, end


def _is_small(point: CurvePoint, field: str, contact: int, share: float) -> bool:
    """Whether the normal force at a turning point is at most a share of its changes in a step."""
    extremes = point.extremes
    size = float(extremes.touch[contact] + extremes.lift_off[contact])
    return bool(abs(getattr(extremes, field)[contact]) <= share * size)


def _places(points: Sequence[CurvePoint], curve: Sequence[CurvePoint]) -> Array:
    """Variables and parameters (points, N + 1), each divided by its size along a curve."""
    size = max(float(np.linalg.norm(point.s)) for point in curve) or 1.0
    width = float(np.ptp([point.parameter for point in curve])) or 1.0
    return np.array([np.append(point.s / size, point.parameter / width) for point in points])


def _segment(places: Array, place: Array) -> int:
    """The number of the point of a curve that comes before a place on it."""
    away = np.linalg.norm(places - place, axis=1)
    lengths = np.linalg.norm(np.diff(places, axis=0), axis=1)
    return int(np.argmin(away[:-1] + away[1:] - lengths))
