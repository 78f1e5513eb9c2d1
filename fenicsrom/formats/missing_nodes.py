"""Adds the nodes of cells of degree 2 that a file leaves out: on edges, in faces and in cells."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from fenicsrom.formats.mesh_file import Block, Floats, Ints, MeshFile
from fenicsrom.formats.shapes import facets_of
from fenicsrom.words import are, counted

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
    _, first, which = np.unique(
        np.sort(every[:, :4], axis=1), axis=0, return_index=True, return_inverse=True
    )
    points, number = mesh.points, len(mesh.points)
    middle, unique = number + which.ravel(), every[first]
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
