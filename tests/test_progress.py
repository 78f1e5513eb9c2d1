"""The progress of nested loops."""

from __future__ import annotations

import io
import sys
from types import SimpleNamespace
from typing import Any

import pytest
from support import heard

from fenicsrom import progress as working
from fenicsrom.assess.curves import pieces as curve_progress
from fenicsrom.cli.printing import progress
from fenicsrom.cli.ranks import CLEAR, refuse
from fenicsrom.online.kernels.compilation import Compilations
from fenicsrom.progress import listening, tell, tracked
from fenicsrom.study import stopwatch


def test_nested_loops_tell_their_part_of_the_whole() -> None:
    told: list[float] = []
    with listening(told.append):
        for item in tracked(range(2)):
            for _ in tracked(range(2)):
                tell(0.5)
            tell(1.0 if item else 0.0)
    inner = [0.125, 0.25, 0.375, 0.5]
    assert told == pytest.approx([*inner, 0.0, 0.5, *(0.5 + x for x in inner), 1.0, 1.0])


def test_stage_says_how_far_it_is_after_some_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr(working.clock, "perf_counter", lambda: now)
    lines: list[str] = []
    watch = stopwatch.Stopwatch()
    with heard(lines.append), watch("derivatives"):
        for _ in tracked(range(10)):
            now += 2.0
    assert lines[0] == "derivatives .."
    ends = ["30 %, at most 14 s left", "60 %, at most 8 s left", "90 %, at most 2 s left"]
    assert lines[1:] == [f"  derivatives: {end}" for end in ends]
    assert watch.seconds["derivatives"] == 20.0


def test_time_left_of_a_stage_of_several_motions_is_that_of_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 100.0
    monkeypatch.setattr(working.clock, "perf_counter", lambda: now)
    lines: list[str] = []
    with heard(lines.append), stopwatch.Stopwatch()("size"):
        for seconds in (0.1, 2.0):
            for k in range(100):
                now += seconds
                tell((k + 1) / 100)
    assert lines[1] == "  size: 51 % of motion 1, at most 5 s left"
    assert lines[-2:] == [
        "  size: 95 % of motion 2, at most 10 s left",
        "  size: 98 % of motion 2, at most 4 s left",
    ]


def test_time_left_does_not_count_the_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first of a thousand steps takes a minute, each of the others 0.1 s."""
    now = 100.0
    monkeypatch.setattr(working.clock, "perf_counter", lambda: now)
    lines: list[str] = []
    with heard(lines.append), stopwatch.Stopwatch()("linear transient"):
        for k in tracked(range(1000)):
            now += 0.1 if k else 60.0
    assert lines[1] == "  linear transient: 0 %, at most 100 s left"
    assert lines[-1].startswith("  linear transient: 9") and lines[-1].endswith(" s left")


def test_time_left_does_not_count_kernels_that_are_compiled_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The second of ten steps compiles for a minute; each takes 2 s."""
    now = 100.0
    monkeypatch.setattr(working.clock, "perf_counter", lambda: now)
    compilation = Compilations()
    function: Any = SimpleNamespace(
        py_func=SimpleNamespace(__module__="kernels", __qualname__="march"),
        stats=SimpleNamespace(cache_path=None),
    )
    event: Any = SimpleNamespace(data={"dispatcher": function}, is_failed=False)
    lines: list[str] = []
    watch = stopwatch.Stopwatch()
    with heard(lines.append), watch("selection"):
        for k in tracked(range(10)):
            if k == 1:
                compilation.on_start(event)
                now += 60.0
                compilation.on_end(event)
            now += 2.0
    assert lines[1] == "  selection: 30 %, at most 14 s left"
    assert watch.seconds["selection"] == pytest.approx(20.0)


def test_progress_is_one_line_of_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setenv("COLUMNS", "20")
    monkeypatch.setattr(sys, "stderr", Terminal())
    progress("mesh ..")
    progress("  derivatives: 30 %, about 14 s left")
    refuse("no mesh", 2)
    told = sys.stderr.getvalue()
    assert told == f"{CLEAR}mesh ..{CLEAR}derivatives: 30 %, {CLEAR}fenicsrom: no mesh\n"
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    progress("mesh ..")
    progress("  solid ..")
    assert sys.stderr.getvalue() == "mesh ..\n  solid ..\n"


def test_time_left_of_a_curve_does_not_grow(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr(curve_progress.clock, "perf_counter", lambda: now)
    told: list[str] = []
    curve = curve_progress.CurveProgress([""])
    with heard(told.append):
        for instant, fraction in ((0.0, 0.0), (10.0, 0.5), (30.0, 0.6), (31.0, 0.9)):
            now = instant
            curve(0, fraction, "")
    ends = [line.split("; ")[1] for line in told]
    assert ends[1] == "50 % of the range, about 10 s left" and ends[2] == "60 % of the range"
    assert ends[3] == "90 % of the range, about 3 s left"
