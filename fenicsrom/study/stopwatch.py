"""Run times, progress and interruption of the stages."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager

PROGRESS_INTERVAL = 2.0  # shortest time between two lines on the progress of a motion, s


def never() -> bool:
    """Tell that the run may continue: the default of `stop`."""
    return False


def stop_where_asked(stop: Callable[[], bool]) -> None:
    """End the run if `stop` asks for it.

    Raises:
        KeyboardInterrupt: `stop` returned True.
    """
    if stop():
        raise KeyboardInterrupt


class Stopwatch:
    """Times stages, and announces each stage.

    Attributes:
        say: receives one line at a time.
        seconds: stage -> run time, s.
    """

    def __init__(self, say: Callable[[str], None] | None = None):
        """Announce stages through `say`; by default to nobody."""
        self.say = say if say is not None else lambda line: None
        self.seconds: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time a stage."""
        self.say(f"{stage} ..")
        begin = clock.perf_counter()
        yield
        self.seconds[stage] = clock.perf_counter() - begin

    def progress(self, model: str, steady: float | None) -> Callable[[float, float], None]:
        """Make a callback for `simulate` that reports the progress every two seconds.

        Args:
            model: name of the model.
            steady: change per period at which the motion counts as steady.
        """
        last = clock.perf_counter()
        count = 0

        def report(fraction: float, change: float) -> None:
            nonlocal last, count
            count += 1
            if clock.perf_counter() - last > PROGRESS_INTERVAL:
                last = clock.perf_counter()
                goal = f" (steady at {steady:.0e})" if steady else ""
                self.say(f"  {model}: period {count}, change {change:.1e}{goal}")

        return report
