"""Continuation of curves with corners: the solutions of n piecewise smooth equations over p.

The curve of r(s, p) = 0 is followed along its arc, with

    |(ds, dp)|^2 = |W ds|^2 / size^2 + dp^2 / range^2,    J = [dr/ds, dr/dp].                    (1)

Where a contact point changes its state, the tangent of the curve jumps: the curve has a corner. Let
v be the unit null vector of J with det [J; v] > 0. Along the curve of a piecewise smooth map the
tangent is c v with one sense c = 1 or -1, through folds and corners (index theory of piecewise
linear paths: Allgower and Georg 1990, chapters 12 and 15). The component of v along p is
proportional to det dr/ds, so a corner turns the parameter back exactly if an odd number of real
eigenvalues of dr/ds changes its sign there.

A step goes along the tangent, and Newton's method corrects the guess on the plane normal to it
(Keller 1977; Seydel 2010, chapter 4). If this fails, a corner lies within the step: the step is
repeated along the tangent of the far piece, which is taken at the end of the failed step, then in
its middle. It must not lead back on the near piece by dragging sliders that stick all the time. The
sense c changes at a branch point only, where the curve goes straight on.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from fenicsrom.arrays import Array
from fenicsrom.online.curves import curve as curves
from fenicsrom.online.kernels.dense import interpolation_weights
from fenicsrom.online.periodic.shooting import STAYS, hold_sliders

FIRST_STEP, LARGEST_STEP, SMALLEST_STEP = 0.01, 0.05, 1e-7  # along a curve, with the lengths (1)
SHORTER = 0.4  # factor of a step that failed
GROWTH = ((2, 2.0), (4, 1.5), (6, 1.0))  # corrections of a point -> factor of the next step
SLOW = 0.6  # its factor after more corrections
FAR = 1.5  # longest distance of a new point, and longest correction, in parts of the step
BEND = 0.5  # least cosine of the angle between the tangents of neighbours without a corner
SHORT = 0.003  # step that may pass a sharper bend, of which a corner is not told
SMOOTH = 0.95  # cosine above which a tangent beyond a step shows no corner
DRAGGED = 0.5  # part of the way to a new point by sliders that rest, above which it may not go back
TURN = -0.5  # least cosine between the tangent of a far piece and that of the point found on it
STRAIGHT, EASY = 0.98, 4  # cosine and corrections of a curve that goes straight through a branch
FIRST_SIZE = 2.0  # least size in (1), in parts of that of the first point
REMEASURED = 1.3  # change of the motion after which lengths are measured by its new size
CLOSED = 0.02  # of a step: a curve that passes its first point so closely is closed
REPEATED = 6  # a curve that passes so many points again, step by step, goes round and round

LOCATED = 1e-3
"""How closely the highest point is located, as a part of the arc of two steps that holds it.

