"""The pieces of a response curve, in the order in which they are followed, and their progress.

A curve starts at the first value of the range, where a few periods are marched and Newton's method
finds the periodic motion (`fenicsrom.online.periodic.shooting`). It is followed through its folds
to the last value (`fenicsrom.online.curves.continuation`). A curve that ends before is followed
from the last value too, so that both sides of a gap are known. Branches and isolated curves come
last.
"""

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fenicsrom.assess.curves.denials import Denials
from fenicsrom.assess.curves.peaks import Peaks
from fenicsrom.assess.curves.response_problem import family_of, shooting_of, start_motion
from fenicsrom.assess.curves.results import CurveFile, Reduced, ResponseCurve, response_table
from fenicsrom.assess.curves.trust import Richer, RicherModel, checks
from fenicsrom.assess.jobs import report
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.online.curves.arc import oriented
from fenicsrom.online.curves.continuation import (
    HURRIES,
    Continuation,
    branch,
    hurries,
    lies_on,
    motions_through_load,
    passes_through,
)
from fenicsrom.online.curves.curve import BACK, END, OUT_OF_POINTS, CurvePoint, Piece
from fenicsrom.online.periodic.shooting import PeriodicMotion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.progress import ask, duration, log, working_time
from fenicsrom.scene.reading.overrides import in_words
from fenicsrom.words import counted

REPORT_INTERVAL = 2.0  # shortest time between two lines of progress of a curve, s
NEARLY_ALL = 0.8  # part of the largest number of points at which the progress warns
KEEP_INTERVAL = 1.0  # shortest time between two writes of its file, s
KEEP_SHARE = 0.05  # most of the time that these writes may take
SAME_START = 1e-6  # distance of the first points of one branch, followed twice, in parts of them
MOST_PERIODS = 64  # of the loads in one of a motion on a branch


