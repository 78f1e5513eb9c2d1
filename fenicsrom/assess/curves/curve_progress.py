"""The progress of response curves: lines for the user, and what is kept of an interrupted run."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from fenicsrom.assess.curves.response_files import CurveFile
from fenicsrom.assess.curves.response_results import response_table
from fenicsrom.progress import duration, log
from fenicsrom.scene.reading.units import in_words
from fenicsrom.words import counted

if TYPE_CHECKING:
    from fenicsrom.assess.curves.response_results import ResponseCurve
    from fenicsrom.scene import Scene

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
