"""Independent computations in several processes, with one progress and one interrupt.

A copy of a process that has started MPI or threads may hang. Therefore a server process, which
starts from nothing and only imports the program, forks the processes (the "forkserver" context).
Each loads the stored machine code once. Systems that cannot fork start each process from nothing.
"""

from __future__ import annotations

import atexit
import functools
import os
import queue
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import active_children, get_all_start_methods, get_context, parent_process
from typing import Any

from fenicsrom.errors import ConvergenceError

POLL = 0.02  # s between two looks at the messages of the processes
SERVER = "fenicsrom.assess.studies.worker_server"  # module that the server process imports
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

Tell = Callable[[int, float, str], None]
"""Receives the number of a job, its fraction that is done, and a line on its progress."""
Job = Callable[[Any, Callable[[float, str], None]], Any]
"""Computes a job; it receives the job and a function that takes its fraction and a line."""


def available_cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def start_server() -> None:
    """Start the server process, so that it imports the program while this process reads its input.

    Without this call it starts with the first jobs.
    """
    with _one_thread_each():
        _context()


@functools.cache
def _context() -> Any:
    """The way in which processes start (module docstring); starts the server process."""
    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    from multiprocessing import forkserver

    context = get_context("forkserver")
    context.set_forkserver_preload([SERVER])
    forkserver.ensure_running()
    # else the server would outlive this process for an instant
    atexit.register(forkserver._forkserver._stop)  # type: ignore[attr-defined]
    return context


def run_jobs(
    function: Job, jobs: Sequence[Any], tell: Tell, workers: int, stop: Callable[[], bool]
) -> Iterator[Any]:
    """Compute jobs and yield their results in order; in processes if there are several workers.

    `function` returns what it has when its progress callback raises KeyboardInterrupt. After an
    interrupt of this process (by `tell`, `stop` or the terminal) the callbacks of all jobs raise
    it, jobs that have not started are dropped, and the results of the others are yielded.

    Args:
        function: computes one job. With several workers it and the jobs must be picklable.
        jobs: its arguments.
        tell: receives the progress of all jobs; it may raise KeyboardInterrupt.
        workers: largest number of processes; 1 computes in this process.
        stop: asked often; the jobs are interrupted when it returns True.

    Yields:
        The result of each job, or the ConvergenceError of a job whose process was ended.

    Raises:
        KeyboardInterrupt: the computation was interrupted in a process; raised after all results.
    """
    workers = min(workers, len(jobs))
    if workers > 1:
        yield from _in_processes(function, jobs, tell, workers, stop)
        return
    for number, job in enumerate(jobs):

        def report(fraction: float, line: str, number: int = number) -> None:
            if stop():
                raise KeyboardInterrupt
            if line:
                tell(number, fraction, line)

        yield function(job, report)


def run_jobs_on_ranks(function: Job, jobs: Sequence[Any], tell: Tell, comm: Any) -> Iterator[Any]:
    """Compute jobs on the ranks of an MPI communicator; rank 0 gives out the jobs.

    Args:
        function: computes one job; the function and the jobs must be picklable.
        jobs: its arguments.
        tell: receives on rank 0 the number of each job that is done.
        comm: communicator of at least two ranks; all ranks must call this function.

    Yields:
        On rank 0 the result of each job, in order; on the others nothing.
    """
    from concurrent.futures import as_completed

    from mpi4py.futures import MPICommExecutor

    with MPICommExecutor(comm, root=0) as found:
        pool: Any = found  # None on the ranks that work
        if pool is None:
            return
        futures = {pool.submit(function, job, _silent): k for k, job in enumerate(jobs)}
        for future in as_completed(futures):
            future.result()
            tell(futures[future], 1.0, f"job {futures[future] + 1}")
    for future in futures:
        yield future.result()


def _silent(fraction: float, line: str) -> None:
    """Report nothing."""


def _in_processes(
    function: Job, jobs: Sequence[Any], tell: Tell, workers: int, stop: Callable[[], bool]
) -> Iterator[Any]:
    """`run_jobs` with several processes."""
    start_server()
    context, others = _context(), active_children()
    messages, stopped = context.Queue(), context.Event()
    with (
        _one_thread_each() as environment,
        ProcessPoolExecutor(
            workers, context, _start_worker, (messages, stopped, environment)
        ) as pool,
    ):
        futures = [pool.submit(_work, function, job, k) for k, job in enumerate(jobs)]
        for future in futures:
            while not future.done():
                try:
                    _pass_on(messages, tell, stop, stopped)
                except KeyboardInterrupt:
                    stopped.set()
                    for other in futures:
                        other.cancel()
            try:
                result = _result(future)
            except CancelledError:
                continue
            if isinstance(result, ConvergenceError):  # the pool waits for its other processes
                for process in set(active_children()) - set(others):
                    process.kill()
            yield result
    if stopped.is_set():
        raise KeyboardInterrupt


def _pass_on(messages: Any, tell: Tell, stop: Callable[[], bool], stopped: Any) -> None:
    """Pass on the next message of the processes, if one arrives within `POLL`.

    Raises:
        KeyboardInterrupt: `tell` raised it, or `stop` returned True for the first time.
    """
    if stop() and not stopped.is_set():
        raise KeyboardInterrupt
    try:
        message = messages.get(timeout=POLL)
    except queue.Empty:
        return
    if not stopped.is_set():
        tell(*message)


def _result(future: Future[Any]) -> Any:
    """The result of a job, or the error if its process was ended.

    Raises:
        CancelledError: the job was dropped before it began.
    """
    try:
        return future.result()
    except BrokenProcessPool:
        return ConvergenceError(
            "a process of the computation was ended from outside; it may have lacked memory"
        )


@contextmanager
def _one_thread_each() -> Iterator[dict[str, str]]:
    """Let the processes that start in the body use one thread each; yield their environment."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield dict(os.environ)
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


_shared: dict[str, Any] = {"terminated": False}


def _start_worker(messages: Any, stopped: Any, environment: dict[str, str]) -> None:
    """Keep the channels of a process, take the environment of the parent, and end with it.

    An interrupt of the terminal is left to the parent. SIGTERM, which batch systems send to all
    processes, ends the job at its next report, so that what it has is not lost.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _note_termination)
    os.environ.clear()
    os.environ.update(environment)
    messages.cancel_join_thread()  # the last messages may be lost, and nobody waits for them
    _shared.update(messages=messages, stopped=stopped)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _note_termination(number: int, frame: object) -> None:
    """Note that this process was asked to end."""
    _shared["terminated"] = True


def _end_with_parent() -> None:
    """End this process when its parent has ended."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(function: Job, job: Any, number: int) -> Any:
    """Compute a job in a process of the pool.

    Raises:
        CancelledError: the computation was interrupted before this job began.
    """
    if _shared["stopped"].is_set():
        raise CancelledError

    def report(fraction: float, line: str) -> None:
        if _shared["terminated"] or _shared["stopped"].is_set():
            raise KeyboardInterrupt
        if line:
            _shared["messages"].put((number, fraction, line))

    return function(job, report)
