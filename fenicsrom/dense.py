"""Small dense linear systems, compiled: the reduced model solves thousands of them, each too small for LAPACK to pay."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True)
def lu_factor(a: Array, pivots: NDArray[np.int64]) -> bool:
    """Factorise a square matrix in place, PA = LU with partial pivoting.

    Args:
        a: (n, n), overwritten by L (unit diagonal, below) and U.
        pivots: (n,), overwritten by the row swapped with row k at step k.

    Returns:
        False if a pivot is zero or not finite.
    """
    n = a.shape[0]
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
        for i in range(k + 1, n):
            a[i, k] /= a[k, k]
            factor = a[i, k]
            for j in range(k + 1, n):
                a[i, j] -= factor * a[k, j]
    return True


@njit(cache=True)
def lu_solve(a: Array, pivots: NDArray[np.int64], b: Array) -> None:
    """Solve in place for every column of b (n, k), with a and pivots from `lu_factor`."""
    n = a.shape[0]
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
        for c in range(columns):
            b[i, c] /= a[i, i]
