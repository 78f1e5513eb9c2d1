"""Files and folders that appear only when they are complete, and archives of checked arrays."""

import errno
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from fenicsrom.errors import ErrorKind, SceneError, refuse

try:
    import fcntl
except ModuleNotFoundError:  # Windows
    fcntl = None  # type: ignore[assignment]


OTHER_FILES = re.compile(
    rb"(?i)\b(include|merge|\w+FromFile|GetEnv|\w*SystemCall|Onelab\w*|input\s*=)|\.(h5|hdf5?)\b"
)
"""Words of a mesh file whose mesh depends on other files or on the environment."""


def reads_other_files(content: bytes) -> bool:
    """Whether the mesh of a file depends on more than the content of the file."""
    return OTHER_FILES.search(content) is not None


@contextmanager
def atomic_write(path: str | Path) -> Iterator[Path]:
    """Write a file that appears under its name only when it is complete.

    The body writes to a temporary path in the same folder (made if missing) with the same suffix.
    At the end the temporary file is flushed to the disk and renamed in one step. If anything stops
    the body (an error, a full disk, an interrupt, an exit), the temporary file is removed, and an
    earlier file of that name stays as it was.

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

    The body writes into a temporary folder beside `path`. At the end every file in it is flushed to
    the disk, and the folder is renamed; it **replaces an earlier folder of that name with all its
    content**. If anything stops the body, the temporary folder is removed, and the earlier folder
    stays as it was.

    Args:
        path: the folder to write.
        comm: an MPI communicator whose ranks all write into the folder. All ranks enter and leave
            together, but the body must not communicate, because it may fail on one rank only. Then
            the folder does not appear, and every rank raises.

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


@contextmanager
def locked_folder(path: Path, wait: bool = False) -> Iterator[bool]:
    """Hold a folder for this process until the body ends; the lock leaves no file behind.

    The operating system releases the lock of a process that dies. Systems without `fcntl`, such as
    Windows, have no lock.

    Args:
        path: the folder.
        wait: wait while another process holds it.

    Yields:
        Whether the folder is held; False if another process holds it.

    Raises:
        OSError: the folder cannot be opened.
    """
    if fcntl is None:
        yield True
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except OSError as error:  # file systems without locks refuse with another error
            yield error.errno not in (errno.EWOULDBLOCK, errno.EACCES)
            return
        try:
            yield True
        finally:
            fcntl.flock(handle, fcntl.LOCK_UN)  # also for processes that were forked in the body
    finally:
        os.close(handle)


def write_archive(
    path: Path, header: Mapping[str, Any], arrays: Mapping[str, Any], compress: bool = False
) -> None:
    """Write arrays and a header to an `.npz` file that appears only when it is complete.

    Args:
        path: the file to write.
        header: values that JSON can hold.
        arrays: numpy arrays by name.
        compress: whether to compress the arrays.

    Raises:
        OSError: the file cannot be written.
    """
    write = np.savez_compressed if compress else np.savez
    with atomic_write(path) as temporary, open(temporary, "wb") as file:
        write(file, header=np.array(json.dumps(header)), **arrays)


@contextmanager
def read_archive(
    path: Path, what: str, form: str, earlier: str = ""
) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Read a file that `write_archive` wrote; pickles are refused.

    The body turns header and arrays into an object. Any error in the body means that the file is
    damaged.

    Args:
        path: the file.
        what: what the file should hold, such as "a checkpoint".
        form: the entry "format" that its header should have.
        earlier: a prefix of "format". An entry with this prefix that differs from `form` was
            written by another version of the program, and the error says so. "" skips this check.

    Yields:
        The header, and the arrays by their names.

    Raises:
        SceneError: the file is missing, damaged or of another format.
    """
    try:
        with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            arrays = dict(file)
        header = json.loads(str(arrays.pop("header")))
        found = str(header["format"])
        if earlier and found.startswith(earlier) and found != form:
            reason = f"holds {what} of another version of this program ({found}, this version reads"
            raise refuse(path, f"{reason} {form}); run the scene again")
        if found != form:
            raise refuse(path, f"format = {found!r}: must be {form!r}")
        yield header, arrays
    except OSError as error:
        reason = f"cannot be read: {error.strerror or 'it is damaged'}"
        raise refuse(path, reason, ErrorKind.FILE) from None
    except SceneError as error:
        if error.source == str(path):
            raise
        raise refuse(path, f"the scene in it is damaged ({error})") from None
    except Exception as error:  # damaged bytes raise many kinds of errors in numpy and zipfile
        reason = f"is not {what} written by this program ({type(error).__name__})"
        raise refuse(path, reason) from None


@contextmanager
def _together(temporary: Path, path: Path, comm: Any) -> Iterator[None]:
    """Run the body on every rank, then raise on all ranks if one failed."""
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
    return path.with_name(f".{path.stem}.{os.urandom(6).hex()}{path.suffix}")


def _flush(file: Path) -> None:
    """Push the content of a file to the disk; Windows flushes only files that may be written."""
    with open(file, "rb" if os.name == "posix" else "rb+") as stream:
        os.fsync(stream.fileno())


def _swap(temporary: Path, path: Path) -> None:
    """Give a finished folder its name; restore the earlier folder if that fails."""
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
    """The same error with the file that the user knows, instead of the temporary file."""
    if error.errno is None or error.filename not in (None, str(temporary)):
        return error
    return OSError(error.errno, error.strerror, str(path))
