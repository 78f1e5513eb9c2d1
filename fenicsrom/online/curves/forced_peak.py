"""The peak of the forced response: the largest amplitude over the frequency, as the force grows.

A continuation in the frequency follows the curve around a motion, through folds if need be, until
the amplitude has fallen by 2 % on both sides: this is a local maximum. Golden sections narrow the
arc that holds the largest amplitude. A continuation in the force at the frequency of this peak
leads to the next force.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.errors import ConvergenceError
from fenicsrom.online.curves.arc import LARGEST_STEP
from fenicsrom.online.curves.continuation import Continuation
from fenicsrom.online.curves.curve import END, LOST, Curve, CurvePoint
from fenicsrom.online.model.problem import Problem
from fenicsrom.online.periodic.families import Family, force_family, frequency_family
from fenicsrom.online.periodic.shooting import Shooting, hold_sliders

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
    point: CurvePoint
    ends: tuple[str, str]


class _Fallen(Exception):
    """The amplitude is far below the largest."""


def forced_peaks(
    problem: Problem,
    rest: tuple[Array, Array],
    frequency: float,
    factors: Sequence[float],
    amplitude: Callable[[CurvePoint], float],
    displaced: NDArray[np.bool_] | None = None,
) -> Iterator[ForcedPeak]:
    """Find the peaks at ascending factors on the loads, each from the one before.

    Args:
        problem: of a reduced model; surfaces are where their approach ends.
        rest: coordinates (n,) and sliders (P, d) of the equilibrium.
        frequency: of small free motions, Hz.
        factors: on the loads that are not static.
        amplitude: of a motion, m.
        displaced: (s,) as in `fenicsrom.online.periodic.families.frequency_family`.

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
    curve = Curve(reason=LOST)
    if first is not None:
        curve = path.run(first, 1.0, points=POINTS, locate=False)
    if curve.reason != END:
        raise ConvergenceError(
            f"the forced motion was lost between {before:g} and {factor:g} times the loads: "
            f"{curve.reason}"
        )
    return np.asarray(curve.points[-1].s)


def climb(
    path: Continuation,
    start: CurvePoint,
    height: Callable[[CurvePoint], float],
    largest_step: float = LARGEST_STEP,
) -> tuple[CurvePoint | None, tuple[str, ...]]:
    """The point of the largest height on the curve through a point, and how both ends ended.

    The curve is followed in both directions until the height has fallen below `FALLEN` of the
    largest, so that a small dip does not end the search. Where an end of the curve is the highest,
    there is no such point.
    """
    points, heights, ends = [start], [height(start)], []
    for direction in (1.0, -1.0):

        def keep(point: CurvePoint) -> None:
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
