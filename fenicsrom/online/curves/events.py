"""What happens between two points of a curve of periodic motions.

Special points of a curve of periodic motions: bifurcations and contact events.

Between two points of a curve there is a special point where

- the tangent has no component along the parameter: a fold;
- the number of Floquet multipliers outside of the unit circle changes: the multiplier that crosses
  the circle tells the kind. A multiplier that crosses at +1 away from a fold marks a branch point.
  If it crosses in a jump, which the derivative of a motion with contact may do where a contact
  state first occurs, the bifurcation is non-smooth;
- a contact state first or last occurs anywhere in a contact of the scene
  (`fenicsrom.online.curves.curve`).

Each is a change of sign of a function of the motion, bracketed on the curve itself by the secant
method, safeguarded by bisection. The function may jump.

Unstable stretches between two points of a curve: lightly damped vibrations at a resonance.

A free vibration about a motion of period T has the multiplier r exp(i theta), where theta is its
angular frequency times T. The pair of this multiplier and its conjugate turns along the curve.
Where theta passes k pi the two meet on the real axis. With d = theta - k pi they are near there

    (-1)^k r exp(+-sqrt(e^2 - d^2)),

where e measures how strongly the motion excites the vibration (Nayfeh and Mook 1979, chapter 5).
If e > -log r, the motion is unstable while d^2 < e^2 - (log r)^2. This stretch may be much shorter
than a step along the curve, so a point is computed where theta should pass k pi. A step that misses
the stretch finds the pair off the real axis on both sides, where it has turned by more than
-2 log r.

The multiplier alone does not tell on which side of the real axis a vibration is. The eigenvector
(q, v) does: q turns in the sense of v, so that the imaginary part of q^H M v is positive.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.curves.arc import SMOOTH, STRAIGHT, oriented
from fenicsrom.online.curves.curve import (
    OPENS,
    SLIPS,
    STICKS,
    Bracket,
    CurvePoint,
    bracketed,
    hermite,
    norm,
)
from fenicsrom.online.periodic.shooting import STABLE_WITHIN, PeriodicMotion, judged

LOCATED = 1e-6  # of the range of the parameter: how closely special points are located
BRACKET = 0.1 * LOCATED  # width of the final bracket along the curve
JUMP = 0.05  # a multiplier that keeps this part of its change in the final bracket jumps
STEEP = 0.1  # least cosine between a plane's normal and the tangent along which a guess is made
ALONG = 0.2  # least cosine between the chord of two points and the normal of planes between them
DEEP = 20  # halvings after which a step has the width of a bracket
MOST = 8  # changes of stability between two points of a curve that are located
CONTRARY = 2  # nested ways of which both halves may hide folds
REAL = 1e-6  # angle of a multiplier below which it counts as real

Test = Callable[[CurvePoint], float]
Margins = Callable[[CurvePoint], Array]


class Path(Protocol):
    """A curve with special points: a `fenicsrom.online.curves.continuation.Continuation`."""

    def correct(self, y: Array, along: Array, *, exact: bool = False) -> CurvePoint | None:
        """The point of the curve on the hyperplane through y normal to `along`."""

    def place(self, point: CurvePoint) -> Array:
        """The unknowns y (N + 1,) of a point."""

    def direction(self, point: CurvePoint) -> Array:
        """The unit tangent (N + 1,) at a point."""


def special_points(
    path: Path, a: CurvePoint, b: CurvePoint, contacts: NDArray[np.int64] | None
) -> list[CurvePoint]:
    """The special points between two points of a curve, in their order.

    Args:
        path: finds points of the curve.
        a: a point.
        b: the next point; the tangents of both point along the path.
        contacts: (P,) number of the contact to which each contact point belongs; None seeks folds
            only.

    Returns:
        The special points; one that could not be located is an end of its bracket, and `within`
        tells how wide this is.
    """
    found: list[CurvePoint] = []
    if a.tangent[-1] * b.tangent[-1] < 0.0:
        fold = change_of_sign(path, lambda point: float(point.tangent[-1]), a, b)
        found.append(_located(fold, "fold"))
    if contacts is None:
        return found
    for kind, margins in _contact_changes(a, b, contacts):
        bracket = change_of_sign(path, _largest(margins), a, b, exact=False)
        found.append(_located(bracket, kind, int(np.argmax(margins(bracket.nearest)))))
    folds = [path.place(point) for point in found if point.kind == "fold"]
    for point in _crossings(path, a, b):
        apart = [norm(path.place(point) - fold) for fold in folds]
        if min(apart, default=np.inf) > LOCATED**0.5:
            found.append(point)
    if len(found) < 2:
        return found
    chord = path.place(b) - path.place(a)
    return sorted(found, key=lambda point: float(chord @ path.place(point)))


def turned_points(
    path: Path, a: CurvePoint, b: CurvePoint, deep: int = DEEP, contrary: int = CONTRARY
) -> list[CurvePoint]:
    """Points between two points of a curve that hide two folds, in order; none if they do not.

    The tangents at a and b then ask for the other sense of the parameter than the way from a to b.
    Of the points that are given, and a and b, no two neighbours hide two folds in this way, unless
    the tangents are contrary to the way on both sides of the points again and again: where sliders
    begin to slip, the curve may go back over a piece with the tangents of the way there.

    Args:
        path: finds points of the curve.
        a: a point.
        b: the next point.
        deep: how often the way may be divided.
        contrary: how often both parts of a way may hide folds.
    """
    if not deep or not _turns(path, a, b):
        return []
    middle = point_between(path, a, b, 0.5)
    if middle is None:
        return []
    first, here, last = (path.place(point) for point in (a, middle, b))
    if max(norm(here - first), norm(last - here)) > norm(last - first):
        return []  # the plane between them meets another part of the curve
    contrary -= _turns(path, a, middle) and _turns(path, middle, b)
    if contrary < 0:
        return [middle]
    return [
        *turned_points(path, a, middle, deep - 1, contrary),
        middle,
        *turned_points(path, middle, b, deep - 1, contrary),
    ]


def _turns(path: Path, a: CurvePoint, b: CurvePoint) -> bool:
    """Whether the parameter goes from a to b against the tangents at both."""
    way = path.place(b)[-1] - path.place(a)[-1]
    hidden = a.tangent[-1] * b.tangent[-1] > 0.0 and way * a.tangent[-1] < 0.0
    return bool(hidden and abs(way) > BRACKET)


def _contact_changes(
    a: CurvePoint, b: CurvePoint, contacts: NDArray[np.int64]
) -> Iterator[tuple[str, Margins]]:
    """Kind of each contact event between a and b, and how far its contact is from it."""
    for contact in np.unique(contacts):
        mine = contacts == contact
        bits = [int(np.bitwise_or.reduce(point.states[mine])) for point in (a, b)]
        touches, opens, slips = (
            [bool(had & state) for had in bits] for state in (SLIPS | STICKS, OPENS, SLIPS)
        )
        if touches[0] != touches[1]:
            yield _end(touches, "touch"), _margins("touch", mine)
        if opens[0] != opens[1]:
            yield _end(opens, "lift-off"), _margins("lift_off", mine)
        if slips[0] != slips[1] and all(touches):
            yield _end(slips, "slip"), _margins("slip", mine)


def _margins(name: str, mine: NDArray[np.bool_]) -> Margins:
    """The function that reads a field of `Extremes` at the points of a contact."""
    return lambda point: np.where(mine, getattr(point.extremes, name), -np.inf)


def _largest(margins: Margins) -> Test:
    """The function that is positive if one of the margins is."""
    return lambda point: float(margins(point).max())


def _end(occurs: list[bool], what: str) -> str:
    """The name of an event."""
    return f"{'first' if occurs[1] else 'last'} {what}"


def outside(motion: CurvePoint | PeriodicMotion) -> int:
    """Number of multipliers outside of the unit circle."""
    if motion.stable:
        return 0
    sizes = np.abs(judged(motion.multipliers, motion.free_sliders))
    return int(np.sum(sizes > 1.0 + STABLE_WITHIN))


def _crossings(path: Path, a: CurvePoint, b: CurvePoint) -> list[CurvePoint]:
    """Where multipliers cross the unit circle between two points.

    The size of the multiplier of rank k (the k-th largest) is a continuous function of the
    monodromy matrix, whatever multipliers collide. If k is the larger number outside, it passes 1.
    The parts beside a crossing are searched too, the oldest first, up to `MOST` crossings. A part
    that is then left counts as the bracket of one more.
    """
    found: list[CurvePoint] = []
    parts = [(a, b)]
    while parts:
        first, last = parts.pop(0)
        rank = max(outside(first), outside(last))
        if outside(first) == outside(last):
            continue
        size = _size_of(rank)
        bracket = Bracket(first, last, (size(first), size(last)))
        if len(found) < MOST:
            bracket = change_of_sign(path, size, first, last)
            if norm(path.place(last) - path.place(first)) > 2.0 * BRACKET:
                parts += [(first, bracket.before), (bracket.after, last)]
        near = norm(path.place(bracket.after) - path.place(bracket.before)) <= LOCATED
        if near and any(bracket.nearest.s is known.s for known in found):
            continue  # beside a fold, the way on may lead back to the same motion
        kind = _kind(bracket, rank, abs(size(last) - size(first)) if near else np.inf)
        found.append(_located(bracket, kind))
    return found


def _size_of(rank: int) -> Test:
    """The function that is positive if the multiplier of a rank is outside of the unit circle."""

    def test(point: CurvePoint) -> float:
        sizes = np.abs(point.judged)
        return float(sizes[rank - 1] - 1.0 - STABLE_WITHIN) if sizes.size >= rank else -1.0

    return test


def _located(bracket: Bracket[CurvePoint], kind: str, contact: int = -1) -> CurvePoint:
    """The special point of a bracket, with the width of the bracket."""
    width = abs(bracket.after.parameter - bracket.before.parameter)
    return replace(bracket.nearest, kind=kind, contact=contact, within=width)


def _kind(bracket: Bracket[CurvePoint], rank: int, change: float) -> str:
    """The kind of a bifurcation at which the multiplier of a rank crosses the unit circle.

    `change` is that of its size outside of the bracket; infinite if the bracket is too wide to tell
    a jump.
    """
    low, high = bracket.values
    if bracket.nearest.states.size and abs(high - low) > JUMP * change:
        return "non-smooth"
    multiplier = bracket.nearest.judged[rank - 1]
    if abs(multiplier.imag) > REAL:
        return "torus"
    return "period doubling" if multiplier.real < 0.0 else "branch point"


def change_of_sign(
    path: Path, test: Test, a: CurvePoint, b: CurvePoint, *, exact: bool = True
) -> Bracket[CurvePoint]:
    """Bracket the change of sign of a function between two points of a curve.

    Args:
        path: finds points of the curve.
        test: the function; its signs at a and b differ. It may jump.
        a: a point.
        b: the next point; the tangents of both point along the path.
        exact: whether the function asks for derivatives at the very point.

    Returns:
        The bracket, not wider than `BRACKET` unless a point in it was not found.
    """
    planes = _Planes(path, a, b)
    point = partial(planes.point, exact=exact)
    found = bracketed(point, test, a, b, planes.length, BRACKET, lost=planes.length)
    assert found is not None  # no bracket is too wide
    return found


def point_between(path: Path, a: CurvePoint, b: CurvePoint, share: float) -> CurvePoint | None:
    """The point of a curve at a share of the way from a to b; None if it is not found."""
    planes = _Planes(path, a, b)
    return planes.point([a, b], [0.0, planes.length], share * planes.length, exact=False)


class _Planes:
    """Parallel planes between two points, in which points of the curve are sought.

    Their normal is the sum of the tangents at both points: a curve with one corner between them
    passes each plane once, even if it turns back there.

    Attributes:
        length: distance of the planes through both points.
    """

    def __init__(self, path: Path, a: CurvePoint, b: CurvePoint):
        """Choose the normal."""
        self._path, self._origin = path, path.place(a)
        chord, normal = path.place(b) - self._origin, path.direction(a) + path.direction(b)
        if normal @ chord <= ALONG * norm(normal) * norm(chord):
            normal = chord
        self._normal: Array = np.asarray(normal / norm(normal))
        self.length = float(self._normal @ chord)

    def point(
        self, points: list[CurvePoint], ends: list[float], arc: float, *, exact: bool = True
    ) -> CurvePoint | None:
        """The point of the curve at a distance from a, between two points; None if lost."""
        for guess in self._guesses(points, ends, arc):
            found = self._path.correct(guess, self._normal, exact=exact)
            if found is not None:
                return self._along(found, points)
        return None

    def _guesses(self, points: list[CurvePoint], ends: list[float], arc: float) -> Iterator[Array]:
        """Guesses (N + 1,) of a point: the cubic through two points, then their tangents."""
        places = [self._path.place(point) for point in points]
        ahead = [self._path.direction(point) for point in points]
        if ahead[0] @ ahead[1] > SMOOTH:
            length, share = norm(places[1] - places[0]), (arc - ends[0]) / (ends[1] - ends[0])
            guess = hermite(places[0], places[1], ahead[0], ahead[1], length, share)
            yield guess + (arc - self._normal @ (guess - self._origin)) * self._normal
        nearer = int(arc > 0.5 * (ends[0] + ends[1]))
        for k in (nearer, 1 - nearer):
            slope = float(self._normal @ ahead[k])
            if abs(slope) > STEEP:
                yield places[k] + (arc - ends[k]) / slope * ahead[k]

    def _along(self, found: CurvePoint, points: list[CurvePoint]) -> CurvePoint:
        """The point with its tangent along the path."""
        ahead, there = (self._path.direction(point) for point in points)
        sense = points[0].sense
        if ahead @ there > STRAIGHT or sense != points[1].sense:  # perhaps a branch point between
            sense = found.sense * (float(np.sign(self._path.direction(found) @ ahead)) or 1.0)
        return oriented(found, sense)


LIGHT = 0.9  # multipliers larger than this belong to lightly damped vibrations
CROSSINGS = 2  # largest number between two points where stretches are sought, to bound the effort
TRIALS = 3  # points that seek one crossing
# Along a curve the size of a multiplier changes much more slowly than its angle: it tells the pairs
# apart. A change of log r by 1 counts as an angle of so many radians.
SIZE_WEIGHT = 40.0
TURN_SEEN = 0.5  # smallest turn in a step, in parts of -2 log r, of a pair that may hide a stretch
NEAR = 0.5  # of -log r: where the angle of the pair is smaller, e is too small for a stretch


class Crossing(NamedTuple):
    """A lightly damped pair meets on the real axis between two points of a curve.

    Attributes:
        size: r.
        sign: (-1)^k.
        angles: d at both points.
    """

    size: float
    sign: float
    angles: tuple[float, float]


def turning_pairs(
    values: Any, vectors: Any, n: int, omega: float, period: float, steps: int
) -> tuple[NDArray[np.complex128], Array]:
    """The multipliers of lightly damped vibrations, and how they turn with the period.

    Steps of length h by the midpoint rule turn the pair of a vibration of angular frequency w by
    2 arctan(w h / 2) each, so that d theta / d log T = w T / (1 + (w h / 2)^2). This rate is at
    most the number of steps.

    Args:
        values: (N,) eigenvalues of the monodromy matrix.
        vectors: (N, N) its eigenvectors, in variables that begin with (L^T q, L^T v / omega).
        n: number of coordinates.
        omega: by which the velocities are scaled, 1/s.
        period: T of the motion, s.
        steps: their number in the period.

    Returns:
        The multipliers (K,), one of each pair, and their rates d theta / d log T (K,).
    """
    light = (np.abs(values) > LIGHT) & (np.abs(values.imag) > REAL)
    q, v = vectors[:n, light], omega * period * vectors[n : 2 * n, light]
    turns = np.sum((q.conj() * v).imag, axis=0)
    forward = turns > 0.0
    turns = turns[forward] / np.sum(np.abs(q[:, forward]) ** 2, axis=0)
    rates = turns / (1.0 + (turns / (2.0 * steps)) ** 2)
    return values[light][forward].astype(np.complex128), np.asarray(rates)


def unseen_points(path: Path, a: CurvePoint, b: CurvePoint) -> list[CurvePoint]:
    """Points between two points of a curve with more unstable multipliers than either, in order.

    Between two unstable points none is sought.
    """
    if not (a.stable or b.stable):
        return []
    crossings = sorted(_axis_crossings(a, b), key=lambda crossing: -crossing.size)[:CROSSINGS]
    found = [_unstable_near(path, a, b, crossing) for crossing in crossings]
    unseen = [point for point in found if point is not None]
    if len(unseen) < 2:
        return unseen
    chord = path.place(b) - path.place(a)
    return sorted(unseen, key=lambda point: float(chord @ path.place(point)))


def _axis_crossings(a: CurvePoint, b: CurvePoint) -> Iterator[Crossing]:
    """Where lightly damped pairs meet on the real axis between two points."""
    if a.turning.size == 0 or b.turning.size == 0:
        return
    rates = 0.5 * (a.turn_rates[:, None] + b.turn_rates[None, :])
    expected = rates * np.log(b.period / a.period)
    turns, apart = _turned(a.turning[:, None] * np.exp(1j * expected), b.turning[None, :])
    pairs, nearest = np.arange(a.turning.size), np.argmin(apart, axis=1)
    sizes, first = np.abs(a.turning), np.angle(a.turning)
    last = first + (expected + turns)[pairs, nearest]
    turn = np.maximum(np.abs(expected[pairs, nearest]), np.abs(last - first))
    low = np.ceil(np.minimum(first, last) / np.pi)
    high = np.floor(np.maximum(first, last) / np.pi)
    both = np.argmin(apart, axis=0)[nearest] == pairs  # each is the nearest one of the other
    turns_enough = turn > -2.0 * TURN_SEEN * np.log(sizes)
    for k in np.flatnonzero(both & turns_enough & (sizes < 1.0) & (low <= high)):
        for multiple in range(int(low[k]), int(high[k]) + 1):
            zero = np.pi * multiple
            sign = 1.0 if multiple % 2 == 0 else -1.0
            angles = float(first[k]) - zero, float(last[k]) - zero
            yield Crossing(float(sizes[k]), sign, angles)


def _turned(expected: Any, found: NDArray[np.complex128]) -> tuple[Array, Array]:
    """Angles from the expected multipliers to the found ones, and their distances."""
    ratio = np.log(found / expected)
    return ratio.imag, np.hypot(SIZE_WEIGHT * ratio.real, ratio.imag)


def _unstable_near(
    path: Path, a: CurvePoint, b: CurvePoint, crossing: Crossing
) -> CurvePoint | None:
    """A point near a crossing with more unstable multipliers than a and b, or None."""
    planes, most = _Planes(path, a, b), max(outside(a), outside(b))
    shares, angles = [0.0, 1.0], list(crossing.angles)
    for _ in range(TRIALS):
        share = shares[0] - angles[0] * (shares[1] - shares[0]) / (angles[1] - angles[0])
        point = planes.point([a, b], [0.0, planes.length], share * planes.length, exact=False)
        if point is None or outside(point) > most:
            return point
        if point.turning.size == 0:
            return None
        turns, apart = _turned(crossing.sign * crossing.size, point.turning)
        angle = float(turns[int(np.argmin(apart))])
        if abs(angle) < -NEAR * np.log(crossing.size) or not min(angles) < angle < max(angles):
            return None
        side = 0 if angle * angles[0] > 0.0 else 1
        shares[side], angles[side] = share, angle
    return None
