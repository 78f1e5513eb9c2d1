"""Curves of periodic motions: pseudo-arclength continuation in a parameter.

The unknowns are the scaled variables s of `fenicsrom.online.periodic` and the parameter p. With
|(ds, dp)|^2 = |ds|^2 / size^2 + dp^2 / range^2 the curve is followed by a polynomial through its
last points and corrected orthogonally to its tangent (Keller 1977; Seydel 2010, chapter 4).
`fenicsrom.online.bifurcations` locates special points between two points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.bifurcations import change_of_sign, special_points
from fenicsrom.online.contact_events import extremes, state_bits
from fenicsrom.online.curve import Curve, CurvePoint, hermite, predict, replaced
from fenicsrom.online.curve_measures import harmonics, states_over_period
from fenicsrom.online.families import Family
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.periodic import (
    RANK,
    PeriodicMotion,
    Shooting,
    floquet,
    least_squares_step,
    stuck_points,
)
from fenicsrom.online.state import DAMPING_DISSIPATION, WORK
from fenicsrom.online.surfaces import Contacts

CURVE_TOLERANCE = 1e-8  # of the residual relative to the variables
CORRECTIONS = 8
FIRST_STEP = 0.01  # along a curve, in parts of the range and of the size of the motion
LARGEST_CORRECTION = 0.5  # longer steps of Newton's method are not trusted
DERIVED_WITHIN = 1e-5  # how far from the point found its derivative may be taken
AWAY, KINK_AWAY = 0.5, 2.0  # longest correction in parts of the step, on the curve and at a kink
STRAIGHT = 0.8  # least cosine of the angle between the tangents of two neighbours
CLOSED = 0.02  # of a step: a curve that passes its first point so closely is closed
GOOD_RATE = 0.1  # a correction that reduces the residual less asks for a new derivative


class Continuation:
    """One curve: `run` follows it from a periodic motion to the end of a range.

    Attributes:
        may_grow: relative residual below which a correction may increase it.
    """

    may_grow = 0.0

    def __init__(
        self,
        shooting: Shooting,
        family: Family,
        low: float,
        high: float,
        size: float,
        tolerance: float = CURVE_TOLERANCE,
    ):
        """Keep the problem.

        Args:
            shooting: the equation of the periodic motion.
            family: problems by the parameter.
            low: where the range of the parameter starts.
            high: where it ends.
            size: of the scaled variables, to weigh them against the parameter.
            tolerance: of the residual relative to the variables.
        """
        self.shooting, self.family, self.tolerance = shooting, family, tolerance
        self.low, self.high, self.range = low, high, high - low
        self.size, self.step = size, 0.0

    def _evaluate(self, y: Array, *, derive: bool) -> Any:
        problem = self.family(y[-1] * self.range)
        return self.shooting.march(
            y[:-1] * self.size,
            problem.model,
            problem.contacts,
            problem.period,
            problem.drift,
            derive=derive,
        )

    def unscaled(self, s: Array, parameter: float) -> Array:
        """Variables z (N,) at the start of the period."""
        return self.shooting.unscaled(s)

    def correct(self, y: Array, along: Array, *, exact: bool = False) -> CurvePoint | None:
        """The point of the curve on the hyperplane through y normal to `along`; None if not found.

        Newton's method takes a new derivative while its steps are longer than `DERIVED_WITHIN`, so
        that the derivative is that of the point found; then it keeps the derivative.

        Args:
            y: (N + 1,) s / size and p / range.
            along: (N + 1,) unit normal; a unit vector of p keeps the parameter.
            exact: whether the derivative is taken at the very point.
        """
        jacobian, last, marched, derived = None, np.inf, 0, 0
        monodromy, stuck = np.zeros((0, 0)), False
        within = 0.0 if exact else DERIVED_WITHIN
        for _ in range(CORRECTIONS):
            fresh = jacobian is None
            found = self._evaluate(y, derive=fresh)
            if found is None:
                return None
            marched, derived = marched + 1, derived + fresh
            residual, matrix, by_parameter, end = found
            relative = float(
                np.linalg.norm(residual) / max(float(np.linalg.norm(y[:-1])) * self.size, 1e-300)
            )
            if relative > max(10.0 * last, self.may_grow):
                return None
            if fresh:
                monodromy, stuck = matrix, len(stuck_points(end.record)) > 0
                jacobian = self._bordered(matrix, by_parameter, along)
            assert jacobian is not None
            if relative <= self.tolerance:
                tangent, free = self._tangent(jacobian, stuck)
                return self._point(y, tangent, monodromy, free, relative, end, (marched, derived))
            step = self._solve(jacobian, np.append(-residual / self.size, 0.0), stuck)
            length = float(np.linalg.norm(step))
            if length > LARGEST_CORRECTION:
                return None
            if length > within or (not fresh and relative > GOOD_RATE * last):
                jacobian = None
            y, last = y + step, relative
        return None

    def _bordered(self, matrix: Array, by_parameter: Array, along: Array) -> Array:
        """The derivative (N + 1, N + 1) of the residual and of the distance along a direction."""
        n = by_parameter.size
        jacobian = np.zeros((n + 1, n + 1))
        jacobian[:n, :n] = matrix - np.eye(n)
        jacobian[:n, n] = by_parameter * self.range / self.size
        jacobian[n] = along
        return jacobian

    def _solve(self, jacobian: Array, right: Array, stuck: bool) -> Array:
        """Solve the bordered system, by least squares where sliders are free.

        Args:
            jacobian: (N + 1, N + 1).
            right: (N + 1,).
            stuck: whether a point sticks during the whole period.
        """
        if not stuck:
            try:
                found: Array = np.asarray(np.linalg.solve(jacobian, right), dtype=np.float64)
                if np.linalg.norm(found) < 1.0 / RANK * max(float(np.linalg.norm(right)), 1e-300):
                    return found
            except np.linalg.LinAlgError:
                pass
        return least_squares_step(jacobian, right)[0]

    def _tangent(self, jacobian: Array, stuck: bool) -> tuple[Array, int]:
        """The unit tangent (N + 1,) of the curve, and the number of free slider components.

        Where sliders are free the motions of a parameter are a family. The tangent is then normal
        to the family, so that the free sliders rest.
        """
        if not stuck:
            found = self._solve(jacobian, np.append(np.zeros(len(jacobian) - 1), 1.0), stuck)
            return found / np.linalg.norm(found), 0
        _, sigma, rows = np.linalg.svd(jacobian[:-1])
        count = 1 + int(np.sum(sigma <= RANK * sigma[0]))
        flat = rows[-count:]
        found = flat[:, -1] @ flat
        if np.linalg.norm(found) < RANK:  # a fold
            found = (flat @ jacobian[-1]) @ flat
        return found / np.linalg.norm(found), count - 1

    def _point(
        self,
        y: Array,
        tangent: Array,
        monodromy: Array,
        free: int,
        residual: float,
        end: Any,
        marches: tuple[int, int],
    ) -> CurvePoint:
        record, m = end.record, self.shooting.m
        displacement = record.displacement
        if displacement.shape[1] == 0:
            displacement = record.probe[:, None, :]
        multipliers, verdict = floquet(monodromy, free)
        s = y[:-1] * self.size
        problem = self.family(float(y[-1] * self.range))
        first_period = int(np.argmin(np.abs(record.time - record.time[-1] / m)))
        return CurvePoint(
            parameter=float(y[-1] * self.range),
            z=self.unscaled(s, float(y[-1] * self.range)),
            s=s,
            tangent=tangent,
            amplitude=np.ptp(displacement, axis=0) / 2.0,
            peak_force=np.max(record.force[:, :, 0], axis=0, initial=0.0),
            friction_dissipation=float(np.sum(record.friction_dissipation[-1])),
            multipliers=multipliers,
            verdict=verdict,
            free_sliders=free,
            states=state_bits(record, problem.contacts),
            residual=residual,
            marches=marches,
            extremes=extremes(record, problem.contacts),
            periods=m,
            alternation=(displacement[first_period] - displacement[-1]).ravel(),
            harmonics=harmonics(record, problem.model.load_histories, problem.period),
            period_states=states_over_period(record),
            damping_dissipation=float(record.energies[-1, DAMPING_DISSIPATION - WORK]),
        )

    def monodromy(self, point: CurvePoint) -> Array | None:
        """The monodromy matrix (N, N) of a point in scaled variables; None if the march fails."""
        found = self._evaluate(self.place(point), derive=True)
        return None if found is None else np.asarray(found[1])

    def place(self, point: CurvePoint) -> Array:
        """The unknowns y (N + 1,) of a point."""
        return np.append(point.s / self.size, point.parameter / self.range)

    def at_parameter(self, s: Array, value: float) -> CurvePoint | None:
        """The point at a value of the parameter near scaled variables s."""
        along = np.zeros(s.size + 1)
        along[-1] = 1.0
        return self.correct(np.append(s / self.size, value / self.range), along)

    def run(
        self,
        start: CurvePoint,
        direction: float | None,
        *,
        step: float = FIRST_STEP,
        largest_step: float = 0.05,
        smallest_step: float = 1e-6,
        points: int = 500,
        locate: bool = True,
        progress: Callable[[CurvePoint], None] | None = None,
        curve: Curve | None = None,
        largest_size: float = np.inf,
        earlier: Sequence[CurvePoint] = (),
    ) -> Curve:
        """Follow the curve.

        The size of the next step is in `step` when `progress` is called. An interrupted run
        continues bit for bit with it, with the points so far and with the `guess` of `shooting`.

        Args:
            start: its first point, or the last one of an interrupted run.
            direction: sign of the change of the parameter at the start; None follows the tangent of
                `start`.
            step: first step along the curve.
            largest_step: largest step.
            smallest_step: smallest step.
            points: largest number of points.
            locate: whether to locate bifurcations and contact events.
            progress: called with each point.
            curve: receives the points, after those that it has; the last of these is `start`.
            largest_size: of the scaled variables, at which the continuation ends.
            earlier: the points of an interrupted run before `start`.
        """
        tangent = start.tangent
        if direction is not None and not earlier:
            tangent = tangent * (np.sign(start.tangent[-1]) or 1.0) * np.sign(direction)
        curve = Curve([*earlier, start]) if curve is None else curve
        curve.reason = "interrupted"
        ys: list[Array] = []
        arcs: list[float] = []
        for point in _since_kink([*earlier, start]):
            self._extend(ys, arcs, point)
        while len(curve.points) < points:
            behind = replaced(curve.points[-1], tangent=tangent)
            guess = predict(ys, arcs, tangent, step)
            inside = self.low <= guess[-1] * self.range <= self.high
            found = self._next(behind, guess, step, smallest_step)
            if found is not None and not self.low <= found.parameter <= self.high:
                last = self._end(behind, found)
                special = self._special(behind, last, locate)
                if last is not None and special is not None:
                    curve.points.append(last)
                    curve.special.extend(special)
                curve.reason = "end of the range"
                return curve
            special = self._special(behind, found, locate)
            if found is None or (special is None and step > 4.0 * smallest_step):
                step *= 0.4
                if step < smallest_step:
                    curve.reason = "no convergence"
                    return curve
                continue
            if reason := self._arrival(curve, behind, found):
                curve.reason = reason
                return curve
            curve.special.extend(special or [])
            curve.points.append(found)
            if _kink(behind, found):
                ys.clear()
                arcs.clear()
            self._extend(ys, arcs, found)
            tangent = found.tangent
            marched, derived = found.marches
            effort = marched + derived
            step = min(largest_step, step * (1.5 if effort <= 4 else 1.0 if effort <= 6 else 0.6))
            if not inside:
                step = max(0.5 * step, smallest_step)
            self.step = step
            if progress is not None:
                progress(found)
            if float(np.linalg.norm(found.s)) > largest_size:
                curve.reason = "grown"
                return curve
        curve.reason = "number of points"
        return curve

    def _extend(self, ys: list[Array], arcs: list[float], point: CurvePoint) -> None:
        """Add a point to those through which the curve is extrapolated, which have no kink."""
        y = self.place(point)
        arcs.append(arcs[-1] + float(np.linalg.norm(y - ys[-1])) if ys else 0.0)
        ys.append(y)

    def _next(
        self, before: CurvePoint, guess: Array, step: float, smallest_step: float
    ) -> CurvePoint | None:
        """The point near a guess (N + 1,), or None to ask for a shorter step.

        A far correction or a sharp turn shows that the step was too long, unless the curve has a
        kink.
        """
        found = self.correct(guess, before.tangent)
        if found is None:
            return None
        way = self.place(found) - self.place(before)
        found = replaced(found, tangent=found.tangent * (np.sign(found.tangent @ way) or 1.0))
        away = float(np.linalg.norm(self.place(found) - guess))
        if _kink(before, found):
            too_long = away > KINK_AWAY * step
        else:
            too_long = away > AWAY * step or float(found.tangent @ before.tangent) < STRAIGHT
        return None if too_long and step > 4.0 * smallest_step else found

    def _end(self, inside: CurvePoint, outside: CurvePoint) -> CurvePoint | None:
        """The point on the bound of the range between two points, if it is found."""
        bound = self.high if outside.parameter > self.high else self.low
        share = (bound - inside.parameter) / (outside.parameter - inside.parameter)
        last = self.at_parameter(inside.s + share * (outside.s - inside.s), bound)
        if last is None:
            return None
        turn = float(np.sign(np.dot(last.tangent, inside.tangent))) or 1.0
        return replaced(last, tangent=turn * last.tangent)

    def _special(
        self, a: CurvePoint, b: CurvePoint | None, locate: bool
    ) -> list[CurvePoint] | None:
        """The special points between two points; None if one was not located."""
        return special_points(self, a, b) if locate and b is not None else []

    def _arrival(self, curve: Curve, before: CurvePoint, found: CurvePoint) -> str:
        """Why the curve ends between two points; its last point is then added. Else ""."""
        if len(curve.points) > 2 and self._passes(curve.points[:2], before, found):
            curve.points.append(curve.points[0])
            return "closed"
        here, there = before.alternation, found.alternation
        if found.periods > 1 and float(here @ there) < 0.0:
            bracket = change_of_sign(
                self, lambda point: float(here @ point.alternation), before, found
            )
            if bracket is not None:
                curve.points.append(bracket.nearest)
            return "end of the branch"
        return ""

    def _passes(self, home: list[CurvePoint], before: CurvePoint, found: CurvePoint) -> bool:
        """Whether the curve passes the first of two points in their direction."""
        first, last, y = self.place(before), self.place(found), self.place(home[0])
        chord, way = last - first, self.place(home[1]) - y
        length = float(np.linalg.norm(chord))
        share = float(chord @ (y - first)) / length**2
        if not 0.0 < share <= 1.0 or way @ chord < 0.5 * length * float(np.linalg.norm(way)):
            return False
        near = hermite(first, last, before.tangent, found.tangent, length, share)
        return float(np.linalg.norm(near - y)) < CLOSED * length


def _since_kink(points: list[CurvePoint]) -> list[CurvePoint]:
    """The last points of a curve without a kink between them."""
    kinks = [k for k, (a, b) in enumerate(pairwise(points), 1) if _kink(a, b)]
    return points[max(kinks, default=0) :]


def _kink(a: CurvePoint, b: CurvePoint) -> bool:
    """Whether the curve has a kink between two points: other contact states, other free sliders."""
    return bool(np.any(a.states != b.states)) or a.free_sliders != b.free_sliders


def follow(
    model: ReducedModel,
    contacts: Contacts,
    settings: Any,
    family: Family,
    start: PeriodicMotion,
    value: float,
    bounds: tuple[float, float],
    *,
    direction: float = 1.0,
    tolerance: float = CURVE_TOLERANCE,
    **options: Any,
) -> Curve:
    """Follow the periodic motions of a family from one of them.

    Args:
        model: the model at the start.
        contacts: parameters of the contact points at the start.
        settings: scheme, spectral radius and steps per period: a `fenicsrom.scene.Time`.
        family: problems by the parameter.
        start: a periodic motion.
        value: its parameter.
        bounds: range of the parameter.
        direction: sign of the first change of the parameter.
        tolerance: of the residual relative to the variables.
        options: of `Continuation.run`.
    """
    problem = family(value)
    m = round(start.period / problem.period)
    shooting = Shooting(problem.model, problem.contacts, settings, problem.period, m)
    s = shooting.scaled(start.z)
    path = Continuation(
        shooting, family, *bounds, size=float(np.linalg.norm(s)), tolerance=tolerance
    )
    first = path.at_parameter(s, value)
    if first is None:
        curve = Curve(reason="no convergence")
        return curve
    return path.run(first, direction, **options)
