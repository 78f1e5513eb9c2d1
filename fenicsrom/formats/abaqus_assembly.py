"""Puts the parts of an Abaqus model together: instances, and the names of their sets."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from fenicsrom.errors import refuse
from fenicsrom.formats.abaqus_elements import kind_of
from fenicsrom.formats.abaqus_keywords import Keyword, fields
from fenicsrom.formats.abaqus_sets import Part, Resolver, by_block, known_name
from fenicsrom.formats.mesh_file import Block, Floats, Ints, MeshFile
from fenicsrom.formats.parts import faces
from fenicsrom.formats.shapes import from_vtk

Placements = list[tuple[str, Part, Floats]]
"""Name, part and placement (3, 4) of each instance."""


def placed(path: Path, keyword: Keyword) -> Floats:
    """Read the placement of *INSTANCE: a translation, then a rotation about an axis.

    Returns:
        The matrix (3, 4) that places a point (x, y, z, 1).

    Raises:
        SceneError: a data line is wrong.
    """
    try:
        rows = [[float(word or 0) for word in fields(line)] for line in keyword.lines[:2]]
        shift = np.array((rows[0] if rows else []) + [0.0] * 3)[:3]
        if len(rows) < 2:
            return np.column_stack([np.eye(3), shift])
        start, end, angle = np.array(rows[1][:3]), np.array(rows[1][3:6]), np.radians(rows[1][6])
        length = float(np.linalg.norm(end - start))
        if not 0.0 < length < np.inf:
            raise ValueError
    except (ValueError, IndexError):
        reason = f"{keyword.lines[:2]} must be a translation and a rotation"
        raise refuse(path, f"*INSTANCE: {reason}") from None
    across = np.cross(np.eye(3), (end - start) / length)  # across @ x = axis × x
    turn = np.eye(3) + np.sin(angle) * across + (1.0 - np.cos(angle)) * across @ across  # Rodrigues
    return np.column_stack([turn, turn @ (shift - start) + start])


def assembled(path: Path, root: Part, instances: Placements) -> tuple[MeshFile, Resolver, Resolver]:
    """Put the nodes, elements and sets of a model together.

    Returns:
        The mesh, and the reader of node and element sets by their names.

    Args:
        path: the file, for messages.
        root: nodes, elements and sets outside of parts.
        instances: name, part and placement of each instance.

    Raises:
        SceneError: an element has a node that is not there, or a set is wrong.
    """
    identity = np.eye(3, 4)
    placements = [("", root, identity), *instances]
    points, node_numbers = _points(placements)
    blocks, element_numbers = _blocks(path, placements, node_numbers)
    starts = np.cumsum([0] + [len(block.nodes) for block in blocks])

    in_cells = {name: part.element_sets for name, part, _ in instances}
    in_nodes = {name: part.node_sets for name, part, _ in instances}
    cells = Resolver(path, "ELSET", root.element_sets, in_cells, element_numbers)

    def nodes_of(instance: str, name: str) -> Ints:
        chosen = by_block(cells.indices(instance, name), starts)
        rows = [block.nodes[of].ravel() for block, of in zip(blocks, chosen, strict=True)]
        return np.unique(np.concatenate(rows)) if rows else np.empty(0, dtype=np.int64)

    nodes = Resolver(path, "NSET", root.node_sets, in_nodes, node_numbers, nodes_of)
    notes: list[str] = []
    for instance, name, shown in _names(placements, "ELSET", notes):
        chosen = by_block(cells.indices(instance, name), starts)
        for block, of in zip(blocks, chosen, strict=True):
            marks = np.zeros(len(block.nodes), dtype=bool)
            marks[of] = True
            if marks.any():
                block.groups[shown] = marks
    groups = {
        shown: nodes.indices(instance, name)
        for instance, name, shown in _names(placements, "NSET", notes)
    }
    groups = {name: members for name, members in groups.items() if len(members)}
    surfaces = _surfaces(placements, blocks, starts, cells, notes)
    mesh = MeshFile(points, (*blocks, *surfaces), groups, notes=tuple(notes))
    return mesh, nodes, cells


def _points(placements: Placements) -> tuple[Floats, dict[str, dict[int, int]]]:
    """Coordinates (n, 3) of all nodes, and the index of each node by instance and number."""
    points, numbers, start = [np.empty((0, 3))], {}, 0
    for name, part, matrix in placements:
        place = np.array(list(part.nodes.values()), dtype=np.float64).reshape(-1, 3)
        exact = np.array_equal(matrix, np.eye(3, 4))
        points.append(place if exact else place @ matrix[:, :3].T + matrix[:, 3])
        numbers[name] = {number: start + k for k, number in enumerate(part.nodes)}
        start += len(place)
    return np.concatenate(points), numbers


def _blocks(
    path: Path, placements: Placements, node_numbers: dict[str, dict[int, int]]
) -> tuple[list[Block], dict[str, dict[int, int]]]:
    """The cells of each instance and type, and the index of each by instance and number."""
    blocks: list[Block] = []
    numbers: dict[str, dict[int, int]] = {}
    start = 0
    for name, part, _ in placements:
        known = numbers.setdefault(name, {})
        for type_, elements in part.elements.items():
            kind = kind_of(type_)
            if kind is None or not elements:
                continue
            if twice := known.keys() & elements.keys():
                raise refuse(path, f"element {min(twice)} is given twice, with different types")
            try:
                index = node_numbers[name]
                rows = np.array([[index[node] for node in row] for row in elements.values()])
            except KeyError as error:
                reason = f"refer to node {error}, which is not in the file"
                raise refuse(path, f"elements of type {type_} {reason}") from None
            labels = np.array(list(elements))
            known |= {int(label): start + k for k, label in enumerate(labels)}
            blocks.append(Block(kind, from_vtk(kind, rows), {}, type_, labels))
            start += len(rows)
    return blocks, numbers


def _names(placements: Placements, keyword: str, notes: list[str]) -> list[tuple[str, str, str]]:
    """For each set the instance, the name, and the name that this program gives.

    Where a set of an instance has the name of another set, it is called "instance.set", as Abaqus
    calls it.
    """
    every = [(instance, name) for instance, part, _ in placements for name in part.names(keyword)]
    found = []
    for instance, name in every:
        shown = name
        if instance and sum(other.upper() == name.upper() for _, other in every) > 1:
            shown = f"{instance}.{name}"
            notes.append(f"the {keyword} {name} of {instance} has the group name {shown}")
        found.append((instance, name, shown))
    return found


def _surfaces(
    placements: Placements,
    blocks: list[Block],
    starts: Ints,
    cells: Resolver,
    notes: list[str],
) -> list[Block]:
    """The facets of the surfaces, on the cells of the highest dimension."""
    highest = max((block.shape.dimension for block in blocks), default=0)
    parts = {instance: part for instance, part, _ in placements}
    found = []
    for instance, name, shown in _names(placements, "SURFACE", notes):
        surfaces = parts[instance].surfaces
        for side in surfaces[known_name(surfaces, name)]:
            if isinstance(side.item, int):
                index = cells.numbers.get(instance, {}).get(side.item)
                chosen = np.array([] if index is None else [index], dtype=np.int64)
            else:
                chosen = cells.indices(instance, side.item)
            members = [
                np.isin(np.arange(a, b), chosen) & (block.shape.dimension == highest)
                for block, (a, b) in zip(blocks, pairwise(starts), strict=True)
            ]
            for facets in faces(blocks, members, side.face):
                facets.groups[shown] = np.ones(len(facets.nodes), dtype=bool)
                found.append(facets)
    return found
