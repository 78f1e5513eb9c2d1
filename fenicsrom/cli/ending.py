"""The end of a command: its printed report and its exit code."""

from __future__ import annotations

from typing import Any

from fenicsrom.cli.printing import print_results


def finish(found: Any, comm: Any) -> int:
    """Print the report of a record, and end as its computation did.

    Args:
        found: the record, such as `fenicsrom.response` returns it.
        comm: the communicator; None without MPI.

    Returns:
        The exit code 0.

    Raises:
        KeyboardInterrupt: the computation was interrupted.
        ConvergenceError, AccuracyError: the error that ended the computation.
    """
    if found.files:  # this rank wrote results
        from fenicsrom.post.reports import report

        shown = report(found)
        print_results(found.scene, shown.text(), shown.warnings, (), found.files, shown.varied)
    if getattr(found, "interrupted", False):
        raise KeyboardInterrupt
    return end(comm, getattr(found, "unfinished", None))


def end(comm: Any, error: Exception | None) -> int:
    """Give the exit code 0, or raise the error after the first rank has written its files.

    Raises:
        ConvergenceError, AccuracyError: the given error.
    """
    if error is None:
        return 0
    if comm is not None:
        comm.barrier()
    raise error
