"""Errors of a run on several ranks: each sentence is printed once, and no rank waits forever."""

import os
import sys
import time
import traceback
from collections.abc import Sequence
from typing import Any

RANKS = (
    "OMPI_COMM_WORLD_RANK",
    "PMIX_RANK",
    "PMI_RANK",
)  # in which mpirun tells a process its rank
CLEAR = "\r\x1b[2K"  # of a terminal: go to the start of the line, and erase it
REFUSED = 77  # MPI tag of the messages by which ranks tell each other about an error
PATIENCE = 10.0  # s that a rank waits for such a message before it assumes that the others continue


def refuse(sentence: str, code: int) -> int:
    """Print an error; a rank is silent if a lower rank prints the same sentence.

    Ranks without an error are aborted, because they would wait for this rank forever.
    """
    comm = all_ranks()
    if comm is None:
        return _say(sentence, code)
    sent = [comm.isend(sentence, rank, REFUSED) for rank in range(comm.size) if rank != comm.rank]
    last = time.monotonic() + PATIENCE
    heard = _heard(comm, range(comm.rank), last)
    if sentence not in heard:
        _say(sentence, code)
    if None in heard + _heard(comm, range(comm.rank + 1, comm.size), last):
        time.sleep(1.0)  # mpirun forwards no output after the abort
        comm.Abort(code)
    for request in sent:
        request.wait()
    return code


def is_idle() -> bool:
    """Whether mpirun started this process, and another rank runs the stored model alone."""
    ranks = (os.environ[name] for name in RANKS if name in os.environ)
    return next(ranks, "0") != "0"


def _heard(comm: Any, ranks: Sequence[int], last: float) -> list[str | None]:
    """Receive the errors of some ranks; None for a rank that sends nothing until the last moment.

    Args:
        comm: the communicator.
        ranks: the ranks to listen to.
        last: the last moment, in s on the monotonic clock.
    """
    found = []
    for rank in ranks:
        while not (there := comm.iprobe(rank, REFUSED)) and time.monotonic() < last:
            time.sleep(0.01)
        found.append(comm.recv(source=rank, tag=REFUSED) if there else None)
    return found


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
