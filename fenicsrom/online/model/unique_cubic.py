"""The different values among the cubic coefficients of an elastic force.

B_ijkl is symmetric in all indices: of the n⁴ values, n (n + 1) (n + 2) (n + 3) / 24 with
i <= j <= k <= l differ. The value of i <= j <= k <= l stands at the place

    C(i, 1) + C(j + 1, 2) + C(k + 2, 3) + C(l + 3, 4)    (combinatorial number system)
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.online.model.polynomial import pairs

ROWS = 256
"""Rows of the paired coefficients that are moved at once."""

Ints = NDArray[np.int64]


def unique_cubic(cubic: Array, n: int) -> Array:
    """The different values of paired cubic coefficients (p, p) of n coordinates."""
    found = np.zeros(count(n) if cubic.size else 0)
    for rows, places, weights in _places(n) if cubic.size else ():
        found[places] = cubic[rows] / weights
    return found


def paired_cubic(values: Array, n: int) -> Array:
    """The paired coefficients (p, p), exactly symmetric, of their different values."""
    p = n * (n + 1) // 2 if values.size else 0
    found = np.zeros((p, p))
    for rows, places, weights in _places(n) if p else ():
        found[rows] = values[places] * weights
    return found


def count(n: int) -> int:
    """The number of different values in n coordinates."""
    return n * (n + 1) * (n + 2) * (n + 3) // 24


def _places(n: int) -> Iterator[tuple[slice, Ints, Array]]:
    """Some rows of the paired coefficients, the places of their values, and their weights.

    The weights are those of `ElasticPolynomial.cubic`: 1/2 in columns i = j, 1 in the others.
    """
    first, second = pairs(n)
    k, m = first[None, :], second[None, :]
    weights = np.where(first == second, 0.5, 1.0)
    for start in range(0, first.size, ROWS):
        rows = slice(start, start + ROWS)
        i, j = first[rows, None], second[rows, None]
        inner, other = np.maximum(i, k), np.minimum(j, m)
        b, c = np.minimum(inner, other) + 1, np.maximum(inner, other) + 2
        a, d = np.minimum(i, k), np.maximum(j, m) + 3
        places = a + b * (b - 1) // 2 + c * (c - 1) * (c - 2) // 6
        yield rows, places + d * (d - 1) * (d - 2) * (d - 3) // 24, weights
