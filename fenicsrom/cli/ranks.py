"""Errors of a run on several ranks: each sentence is printed once, and no rank waits forever."""

import os
import sys
import time
import traceback
from typing import Any

RANKS = ("OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK")  # where mpirun tells a process its rank
CLEAR = "\r\x1b[2K"  # of a terminal: go to the start of the line, and erase it
PATIENCE = 10.0  # s that a rank with an error waits for those of the others


def refuse(sentence: str, code: int) -> int:
    """Print an error; a rank is silent if a lower rank prints the same sentence.

    If a rank has no error, all are aborted, because that rank would wait for this one forever.
    """
    comm = all_ranks()
    if comm is None:
        return _say(sentence, code)
    every, last = comm.Ibarrier(), time.monotonic() + PATIENCE
    while not (ended := every.Test()) and time.monotonic() < last:
        time.sleep(0.01)
    if not ended:
        _say(sentence, code)
        time.sleep(1.0)  # mpirun forwards no output after the abort
        comm.Abort(code)
    return code if sentence in comm.allgather(sentence)[: comm.rank] else _say(sentence, code)


def is_idle() -> bool:
    """Whether mpirun started this process, and another rank runs the stored model alone."""
    ranks = (os.environ[name] for name in RANKS if name in os.environ)
    return next(ranks, "0") != "0"


def stopped(word: str, code: int) -> int:
    """Say on the first rank that the run was stopped; return the exit code."""
    comm = all_ranks()
    return _say(word, code) if comm is None or comm.rank == 0 else code


def abort_all() -> None:
    """Print the traceback of an unexpected exception of this rank, and end all ranks.

    The other ranks would wait for this rank forever. With one rank this does nothing.
    """
    comm = all_ranks()
    if comm is None:
        return
    traceback.print_exc()
    sys.stderr.flush()
    time.sleep(1.0)  # mpirun forwards no output after the abort
    comm.Abort(1)


def end_progress() -> None:
    """Remove the line of progress from a terminal, before something else is printed."""
    if sys.stderr.isatty():
        print(CLEAR, end="", file=sys.stderr, flush=True)


def _say(sentence: str, code: int) -> int:
    """Print a sentence to stderr; return the exit code."""
    end_progress()
    print(f"fenicsrom: {sentence}", file=sys.stderr, flush=True)
    return code


def all_ranks() -> Any:
    """Give the communicator of all ranks; None if MPI is not in use or has one rank."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi.COMM_WORLD if mpi and mpi.COMM_WORLD.size > 1 else None
