"""Compilation with numba, and the cache of the machine code."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from numba import njit


def _sources() -> str:
    """A digest of the modules whose compiled functions call each other."""
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


_SOURCES = _sources()


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function with numba, and keep the machine code for the next process.

    Numba keeps it until the function's own file changes, but it holds code of other files too: here
    it is kept until one of them changes.
    """
    dispatcher = njit(cache=True, error_model="numpy", **options)(function)
    with suppress(AttributeError):  # no public way; a numba built otherwise keeps to its own rule
        dispatcher._cache._cache_file._source_stamp = _SOURCES
    return dispatcher


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no arrays: numba then counts no references to those it is
    given.
    """
    return compiled(function, _nrt=False)


def part(function: Callable[..., Any]) -> Any:
    """A kernel that becomes a part of its callers: to hand on tuples of many arrays costs more than
    short functions do.
    """
    return compiled(function, _nrt=False, forceinline=True)
