"""Symmetric dense matrices whose coordinates have different units.

A reduced model has contact displacements in m beside mass-normalised coordinates in m √kg. On a
very small or very large body the entries of its matrices differ by 20 orders of magnitude, and the
rounding of an eigenvalue is that of the largest entry. A matrix is therefore first scaled to a unit
diagonal, D A D. That keeps the signs of its eigenvalues (Sylvester's law of inertia), and leaves a
positive definite matrix with almost the least condition number that a diagonal scaling gives (van
der Sluis, Numerische Mathematik 14, 1969).
"""

import numpy as np

from fenicsrom.arrays import Array


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
