"""The pieces of a response curve, in the order in which they are followed, and their progress.

A curve starts at the first value of the range, where a few periods are marched and Newton's method
finds the periodic motion (`fenicsrom.online.periodic.shooting`). It is followed through its folds
to the last value (`fenicsrom.online.curves.continuation`). A curve that ends before is followed
from the last value too, so that both sides of a gap are known. Branches and isolated curves come
last.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from fenicsrom.assess.curves.branches import Piece, follow_branches, follow_isolated
from fenicsrom.assess.curves.denials import Denials
from fenicsrom.assess.curves.peaks import follow_peaks
from fenicsrom.assess.curves.response_problem import family_of, shooting_of, start_motion
from fenicsrom.assess.curves.results import CurveFile, ResponseCurve, response_table
from fenicsrom.assess.curves.trust import Richer, RicherModel, checks
from fenicsrom.errors import AccuracyError, ConvergenceError
from fenicsrom.online.curves.arc import oriented
from fenicsrom.online.curves.continuation import HURRIES, Continuation, hurries
from fenicsrom.online.curves.curve import OUT_OF_POINTS, CurvePoint
from fenicsrom.online.periodic.shooting import Family, PeriodicMotion
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.progress import duration, listening, log, working_time
from fenicsrom.scene import Scene
from fenicsrom.scene.reading.overrides import in_words
from fenicsrom.words import counted

REPORT_INTERVAL = 2.0  # shortest time between two lines of progress of a curve, s
NEARLY_ALL = 0.8  # part of the largest number of points at which the progress warns
KEEP_INTERVAL = 1.0  # shortest time between two writes of its file, s
KEEP_SHARE = 0.05  # most of the time that these writes may take


class CurveWalk:
    """Reports the progress of one curve, and keeps its points in a file."""

    def __init__(
        self,
        curve: ResponseCurve,
        scene: Scene,
        report: Callable[[float, str], None],
        file: CurveFile | None,
    ):
        """Begin at the points that the curve has.

        Args:
            curve: the curve.
            scene: its scene, with a table [response].
            report: receives the part of the range that is covered and a line; where it is only
                asked whether to stop, 0 and an empty line. The callback raises KeyboardInterrupt to
                stop the computation.
            file: the file; None keeps nothing.
        """
        self.curve, self.scene, self.file = curve, scene, file
        self._report = report
        self._said = self._kept = clock.perf_counter()
        self._wait = KEEP_INTERVAL

    def __call__(self, line: str) -> None:
        """Report a line."""
        self._report(self.fraction if line else 0.0, line)

    @property
    def fraction(self) -> float:
        """The part of the range of the parameter that the curve covers, from both ends."""
        table = response_table(self.scene)
        low, high = table.low, table.high
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
            here = in_words(self.scene, response_table(self.scene).parameter, point.parameter)
            line = (
                f"{counted(len(self.curve.points), 'point')}, {here}, amplitude "
                f"{1e3 * float(point.amplitude.max()):.4g} mm, {'un' * (not point.stable)}stable"
                f"{HURRIES * hurries(piece)}"
            )
        most = response_table(self.scene).points
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
        if self.file is None:
            return
        pieces = [
            piece
            for piece in self.curve.pieces
            if piece.reason != "interrupted" or piece.origin == "march"
        ]
        self.file.save(replace(self.curve, pieces=pieces), done=done)


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


def follow_curve(
    stored: StoredModel, curve: ResponseCurve, walk: CurveWalk, richer: RicherModel | None
) -> None:
    """Compute the pieces of one curve, from where it stands, and estimate its errors.

    Raises:
        ConvergenceError, AccuracyError: no motion was found at either end of the range.
    """
    begin, table = working_time(), response_table(stored.scene)
    family = family_of(stored)
    error: ConvergenceError | AccuracyError | None = None
    try:
        ahead = float(np.sign(table.last - table.first))
        for value, direction in ((table.first, ahead), (table.last, -ahead)):
            earlier = [
                piece
                for piece in curve.pieces
                if piece.origin == "march" and piece.direction == direction
            ]
            start: PeriodicMotion | None = None
            if not earlier:
                try:
                    start = _start(stored, family, value, walk)
                except (ConvergenceError, AccuracyError) as problem:
                    error = problem
                    continue
                curve.pieces.append(Piece(direction=direction))
            piece = earlier[0] if earlier else curve.pieces[-1]
            if start is not None or piece.reason == "interrupted":
                _follow_piece(stored, family, start, value, piece, walk)
            reached = abs(piece.points[-1].parameter - table.last) <= 1e-9 * table.high
            if reached or piece.reason == OUT_OF_POINTS:
                break
        if not curve.points and error is not None:
            raise error
        denials = Denials(family, lambda: walk(""))
        denials.apply(curve.pieces)
        _follow_more(stored, family, curve, walk)
        if response_table(stored.scene).peak_over is not None:
            with listening(lambda _: walk("")):  # it may stop the computation
                follow_peaks(stored, curve, richer)
        other, limit = None, np.inf
        if richer is not None:
            other, limit = Richer(family_of(richer.stored), richer.transfer), richer.limit
        walk("checking the curve with half the step and a richer basis")
        judged = checks(curve.pieces, family, other, lambda: walk(""), limit, denials.motion)
        curve.checks = denials.apply(curve.pieces, judged)
    finally:
        marches = np.array([point.marches for point in curve.points + curve.special])
        total = marches.reshape(-1, 2).sum(axis=0)
        curve.marches = int(total[0]), int(total[1])
        curve.seconds += working_time() - begin


def _start(stored: StoredModel, family: Family, value: float, walk: CurveWalk) -> PeriodicMotion:
    """The motion at an end of the range; errors as `start_motion`."""
    place = in_words(stored.scene, response_table(stored.scene).parameter, value)
    walk(f"start at {place}: a march, then Newton's method")
    return start_motion(stored, family, value)


def _follow_piece(
    stored: StoredModel,
    family: Family,
    start: PeriodicMotion | None,
    value: float,
    piece: Piece,
    walk: CurveWalk,
) -> None:
    """Follow one piece from a motion, or on from its last point.

    Args:
        stored: the model.
        family: problems by the parameter.
        start: the first motion; None continues from the last point of the piece.
        value: parameter at the first motion.
        piece: the piece.
        walk: reports and keeps what is done.

    Raises:
        ConvergenceError: the first point was not found.
    """
    table = response_table(stored.scene)
    path = _path(stored, family, piece.points[0] if start is None else start)
    if start is not None:
        piece.points.append(_first_point(path, start, value, piece.direction, stored.scene))
        walk.passed()
    path.run(
        piece.points[-1],
        None,
        curve=piece,
        points=table.points,
        progress=lambda point: walk.passed(),
    )
    _refine_largest(path, piece)
    walk(f"{counted(len(piece.points), 'point')}, {piece.reason}")


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


def _path(
    stored: StoredModel, family: Family, motion: CurvePoint | PeriodicMotion, periods: int = 1
) -> Continuation:
    """The continuation over the range of the scene, measured by the size of a motion."""
    table, shooting = response_table(stored.scene), shooting_of(stored, family, periods)
    return Continuation(shooting, family, table.low, table.high, shooting.scaled(motion.z))


def _first_point(
    path: Continuation, start: PeriodicMotion, value: float, direction: float, scene: Scene
) -> CurvePoint:
    """The first point of a piece; arguments and errors as `_follow_piece`."""
    begin = path.at_parameter(path.shooting.scaled(start.z), value)
    if begin is None:
        here = in_words(scene, response_table(scene).parameter, value)
        raise ConvergenceError(f"the motion at {here} was lost")
    turn = float(np.sign(begin.tangent[-1])) or 1.0
    return oriented(begin, turn * direction * begin.sense)


def _follow_more(
    stored: StoredModel, family: Family, curve: ResponseCurve, progress: CurveWalk
) -> None:
    """Follow the branches and the isolated curves that the scene asks for.

    Raises:
        ConvergenceError, AccuracyError: no motion was found where isolated curves are sought.
    """
    table = response_table(stored.scene)

    def path_of(motion: CurvePoint, periods: int) -> Continuation:
        return _path(stored, family, motion, periods)

    def follow(
        path: Continuation, begin: CurvePoint, direction: float | None, origin: str, periods: int
    ) -> None:
        piece = Piece([begin], reason="interrupted", origin=origin, periods=periods)
        curve.pieces.append(piece)
        path.run(
            begin,
            direction,
            curve=piece,
            points=table.points,
            progress=lambda point: progress(""),
        )
        progress(f"{origin}: {counted(len(piece.points), 'point')}, {piece.reason}")

    def start(value: float) -> CurvePoint:
        motion = _start(stored, family, value, progress)
        return _first_point(_path(stored, family, motion), motion, value, 1.0, stored.scene)

    follow_branches(curve.pieces, path_of, follow, table.parameter, table.branches)
    follow_isolated(curve.pieces, path_of, follow, start, table.isolated or ())
