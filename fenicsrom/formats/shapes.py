"""Shapes of cells: their numbers of nodes, and their facets.

A "kind" is gmsh's number of an element type. All nodes are in gmsh's order, with the corners first.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Ints = npt.NDArray[Any]


@dataclass(frozen=True)
class Shape:
    """The shape of a cell.

    Attributes:
        name: name of such cells in messages, plural.
        dimension: dimension of the cell.
        corners: number of vertices.
        nodes: number of nodes.
        edges: corners of the edges; a quadratic cell has one node on each, in this order.
        facets: corners of each facet, in the order in which Abaqus numbers the faces.
    """

    name: str
    dimension: int
    corners: int
    nodes: int
    edges: tuple[tuple[int, int], ...] = ()
    facets: tuple[tuple[int, ...], ...] = ()


_TRIANGLE = ((0, 1), (1, 2), (2, 0))
_SQUARE = ((0, 1), (1, 2), (2, 3), (3, 0))
_TETRA = ((0, 1), (1, 2), (2, 0), (3, 0), (2, 3), (1, 3))
_TETRA_FACES = ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0))
_UPRIGHT = ((2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7))
_CUBE = ((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), *_UPRIGHT)
_CUBE_FACES = ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0))

_WEDGE_FACES = ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0))
_PYRAMID_FACES = ((0, 1, 2, 3), (0, 4, 1), (1, 4, 2), (2, 4, 3), (3, 4, 0))

SHAPES = {
    15: Shape("points", 0, 1, 1),
    1: Shape("lines", 1, 2, 2, ((0, 1),)),
    8: Shape("lines of 3 nodes", 1, 2, 3, ((0, 1),)),
    2: Shape("triangles", 2, 3, 3, _TRIANGLE, _TRIANGLE),
    9: Shape("triangles of 6 nodes", 2, 3, 6, _TRIANGLE, _TRIANGLE),
    3: Shape("quadrilaterals", 2, 4, 4, _SQUARE, _SQUARE),
    16: Shape("quadrilaterals of 8 nodes", 2, 4, 8, _SQUARE, _SQUARE),
    10: Shape("quadrilaterals of 9 nodes", 2, 4, 9, _SQUARE, _SQUARE),
    4: Shape("tetrahedra", 3, 4, 4, _TETRA, _TETRA_FACES),
    11: Shape("tetrahedra of 10 nodes", 3, 4, 10, _TETRA, _TETRA_FACES),
    5: Shape("hexahedra", 3, 8, 8, _CUBE, _CUBE_FACES),
    17: Shape("hexahedra of 20 nodes", 3, 8, 20, _CUBE, _CUBE_FACES),
    12: Shape("hexahedra of 27 nodes", 3, 8, 27, _CUBE, _CUBE_FACES),
    6: Shape("wedges", 3, 6, 6, (), _WEDGE_FACES),
    18: Shape("wedges of 15 nodes", 3, 6, 15, (), _WEDGE_FACES),
    13: Shape("wedges of 18 nodes", 3, 6, 18, (), _WEDGE_FACES),
    7: Shape("pyramids", 3, 5, 5, (), _PYRAMID_FACES),
    19: Shape("pyramids of 13 nodes", 3, 5, 13, (), _PYRAMID_FACES),
    14: Shape("pyramids of 14 nodes", 3, 5, 14, (), _PYRAMID_FACES),
}
"""Shapes by kind."""

STRAIGHT = {(1, 2): 1, (2, 3): 2, (2, 4): 3, (3, 4): 4, (3, 8): 5}
"""Kinds of the straight shapes, by dimension and number of corners."""

SERENDIPITY = {1: 8, 2: 9, 3: 16, 4: 11, 5: 17}
"""Kind with one node on each edge, of each straight kind."""

TETRA_FROM_VTK = (0, 1, 2, 3, 4, 5, 6, 7, 9, 8)
"""Gmsh's order of the nodes of a tetrahedron of 10 nodes, as indices in VTK's order."""

CUBE_FROM_VTK = (*range(9), 11, 16, 9, 17, 10, 18, 19, 12, 15, 13, 14)
"""Gmsh's order of the nodes of a hexahedron of 20 nodes, as indices in VTK's order."""

FROM_VTK: dict[int, tuple[int, ...]] = {
    11: TETRA_FROM_VTK,
    17: CUBE_FROM_VTK,
    12: (*CUBE_FROM_VTK, 24, 22, 20, 21, 23, 25, 26),
}
"""Gmsh's order of the nodes, as indices in VTK's order, of the kinds where the two differ."""


def from_vtk(kind: int, cells: Ints) -> Ints:
    """Node numbers (cells, nodes) of a kind in gmsh's order, from those in VTK's order."""
    return cells[:, FROM_VTK.get(kind, range(cells.shape[1]))]


def distinct(rows: Ints) -> tuple[Ints, Ints, Ints]:
    """Find rows (m, n) that hold the same numbers in any order.

    Returns:
        The first of each kind of rows (k,), the kind of each row (m,), and the number of rows of
        each kind (k,).
    """
    rows = np.sort(rows, axis=1)
    _, first, which, count = np.unique(
        rows, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    return first, which.ravel(), count


def facet_kind(kind: int) -> int:
    """The kind of the facets of a kind of cells: straight, or with one node on each edge."""
    shape = SHAPES[kind]
    straight = STRAIGHT[shape.dimension - 1, len(shape.facets[0])]
    return straight if shape.nodes == shape.corners else SERENDIPITY[straight]


def facet_nodes(kind: int) -> list[list[int]]:
    """Indices of the nodes of each facet of a kind of cells: corners, then nodes on edges."""
    shape = SHAPES[kind]
    rows = []
    for corners in shape.facets:
        row = list(corners)
        if shape.nodes > shape.corners:
            ends = zip(corners, (*corners[1:], corners[0]), strict=True)
            sides = list(ends) if shape.dimension == 3 else [(corners[0], corners[1])]
            row += [shape.corners + _edge(shape, a, b) for a, b in sides]
        rows.append(row)
    return rows


def _edge(shape: Shape, a: int, b: int) -> int:
    """The number of an edge by its corners, in any order."""
    return next(k for k, edge in enumerate(shape.edges) if set(edge) == {a, b})


def facets_of(kind: int, cells: Ints) -> Ints:
    """Node numbers (cells, facets, nodes) of the facets of cells (cells, nodes) of a kind."""
    return cells[:, np.array(facet_nodes(kind))]
