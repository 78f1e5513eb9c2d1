"""Displacements along the centreline of a slender body."""

from __future__ import annotations

import numpy as np

from fenicsrom.arrays import Array

INSIDE = 1e-13
"""Distance of the ends of the centreline from those of the body, relative to its length."""


def centreline(points: Array, values: Array, stations: int = 101) -> tuple[Array, Array]:
    """Sample fields along the axis of a slender body, for `plot_modes`.

    The axis is the coordinate direction in which the body is longest, through the middle of the
    box around it. Fields are linear between neighbouring nodes, also across a hollow section: a
    section that rotates has no axial displacement in its middle.

    Args:
        points: (n, d) nodes, m.
        values: (f, n, d) fields at the nodes.
        stations: number of points along the axis; those outside of the body are left out.

    Returns:
        Positions (k,) in m, from the smallest to the largest coordinate, and values (f, k, d), the
        axial component first, then the others in order.
    """
    from scipy.interpolate import LinearNDInterpolator

    low, high = points.min(axis=0), points.max(axis=0)
    axis = int(np.argmax(high - low))
    order = [axis, *(k for k in range(points.shape[1]) if k != axis)]
    line = np.tile((low + high) / 2.0, (stations, 1))
    spare = INSIDE * (high - low)[axis]
    positions = np.linspace(low[axis], high[axis], stations)
    line[:, axis] = positions.clip(low[axis] + spare, high[axis] - spare)
    found = LinearNDInterpolator(points, np.moveaxis(values, 0, 1))(line)
    inside = ~np.isnan(found).any(axis=(1, 2))
    return positions[inside], np.moveaxis(found[inside], 1, 0)[..., order]
