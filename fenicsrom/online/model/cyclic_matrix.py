"""Matrices of a disk of N sectors, each of which shares a few coordinates with the next one.

A sector has the coordinates q = (η, y, y′), and y′ are those that y is of the next sector. With
z = (η_0, y_0, η_1, y_1, ..) and q_j = P_j z,

    A = Σ_j P_jᵀ A_j P_j.                                                                 (1)

To solve A z = b, η of each sector is eliminated, in all sectors at once,

    S_j = A_yy − A_yη A_ηη⁻¹ A_ηy    in (y_j, y_{j+1}),                                   (2)

and then y of every second sector, of every second one of those that are left, and so on: what is
left is a cyclic matrix each time (Hockney, J. ACM 12, 1965). The effort is proportional to N.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array

COLUMNS = 36
"""So many right-hand sides at once stay in the cache of a core, which halves the time."""


@dataclass(frozen=True, eq=False)
class CyclicMatrix:
    """The matrix (1) plus w U Uᵀ, with the operators that a time step asks of a matrix.

    Attributes:
        sectors: N.
        blocks: (N, n, n) A_j, or (1, n, n) if those of all sectors are equal.
        shapes: m, the number of y, and of y′.
        neighbour: 1 or -1: y′ of sector j is y of sector j + neighbour.
        columns: U (size, r), few columns that reach all sectors.
        weight: w; 0 without such columns. A sum has those of one of its matrices.
    """

    sectors: int
    blocks: Array
    shapes: int
    neighbour: int
    columns: Array = field(default_factory=lambda: np.zeros((0, 0)))
    weight: float = 0.0

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
            found = self.summed(q @ self.blocks[0].T)
        else:
            found = self.summed((self.blocks @ q[:, :, None])[:, :, 0])
        if self.weight:
            found += self.weight * self.columns @ (self.columns.T @ z)
        return found

    def __rmul__(self, factor: float) -> CyclicMatrix:
        """The product with a number."""
        return replace(self, blocks=factor * self.blocks, weight=factor * self.weight)

    def __add__(self, other: CyclicMatrix) -> CyclicMatrix:
        """The sum with a matrix of the same sectors."""
        more = self if self.weight else other
        columns, weight = more.columns, self.weight + other.weight
        return replace(self, blocks=self.blocks + other.blocks, columns=columns, weight=weight)

    def toarray(self) -> Array:
        """The full matrix (size, size)."""
        found = self.summed(self.blocks @ self.of_sectors(np.eye(self.shape[0])))
        return found + self.weight * self.columns @ self.columns.T if self.weight else found

    def inverse(self) -> Callable[[Array], Array]:
        """The inverse times vectors (size, k), or one (size,); NaN if the matrix is singular.

        The columns come in by the formula of Sherman, Morrison and Woodbury.
        """
        try:
            plain = _Inverse(self)
            if not self.weight:
                return plain
            given = plain(self.columns)
            small = np.eye(given.shape[1]) / self.weight + self.columns.T @ given
            pulled = given @ np.linalg.inv(small)
        except np.linalg.LinAlgError:
            return lambda block: np.full(block.shape, np.nan)

        def solve(block: Array) -> Array:
            found = plain(block)
            return np.asarray(found - pulled @ (self.columns.T @ found))

        return solve


def _moved(values: Array, places: int) -> Array:
    """Values (N, ..) of the sectors given to those so many places on; `np.roll` is slow."""
    return np.concatenate([values[-places:], values[:-places]])


class _Level(NamedTuple):
    """Every second one of some sectors, whose y is eliminated.

    Attributes:
        inverses: (k, m, m) inverses of their diagonal blocks.
        rows: (k, 2 m, m) their columns in the rows of the sectors before and behind.
        follow: (k, m, 2 m) their inverses times their columns of y of these two sectors.
        behind: (k,) numbers of the sectors behind, among those that are left.
    """

    inverses: Array
    rows: Array
    follow: Array
    behind: NDArray[np.intp]


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
        before, behind = _moved(faces[:, m:, :m], 1), faces[:, :m, m:]  # columns of y
        self._levels: list[_Level] = []
        while len(diagonal) > 1:
            inverses: Array = np.asarray(np.linalg.inv(diagonal[1::2]))
            k = len(inverses)
            follow = inverses @ np.concatenate([before[1::2], behind[1::2]], axis=2)
            diagonal, before, behind = diagonal[::2].copy(), before[::2].copy(), behind[::2].copy()
            next_ones = np.arange(1, k + 1) % len(diagonal)
            rows = np.concatenate([behind[:k], before[next_ones]], axis=1)
            change = rows @ follow
            diagonal[:k] -= change[:, :m, :m]
            diagonal[next_ones] -= change[:, m:, m:]
            behind[:k], before[next_ones] = -change[:, :m, m:], -change[:, m:, :m]
            self._levels.append(_Level(inverses, rows, follow, next_ones))
        self._last = np.linalg.inv(diagonal + before + behind)

    def __call__(self, block: Array) -> Array:
        """The inverse times a block (size, k), or a vector (size,)."""
        m, sectors = self._matrix.shapes, self._matrix.sectors
        columns = block.size // len(block)
        if columns > COLUMNS:
            parts = np.split(block, range(COLUMNS, columns, COLUMNS), axis=1)
            return np.concatenate([*map(self, parts)], axis=1)
        b = block.reshape(sectors, len(block) // sectors, columns)[self._order]
        e = b.shape[1] - m
        found = np.empty_like(b)
        eta = np.matmul(self._inside, b[:, :e], out=found[:, :e])
        pulled = self._rows @ eta
        y = self._faces(b[:, e:] - pulled[:, :m] - _moved(pulled[:, m:], 1))
        found[:, e:] = y
        eta -= self._follow @ np.concatenate([y, _moved(y, -1)], axis=1)
        return found[self._order].reshape(block.shape)

    def _faces(self, y: Array) -> Array:
        """The y (N, m, k) of the sectors for forces on them."""
        m, own = self._matrix.shapes, []
        for level in self._levels:
            own.append(level.inverses @ y[1::2])
            pushed, y = level.rows @ own[-1], y[::2].copy()
            y[: len(pushed)] -= pushed[:, :m]
            y[level.behind] -= pushed[:, m:]
        y = self._last @ y
        for level, moved in zip(self._levels[::-1], own[::-1], strict=True):
            ends, found = np.concatenate([y[: len(moved)], y[level.behind]], axis=1), y
            y = np.empty((len(moved) + len(found), *y.shape[1:]))
            y[::2], y[1::2] = found, moved - level.follow @ ends
        return y
