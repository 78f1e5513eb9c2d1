"""Divides wedges, pyramids and mixed meshes into tetrahedra or triangles.

The program computes with cells of one shape. A cell is divided from its corner with the smallest
number, and a quadrilateral face along the diagonal at its corner with the smallest number, so that
neighbours agree. Source: Dompierre et al., How to subdivide pyramids, prisms and hexahedra into
tetrahedra, 1999.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenicsrom.formats.mesh_file import Block, Ints, MeshFile
from fenicsrom.formats.shapes import SHAPES
from fenicsrom.words import counted

SIMPLEX = {2: 2, 3: 4}
"""Kind of the triangle and of the tetrahedron."""

WHOLE = (2, 3, 4, 5)
"""Corners and dimension are those of these kinds in a mesh of one shape, which stays as it is."""


def divided(mesh: MeshFile) -> MeshFile:
    """Give the mesh with simplices in place of its cells, if they have different shapes.

    Nodes on edges are left out. Facets are divided with the cells.
    """
    dimension = max((block.shape.dimension for block in mesh.blocks), default=0)
    shapes = {
        (block.shape.dimension, block.shape.corners)
        for block in mesh.blocks
        if block.shape.dimension == dimension
    }
    whole = {(SHAPES[kind].dimension, SHAPES[kind].corners) for kind in WHOLE}
    if dimension < 2 or (len(shapes) == 1 and shapes <= whole):
        return mesh
    blocks = [_divided(block) for block in mesh.blocks]
    parts = ", ".join(
        f"{block.shape.name}: {len(block.nodes)}"
        for block in mesh.blocks
        if block.shape.dimension == dimension
    )
    number = sum(len(b.nodes) for b in blocks if b.shape.dimension == dimension)
    names = ("tetrahedron", "tetrahedra") if dimension == 3 else ("triangle", "")
    into = counted(number, *names)
    note = f"cells of several shapes ({parts}) are divided into {into} with straight edges"
    return replace(mesh, blocks=tuple(blocks), notes=(*mesh.notes, note))


def _divided(block: Block) -> Block:
    """Simplices in place of the cells of a block; lines and points stay as they are."""
    shape = block.shape
    if shape.dimension < 2:
        return block
    corners = block.nodes[:, : shape.corners]
    if shape.corners == shape.dimension + 1:
        rows, of = corners, np.arange(len(corners))
    elif shape.dimension == 2:
        rows, of = _triangles(corners)
    else:
        rows, of = _tetrahedra(block.kind, corners)
    groups = {name: marks[of] for name, marks in block.groups.items()}
    labels = None if block.labels is None else block.labels[of]
    return Block(SIMPLEX[shape.dimension], rows, groups, block.name, labels)


def _triangles(faces: Ints) -> tuple[Ints, Ints]:
    """Triangles (2 k, 3) of quadrilaterals (k, 4), and the number of its quadrilateral of each."""
    turn = (np.arange(4) + faces.argmin(axis=1)[:, None]) % 4
    turned = np.take_along_axis(faces, turn, axis=1)
    rows = np.concatenate([turned[:, [0, 1, 2]], turned[:, [0, 2, 3]]])
    return rows, np.tile(np.arange(len(faces)), 2)


def _tetrahedra(kind: int, cells: Ints) -> tuple[Ints, Ints]:
    """Tetrahedra (n, 4) of cells (k, corners) of a kind, and the number of its cell of each."""
    found, of = [], []
    first = cells.argmin(axis=1)
    for k in range(cells.shape[1]):
        chosen = np.flatnonzero(first == k)
        for facet in (facet for facet in SHAPES[kind].facets if k not in facet):
            faces, which = cells[chosen][:, facet], np.arange(len(chosen))
            if len(facet) == 4:
                faces, which = _triangles(faces)
            faces = faces[:, ::-1]  # the facets of the shapes have inner normals
            found.append(np.column_stack([cells[chosen[which], k], faces]))
            of.append(chosen[which])
    return np.concatenate(found), np.concatenate(of)
