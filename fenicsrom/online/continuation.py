"""Curves of periodic motions: pseudo-arclength continuation in a parameter.

The unknowns are the scaled variables s of `fenicsrom.online.periodic` and the parameter p. With
|(ds, dp)|^2 = |ds|^2 / size^2 + dp^2 / range^2 the curve is followed by a polynomial through its
last points and corrected orthogonally to its tangent (Keller 1977; Seydel 2010, chapter 4). The
first correction at a point takes the derivative there, the next ones keep it while they converge.

Where the tangent has no component along p the curve folds. Period doubling and torus bifurcations
are zeros of functions of the Floquet multipliers. All are located by the secant method, safeguarded
by bisection, on the curve itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.curve_measures import harmonics, states_over_period
from fenicsrom.online.load_histories import AMPLITUDE, OMEGA
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.period_map import no_drift
from fenicsrom.online.periodic import (
    RANK,
    PeriodicMotion,
    Shooting,
    floquet,
    least_squares_step,
)
from fenicsrom.online.state import DAMPING_DISSIPATION, WORK
from fenicsrom.online.step_sensitivity import Drift
from fenicsrom.online.surfaces import Contacts

CURVE_TOLERANCE = 1e-8  # of the residual relative to the variables
CORRECTIONS = 8
LOCATED = 1e-6  # of the range of the parameter: how closely bifurcations are located
GOOD_RATE = 0.1  # a correction that reduces the residual less asks for a new derivative
DEGREE = 3  # of the polynomial that predicts


class Problem(NamedTuple):
    """The data of a periodic motion at one value of the parameter.

    Attributes:
        model: the model.
        contacts: parameters of the contact points.
        period: of the loads, s.
        drift: derivatives of the data by the parameter.
    """

    model: ReducedModel
    contacts: Contacts
    period: float
    drift: Drift


Family = Callable[[float], Problem]


def frequency_family(
    model: ReducedModel, contacts: Contacts, period: float, *, spin: bool = False
) -> Family:
    """Problems by the excitation frequency in Hz: all sines keep their ratio to it.

    Args:
        model: the model.
        contacts: parameters of the contact points.
        period: of the loads that are given, s.
        spin: whether the surfaces turn in proportion to the frequency (an engine order).
    """

    def at(frequency: float) -> Problem:
        factor = frequency * period
        sines = model.load_histories.sines.copy()
        sines[:, OMEGA] *= factor
        nothing = no_drift(model, contacts)
        by_sines = nothing.sines.copy()
        by_sines[:, OMEGA] = sines[:, OMEGA] / frequency
        moved, by_contacts = contacts, nothing.contacts
        if spin:
            moved = contacts._replace(spin=contacts.spin * factor)
            by_contacts = by_contacts._replace(spin=contacts.spin * period)
        return Problem(
            model._replace(load_histories=model.load_histories._replace(sines=sines)),
            moved,
            1.0 / frequency,
            Drift(by_contacts, by_sines, 0.0, -1.0 / frequency),
        )

    return at


def force_family(
    model: ReducedModel, contacts: Contacts, period: float, load: int | None = None
) -> Family:
    """Problems by a factor on the amplitudes of one load, or of all."""
    spans = model.load_histories.spans
    chosen = np.zeros(model.load_histories.sines.shape[0], dtype=bool)
    for k in range(spans.shape[0]):
        if load is None or k == load:
            chosen[spans[k, 0] : spans[k, 1]] = True

    def at(factor: float) -> Problem:
        sines = model.load_histories.sines.copy()
        nothing = no_drift(model, contacts)
        by_sines = nothing.sines.copy()
        by_sines[chosen, AMPLITUDE] = sines[chosen, AMPLITUDE]
        sines[chosen, AMPLITUDE] *= factor
        return Problem(
            model._replace(load_histories=model.load_histories._replace(sines=sines)),
            contacts,
            period,
            nothing._replace(sines=by_sines),
        )

    return at


def contact_family(
    model: ReducedModel,
    contacts: Contacts,
    period: float,
    name: str,
    weights: Array | None = None,
) -> Family:
    """Problems by a number of the contacts: p times `weights`.

    Args:
        model: the model.
        contacts: parameters of the contact points.
        period: of the loads, s.
        name: "preload", "normal_stiffness", "tangential_stiffness", "friction", "spin", or "gap".
            The gap is added to the radius (subtracted outside of a surface) of the contacts given.
        weights: (P,) what one unit of p means at each point; 0 leaves a point as it is. 1 if not
            given.
    """
    weights = np.ones(contacts.preload.size) if weights is None else np.asarray(weights, float)

    def at(value: float) -> Problem:
        nothing = no_drift(model, contacts)
        if name == "gap":
            change = weights * contacts.side
            moved = contacts._replace(radius=contacts.radius + value * change)
            drift = nothing.contacts._replace(radius=change)
        else:
            given = getattr(contacts, name)
            chosen: dict[str, Any] = {name: np.where(weights != 0.0, value * weights, given)}
            moved = contacts._replace(**chosen)
            along: dict[str, Any] = {name: weights}
            drift = nothing.contacts._replace(**along)
        return Problem(model, moved, period, nothing._replace(contacts=drift))

    return at


def damping_family(model: ReducedModel, contacts: Contacts, period: float) -> Family:
    """Problems by the mass-proportional damping alpha in 1/s."""

    def at(value: float) -> Problem:
        nothing = no_drift(model, contacts)
        return Problem(
            model._replace(damping=float(value)), contacts, period, nothing._replace(damping=1.0)
        )

    return at


@dataclass(frozen=True, eq=False)
class CurvePoint:
    """A periodic motion on a curve.

    Attributes:
        parameter: p.
        z: (N,) variables at the start of the period.
        s: (N,) scaled variables.
        tangent: (N + 1,) unit tangent of the curve in (s / size, p / range).
        amplitude: (P, d) half of peak-to-peak of the contact displacement, or (1, d) of the probe
            without contact, m.
        peak_force: (P,) largest normal force, N.
        friction_dissipation: energy dissipated by friction in the period, J.
        multipliers: (N,) Floquet multipliers, the largest first.
        verdict: "stable", "fold", "period doubling" or "torus".
        free_sliders: number of slider components that are not unique.
        states: (P,) bits of the contact states that occur: 1 open, 2 slip, 4 stick.
        residual: relative.
        marches: number of marched periods it took, and of those with derivatives.
        kind: "" of an ordinary point, else the bifurcation located there.
        harmonics: (H, P, d) complex harmonics of the displacement, m, in phase with the load: see
            `fenicsrom.online.curve_measures.harmonics`.
        period_states: (phases, P) contact states over the period.
        damping_dissipation: energy dissipated by damping in the period, J.
    """

    parameter: float
    z: Array
    s: Array
    tangent: Array
    amplitude: Array
    peak_force: Array
    friction_dissipation: float
    multipliers: NDArray[np.complex128]
    verdict: str
    free_sliders: int
    states: Array
    residual: float
    marches: tuple[int, int]
    kind: str = ""
    harmonics: NDArray[np.complex128] = field(default_factory=lambda: np.zeros((0, 0, 0), complex))
    period_states: NDArray[np.int8] = field(default_factory=lambda: np.zeros((0, 0), np.int8))
    damping_dissipation: float = 0.0

    @property
    def stable(self) -> bool:
        """Whether the motion is stable."""
        return self.verdict == "stable"


@dataclass(eq=False)
class Curve:
    """Periodic motions along a parameter.

    Attributes:
        points: in the order in which they were found.
        special: located bifurcations.
        reason: why the continuation ended: "end of the range", "number of points" or
            "no convergence".
    """

    points: list[CurvePoint] = field(default_factory=list)
    special: list[CurvePoint] = field(default_factory=list)
    reason: str = ""


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
        histories = problem.model.load_histories
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
            harmonics=harmonics(record, histories, problem.period),
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
        before: Sequence[CurvePoint] = (),
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
            before: the points of an interrupted run before `start`.
        """
        curve = Curve([*before, start])
        tangent = start.tangent
        if not before:
            tangent = tangent * (np.sign(start.tangent[-1]) or 1.0) * np.sign(direction)
        ys, arcs = [self.place(point) for point in curve.points], [0.0]
        for behind, ahead in pairwise(ys):
            arcs.append(arcs[-1] + float(np.linalg.norm(ahead - behind)))
        tangents = [tangent]
        while len(curve.points) < points:
            guess = _predict(ys, arcs, tangents[-1], step)
            inside = self.low <= guess[-1] * self.range <= self.high
            found = self.correct(guess, tangents[-1])
            if found is not None:
                turn = float(np.dot(found.tangent, tangents[-1]))
                # a sharp turn or a far correction: the step was too long
                away = float(np.linalg.norm(self.place(found) - guess))
                if abs(turn) < 0.8 or away > 0.5 * step:
                    found = None if step > 4.0 * smallest_step else found
            if found is None:
                step *= 0.4
                if step < smallest_step:
                    curve.reason = "no convergence"
                    return curve
                continue
            tangent = found.tangent * (np.sign(np.dot(found.tangent, tangents[-1])) or 1.0)
            found = _with(found, tangent=tangent)
            before = curve.points[-1]
            if not self.low <= found.parameter <= self.high:
                bound = self.high if found.parameter > self.high else self.low
                share = (bound - before.parameter) / (found.parameter - before.parameter)
                last = self.at_parameter(before.s + share * (found.s - before.s), bound)
                if last is not None:
                    curve.points.append(last)
                curve.reason = "end of the range"
                return curve
            if locate:
                curve.special.extend(self._locate(before, found, tangents[-1]))
            curve.points.append(found)
            arcs.append(arcs[-1] + float(np.linalg.norm(self.place(found) - ys[-1])))
            ys.append(self.place(found))
            tangents.append(tangent)
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

    def _locate(self, a: CurvePoint, b: CurvePoint, tangent: Array) -> list[CurvePoint]:
        """The bifurcations between two points."""
        found = []
        for kind, test in TESTS.items():
            first, second = test(_with(a, tangent=tangent)), test(b)
            if np.isfinite(first) and np.isfinite(second) and first * second < 0.0:
                point = self._zero(test, a, b, tangent, first, second)
                if point is not None:
                    found.append(_with(point, kind=kind))
        return found

    def _zero(
        self,
        test: Callable[[CurvePoint], float],
        a: CurvePoint,
        b: CurvePoint,
        tangent: Array,
        first: float,
        second: float,
    ) -> CurvePoint | None:
        """Where a test function is zero between two points, by regula falsi (Illinois)."""
        ya, yb = self.place(a), self.place(b)
        ta, tb = tangent, b.tangent
        low, high, best = 0.0, 1.0, None
        chord = (yb - ya) / np.linalg.norm(yb - ya)
        length = float(np.linalg.norm(yb - ya))
        for _ in range(40):
            share = low + (high - low) * first / (first - second)
            guess = _hermite(ya, yb, ta, tb, length, share)
            point = self.correct(guess, chord)
            if point is None:
                return best
            sign = np.sign(np.dot(point.tangent, ta)) or 1.0
            point = _with(point, tangent=sign * point.tangent)
            value = test(point)
            close = best is not None and abs(point.parameter - best.parameter) <= (
                0.1 * LOCATED * self.range
            )
            best = point
            if close or value == 0.0 or (high - low) * length <= 0.1 * LOCATED:
                return best
            if value * second > 0.0:
                high, second = share, value
                first *= 0.5
            else:
                low, first = share, value
                second *= 0.5
        return best


