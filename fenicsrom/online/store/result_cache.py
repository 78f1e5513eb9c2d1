"""The cache of results: a folder of archives with a limit of their total size.

The name of an archive is its key, a hash of all that its results depend on. An archive appears only
when it is complete, so that runs may share the folder. Using an archive renews its time; the oldest
ones are removed when the limit is exceeded. `FENICSROM_CACHE` names another folder, or is "off".
"""

import hashlib
import json
import os
import re
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.files import read_archive, reads_other_files, write_archive
from fenicsrom.online.store.provenance import provenance
from fenicsrom.progress import log

VARIABLE = "FENICSROM_CACHE"
OFF = "off"

LIBRARIES = "numpy scipy numba gmsh meshio fenics-basix fenics-dolfinx petsc4py slepc4py".split()

PACKAGE = Path(__file__).parents[2]

Results = TypeVar("Results")

LIMIT = 5_000_000_000
"""Largest total size in bytes; a model of 300,000 unknowns takes a tenth of it."""

ARCHIVE = re.compile(r"([0-9a-f]{40}|\.[0-9a-f]{40}\.[0-9a-f]{12})\.npz")
"""Names of archives and of their temporary files; other files of the folder are not ours."""

ABANDONED = 3600.0
"""Age in s of a temporary file of a run that was killed; others write theirs within a minute."""


@dataclass(frozen=True)
class Entry:
    """One archive.

    Attributes:
        path: its file.
        size: bytes.
        used: time of the last use, s since the epoch.
    """

    path: Path
    size: int
    used: float


def cache_folder() -> Path | None:
    """The folder of the results; None if the cache is switched off.

    Raises:
        SceneError: the environment variable names a file.
    """
    given = os.environ.get(VARIABLE, "")
    if given.lower() == OFF:
        return None
    if not given:
        home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        return Path(home) / "fenicsrom" / "results"
    if Path(given).exists() and not Path(given).is_dir():
        raise SceneError(
            f'{VARIABLE} = {given}: is not a folder; name a folder, or "{OFF}"',
            kind=ErrorKind.FILE,
            key=VARIABLE,
            source=given,
        )
    return Path(given)


def mesh_digest(mesh: Path) -> str | None:
    """A hash of the content of a mesh file; None if the mesh depends on other files.

    Raises:
        OSError: the file cannot be read.
    """
    content = mesh.read_bytes()
    return None if reads_other_files(content) else hashlib.sha256(content).hexdigest()


def key_of(table: Any) -> str:
    """A hash of plain data and of the program: its modules, its libraries, the options of PETSc."""
    program = provenance(LIBRARIES) | {"package": package_digest(PACKAGE)}
    program |= {name: os.environ.get(name, "") for name in ("PETSC_OPTIONS", "OMP_NUM_THREADS")}
    return hashlib.sha256(json.dumps([table, program], sort_keys=True).encode()).hexdigest()


def package_digest(folder: Path) -> str:
    """SHA-256 of the names and the content of all modules in a folder."""
    digest = hashlib.sha256()
    for module in sorted(folder.rglob("*.py")):
        content = hashlib.sha256(module.read_bytes()).hexdigest()
        digest.update(f"{module.relative_to(folder)} {content}\n".encode())
    return digest.hexdigest()


def read_results(
    folder: Path, key: str, what: str, take: Callable[[Any, Any], Results]
) -> Results | None:
    """Read an archive; None if it is missing. A damaged one is removed.

    Args:
        folder: the folder of the cache.
        key: of the results.
        what: the archive should hold, such as "a motion".
        take: makes an object of the header and the arrays.
    """
    path = archive_of(folder, key)
    if not path.exists():
        return None
    try:
        with read_archive(path, what, key) as (header, arrays):
            found = take(header, arrays)
    except SceneError:
        _remove(path)
        return None
    with suppress(OSError):
        os.utime(path)
    return found


def write_results(
    folder: Path, key: str, what: str, header: dict[str, Any], arrays: dict[str, Any]
) -> None:
    """Write an archive, and keep the folder below its limit; a full disk costs only time.

    Args:
        folder: the folder of the cache.
        key: of the results.
        what: the archive holds, such as "a motion".
        header: plain data.
        arrays: by their names.
    """
    try:
        write_archive(archive_of(folder, key), {**header, "format": key}, arrays)
    except OSError as error:
        log.info(f"{what} was not stored in the cache: {error}")
    trim(folder)


def archive_of(folder: Path, key: str) -> Path:
    """The file of a key."""
    return folder / f"{key[:40]}.npz"


def entries(folder: Path) -> list[Entry]:
    """The archives of a folder, and abandoned temporary files, the oldest first.

    Another run may remove one at any time.
    """
    found = []
    with suppress(OSError):
        for path in folder.iterdir():
            if ARCHIVE.fullmatch(path.name):
                with suppress(OSError):
                    status = path.stat()
                    abandoned = status.st_mtime < time.time() - ABANDONED
                    if abandoned or not path.name.startswith("."):
                        found.append(Entry(path, status.st_size, status.st_mtime))
    return sorted(found, key=lambda entry: entry.used)


def trim(folder: Path, limit: int = LIMIT) -> None:
    """Remove the oldest archives until the others fit into the limit."""
    kept = entries(folder)
    size = sum(entry.size for entry in kept)
    for entry in kept:
        if size <= limit:
            return
        _remove(entry.path)
        size -= entry.size


def clear(folder: Path) -> int:
    """Remove all archives; give their number."""
    found = entries(folder)
    for entry in found:
        _remove(entry.path)
    return len(found)


def _remove(path: Path) -> None:
    """Remove an archive, if it is still there and may be removed."""
    with suppress(OSError):
        path.unlink()
