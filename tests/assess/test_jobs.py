"""Jobs of several workers: progress, interrupts and workers that die."""

from __future__ import annotations

import os
import signal
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from fenicsrom.assess import jobs
from fenicsrom.assess.jobs import LIVES, THREADS, report, run_jobs
from fenicsrom.errors import ConvergenceError, ErrorKind
from fenicsrom.progress import ask, asking


def square(job: float) -> tuple[float, int, str]:
    """A job: its square, the process and its number of threads."""
    report(1.0, f"job {job}")
    return job**2, os.getpid(), os.environ.get(THREADS[0], "")


def endless(job: int) -> str:
    """A job that ends when it is interrupted; job 0 is told first."""
    try:
        report(0.1, "begun")
        while True:
            time.sleep(0.01)
            ask()
    except KeyboardInterrupt:
        return f"job {job} until the interrupt"


def die(job: tuple[str, int]) -> str:
    """A job whose process ends at once; a positive number of times, or always if it is negative."""
    name, times = job
    if times:
        marks = sorted(Path(name).glob("*"))
        if len(marks) != times:
            (Path(name) / str(len(marks))).touch()
            time.sleep(0.2)  # until the other process has its job, too
            os._exit(3)
    return Path(name).name


def silent(number: int, fraction: float, line: str) -> None:
    """Drop the progress."""


@pytest.mark.slow
@pytest.mark.parametrize("system", ["linux", "darwin"])
def test_results_come_from_other_processes(system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Processes of Linux are forked, those of other systems start from nothing."""
    monkeypatch.setattr(jobs.sys, "platform", system)
    lines: list[tuple[int, float, str]] = []
    before = dict(os.environ)
    found = dict(run_jobs(square, [3.0, 2.0, 1.0], lambda *it: lines.append(it), 2))
    assert [found[k][0] for k in range(3)] == [9.0, 4.0, 1.0]
    assert os.getpid() not in [process for _, process, _ in found.values()]
    assert {threads for _, _, threads in found.values()} == {"1"}
    assert dict(os.environ) == before
    assert set(lines) <= {(0, 1.0, "job 3.0"), (1, 1.0, "job 2.0"), (2, 1.0, "job 1.0")}


def test_one_worker_computes_in_this_process() -> None:
    lines: list[Any] = []
    found = list(run_jobs(square, [2.0, 3.0], lambda *it: lines.append(it), 1))
    assert [(k, process) for k, (_, process, _) in found] == [(0, os.getpid()), (1, os.getpid())]
    assert lines == [(0, 1.0, "job 2.0"), (1, 1.0, "job 3.0")]


def deepen(job: int) -> int:
    """A job that calls itself without an end if it is 1."""
    return deepen(job) if job == 1 else job


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_unexpected_exception_of_a_job_leaves_the_other_results(workers: int) -> None:
    found = dict(run_jobs(deepen, [0, 1, 2], silent, workers))
    assert (found[0], found[2]) == (0, 2)
    assert isinstance(found[1], ConvergenceError) and found[1].kind is ErrorKind.DEFECT
    assert "RecursionError" in str(found[1]) and "test_jobs.py" in str(found[1])


def test_any_executor_computes_the_jobs() -> None:
    lines: list[Any] = []
    with ThreadPoolExecutor(2) as threads:
        found = dict(run_jobs(square, [2.0, 3.0], lambda *it: lines.append(it), threads))
    assert [found[k][0] for k in range(2)] == [4.0, 9.0]
    assert sorted(lines) == [(0, 1.0, "done"), (1, 1.0, "done")]


def test_threads_take_turns() -> None:
    """They share models, whose scratch arrays serve one job: a sweep on two threads was wrong."""
    running = set[int]()

    def alone(job: int) -> bool:
        running.add(job)
        time.sleep(0.05)
        others = len(running) - 1
        running.discard(job)
        return not others

    with ThreadPoolExecutor(2) as threads:
        found = dict(run_jobs(alone, [0, 1, 2, 3], silent, threads))
    assert all(found[k] for k in range(4))


@pytest.mark.parametrize("how", ["tell", "stop"])
def test_interrupt_yields_what_the_running_jobs_have(how: str) -> None:
    begun: list[int] = []

    def tell(number: int, fraction: float, line: str) -> None:
        begun.append(number)
        if how == "tell" and len(begun) == 2:
            raise KeyboardInterrupt

    def stop() -> bool:
        return how == "stop" and len(begun) >= 2

    found = {}
    with pytest.raises(KeyboardInterrupt), asking(stop):
        for number, result in run_jobs(endless, [0, 1, 2, 3], tell, 2):
            found[number] = result
    assert found == {k: f"job {k} until the interrupt" for k in (0, 1)}


@pytest.mark.slow
def test_job_runs_again_after_its_process_died(tmp_path: Path) -> None:
    """Job 0 kills its process twice, while job 1 runs; job 2 kills each process."""
    jobs = [(str(tmp_path / name), times) for name, times in (("a", 2), ("b", 0), ("c", -1))]
    for folder, _ in jobs:
        Path(folder).mkdir()
    found = dict(run_jobs(die, jobs, silent, 2))
    assert (found[0], found[1]) == ("a", "b")
    assert isinstance(found[2], ConvergenceError)
    assert len(list((tmp_path / "c").iterdir())) == LIVES


def test_executor_whose_process_dies_gives_errors(tmp_path: Path) -> None:
    with ProcessPoolExecutor(1, get_context("forkserver")) as executor:
        found = dict(run_jobs(die, [(str(tmp_path), -1)] * 2, silent, executor))
    assert [type(found[k]) for k in range(2)] == [ConvergenceError] * 2


@pytest.mark.slow
def test_cluster_runs_the_jobs_of_a_killed_worker_again(tmp_path: Path) -> None:
    """Two workers of a local Dask cluster; one is killed while it computes job 0."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0"
        ) as cluster,
        distributed.Client(cluster) as client,
        client.get_executor(pure=False) as executor,
    ):
        begun = tmp_path / "begun"
        results = run_jobs(wait_for_death, [begun, *range(3)], silent, executor)
        killer = Thread(target=kill, args=(begun,))
        killer.start()
        found = dict(results)
        killer.join()
    assert [found[k][0] for k in range(4)] == [begun, 0, 1, 2]
    first = int(begun.read_text())
    assert found[0][1] not in (first, os.getpid())


def wait_for_death(job: Any) -> tuple[Any, int]:
    """A job; if it is a path, its first process writes its number there, and waits."""
    if isinstance(job, Path) and not job.exists():
        job.write_text(str(os.getpid()))
        time.sleep(60.0)
    return job, os.getpid()


def kill(begun: Path) -> None:
    """Kill the process whose number is in a file, as soon as the file is there."""
    for _ in range(1000):
        if begun.exists() and (number := begun.read_text()):
            os.kill(int(number), signal.SIGKILL)
            return
        time.sleep(0.02)
