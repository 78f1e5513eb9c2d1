"""Curves of periodic motions over a parameter, followed by `fenicsrom.online.curves.arc`.

The unknowns are the scaled variables s of `fenicsrom.online.periodic.shooting` and the parameter p.
`fenicsrom.online.curves.events` locates special points between two points, and
`fenicsrom.online.curves.events` finds unstable stretches that are shorter than a step.

Other curves from a curve of periodic motions: branches, and motions at larger loads.

At a period doubling the motion has a multiplier -1. A branch of motions of twice as many periods
starts along its eigenvector. At a branch point the eigenvector of the multiplier +1 leads to a
branch of motions of as many periods. The first point of a branch is sought on a hyperplane normal
to the eigenvector, at a distance from the curve (Seydel 2010, chapter 5).

An isolated branch is reached through the loads: the motion is followed over a factor on the loads,
at a fixed parameter and through all folds. Each time the factor passes 1 there is a motion of the
problem.

The peak of the forced response: the largest amplitude over the frequency, as the force grows.

A continuation in the frequency follows the curve around a motion, through folds if need be, until
the amplitude has fallen by 2 % on both sides: this is a local maximum. Golden sections narrow the
arc that holds the largest amplitude. A continuation in the force at the frequency of this peak
leads to the next force.
"""

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.curves import arc, events
from fenicsrom.online.curves import curve as curves
from fenicsrom.online.model.model import Problem
from fenicsrom.online.periodic.shooting import (
    Family,
    PeriodicMotion,
    Shooting,
    floquet,
    force_family,
    frequency_family,
    hold_sliders,
)
from fenicsrom.online.step.state import DAMPING_DISSIPATION, WORK

STRETCH = 12  # unstable points in a row: no test can see the motions that follow,
HASTE = 2.0  # so that the largest step is multiplied by this,
HURRIES = " for many points: longer steps, no search between them"  # and the progress says so


def hurries(curve: curves.Curve) -> bool:
    """Whether the last points of a curve are unstable, so that the next ones are worth less."""
    last = curve.points[-STRETCH:]
    return len(last) == STRETCH and not any(p.stable or p.verdict == curves.UNJUDGED for p in last)


