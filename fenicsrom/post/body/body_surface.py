"""The boundary of a body as triangles, for pictures without a rendering library."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from fenicsrom.arrays import Array
from fenicsrom.post.paraview.vtk import grid_of, unknowns_of
from fenicsrom.post.paraview.vtk_files import CELLS, Grid, in_space, reference_nodes

if TYPE_CHECKING:
    from dolfinx.fem import Function, FunctionSpace

Ints = NDArray[np.int64]

FEATURE_ANGLE = 40.0
"""Smallest angle between two triangles, in degrees, at which their common edge is drawn."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of a boundary, or of a plane body.

    Attributes:
        points: (n, 3) all points of the body, m.
        triangles: (k, 3) point numbers, counter-clockwise seen from outside.
        edges: (m, 2) point numbers of the edges that show the form: the rim of a plane body, and
            the sharp edges of a solid one.
        sides: (m, 2) the two triangles of each edge; twice the same at a rim.
        wires: (w, 2) point numbers of the edges of the cells.
        wire_sides: (w,) a triangle of each of them.
        flat: whether the body is plane.
    """

    points: Array
    triangles: Ints
    edges: Ints
    sides: Ints
    wires: Ints
    wire_sides: Ints
    flat: bool


def gathered_surface(
    space: FunctionSpace, fields: Mapping[str, Array | Function]
) -> tuple[Surface, dict[str, Array]] | None:
    """Collect the boundary of a body and fields on it on the first rank. Collective.

    Args:
        space: vector Lagrange space of degree 1 or 2.
        fields: label -> nodal values, as an array of the local and ghost unknowns or a Function.

    Returns:
        The surface, and the values (n, 3) at its points; None on the other ranks.
    """
    comm, numbering, d = space.mesh.comm, space.dofmap.index_map, space.dofmap.index_map_bs
    grid = grid_of(space)
    owned = numbering.size_local
    cells = numbering.local_to_global(grid.nodes.astype(np.int32))[grid.grid.cells]
    mine = space.tabulate_dof_coordinates()[:owned]
    values = {
        label: in_space(unknowns_of(space, field).reshape(-1, d)[:owned])
        for label, field in fields.items()
    }
    found = comm.gather((cells, mine, values))
    if found is None:
        return None
    cells, points = (np.concatenate([part[k] for part in found]) for k in range(2))
    joined = {label: np.concatenate([part[2][label] for part in found]) for label in fields}
    return surface_of(Grid(points, cells, grid.grid.cell_type)), joined


def surface_of(grid: Grid) -> Surface:
    """The boundary of a grid of solid cells, or all cells of a plane grid."""
    name = next(name for name, (types, _) in CELLS.items() if grid.cell_type in types)
    quadratic = grid.cell_type == CELLS[name][0][1]
    pattern = _faces(name, quadratic)
    parts, wires, owners, begin = [], [], [], 0
    flat = name in ("triangle", "quadrilateral")
    keys = np.concatenate([np.sort(grid.cells[:, corners], axis=1) for corners, _ in pattern])
    _, numbers, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    outer = (counts[numbers.ravel()] == 1).reshape(len(pattern), len(grid.cells))
    for (_, triangles), free in zip(pattern, outer, strict=True):
        parts.append(grid.cells[free][:, triangles].reshape(-1, 3))
        rim = _rim(triangles)
        wires.append(grid.cells[free][:, rim].reshape(-1, 2))
        first = begin + len(triangles) * np.arange(np.count_nonzero(free))
        owners.append(np.repeat(first, len(rim)))
        begin += len(parts[-1])
    triangles = np.concatenate(parts)
    edges, sides = _form_edges(grid.points, triangles)
    return Surface(
        grid.points, triangles, edges, sides, np.concatenate(wires), np.concatenate(owners), flat
    )


def _rim(triangles: Ints) -> Ints:
    """The edges (k, 2) that belong to one triangle only."""
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    edges, counts = np.unique(np.sort(pairs, axis=1), axis=0, return_counts=True)
    return edges[counts == 1]


def is_flat(points: Array) -> bool:
    """Whether points (n, 3) lie in the plane of x and y."""
    return not np.ptp(points[:, 2])


def areas(points: Array, triangles: Ints) -> Array:
    """(k, 3) normals of triangles, as long as their areas, m²."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    return np.asarray(0.5 * np.cross(b - a, c - a))


def normals(points: Array, triangles: Ints) -> Array:
    """(k, 3) unit normals of triangles; zero for a triangle without area."""
    across = areas(points, triangles)
    size = np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(across / np.where(size > 0.0, size, 1.0))


def _form_edges(points: Array, triangles: Ints) -> tuple[Ints, Ints]:
    """The rim and the sharp edges, and the triangles on both sides of each."""
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    owner = np.tile(np.arange(len(triangles)), 3)
    edges, first, number, counts = np.unique(
        np.sort(pairs, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    last = np.zeros(len(edges), dtype=np.int64)
    last[number.ravel()] = owner  # the last one that is written remains
    sides = np.column_stack([owner[first], last])
    direction = normals(points, triangles)
    cosine = np.sum(direction[sides[:, 0]] * direction[sides[:, 1]], axis=1)
    shown = (counts == 1) | (cosine < np.cos(np.radians(FEATURE_ANGLE)))
    return edges[shown], sides[shown]


@cache
def _faces(name: str, quadratic: bool) -> tuple[tuple[Any, Any], ...]:
    """The corners and the triangles (k, 3) of each face of a cell, as numbers of its nodes."""
    nodes = np.round(2.0 * reference_nodes(name)).astype(int)
    count = {"triangle": 3, "quadrilateral": 4, "tetrahedron": 4, "hexahedron": 8}[name]
    if not quadratic:
        nodes = nodes[:count]
    d = nodes.shape[1]
    if d == 2:
        return (_face(nodes, np.arange(len(nodes)), nodes, None, count, quadratic),)
    found = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for level in (0, 2) if name == "hexahedron" else (0,):
            on = np.flatnonzero(nodes[:, axis] == level)
            out = np.eye(3)[axis] * (level - 1)
            found.append(_face(nodes, on, nodes[on][:, others], out, count, quadratic))
    if name == "tetrahedron":
        on = np.flatnonzero(nodes.sum(axis=1) == 2)
        found.append(_face(nodes, on, nodes[on][:, :2], np.ones(3), count, quadratic))
    return tuple(found)


def _face(
    nodes: Any, on: Any, places: Any, out: Any, corners: int, quadratic: bool
) -> tuple[Any, Any]:
    """The corners and the triangles of one face, whose nodes `on` have plane places in halves."""
    at = {tuple(place): node for place, node in zip(places.tolist(), on.tolist(), strict=True)}
    step = 1 if quadratic else 2
    triangles = []
    for i in range(0, 2, step):
        for j in range(0, 2, step):
            square = [(i, j), (i + step, j), (i + step, j + step), (i, j + step)]
            if all(corner in at for corner in square):
                a, b, c, e = (at[corner] for corner in square)
                triangles += [(a, b, c), (a, c, e)]
            elif all(square[k] in at for k in (0, 1, 3)):
                triangles.append(tuple(at[square[k]] for k in (0, 1, 3)))
    found = np.array(triangles)
    if out is not None:
        a, b, c = (nodes[found[:, k]].astype(float) for k in range(3))
        inward = np.sum(np.cross(b - a, c - a) * out, axis=1) < 0.0
        found[inward] = found[inward][:, [0, 2, 1]]
    return on[on < corners], found
