"""Newton's corrections on a curve of periodic motions.

The unknowns are the scaled variables s of `online.periodic.shooting` and the parameter p. With
|(ds, dp)|^2 = |ds|^2 / size^2 + dp^2 / range^2 a point is corrected orthogonally to the tangent of
the curve (Keller 1977; Seydel 2010, chapter 4).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.curves.contact_events import occurrences
from fenicsrom.online.curves.curve import CurvePoint, norm
from fenicsrom.online.curves.curve_measures import harmonics, states_over_period
from fenicsrom.online.curves.turning_pairs import turning_pairs
from fenicsrom.online.periodic.families import Family, Problem
from fenicsrom.online.periodic.shooting import (
    RANK,
    Shooting,
    floquet,
    least_squares_step,
    stuck_points,
)
from fenicsrom.online.step.state import DAMPING_DISSIPATION, WORK

CURVE_TOLERANCE = 1e-8  # of the residual relative to the variables
CORRECTIONS = 8
LARGEST_CORRECTION = 0.5  # longer steps of Newton's method are not trusted
DERIVED_WITHIN = 1e-5  # how far from the point found its derivative may be taken
# A guess with a small residual may be far from the motion, if a multiplier is near 1: it is a point
# of the curve if Newton's method would move it by less than this.
GUESSED_WITHIN = 1e-7
ROUNDING = 1e-12  # relative residual that Newton's method reduces no further: rounding of a march
GOOD_RATE = 0.1  # a correction that reduces the residual less asks for a new derivative


class Corrector:
    """The points of one curve near given guesses.

    Attributes:
        may_grow: relative residual below which a correction may increase the residual.
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
            size: size of the scaled variables, to weigh them against the parameter.
            tolerance: tolerance of the residual relative to the variables.
        """
        self.shooting, self.family, self.tolerance = shooting, family, tolerance
        self.low, self.high, self.range = low, high, high - low
        self.size = size

    def _evaluate(self, y: Array, problem: Problem, *, derive: bool) -> Any:
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
            exact: whether the derivative is taken at the very point, after one correction or more
                unless the residual of the guess is rounding.
        """
        jacobian, last, marched, derived = None, np.inf, 0, 0
        monodromy, stuck = np.zeros((0, 0)), False
        within = 0.0 if exact else DERIVED_WITHIN
        for _ in range(CORRECTIONS):
            fresh = jacobian is None
            problem = self.family(float(y[-1] * self.range))
            found = self._evaluate(y, problem, derive=fresh)
            if found is None:
                return None
            marched, derived = marched + 1, derived + fresh
            residual, matrix, by_parameter, end = found
            relative = norm(residual) / max(norm(y[:-1]) * self.size, 1e-300)
            if relative > max(10.0 * last, self.may_grow, self.tolerance):
                return None
            if fresh:
                monodromy, stuck = matrix, len(stuck_points(end.record)) > 0
                jacobian = self._bordered(matrix, by_parameter, along)
            assert jacobian is not None
            enough = self.tolerance if marched > 1 else min(ROUNDING, self.tolerance) * exact
            is_point = relative <= enough
            if not is_point:
                step = self._solve(jacobian, np.concatenate([-residual / self.size, [0.0]]), stuck)
                length = norm(step)
                is_point = not exact and relative <= self.tolerance and length <= GUESSED_WITHIN
            if is_point:
                tangent, free = self._tangent(jacobian, stuck)
                marches = marched, derived
                return self._point(problem, y, tangent, monodromy, free, relative, end, marches)
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
                if norm(found) < 1.0 / RANK * max(norm(right), 1e-300):
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
            right = np.zeros(len(jacobian))
            right[-1] = 1.0
            found = self._solve(jacobian, right, stuck)
            return np.asarray(found / norm(found), dtype=np.float64), 0
        _, sigma, rows = np.linalg.svd(jacobian[:-1])
        count = 1 + int(np.sum(sigma <= RANK * sigma[0]))
        flat = rows[-count:]
        found = flat[:, -1] @ flat
        if norm(found) < RANK:  # a fold
            found = (flat @ jacobian[-1]) @ flat
        return np.asarray(found / norm(found), dtype=np.float64), count - 1

    def _point(
        self,
        problem: Problem,
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
        values, vectors = np.linalg.eig(monodromy)
        multipliers, verdict = floquet(values, free)
        s, parameter = y[:-1] * self.size, float(y[-1] * self.range)
        states, extremes = occurrences(record, problem.contacts)
        first_period = int(np.argmin(np.abs(record.time - record.time[-1] / m)))
        turning, turn_rates = turning_pairs(
            values,
            vectors,
            problem.model.size,
            self.shooting.omega,
            m * problem.period,
            self.shooting.map.fractions.size - 1,
        )
        return CurvePoint(
            parameter=parameter,
            z=self.unscaled(s, parameter),
            s=s,
            tangent=tangent,
            amplitude=np.ptp(displacement, axis=0) / 2.0,
            peak_force=np.max(record.force[:, :, 0], axis=0, initial=0.0),
            friction_dissipation=float(np.sum(record.friction_dissipation[-1])),
            multipliers=multipliers,
            verdict=verdict,
            free_sliders=free,
            states=states,
            residual=residual,
            marches=marches,
            extremes=extremes,
            periods=m,
            alternation=(displacement[first_period] - displacement[-1]).ravel(),
            harmonics=harmonics(record, problem.model.load_histories, problem.period),
            period_states=states_over_period(record, states),
            damping_dissipation=float(record.energies[-1, DAMPING_DISSIPATION - WORK]),
            turning=turning,
            turn_rates=turn_rates,
            period=m * problem.period,
        )

    def monodromy(self, point: CurvePoint) -> Array | None:
        """The monodromy matrix (N, N) of a point in scaled variables; None if the march fails."""
        found = self._evaluate(self.place(point), self.family(point.parameter), derive=True)
        return None if found is None else np.asarray(found[1])

    def place(self, point: CurvePoint) -> Array:
        """The unknowns y (N + 1,) of a point."""
        return np.concatenate([point.s / self.size, [point.parameter / self.range]])

    def at_parameter(self, s: Array, value: float) -> CurvePoint | None:
        """The point at a value of the parameter near scaled variables s."""
        along = np.zeros(s.size + 1)
        along[-1] = 1.0
        return self.correct(np.append(s / self.size, value / self.range), along, exact=True)