class Continuation(arc.ArcLength):
    """The periodic motions of a family.

    In a long unstable stretch the steps are longer, and only folds and turns are sought, which give
    the curve its shape.
    """

    _hurries = False

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

    def values(self, s: Array, parameter: float, *, derive: bool) -> arc.Values | None:
        """P(s, p) - s and its derivatives; None if a step failed."""
        found = self.shooting.march(s, self.family(parameter), derive=derive)
        if found is None:
            return None
        residual, matrix, by_parameter, end = found
        if not derive:
            return arc.Values(residual, matrix, end)
        jacobian = np.column_stack([matrix - np.eye(s.size), by_parameter])
        return arc.Values(residual, jacobian, end)

    def problem_at(self, s: Array, parameter: float) -> Problem:
        """The data of a motion."""
        return self.family(parameter)

    def unscaled(self, s: Array, parameter: float) -> Array:
        """Variables z (N,) at the start of the period."""
        return self.shooting.unscaled(s)

    def point(self, place: arc.Place, evaluations: tuple[int, int]) -> curves.CurvePoint:
        """The motion of a solution; arguments as `ArcLength.point`."""
        s, parameter = self.variables(place.y)
        problem, record, m = self.problem_at(s, parameter), place.detail.record, self.shooting.m
        displacement = record.observed
        n = self.shooting.map.size
        values, vectors = np.linalg.eig(self._monodromy(place.jacobian)[:n, :n])
        multipliers, verdict = floquet(values, place.free)
        steps, period = self.shooting.map.fractions.size - 1, m * problem.period
        turning, turn_rates = events.turning_pairs(
            values, vectors, problem.model.size, self.shooting.omega, period, steps
        )
        z = self.unscaled(s, parameter)
        drift = np.linalg.norm(self.shooting.map.sliders(place.detail.z - z), axis=1)
        states, extremes = curves.occurrences(record, problem.contacts, drift)
        first_period = int(np.argmin(np.abs(record.time - record.time[-1] / m)))
        return curves.CurvePoint(
            parameter=parameter,
            z=z,
            s=s,
            tangent=np.append(*self.variables(place.tangent)),
            amplitude=np.ptp(displacement, axis=0) / 2.0,
            peak_force=np.max(record.force[:, :, 0], axis=0, initial=0.0),
            friction_dissipation=float(np.sum(record.friction_dissipation[-1])),
            states=states,
            residual=place.residual,
            marches=evaluations,
            extremes=extremes,
            periods=m,
            alternation=(displacement[first_period] - displacement[-1]).ravel(),
            harmonics=curves.harmonics(record, problem.model.load_histories, problem.period),
            period_states=curves.states_over_period(record, states),
            damping_dissipation=float(record.energies[-1, DAMPING_DISSIPATION - WORK]),
            multipliers=multipliers,
            verdict=verdict,
            free_sliders=place.free,
            turning=turning,
            turn_rates=turn_rates,
            period=period,
            probe_amplitude=curves.half_range(record.time, record.probe),
        )

    def _monodromy(self, jacobian: Array) -> Array:
        """The derivative (N, N) of P(s), given the Jacobian (N, N + 1) of P(s) - s."""
        return jacobian[:, :-1] + np.eye(len(jacobian))

    def monodromy(self, point: curves.CurvePoint) -> Array | None:
        """The monodromy matrix (N, N) of a point in scaled variables; None if the march fails."""
        found = self.values(point.s, point.parameter, derive=True)
        return None if found is None else self._monodromy(found.jacobian)

    def haste(self, curve: curves.Curve) -> float:
        """Factor on the largest step, which is longer where no test can see the motions."""
        self._hurries = hurries(curve)
        return HASTE if self._hurries else 1.0

    def between(
        self, before: curves.CurvePoint, found: curves.CurvePoint
    ) -> tuple[list[curves.CurvePoint], list[curves.CurvePoint]]:
        """Points that a step missed between two points, and the special points there."""
        guess = self.shooting.guess
        points, special = [before], []
        for last in [*events.unseen_points(self, before, found), found]:
            points += [*events.turned_points(self, points[-1], last), last]
        hurries = self._hurries and not found.stable
        contacts = None if hurries else self.shooting.problem.model.points.contact
        for first, last in pairwise(points):
            special.extend(events.special_points(self, first, last, contacts))
        self.shooting.guess = guess  # the curve goes on as if nothing had been sought
        return points[1:-1], special

    def arrival(
        self, curve: curves.Curve, before: curves.CurvePoint, found: curves.CurvePoint
    ) -> str:
        """Why the curve ends between two points; arguments as `ArcLength.arrival`."""
        here, there = before.alternation, found.alternation
        if found.periods > 1 and float(here @ there) < 0.0:
            bracket = events.change_of_sign(
                self, lambda point: float(here @ point.alternation), before, found
            )
            curve.points.append(bracket.nearest)
            return "end of the branch"
        return super().arrival(curve, before, found)


def follow(
    family: Family,
    start: PeriodicMotion | curves.CurvePoint,
    value: float,
    bounds: tuple[float, float],
    *,
    direction: float = 1.0,
    **options: Any,
) -> curves.Curve:
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
    return (
        curves.Curve(reason=curves.LOST) if first is None else path.run(first, direction, **options)
    )


SWITCH = (0.02, 0.05, 0.1)  # distances from the curve at which a branch is sought
APART = 0.1  # of this distance: a motion that is nearer to the curve does not lie on a branch
SAME = 1e-5  # relative distance below which two motions are the same
LEAST_LOAD, LARGEST_LOAD = 0.01, 4.0  # factors on the loads through which other motions are sought
LOAD_POINTS = 1000  # largest number of points over the load


def branch(
    path: Continuation, point: curves.CurvePoint, shooting: Shooting, sense: float = 1.0
) -> tuple[Continuation, curves.CurvePoint] | None:
    """The first point of the branch that leaves a curve at a period doubling or branch point.

    Args:
        path: the continuation of the curve.
        point: the located bifurcation.
        shooting: the equation of the motions on the branch.
        sense: 1 or -1, the sense along the eigenvector.

    Returns:
        The continuation of the branch and its first point, whose tangent points away from the
        curve; None if no branch was found.
    """
    direction = _eigenvector(path, point)
    if direction is None:
        return None
    other = Continuation(shooting, path.family, path.low, path.high, point.s)
    along = other.direction(replace(point, tangent=np.append(sense * direction, 0.0)))
    for distance in SWITCH:
        start = other.correct(other.place(point) + distance * along, along, exact=True)
        if start is None or not path.low <= start.parameter <= path.high:
            continue
        same = path.at_parameter(point.s, start.parameter)
        apart = np.inf if same is None else curves.norm(other.place(same) - other.place(start))
        if apart > APART * distance:
            turn = float(np.sign(start.tangent @ along)) or 1.0
            return other, arc.oriented(start, turn * start.sense)
    return None


