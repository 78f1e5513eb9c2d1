"""The announcement of the compilation of kernels, which takes minutes in the first run.

The event "numba:compile" is sent where numba compiles a function that it does not find in its
cache. Source: numba's documentation of `numba.core.event`.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

COMPILING = (
    "compiling kernels: once for this version of the program on this kind of processor; this takes "
    "some minutes .."
)


@contextmanager
def announced(say: Callable[[str], None]) -> Iterator[None]:
    """Say once that kernels are compiled, if the body compiles any in this process."""
    from numba.core import event

    class Once(event.Listener):  # type: ignore[misc]
        """Speaks at the first compilation; processes that are forked later are silent."""

        process: int | None = os.getpid()

        def on_start(self, event: Any) -> None:
            """Announce the first compilation."""
            if self.process == os.getpid():
                self.process = None
                say(COMPILING)

        def on_end(self, event: Any) -> None:
            """Do nothing."""

    with event.install_listener("numba:compile", Once()):
        yield