class CurveWalk:
    """Follows one curve, reports its progress, and keeps its points in a file.

    Attributes:
        stored: the model under the scene of the curve.
        table: the table [response] of this scene.
        family: the periodic problems by the parameter.
        curve: the curve, which grows.
    """

    def __init__(self, stored: Reduced, curve: ResponseCurve, file: CurveFile | None = None):
        """Begin at the points that the curve has; without a file, nothing is kept."""
        self.stored, self.curve, self._file = stored, curve, file
        self.table, self.family = response_table(stored.scene), family_of(stored)
        self._said = self._kept = clock.perf_counter()
        self._wait = KEEP_INTERVAL

    # ------------------------------------------------------------------ progress

    def __call__(self, line: str = "") -> None:
        """Ask whether to go on, and report a line."""
        ask()
        if line:
            report(self.fraction, line)

    def place(self, value: float) -> str:
        """A value of the parameter in words."""
        return in_words(self.stored.scene, self.table.parameter, value)

    @property
    def fraction(self) -> float:
        """The part of the range of the parameter that the curve covers, from both ends."""
        low, high = self.table.low, self.table.high
        covered = 0.0
        for piece in self.curve.pieces:
            values = [point.parameter for point in piece.points]
            if values and piece.origin == "march":
                covered += max(values) - low if piece.direction > 0.0 else high - min(values)
        return min(max(covered / (high - low), 0.0), 1.0)

    def passed(self) -> None:
        """Note that the last piece has a new point."""
        piece, now = self.curve.pieces[-1], clock.perf_counter()
        if now - self._kept > self._wait:
            self.save()
            self._kept = clock.perf_counter()
            self._wait = max(KEEP_INTERVAL, (self._kept - now) / KEEP_SHARE)
        line = ""
        if now - self._said > REPORT_INTERVAL:
            self._said, point = now, piece.points[-1]
            line = (
                f"{counted(len(self.curve.points), 'point')}, {self.place(point.parameter)}, "
                f"amplitude {1e3 * float(point.amplitude.max()):.4g} mm, "
                f"{_stability(point)}{HURRIES * hurries(piece)}"
            )
        most = self.table.points
        if len(piece.points) == int(NEARLY_ALL * most):
            line = f"{counted(len(piece.points), 'point')} of at most response.points = {most}"
        self(line)

    def save(self, done: bool = False) -> None:
        """Keep the curve in its file, but no interrupted branch, which is followed again.

        Args:
            done: whether the curve is complete.

        Raises:
            OSError: the file cannot be written.
        """
        if self._file is None:
            return
        pieces = [
            piece
            for piece in self.curve.pieces
            if piece.reason != "interrupted" or piece.origin == "march"
        ]
        self._file.save(replace(self.curve, pieces=pieces), done=done)

    # ------------------------------------------------------------------ pieces

    def path(self, motion: CurvePoint | PeriodicMotion, periods: int = 1) -> Continuation:
        """The continuation of motions of so many periods, measured by the size of a motion."""
        shooting = shooting_of(self.stored, self.family, periods)
        s = shooting.scaled(motion.z)
        return Continuation(shooting, self.family, self.table.low, self.table.high, s)

    def start(self, value: float) -> CurvePoint:
        """The motion at a value of the parameter, with a tangent to larger ones.

        Raises:
            ConvergenceError, AccuracyError: no motion was found; the error names the value.
        """
        begin = self.first(value)
        if begin is None:
            raise ConvergenceError(f"the motion at {self.place(value)} was lost")
        return oriented(begin, (float(np.sign(begin.tangent[-1])) or 1.0) * begin.sense)

    def first(self, value: float) -> CurvePoint | None:
        """The motion at a value of the parameter, with any tangent; errors as `start`."""
        self(f"start at {self.place(value)}: a march, then Newton's method")
        motion = start_motion(self.stored, self.family, value)
        path = self.path(motion)
        return path.at_parameter(path.shooting.scaled(motion.z), value)

    def from_end(self, value: float, direction: float) -> bool:
        """Follow the curve from an end of its range, or on from its last point.

        Args:
            value: of the parameter at the end.
            direction: sign of the change of the parameter.

        Returns:
            Whether the other end is reached, or the number of points.

        Raises:
            ConvergenceError, AccuracyError: no motion was found at the end.
        """
        pieces = self.curve.pieces
        piece = next((p for p in pieces if p.origin == "march" and p.direction == direction), None)
        if piece is None:
            begin = self.start(value)
            points = [oriented(begin, direction * begin.sense)]
            piece = Piece(points, reason="interrupted", direction=direction)
            pieces.append(piece)
            self.passed()
        if piece.reason == "interrupted":
            path = self.path(piece.points[0])
            self._run(path, piece, self.passed)
            _refine_largest(path, piece)
            self(f"{counted(len(piece.points), 'point')}, {piece.reason}")
        reached = abs(piece.points[-1].parameter - self.table.last) <= 1e-9 * self.table.high
        return reached or piece.reason == OUT_OF_POINTS

    def follow(
        self,
        path: Continuation,
        begin: CurvePoint,
        direction: float | None,
        origin: str,
        periods: int = 1,
    ) -> Piece:
        """A new part of the curve, followed from its first point.

        Args:
            path: the continuation.
            begin: the first point.
            direction: as in `Continuation.run`.
            origin: as in `Piece`.
            periods: number of periods of the loads in one of the motion.
        """
        piece = Piece([begin], reason="interrupted", origin=origin, periods=periods)
        self.curve.pieces.append(piece)
        self._run(path, piece, self, direction)
        self(f"{origin}: {counted(len(piece.points), 'point')}, {piece.reason}")
        return piece

    def _run(
        self,
        path: Continuation,
        piece: Piece,
        progress: Callable[[], None],
        direction: float | None = None,
    ) -> None:
        """Follow a piece from its last point."""
        last, points = piece.points[-1], self.table.points
        path.run(last, direction, curve=piece, points=points, progress=lambda point: progress())

    # ------------------------------------------------------------------ branches

    def branches(self) -> None:
        """Follow the branches at the period doublings and branch points of the curve."""
        done = 0
        for _ in range(self.table.branches):
            fresh = self.curve.pieces[done:]
            done += len(fresh)
            for piece in fresh:
                for point in piece.special:
                    if point.kind in ("period doubling", "branch point"):
                        self._branch(piece, point)

    def _branch(self, piece: Piece, point: CurvePoint) -> None:
        """Follow the branches at one point of a piece, unless one of the pieces is this branch.

        An interrupted run may have left one of two branches.
        """
        doubles = point.kind == "period doubling"
        periods = piece.periods * (2 if doubles else 1)
        if periods > MOST_PERIODS:
            return
        path = self.path(point, piece.periods)
        origin = f"{point.kind} at {self.table.parameter} = {point.parameter:.7g}"
        kept = [other for other in self.curve.pieces if other.origin == origin]
        others = [p for p in self.curve.pieces if p not in (piece, *kept) and p.periods == periods]
        if any(passes_through(path, other, point) for other in others):
            return
        for sense in (1.0, -1.0):
            path = self.path(point, piece.periods)
            found = branch(path, point, self.path(point, periods).shooting, sense)
            if found is None:
                continue
            new = next((other for other in kept if _begins_at(other, found[1])), None)
            new = new or self.follow(*found, None, origin, periods)
            if not new.points[0].kind:
                new.points.insert(0, point)
            # the motions on both sides of a period doubling differ by a shift in time
            if doubles or new.reason == "closed":
                return

    def isolated(self) -> None:
        """Follow curves that are connected with the curve through the size of the loads only.

        Raises:
            ConvergenceError, AccuracyError: no motion was found where they are sought.
        """
        for value in self.table.isolated or ():
            known = self._motion_at(value) or self.start(value)
            path = self.path(known)
            s = path.shooting.scaled(known.z)
            for motion in motions_through_load(path.shooting, self.family(value), s):
                path = self.path(motion)
                point = path.at_parameter(motion.s, value)
                if point is not None and not any(lies_on(path, p, point) for p in self._single):
                    self._both(point)

    @property
    def _single(self) -> list[Piece]:
        """The pieces of motions of one period."""
        return [piece for piece in self.curve.pieces if piece.periods == 1]

    def _motion_at(self, value: float) -> CurvePoint | None:
        """A motion of the curve at a value of the parameter, or None."""
        for piece in self._single:
            for a, _, near in piece.crossings(value):
                point = self.path(a).at_parameter(near, value)
                if point is not None:
                    return point
        return None

    def _both(self, point: CurvePoint) -> None:
        """Follow a piece in both directions from a point, as one piece."""
        piece = self.follow(self.path(point), point, 1.0, "isolated")
        if piece.reason == "closed":
            return
        back = self.follow(self.path(point), point, -1.0, "isolated")
        self.curve.pieces.pop()
        piece.points[:0] = back.points[:0:-1]
        piece.special[:0] = back.special[::-1]
        if piece.reason in (END, BACK):
            piece.reason = END if back.reason in (END, BACK) else back.reason

    # ------------------------------------------------------------------ the whole

    def compute(self, richer: RicherModel | None) -> None:
        """Compute the curve, from where it stands, and estimate its errors.

        Args:
            richer: a model with a richer basis under the scene of the curve, or None.

        Raises:
            ConvergenceError, AccuracyError: no motion was found at either end of the range.
        """
        begin, curve = working_time(), self.curve
        try:
            self._ends()
            denials = Denials(self.family, self)
            denials.apply(curve.pieces)
            self.branches()
            self.isolated()
            if self.table.peak_over is not None and isinstance(self.stored, StoredModel):
                Peaks(self.stored, curve, richer).follow()
            other, limit = None, np.inf
            if richer is not None:
                other, limit = Richer(family_of(richer.stored), richer.transfer), richer.limit
            self("checking the curve with half the step and a richer basis")
            judged = checks(curve.pieces, self.family, other, self, limit, denials.motion)
            curve.checks = denials.apply(curve.pieces, judged)
        finally:
            marches = np.array([point.marches for point in curve.points + curve.special])
            total = marches.reshape(-1, 2).sum(axis=0)
            curve.marches = int(total[0]), int(total[1])
            curve.seconds += working_time() - begin

    def _ends(self) -> None:
        """Follow the curve from its first value and, if it ends before the last, from there."""
        ahead = float(np.sign(self.table.last - self.table.first))
        lost: ConvergenceError | AccuracyError | None = None
        for value, direction in ((self.table.first, ahead), (self.table.last, -ahead)):
            try:
                if self.from_end(value, direction):
                    return
            except (ConvergenceError, AccuracyError) as error:
                lost = error
        if lost is not None and not self.curve.points:
            raise lost