def _eigenvector(path: Continuation, point: curves.CurvePoint) -> Array | None:
    """The real eigenvector (N,) of the multiplier at -1 or 1; None if the march fails."""
    monodromy = path.monodromy(point)
    if monodromy is None:
        return None
    values, vectors = np.linalg.eig(monodromy)
    target = -1.0 if point.kind == "period doubling" else 1.0
    vector = vectors[:, int(np.argmin(np.abs(values - target)))]
    real = np.real(vector * np.exp(-1j * np.angle(vector[np.argmax(np.abs(vector))])))
    return np.asarray(real)


def motions_through_load(shooting: Shooting, problem: Problem, s: Array) -> list[curves.CurvePoint]:
    """The motions of a problem that are connected with one of them through the size of the loads.

    Args:
        shooting: the equation of the motion.
        problem: the problem.
        s: (N,) scaled variables of one motion.

    Returns:
        The points at which the factor on the loads is 1, without the start; empty if no periodic
        load exists, or if the motion was not found.
    """
    family = force_family(problem)
    if not np.any(family(1.0).varied.model.load_histories.sines.imag):
        return []
    found: list[curves.CurvePoint] = []
    for direction in (1.0, -1.0):
        path = Continuation(shooting, family, LEAST_LOAD, LARGEST_LOAD, s)
        start = path.at_parameter(s, 1.0)
        if start is None:
            return found
        curve = path.run(start, direction, points=LOAD_POINTS, locate=False)
        for _, _, near in curves.Curve(curve.points[1:]).crossings(1.0):
            point = path.at_parameter(near, 1.0)
            if point is not None and not any(_same(point, other) for other in [start, *found]):
                found.append(point)
        if curve.reason == "closed":
            break
    return found


def _same(a: curves.CurvePoint, b: curves.CurvePoint) -> bool:
    """Whether two motions at the same parameter are the same."""
    return float(np.linalg.norm(a.s - b.s)) < SAME * float(np.linalg.norm(b.s))


def passes_through(path: Continuation, curve: curves.Curve, point: curves.CurvePoint) -> bool:
    """Whether a curve passes a point, or ends there, within a part of its steps."""
    y = path.place(point)
    for a, b in pairwise(curve.points):
        first, chord = path.place(a), path.place(b) - path.place(a)
        length = float(np.linalg.norm(chord))
        if length == 0.0:
            continue
        share = min(max(float(chord @ (y - first)) / length**2, 0.0), 1.0)
        if np.linalg.norm(first + share * chord - y) < APART * length:
            return True
    return False


def lies_on(path: Continuation, curve: curves.Curve, point: curves.CurvePoint) -> bool:
    """Whether a motion belongs to a curve.

    The motions of the curve at the parameter of the point are computed and compared with it.
    """
    for _, _, near in curve.crossings(point.parameter):
        found = path.at_parameter(near, point.parameter)
        if found is not None and _same(found, point):
            return True
    return False


SMALL_FORCE = 1e-2  # part of the first force at which the motion is sought from rest
WINDOW = 2.0  # largest ratio of the frequencies at which a search ends and starts
POINTS = 400  # of a continuation
FALLEN = 0.98  # part of the largest amplitude at which its neighbourhood ends


@dataclass(frozen=True, eq=False)
class ForcedPeak:
    """The largest amplitude over the frequency.

    Attributes:
        value: factor on the loads, or another number over which peaks are followed.
        frequency: Hz.
        amplitude: m.
        point: the motion.
        ends: how the curve ended on both sides of the peak, the first end first: "fallen" where the
            amplitude had fallen enough, else as `Curve.reason`: a larger amplitude may lie beyond.
    """

    value: float
    frequency: float
    amplitude: float
    point: curves.CurvePoint
    ends: tuple[str, str]


class _Fallen(Exception):
    """The amplitude is far below the largest."""


