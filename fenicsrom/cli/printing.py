"""Prints progress to stderr and results to stdout, and ends a command as its computation did."""

import logging
import shutil
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from fenicsrom.cli.ranks import CLEAR, all_ranks, end_progress
from fenicsrom.cli.termination import is_terminated
from fenicsrom.errors import printable
from fenicsrom.progress import log
from fenicsrom.scene import Scene, scene_heading
from fenicsrom.scene.reading.overrides import units_sentence


def progress(line: str) -> None:
    """Show progress on stderr; stop a serial run if SIGTERM arrived.

    On a terminal, each line takes the place of the one before it; elsewhere, lines follow each
    other.
    """
    if is_terminated() and all_ranks() is None:
        raise KeyboardInterrupt
    if not sys.stderr.isatty():
        print(line, file=sys.stderr, flush=True)
        return
    width = shutil.get_terminal_size().columns - 1
    print(f"{CLEAR}{printable(line.strip())[:width]}", end="", file=sys.stderr, flush=True)


class _Shown(logging.Handler):
    """Shows messages as progress."""

    def emit(self, record: logging.LogRecord) -> None:
        """Show a message."""
        progress(record.getMessage())


@contextmanager
def logged_progress(quiet: bool) -> Iterator[None]:
    """Show the messages of the logger `fenicsrom` in the body, on stderr; none if `quiet`."""
    handler, level = logging.NullHandler() if quiet else _Shown(logging.INFO), log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)


def print_results(
    scene: Scene | None,
    table: str,
    warnings: Sequence[str],
    sentences: Sequence[str] = (),
    files: Sequence[Path] = (),
    varied: Collection[str] = (),
) -> None:
    """Print the title of the scene, a table, warnings, sentences and the list of written files.

    Characters that a terminal would interpret are escaped. The title leaves out the varied keys.
    """
    end_progress()
    print()
    if scene is not None and scene.title:
        print(printable(scene_heading(scene, varied)))
    if scene is not None and (sentence := units_sentence(scene)):
        print(sentence)
    if table:
        print(table)
    for warning in warnings:
        print(f"warning: {printable(warning)}")
    for sentence in sentences:
        print(printable(sentence))
    print("files:")
    for path in files:
        print(f"  {printable(str(path))}")


def finish(found: Any, comm: Any) -> int:
    """Print the report of a record, and end as its computation did.

    Args:
        found: the record, such as `fenicsrom.response` returns it.
        comm: the communicator; None without MPI.

    Returns:
        The exit code: 0, or 1 if the record says that a part of it failed.

    Raises:
        KeyboardInterrupt: the computation was interrupted.
        ConvergenceError, AccuracyError: the error that ended the computation.
    """
    from fenicsrom.post.base.page import failure_of
    from fenicsrom.post.reports import report

    if found.files and (comm is None or comm.rank == 0):
        shown = report(found)
        table, said = shown.text(), [shown.verdict.text]
        print_results(found.scene, table, shown.warnings, said, found.files, shown.varied)
    if getattr(found, "interrupted", False):
        raise KeyboardInterrupt
    if (error := failure_of(found)) is None:
        return int(getattr(found, "failed", False))
    if comm is not None:
        comm.barrier()  # the first rank writes its files
    raise error
