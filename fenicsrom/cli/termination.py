"""SIGTERM sets a flag that the run reads between stages and after each period.

Python runs the handlers of signals between two of its own instructions, so both SIGINT and SIGTERM
wait for a call of a library to return; `fenicsrom.cli.supervision` ends what takes too long.
"""

import os
import signal
import threading
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

REPEATED = 1.0  # s after a signal in which another one is the same request, as of a process group
WORDS: dict[int, tuple[str, int]] = {
    signal.SIGINT: ("interrupted", 130),
    signal.SIGTERM: ("terminated", 143),
}

_received: list[int] = []


def is_stopped() -> bool:
    """Tell whether SIGINT or SIGTERM arrived."""
    return bool(_received)


def is_terminated() -> bool:
    """Tell whether SIGTERM arrived first."""
    return _received[:1] == [signal.SIGTERM]


@contextmanager
def terminable() -> Iterator[None]:
    """Note SIGINT and SIGTERM for `is_stopped`, if this is the main thread.

    SIGINT raises KeyboardInterrupt too. Numba drops exceptions that are raised while numba
    compiles, so what computes asks `is_stopped` as well. A SIGTERM that comes more than `REPEATED`
    after the first signal ends the process at once; all files are complete at any moment.
    """
    first = float("inf")

    def note(number: int, frame: object) -> None:
        nonlocal first
        now, is_first = clock.monotonic(), not _received
        _received.append(number)
        first = min(first, now)
        again = now > first + REPEATED
        if number == signal.SIGINT and (is_first or again):
            raise KeyboardInterrupt
        if again:
            signal.signal(number, signal.SIG_DFL)
            os.kill(os.getpid(), number)

    _received.clear()
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before: dict[int, Any] = {signal.SIGTERM: signal.signal(signal.SIGTERM, note)}
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        before[signal.SIGINT] = signal.signal(signal.SIGINT, note)
    if hasattr(signal, "pthread_sigmask"):  # the parent process, which Windows has not, blocks them
        signal.pthread_sigmask(signal.SIG_UNBLOCK, WORDS)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
