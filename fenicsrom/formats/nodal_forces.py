"""Forces at nodes as loads: each by itself, or many of one direction as a load on their facets."""

from collections import defaultdict
from collections.abc import Mapping

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fenicsrom.formats.cells import faces
from fenicsrom.formats.mesh_file import Block, DeckLoad, Floats, Ints
from fenicsrom.formats.shapes import distinct

MOST_TABLES = 20
"""More tables of loads or supports at single nodes are not written."""

SAME_PLACE = 0.02
"""Distance between the line of forces and the centroid of their facets that counts as none,
relative to the extent of the facets."""

SAME_DIRECTION = 6
"""Digits in which the components of unit vectors of one direction agree."""


def forces_on(
    points: Floats, cells: list[Block], forces: Mapping[int, Floats], groups: dict[str, Ints]
) -> tuple[list[DeckLoad], list[str]]:
    """Give the loads of forces at nodes.

    Many forces of one direction become their sum, which a scene spreads over the area of a group,
    if it acts along the same line.

    Args:
        points: coordinates of the nodes, shape (n, 3).
        cells: the cells of the solid.
        forces: force (3,) at each node.
        groups: groups of nodes by name, to which those of such facets are added.

    Returns:
        The loads, and what is not taken, in words.
    """
    loads: list[DeckLoad] = []
    left: list[str] = []
    alone = dict(forces)
    if len(forces) > MOST_TABLES:
        for nodes, centroid in _patches(points, cells, forces):
            own = [node for node in nodes.tolist() if node in alone]
            vectors = np.array([alone[node] for node in own])
            total = vectors.sum(axis=0)
            moment = np.cross(points[own] - centroid, vectors).sum(axis=0)
            reach = SAME_PLACE * np.ptp(points[nodes], axis=0).max() * np.linalg.norm(total)
            if reach == 0.0 or np.linalg.norm(moment) > reach:
                continue
            known = (name for name, of in groups.items() if np.array_equal(np.sort(of), nodes))
            name = next(known, f"forces {len(loads) + 1}")
            groups[name] = nodes
            loads.append(DeckLoad("force", tuple(total.tolist()), group=name))
            spread = f"which the scene spreads over the area of the group {name}"
            left.append(f"the distribution of the forces at {len(own)} nodes, {spread}")
            for node in own:
                del alone[node]
    if len(alone) > MOST_TABLES:
        total = np.sum(list(alone.values()), axis=0)
        listed = ", ".join(f"{value:.6g}" for value in total)
        ways = "[[loads]] can act on a group as a force, traction or pressure"
        left.append(f"forces at {len(alone)} nodes, in total ({listed}); {ways}")
        return loads, left
    for node, force in alone.items():
        at = tuple(points[node].tolist())
        loads.append(DeckLoad("force", tuple(force.tolist()), at))
    return loads, left


def _patches(
    points: Floats, cells: list[Block], forces: Mapping[int, Floats]
) -> list[tuple[Ints, Floats]]:
    """The nodes and the centroid (3,) of each patch of facets under forces of one direction.

    All nodes of such facets have forces; of facets with nodes on their edges, only these need to.
    """
    lines: dict[tuple[float, ...], list[int]] = defaultdict(list)
    for node, force in forces.items():
        unit = (force / np.linalg.norm(force)).round(SAME_DIRECTION) + 0.0
        first = unit[np.flatnonzero(unit)[0]]
        lines[tuple((np.sign(first) * unit).tolist())].append(node)
    facets = _boundary(cells)
    found = []
    for line in lines.values():
        loaded = [
            (rows[np.isin(rows[:, n if rows.shape[1] > n else 0 :], line).all(axis=1)], n)
            for rows, n in facets
        ]
        found += _connected(points, loaded)
    return found


def _boundary(cells: list[Block]) -> list[tuple[Ints, int]]:
    """The facets (k, nodes) of the boundary, and their number of corners, by their shape."""
    every: dict[tuple[int, int], list[Ints]] = defaultdict(list)
    most = max((len(block.shape.facets) for block in cells), default=0)
    whole = [np.ones(len(block.nodes), dtype=bool) for block in cells]
    for face in range(most):
        for block in faces(cells, whole, face):
            every[block.nodes.shape[1], block.shape.corners].append(block.nodes)
    found = []
    for (_, corners), parts in every.items():
        rows = np.concatenate(parts)
        first, _, count = distinct(rows[:, :corners])
        found.append((rows[first[count == 1]], corners))
    return found


def _connected(points: Floats, facets: list[tuple[Ints, int]]) -> list[tuple[Ints, Floats]]:
    """Nodes and centroid (3,) of each connected part of facets (k, nodes) with their corners."""
    pairs = [
        np.column_stack([np.repeat(rows[:, 0], rows.shape[1]), rows.ravel()]) for rows, _ in facets
    ]
    ends = np.concatenate([np.empty((0, 2), dtype=np.int64), *pairs])
    if not len(ends):
        return []
    size = int(ends.max()) + 1
    graph = coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(size, size))
    part = connected_components(graph, directed=False)[1]
    found = []
    for number in np.unique(part[ends[:, 0]]):
        area, moment, nodes = 0.0, np.zeros(3), [np.empty(0, dtype=np.int64)]
        for rows, corners in facets:
            rows = rows[part[rows[:, 0]] == number]
            nodes.append(rows.ravel())
            for sides in ((0, 1, 2), (0, 2, 3))[: max(corners - 2, 1)]:
                x = points[rows[:, sides[:corners]]]
                across = x[:, 1] - x[:, 0]
                if corners > 2:
                    across = 0.5 * np.cross(across, x[:, 2] - x[:, 0])
                sizes = np.linalg.norm(across, axis=1)
                area, moment = area + sizes.sum(), moment + sizes @ x.mean(axis=1)
        found.append((np.unique(np.concatenate(nodes)), moment / area))
    return found