def _with(point: CurvePoint, **changes: Any) -> CurvePoint:
    return CurvePoint(**(point.__dict__ | changes))


def _predict(ys: list[Array], arcs: list[float], tangent: Array, step: float) -> Array:
    """Extrapolate the last points to `step` beyond them, by a polynomial of `DEGREE` at most."""
    count = min(len(ys), DEGREE + 1)
    if count < 2:
        return np.asarray(ys[-1] + step * tangent)
    nodes, target = np.array(arcs[-count:]) - arcs[-1], step
    weights = [
        np.prod([(target - b) / (a - b) for j, b in enumerate(nodes) if j != i])
        for i, a in enumerate(nodes)
    ]
    return np.asarray(np.tensordot(weights, np.array(ys[-count:]), axes=1))


def _hermite(ya: Array, yb: Array, ta: Array, tb: Array, length: float, share: float) -> Array:
    """Cubic between two points with their tangents."""
    t = share
    return np.asarray(
        (1.0 + 2.0 * t) * (1.0 - t) ** 2 * ya
        + t * t * (3.0 - 2.0 * t) * yb
        + length * (t * (1.0 - t) ** 2 * ta + t * t * (t - 1.0) * tb)
    )


def _fold(point: CurvePoint) -> float:
    return float(point.tangent[-1])


def _period_doubling(point: CurvePoint) -> float:
    """The product of all multipliers plus one: it changes sign where a real one passes -1."""
    return float(np.prod(point.multipliers + 1.0).real)


def _torus(point: CurvePoint) -> float:
    """How far the largest complex pair is outside of the unit circle; NaN without one."""
    pairs = point.multipliers[point.multipliers.imag > 1e-9]
    return float(np.max(np.abs(pairs)) - 1.0) if pairs.size else np.nan


TESTS: dict[str, Callable[[CurvePoint], float]] = {
    "fold": _fold,
    "period doubling": _period_doubling,
    "torus": _torus,
}


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
