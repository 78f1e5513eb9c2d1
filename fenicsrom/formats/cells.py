"""The cells of a finite-element model: sorted, completed and divided.

Divides wedges, pyramids and mixed meshes into tetrahedra or triangles.

The program computes with cells of one shape. A cell is divided from its corner with the smallest
number, and a quadrilateral face along the diagonal at its corner with the smallest number, so that
neighbours agree. Source: Dompierre et al., How to subdivide pyramids, prisms and hexahedra into
tetrahedra, 1999.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats.mesh_file import Block, Floats, Ints, Marks, MeshFile
from fenicsrom.formats.shapes import SHAPES, STRAIGHT, distinct, facet_kind, facets_of
from fenicsrom.words import are, counted


def sorted_elements(path: Path, mesh: MeshFile) -> MeshFile:
    """Keep the cells of the highest dimension, and the groups of elements on their facets.

    An element of one dimension less stands for the facet of a cell if it has the same corners. All
    other elements (shells, beams and springs beside a solid) are left out, and said to be.

    Raises:
        SceneError: there are no cells, a cell refers to a node that is not there, or two cells have
            the same nodes.
    """
    if not mesh.blocks:
        raise refuse(path, "the file has no cells; write the file with its mesh")
    dimension = max(block.shape.dimension for block in mesh.blocks)
    if dimension < 2:
        raise refuse(path, "the file has no cells of dimension 2 or 3, only lines and points")
    cells = [block for block in mesh.blocks if block.shape.dimension == dimension]
    _check_not_doubled(path, cells)
    facets: list[Block] = []
    left: Counter[str] = Counter()
    for block in mesh.blocks:
        if block.shape.dimension < dimension - 1:
            left[block.name] += len(block.nodes)
    on_cells = _cell_facets(cells)
    for corners in (2, 3, 4):
        blocks = [
            block
            for block in mesh.blocks
            if (block.shape.dimension, block.shape.corners) == (dimension - 1, corners)
        ]
        kind, whole = on_cells.get(corners, (0, np.empty((0, corners), dtype=np.int64)))
        for block, (rows, found) in zip(blocks, _matching(blocks, corners, whole), strict=True):
            if found.any():
                groups = {name: marks[found] for name, marks in block.groups.items()}
                facets.append(Block(kind, rows[found], groups, block.name))
            left[block.name] += int((~found).sum())
    left_out = [counted(count, f"{name} element") for name, count in left.items() if count]
    return replace(
        mesh, blocks=(*cells, *facets), not_read=(*dict.fromkeys(left_out), *mesh.not_read)
    )


def faces(blocks: list[Block], members: list[Marks], face: int) -> list[Block]:
    """The facets of one number, counted from 0 as in Abaqus, of some cells of each block."""
    found = []
    for block, marks in zip(blocks, members, strict=True):
        shape = block.shape
        if not marks.any() or not 0 <= face < len(shape.facets):
            continue
        if shape.edges:
            rows = facets_of(block.kind, block.nodes[marks])[:, face]
            found.append(Block(facet_kind(block.kind), rows))
        else:  # wedges and pyramids, which will be divided: corners only
            corners = shape.facets[face]
            kind = STRAIGHT[2, len(corners)]
            found.append(Block(kind, block.nodes[marks][:, corners]))
    return found


def _check_not_doubled(path: Path, cells: list[Block]) -> None:
    """Check that no two cells have the same corners.

    Raises:
        SceneError: two cells have.
    """
    for number in {block.shape.corners for block in cells}:
        blocks = [block for block in cells if block.shape.corners == number]
        first, which, _ = distinct(np.concatenate([block.nodes[:, :number] for block in blocks]))
        again = np.flatnonzero(first[which] != np.arange(len(which)))
        if len(again):
            labels = np.concatenate([block.labels for block in blocks if block.labels is not None])
            one, other = labels[[first[which[again[0]]], again[0]]]
            doubled = f"{counted(len(again), 'cell')} with the same nodes as another cell"
            reason = f"such as the elements {one} and {other}: delete the doubled elements"
            raise refuse(path, f"{doubled}, {reason}")


def _cell_facets(cells: list[Block]) -> dict[int, tuple[int, Ints]]:
    """Kind and nodes (facets, nodes) of the facets of the cells, by their number of corners."""
    found: dict[int, tuple[int, Ints]] = {}
    for block in cells:
        if block.shape.facets:
            rows, kind = facets_of(block.kind, block.nodes), facet_kind(block.kind)
            rows = rows.reshape(-1, rows.shape[-1])
            known, others = found.get(SHAPES[kind].corners, (kind, rows[:0]))
            if known == kind:
                rows = np.concatenate([others, rows])
            found[SHAPES[kind].corners] = kind, rows
    return found


def _matching(blocks: list[Block], corners: int, facets: Ints) -> list[tuple[Ints, Marks]]:
    """For each element, the facet with the same corners, and whether such a facet exists."""
    if not blocks:
        return []
    if not len(facets):
        return [(block.nodes, np.zeros(len(block.nodes), dtype=bool)) for block in blocks]
    given = [block.nodes[:, :corners] for block in blocks]
    first, which, _ = distinct(np.concatenate([facets[:, :corners], *given]))
    at = first[which[len(facets) :]]
    found, rows = at < len(facets), facets[np.minimum(at, len(facets) - 1)]
    ends = np.cumsum([len(part) for part in given])[:-1]
    return list(zip(np.split(rows, ends), np.split(found, ends), strict=True))


FACES_OF_27 = (0, 2, 5, 3, 4, 1)
"""The face of a hexahedron, as `shapes` counts them, in whose middle each of gmsh's nodes 20 to 25
lies."""


def complete(mesh: MeshFile) -> MeshFile:
    """Add the nodes of degree 2 that cells of 8 and 20 nodes lack, by their shape functions.

    Only with all nodes does dolfinx keep the cells curved.
    A node in the middle of a face is in the node groups that contain the whole face.
    """
    faces = [np.empty((0, 8), dtype=np.int64)]
    for block in mesh.blocks:
        if block.kind == 16:
            faces.append(block.nodes)
        elif block.kind == 17:
            faces.append(facets_of(17, block.nodes)[:, FACES_OF_27].reshape(-1, 8))
    every = np.concatenate(faces)
    if not len(every):
        return mesh
    first, which, _ = distinct(every[:, :4])
    points, number = mesh.points, len(mesh.points)
    middle, unique = number + which, every[first]
    groups = {
        name: np.union1d(nodes, number + np.flatnonzero(np.isin(unique, nodes).all(axis=1)))
        for name, nodes in mesh.node_groups.items()
    }
    added = 0.5 * points[unique[:, 4:]].sum(axis=1) - 0.25 * points[unique[:, :4]].sum(axis=1)
    points = np.concatenate([points, added])
    blocks: list[Block] = []
    start = 0
    for block in mesh.blocks:
        rows: Ints = block.nodes
        if block.kind == 16:
            whole = np.column_stack([rows, middle[start : start + len(rows)]])
            blocks.append(replace(block, kind=10, nodes=whole))
            start += len(rows)
        elif block.kind == 17:
            sides = middle[start : start + 6 * len(rows)].reshape(-1, 6)
            start += 6 * len(rows)
            centre = 0.25 * (points[rows[:, 8:]].sum(axis=1) - points[rows[:, :8]].sum(axis=1))
            whole = np.column_stack([rows, sides, len(points) + np.arange(len(rows))])
            blocks.append(replace(block, kind=12, nodes=whole))
            points = np.concatenate([points, centre])
        else:
            blocks.append(block)
    return replace(mesh, points=points, blocks=tuple(blocks), node_groups=groups)


def with_middles(blocks: Iterable[Block], points: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Put one new node in the middle of each edge that lacks its node.

    Args:
        blocks: the cells; their negative node indices stand for such nodes, and are replaced.
        points: coordinates of the nodes of the file, shape (n, 3).

    Returns:
        The coordinates of all nodes, and a sentence on the new ones if there are any.
    """
    extra: list[Floats] = []
    middles: dict[tuple[int, ...], int] = {}
    for block in blocks:
        shape = block.shape
        for row, k in np.argwhere(block.nodes[:, shape.corners :] < 0):
            if k < len(shape.edges):
                ends = tuple(sorted(block.nodes[row, list(shape.edges[k])]))
                if ends not in middles:
                    middles[ends] = len(points) + len(extra)
                    extra.append(0.5 * points[list(ends)].sum(axis=0))
                block.nodes[row, shape.corners + k] = middles[ends]
    if not extra:
        return points, ()
    nodes = f"{counted(len(extra), 'node')} on edges that the file leaves out {are(len(extra))}"
    return np.concatenate([points, np.array(extra)]), (f"{nodes} put in the middle",)


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