A step turns a motion against the force by 0.05, so the height there is off by less than 1e-6."""

CORRECTIONS = 12
TRIED = 3  # after so many corrections, each must be shorter than half of the shortest before
LARGEST_CORRECTION = 1.0  # longer steps of Newton's method away from a curve are not trusted
TOLERANCE = 1e-7  # a point is found if Newton's method would move it by at most this
OF_STEP = 1e-3  # and by at most this part of the step along the curve
EXACT = 1e-9  # the same of a point that is sought exactly
KEPT_WITHIN = 1e-4  # the factor is kept after a correction of at most this,
RATE = 0.3  # while each correction is shorter than this part of the last
FLAT = 1e6  # length of the null vector beyond which its border is nearly normal to it


Factor = tuple[Array, Array]
"""LU factors and pivots."""


class Values(NamedTuple):
    """The equations at one place.

    Attributes:
        residual: (n,) r.
        jacobian: (n, n + 1) J; (0, 0) if it was not asked for.
        detail: what a point of the curve is made of.
    """

    residual: Array
    jacobian: Array
    detail: Any


class Place(NamedTuple):
    """A solution of the equations, as it is found.

    Attributes:
        y: (n + 1,) W s / size and p / range.
        tangent: (n + 1,) v, with the lengths (1).
        residual: relative to s.
        jacobian: (n, n + 1) J where the derivative was taken last, of s and p.
        free: number of equations of sliders that stick.
        corrections: steps of Newton's method.
        detail: as in `Values`.
    """

    y: Array
    tangent: Array
    residual: float
    jacobian: Array
    free: int
    corrections: int
    detail: Any


Point = Any
"""What a continuation needs of a point of its curve, as `fenicsrom.online.curves.curve.CurvePoint`
has it: s (n,), the parameter, the tangent (n + 1,) in (s, p), and its sense c."""


class ArcLength:
    """One curve: `run` follows it from a point to the end of a range.

    Attributes:
        low: where the range of the parameter starts.
        high: where it ends.
        range: its width.
        size: of W s, which measures lengths; `run` keeps it near that of the present point.
        least: smallest size.
        step: size of the next step.
    """

    step = FIRST_STEP
    sliders: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
    """The equations and unknowns that are sliders of contact points."""

    def __init__(self, low: float, high: float, s: Array, weights: Array | None = None):
        """Set the range of the parameter, the first s (n,), and the weights W (n, n), or 1."""
        self.low, self.high, self.range = low, high, high - low
        self._weights, self._inverse = weights, None if weights is None else np.linalg.inv(weights)
        self.size = self.least = FIRST_SIZE * curves.norm(self._weighed(s)) or 1.0
        self._evaluations = [0, 0]

    def values(self, s: Array, parameter: float, *, derive: bool) -> Values | None:
        """The equations; None if they could not be evaluated."""
        raise NotImplementedError

    def point(self, place: Place, evaluations: tuple[int, int]) -> Point:
        """The point of the curve of a solution, with sense 1.

        Args:
            place: the solution.
            evaluations: of the equations since the last point, and those with derivatives.
        """
        raise NotImplementedError

    # ------------------------------------------------------------------ places

    def place(self, point: Point) -> Array:
        """The unknowns y (n + 1,) of a point: W s / size and p / range."""
        return self._unknowns(point.s, point.parameter)

    def _weighed(self, s: Array) -> Array:
        """W s (n,)."""
        return s if self._weights is None else self._weights @ s

    def _unknowns(self, s: Array, parameter: float) -> Array:
        return np.append(self._weighed(s) / self.size, parameter / self.range)

    def variables(self, y: Array) -> tuple[Array, float]:
        """The variables s (n,) and p of unknowns y (n + 1,)."""
        s = y[:-1] * self.size
        return s if self._inverse is None else self._inverse @ s, float(y[-1] * self.range)

    def direction(self, point: Point) -> Array:
        """The unit tangent (n + 1,) at a point, with the lengths (1)."""
        found = self._unknowns(point.tangent[:-1], point.tangent[-1])
        return np.asarray(found / curves.norm(found))

    def at_parameter(self, s: Array, value: float, *, exact: bool = True) -> Point:
        """The point at a value of the parameter near s (n,), as `correct` finds it."""
        along = np.zeros(s.size + 1)
        along[-1] = 1.0
        return self.correct(self._unknowns(s, value), along, exact=exact)

    def correct(self, y: Array, along: Array, *, exact: bool = False) -> Point:
        """The point of the curve on the plane through y normal to `along`; None if not found.

        Args:
            y: (n + 1,) W s / size and p / range.
            along: (n + 1,) unit normal; a unit vector of p keeps the parameter.
            exact: whether the derivative is taken at the very point.
        """
        tolerance = EXACT if exact else TOLERANCE
        found = self._corrected(y, along, tolerance, LARGEST_CORRECTION, exact=exact)
        return None if found is None else self._made(found)

    def _made(self, place: Place) -> Point:
        marched, derived = self._evaluations
        self._evaluations = [0, 0]
        return self.point(place, (marched, derived))

    # ------------------------------------------------------------------ corrections

    def _at(self, y: Array, *, derive: bool) -> Values | None:
        self._evaluations[0] += 1
        self._evaluations[1] += derive
        return self.values(*self.variables(y), derive=derive)

    def _corrected(
        self, y: Array, along: Array, tolerance: float, longest: float, *, exact: bool = False
    ) -> Place | None:
        """The solution on the plane through y (n + 1,) normal to `along`; None if not found.

        Newton's method keeps the derivative after short corrections, while it serves. It ends at a
        correction of more than `longest`.
        """
        begin, last, least, corrections, free = y, np.inf, np.inf, 0, 0
        factor: Factor | None = None
        jacobian: Array = np.zeros((0, 0))
        scaled: Array = jacobian
        for _ in range(CORRECTIONS):
            fresh = factor is None
            found = self._at(y, derive=fresh)
            if found is None:
                return None
            if fresh:
                jacobian = found.jacobian
                scaled, free = self._scaled(jacobian)
                factor = factorised(scaled, along)
            if factor is None:
                return None
            step = solved(factor, np.append(-found.residual / self.size, along @ (begin - y)))
            length = curves.norm(step)
            if length <= tolerance or (length <= TOLERANCE and length > RATE * last):
                if exact and not fresh:
                    factor = None
                    continue
                size = max(curves.norm(y[:-1]), 1e-300)
                residual = curves.norm(found.residual) / self.size / size
                tangent = _null(scaled, along, factor)
                if tangent is None:
                    return None
                return Place(y, tangent, residual, jacobian, free, corrections, found.detail)
            if not length <= longest:
                return None
            if corrections >= TRIED and length > 0.5 * least and not exact:
                return None
            if not fresh and length > RATE * last:
                factor, last = None, np.inf
                continue
            least = min(least, length)
            if length > KEPT_WITHIN:
                factor = None
            y, last, corrections = y + step, length, corrections + 1
        return None

    def _scaled(self, jacobian: Array) -> tuple[Array, int]:
        """J (n, n + 1) with the lengths (1), in which sliders that stick rest; their number."""
        found = jacobian.copy()
        free = hold_sliders(found, self.sliders)
        if self._inverse is not None:
            found[:, :-1] = found[:, :-1] @ self._inverse
        found[:, -1] *= self.range / self.size
        return found, free

    # ------------------------------------------------------------------ one step

    def _next(self, here: Point, step: float) -> tuple[Point, int] | None:
        """The point a step beyond a point, and its corrections; None asks for a shorter step."""
        y, ahead = self.place(here), self.direction(here)
        limits = min(TOLERANCE, OF_STEP * step), FAR * step
        found = self._corrected(y + step * ahead, ahead, *limits)
        if found is not None and curves.norm(found.y - y - step * ahead) < step:
            way, cosine, sense = found.y - y, float(found.tangent @ ahead), here.sense
            straight = way @ ahead > STRAIGHT * curves.norm(way) and abs(cosine) > STRAIGHT
            if straight and found.corrections <= EASY:
                sense = float(np.sign(cosine))
            if curves.norm(way) < FAR * step and (sense * cosine > BEND or step <= SHORT):
                return self._oriented(found, sense), found.corrections
        for share in (1.0, 0.5):
            far = self._beyond(y + share * step * ahead, ahead, here.sense)
            if far is None or far @ ahead > SMOOTH:
                continue
            found = self._corrected(y + step * far, far, *limits)
            if (
                found is None
                or self._goes_back(here, found)
                or curves.norm(found.y - y) >= FAR * step
            ):
                continue
            if here.sense * (found.tangent @ far) > TURN:
                return self._oriented(found, here.sense), found.corrections
        return None

    def _goes_back(self, here: Point, found: Place) -> bool:
        """Whether a step goes back in p and mainly moves sliders that rest at both of its ends.

        A point sticks all the time wherever its slider is within some bounds. Sliders that are
        moved against these bounds along the far piece may lead back to the near piece.
        """
        way = found.y - self.place(here)
        rests = self.sliders[np.abs(here.tangent[self.sliders]) <= STAYS]
        rests = rests[np.abs(found.tangent[rests]) <= STAYS]
        back = way[-1] * here.tangent[-1] < 0.0
        return bool(back and curves.norm(way[rests]) > DRAGGED * curves.norm(way))

    def _oriented(self, found: Place, sense: float) -> Point:
        return oriented(self._made(found), sense)

    def _beyond(self, y: Array, ahead: Array, sense: float) -> Array | None:
        """The tangent (n + 1,) that the equations have at y, which need not solve them."""
        found = self._at(y, derive=True)
        if found is None:
            return None
        scaled = self._scaled(found.jacobian)[0]
        tangent = _null(scaled, ahead, factorised(scaled, ahead))
        return None if tangent is None else sense * tangent

    def _end(self, inside: Point, outside: Point) -> Point | None:
        """The point on the bound of the range between two points, if it is found.

        There the curve leaves the range. The sense of the point outside of it may be another one,
        because a branch point may lie between both.
        """
        bound, way = (self.high, 1.0) if outside.parameter > self.high else (self.low, -1.0)
        share = (bound - inside.parameter) / (outside.parameter - inside.parameter)
        last = self.at_parameter(inside.s + share * (outside.s - inside.s), bound)
        if last is None:
            return None
        return oriented(last, last.sense * (float(np.sign(last.tangent[-1] * way)) or 1.0))

    # ------------------------------------------------------------------ the curve

    def run(
        self,
        start: Point,
        direction: float | None,
        *,
        curve: curves.Curve | None = None,
        largest_step: float = LARGEST_STEP,
        points: int = 1000,
        locate: bool = True,
        progress: Callable[[Point], None] | None = None,
    ) -> curves.Curve:
        """Follow the curve.

        Args:
            start: its first point, or the last one of an interrupted run.
            direction: sign of the change of the parameter at the start; None follows the tangent of
                `start`.
            curve: receives the points, after those that it has; the last of these is `start`.
            largest_step: largest step.
            points: largest number of points.
            locate: whether to locate special points.
            progress: called with each point.
        """
        here, self.step, self._repeated = start, FIRST_STEP, 0
        if direction is not None and start.tangent[-1] * direction < 0.0:
            here = oriented(start, -start.sense)
        curve = curves.Curve([here]) if curve is None else curve
        curve.reason = "interrupted"
        while len(curve.points) < points:
            self.measure(here)
            step = min(self.step, largest_step * self.haste(curve))
            made = self._next(here, step)
            found = None if made is None else made[0]
            ends = found is not None and not self.low <= found.parameter <= self.high
            if found is not None and ends:
                found = self._end(here, found)
            if made is None or found is None:
                self.step = SHORTER * step
                if self.step < SMALLEST_STEP:
                    curve.reason = curves.END if ends else curves.LOST
                    return curve
                continue
            if not ends and (reason := self.arrival(curve, here, found)):
                curve.reason = reason
                return curve
            unseen, special = self.between(here, found) if locate else ([], [])
            curve.special.extend(special)
            curve.points.extend([*unseen, found])
            if ends:
                apart = abs(found.parameter - curve.points[0].parameter)
                curve.reason = curves.END if apart > 1e-9 * self.range else curves.BACK
                return curve
            here = found
            self.step = step * next((f for n, f in GROWTH if made[1] <= n), SLOW)
            if progress is not None:
                progress(found)
        curve.reason = curves.OUT_OF_POINTS
        return curve

    def haste(self, curve: curves.Curve) -> float:
        """Factor on the largest step from the last point of a curve."""
        return 1.0

    def measure(self, here: Point) -> None:
        """Measure lengths by the size of a point, where it has changed."""
        now = max(curves.norm(self._weighed(here.s)), self.least)
        if not 1.0 / REMEASURED <= now / self.size <= REMEASURED:
            self.size = now

    def highest(self, points: Sequence[Point], height: Callable[[Point], float]) -> Point:
        """The highest point on the arc through three points, of which the second is the highest."""
        from scipy.optimize import minimize_scalar  # slow to import

        places = np.array([self.place(point) for point in points])
        arcs = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1)))
        chord = (places[2] - places[0]) / curves.norm(places[2] - places[0])
        best = points[1], height(points[1])

        def depth(arc: float) -> float:
            nonlocal best
            weights = interpolation_weights([*arcs], arc)
            found = self.correct(np.tensordot(weights, places, axes=1), chord)
            if found is None:
                return 0.0  # lower than any point; the search computes with the value
            found = oriented(found, points[1].sense)
            value = height(found)
            if value > best[1]:
                best = found, value
            return -value

        limit = {"xatol": LOCATED * arcs[2]}
        minimize_scalar(depth, bounds=(0.0, arcs[2]), method="bounded", options=limit)
        return best[0]

    def between(self, before: Point, found: Point) -> tuple[list[Point], list[Point]]:
        """More points between two points, and the special points there."""
        return [], []

    def arrival(self, curve: curves.Curve, before: Point, found: Point) -> str:
        """Why the curve ends between two points; its last point is then added. Else ""."""
        if len(curve.points) > 2 and self._passes(curve.points[:2], before, found):
            curve.points.append(curve.points[0])
            return "closed"
        low, high = sorted((before.parameter, found.parameter))
        passed = sum(
            self._passes(curve.points[k : k + 2], before, found)
            for k, point in enumerate(curve.points[1:-2], 1)
            if low <= point.parameter <= high
        )
        self._repeated = max(self._repeated + (passed or -1), 0)
        return curves.REPEATS if self._repeated >= REPEATED else ""

    def _passes(self, home: list[Point], before: Point, found: Point) -> bool:
        """Whether the curve passes the first of two points in their direction."""
        first, last, y = self.place(before), self.place(found), self.place(home[0])
        chord, way = last - first, self.place(home[1]) - y
        length = curves.norm(chord)
        share = float(chord @ (y - first)) / length**2
        if not 0.0 < share <= 1.0 or way @ chord < 0.5 * length * curves.norm(way):
            return False
        ahead, there = self.direction(before), self.direction(found)
        near = curves.hermite(first, last, ahead, there, length, share)
        return curves.norm(near - y) < CLOSED * length


def oriented(point: Point, sense: float) -> Point:
    """The point with the tangent of a sense, 1 or -1."""
    if point.sense == sense:
        return point
    return replace(point, tangent=-point.tangent, sense=sense)


def factorised(jacobian: Array, border: Array) -> Factor | None:
    """The LU factors of [J; border] (n + 1, n + 1); None if it is singular."""
    lu, pivots, fails = dgetrf(np.vstack([jacobian, border]))
    return None if fails else (lu, pivots)


def solved(factor: Factor, right: Array) -> Array:
    """The solution (n + 1,) of a factorised system."""
    return np.asarray(dgetrs(*factor, right)[0])


def _null(jacobian: Array, border: Array, factor: Factor | None) -> Array | None:
    """The unit null vector v (n + 1,) of J with det [J; v] > 0; None if it is not unique.

    Of [J; g] v = e the last unit vector, det [J; v] has the sign of det [J; g]. The border g may be
    normal to the curve; then another one is taken.
    """
    for _ in range(2):
        if factor is not None:
            right = np.zeros(border.size)
            right[-1] = 1.0
            found = solved(factor, right)
            length = curves.norm(found)
            if length < FLAT:
                lu, pivots = factor
                swaps = np.count_nonzero(pivots != np.arange(pivots.size))
                negative = np.count_nonzero(np.diag(lu) < 0.0)
                return np.asarray(found / length * (-1.0) ** (swaps + negative))
        border = np.random.default_rng(0).standard_normal(border.size)
        factor = factorised(jacobian, np.asarray(border / curves.norm(border)))
    return None
