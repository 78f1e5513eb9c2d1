"""Matrices of a disk of N sectors, each of which shares a few coordinates with the next one.

A sector has the coordinates q = (η, y, y′), and y′ are those that y is of the next sector. With
z = (η_0, y_0, η_1, y_1, ..) and q_j = P_j z,

    A = Σ_j P_jᵀ A_j P_j.                                                                 (1)

To solve A z = b, η of each sector is eliminated, in all sectors at once,

    S_j = A_yy − A_yη A_ηη⁻¹ A_ηy    in (y_j, y_{j+1}),                                   (2)

and then y of one sector after the other. The last one stays as a border of the others, which makes
the cyclic matrix a tridiagonal one. The effort is proportional to N.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fenicsrom.arrays import Array


@dataclass(frozen=True, eq=False)
class CyclicMatrix:
    """The matrix (1), with the operators that a time step asks of a matrix.

    Attributes:
        sectors: N.
        blocks: (N, n, n) A_j, or (1, n, n) if those of all sectors are equal.
        shapes: m, the number of y, and of y′.
        neighbour: 1 or -1: y′ of sector j is y of sector j + neighbour.
    """

    sectors: int
    blocks: Array
    shapes: int
    neighbour: int

    __array_ufunc__ = None  # numpy leaves its products to this class

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and columns."""
        rows = self.sectors * (self.blocks.shape[1] - self.shapes)
        return rows, rows

    @property
    def size(self) -> int:
        """Number of entries of the full matrix."""
        return self.shape[0] ** 2

    def of_sectors(self, z: Array) -> Array:
        """The coordinates q of all sectors: (N, n, ..) for z (size, ..)."""
        own = z.reshape(self.sectors, len(z) // self.sectors, *z.shape[1:])
        return np.concatenate([own, _moved(own[:, -self.shapes :], -self.neighbour)], axis=1)

    def summed(self, q: Array) -> Array:
        """Pᵀ q (size, ..) for forces q (N, n, ..) of all sectors."""
        n = self.blocks.shape[1] - self.shapes
        own = q[:, :n].copy()
        own[:, n - self.shapes :] += _moved(q[:, n:], self.neighbour)
        return own.reshape(self.shape[0], *q.shape[2:])

    def __matmul__(self, z: Array) -> Array:
        """The product with a vector (size,)."""
        q = self.of_sectors(z)
        if len(self.blocks) == 1:
            return self.summed(q @ self.blocks[0].T)
        return self.summed((self.blocks @ q[:, :, None])[:, :, 0])

    def __rmul__(self, factor: float) -> CyclicMatrix:
        """The product with a number."""
        return replace(self, blocks=factor * self.blocks)

    def __add__(self, other: CyclicMatrix) -> CyclicMatrix:
        """The sum with a matrix of the same sectors."""
        return replace(self, blocks=self.blocks + other.blocks)

    def toarray(self) -> Array:
        """The full matrix (size, size)."""
        return self.summed(self.blocks @ self.of_sectors(np.eye(self.shape[0])))

    def inverse(self) -> Callable[[Array], Array]:
        """The inverse times vectors (size, k), or one (size,); NaN if the matrix is singular."""
        try:
            return _Inverse(self)
        except np.linalg.LinAlgError:
            return lambda block: np.full(block.shape, np.nan)


def _moved(values: Array, places: int) -> Array:
    """Values (N, ..) of the sectors given to those so many places on; `np.roll` is slow."""
    return np.concatenate([values[-places:], values[:-places]])


class _Inverse:
    """The inverse of a matrix (1).

    The sectors are taken in the order in which each is followed by the one that shares its y′.
    """

    def __init__(self, matrix: CyclicMatrix):
        """Eliminate. Raises LinAlgError if a block on the way is singular."""
        self._matrix, m = matrix, matrix.shapes
        self._order = slice(None, None, matrix.neighbour)
        blocks = np.broadcast_to(matrix.blocks, (matrix.sectors, *matrix.blocks.shape[1:]))
        blocks = blocks[self._order]
        e = blocks.shape[1] - 2 * m
        self._inside, self._rows = np.linalg.inv(blocks[:, :e, :e]), blocks[:, e:, :e]
        self._follow = self._inside @ blocks[:, :e, e:]
        faces = blocks[:, e:, e:] - self._rows @ self._follow
        diagonal = faces[:, :m, :m] + _moved(faces[:, m:, m:], 1)
        last = len(faces) - 1
        # of block k: the couplings with the next block and with the border, above and below
        above = np.zeros((last, m, 2 * m))
        below = np.zeros((last, 2 * m, m))
        above[:-1, :, :m], below[:-1, :m] = faces[: last - 1, :m, m:], faces[: last - 1, m:, :m]
        above[-1, :, m:], below[-1, m:] = faces[last - 1, :m, m:], faces[last - 1, m:, :m]
        above[0, :, m:] += faces[last, m:, :m]
        below[0, m:] += faces[last, :m, m:]
        self._inverses = np.empty((last + 1, m, m))
        for k in range(last):
            self._inverses[k] = np.linalg.inv(diagonal[k])
            right = self._inverses[k] @ above[k]
            left = below[k] @ right
            if k + 1 < last:
                diagonal[k + 1] -= left[:m, :m]
                above[k + 1, :, m:] -= left[:m, m:]
                below[k + 1, m:] -= left[m:, :m]
            diagonal[last] -= left[m:, m:]
            above[k] = right
        self._inverses[last] = np.linalg.inv(diagonal[last])
        self._above, self._below = above, below

    def __call__(self, block: Array) -> Array:
        """The inverse times a block (size, k), or a vector (size,)."""
        m, sectors = self._matrix.shapes, self._matrix.sectors
        columns = block.size // len(block)
        b = block.reshape(sectors, len(block) // sectors, columns)[self._order]
        e = b.shape[1] - m
        found = np.empty_like(b)
        eta, y = found[:, :e], b[:, e:].copy()
        np.matmul(self._inside, b[:, :e], out=eta)
        pulled = self._rows @ eta
        y -= pulled[:, :m]
        y -= _moved(pulled[:, m:], 1)
        last = len(y) - 1
        for k in range(last):
            y[k] = self._inverses[k] @ y[k]
            pushed = self._below[k] @ y[k]
            y[k + 1] -= pushed[:m]
            y[last] -= pushed[m:]
        y[last] = self._inverses[last] @ y[last]
        for k in range(last - 1, -1, -1):
            y[k] -= self._above[k] @ np.concatenate([y[k + 1], y[last]])
        found[:, e:] = y
        eta -= self._follow @ np.concatenate([y, _moved(y, -1)], axis=1)
        return found[self._order].reshape(block.shape)
