"""Sorts the elements of a finite-element model: cells, facets that name a group, and the rest."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats.mesh_file import Block, Ints, Marks, MeshFile
from fenicsrom.formats.shapes import SHAPES, STRAIGHT, facet_kind, facets_of
from fenicsrom.words import counted


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
        if not marks.any() or face >= len(shape.facets):
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
        corners = np.sort(np.concatenate([block.nodes[:, :number] for block in blocks]), axis=1)
        _, first, which = np.unique(corners, axis=0, return_index=True, return_inverse=True)
        again = np.flatnonzero(first[which.ravel()] != np.arange(len(corners)))
        if len(again):
            labels = np.concatenate([block.labels for block in blocks if block.labels is not None])
            one, other = labels[[first[which.ravel()[again[0]]], again[0]]]
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
    both = np.sort(np.concatenate([facets[:, :corners], *given]), axis=1)
    _, first, which = np.unique(both, axis=0, return_index=True, return_inverse=True)
    at = first[which.ravel()[len(facets) :]]
    found, rows = at < len(facets), facets[np.minimum(at, len(facets) - 1)]
    ends = np.cumsum([len(part) for part in given])[:-1]
    return list(zip(np.split(rows, ends), np.split(found, ends), strict=True))
