"""Small dense matrices, compiled: the reduced model meets millions, each too small for BLAS and
LAPACK to pay.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.compiled import compiled, kernel


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

    Three rows are taken at a time, for all k: the innermost loop becomes vector instructions that
    have more to do than load and store.
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
    """Solve in place for every column of the first n rows of b, with a and pivots from
    `lu_factor`.
    """
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


def negative_eigenvalues(matrix: Array) -> int:
    """Number of negative eigenvalues of the symmetric part of a matrix (n, n)."""
    return int(np.sum(np.linalg.eigvalsh(0.5 * (matrix + matrix.T)) < 0.0))
