"""Curves of periodic motions: pseudo-arclength continuation in a parameter.

The curve is extrapolated by the cubic through its last two points with their tangents, and each
point is corrected by `online.curves.curve_correction`. `online.curves.bifurcations` locates
special points between two points, and `online.curves.turning_pairs` finds unstable stretches
that are shorter than a step.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.contact.surfaces import Contacts
from fenicsrom.online.curves.bifurcations import change_of_sign, special_points
from fenicsrom.online.curves.curve import END, LOST, Curve, CurvePoint, hermite, norm, replaced
from fenicsrom.online.curves.curve_correction import CURVE_TOLERANCE, Corrector
from fenicsrom.online.curves.turning_pairs import unseen_points
from fenicsrom.online.model.model import ReducedModel
from fenicsrom.online.periodic.families import Family
from fenicsrom.online.periodic.shooting import PeriodicMotion, Shooting

FIRST_STEP = 0.01  # along a curve, in parts of the range and of the size of the motion
AWAY, KINK_AWAY = 0.5, 2.0  # longest correction in parts of the step, on the curve and at a kink
STRAIGHT = 0.8  # least cosine of the angle between the tangents of two neighbours
REACH = 4.0  # longest step that the cubic predicts, in parts of the distance of its points
CLOSED = 0.02  # of a step: a curve that passes its first point so closely is closed


class Continuation(Corrector):
    """One curve: `run` follows it from a periodic motion to the end of a range.

    Attributes:
        step: size of the next step.
    """

    step = 0.0

    # Longer than 60 lines: one loop of predictor, corrector and step control, read downwards.
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
            largest_size: largest size of the scaled variables, at which the continuation ends.
            earlier: the points of an interrupted run before `start`.
        """
        tangent = start.tangent
        if direction is not None and not earlier:
            tangent = tangent * (np.sign(start.tangent[-1]) or 1.0) * np.sign(direction)
        curve = Curve([*earlier, start]) if curve is None else curve
        curve.reason = "interrupted"
        before = earlier[-1] if earlier else None
        while len(curve.points) < points:
            behind = replaced(curve.points[-1], tangent=tangent)
            guess = self._guess(before, behind, step)
            inside = self.low <= guess[-1] * self.range <= self.high
            found = self._next(behind, guess, step, smallest_step)
            ends = found is not None and not self.low <= found.parameter <= self.high
            if found is not None and ends:
                found = self._end(behind, found)
            unseen, special = self._special(behind, found, locate)
            if found is None or (special is None and step > 4.0 * smallest_step):
                step *= 0.4
                if step < smallest_step:
                    curve.reason = END if ends else LOST
                    return curve
                continue
            if not ends and (reason := self._arrival(curve, behind, found)):
                curve.reason = reason
                return curve
            curve.special.extend(special or [])
            curve.points.extend([*unseen, found])
            if ends:
                curve.reason = END
                return curve
            before, tangent = [behind, *unseen][-1], found.tangent
            marched, derived = found.marches
            effort = marched + derived
            step = min(largest_step, step * (1.5 if effort <= 4 else 1.0 if effort <= 6 else 0.6))
            if not inside:
                step = max(0.5 * step, smallest_step)
            self.step = step
            if progress is not None:
                progress(found)
            if norm(found.s) > largest_size:
                curve.reason = "grown"
                return curve
        curve.reason = "number of points"
        return curve

    def _guess(self, before: CurvePoint | None, here: CurvePoint, step: float) -> Array:
        """Guess the unknowns (N + 1,) a step beyond a point, if possible by the point before."""
        y = self.place(here)
        if before is None or _kink(before, here):
            return np.asarray(y + step * here.tangent)
        first = self.place(before)
        chord = y - first
        length, turn = norm(chord), np.sign(before.tangent @ chord) or 1.0
        share = 1.0 + min(step, REACH * length) / length
        return hermite(first, y, turn * before.tangent, here.tangent, length, share)

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
        away = norm(self.place(found) - guess)
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
    ) -> tuple[list[CurvePoint], list[CurvePoint] | None]:
        """Points in unstable stretches between two points, and the special points there.

        The special points are None if one was not located.
        """
        if b is None or not locate:
            return [], []
        guess = self.shooting.guess
        unseen, special = unseen_points(self, a, b), []
        if not unseen:  # the curve goes on as if nothing had been sought
            self.shooting.guess = guess
        for first, last in pairwise([a, *unseen, b]):
            located = special_points(self, first, last)
            if located is None:
                return unseen, None
            special.extend(located)
        return unseen, special

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
        length = norm(chord)
        share = float(chord @ (y - first)) / length**2
        if not 0.0 < share <= 1.0 or way @ chord < 0.5 * length * norm(way):
            return False
        near = hermite(first, last, before.tangent, found.tangent, length, share)
        return norm(near - y) < CLOSED * length


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
    """Follow the periodic motions of a family from one motion.

    Args:
        model: the model at the start.
        contacts: parameters of the contact points at the start.
        settings: scheme, spectral radius and steps per period: a `fenicsrom.scene.Time`.
        family: problems by the parameter.
        start: a periodic motion.
        value: its parameter.
        bounds: range of the parameter.
        direction: sign of the first change of the parameter.
        tolerance: tolerance of the residual relative to the variables.
        options: of `Continuation.run`.
    """
    problem = family(value)
    m = round(start.period / problem.period)
    shooting = Shooting(problem.model, problem.contacts, settings, problem.period, m)
    s = shooting.scaled(start.z)
    path = Continuation(shooting, family, *bounds, size=norm(s), tolerance=tolerance)
    first = path.at_parameter(s, value)
    if first is None:
        curve = Curve(reason=LOST)
        return curve
    return path.run(first, direction, **options)
