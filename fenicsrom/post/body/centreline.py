"""Displacements along the centreline of a slender body."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.post.paraview.vtk import unknowns_of

if TYPE_CHECKING:
    from dolfinx.fem import Function, FunctionSpace


def centreline(
    space: FunctionSpace, fields: Mapping[str, Array | Function], stations: int = 101
) -> tuple[Array, Array]:
    """Sample fields along the axis of a slender body, for `plot_modes`. Collective.

    The axis is the coordinate direction in which the body is longest. At each station, a polynomial
    that is quadratic along the axis and linear across it is fitted to the nodes nearby. The weight
    of a node falls linearly with its distance from the station. The weight reaches zero at two
    spacings of the stations. This distance is doubled until enough nodes are near. The polynomial
    is evaluated at the middle of the section, so that the rotation of a section does not appear as
    an axial displacement. All ranks return the same result.

    Args:
        space: vector Lagrange space.
        fields: as in `write_fields`.
        stations: number of points along the axis.

    Returns:
        Positions (stations,) in m, from the smallest to the largest coordinate, and values
        (n_fields, stations, d), the axial component first, then the others in order.
    """
    # longer than 60 lines by its documentation: 45 lines of code
    comm = space.mesh.comm
    d = space.dofmap.index_map_bs
    owned = space.dofmap.index_map.size_local
    x = space.tabulate_dof_coordinates()[:owned, :d]
    values = np.array(
        [unknowns_of(space, field)[: owned * d].reshape(-1, d) for field in fields.values()]
    )
    values = values.reshape(len(fields), owned, d)
    boxes = comm.allgather((x.min(axis=0), x.max(axis=0)) if owned else None)
    low = np.min([box[0] for box in boxes if box], axis=0)
    high = np.max([box[1] for box in boxes if box], axis=0)
    axis = int(np.argmax(high - low))
    order = [axis, *(k for k in range(d) if k != axis)]
    positions = np.linspace(low[axis], high[axis], stations)
    length = high[axis] - low[axis]
    across = (x[:, order[1:]] - ((low + high) / 2)[order[1:]]) / length
    result = np.zeros((len(fields), stations, d))
    pending, reach = np.arange(stations), 2 * length / (stations - 1)
    while len(pending):
        gram = np.zeros((len(pending), d + 2, d + 2))
        right = np.zeros((len(pending), d + 2, len(fields) * d))
        sides = np.full((2, len(pending), d - 1), -np.inf)
        for k, position in enumerate(positions[pending]):
            s = (x[:, axis] - position) / reach
            near = np.flatnonzero(np.abs(s) < 1)
            rows = np.column_stack([np.ones(near.size), s[near], s[near] ** 2, across[near]])
            weighted = rows * (1 - np.abs(s[near]))[:, None]
            sides[:, k] = np.max([across[near], -across[near]], axis=1, initial=-np.inf)
            gram[k] = weighted.T @ rows
            right[k] = weighted.T @ values[:, near].transpose(1, 0, 2).reshape(
                near.size, len(fields) * d
            )
        gram, right = sum(comm.allgather(gram)), sum(comm.allgather(right))
        sides = np.max(comm.allgather(sides), axis=0)
        spread = np.linalg.eigvalsh(gram[:, :3, :3])
        enough = (spread[:, 0] > 1e-4 * spread[:, 2]) | (reach > length)
        for k in np.flatnonzero(enough):
            at = np.concatenate([[1.0, 0.0, 0.0], (sides[0, k] - sides[1, k]) / 2])
            fitted = at @ np.linalg.pinv(gram[k], rcond=1e-13, hermitian=True) @ right[k]
            result[:, pending[k]] = fitted.reshape(len(fields), d)[:, order]
        pending, reach = pending[~enough], 2 * reach
    return positions, result
