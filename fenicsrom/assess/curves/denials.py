"""Verdicts on the stability that finer time steps deny.

A time step may make an instability: a pair of multipliers of a vibration that the step hardly
resolves leaves the unit circle. Such an instability moves along the curve with the step, so half
the step may have it at the same motion by chance, and a quarter does not. A verdict counts as known
where half and a quarter of the step agree with it.

Wherever a curve changes its stability, other than in a fold, the motions with finer steps are asked
on both sides, point after point, until all steps agree. The points passed on the way are denied:
their stability is not known. So is an instability whose motion finer steps do not find, and a
point between two denied ones. The bifurcation lies between the nearest points on which all steps
agree. It is left out where a whole stretch is denied, because then finer steps find no change
there.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

from fenicsrom.assess.curves.trust import FOLD, SAME_MOTION, Check, change, finer_motion
from fenicsrom.online.curves.curve import BIFURCATIONS, CurvePoint, Piece
from fenicsrom.online.curves.events import outside
from fenicsrom.online.periodic.shooting import Family, PeriodicMotion

FINER = 2, 4
"""How many times as many steps are asked, one after the other, while they agree with the point."""
NOT_FOUND = "not found"
"""Verdict of a finer step that has no motion near that of the step."""

Motion = CurvePoint | PeriodicMotion


class _Finer(NamedTuple):
    """What finer steps find at a point.

    Attributes:
        verdict: its own where all steps agree, else that of the first step that finds another
            stability, or `NOT_FOUND`.
        outside: number of multipliers outside of the unit circle; -1 if there is no motion.
    """

    verdict: str
    outside: int

    @property
    def is_unstable(self) -> bool:
        """Whether the motion was found, and is unstable."""
        return self.verdict not in ("stable", NOT_FOUND)


class Denials:
    """The verdicts of finer time steps on the points of a curve; each motion is computed once."""

    def __init__(self, family: Family, ask: Callable[[], None]):
        """Begin.

        Args:
            family: problems by the parameter.
            ask: called before each motion; it may raise KeyboardInterrupt.
        """
        self._family, self._ask = family, ask
        self._motions: dict[tuple[CurvePoint, int], Motion | None] = {}
        self._known: dict[CurvePoint, _Finer] = {}
        self._denied: dict[CurvePoint, CurvePoint] = {}

    def motion(self, point: CurvePoint, finer: int = 2) -> Motion | None:
        """The motion at a point with `finer` times as many steps; None if it was not found."""
        if (point, finer) not in self._motions:
            self._ask()
            self._motions[point, finer] = finer_motion(point, self._family, finer)
        return self._motions[point, finer]

    def _finer(self, point: CurvePoint) -> _Finer:
        """What finer steps find at a point.

        Next to a fold they may find another motion, which does not count.
        """
        if point not in self._known:
            found, near = _Finer(point.verdict, outside(point)), point
            for finer in FINER:
                motion = self.motion(near, finer)
                if motion is None:
                    found = _Finer(NOT_FOUND, -1)
                    break
                if change(point.amplitude, motion.amplitude) > SAME_MOTION:
                    break
                found = _Finer(motion.verdict, outside(motion))
                if motion.stable != point.stable:
                    break
                near = replace(point, z=motion.z)
            self._known[point] = found
        return self._known[point]

    def _denies(self, point: CurvePoint) -> bool:
        return not point.kind and point.stable == self._finer(point).is_unstable

    def apply(self, pieces: Sequence[Piece], checks: Sequence[Check] = ()) -> list[Check]:
        """Mark the denied points of some pieces, and leave denied bifurcations out.

        Args:
            pieces: the parts of the curve.
            checks: of its points; from those with contradictions, more points are asked.

        Returns:
            The checks with the marked points.
        """
        wrong = {check.point for check in checks if check.contradicted_by_step}
        for piece in pieces:
            self._apply(piece, [k for k, p in enumerate(piece.points) if p in wrong])
        return [
            replace(check, point=self._denied.get(check.point, check.point)) for check in checks
        ]

    def _apply(self, piece: Piece, seeds: list[int]) -> None:
        """As `apply`, for one piece and the numbers of the points with contradictions."""
        points, changes = piece.points, list(_changes(piece))
        for _, ends in changes:
            seeds += ends if points[ends[0]].stable != points[ends[1]].stable else ()
        denied = {k for seed in seeds for k in self._reached(points, seed)}
        denied |= {k + 1 for k in denied if k + 2 in denied}
        left_out, moved = set(), {}
        for event, ends in changes:
            between = [other for other, its in changes if its == ends]
            sides = self._sides(points, ends, denied, between)
            if sides is None:
                left_out.add(event)
            elif sides != ends:
                apart = max(abs(points[k].parameter - event.parameter) for k in sides)
                moved[event] = replace(
                    event, within=max(event.within, apart), denied=self._finer(event).verdict
                )
        piece.special = [
            moved.get(event, event) for event in piece.special if event not in left_out
        ]
        for k in denied:
            point, found = points[k], self._finer(points[k])
            points[k] = self._denied[point] = replace(point, denied=found.verdict)
            self._known[points[k]] = found
            self._motions[points[k], FINER[0]] = self.motion(point)

    def _reached(self, points: Sequence[CurvePoint], seed: int) -> Iterator[int]:
        """The numbers of the denied points around a point, up to where all steps agree."""
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
        stable, counts = [points[k].stable for k in ends], [outside(points[k]) for k in ends]
        if stable[0] == stable[1]:
            if counts[0] == counts[1]:  # a stretch between two neighbours, which all steps must see
                found = {self._finer(event).outside for event in between}
                sees = not found <= {-1, counts[0]}
            else:  # one more unstable multiplier
                sees = counts == [self._finer(points[k]).outside for k in ends]
            return ends if sees and denied.isdisjoint(ends) else None
        sides = []
        for way, k, mine in zip((-1, 1), ends, stable, strict=True):
            while 0 <= k < len(points) and k in denied and points[k].stable == mine:
                k += way
            if not 0 <= k < len(points) or points[k].stable != mine:
                return None
            sides.append(k)
        return sides[0], sides[1]


def _changes(piece: Piece) -> Iterator[tuple[CurvePoint, tuple[int, int]]]:
    """Each bifurcation of a piece but the folds, with the numbers of the points around it."""
    numbers, last = {point: k for k, point in enumerate(piece.points)}, 0
    for point in piece.in_order():
        last = numbers.get(point, last)
        own = point not in numbers and last + 1 < len(piece.points)
        if own and point.kind in BIFURCATIONS and point.kind != FOLD:
            yield point, (last, last + 1)
