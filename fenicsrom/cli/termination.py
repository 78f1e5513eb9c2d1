"""The signal SIGTERM sets a flag that the run reads between stages and after each period."""

import os
import signal
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager

REPEATED = 1.0  # s after a SIGTERM in which another one is the same request, as of a process group

_termination = {"requested": False}


def is_terminated() -> bool:
    """Tell whether SIGTERM arrived."""
    return _termination["requested"]


@contextmanager
def terminable() -> Iterator[None]:
    """Note SIGTERM for `is_terminated`, if this is the main thread.

    The handler raises no exception, because numba drops exceptions that are raised while numba
    compiles. A SIGTERM that comes more than `REPEATED` after the first one ends the process at
    once; all files are complete at any moment.
    """
    first = float("inf")

    def note(number: int, frame: object) -> None:
        nonlocal first
        if clock.monotonic() > first + REPEATED:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            os.kill(os.getpid(), signal.SIGTERM)
        first = min(first, clock.monotonic())
        _termination["requested"] = True

    _termination["requested"] = False
    try:
        before = signal.signal(signal.SIGTERM, note)
    except ValueError:  # not the main thread
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)
