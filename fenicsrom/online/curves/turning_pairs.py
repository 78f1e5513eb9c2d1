"""Unstable stretches between two points of a curve: lightly damped vibrations at a resonance.

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

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.curves.bifurcations import REAL, Path, outside, point_between
from fenicsrom.online.curves.curve import CurvePoint

LIGHT = 0.9  # multipliers larger than this belong to lightly damped vibrations
CROSSINGS = 2  # largest number between two points where stretches are sought, to bound the effort
TRIALS = 3  # points that seek one crossing
# Along a curve the size of a multiplier changes much more slowly than its angle: it tells the pairs
# apart. A change of log r by 1 counts as an angle of so many radians.
SIZE_WEIGHT = 40.0
TURN_SEEN = 0.5  # smallest turn in a step, in parts of -2 log r, of a pair that may hide a stretch
NEAR = 0.5  # of -log r: where the pair keeps so small an angle, e is too small for a stretch


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
    q, v = vectors[:n, light], vectors[n : 2 * n, light]
    turns = np.sum((q.conj() * v).imag, axis=0)
    forward = turns > 0.0
    turns = omega * period * turns[forward] / np.sum(np.abs(q[:, forward]) ** 2, axis=0)
    rates = turns / (1.0 + (turns / (2.0 * steps)) ** 2)
    return values[light][forward].astype(np.complex128), np.asarray(rates)


def unseen_points(path: Path, a: CurvePoint, b: CurvePoint) -> list[CurvePoint]:
    """Points between two points of a curve with more unstable multipliers than either, in order."""
    crossings = sorted(_crossings(a, b), key=lambda crossing: -crossing.size)[:CROSSINGS]
    found = [_unstable_near(path, a, b, crossing) for crossing in crossings]
    unseen = [point for point in found if point is not None]
    if len(unseen) < 2:
        return unseen
    chord = path.place(b) - path.place(a)
    return sorted(unseen, key=lambda point: float(chord @ path.place(point)))


def _crossings(a: CurvePoint, b: CurvePoint) -> Iterator[Crossing]:
    """Where lightly damped pairs meet on the real axis between two points."""
    if a.turning.size == 0 or b.turning.size == 0:
        return
    rates = 0.5 * (a.turn_rates[:, None] + b.turn_rates[None, :])
    expected = rates * np.log(b.period / a.period)
    turns, apart = _turns(a.turning[:, None] * np.exp(1j * expected), b.turning[None, :])
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
            yield Crossing(float(sizes[k]), sign, (float(first[k]) - zero, float(last[k]) - zero))


def _turns(expected: Any, found: NDArray[np.complex128]) -> tuple[Array, Array]:
    """Angles from the expected multipliers to the found ones, and their distances."""
    ratio = np.log(found / expected)
    return ratio.imag, np.hypot(SIZE_WEIGHT * ratio.real, ratio.imag)


def _unstable_near(
    path: Path, a: CurvePoint, b: CurvePoint, crossing: Crossing
) -> CurvePoint | None:
    """A point near a crossing with more unstable multipliers than a and b, or None."""
    shares, angles = [0.0, 1.0], list(crossing.angles)
    for _ in range(TRIALS):
        share = shares[0] - angles[0] * (shares[1] - shares[0]) / (angles[1] - angles[0])
        point = point_between(path, a, b, share)
        if point is None:
            return None
        if outside(point) > max(outside(a), outside(b)):
            return point
        if point.turning.size == 0:
            return None
        turns, apart = _turns(crossing.sign * crossing.size, point.turning)
        angle = float(turns[np.argmin(apart)])
        if abs(angle) < -NEAR * np.log(crossing.size):
            return None
        side = 0 if angle * angles[0] > 0.0 else 1
        if not min(angles) < angle < max(angles):
            return None
        shares[side], angles[side] = share, angle
    return None
