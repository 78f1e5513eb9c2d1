"""The boundary of a body as triangles with fields on them, and its sharp edges."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.paraview.vtk import grid_of, unknowns_of
from fenicsrom.post.paraview.vtk_files import Grid, in_space

if TYPE_CHECKING:
    from dolfinx.fem import Function, FunctionSpace
    from pyvista import PolyData

Ints = NDArray[np.int64]

FEATURE_ANGLE = 40.0
"""Smallest angle between two triangles, in degrees, at which their common edge is drawn."""

NODE = "node"
"""The point array of a surface with the numbers of its points in the grid."""


def gathered_grid(
    space: FunctionSpace, fields: Mapping[str, Array | Function]
) -> tuple[Grid, dict[str, Array]] | None:
    """Collect the mesh of a body and fields on it on the first rank. Collective.

    Args:
        space: vector Lagrange space of degree 1 or 2.
        fields: label -> nodal values, as an array of the local and ghost unknowns or a Function.

    Returns:
        The grid, and the values (n, 3) at its points; None on the other ranks.
    """
    comm, numbering, d = space.mesh.comm, space.dofmap.index_map, space.dofmap.index_map_bs
    grid = grid_of(space)
    owned = numbering.size_local
    cells = numbering.local_to_global(grid.nodes.astype(np.int32))[grid.grid.cells]
    mine = space.tabulate_dof_coordinates()[:owned]
    values = {
        label: in_space(unknowns_of(field).reshape(-1, d)[:owned])
        for label, field in fields.items()
    }
    found = comm.gather((cells, mine, values))
    if found is None:
        return None
    cells, points = (np.concatenate([part[k] for part in found]) for k in range(2))
    joined = {label: np.concatenate([part[2][label] for part in found]) for label in fields}
    return Grid(points, cells, grid.grid.cell_type), joined


def surface_of(grid: Grid, values: Mapping[str, Array] | None = None) -> PolyData:
    """The boundary of a grid of solid cells, or all cells of a plane grid, as triangles.

    Args:
        grid: the grid.
        values: label -> values (n, ...) at its points.

    Returns:
        The triangles, counter-clockwise seen from outside, with the values as point arrays.
    """
    return _boundary(grid, 1, values).triangulate()


def _boundary(grid: Grid, divisions: int, values: Mapping[str, Array] | None = None) -> PolyData:
    """The boundary of a grid; quadratic faces are divided so often, and their nodes are used."""
    import pyvista

    count = np.full((len(grid.cells), 1), grid.cells.shape[1])
    types = np.full(len(grid.cells), grid.cell_type, dtype=np.uint8)
    solid = pyvista.UnstructuredGrid(np.hstack([count, grid.cells]).ravel(), types, grid.points)
    for label, found in (values or {}).items():
        solid.point_data[label] = found
    solid.point_data[NODE] = np.arange(len(grid.points))
    return solid.extract_surface(nonlinear_subdivision=divisions, algorithm="dataset_surface")


def form_edges(surface: PolyData) -> PolyData:
    """The edges that show the form of a surface: its rim and its sharp edges."""
    return surface.extract_feature_edges(
        FEATURE_ANGLE, non_manifold_edges=False, manifold_edges=False
    )


def cell_edges(grid: Grid) -> PolyData:
    """The edges of the cells on the boundary of a grid, straight between their corners."""
    return _boundary(grid, 0).extract_all_edges()


def is_flat(points: Array) -> bool:
    """Whether points (n, 3) lie in the plane of x and y."""
    return not np.ptp(points[:, 2])


def areas(surface: PolyData) -> Array:
    """(k, 3) normals of the triangles of a surface, as long as their areas, m²."""
    a, b, c = (surface.points[surface.regular_faces[:, k]].astype(float) for k in range(3))
    return np.asarray(0.5 * np.cross(b - a, c - a))


def faces_on(surface: PolyData, on: Any) -> Any:
    """(k,) whether all corners of the triangles are among the flagged points (n,)."""
    return on[surface.regular_faces].all(axis=1)
