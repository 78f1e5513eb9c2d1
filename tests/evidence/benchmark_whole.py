"""Split the CPU time of a whole command into what it was spent on.

    python3 tests/evidence/benchmark.py --whole run demos/blade_rub.toml

The command runs once in this process, with one worker, and its output goes to a temporary folder.
Each sample of the CPU time counts for the first of `PARTS` whose place is among the functions that
are running, the outermost function first. A module that is imported counts as an import wherever
that happens. Run the command once before, so that its caches are warm.
"""

from __future__ import annotations

import os
import signal
import tempfile
from collections import Counter
from contextlib import redirect_stdout
from io import StringIO
from time import process_time
from types import FrameType

from fenicsrom.cli import main

SAMPLE = 0.004  # s
IMPORT = "_find_and_load"
PARTS = (
    (
        "estimates",
        ("assess/errors/", ":finer_elements", ":_finer", "curves/trust", "curves/checks"),
    ),
    ("files", ("post/run/summary", "post/paraview/", "post/base/page", "online/store/")),
    ("pictures", ("fenicsrom/post/",)),
    ("offline", ("fem/", "reduction/")),
    ("motion", ("online/", "assess/")),
)
"""Each part, and its places: a module of the package, or the name of a function behind a colon."""


def split(words: list[str]) -> Counter[str]:
    """Run a command; give its CPU time by parts, s."""
    found, last = Counter[str](), process_time()

    def sample(number: int, frame: FrameType | None) -> None:
        nonlocal last
        now = process_time()
        found[part_of(frame)] += now - last
        last = now

    signal.signal(signal.SIGPROF, sample)
    signal.setitimer(signal.ITIMER_PROF, SAMPLE, SAMPLE)
    code = main(words)
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    if code:
        raise SystemExit(code)
    return found


def part_of(frame: FrameType | None) -> str:
    """The part to which the functions that are running belong."""
    places = []
    while frame is not None:
        if frame.f_code.co_name == IMPORT:
            return "imports"
        places.append(f"{frame.f_code.co_filename}:{frame.f_code.co_name}")
        frame = frame.f_back
    for place in reversed(places):
        for name, marks in PARTS:
            if "fenicsrom/" in place and any(mark in place for mark in marks):
                return name
    return "other"


def measure(words: list[str]) -> None:
    """Print the CPU times of a command by parts, the longest first."""
    os.sched_setaffinity(
        0, {min(os.sched_getaffinity(0))}
    )  # one worker: curves run in this process
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        found = split([*words, "--output", folder, "--force"])
    print(f"{' '.join(words)}: {found.total():.1f} CPU s")
    for name, seconds in found.most_common():
        print(f"  {name:10} {seconds:6.2f}  {100.0 * seconds / found.total():3.0f} %")
