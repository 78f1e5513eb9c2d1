"""From the model in an open gmsh to a clean model that dolfinx can distribute.

The clean model holds the solid and its facet groups only. Every cell and every facet is in exactly
one physical group, and the nodes are numbered from 1 without gaps.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.fem.mesh.conformity import check_conforming
from fenicsrom.fem.mesh.gmsh_checks import check_cells, check_facets
from fenicsrom.fem.mesh.gmsh_queries import (
    QUADRATIC,
    Floats,
    Ints,
    add_elements,
    boundary_facets,
    cell_sides,
    elements_of,
    group_entities,
    model_nodes,
)
from fenicsrom.formats.shapes import SHAPES, distinct, facet_kind
from fenicsrom.scene import Geometry

SOLID = "solid"
"""Group of the cells that become the mesh; without a group of this name, all cells are used."""

CLEAN = "fenicsrom"
"""Name of the clean model in gmsh."""

COINCIDENT = 1e-9
"""Nodes at smaller distances, relative to the extent of the mesh, coincide."""


@dataclass(frozen=True)
class CleanModel:
    """Description of a clean model, for all ranks.

    Attributes:
        facet_groups: tags of each facet group by its name.
        cell_groups: tags of each cell group by its name.
        facets: number of facets in the file of each facet group.
        nodes: node numbers, from 0, of the vertices (n,) and of the ends of the edges (k, 2) of
            each node group.
        warnings: sentences for the user.
    """

    facet_groups: dict[str, tuple[int, ...]]
    cell_groups: dict[str, tuple[int, ...]]
    facets: dict[str, int]
    nodes: dict[str, tuple[Ints, Ints]]
    warnings: tuple[str, ...]


def clean_model(gmsh: Any, geometry: Geometry, sets: dict[str, Ints]) -> CleanModel:
    """Check the current model and add a clean model, which becomes the current one.

    Args:
        gmsh: the open gmsh; its current model has the mesh.
        geometry: dimension, kind of the cells, whether they are curved, and unit of length; `mesh`
            names the mesh in messages.
        sets: node numbers of each node set.

    Returns:
        The description of the clean model.

    Raises:
        SceneError: the mesh cannot be used.
    """
    source, d = str(geometry.mesh), geometry.dimension
    in_cells, in_facets = group_entities(gmsh, source, d), group_entities(gmsh, source, d - 1)
    if SOLID in in_facets:
        reason = f"group {SOLID!r} has dimension {d - 1}: rename it, or give it dimension {d}"
        raise refuse(source, reason, ErrorKind.MESH)
    in_cells.setdefault(SOLID, [entity for _, entity in gmsh.model.getEntities(d)])
    given, kind, warnings = check_cells(gmsh, geometry, in_cells[SOLID])
    cell, facet = kind, facet_kind(kind)
    if geometry.curved:
        cell, facet = QUADRATIC[cell], QUADRATIC[facet]
    check_facets(gmsh, source, d - 1, in_facets, facet)

    cells, cell_tags, cell_groups = _solid_cells(gmsh, d, in_cells, cell)
    used = np.unique(cells)
    vertices = SHAPES[kind].corners
    corners = np.unique(cells[:, :vertices])
    node_groups, left_out = _node_groups(gmsh, source, d, in_cells[SOLID], given, sets, corners)
    rows = {name: elements_of(gmsh, d - 1, on, facet) for name, on in in_facets.items()}
    if sets:
        boundary = boundary_facets(gmsh, d, in_cells[SOLID], given)
        rows = _facets_of_sets(boundary, SHAPES[facet].nodes, sets) | rows
    facets, facet_tags, facet_groups = _combine(rows)
    sizes = {name: int(np.isin(facet_tags, tags).sum()) for name, tags in facet_groups.items()}
    near = np.isin(facets, used).all(axis=1)
    if facet_groups and not near.any():
        reason = f"facet groups {', '.join(facet_groups)}: at least one facet must touch the cells"
        raise refuse(source, reason, ErrorKind.MESH)
    numbers, points = model_nodes(gmsh)
    points = points * geometry.scale
    check_conforming(source, kind, np.searchsorted(numbers, cells[:, :vertices]), points, d)
    warnings += left_out
    if apart := _coincident(points[np.searchsorted(numbers, corners)]):
        nodes = "1 node coincides" if apart == 1 else f"{apart} nodes coincide"
        what = f"{nodes} with another node: the cells there are not joined"
        warnings += (f"{source}: {what}",)

    _add_model(gmsh, d, points[np.searchsorted(numbers, used)])
    add_elements(gmsh, d, cell, np.searchsorted(used, cells) + 1, cell_tags)
    add_elements(gmsh, d - 1, facet, np.searchsorted(used, facets[near]) + 1, facet_tags[near])
    found = {
        name: (np.searchsorted(used, a), np.searchsorted(used, b))
        for name, (a, b) in node_groups.items()
    }
    return CleanModel(facet_groups, cell_groups, sizes, found, warnings)


def _solid_cells(
    gmsh: Any, d: int, in_cells: dict[str, list[int]], cell: int
) -> tuple[Ints, Ints, dict[str, tuple[int, ...]]]:
    """Collect the cells of the solid.

    Args:
        gmsh: the open gmsh.
        d: dimension of the cells.
        in_cells: entities of each group of cells, of which one is the solid.
        cell: kind of the cells in the mesh.

    Returns:
        Node numbers (k, nodes) and tags (k,) of the cells, and the tags of each group that has
        cells of the solid.
    """
    cells, tags, groups = _combine(
        {name: elements_of(gmsh, d, on, cell) for name, on in in_cells.items()}
    )
    solid = np.isin(tags, groups[SOLID])
    cells, tags = cells[solid], tags[solid]
    return cells, tags, {name: on for name, on in groups.items() if np.isin(on, tags).any()}


def _add_model(gmsh: Any, d: int, points: Floats) -> None:
    """Add the clean model with nodes (n, 3), numbered from 1, which becomes the current model."""
    gmsh.model.add(CLEAN)
    gmsh.model.addDiscreteEntity(d, 1)
    gmsh.model.mesh.addNodes(d, 1, np.arange(len(points)) + 1, points.ravel())


def _facets_of_sets(boundary: Ints, width: int, sets: dict[str, Ints]) -> dict[str, Ints]:
    """Find the facets (k, nodes) of the boundary that have all their nodes in a node set.

    Of each facet the first `width` nodes are given. Sets without facets are left out.
    """
    found = {
        name: boundary[np.isin(boundary, nodes).all(axis=1), :width] for name, nodes in sets.items()
    }
    return {name: facets for name, facets in found.items() if len(facets)}


def _node_groups(
    gmsh: Any,
    source: str,
    d: int,
    solid: list[int],
    kind: int,
    sets: dict[str, Ints],
    corners: Ints,
) -> tuple[dict[str, tuple[Ints, Ints]], tuple[str, ...]]:
    """Collect the node groups: points, node sets and, in 3D, curves.

    Args:
        gmsh: the open gmsh.
        source: name of the file.
        d: dimension of the cells.
        solid: the entities of the cells.
        kind: kind of the cells.
        sets: node numbers of each node set.
        corners: sorted node numbers of the vertices of the cells.

    Returns:
        Node numbers of the vertices (n,) and of the ends of the edges (k, 2) of each group, and
        warnings.
    """
    curves = group_entities(gmsh, source, 1) if d == 3 else {}
    pairs = {name: elements_of(gmsh, 1, on, 1) for name, on in curves.items()}
    single = group_entities(gmsh, source, 0)
    points = {name: elements_of(gmsh, 0, on, 15).ravel() for name, on in single.items()} | sets
    if d == 3 and sets:
        edges = [cell_sides(gmsh, entity, kind, 1) for entity in solid]
        whole = np.concatenate([edge for edge in edges if len(edge)])
        for name, nodes in sets.items():
            within = np.sort(whole[np.isin(whole, nodes).all(axis=1), :2], axis=1)
            inside = np.unique(within, axis=0)
            pairs[name] = np.concatenate([pairs[name], inside]) if name in pairs else inside
    found, warnings = {}, []
    for name in sorted(pairs.keys() | points.keys()):
        ends = pairs.get(name, np.empty((0, 2), dtype=np.int64)).astype(np.int64)
        nodes = np.union1d(points.get(name, np.empty(0)).astype(np.int64), ends.ravel())
        kept = nodes[np.isin(nodes, corners)]
        if len(kept):
            found[name] = (kept, ends[np.isin(ends, corners).all(axis=1)])
        else:
            what = f"node group {name!r} has no vertex of the cells and is left out"
            warnings.append(f"{source}: {what}")
    return found, tuple(warnings)


def _coincident(points: Floats) -> int:
    """Number of points (n, 3) that coincide with an earlier one."""
    size = max(float(np.ptp(points, axis=0).max()), np.finfo(float).tiny)
    places = np.round((points - points.min(axis=0)) / (COINCIDENT * size))
    return len(points) - len(np.unique(places, axis=0))


def _combine(groups: dict[str, Ints]) -> tuple[Ints, Ints, dict[str, tuple[int, ...]]]:
    """Give each element one tag that states its groups.

    Args:
        groups: node numbers (m, nodes) of the elements of each group; an element may belong to
            several groups.

    Returns:
        The elements (k, nodes), each once; their tags (k,), from 1; and the tags of each group.
    """
    if not groups:
        return np.empty((0, 0), dtype=np.int64), np.empty(0, dtype=np.int64), {}
    rows = np.concatenate(list(groups.values()))
    group = np.repeat(np.arange(len(groups)), [len(elements) for elements in groups.values()])
    first, element, _ = distinct(rows)
    member = np.zeros((len(first), len(groups)), dtype=bool)
    member[element, group] = True
    kinds, tags = np.unique(member, axis=0, return_inverse=True)
    found = {
        name: tuple((np.flatnonzero(kinds[:, i]) + 1).tolist()) for i, name in enumerate(groups)
    }
    return rows[first], tags.ravel() + 1, found
