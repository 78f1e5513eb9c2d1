"""Nodes on edges that cells of degree 2 lack in their file."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fenicsrom.formats.mesh_file import Block, Floats
from fenicsrom.formats.shapes import SHAPES
from fenicsrom.words import are, counted


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
        shape = SHAPES[block.kind]
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
