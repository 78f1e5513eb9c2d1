"""A response curve by harmonic balance, with as many harmonics as its accuracy asks for.

The curve is followed with a few harmonics. At its largest amplitude and at both ends, the motion is
found again with half as many harmonics more and twice the instants, on the plane normal to the
curve. While amplitude or parameter change by more than the accuracy, the curve is followed again
with so many harmonics.

The stability of a body comes from one period of its time steps with derivatives, at some points. A
point between two of them takes their verdict if they agree; otherwise one more point between them
is judged. The stability of a wave of a disk is not judged.
"""

from dataclasses import replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.assess.curves.pieces import CurveWalk
from fenicsrom.assess.curves.response_problem import family_of, shooting_of
from fenicsrom.assess.curves.results import Reduced, ResponseCurve, response_table
from fenicsrom.assess.curves.trust import SAME_MOTION, SHARE, Check, RicherModel, change, selected
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind
from fenicsrom.notes import AMPLITUDES
from fenicsrom.online.curves.balance_curve import BalanceCurve, first_motion
from fenicsrom.online.curves.curve import UNJUDGED, CurvePoint, Piece
from fenicsrom.online.model.disk_model import lag_of
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic.balance import Balance
from fenicsrom.online.periodic.shooting import (
    Family,
    PeriodicMotion,
    floquet,
    hold_sliders,
    motion_of,
)
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.store.disk import StoredDisk
from fenicsrom.progress import working_time

FIRST, MOST = 7, 134  # harmonics with which a curve is followed first, and at most


def balance_of(stored: Reduced, family: Family, harmonics: int, finer: int = 1) -> Balance:
    """The equations of the motions of a model with so many harmonics."""
    problem = family(response_table(stored.scene).high)
    if isinstance(stored, StoredDisk):
        scene = stored.scene
        lag, ratios = lag_of(scene), scene.damping.modal
        return Balance(problem, harmonics, stored.sector, lag, finer, ratios)
    return Balance(problem, harmonics, finer=finer)


