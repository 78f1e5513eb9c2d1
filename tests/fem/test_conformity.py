"""Cells that overlap and nodes that hang are refused."""

from __future__ import annotations

import numpy as np
import pytest
from support import refusal

from fenicsrom.errors import ErrorKind
from fenicsrom.fem.mesh.gmsh_model import check_conforming

SQUARES = np.array([(x, y, 0.0) for y in range(3) for x in range(3)], dtype=float)


def cell(x: int, y: int) -> list[int]:
    """A unit square of the grid of 3 by 3 nodes."""
    first = 3 * y + x
    return [first, first + 1, first + 4, first + 3]


def test_grid_conforms() -> None:
    cells = np.array([cell(x, y) for x in range(2) for y in range(2)])
    check_conforming("m", 3, cells, SQUARES, 2)


def test_hanging_node_is_refused_with_its_place() -> None:
    points = np.concatenate([SQUARES, [(3.0, 0, 0), (3.0, 2, 0)]])
    cells = np.array([cell(1, 0), cell(1, 1), [2, 9, 10, 8]])
    with refusal(ErrorKind.MESH, file="m", names="(2, 1)"):
        check_conforming("m", 3, cells, points, 2)


def test_touching_bodies_need_not_match() -> None:
    points = np.concatenate([SQUARES, [(2.0, 0.5, 0), (3.0, 0.5, 0), (3.0, 1.5, 0), (2.0, 1.5, 0)]])
    cells = np.array([cell(1, 0), cell(1, 1), [9, 10, 11, 12]])
    check_conforming("m", 3, cells, points, 2)


@pytest.mark.parametrize("gap", [0.0, 0.001])
def test_crack_and_gap_are_no_hanging_nodes(gap: float) -> None:
    apart = SQUARES[[2, 5, 8]] + (gap, 0, 0)
    points = np.concatenate([SQUARES, apart, [(3.0, 0, 0), (3.0, 1, 0), (3.0, 2, 0)]])
    cells = np.array([cell(1, 0), cell(1, 1), [9, 12, 13, 10], [10, 13, 14, 11]])
    check_conforming("m", 3, cells, points, 2)


def test_third_cell_on_an_edge_is_refused() -> None:
    cells = np.array([[0, 1, 4], [1, 2, 4], [1, 5, 4]])
    with refusal(ErrorKind.MESH, file="m", names="overlap"):
        check_conforming("m", 2, cells, SQUARES, 2)


def cubes(*corners: tuple[float, float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Hexahedra with this lowest corner and size, joined at common nodes, and their nodes."""
    unit = np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))])
    places = np.concatenate([np.array(corner[:3]) + corner[3] * unit for corner in corners])
    points, rows = np.unique(places, axis=0, return_inverse=True)
    return rows.reshape(-1, 8), points


def test_hanging_nodes_of_hexahedra_are_found() -> None:
    small = [(1.0, y, z, 0.5) for y in (0.0, 0.5) for z in (0.0, 0.5)]
    rows, points = cubes((0, 0, 0, 1), *small)
    with refusal(ErrorKind.MESH, file="m", names="5 nodes"):
        check_conforming("m", 5, rows, points, 3)
    rows, points = cubes((0, 0, 0, 1), (1, 0, 0, 1))
    check_conforming("m", 5, rows, points, 3)


def test_crack_between_hexahedra_is_no_hanging_node() -> None:
    rows, points = cubes((0, 0, 0, 1))
    check_conforming(
        "m", 5, np.concatenate([rows, rows + 8]), np.concatenate([points, points + np.eye(3)[0]]), 3
    )


def test_hanging_node_of_tetrahedra_is_found() -> None:
    points = np.array(
        [(0, 0, 0), (2, 0, 0), (0, 2, 0), (0, 0, 2), (0, 0, -2), (0.5, 0.5, 0)], float
    )
    check_conforming("m", 4, np.array([[0, 1, 2, 3], [0, 2, 1, 4]]), points, 3)
    cells = np.array([[0, 1, 2, 3], [0, 5, 1, 4], [1, 5, 2, 4], [2, 5, 0, 4]])
    with refusal(ErrorKind.MESH, file="m", names="(0.5, 0.5, 0)"):
        check_conforming("m", 4, cells, points, 3)
