"""Special points of a curve of periodic motions: bifurcations and contact events.

Between two points of a curve there is a special point where

- the tangent has no component along the parameter: a fold;
- the number of Floquet multipliers outside of the unit circle changes: the multiplier that crosses
  the circle tells the kind. A multiplier that crosses at +1 away from a fold marks a branch point.
  If it crosses in a jump, which the derivative of a motion with contact may do where a contact
  state first occurs, the bifurcation is non-smooth;
- a contact state first or last occurs at a contact point (`online.curves.contact_events`).

Each is a change of sign of a function of the motion, bracketed on the curve itself by the secant
method, safeguarded by bisection. The function may jump.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Protocol

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.curves.brackets import Bracket, bracketed
from fenicsrom.online.curves.contact_events import OPENS, SLIPS, STICKS
from fenicsrom.online.curves.curve import CurvePoint, hermite, norm, replaced
from fenicsrom.online.periodic.shooting import STABLE_WITHIN

LOCATED = 1e-6  # of the range of the parameter: how closely special points are located
BRACKET = 0.1 * LOCATED  # width of the final bracket along the curve
JUMP = 0.05  # a multiplier that keeps this part of its change in the final bracket jumps
REAL = 1e-6  # angle of a multiplier below which it counts as real

Test = Callable[[CurvePoint], float]


class Path(Protocol):
    """A curve with special points: a `online.curves.continuation.Continuation`."""

    def correct(self, y: Array, along: Array, *, exact: bool = False) -> CurvePoint | None:
        """The point of the curve on the hyperplane through y normal to `along`."""

    def place(self, point: CurvePoint) -> Array:
        """The unknowns y (N + 1,) of a point."""


def special_points(path: Path, a: CurvePoint, b: CurvePoint) -> list[CurvePoint] | None:
    """The special points between two points of a curve, in their order.

    Args:
        path: finds points of the curve.
        a: a point.
        b: the next point; the tangents of both point along the path.

    Returns:
        The special points; None if any of them could not be located.
    """
    found: list[CurvePoint] = []
    for kind, contact, test in _changes(a, b):
        bracket = change_of_sign(path, test, a, b)
        if bracket is None:
            return None
        found.append(replaced(bracket.nearest, kind=kind, contact=contact))
    crossings = _crossings(path, a, b)
    if crossings is None:
        return None
    folds = [path.place(point) for point in found if point.kind == "fold"]
    for point in crossings:
        apart = [norm(path.place(point) - fold) for fold in folds]
        if min(apart, default=np.inf) > LOCATED**0.5:
            found.append(point)
    if len(found) < 2:
        return found
    chord = path.place(b) - path.place(a)
    return sorted(found, key=lambda point: float(chord @ path.place(point)))


def _changes(a: CurvePoint, b: CurvePoint) -> Iterator[tuple[str, int, Test]]:
    """Kind, contact point and test function of the fold and the contact events between a and b."""
    if a.tangent[-1] * b.tangent[-1] < 0.0:
        yield "fold", -1, lambda point: float(point.tangent[-1])
    for p in map(int, np.flatnonzero(a.states != b.states)):
        touches = [bool(point.states[p] & (SLIPS | STICKS)) for point in (a, b)]
        opens = [bool(point.states[p] & OPENS) for point in (a, b)]
        slips = [bool(point.states[p] & SLIPS) for point in (a, b)]
        if touches[0] != touches[1]:
            yield _end(touches, "touch"), p, _extreme("touch", p)
        if opens[0] != opens[1]:
            yield _end(opens, "lift-off"), p, _extreme("lift_off", p)
        if slips[0] != slips[1] and all(touches):
            yield _end(slips, "slip"), p, _extreme("slip", p)


def _extreme(name: str, p: int) -> Test:
    """The function that reads a field of `Extremes` at a contact point."""

    def test(point: CurvePoint) -> float:
        return float(getattr(point.extremes, name)[p])

    return test


def _end(occurs: list[bool], what: str) -> str:
    """The name of an event."""
    return f"{'first' if occurs[1] else 'last'} {what}"


def outside(point: CurvePoint) -> int:
    """Number of multipliers outside of the unit circle."""
    if point.stable:
        return 0
    return int(np.sum(np.abs(point.judged) > 1.0 + STABLE_WITHIN))


def _crossings(path: Path, a: CurvePoint, b: CurvePoint) -> list[CurvePoint] | None:
    """Where multipliers cross the unit circle between two points, in their order.

    The size of the multiplier of rank k (the k-th largest) is a continuous function of the
    monodromy matrix, whatever multipliers collide. If k is the larger number outside, it passes 1.
    """
    before, after = outside(a), outside(b)
    if before == after:
        return []
    rank = max(before, after)

    def test(point: CurvePoint) -> float:
        sizes = np.abs(point.judged)
        return float(sizes[rank - 1] - 1.0 - STABLE_WITHIN) if sizes.size >= rank else -1.0

    bracket = change_of_sign(path, test, a, b)
    if bracket is None:
        return None
    kind = _kind(bracket, rank, abs(test(b) - test(a)))
    here = [replaced(bracket.nearest, kind=kind)]
    if norm(path.place(b) - path.place(a)) <= 2.0 * BRACKET:
        return here
    first = _crossings(path, a, bracket.before)
    last = _crossings(path, bracket.after, b)
    return None if first is None or last is None else first + here + last


def _kind(bracket: Bracket[CurvePoint], rank: int, change: float) -> str:
    """The kind of a bifurcation at which the multiplier of a rank crosses the unit circle."""
    low, high = bracket.values
    if abs(high - low) > JUMP * change:
        return "non-smooth"
    multiplier = bracket.nearest.judged[rank - 1]
    if abs(multiplier.imag) > REAL:
        return "torus"
    return "period doubling" if multiplier.real < 0.0 else "branch point"


def change_of_sign(
    path: Path, test: Test, a: CurvePoint, b: CurvePoint
) -> Bracket[CurvePoint] | None:
    """Bracket the change of sign of a function between two points of a curve.

    Each point is sought on the hyperplane normal to the chord from a to b.

    Args:
        path: finds points of the curve.
        test: the function; its signs at a and b differ. It may jump.
        a: a point.
        b: the next point; the tangents of both point along the path.

    Returns:
        The bracket, not wider than `BRACKET`; None if a point was not found.
    """
    origin = path.place(a)
    chord = path.place(b) - origin
    length = norm(chord)
    chord /= length

    def between(points: list[CurvePoint], ends: list[float], arc: float) -> CurvePoint | None:
        return _between(path, points, ends, arc, origin, chord)

    return bracketed(between, test, a, b, length, BRACKET)


def point_between(path: Path, a: CurvePoint, b: CurvePoint, share: float) -> CurvePoint | None:
    """The point of a curve at a share of the chord from a to b; None if it is not found."""
    origin = path.place(a)
    chord = path.place(b) - origin
    length = norm(chord)
    chord /= length
    return _between(path, [a, b], [0.0, length], share * length, origin, chord)


def _between(
    path: Path,
    points: list[CurvePoint],
    ends: list[float],
    arc: float,
    origin: Array,
    chord: Array,
) -> CurvePoint | None:
    """The point of the curve at a distance along the chord, between two points; None if lost."""
    first, last = (path.place(point) for point in points)
    share = (arc - ends[0]) / (ends[1] - ends[0])
    length = norm(last - first)
    guess = hermite(first, last, points[0].tangent, points[1].tangent, length, share)
    guess = guess + (arc - chord @ (guess - origin)) * chord
    point = path.correct(guess, chord, exact=True)
    if point is None:
        guess = first + share * (last - first)
        point = path.correct(guess, chord, exact=True)
    if point is None:
        return None
    turn = float(np.sign(point.tangent @ points[0].tangent)) or 1.0
    return replaced(point, tangent=turn * point.tangent)