def balance_at(stored: Reduced, family: Family, point: CurvePoint) -> Balance:
    """The equations of the motions of a model with the harmonics of a point."""
    rows = balance_of(stored, family, 0).shape[1]
    return balance_of(stored, family, (point.s.size // rows - 1) // 2)


def more(harmonics: int) -> int:
    """Half as many harmonics again."""
    return harmonics + (harmonics + 1) // 2


def balanced_motion(stored: Reduced, point: CurvePoint) -> Motion:
    """A period of the motion at a point of a curve of a model.

    Raises:
        ConvergenceError: its forces were not found.
    """
    family = family_of(stored)
    balance, problem = balance_at(stored, family, point), family(point.parameter)
    found = balance.at(problem, point.s, derive=False)
    if found is None:
        raise ConvergenceError("the periodic motion was lost when it was recorded")
    return motion_of(balance.record(found), problem.period)


class BalanceWalk(CurveWalk):
    """Follows one curve by harmonic balance."""

    @cached_property
    def _balance(self) -> Balance:
        """The equations with the harmonics of the points of the curve, or with the first ones."""
        if self.curve.points:
            return balance_at(self.stored, self.family, self.curve.points[0])
        return balance_of(self.stored, self.family, FIRST)

    def path(self, motion: CurvePoint | PeriodicMotion, periods: int = 1) -> BalanceCurve:  # type: ignore[override]
        """The continuation of motions with the harmonics of a motion."""
        assert isinstance(motion, CurvePoint)
        return self._path(self._balance, motion.s)

    def _path(self, balance: Balance, s: Array) -> BalanceCurve:
        return BalanceCurve(balance, self.family, self.table.low, self.table.high, s)

    def first(self, value: float) -> CurvePoint | None:
        """The motion at a value of the parameter: from the linear one, or from small loads.

        Raises:
            ConvergenceError: it was not found.
        """
        self(f"start at {self.place(value)} with {self._balance.harmonics} harmonics")
        return self._found(value)

    def _found(self, value: float) -> CurvePoint | None:
        """As `first`, untold."""
        problem, lost = self.family(value), f"response: at {self.place(value)} no motion was found"
        s = self._balance.linear(problem)
        if s is None:
            text = f"{lost}: a mode without damping is in resonance"
            raise ConvergenceError(text, kind=ErrorKind.CONVERGENCE)
        found = first_motion(self._path(self._balance, s), s, value)
        if found is None:
            text = f"{lost}: begin where the motion is smaller (response.first, response.last)"
            text += ", or press together contacts that are open at rest (preload)"
            raise ConvergenceError(text, kind=ErrorKind.CONVERGENCE)
        return found

    def compute(self, richer: RicherModel | None) -> None:
        """Compute the curve, from where it stands, and estimate its errors.

        Args:
            richer: a model with a richer basis under the scene of the curve, or None.

        Raises:
            ConvergenceError: no motion was found at either end of the range.
            AccuracyError: the accuracy needs more harmonics than `MOST`.
        """
        begin, curve, spent = working_time(), self.curve, np.zeros(2, int)
        try:
            while True:
                self._ends()
                points = curve.points + curve.special
                spent += np.sum([point.marches for point in points], axis=0, dtype=int)
                curve.harmonics = self._balance.harmonics
                finer = more(curve.harmonics)
                self(f"checking {curve.harmonics} harmonics with {finer}")
                errors = [self._error(point) for _, point in selected(curve.pieces)]
                known = [np.inf if error is None else error for error in errors]
                if max(known) <= self.table.accuracy:
                    break
                if finer > MOST:
                    text = f"{finer} instead of {curve.harmonics} harmonics change amplitudes by "
                    text += f"{max(known):.2g}, more than response.accuracy"
                    if np.isinf(max(known)):
                        text = f"a motion with {finer} harmonics was not found"
                    raise AccuracyError(f"response: {text}", quantity=AMPLITUDES)
                self._balance = balance_of(self.stored, self.family, finer)
                curve.pieces = []
            for piece in curve.pieces if isinstance(self.stored, StoredModel) else ():
                self._judge(piece)
            others = [self._richer(p, richer) for _, p in selected(curve.pieces)]
            pairs = zip(selected(curve.pieces), errors, others, strict=True)
            curve.checks = [
                Check(
                    point,
                    where,
                    "amplitude",
                    step_error=error,
                    basis_error=other,
                    compared=richer is not None,
                    richer_verdict=None if other is None else UNJUDGED,
                )
                for (where, point), error, other in pairs
            ]
        finally:
            curve.marches = int(spent[0]), int(spent[1])
            curve.seconds += working_time() - begin

    def _error(self, point: CurvePoint) -> float | None:
        """Relative change of amplitude or parameter by more harmonics; None if not found."""
        self()
        finer = balance_of(self.stored, self.family, more(self._balance.harmonics), 2)
        s, tangent = (
            finer.from_other(self._balance, part) for part in (point.s, point.tangent[:-1])
        )
        path = self._path(finer, s)
        start = replace(point, s=s, tangent=np.append(tangent, point.tangent[-1]))
        found = path.correct(path.place(start), path.direction(start))
        if found is None:
            return None
        moved = abs(found.parameter - point.parameter) / (abs(point.parameter) or 1.0)
        return max(change(point.amplitude, found.amplitude), moved)

    def _richer(self, point: CurvePoint, richer: RicherModel | None) -> float | None:
        """Relative change of an amplitude by a richer basis; None without it."""
        if richer is None:
            return None
        self()
        family, other = family_of(richer.stored), self._balance
        if not richer.transfer.size:
            return self._richer_wave(point, richer)
        found = other.at(self.family(point.parameter), point.s, derive=False)
        if found is None:
            return None
        balance = balance_of(richer.stored, family, other.harmonics)
        s = balance.scaled(other.coordinates(found) @ richer.transfer.T @ balance.rows.T)
        path = BalanceCurve(balance, family, self.table.low, self.table.high, s)
        near = path.at_parameter(s, point.parameter)
        return None if near is None else change(point.amplitude, near.amplitude)

    def _richer_wave(self, point: CurvePoint, richer: RicherModel) -> float | None:
        """As `_richer`, of a disk: the coordinates of its larger sector are not known."""
        walk = BalanceWalk(richer.stored, ResponseCurve(None))
        walk._balance = balance_of(richer.stored, walk.family, self._balance.harmonics)
        try:
            near = walk._found(point.parameter)
        except ConvergenceError:
            return None
        moved = None if near is None else change(point.amplitude, near.amplitude)
        return None if moved is None or moved > SAME_MOTION else moved

    def _judge(self, piece: Piece) -> None:
        """Judge the stability of some points of a piece, and give that of the points between."""
        points = piece.points
        wanted = {*range(0, len(points), SHARE), len(points) - 1}
        wanted.add(int(np.argmax([float(point.amplitude.max()) for point in points])))
        ends = sorted(wanted)
        for k in ends:
            points[k] = self._judged(points[k])
        pairs = list(pairwise(ends))
        while pairs:
            a, b = pairs.pop()
            if b - a < 2:
                continue
            if points[a].verdict == points[b].verdict:
                for k in range(a + 1, b):
                    points[k] = replace(points[k], verdict=points[a].verdict)
                continue
            middle = (a + b) // 2
            points[middle] = self._judged(points[middle])
            pairs += [(a, middle), (middle, b)]

    def _judged(self, point: CurvePoint) -> CurvePoint:
        """A point with its multipliers; as it is if a step of the period fails."""
        self()
        shooting = shooting_of(self.stored, self.family)
        found = shooting.march(shooting.scaled(point.z), self.family(point.parameter))
        if found is None:
            return point
        free = hold_sliders(found[1] - np.eye(len(found[1])), shooting.sliders)
        multipliers, verdict = floquet(np.linalg.eigvals(found[1]), free)
        return replace(point, multipliers=multipliers, verdict=verdict, free_sliders=free)
