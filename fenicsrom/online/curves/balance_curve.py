"""Curves of periodic motions by harmonic balance over a parameter.

The unknowns are the coefficients of `fenicsrom.online.periodic.balance`. The curve is followed by
`fenicsrom.online.curves.arc`. Folds and changes of contact are located; the stability is not
judged, because it does not follow from the coefficients.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.curves import arc, events
from fenicsrom.online.curves.curve import (
    END,
    UNJUDGED,
    CurvePoint,
    half_range,
    harmonics,
    occurrences,
    states_over_period,
)
from fenicsrom.online.periodic.balance import Balance, Balanced
from fenicsrom.online.periodic.period_map import PeriodVariables
from fenicsrom.online.periodic.shooting import Family, force_family
from fenicsrom.online.step.state import DAMPING_DISSIPATION, WORK, scheme

DIFFERENCE = 1e-6
"""Step of the differences by the parameter, relative to it or, at zero, to the range."""

WEAK = 0.01  # factor on the loads at which a motion is sought from rest
LOAD_POINTS = 400  # largest number of points over this factor


class BalanceCurve(arc.ArcLength):
    """The motions of a family by harmonic balance."""

    def __init__(self, balance: Balance, family: Family, low: float, high: float, s: Array):
        """Keep the equations; arguments as `fenicsrom.online.curves.arc.ArcLength`."""
        super().__init__(low, high, s)
        self.balance, self.family = balance, family

    def values(self, s: Array, parameter: float, *, derive: bool) -> arc.Values | None:
        """The equations and their derivatives; None if they could not be evaluated."""
        balance = self.balance
        found = balance.at(self.family(parameter), s, derive=derive)
        if found is None:
            return None
        residual = balance.scaled(found.residual)
        jacobian: Array = np.zeros((0, 0))
        if derive:
            step = DIFFERENCE * (abs(parameter) or self.range)
            ends = [balance.near(self.family(parameter + way), s, found) for way in (step, -step)]
            if ends[0] is None or ends[1] is None:
                return None
            scale = np.tile(balance.scale, balance.shape[0])
            slope = balance.scaled(ends[0] - ends[1]) / (2.0 * step)
            jacobian = np.column_stack([scale[:, None] * found.slopes / scale, slope])
        return arc.Values(residual, jacobian, found)

    def point(self, place: arc.Place, evaluations: tuple[int, int]) -> CurvePoint:
        """The motion of a solution; its stability is not judged."""
        s, parameter = self.variables(place.y)
        found: Balanced = place.detail
        problem, record = found.problem, self.balance.record(found)
        model, settings = problem.model, problem.time
        moved = record.observed
        states, extremes = occurrences(record, problem.contacts)
        plan = scheme(settings.scheme, model, settings.spectral_radius or 0.8)
        q, v, a = np.split(record.coordinates[-1], 3)
        sliders = np.array([orbit.slider[-1] for orbit in found.orbits])
        z = PeriodVariables(model.size, problem.contacts, plan).pack(q, v, a, sliders)
        ranges = [half_range(record.time, moved[:, p]) for p in range(moved.shape[1])]
        return CurvePoint(
            parameter=parameter,
            z=z,
            s=s,
            tangent=np.append(*self.variables(place.tangent)),
            amplitude=np.array(ranges),
            peak_force=np.max(record.force[:, :, 0], axis=0, initial=0.0),
            friction_dissipation=float(np.sum(record.friction_dissipation[-1])),
            multipliers=np.zeros(0, complex),
            verdict=UNJUDGED,
            free_sliders=sum(orbit.free for orbit in found.orbits),
            states=states,
            residual=place.residual,
            marches=evaluations,
            extremes=extremes,
            harmonics=harmonics(record, model.load_histories, problem.period),
            period_states=states_over_period(record, states),
            damping_dissipation=float(record.energies[-1, DAMPING_DISSIPATION - WORK]),
            period=problem.period,
            probe_amplitude=half_range(record.time, record.probe),
        )

    def between(
        self, before: CurvePoint, found: CurvePoint
    ) -> tuple[list[CurvePoint], list[CurvePoint]]:
        """Points that hide two folds between two points; folds and changes of contact."""
        points = [before, *events.turned_points(self, before, found), found]
        contacts = self.family(before.parameter).model.points.contact
        special = [events.special_points(self, a, b, contacts) for a, b in pairwise(points)]
        return points[1:-1], [point for some in special for point in some]


def first_motion(path: BalanceCurve, s: Array, value: float) -> CurvePoint | None:
    """The motion at a value of the parameter; None if it was not found.

    Args:
        path: the curve.
        s: variables of the linear motion, near which it is sought; else it grows with the loads.
        value: of the parameter.
    """
    found: CurvePoint | None = path.at_parameter(s, value)
    if found is not None:
        return found
    by_force = BalanceCurve(path.balance, force_family(path.family(value)), WEAK, 1.0, WEAK * s)
    weak = by_force.at_parameter(WEAK * s, WEAK)
    if weak is None:
        return None
    grown = by_force.run(weak, 1.0, points=LOAD_POINTS, locate=False)
    found = path.at_parameter(grown.points[-1].s, value) if grown.reason == END else None
    return found
