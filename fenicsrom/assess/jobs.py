"""Independent computations by the workers of a `concurrent.futures.Executor`.

The workers are processes of this machine, the ranks of an MPI communicator or those of an executor
that the caller gives, such as a Dask cluster. All workers must see the output folder.

A copy of a process that has started MPI or threads may hang. Therefore a server process, which
starts from nothing and only imports the program, forks the processes of this machine (the
"forkserver" context). Windows cannot fork, and libraries of macOS may crash in a copy: there, each
process starts from nothing.
"""

import os
import queue
import signal
import sys
import threading
import time as clock
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent import futures
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from multiprocessing import active_children, get_context, parent_process
from typing import Any, NamedTuple, cast

from fenicsrom.errors import ConvergenceError, job_error
from fenicsrom.progress import ask, asking

POLL = 0.02  # s between two looks at the messages of the processes
PATIENCE = 5.0  # s in which interrupted processes end their jobs, before they are killed
LIVES = 3  # a job is given up when so many workers have died with it
SERVER = "fenicsrom.assess.studies.worker_server"  # module that the server process imports
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

_TURN = threading.Lock()
"""Held by a job: the threads of a Dask worker share models, whose scratch arrays serve one job."""

Tell = Callable[[int, float, str], None]
"""Receives the number of a job, its fraction that is done, and a line on its progress."""
Job = Callable[[Any], Any]
"""Computes a job."""
Workers = int | futures.Executor
"""The largest number of processes of this machine (1: this process), or an executor."""


_tell: ContextVar[Callable[[float, str], None]] = ContextVar("tell")


def report(fraction: float, line: str) -> None:
    """Tell whoever runs the present job its fraction that is done, and a line on its progress."""
    if (tell := _tell.get(None)) is not None:
        tell(fraction, line)


def available_cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return min(os.cpu_count() or 1, 61)  # Windows waits for no more processes than these


def run_jobs(
    function: Job,
    jobs: Sequence[Any],
    tell: Tell,
    workers: Workers = 1,
    comm: Any = None,
) -> Iterator[tuple[int, Any]]:
    """Compute jobs, and yield the number and the result of each job when it ends.

    `function` may `report` its progress, and returns what it has when `fenicsrom.progress.ask`
    raises KeyboardInterrupt. After an interrupt of this process (by `tell`, `ask` or the terminal),
    jobs that have not started are dropped. In jobs of this process and of its child processes,
    `ask` raises KeyboardInterrupt, and their results are yielded. A child process that then needs
    more than `PATIENCE` is killed, without a result.

    If a process of this machine dies, its jobs run again, one at a time. A Dask cluster runs such
    jobs again by itself.

    Args:
        function: computes one job. Unless it runs here, it and the jobs must be picklable.
        jobs: its arguments.
        tell: receives the progress of all jobs; it may raise KeyboardInterrupt.
        workers: compute the jobs.
        comm: MPI communicator; with several ranks, which all must call this function, rank 0 gives
            out the jobs to the others, and all ranks get all results.

    Yields:
        Number and result of each job. The result is an error if the job raised one, whatever it is,
        or if its workers died: the other jobs go on.

    Raises:
        KeyboardInterrupt: the computation was interrupted; raised after all results.
    """
    if comm is not None and comm.size > 1 and not isinstance(workers, futures.Executor):
        yield from _on_ranks(function, jobs, tell, comm)
        return
    if isinstance(workers, int) and min(workers, len(jobs)) <= 1:
        yield from _here(function, jobs, tell)
        return
    waiting, deaths = dict(enumerate(jobs)), Counter[int]()
    while waiting:
        suspect = [k for k in waiting if deaths[k]][:1]
        batch = {k: waiting[k] for k in suspect or waiting}
        with _pool(workers, len(batch)) as pool:
            for number, result in _results(pool, function, batch, tell):
                if isinstance(result, _deadly()):
                    deaths[number] += 1
                    if pool.stopped is not None and deaths[number] < LIVES:
                        continue
                    result = ConvergenceError(
                        "the process of this computation ended again and again; it may have "
                        "lacked memory"
                    )
                del waiting[number]
                yield number, result


def _here(function: Job, jobs: Sequence[Any], tell: Tell) -> Iterator[tuple[int, Any]]:
    """`run_jobs` in this process."""
    for number, job in enumerate(jobs):
        yield number, _result(function, job, partial(tell, number))


def _result(function: Job, job: Any, tell: Callable[[float, str], None]) -> Any:
    """The result of a job, whose progress goes to `tell`, or the error that ended the job."""
    outer = _tell.set(tell)
    try:
        return function(job)
    except Exception as error:
        return job_error(error)
    finally:
        _tell.reset(outer)


