"""The cache of offline results: a folder of archives with a limit of their total size.

An archive appears only when it is complete, so that runs may share the folder. Using an archive
renews its time; the oldest ones are removed when the limit is exceeded. `FENICSROM_CACHE` names
another folder, or is "off".
"""

from __future__ import annotations

import os
import re
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.files import CACHE_OFF, CACHE_VARIABLE, cache_is_off

LIMIT = 5_000_000_000
"""Largest total size in bytes; a model of 300,000 unknowns takes a tenth of it."""

SUFFIX = ".npz"
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
    """The folder of the offline results; None if the cache is switched off.

    Raises:
        SceneError: the environment variable names a file.
    """
    if cache_is_off():
        return None
    given = os.environ.get(CACHE_VARIABLE)
    if given:
        if Path(given).exists() and not Path(given).is_dir():
            raise SceneError(
                f'{CACHE_VARIABLE} = {given}: is not a folder; name a folder, or "{CACHE_OFF}"',
                kind=ErrorKind.FILE,
                key=CACHE_VARIABLE,
                source=given,
            )
        return Path(given)
    from fenicsrom.assess.full.full_cache import cache_folder

    return cache_folder() / "offline"


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
        remove(entry.path)
        size -= entry.size


def clear(folder: Path) -> int:
    """Remove all archives; give their number."""
    found = entries(folder)
    for entry in found:
        remove(entry.path)
    return len(found)


def renew(path: Path) -> None:
    """Note that an archive was used."""
    with suppress(OSError):
        os.utime(path)


def remove(path: Path) -> None:
    """Remove an archive, if it is still there and may be removed."""
    with suppress(OSError):
        path.unlink()
