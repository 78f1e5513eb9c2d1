"""Run times and progress of the stages."""

from collections.abc import Iterator
from contextlib import contextmanager

from fenicsrom.progress import duration, listening, log, working_time

SILENCE = 5.0  # time without a line after which a stage says how far it is, s
IN_PARTS = ("size", "checks")  # stages of several motions, each of which begins at 0 %
FIRST_STEP = 0.02  # of the work: a smaller first step may contain the compilation of forms


class Stopwatch:
    """Times stages, and logs their progress.

    Attributes:
        seconds: stage -> run time without the compilation of kernels, s.
        stage: name of the stage that runs; "" between stages.
    """

    def __init__(self) -> None:
        """Begin without a stage."""
        self.seconds: dict[str, float] = {}
        self.stage = ""
        self._last = working_time()

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time a stage."""
        outer, self.stage = self.stage, stage
        log.info(f"{stage} ..")
        work = self._last = working_time()
        known: tuple[float, float] | None = None  # from when and where the speed is measured
        last, motion = 0.0, 1

        def report(fraction: float) -> None:
            """Say how far the stage is; a motion that settles early ends it earlier."""
            nonlocal known, last, motion
            now = working_time()
            if fraction < last:  # another motion
                known, motion = (now, fraction), motion + 1
            last = fraction
            if known is None:
                known = (work, 0.0) if fraction > FIRST_STEP else (now, fraction)
            if now - self._last > SILENCE and known[1] < fraction < 1.0:
                self._last = now
                rest = (now - known[0]) * (1.0 - fraction) / (fraction - known[1])
                of_it = f" of motion {motion}" if stage in IN_PARTS else ""
                log.info(f"  {stage}: {100.0 * fraction:.0f} %{of_it}{_at_most(rest)}")

        try:
            with listening(report):
                yield
        finally:
            self.stage = outer
        self.seconds[stage] = working_time() - work


def _at_most(seconds: float) -> str:
    """The end of a line: the longest time that is left, or "" where it is below a second."""
    return f", at most {duration(seconds)} left" if seconds >= 1.0 else ""