def _on_ranks(
    function: Job, jobs: Sequence[Any], tell: Tell, comm: Any
) -> Iterator[tuple[int, Any]]:
    """`run_jobs` on the ranks of a communicator."""
    from mpi4py.futures import MPICommExecutor

    found: Any = None
    # the executor is None on the ranks that work
    with MPICommExecutor(comm, root=0) as executor:
        if executor is not None:
            try:
                found = list(run_jobs(function, jobs, tell, cast(futures.Executor, executor)))
            except KeyboardInterrupt as interrupt:
                found = interrupt
    found = comm.bcast(found)
    if isinstance(found, KeyboardInterrupt):
        raise found
    yield from found


class _Pool(NamedTuple):
    """An executor, and how many jobs it receives at a time.

    Attributes:
        executor: the executor.
        room: number of jobs that wait or run in it at the same time.
        messages: receives the progress of child processes; None for other workers.
        stopped: event that stops the jobs of child processes; None for other workers.
        kill: ends the child processes at once.
    """

    executor: futures.Executor
    room: int
    messages: Any = None
    stopped: Any = None
    kill: Callable[[], None] = lambda: None


def _deadly() -> tuple[type[Exception], ...]:
    """The errors that say that a worker died with its job."""
    distributed = sys.modules.get("distributed")
    return (futures.BrokenExecutor, *((distributed.KilledWorker,) if distributed else ()))


def _results(
    pool: _Pool, function: Job, batch: Mapping[int, Any], tell: Tell
) -> Iterator[tuple[int, Any]]:
    """Yield number and result of each job of a batch; arguments as `run_jobs`.

    The result is one of `_deadly` if the worker died. If it was a process of this machine, jobs of
    the batch that have not begun are then left out.
    """
    order, running, interrupted, last = deque(batch), dict[Any, int](), False, float("inf")
    while order or running:
        if clock.monotonic() > last:
            pool.kill()
        done = set[Any]()
        try:
            while order and len(running) < pool.room:
                number = order.popleft()
                running[pool.executor.submit(_work, function, batch[number], number)] = number
            done = futures.wait(running, POLL, futures.FIRST_COMPLETED).done
            if not interrupted:
                _pass_on(pool, tell)
                ask()
        except futures.BrokenExecutor as error:
            if pool.stopped is not None:
                order.clear()
            yield number, error
        except KeyboardInterrupt:
            interrupted = True
            order.clear()
            for future in running:
                future.cancel()
            if pool.stopped is None:
                raise
            pool.stopped.set()
            last = min(last, clock.monotonic() + PATIENCE)
        for future in done:
            number, result = running.pop(future), None
            try:
                result = future.result()
            except futures.CancelledError:
                continue
            except _deadly() as error:
                result = error
                if pool.stopped is not None:
                    order.clear()
                    pool.kill()  # the executor waits for the other processes
            except Exception as error:  # the result could not be sent
                result = job_error(error)
            if pool.stopped is None:
                tell(number, 1.0, "done")
            yield number, result
    if interrupted:
        raise KeyboardInterrupt


def _pass_on(pool: _Pool, tell: Tell) -> None:
    """Pass on the messages that the processes have sent."""
    try:
        while pool.messages is not None:
            tell(*pool.messages.get_nowait())
    except queue.Empty:
        pass


@contextmanager
def _pool(workers: Workers, count: int) -> Iterator[_Pool]:
    """The executor of the caller, or new processes of this machine, for so many jobs."""
    if isinstance(workers, futures.Executor):
        yield _Pool(workers, count)
        return
    room, kind = min(workers, count), "forkserver" if sys.platform == "linux" else "spawn"
    context: Any = get_context(kind)
    with _one_thread_each() as environment:
        if kind == "forkserver":
            context.set_forkserver_preload([SERVER])
        messages, stopped = context.Queue(), context.Event()
        others = set(active_children())

        def kill() -> None:
            for process in set(active_children()) - others:
                process.kill()

        with futures.ProcessPoolExecutor(
            room, context, _start_worker, (messages, stopped, environment)
        ) as executor:
            try:
                yield _Pool(executor, room, messages, stopped, kill)
            finally:
                stopped.set()


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


_channel: dict[str, Any] = {}  # of this process, if it is a child process that computes jobs


def _start_worker(messages: Any, stopped: Any, environment: dict[str, str]) -> None:
    """Keep the channel of a process, take the environment of the parent, and end with it.

    Ctrl-C, which a terminal sends to all processes, is handled by the parent.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.clear()
    os.environ.update(environment)
    messages.cancel_join_thread()  # the last messages may be lost, and nobody waits for them
    _channel.update(messages=messages, stopped=stopped)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when its parent has ended."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def _work(function: Job, job: Any, number: int) -> Any:
    """Compute a job in a worker.

    Raises:
        CancelledError: the computation was interrupted before this job began.
    """
    if not _channel:
        with _TURN:
            return _result(function, job, lambda *_: None)
    if _channel["stopped"].is_set():
        raise futures.CancelledError
    with asking(_channel["stopped"].is_set):
        return _result(function, job, lambda *said: _channel["messages"].put((number, *said)))
