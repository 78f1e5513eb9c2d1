"""The announcement of kernels that are compiled, with the time that each took before.

The event "numba:compile" is sent where numba compiles a function that it does not find in its
cache. Source: numba's documentation of `numba.core.event`. The CPU times are kept beside the
machine code, so that they belong to this kind of processor.
"""

from __future__ import annotations

import json
import os
import time as clock
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from numba.core.event import Listener, install_listener

from fenicsrom.files import atomic_write
from fenicsrom.progress import add_compilation, duration

ONCE = "once for this version of the program on this kind of processor"
SHORT = 3.0  # s: shorter compilations are not announced
TIMES = "compile_seconds.json"  # file of the CPU times, by the names of the functions


@contextmanager
def announced(say: Callable[[str], None]) -> Iterator[None]:
    """Say which kernels this process compiles in the body, and how long each took before."""
    with install_listener("numba:compile", Compilations(say)):
        yield


class Compilations(Listener):  # type: ignore[misc]
    """Announces the outermost function that is compiled, and keeps the time it takes.

    Estimates of the time that is left do not count it (`fenicsrom.progress.working_time`).

    Processes that are forked later are silent.
    """

    def __init__(self, say: Callable[[str], None]):
        """Announce through `say`."""
        self._say = say
        self._process = os.getpid()
        self._depth = 0
        self._begin = self._began = 0.0  # CPU time and time on the clock, s
        self._silent = False  # on kernels whose time is not known: announced together

    def on_start(self, event: Any) -> None:
        """Announce a compilation, unless it is known to be short or belongs to another one."""
        self._depth += 1
        if self._depth > 1 or os.getpid() != self._process:
            return
        self._begin, self._began = clock.process_time(), clock.perf_counter()
        function = event.data["dispatcher"]
        known, name = known_times(function), _name(function)
        if known.get(name, 0.0) > SHORT:
            self._say(f"compiling the kernel {name}: about {duration(known[name])}, {ONCE} ..")
        elif name not in known and not self._silent:
            self._silent = True
            self._say(f"compiling kernels: {ONCE}{'' if known else '; this takes some minutes'} ..")

    def on_end(self, event: Any) -> None:
        """Keep the time of a compilation that succeeded."""
        self._depth -= 1
        if self._depth > 0 or os.getpid() != self._process:
            return
        add_compilation(clock.perf_counter() - self._began)
        if not event.is_failed:
            function = event.data["dispatcher"]
            keep_time(function, clock.process_time() - self._begin)


def _name(function: Any) -> str:
    """The name of a compiled function, with its module."""
    return f"{function.py_func.__module__}.{function.py_func.__qualname__}"


def _file(function: Any) -> Path | None:
    """The file of the times beside the machine code of a function; None if it is not stored."""
    folder = function.stats.cache_path
    return None if folder is None else Path(folder) / TIMES


def known_times(function: Any) -> dict[str, float]:
    """The CPU times (s) of earlier compilations in the folder of a function; empty if unknown."""
    path = _file(function)
    with suppress(OSError, ValueError, AttributeError, TypeError):
        if path is not None:
            found = json.loads(path.read_text(encoding="utf-8"))
            return {str(name): float(seconds) for name, seconds in found.items()}
    return {}


def keep_time(function: Any, seconds: float) -> None:
    """Keep the CPU time (s) of the compilation of a function; a folder may refuse it."""
    path = _file(function)
    if path is None:
        return
    times = known_times(function) | {_name(function): round(seconds, 2)}
    with suppress(OSError), atomic_write(path) as temporary:
        temporary.write_text(json.dumps(times, indent=1), encoding="utf-8")
