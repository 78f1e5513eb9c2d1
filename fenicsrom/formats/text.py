"""Reads text files of other programs, and the files that they include."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fenicsrom.errors import ErrorKind, SceneError, refuse

DEEPEST = 16
"""Files may include files to this depth; a file that includes itself would never end."""


MOST_NUMBERS = 10_000_000
"""A range of more numbers is damaged, and would fill the memory."""


def numbers_between(first: int, last: int, step: int = 1) -> range:
    """The numbers from the first to the last one, included.

    Raises:
        ValueError: the step is 0, or the range is too long.
    """
    found = range(first, last + 1, step)
    if last - first > MOST_NUMBERS * abs(step):
        raise ValueError(f"{first} to {last}: more than {MOST_NUMBERS} numbers")
    return found


def content_of(path: Path) -> bytes:
    """The bytes of a file.

    Raises:
        SceneError: the file cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise refuse(path, f"cannot be read: {error.strerror}", ErrorKind.FILE) from None


def read_lines(path: Path) -> list[str]:
    """The lines of a text file, without the ends of the lines."""
    text = content_of(path).decode("utf-8-sig", errors="replace")
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Refuse a file whose content raises an error where it is read.

    Raises:
        SceneError: the file is damaged.
    """
    try:
        yield
    except SceneError:
        raise
    except RecursionError:
        reason = "its sets or coordinate systems refer to each other without end"
        raise refuse(path, reason) from None
    except (ArithmeticError, LookupError, StopIteration, ValueError) as error:
        reason = (
            f"cannot be read; the file may be truncated or damaged ({error or 'it ends early'})"
        )
        raise refuse(path, reason) from None


def included(path: Path, name: str, what: str, depth: int) -> Path:
    """Find a file that another file includes.

    Args:
        path: the file that includes it.
        name: its path in that file, relative to the folder of that file.
        what: the keyword, for messages.
        depth: number of files that include each other so far.

    Raises:
        SceneError: the file does not exist, or files include each other without end.
    """
    found = path.parent / name.strip().strip("'\"").replace("\\", "/")
    if not found.is_file():
        raise refuse(path, f"{what} {name.strip()}: there is no file {found}", ErrorKind.FILE)
    if depth >= DEEPEST:
        raise refuse(path, f"{what} {name.strip()}: files include each other without end")
    return found