def _stability(point: CurvePoint) -> str:
    """The stability of a point in a line of progress."""
    return ("stable" if point.stable else "unstable") if point.known else "stability not judged"


def _refine_largest(path: Continuation, piece: Piece) -> None:
    """Add the motion of the largest amplitude of a piece, which may lie between two points."""
    points = piece.points

    def size(point: CurvePoint) -> float:
        return float(point.amplitude.max())

    k = int(np.argmax([size(point) for point in points]))
    if 0 < k < len(points) - 1:
        path.measure(points[k])
        top = path.highest(points[k - 1 : k + 2], size)
        if top is not points[k]:
            way = (path.place(top) - path.place(points[k])) @ path.direction(points[k])
            points.insert(k + int(way > 0.0), top)


def _begins_at(piece: Piece, begin: CurvePoint) -> bool:
    """Whether a branch has this point first, or next after its bifurcation."""
    size = SAME_START * float(np.linalg.norm(begin.s))
    return any(float(np.linalg.norm(point.s - begin.s)) <= size for point in piece.points[:2])


class CurveProgress:
    """Logs the progress of several curves with the time that is left."""

    def __init__(self, names: Sequence[str]):
        """Begin.

        Args:
            names: beginnings of the lines, one for each curve.
        """
        self._names = names
        self._first: list[float | None] = [None] * len(names)
        self._now = [0.0] * len(names)
        self._begin = clock.perf_counter()
        self._left = float("inf")  # the time that was told last, s

    def __call__(self, number: int, fraction: float, line: str) -> None:
        """Report a line of one curve, with the finished part of all curves."""
        if self._first[number] is None:
            self._first[number] = fraction
        self._now[number] = fraction
        count = f"curve {number + 1} of {len(self._names)}, " if len(self._names) > 1 else ""
        log.info(f"  {count}{self._names[number]}{line}; {self.remaining()}")

    def finished(self, number: int) -> None:
        """Count a curve as done."""
        self._first[number] = self._first[number] or 0.0
        self._now[number] = 1.0

    def remaining(self) -> str:
        """The part of all curves that is done, and the time that is left if it can be told."""
        total = sum(self._now) / len(self._now)
        gained = total - sum(first or 0.0 for first in self._first) / len(self._now)
        seconds = clock.perf_counter() - self._begin
        text = f"{100.0 * total:.0f} % of the range"
        if gained < 0.02 or total == 1.0:  # the checks are still to come
            return text
        left = seconds * (1.0 - total) / gained
        if left > self._left:  # the curve became slower: nobody knows
            return text
        self._left = left
        return f"{text}, about {duration(left)} left"
