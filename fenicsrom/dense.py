"""Small dense matrices, compiled: the reduced model meets millions, each too small for BLAS and LAPACK to pay."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _sources() -> str:
    """A digest of the modules whose compiled functions call each other."""
    digest = hashlib.sha256()
    for name in ("dense", "contact", "signals", "reduced", "integrate"):
        digest.update(Path(__file__).with_name(f"{name}.py").read_bytes())
    return digest.hexdigest()


_SOURCES = _sources()


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """Compile a function with numba, and keep the machine code for the next process.

    Numba keeps it until the function's own file changes, but it holds code of other files too: here it is kept until one
    of them changes.
    """
    dispatcher = njit(cache=True, error_model="numpy", **options)(function)
    with suppress(AttributeError):  # no public way; a numba built otherwise keeps to its own rule
        dispatcher._cache._cache_file._source_stamp = _SOURCES
    return dispatcher


def kernel(function: Callable[..., Any]) -> Any:
    """Compile a function that makes no arrays: numba then counts no references to those it is given."""
    return compiled(function, _nrt=False)


def part(function: Callable[..., Any]) -> Any:
    """A kernel that becomes a part of its callers: to hand on tuples of many arrays costs more than short functions do."""
    return compiled(function, _nrt=False, forceinline=True)


@compiled
def times(a: Array, x: Array) -> Array:
    """A x for a matrix a (n, k) and a vector x (k,)."""
    result = np.empty(a.shape[0])
    for i in range(a.shape[0]):
        value = 0.0
        for j in range(a.shape[1]):
            value += a[i, j] * x[j]
        result[i] = value
    return result


@kernel
def write_times(a: Array, x: Array, out: Array) -> None:
    """Write A x (n,) for a matrix a (n, k) and a vector x (k,)."""
    for i in range(a.shape[0]):
        value = 0.0
        for j in range(a.shape[1]):
            value += a[i, j] * x[j]
        out[i] = value


@kernel
def add_times(offset: Array, a: Array, x: Array, out: Array) -> None:
    """Write offset + A x (n,) for a matrix a (n, k) and a vector x (k,)."""
    for i in range(a.shape[0]):
        value = offset[i]
        for j in range(a.shape[1]):
            value += a[i, j] * x[j]
        out[i] = value


@kernel
def inner(x: Array, y: Array) -> float:
    """Inner product of two vectors."""
    value = 0.0
    for i in range(x.size):
        value += x[i] * y[i]
    return value


@kernel
def add_combined_rows(weights: Array, rows: Array, out: Array) -> None:
    """Add weights @ rows to out; (k, r), (r, n), (k, n), k small.

    Three rows are taken at a time, for all k: the innermost loop becomes vector instructions that have more to do than
    load and store.
    """
    k, count, n = weights.shape[0], rows.shape[0], rows.shape[1]
    whole = count - count % 3
    for r in range(0, whole, 3):
        for c in range(k):
            first, second, third = weights[c, r], weights[c, r + 1], weights[c, r + 2]
            for j in range(n):
                out[c, j] += first * rows[r, j] + second * rows[r + 1, j] + third * rows[r + 2, j]
    for r in range(whole, count):
        for c in range(k):
            factor = weights[c, r]
            for j in range(n):
                out[c, j] += factor * rows[r, j]


@kernel
def lu_factor(a: Array, pivots: NDArray[np.int64], n: int) -> bool:
    """Factorise the leading (n, n) part of a matrix in place, PA = LU with partial pivoting.

    Args:
        a: overwritten by L (unit diagonal, below) and U.
        pivots: overwritten by the row swapped with row k at step k.
        n: size of the part.

    Returns:
        False if a pivot is zero or not finite.
    """
    for k in range(n):
        row = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[row, k]):
                row = i
        pivots[k] = row
        if not (abs(a[row, k]) > 0.0 and abs(a[row, k]) < np.inf):
            return False
        if row != k:
            for j in range(n):
                a[k, j], a[row, j] = a[row, j], a[k, j]
        inverse = 1.0 / a[k, k]
        for i in range(k + 1, n):
            a[i, k] *= inverse
            factor = a[i, k]
            for j in range(k + 1, n):
                a[i, j] -= factor * a[k, j]
    return True


@kernel
def lu_solve(a: Array, pivots: NDArray[np.int64], b: Array, n: int) -> None:
    """Solve in place for every column of the first n rows of b, with a and pivots from `lu_factor`."""
    columns = b.shape[1]
    for k in range(n):
        row = pivots[k]
        if row != k:
            for c in range(columns):
                b[k, c], b[row, c] = b[row, c], b[k, c]
    for i in range(n):
        for j in range(i):
            for c in range(columns):
                b[i, c] -= a[i, j] * b[j, c]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            for c in range(columns):
                b[i, c] -= a[i, j] * b[j, c]
        inverse = 1.0 / a[i, i]
        for c in range(columns):
            b[i, c] *= inverse
