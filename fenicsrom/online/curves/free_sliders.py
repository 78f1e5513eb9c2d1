"""Newton's equation of a periodic motion in which contact points stick.

A point that sticks during the whole period keeps its slider, whatever its place: its equation is
0 = 0. Here the slider stays where it is, and the other unknowns follow. Least squares would take
the nearest member of this family too, but they need a bound below which singular values count as
zero, and the models have stiff modes whose small singular values count.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array

STAYS = 1e-12  # largest derivative of the change of a slider that sticks: rounding


def solve_with_free_sliders(
    jacobian: Array, right: Array, sliders: NDArray[np.int64]
) -> tuple[Array, int]:
    """The solution of a square system, and how many sliders are free.

    Args:
        jacobian: (k, k) derivative of the change over a period, perhaps bordered.
        right: (k,)
        sliders: the equations and unknowns that are sliders.

    Raises:
        LinAlgError: the system without the free sliders is singular.
    """
    free = sliders[np.max(np.abs(jacobian[sliders]), axis=1, initial=0.0) <= STAYS]
    keep = np.delete(np.arange(right.size), free)
    found = np.zeros_like(right)
    found[keep] = np.linalg.solve(jacobian[np.ix_(keep, keep)], right[keep])
    return found, free.size
