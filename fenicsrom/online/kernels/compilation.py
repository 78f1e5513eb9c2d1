"""The compilation of kernels: its announcement, and its time.

Numba sends the event "numba:compile" where it compiles a function that it does not find in its
cache. Source: numba's documentation of `numba.core.event`.
"""

import os
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.event import Listener

from fenicsrom.progress import add_compilation, duration

ONCE = "once for this version of the program on this kind of processor"
KERNELS = {
    "contact.law.at_rest": "the contact law",
    "contact.problem.solve_contact": "the contact problem",
    "step.loop.march": "the time steps",
    "derivative.period_sensitivity.carry_derivatives": "the derivatives of a period",
}
"""The kernels whose compilation takes seconds, by their names in `fenicsrom.online`."""


class Compilations(Listener):  # type: ignore[misc]
    """Leaves the time of compilations out of `fenicsrom.progress.working_time`.

    Processes that are forked later announce nothing.

    Attributes:
        say: receives a line for each of the `KERNELS` that is compiled.
    """

    def __init__(self) -> None:
        """Announce to nobody."""
        self.say: Callable[[str], None] = lambda line: None
        self._process = os.getpid()
        self._depth, self._began = 0, 0.0
        self._count, self._seconds = 0, 0.0  # kernels compiled so far, and the time of all

    def on_start(self, event: Any) -> None:
        """Announce a kernel, unless it is compiled as a part of another one."""
        self._depth += 1
        if self._depth > 1:
            return
        self._began = clock.perf_counter()
        function = event.data["dispatcher"].py_func
        kernel = f"{function.__module__}.{function.__qualname__}".removeprefix("fenicsrom.online.")
        if kernel in KERNELS and os.getpid() == self._process:
            self._count += 1
            spent = f"{duration(self._seconds)} so far, " if self._count > 1 else ""
            self.say(
                f"compiling kernel {self._count} of at most {len(KERNELS)}, {KERNELS[kernel]}: "
                f"{spent}{ONCE} .."
            )

    def on_end(self, event: Any) -> None:
        """Add the time of a compilation."""
        self._depth -= 1
        if self._depth == 0:
            seconds = clock.perf_counter() - self._began
            self._seconds += seconds
            add_compilation(seconds)


COMPILATIONS = Compilations()
"""Listens as long as this process runs."""


@contextmanager
def announced(say: Callable[[str], None]) -> Iterator[None]:
    """Say which kernels this process compiles in the body."""
    outer, COMPILATIONS.say = COMPILATIONS.say, say
    try:
        yield
    finally:
        COMPILATIONS.say = outer
