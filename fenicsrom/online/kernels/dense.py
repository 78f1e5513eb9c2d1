"""Small dense matrices and vectors in compiled code.

The reduced model works on millions of them, each too small for BLAS and LAPACK to be faster.

Symmetric dense matrices whose coordinates have different units.

A reduced model has contact displacements in m beside mass-normalised coordinates in m √kg. On a
very small or very large body the entries of its matrices differ by 20 orders of magnitude, and the
rounding of an eigenvalue is that of the largest entry. A matrix is therefore first scaled to a unit
diagonal, D A D. That keeps the signs of its eigenvalues (Sylvester's law of inertia), and leaves a
positive definite matrix with almost the least condition number that a diagonal scaling gives (van
der Sluis, Numerische Mathematik 14, 1969).
"""

from collections.abc import Sequence

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.kernels.compilation import KERNEL, SHORT, kernel, part, reordered


def scaled(matrix: Array) -> Array:
    """A symmetric matrix (n, n) with diagonal entries of size 1; where one is 0, it stays."""
    size = np.sqrt(np.abs(np.diag(matrix)))
    factor = 1.0 / np.where(size > 0.0, size, 1.0)
    return matrix * factor[:, None] * factor


def negative_eigenvalues(matrix: Array) -> int:
    """Number of negative eigenvalues of the symmetric part of a matrix (n, n)."""
    return int(np.sum(np.linalg.eigvalsh(scaled(0.5 * (matrix + matrix.T))) < 0.0))


def scaled_condition(matrix: Array) -> float:
    """Condition number of a symmetric matrix after scaling to unit diagonal; 1 for an empty one."""
    return float(np.linalg.cond(scaled(matrix))) if matrix.size else 1.0


def orthonormal(vectors: Array, gram: Array, least: float) -> Array:
    """Combinations (local, k) of vectors (local, m) that are orthonormal in an inner product.

    Args:
        vectors: the vectors.
        gram: (m, m) their inner products.
        least: smaller eigenvalues of the inner products of unit vectors are rounding.
    """
    size = np.sqrt(np.abs(np.diag(gram)))
    size[size == 0.0] = 1.0
    values, axes = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > least
    return np.asarray(vectors @ (axes[:, kept] / np.sqrt(values[kept]) / size[:, None]))


def interpolation_weights(known: Sequence[float], at: float) -> Array:
    """Weights (k,) that give the value at a point from those at k points, by one polynomial."""
    return np.array(
        [np.prod([(at - b) / (a - b) for b in known if b != a], initial=1.0) for a in known]
    )


MANY_ROWS = 8  # of a matrix whose product combines its columns


@part
def write_times(a: Array, x: Array, out: Array) -> None:
    """Write A x (n,) for a matrix a (n, k) and a vector x (k,)."""
    for i in range(a.shape[0]):
        value = 0.0
        for j in range(a.shape[1]):
            value += a[i, j] * x[j]
        out[i] = value


@part
def add_times(offset: Array, a: Array, columns: Array, x: Array, out: Array) -> None:
    """Write offset + A x (m,) for a vector x (n,) and a matrix a (m, n) with columns (n, m).

    Few rows are multiplied faster as inner products, many by combining the columns, three at a
    time.
    """
    m, n = a.shape
    if m < MANY_ROWS:
        for i in range(m):
            value = offset[i]
            for j in range(n):
                value += a[i, j] * x[j]
            out[i] = value
        return
    for i in range(m):
        out[i] = offset[i]
    whole = n - n % 3
    for j in range(0, whole, 3):
        first, second, third = x[j], x[j + 1], x[j + 2]
        for i in range(m):
            out[i] += first * columns[j, i] + second * columns[j + 1, i] + third * columns[j + 2, i]
    for j in range(whole, n):
        factor = x[j]
        for i in range(m):
            out[i] += factor * columns[j, i]


@part
def inner(x: Array, y: Array) -> float:
    """Inner product of two vectors."""
    value = 0.0
    for i in range(x.size):
        value += x[i] * y[i]
    return value


