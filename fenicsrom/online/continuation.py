"""Curves of periodic motions: pseudo-arclength continuation in a parameter.

The unknowns are the scaled variables s of `fenicsrom.online.periodic` and the parameter p. With
|(ds, dp)|^2 = |ds|^2 / size^2 + dp^2 / range^2 the curve is followed by a polynomial through its
last points and corrected orthogonally to its tangent (Keller 1977; Seydel 2010, chapter 4). The
first correction at a point takes the derivative there, the next ones keep it while they converge.
`fenicsrom.online.bifurcations` locates bifurcations between two points.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.bifurcations import locate
from fenicsrom.online.curve import Curve, CurvePoint, predict, replaced
from fenicsrom.online.curve_measures import harmonics, states_over_period
from fenicsrom.online.families import Family
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.periodic import (
    RANK,
    PeriodicMotion,
    Shooting,
    floquet,
    least_squares_step,
)
from fenicsrom.online.state import DAMPING_DISSIPATION, WORK
from fenicsrom.online.surfaces import Contacts

CURVE_TOLERANCE = 1e-8  # of the residual relative to the variables
CORRECTIONS = 8
GOOD_RATE = 0.1  # a correction that reduces the residual less asks for a new derivative


class Continuation:
    """One curve: `run` follows it from a periodic motion to the end of a range."""

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

    def correct(self, y: Array, along: Array) -> CurvePoint | None:
        """The point of the curve on the hyperplane through y normal to `along`; None if not found.

        Args:
            y: (N + 1,) s / size and p / range.
            along: (N + 1,) unit normal; a unit vector of p keeps the parameter.
        """
        jacobian, last, marched, derived = None, np.inf, 0, 0
        tangent_free = 0
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
            if fresh:
                n = residual.size
                monodromy = matrix
                jacobian = np.zeros((n + 1, n + 1))
                jacobian[:n, :n] = matrix - np.eye(n)
                jacobian[:n, n] = by_parameter * self.range / self.size
                jacobian[n] = along
                last = np.inf
            assert jacobian is not None
            if relative <= self.tolerance:
                tangent, tangent_free = self._solve(jacobian, np.append(np.zeros(y.size - 1), 1.0))
                return self._point(
                    y, tangent, monodromy, tangent_free, relative, end, (marched, derived)
                )
            if not fresh and relative > GOOD_RATE * last:
                if relative > 10.0 * last:
                    return None
                jacobian = None
                continue
            last = relative
            step, _ = self._solve(jacobian, np.append(-residual / self.size, 0.0))
            if np.linalg.norm(step) > 0.5:
                return None
            y = y + step
        return None

    def _solve(self, jacobian: Array, right: Array) -> tuple[Array, int]:
        """Solve the bordered system, by least squares where sliders are free."""
        try:
            found: Array = np.asarray(np.linalg.solve(jacobian, right), dtype=np.float64)
            if np.linalg.norm(found) < 1.0 / RANK * max(float(np.linalg.norm(right)), 1e-300):
                return found, 0
        except np.linalg.LinAlgError:
            pass
        return least_squares_step(jacobian, right)

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
        record = end.record
        displacement = record.displacement
        if displacement.shape[1] == 0:
            displacement = record.probe[:, None, :]
        multipliers, verdict = floquet(monodromy, free)
        bits = np.zeros(record.state.shape[1], dtype=np.int64)
        for bit, state in enumerate((-1, 0, 1)):
            bits |= np.any(record.state == state, axis=0).astype(np.int64) << bit
        s = y[:-1] * self.size
        problem = self.family(float(y[-1] * self.range))
        return CurvePoint(
            parameter=float(y[-1] * self.range),
            z=self.shooting.unscaled(s),
            s=s,
            tangent=tangent / np.linalg.norm(tangent),
            amplitude=np.ptp(displacement, axis=0) / 2.0,
            peak_force=np.max(record.force[:, :, 0], axis=0, initial=0.0),
            friction_dissipation=float(np.sum(record.friction_dissipation[-1])),
            multipliers=multipliers,
            verdict=verdict,
            free_sliders=free,
            states=bits,
            residual=residual,
            marches=marches,
            harmonics=harmonics(record, problem.model.load_histories, problem.period),
            period_states=states_over_period(record),
            damping_dissipation=float(record.energies[-1, DAMPING_DISSIPATION - WORK]),
        )

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
        direction: float,
        *,
        step: float = 0.01,
        largest_step: float = 0.05,
        smallest_step: float = 1e-6,
        points: int = 500,
        locate: bool = True,
        progress: Callable[[CurvePoint], None] | None = None,
        earlier: Sequence[CurvePoint] = (),
    ) -> Curve:
        """Follow the curve.

        The size of the next step is in `step` when `progress` is called. An interrupted run
        continues bit for bit with it, with the points so far and with the `guess` of `shooting`.

        Args:
            start: its first point, or the last one of an interrupted run.
            direction: sign of the change of the parameter at the start.
            step: first step along the curve.
            largest_step: largest step.
            smallest_step: smallest step.
            points: largest number of points.
            locate: whether to locate bifurcations.
            progress: called with each point.
            earlier: the points of an interrupted run before `start`.
        """
        tangent = start.tangent
        if not earlier:
            tangent = tangent * (np.sign(start.tangent[-1]) or 1.0) * np.sign(direction)
        curve = Curve([*earlier, start])
        ys, arcs = [self.place(point) for point in curve.points], [0.0]
        for behind, ahead in pairwise(ys):
            arcs.append(arcs[-1] + float(np.linalg.norm(ahead - behind)))
        tangents = [tangent]
        while len(curve.points) < points:
            guess = predict(ys, arcs, tangents[-1], step)
            inside = self.low <= guess[-1] * self.range <= self.high
            found = self._next(guess, tangents[-1], step, smallest_step)
            if found is None:
                step *= 0.4
                if step < smallest_step:
                    curve.reason = "no convergence"
                    return curve
                continue
            before = curve.points[-1]
            if not self.low <= found.parameter <= self.high:
                curve.points.extend(self._end(before, found))
                curve.reason = "end of the range"
                return curve
            if locate:
                curve.special.extend(self._locate(before, found, tangents[-1]))
            curve.points.append(found)
            arcs.append(arcs[-1] + float(np.linalg.norm(self.place(found) - ys[-1])))
            ys.append(self.place(found))
            tangents.append(found.tangent)
            marched, derived = found.marches
            effort = marched + derived
            step = min(largest_step, step * (1.5 if effort <= 3 else 1.0 if effort <= 6 else 0.6))
            if not inside:
                step = max(0.5 * step, smallest_step)
            self.step = step
            if progress is not None:
                progress(found)
        curve.reason = "number of points"
        return curve

    def _next(
        self, guess: Array, tangent: Array, step: float, smallest_step: float
    ) -> CurvePoint | None:
        """The point near a guess (N + 1,), or None to ask for a shorter step.

        A sharp turn or a far correction shows that the step was too long.
        """
        found = self.correct(guess, tangent)
        if found is None:
            return None
        turn = float(np.dot(found.tangent, tangent))
        away = float(np.linalg.norm(self.place(found) - guess))
        if (abs(turn) < 0.8 or away > 0.5 * step) and step > 4.0 * smallest_step:
            return None
        return replaced(found, tangent=found.tangent * (np.sign(turn) or 1.0))

    def _end(self, inside: CurvePoint, outside: CurvePoint) -> list[CurvePoint]:
        """The point on the bound of the range between two points, if it is found."""
        bound = self.high if outside.parameter > self.high else self.low
        share = (bound - inside.parameter) / (outside.parameter - inside.parameter)
        last = self.at_parameter(inside.s + share * (outside.s - inside.s), bound)
        return [] if last is None else [last]

    def _locate(self, a: CurvePoint, b: CurvePoint, tangent: Array) -> list[CurvePoint]:
        """The bifurcations between two points."""
        return locate(self, replaced(a, tangent=tangent), b)


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
