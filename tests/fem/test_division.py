"""Wedges, pyramids and mixed meshes, which are divided into simplices."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support import gmsh_session

from fenicsrom import formats
from fenicsrom.fem.mesh.inspection import inspect

NODES = {
    1: (0, 0, 0), 2: (1, 0, 0), 3: (1, 1, 0), 4: (0, 1, 0),
    5: (0, 0, 1), 6: (1, 0, 1), 7: (1, 1, 1), 8: (0, 1, 1),
    9: (2, 0, 0), 10: (2, 1, 0), 11: (2, 0, 1), 12: (2, 1, 1),
    13: (0.5, 0.5, 2), 14: (1.5, 0.5, 2),
}  # fmt: skip
CELLS = {
    "C3D8": [(1, 2, 3, 4, 5, 6, 7, 8)],
    "C3D6": [(2, 9, 3, 6, 11, 7), (9, 10, 3, 11, 12, 7)],
    "C3D5": [(5, 6, 7, 8, 13)],
    "C3D4": [(6, 7, 13, 14), (6, 11, 7, 14)],
}
VOLUME = 1.0 + 1.0 + 1.0 / 3.0 + 1.0 / 6.0 + 1.0 / 6.0
"""A cube, a cube of two wedges, a pyramid on the first one, and two tetrahedra."""


def deck(numbers: dict[int, int]) -> str:
    """An Abaqus file of these cells, with other numbers of the nodes."""
    places = sorted((numbers[k], *place) for k, place in NODES.items())
    text = "*NODE\n" + "".join(f"{k}, {x}, {y}, {z}\n" for k, x, y, z in places)
    label = 0
    for name, rows in CELLS.items():
        text += f"*ELEMENT, TYPE={name}, ELSET={name}\n"
        for row in rows:
            label += 1
            text += f"{label}, {', '.join(str(numbers[k]) for k in row)}\n"
    return text + "*SURFACE, NAME=side\nC3D6, S3\n*SURFACE, NAME=low\nC3D8, S1\nC3D6, S1\n"


@pytest.mark.parametrize("seed", range(3))
def test_mixed_mesh_is_conforming_for_every_order_of_the_nodes(tmp_path: Path, seed: int) -> None:
    """`inspect` refuses hanging nodes, overlaps and cells inside out."""
    order = np.random.default_rng(seed).permutation(len(NODES)) + 1
    numbers = dict(zip(NODES, order.tolist(), strict=True))
    path = tmp_path / "mixed.inp"
    path.write_text(deck(numbers))
    found = inspect(path)
    assert found.refusal is None and found.pieces == 1 and found.quality > 0.1
    assert found.volume == pytest.approx(VOLUME, rel=1e-10)
    sizes = {group.name: group.size for group in found.groups if group.kind == "facets"}
    assert sizes["low"] == pytest.approx(2.0) and sizes["side"] == pytest.approx(2.0)
    cells = {group.name: group.size for group in found.groups if group.kind == "cells"}
    assert cells["C3D6"] == pytest.approx(1.0) and cells["C3D5"] == pytest.approx(1.0 / 3.0)


def test_division_is_noted(tmp_path: Path) -> None:
    path = tmp_path / "mixed.inp"
    path.write_text(deck({k: k for k in NODES}))
    (note,) = formats.read(path).notes
    assert "hexahedra: 1" in note and "wedges: 2" in note and "tetrahedra" in note


@pytest.mark.slow
def test_plane_mesh_of_two_shapes_has_triangles(tmp_path: Path) -> None:
    path = tmp_path / "plane.msh"
    with gmsh_session() as gmsh:
        gmsh.model.addDiscreteEntity(2, 1)
        points = [0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0, 2, 0, 0]
        gmsh.model.mesh.addNodes(2, 1, range(1, 6), points)
        gmsh.model.mesh.addElementsByType(1, 3, [1], [1, 2, 3, 4])
        gmsh.model.mesh.addElementsByType(1, 2, [2], [2, 5, 3])
        gmsh.write(str(path))
    found = inspect(path)
    assert found.cells == {"triangles": 3} and found.volume == pytest.approx(1.5)


def test_quadratic_wedges_keep_their_corners(tmp_path: Path) -> None:
    """The nodes on edges are left out; the body is that of the straight wedge."""
    middle = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]
    corners = [NODES[k] for k in (2, 9, 3, 6, 11, 7)]
    nodes = [*corners, *(tuple(np.mean([corners[a], corners[b]], axis=0)) for a, b in middle)]
    lines = "".join(f"{k}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(nodes, 1))
    row = ", ".join(map(str, range(1, 16)))
    path = tmp_path / "wedge.inp"
    path.write_text(f"*NODE\n{lines}*ELEMENT, TYPE=C3D15\n1, {row}\n")
    found = inspect(path)
    assert found.cells == {"tetrahedra": 3} and found.volume == pytest.approx(0.5)
