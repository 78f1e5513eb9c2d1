"""SIGTERM sets a flag that the run reads between stages and after each period.

Python runs the handlers of signals between two of its own instructions, so both SIGINT and SIGTERM
wait for a call of a library to return. A thread ends the process if gmsh makes them wait too long.
"""

import os
import select
import signal
import threading
import time as clock
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from fenicsrom.cli.ranks import all_ranks, stopped

REPEATED = 1.0  # s after a SIGTERM in which another one is the same request, as of a process group
PATIENCE = 3.0  # s that a signal waits for a library
WORDS: dict[int, tuple[str, int]] = {
    signal.SIGINT: ("interrupted", 130),
    signal.SIGTERM: ("terminated", 143),
}

_termination = {"requested": False}


def is_terminated() -> bool:
    """Tell whether SIGTERM arrived."""
    return _termination["requested"]


@contextmanager
def terminable() -> Iterator[None]:
    """Note SIGTERM for `is_terminated`, if this is the main thread.

    The handler raises no exception, because numba drops exceptions that are raised while numba
    compiles. A SIGTERM that comes more than `REPEATED` after the first one ends the process at
    once; all files are complete at any moment. A serial run ends also if a signal waits longer than
    `PATIENCE` for a library that lets other threads run, such as gmsh.
    """
    noticed: list[int] = []
    first = float("inf")

    def note(number: int, frame: object) -> None:
        nonlocal first
        noticed.append(number)
        if clock.monotonic() > first + REPEATED:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            os.kill(os.getpid(), signal.SIGTERM)
        first = min(first, clock.monotonic())
        _termination["requested"] = True

    def interrupt(number: int, frame: object) -> None:
        noticed.append(number)
        raise KeyboardInterrupt

    _termination["requested"] = False
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before: dict[int, Any] = {signal.SIGTERM: signal.signal(signal.SIGTERM, note)}
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        before[signal.SIGINT] = signal.signal(signal.SIGINT, interrupt)
    try:
        with _watched(noticed):
            yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _watched(noticed: list[int]) -> Iterator[None]:
    """End a serial run if a signal arrives and is not `noticed` in time."""
    read, write = os.pipe()
    for end in (read, write):
        os.set_blocking(end, False)

    def watch() -> None:
        while select.select([read], [], []) and (numbers := os.read(read, 64)):
            known = [WORDS[number] for number in numbers if number in WORDS]
            if not known or all_ranks() is not None:
                continue
            # a library that lets no other thread run stops this count, too
            for _ in range(round(PATIENCE / 0.1)):
                if noticed:
                    break
                clock.sleep(0.1)
            else:
                word, code = known[0]
                os._exit(stopped(f"{word}; run the command again", code))
            noticed.clear()
            with suppress(BlockingIOError):  # signals that came together have one handler
                os.read(read, 64)

    before, thread = signal.set_wakeup_fd(write), threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield
    finally:
        signal.set_wakeup_fd(before)
        os.close(write)
        thread.join()
        os.close(read)