def forced_peaks(
    problem: Problem,
    rest: tuple[Array, Array],
    frequency: float,
    factors: Sequence[float],
    amplitude: Callable[[curves.CurvePoint], float],
    displaced: NDArray[np.bool_] | None = None,
) -> Iterator[ForcedPeak]:
    """Find the peaks at ascending factors on the loads, each from the one before.

    Args:
        problem: of a reduced model; surfaces are where their approach ends.
        rest: coordinates (n,) and sliders (P, d) of the equilibrium.
        frequency: of small free motions, Hz.
        factors: on the loads that are not static.
        amplitude: of a motion, m.
        displaced: (s,) as in `fenicsrom.online.periodic.shooting.frequency_family`.

    Raises:
        ConvergenceError: a motion or a peak was not found; the error names the factor.
    """

    def at_force(factor: float) -> Family:
        return frequency_family(force_family(problem)(factor), displaced=displaced)

    before = SMALL_FORCE * factors[0]
    shooting = Shooting(at_force(before)(frequency))
    s = _small_motion(shooting, rest)
    for factor in factors:
        by_force = force_family(at_force(1.0)(frequency))
        s = _at_larger_force(shooting, by_force, s, before, factor)
        bounds = frequency / WINDOW, frequency * WINDOW
        path = Continuation(shooting, at_force(factor), *bounds, s)
        first = path.at_parameter(s, frequency)
        top, ends = (None, ()) if first is None else climb(path, first, amplitude)
        if top is None:
            early = [end for end in dict.fromkeys(ends) if end != "fallen"]
            reasons = " and ".join(early) or "no convergence"
            raise ConvergenceError(
                f"no largest amplitude of the forced motion was found between {path.low:.6g} and "
                f"{path.high:.6g} Hz with {factor:g} times the loads: the curve over the frequency "
                f"ended early ({reasons})"
            )
        s, frequency, before = top.s, top.parameter, factor
        yield ForcedPeak(factor, frequency, amplitude(top), top, (ends[0], ends[1]))


def _small_motion(shooting: Shooting, rest: tuple[Array, Array]) -> Array:
    """Scaled variables of the linear motion about the equilibrium.

    Raises:
        ConvergenceError: a step failed, or a mode without damping is in resonance.
    """
    q, sliders = rest
    zero = np.zeros_like(q)
    s = shooting.scaled(shooting.map.pack(q, zero, zero, sliders))
    found = shooting.march(s)
    if found is not None:
        residual, matrix, _, _ = found
        with contextlib.suppress(np.linalg.LinAlgError):
            jacobian = matrix - np.eye(s.size)
            hold_sliders(jacobian, shooting.sliders)
            return s + np.linalg.solve(jacobian, -residual)
    raise ConvergenceError("the forced motion under small loads was not found")


def _at_larger_force(
    shooting: Shooting, family: Family, s: Array, before: float, factor: float
) -> Array:
    """Scaled variables of the motion at a factor, from the motion at a smaller factor.

    Raises:
        ConvergenceError: the factor was not reached.
    """
    path = Continuation(shooting, family, before, factor, s)
    first = path.at_parameter(s, before)
    curve = curves.Curve(reason=curves.LOST)
    if first is not None:
        curve = path.run(first, 1.0, points=POINTS, locate=False)
    if curve.reason != curves.END:
        raise ConvergenceError(
            f"the forced motion was lost between {before:g} and {factor:g} times the loads: "
            f"{curve.reason}"
        )
    return np.asarray(curve.points[-1].s)


def climb(
    path: Continuation,
    start: curves.CurvePoint,
    height: Callable[[curves.CurvePoint], float],
    largest_step: float = arc.LARGEST_STEP,
) -> tuple[curves.CurvePoint | None, tuple[str, ...]]:
    """The point of the largest height on the curve through a point, and how both ends ended.

    The curve is followed in both directions until the height has fallen below `FALLEN` of the
    largest, so that a small dip does not end the search. Where an end of the curve is the highest,
    there is no such point.
    """
    points, heights, ends = [start], [height(start)], []
    for direction in (1.0, -1.0):

        def keep(point: curves.CurvePoint) -> None:
            points.append(point)
            heights.append(height(point))
            if heights[-1] < FALLEN * max(heights):
                raise _Fallen

        try:
            options: dict[str, Any] = {"largest_step": largest_step, "progress": keep}
            curve = path.run(start, direction, points=POINTS, locate=False, **options)
            ends.append(curve.reason)
        except _Fallen:
            ends.append("fallen")
        points.reverse()
        heights.reverse()
    ends.reverse()
    best = int(np.argmax(heights))
    if not 0 < best < len(points) - 1:
        return None, tuple(ends)
    return path.highest(points[best - 1 : best + 2], height), tuple(ends)
