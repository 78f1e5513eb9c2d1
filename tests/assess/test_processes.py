"""Jobs in several processes: order, progress, interrupts and processes that die."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from typing import Any

import pytest

from fenicsrom.assess.processes import THREADS, run_jobs
from fenicsrom.errors import ConvergenceError


def square(job: float, report: Callable[[float, str], None]) -> tuple[float, int, str]:
    """A job: its square, the process and its number of threads."""
    report(1.0, f"job {job}")
    return job**2, os.getpid(), os.environ.get(THREADS[0], "")


def endless(job: int, report: Callable[[float, str], None]) -> str:
    """A job that ends when it is interrupted; job 0 is told first."""
    try:
        report(0.1, "begun")
        while True:
            time.sleep(0.01)
            report(0.5, "")
    except KeyboardInterrupt:
        return f"job {job} until the interrupt"


def die(job: int, report: Callable[[float, str], None]) -> int:
    """A job whose process ends at once."""
    os._exit(3)


def silent(number: int, fraction: float, line: str) -> None:
    """Drop the progress."""


def test_results_come_in_order_from_other_processes() -> None:
    lines: list[tuple[int, float, str]] = []
    before = dict(os.environ)
    found = list(run_jobs(square, [3.0, 2.0, 1.0], lambda *it: lines.append(it), 2, lambda: False))
    assert [value for value, _, _ in found] == [9.0, 4.0, 1.0]
    assert os.getpid() not in [process for _, process, _ in found]
    assert {threads for _, _, threads in found} == {"1"}
    assert dict(os.environ) == before
    assert set(lines) <= {(0, 1.0, "job 3.0"), (1, 1.0, "job 2.0"), (2, 1.0, "job 1.0")}


def test_one_worker_computes_in_this_process() -> None:
    lines: list[Any] = []
    found = list(run_jobs(square, [2.0, 3.0], lambda *it: lines.append(it), 1, lambda: False))
    assert [process for _, process, _ in found] == [os.getpid()] * 2
    assert lines == [(0, 1.0, "job 2.0"), (1, 1.0, "job 3.0")]


@pytest.mark.parametrize("how", ["tell", "stop"])
def test_interrupt_yields_what_the_running_jobs_have(how: str) -> None:
    begun: list[int] = []

    def tell(number: int, fraction: float, line: str) -> None:
        begun.append(number)
        if how == "tell" and len(begun) == 2:
            raise KeyboardInterrupt

    def stop() -> bool:
        return how == "stop" and len(begun) >= 2

    found = []
    with pytest.raises(KeyboardInterrupt):
        for result in run_jobs(endless, [0, 1, 2, 3], tell, 2, stop):
            found.append(result)
    assert 2 <= len(found) <= 3  # the queue of the pool may have taken one job more
    assert found[:2] == ["job 0 until the interrupt", "job 1 until the interrupt"]


def test_process_that_dies_gives_an_error_as_its_result() -> None:
    found = list(run_jobs(die, [0, 1], silent, 2, lambda: False))
    assert [type(result) for result in found] == [ConvergenceError] * 2
