"""The parts of a response curve beyond its first one: branches and isolated curves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.curves.continuation import (
    Continuation,
    branch,
    lies_on,
    motions_through_load,
    passes_through,
)
from fenicsrom.online.curves.curve import BACK, END, Curve, CurvePoint

SAME_START = 1e-6  # distance of the first points of one branch, followed twice, in parts of them
MOST_PERIODS = 64  # of the loads in one of a motion on a branch

PathOf = Callable[[CurvePoint, int], Continuation]
"""Makes a continuation of motions of so many periods, with the size of a motion."""


@dataclass(eq=False)
class Piece(Curve):
    """A connected part of a curve.

    Attributes:
        points: in their order along the curve.
        special: the located bifurcations and contact events.
        reason: why it ends: as in `fenicsrom.online.curves.curve.Curve`.
        origin: where it comes from: "march", or the kind and the parameter of the bifurcation at
            which it leaves another piece, or "isolated".
        periods: number of periods of the loads in one of the motion.
        direction: 1.0 of a piece that starts at the first value of the range, -1.0 of a piece that
            starts at the last value.
    """

    origin: str = "march"
    periods: int = 1
    direction: float = 1.0

    def in_order(self) -> list[CurvePoint]:
        """The points, with the special points where the curve passes them."""
        points = list(self.points)
        if not points:
            return points
        size = max(float(np.linalg.norm(point.s)) for point in points) or 1.0
        width = max(abs(points[-1].parameter - points[0].parameter), abs(points[0].parameter))

        def place(point: CurvePoint) -> Array:
            return np.append(point.s / size, point.parameter / width)

        for special in self.special:
            places = np.array([place(point) for point in points])
            ways = np.linalg.norm(places - place(special), axis=1)
            detours = ways[:-1] + ways[1:] - np.linalg.norm(np.diff(places, axis=0), axis=1)
            points.insert(int(np.argmin(detours)) + 1 if detours.size else 0, special)
        return points


class Follow(Protocol):
    """Follows a new part of a curve."""

    def __call__(
        self,
        path: Continuation,
        begin: CurvePoint,
        direction: float | None,
        origin: str,
        periods: int,
    ) -> None:
        """Add a part to the curve and follow it from its first point.

        Args:
            path: the continuation.
            begin: the first point.
            direction: as in `Continuation.run`.
            origin: as in `Piece`.
            periods: number of periods of the loads in one of the motion.
        """


def follow_branches(
    parts: list[Piece], path_of: PathOf, follow: Follow, name: str, generations: int
) -> None:
    """Follow the branches at the period doublings and branch points of a curve.

    Args:
        parts: the parts of the curve; `follow` adds to them.
        path_of: makes continuations.
        follow: follows a part.
        name: name of the parameter.
        generations: how often a branch is taken from a branch.
    """
    done = 0
    for _ in range(generations):
        fresh = parts[done:]
        done = len(parts)
        for part in fresh:
            for point in part.special:
                if point.kind in ("period doubling", "branch point"):
                    _follow_branch(parts, part, point, path_of, follow, name)


def _follow_branch(
    parts: list[Piece],
    part: Piece,
    point: CurvePoint,
    path_of: PathOf,
    follow: Follow,
    name: str,
) -> None:
    """Follow the branches at one point of a part, unless one of the parts is this branch.

    An interrupted run may have left one of two branches.
    """
    periods = part.periods * (2 if point.kind == "period doubling" else 1)
    if periods > MOST_PERIODS:
        return
    path = path_of(point, part.periods)
    origin = f"{point.kind} at {name} = {point.parameter:.7g}"
    kept = [other for other in parts if other.origin == origin]
    others = [
        other
        for other in parts
        if other is not part and other not in kept and other.periods == periods
    ]
    if any(passes_through(path, other, point) for other in others):
        return
    for sense in (1.0, -1.0):
        path = path_of(point, part.periods)
        found = branch(path, point, path_of(point, periods).shooting, sense)
        if found is None:
            continue
        new = next((other for other in kept if _begins_at(other, found[1])), None)
        if new is None:
            follow(*found, None, origin, periods)
            new = parts[-1]
        if not new.points[0].kind:
            new.points.insert(0, point)
        # the motions on both sides of a period doubling differ by a shift in time
        if point.kind == "period doubling" or new.reason == "closed":
            return


def _begins_at(part: Piece, begin: CurvePoint) -> bool:
    """Whether a branch has this point first, or next after its bifurcation."""
    size = SAME_START * float(np.linalg.norm(begin.s))
    return any(float(np.linalg.norm(point.s - begin.s)) <= size for point in part.points[:2])


def follow_isolated(
    parts: list[Piece],
    path_of: PathOf,
    follow: Follow,
    start: Callable[[float], CurvePoint],
    values: Sequence[float],
) -> None:
    """Follow curves that are connected with a curve through the size of the loads only.

    Args:
        parts: the parts of the curve; `follow` adds to them.
        path_of: makes continuations.
        follow: follows a part.
        start: finds a motion at a value of the parameter at which no part has a motion.
        values: values of the parameter at which motions are sought.

    Raises:
        ConvergenceError, AccuracyError: from `start`.
    """
    for value in values:
        known = _motion_at(parts, path_of, value) or start(value)
        path = path_of(known, 1)
        problem = path.family(value)
        for motion in motions_through_load(path.shooting, problem, path.shooting.scaled(known.z)):
            path = path_of(motion, 1)
            point = path.at_parameter(motion.s, value)
            same = [part for part in parts if part.periods == 1]
            if point is None or any(lies_on(path, part, point) for part in same):
                continue
            _follow_both(parts, path_of, follow, point)


def _motion_at(parts: list[Piece], path_of: PathOf, value: float) -> CurvePoint | None:
    """A motion of the parts at a value of the parameter, or None."""
    for part in parts:
        if part.periods == 1:
            for a, _, near in part.crossings(value):
                point = path_of(a, 1).at_parameter(near, value)
                if point is not None:
                    return point
    return None


def _follow_both(parts: list[Piece], path_of: PathOf, follow: Follow, point: CurvePoint) -> None:
    """Follow a part in both directions from a point, as one part."""
    follow(path_of(point, 1), point, 1.0, "isolated", 1)
    part = parts[-1]
    if part.reason == "closed":
        return
    follow(path_of(point, 1), point, -1.0, "isolated", 1)
    back = parts.pop()
    part.points[:0] = back.points[:0:-1]
    part.special[:0] = back.special[::-1]
    if part.reason in (END, BACK):
        part.reason = END if back.reason in (END, BACK) else back.reason
