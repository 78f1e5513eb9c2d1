"""SIGTERM: a flag that the run reads between stages and after each period."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager

_termination = {"requested": False}


def is_terminated() -> bool:
    """Tell whether SIGTERM arrived; the run asks between stages and after each period."""
    return _termination["requested"]


@contextmanager
def terminable() -> Iterator[None]:
    """Note SIGTERM for `is_terminated`, if this is the main thread.

    The handler does not raise: numba drops exceptions that are raised while it compiles. A second
    SIGTERM ends the process at once; files are complete at any moment.
    """

    def note(number: int, frame: object) -> None:
        _termination["requested"] = True
        signal.signal(signal.SIGTERM, signal.SIG_DFL)

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
