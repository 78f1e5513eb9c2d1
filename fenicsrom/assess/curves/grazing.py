"""Contact events of a curve that its time steps do not resolve.

A body that only just reaches a surface touches it for less than a step. Whether an instant of the
steps falls into this time depends on the phase of the motion, so that along a curve the touch seems
to come and go. The trial normal force N0 - k_n gap is then, at its turning point, nearer to zero
than it changes within a step. With steps of the phase 2 pi / n, the turning point of the k-th
harmonic of range R is missed by less than R (k pi / n)^2 / 4.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.curves.curve import Curve, CurvePoint

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
    left_out = {id(point) for point in _unresolved(curve, (0.5 * HARMONIC * np.pi / steps) ** 2)}
    return [point for point in curve.special if id(point) not in left_out]


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