@kernel
def add_combined_rows(weights: Array, rows: Array, out: Array) -> None:
    """Add weights @ rows to out; (k, r), (r, n), (k, n), k small.

    Three rows are added at a time, for k = 2 to both sums at once. The innermost loop then does
    more arithmetic for each number that it loads and stores.
    """
    k, count, n = weights.shape[0], rows.shape[0], rows.shape[1]
    whole = count - count % 3
    if k == 2:
        for r in range(0, whole, 3):
            a0, b0, c0 = weights[0, r], weights[0, r + 1], weights[0, r + 2]
            a1, b1, c1 = weights[1, r], weights[1, r + 1], weights[1, r + 2]
            for j in range(n):
                first, second, third = rows[r, j], rows[r + 1, j], rows[r + 2, j]
                out[0, j] += a0 * first + b0 * second + c0 * third
                out[1, j] += a1 * first + b1 * second + c1 * third
        for r in range(whole, count):
            a0, a1 = weights[0, r], weights[1, r]
            for j in range(n):
                out[0, j] += a0 * rows[r, j]
                out[1, j] += a1 * rows[r, j]
        return
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
def add_by_upper_half(s: Array, t: Array, matrix: Array, out: Array) -> None:
    """Multiply by the upper half of a matrix from both sides, which is read once.

    Args:
        s: (k, n), k small.
        t: (k, n); out: at i the sum of matrix[i, j] t[j] over the j above the block of i.
        matrix: (n, n).
        out: (k, n); the sum of s[i] matrix[i, j] over the i below j or in its block is added.
    """
    k, n = s.shape
    for first in range(0, n, 6):
        above = min(first + 6, n)
        for c in range(k):
            for i in range(first, above):
                for j in range(first, above):
                    out[c, j] += s[c, i] * matrix[i, j]
        if above == n:
            t[:, first:] = 0.0
            return
        x, y, z = matrix[first, above:], matrix[first + 1, above:], matrix[first + 2, above:]
        u, v, w = matrix[first + 3, above:], matrix[first + 4, above:], matrix[first + 5, above:]
        rows = x, y, z, u, v, w
        if k == 2:
            s0, s1, t0, t1 = s[0, first:], s[1, first:], t[0, first:], t[1, first:]
            _add_rows_twice(s0, s1, t0, t1, rows, out[0, above:], out[1, above:])
        else:
            for c in range(k):
                _add_rows(s[c, first:], t[c, first:], rows, out[c, above:])


@reordered
def _add_rows(s: Array, t: Array, rows: tuple[Array, ...], out: Array) -> None:
    """Six rows of `add_by_upper_half`, right of their block; all arrays are contiguous."""
    (x, y, z, u, v, w), later = rows, t[6:]
    a, b, c, d, e, f = s[0], s[1], s[2], s[3], s[4], s[5]
    at_x, at_y, at_z, at_u, at_v, at_w = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(out.size):
        out[j] += a * x[j] + b * y[j] + c * z[j] + d * u[j] + e * v[j] + f * w[j]
        at_x += x[j] * later[j]
        at_y += y[j] * later[j]
        at_z += z[j] * later[j]
        at_u += u[j] * later[j]
        at_v += v[j] * later[j]
        at_w += w[j] * later[j]
    t[0], t[1], t[2], t[3], t[4], t[5] = at_x, at_y, at_z, at_u, at_v, at_w


@reordered
def _add_rows_twice(
    s: Array, s1: Array, t: Array, t1: Array, rows: tuple[Array, ...], out: Array, out1: Array
) -> None:
    """`_add_rows` for two points in one pass over the rows."""
    (x, y, z, u, v, w), later, later1 = rows, t[6:], t1[6:]
    a, b, c, d, e, f = s[0], s[1], s[2], s[3], s[4], s[5]
    a1, b1, c1, d1, e1, f1 = s1[0], s1[1], s1[2], s1[3], s1[4], s1[5]
    at_x, at_y, at_z, at_u, at_v, at_w = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    at_x1, at_y1, at_z1, at_u1, at_v1, at_w1 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(out.size):
        out[j] += a * x[j] + b * y[j] + c * z[j] + d * u[j] + e * v[j] + f * w[j]
        out1[j] += a1 * x[j] + b1 * y[j] + c1 * z[j] + d1 * u[j] + e1 * v[j] + f1 * w[j]
        at_x += x[j] * later[j]
        at_y += y[j] * later[j]
        at_z += z[j] * later[j]
        at_u += u[j] * later[j]
        at_v += v[j] * later[j]
        at_w += w[j] * later[j]
        at_x1 += x[j] * later1[j]
        at_y1 += y[j] * later1[j]
        at_z1 += z[j] * later1[j]
        at_u1 += u[j] * later1[j]
        at_v1 += v[j] * later1[j]
        at_w1 += w[j] * later1[j]
    t[0], t[1], t[2], t[3], t[4], t[5] = at_x, at_y, at_z, at_u, at_v, at_w
    t1[0], t1[1], t1[2], t1[3], t1[4], t1[5] = at_x1, at_y1, at_z1, at_u1, at_v1, at_w1


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
        upper = a[k, k + 1 : n]
        for i in range(k + 1, n):
            a[i, k] *= inverse
            factor, below = a[i, k], a[i, k + 1 : n]
            for j in range(upper.size):  # from 0, which the compiler turns into vector arithmetic
                below[j] -= factor * upper[j]
    return True


@part
def substitute(a: Array, b: Array, n: int, columns: int) -> None:
    """Solve L U x = b in place for the first columns of b (n, ..)."""
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


