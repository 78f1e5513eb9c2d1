"""Curves of periodic motions over a parameter, followed by `fenicsrom.online.curves.arc`.

The unknowns are the scaled variables s of `fenicsrom.online.periodic.shooting` and the parameter p.
`fenicsrom.online.curves.bifurcations` locates special points between two points, and
`fenicsrom.online.curves.turning_pairs` finds unstable stretches that are shorter than a step.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.curves.arc import ArcLength, Place, Values
from fenicsrom.online.curves.bifurcations import change_of_sign, special_points, turned_points
from fenicsrom.online.curves.contact_events import occurrences
from fenicsrom.online.curves.crest import half_range
from fenicsrom.online.curves.curve import LOST, Curve, CurvePoint
from fenicsrom.online.curves.curve_measures import harmonics, states_over_period
from fenicsrom.online.curves.turning_pairs import turning_pairs, unseen_points
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.periodic.families import Family
from fenicsrom.online.periodic.shooting import PeriodicMotion, Shooting, floquet
from fenicsrom.online.step.state import DAMPING_DISSIPATION, WORK


class Continuation(ArcLength):
    """The periodic motions of a family."""

    def __init__(self, shooting: Shooting, family: Family, low: float, high: float, s: Array):
        """Keep the problem.

        Args:
            shooting: the equation of the periodic motion.
            family: problems by the parameter.
            low: where the range of the parameter starts.
            high: where it ends.
            s: (N,) scaled variables of the first motion, whose size is weighed against the range.
        """
        weights = np.eye(s.size)
        weights[: shooting.map.size, : shooting.map.size] = shooting.weights
        super().__init__(low, high, s, weights)
        self.shooting, self.family = shooting, family
        self.sliders = shooting.sliders

    def values(self, s: Array, parameter: float, *, derive: bool) -> Values | None:
        """P(s, p) - s and its derivatives; None if a step failed."""
        found = self.shooting.march(s, self.family(parameter), derive=derive)
        if found is None:
            return None
        residual, matrix, by_parameter, end = found
        if not derive:
            return Values(residual, matrix, end)
        jacobian = np.column_stack([matrix - np.eye(s.size), by_parameter])
        return Values(residual, jacobian, end)

    def problem_at(self, s: Array, parameter: float) -> Problem:
        """The data of a motion."""
        return self.family(parameter)

    def unscaled(self, s: Array, parameter: float) -> Array:
        """Variables z (N,) at the start of the period."""
        return self.shooting.unscaled(s)

    def point(self, place: Place, evaluations: tuple[int, int]) -> CurvePoint:
        """The motion of a solution; arguments as `ArcLength.point`."""
        s, parameter = self.variables(place.y)
        problem, record, m = self.problem_at(s, parameter), place.detail.record, self.shooting.m
        displacement = record.displacement
        if displacement.shape[1] == 0:
            displacement = record.probe[:, None, :]
        n = self.shooting.map.size
        values, vectors = np.linalg.eig(self._monodromy(place.jacobian)[:n, :n])
        multipliers, verdict = floquet(values, place.free)
        z = self.unscaled(s, parameter)
        drift = np.linalg.norm(self.shooting.map.sliders(place.detail.z - z), axis=1)
        states, extremes = occurrences(record, problem.contacts, drift)
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
            z=z,
            s=s,
            tangent=np.append(*self.variables(place.tangent)),
            amplitude=np.ptp(displacement, axis=0) / 2.0,
            peak_force=np.max(record.force[:, :, 0], axis=0, initial=0.0),
            friction_dissipation=float(np.sum(record.friction_dissipation[-1])),
            multipliers=multipliers,
            verdict=verdict,
            free_sliders=place.free,
            states=states,
            residual=place.residual,
            marches=evaluations,
            extremes=extremes,
            periods=m,
            alternation=(displacement[first_period] - displacement[-1]).ravel(),
            harmonics=harmonics(record, problem.model.load_histories, problem.period),
            period_states=states_over_period(record, states),
            damping_dissipation=float(record.energies[-1, DAMPING_DISSIPATION - WORK]),
            turning=turning,
            turn_rates=turn_rates,
            period=m * problem.period,
            probe_amplitude=half_range(record.time, record.probe),
        )

    def _monodromy(self, jacobian: Array) -> Array:
        """The derivative (N, N) of P by s, from that (N, N + 1) of the equations."""
        return jacobian[:, :-1] + np.eye(len(jacobian))

    def monodromy(self, point: CurvePoint) -> Array | None:
        """The monodromy matrix (N, N) of a point in scaled variables; None if the march fails."""
        found = self.values(point.s, point.parameter, derive=True)
        return None if found is None else self._monodromy(found.jacobian)

    def between(
        self, before: CurvePoint, found: CurvePoint
    ) -> tuple[list[CurvePoint], list[CurvePoint]]:
        """Points that a step missed between two points, and the special points there."""
        guess = self.shooting.guess
        points, special = [before], []
        for last in [*unseen_points(self, before, found), found]:
            points += [*turned_points(self, points[-1], last), last]
        contacts = self.shooting.problem.model.points.contact
        for first, last in pairwise(points):
            special.extend(special_points(self, first, last, contacts))
        self.shooting.guess = guess  # the curve goes on as if nothing had been sought
        return points[1:-1], special

    def arrival(self, curve: Curve, before: CurvePoint, found: CurvePoint) -> str:
        """Why the curve ends between two points; arguments as `ArcLength.arrival`."""
        here, there = before.alternation, found.alternation
        if found.periods > 1 and float(here @ there) < 0.0:
            bracket = change_of_sign(
                self, lambda point: float(here @ point.alternation), before, found
            )
            curve.points.append(bracket.nearest)
            return "end of the branch"
        return super().arrival(curve, before, found)


def follow(
    family: Family,
    start: PeriodicMotion | CurvePoint,
    value: float,
    bounds: tuple[float, float],
    *,
    direction: float = 1.0,
    **options: Any,
) -> Curve:
    """Follow the periodic motions of a family from one motion.

    Args:
        family: problems by the parameter.
        start: a periodic motion.
        value: its parameter.
        bounds: range of the parameter.
        direction: sign of the first change of the parameter.
        options: of `Continuation.run`.
    """
    problem = family(value)
    m = round(start.period / problem.period)
    shooting = Shooting(problem, m)
    s = shooting.scaled(start.z)
    path = Continuation(shooting, family, *bounds, s)
    first = path.at_parameter(s, value)
    return Curve(reason=LOST) if first is None else path.run(first, direction, **options)
