"""The progress of long computations: loops tell how far they are, and a listener may show it.

The loops do not know who listens, and nobody needs to: without a listener they only count.
"""

import logging
import time as clock
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")
Listener = Callable[[float], None]


class Stopped(KeyboardInterrupt):
    """The work was asked to stop."""


log = logging.getLogger("fenicsrom")
"""Receives the lines on the progress, at the level INFO."""

_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)
_stop: ContextVar[Callable[[], bool] | None] = ContextVar("stop", default=None)


@contextmanager
def _set(variable: ContextVar[T], value: T) -> Iterator[None]:
    """Let a variable have a value in the body."""
    outer = variable.get()
    variable.set(value)
    try:
        yield
    finally:
        variable.set(outer)


def listening(listener: Listener | None) -> AbstractContextManager[None]:
    """Pass the completed fraction of the work in the body to a listener."""
    return _set(_listener, listener)


def asking(stop: Callable[[], bool] | None) -> AbstractContextManager[None]:
    """Let the work in the body end soon after `stop` returns True; None asks nobody.

    Studies then keep what they have, and most say so by `interrupted`; a run raises
    KeyboardInterrupt.

    Example:
        >>> import time
        >>> import fenicsrom as fr
        >>> end = time.monotonic() + 60.0
        >>> with fr.asking(lambda: time.monotonic() > end):
        ...     motion = fr.load_model("out/beam.npz").simulate()
    """
    return _set(_stop, stop)


def is_stopped() -> bool:
    """Whether the work was asked to stop."""
    stop = _stop.get()
    return stop is not None and stop()


def ask() -> None:
    """Ask whether to go on: whatever takes more than a second calls this again and again.

    Raises:
        Stopped: the work was asked to stop.
    """
    if is_stopped():
        raise Stopped


def tell(fraction: float) -> None:
    """Tell the listener which fraction of the work is done, from 0 to 1."""
    listener = _listener.get()
    if listener is not None:
        listener(fraction)


def tracked(items: Collection[T]) -> Iterator[T]:
    """Iterate over items of about equal work, and tell after each one the fraction that is done.

    What the body tells counts as a part of its item.
    """
    outer = _listener.get()
    count = len(items)
    for k, item in enumerate(items):
        with listening(outer and _part(outer, k, count)):
            yield item
        tell((k + 1) / count)


def _part(outer: Listener, k: int, count: int) -> Listener:
    """A listener of item k of so many items."""
    return lambda fraction: outer((k + fraction) / count)


_compilation = 0.0  # time that this process spent on the compilation of kernels, s


def add_compilation(seconds: float) -> None:
    """Leave the time (s) of a compilation out of `working_time`: it happens only once."""
    global _compilation
    _compilation += seconds


def working_time() -> float:
    """A clock (s) that stands still while kernels are compiled; only differences mean something."""
    return clock.perf_counter() - _compilation


def time_left(seconds: float, fraction: float) -> str:
    """Say how long the rest takes if this fraction took so many seconds."""
    if fraction <= 0.0:
        return "time left unknown"
    rest = seconds * (1.0 - fraction) / fraction
    return f"about {duration(rest)} left"


def duration(seconds: float) -> str:
    """A time in words."""
    return f"{seconds:.0f} s" if seconds < 100.0 else f"{seconds / 60.0:.0f} min"