@part
def subtract_rows(a: Array, b: Array, i: int, first: int, last: int, columns: int) -> None:
    """Subtract a[i, first:last] @ b[first:last] from row i of b, three rows at a time."""
    whole = last - (last - first) % 3
    for j in range(first, whole, 3):
        f, g, h = a[i, j], a[i, j + 1], a[i, j + 2]
        for c in range(columns):
            b[i, c] -= f * b[j, c] + g * b[j + 1, c] + h * b[j + 2, c]
    for j in range(whole, last):
        factor = a[i, j]
        for c in range(columns):
            b[i, c] -= factor * b[j, c]


@kernel
def lu_solve(a: Array, pivots: NDArray[np.int64], b: Array, n: int, columns: int) -> None:
    """Solve in place for the first columns of b (n, ..); a and pivots from `lu_factor`.

    The compiler writes out the loops over one, two, three and four columns.
    """
    for k in range(n):
        row = pivots[k]
        if row != k:
            for c in range(columns):
                b[k, c], b[row, c] = b[row, c], b[k, c]
    if columns == 1:
        substitute(a, b, n, 1)
    elif columns == 2:
        substitute(a, b, n, 2)
    elif columns == 3:
        substitute(a, b, n, 3)
    elif columns == 4:
        substitute(a, b, n, 4)
    else:
        for i in range(n):
            subtract_rows(a, b, i, 0, i, columns)
        for i in range(n - 1, -1, -1):
            subtract_rows(a, b, i, i + 1, n, columns)
            inverse = 1.0 / a[i, i]
            for c in range(columns):
                b[i, c] *= inverse


# Vector operations of the time step; they run plain and compiled. A new array costs compiled code
# more than the arithmetic on a short vector, so results are written into arrays that exist.


def combine(out, a, x, b, y, c=0.0, z=None):  # type: ignore[no-untyped-def]
    """Write a x + b y (+ c z) into out (n,), which may be one of the vectors."""
    out[:] = a * x + b * y if z is None else a * x + b * y + c * z


@overload(combine, jit_options=KERNEL)
def _combine(out, a, x, b, y, c=0.0, z=None):  # type: ignore[no-untyped-def]
    def two(out, a, x, b, y, c=0.0, z=None):  # type: ignore[no-untyped-def]
        for i in range(out.size):
            out[i] = a * x[i] + b * y[i]

    def three(out, a, x, b, y, c=0.0, z=None):  # type: ignore[no-untyped-def]
        for i in range(out.size):
            out[i] = a * x[i] + b * y[i] + c * z[i]

    return three if isinstance(z, types.Array) else two


def copy_vector(out, vector):  # type: ignore[no-untyped-def]
    """Write a vector (n,), or vectors (P, d), into out."""
    out[:] = vector


@overload(copy_vector, jit_options=SHORT)
def _copy_vector(out, vector):  # type: ignore[no-untyped-def]
    def one(out, vector):  # type: ignore[no-untyped-def]
        for i in range(out.size):
            out[i] = vector[i]

    def several(out, vector):  # type: ignore[no-untyped-def]
        for p in range(out.shape[0]):
            for k in range(out.shape[1]):
                out[p, k] = vector[p, k]

    return one if out.ndim == 1 else several


def copy_to_points(points, displacement):  # type: ignore[no-untyped-def]
    """Write displacements (P d,) into points (P, d)."""
    points[:] = displacement.reshape(points.shape)


@overload(copy_to_points, jit_options=SHORT)
def _copy_to_points(points, displacement):  # type: ignore[no-untyped-def]
    def copy_entries(points, displacement):  # type: ignore[no-untyped-def]
        d = points.shape[1]
        for p in range(points.shape[0]):
            for k in range(d):
                points[p, k] = displacement[p * d + k]

    return copy_entries


def subtract_contact(out, y, unit, points, force):  # type: ignore[no-untyped-def]
    """Write into out (n,) the response y (n,) minus that to the forces at some contact points.

    Args:
        out: (n,).
        y: (n,) response without contact forces.
        unit: (n, c d) responses to unit contact forces at these points.
        points: (c,) their numbers.
        force: (P, d) contact forces of all points, N.
    """
    out[:] = y - np.dot(unit, force[points].reshape(-1))


@overload(subtract_contact, jit_options=SHORT)
def _subtract_contact(out, y, unit, points, force):  # type: ignore[no-untyped-def]
    def subtract_entries(out, y, unit, points, force):  # type: ignore[no-untyped-def]
        d = force.shape[1]
        for i in range(y.size):
            value = y[i]
            for t in range(points.size):
                for k in range(d):
                    value -= unit[i, t * d + k] * force[points[t], k]
            out[i] = value

    return subtract_entries
