"""Files and folders that appear whole or not at all, and archives of arrays that are read with
distrust.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.errors import ErrorKind, SceneError


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Write a file that appears under its name only when it is complete.

    The body writes to the temporary path it is given, in the same folder (made if missing) and with
    the same suffix. At the end the temporary file is flushed to the disk and takes the name in one
    step. Whatever stops the body (an error, a full disk, an interrupt, an exit) removes it, and a
    file that had the name before stays as it was.

    Args:
        path: the file to write.

    Yields:
        The temporary path to write to.

    Raises:
        OSError: the file cannot be written; the error names `path`.
    """
    path = Path(path)
    temporary = _beside(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield temporary
        _flush(temporary)
        os.replace(temporary, path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise _named(error, temporary, path) from error
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


@contextmanager
def atomic_folder(path: str | Path, comm: Any = None) -> Iterator[Path]:
    """Write a folder that appears under its name only when everything in it is complete.

    The body writes into a temporary folder beside `path`; at the end every file in it is flushed to
    the disk and the folder takes the name, **replacing the folder that had it, with all its
    content**. Whatever stops the body removes the temporary folder and leaves the older one as it
    was.

    Args:
        path: the folder to write.
        comm: an MPI communicator whose ranks all write into the folder. The call is collective, the
            body must not
            be: when one rank fails, the folder does not appear and every rank raises.

    Yields:
        The temporary folder to write into, the same on every rank.

    Raises:
        OSError: the folder cannot be written, here or on another rank; the error names `path`.
    """
    path = Path(path)
    first = comm is None or comm.rank == 0
    temporary = _beside(path) if comm is None else comm.bcast(_beside(path))
    try:
        with _together(temporary, path, comm):
            if first:
                temporary.mkdir(parents=True)
        with _together(temporary, path, comm):
            yield temporary
        with _together(temporary, path, comm):
            if first:
                for file in temporary.rglob("*"):
                    if file.is_file():
                        _flush(file)
                _swap(temporary, path)
    finally:
        if first:
            shutil.rmtree(temporary, ignore_errors=True)


def write_archive(
    path: Path, header: Mapping[str, Any], arrays: Mapping[str, Any], compress: bool = False
) -> None:
    """Write arrays as an `.npz` with a header of what JSON can hold; the file appears whole or not
    at all.

    Raises:
        OSError: it cannot be written.
    """
    write = np.savez_compressed if compress else np.savez
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        write(file, header=np.array(json.dumps(header)), **arrays)


@contextmanager
def read_archive(
    path: Path, what: str, form: str
) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Read what `write_archive` wrote, or what pretends to be: pickles are refused.

    The body makes of header and arrays what they stand for; whatever it raises means that the file
    is damaged.

    Args:
        path: the file.
        what: it should be, such as "a checkpoint".
        form: what its header should have under "format".

    Yields:
        The header, and the arrays by their names.

    Raises:
        SceneError: the file is missing, damaged or of another format; one line that begins with its
            path.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of entries that overlap: someone has been at the file
            with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
                arrays = {name: np.array(file[name]) for name in file.files}
            header = json.loads(str(arrays.pop("header")[()]))
        if header.get("format") != form:
            raise _damaged(path, f"{path}: format = {header.get('format')!r}: must be {form!r}")
        yield header, arrays
    except FileNotFoundError:
        raise SceneError(
            f"{path}: cannot be read: no such file", kind=ErrorKind.FILE, source=str(path)
        ) from None
    except OSError as error:
        raise SceneError(
            f"{path}: cannot be read: {error.strerror or 'it is damaged'}",
            kind=ErrorKind.FILE,
            source=str(path),
        ) from None
    except SceneError as error:
        if error.source == str(path):
            raise
        raise _damaged(path, f"{path}: the scene in it is damaged ({error})") from None
    except (
        Exception
    ) as error:  # damaged bytes make numpy, zipfile and zlib raise whatever they have
        reason = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise _damaged(path, f"{path}: is not {what} written by this program ({reason})") from None


def _damaged(path: Path, text: str) -> SceneError:
    """The error of a damaged file, from the first line of a text, shortened."""
    return SceneError(text.splitlines()[0][:500], kind=ErrorKind.FORMAT, source=str(path))


@contextmanager
def _together(temporary: Path, path: Path, comm: Any) -> Iterator[None]:
    """Let every rank do its part, then raise on all of them if one failed."""
    failure: BaseException | None = None
    try:
        yield
    except OSError as error:
        failure = _named(error, temporary, path)
    except BaseException as error:
        failure = error
    failed = [failure is not None] if comm is None else comm.allgather(failure is not None)
    if failure is not None:
        raise failure
    if any(failed):
        raise OSError(f"{path} was not written: rank {failed.index(True)} failed")


def _beside(path: Path) -> Path:
    """A hidden name in the same folder, unused, with the same suffix."""
    return path.with_name(f".{path.stem}.{secrets.token_hex(6)}{path.suffix}")


def _flush(file: Path) -> None:
    """Push the content of a file to the disk."""
    with open(file, "rb") as stream:
        os.fsync(stream.fileno())


def _swap(temporary: Path, path: Path) -> None:
    """Give a finished folder its name; the older folder comes back if that fails."""
    if not path.exists():
        os.rename(temporary, path)
        return
    older = _beside(path)
    os.rename(path, older)
    try:
        os.rename(temporary, path)
    except BaseException:
        os.rename(older, path)
        raise
    shutil.rmtree(older) if older.is_dir() else older.unlink()


def _named(error: OSError, temporary: Path, path: Path) -> OSError:
    """The same error, naming the file the user knows instead of the temporary one (or none)."""
    if error.errno is None or error.filename not in (None, str(temporary)):
        return error
    return OSError(error.errno, error.strerror, str(path))
