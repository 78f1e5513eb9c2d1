"""Verdicts on the stability that half the time step denies.

A time step may make an instability: a pair of multipliers of a vibration that the step hardly
resolves leaves the unit circle. So wherever a curve changes its stability, other than in a fold,
the motions with half the step are asked on both sides, point after point, until both steps agree.
The points passed on the way are denied: their stability is not known. So is an instability whose
motion half the step does not find. The bifurcation lies between
the nearest points on which both steps agree. It is left out where a whole stretch is denied,
because then half the step finds no change there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

from fenicsrom.assess.curves.branches import Piece
from fenicsrom.assess.curves.trust import FOLD, Check, change, finer_motion
from fenicsrom.online.curves.curve import BIFURCATIONS, CurvePoint
from fenicsrom.online.periodic.shooting import Family

SAME_MOTION = 0.2
"""Largest change of the amplitude by half the step: next to a fold, the motion that is found may be
another one."""
NOT_FOUND = "not found"
"""Verdict of half the step where it has no motion near that of the step."""


class Denials:
    """The verdicts of half the time step on the points of a curve, each asked once."""

    def __init__(self, family: Family, ask: Callable[[], None]):
        """Begin.

        Args:
            family: problems by the parameter.
            ask: called before each motion; it may raise KeyboardInterrupt.
        """
        self._family, self._ask = family, ask
        self._verdicts: dict[int, tuple[CurvePoint, str]] = {}

    def _finer(self, point: CurvePoint) -> str:
        """The verdict of half the step, or `NOT_FOUND`; that of the point if it finds another."""
        if id(point) not in self._verdicts:
            self._ask()
            found, verdict = finer_motion(point, self._family), NOT_FOUND
            if found is not None:
                is_same = change(point.amplitude, found.amplitude) <= SAME_MOTION
                verdict = found.verdict if is_same else point.verdict
            self._verdicts[id(point)] = point, verdict
        return self._verdicts[id(point)][1]

    def _is_unstable(self, point: CurvePoint) -> bool:
        """Whether half the step finds the motion, and finds it unstable."""
        return self._finer(point) not in ("stable", NOT_FOUND)

    def _denies(self, point: CurvePoint) -> bool:
        return not point.kind and point.stable == self._is_unstable(point)

    def apply(self, pieces: Sequence[Piece], checks: Sequence[Check] = ()) -> None:
        """Mark the denied points of some pieces, and leave denied bifurcations out.

        Args:
            pieces: the parts of the curve.
            checks: of its points; from those with contradictions, more points are asked.
        """
        wrong = {id(check.point) for check in checks if check.contradicted_by_step}
        for piece in pieces:
            self._apply(piece, [k for k, p in enumerate(piece.points) if id(p) in wrong])

    def _apply(self, piece: Piece, seeds: list[int]) -> None:
        """As `apply`, for one piece and the numbers of the points with contradictions."""
        points, changes = piece.points, list(_changes(piece))
        for _, ends in changes:
            seeds += ends if points[ends[0]].stable != points[ends[1]].stable else ()
        denied = {k for seed in seeds for k in self._reached(points, seed)}
        left_out, moved = set(), {}
        for event, ends in changes:
            between = [other for other, its in changes if its == ends]
            sides = self._sides(points, ends, denied, between)
            if sides is None:
                left_out.add(id(event))
            elif sides != ends:
                apart = max(abs(points[k].parameter - event.parameter) for k in sides)
                moved[id(event)] = replace(
                    event, within=max(event.within, apart), denied=self._finer(event)
                )
        piece.special = [
            moved.get(id(event), event) for event in piece.special if id(event) not in left_out
        ]
        for k in denied:
            verdict = self._finer(points[k])
            points[k] = replace(points[k], denied=verdict)
            self._verdicts[id(points[k])] = points[k], verdict

    def _reached(self, points: Sequence[CurvePoint], seed: int) -> Iterator[int]:
        """The numbers of the denied points around a point, up to where both steps agree."""
        if not self._denies(points[seed]):
            return
        yield seed
        for way in (-1, 1):
            k = seed + way
            while 0 <= k < len(points) and self._denies(points[k]):
                yield k
                k += way

    def _sides(
        self,
        points: Sequence[CurvePoint],
        ends: tuple[int, int],
        denied: set[int],
        between: Sequence[CurvePoint],
    ) -> tuple[int, int] | None:
        """The nearest agreed points on both sides of a bifurcation; None if it is denied.

        Args:
            points: of the piece.
            ends: numbers of the points before and after the bifurcation.
            denied: numbers of the denied points.
            between: the bifurcations between the same points.
        """
        stable = [points[k].stable for k in ends]
        if stable[0] == stable[1]:  # a stretch between two neighbours, which both steps must see
            sees = any(self._is_unstable(event) == stable[0] for event in between)
            return ends if sees else None
        found = []
        for way, k, mine in zip((-1, 1), ends, stable, strict=True):
            while 0 <= k < len(points) and k in denied and points[k].stable == mine:
                k += way
            if not 0 <= k < len(points) or points[k].stable != mine:
                return None
            found.append(k)
        return found[0], found[1]


def _changes(piece: Piece) -> Iterator[tuple[CurvePoint, tuple[int, int]]]:
    """Each bifurcation of a piece but the folds, with the numbers of the points around it."""
    numbers, last = {id(point): k for k, point in enumerate(piece.points)}, 0
    for point in piece.in_order():
        last = numbers.get(id(point), last)
        own = id(point) not in numbers and last + 1 < len(piece.points)
        if own and point.kind in BIFURCATIONS and point.kind != FOLD:
            yield point, (last, last + 1)
