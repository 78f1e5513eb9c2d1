"""From the model in an open gmsh to a clean model that dolfinx can distribute.

The clean model holds the solid and its facet groups only. Every cell and every facet is in exactly
one physical group, and the nodes are numbered from 1 without gaps. The kinds of the cells, their
shapes and their facets are checked.
"""

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.fem.mesh.gmsh_cad import (
    QUADRATIC,
    Floats,
    Ints,
    add_elements,
    boundary_facets,
    cell_sides,
    elements_of,
    fits,
    group_entities,
    model_nodes,
    straight_places,
)
from fenicsrom.fem.mesh.sector import Sector, find_sector
from fenicsrom.formats.mesh_file import unsupported
from fenicsrom.formats.shapes import SHAPES, distinct, facet_kind, facets_of
from fenicsrom.formats.shapes import STRAIGHT as STRAIGHT_KINDS
from fenicsrom.notes import Note, NoteKind
from fenicsrom.scene import Geometry
from fenicsrom.scene.base.rules import Where
from fenicsrom.words import are, counted

ON_FACET = 1e-5
"""Nodes at smaller distances from a facet, relative to its size, lie on it.

Files with six significant digits place the nodes of a refined edge that accurately.
"""

WAYS_OUT = (
    "give bodies that touch a contact ([[contacts]] with against), or join them (by [[ties]], by "
    "common nodes, or as both bodies of one .step file)"
)
"""What to do about bodies that touch and are not joined."""

MOST_PIECES = 4
"""Most pieces of a mesh that a sentence names."""


def ends_of(piece: Ints, x: Floats, count: int) -> Floats:
    """Lowest and highest coordinates (2, count, d) of the points x (n, d) of each piece (n,)."""
    low, high = np.full((2, count, x.shape[1]), np.inf)
    np.minimum.at(low, piece, x)
    np.minimum.at(high, piece, -x)
    return np.array([low, -high])


def boxes(low: Floats, high: Floats) -> list[str]:
    """Name pieces of a mesh by their corners (k, d) in m."""
    size = float(np.max(high - low))
    low, high = (size * (np.round(end / size, 6) + 0.0) for end in (low, high))
    return [
        f"({', '.join(f'{a:.4g} to {b:.4g}' for a, b in zip(*ends, strict=True))})"
        for ends in zip(low, high, strict=True)
    ]


def apart(low: Floats, high: Floats) -> str:
    """A sentence on the k pieces of a mesh, given the corners (k, d) of each; "" for one piece."""
    if (number := len(low)) == 1:
        return ""
    named = ", ".join(boxes(low, high)[:MOST_PIECES])
    return (
        f"the mesh has {number} pieces that share no node, so they do not feel each other and "
        f"may pass through each other: {named}{', ..' * (number > MOST_PIECES)} m; "
        f"{WAYS_OUT}"
    )


def check_conforming(source: str, kind: int, cells: Ints, points: Floats, dimension: int) -> None:
    """Check that cells do not overlap and that no node hangs inside a facet of another cell.

    Connected pieces that touch one another need not match.

    Args:
        source: name of the mesh, for messages.
        kind: gmsh's number of the straight cell.
        cells: corners of the cells (k, corners), as indices of points.
        points: coordinates of the nodes (n, 3), m.
        dimension: dimension of the cells.

    Raises:
        SceneError: a coordinate is not finite, a facet belongs to more than two cells, or a node
            hangs inside a facet of its own piece.
    """
    if not np.isfinite(points).all():
        raise refuse(source, "a node has coordinates that are not finite", ErrorKind.MESH)
    facets = facets_of(kind, cells)
    facets = facets.reshape(-1, facets.shape[-1])
    first, _, count = distinct(facets)

    def refused(number: int, what: str, place: Floats, advice: str = "") -> SceneError:
        where = ", ".join(f"{value:.6g}" for value in place[:dimension])
        return refuse(source, f"{number} {what}, one at ({where}){advice}", ErrorKind.MESH)

    crowded = facets[first[count > 2]]
    if len(crowded):
        what = "facets belong to more than two cells, so cells overlap"
        raise refused(len(crowded), what, points[crowded[0]].mean(axis=0))
    node, facet = _hanging(boundary := facets[first[count == 1]], points)
    piece = pieces_of(cells, len(points))
    if len(hanging := np.unique(node[piece[node] == piece[boundary[facet, 0]]])):
        what = (
            "nodes lie on a facet of a cell that does not have them, so the cells there are not "
            "joined"
        )
        raise refused(len(hanging), what, points[hanging[0]], ": refine with whole cells")


def pieces_of(cells: Ints, size: int) -> Ints:
    """The connected piece of each of `size` nodes; cells (k, corners) that share a node are one."""
    rows, columns = np.repeat(cells[:, 0], cells.shape[1]), cells.ravel()
    graph = coo_array((np.ones(cells.size, dtype=bool), (rows, columns)), shape=(size, size))
    return connected_components(graph, directed=False)[1]


def _hanging(facets: Ints, points: Floats) -> tuple[Ints, Ints]:
    """Nodes (m,) of the boundary, and those of its facets (k, corners) inside which they lie."""
    nodes = np.unique(facets)
    x = points[facets]
    centre = x.mean(axis=1)
    radius = np.linalg.norm(x - centre[:, None], axis=2).max(axis=1)
    near = cKDTree(points[nodes]).query_ball_point(centre, radius)
    which = np.repeat(np.arange(len(facets)), [len(found) for found in near])
    node = nodes[np.concatenate([np.asarray(found, dtype=np.int64) for found in near])]
    other = ~(facets[which] == node[:, None]).any(axis=1)
    which, node = which[other], node[other]
    corners, place, size = x[which], points[node], radius[which]
    apart = np.linalg.norm(corners - place[:, None], axis=2).min(axis=1) > ON_FACET * size
    inside = np.zeros(len(node), dtype=bool)
    if facets.shape[1] == 2:
        inside = _on_segment(corners[:, 0], corners[:, 1], place, size)
    for a, b, c in {2: [], 3: [(0, 1, 2)], 4: [(0, 1, 2), (0, 2, 3)]}[facets.shape[1]]:
        inside |= _on_triangle(corners[:, a], corners[:, b], corners[:, c], place, size)
    return node[inside & apart], which[inside & apart]


def _on_segment(a: Floats, b: Floats, place: Floats, size: Floats) -> Ints:
    """Whether places (k, 3) in the ball around a segment from a to b (k, 3) lie on it."""
    along = b - a
    t = np.einsum("ki,ki->k", place - a, along) / np.einsum("ki,ki->k", along, along)
    off = np.linalg.norm(place - a - t[:, None] * along, axis=1)
    return off <= ON_FACET * size


def _on_triangle(a: Floats, b: Floats, c: Floats, place: Floats, size: Floats) -> Ints:
    """Whether places (k, 3) lie on the triangles a, b, c (k, 3)."""
    u, v, w = b - a, c - a, place - a
    normal = np.cross(u, v)
    area = np.einsum("ki,ki->k", normal, normal)
    area = np.where(area > 0.0, area, np.inf)
    off = np.abs(np.einsum("ki,ki->k", w, normal)) / np.sqrt(area)
    second = np.einsum("ki,ki->k", np.cross(w, v), normal) / area
    third = np.einsum("ki,ki->k", np.cross(u, w), normal) / area
    weights = np.column_stack([1.0 - second - third, second, third])
    return (off <= ON_FACET * size) & (weights >= -ON_FACET).all(axis=1)


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
        node_sets: for each node group that is a node set alone, the ends (k, 2), from 0, of the
            edges whose middle node is in the set.
        glued: names of the faces of a CAD file along which bodies are glued.
        sector: set if the body is one sector of a disk.
    """

    facet_groups: dict[str, tuple[int, ...]]
    cell_groups: dict[str, tuple[int, ...]]
    facets: dict[str, int]
    nodes: dict[str, tuple[Ints, Ints]]
    warnings: tuple[str, ...]
    node_sets: dict[str, Ints] = field(default_factory=dict)
    glued: Collection[str] = ()
    sector: Sector | None = None


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
    edges = _edges_of_sets(gmsh, in_cells[SOLID], given, sets, corners)
    node_groups, left_out = _node_groups(gmsh, source, d, sets, edges, corners)
    rows = {name: elements_of(gmsh, d - 1, on, facet) for name, on in in_facets.items()}
    boundary, around = boundary_facets(gmsh, d, in_cells[SOLID], given)
    if sets:
        rows = _facets_of_sets(boundary, SHAPES[facet].nodes, sets) | rows
    facets, facet_tags, facet_groups = _combine(rows)
    sizes = {name: int(np.isin(facet_tags, tags).sum()) for name, tags in facet_groups.items()}
    near = np.isin(facets, used).all(axis=1)
    if facet_groups and not near.any():
        reason = f"facet groups {', '.join(facet_groups)}: at least one facet must touch the cells"
        raise refuse(source, reason, ErrorKind.MESH)
    numbers, points = model_nodes(gmsh)
    points = points * geometry.scale
    at = np.searchsorted(numbers, cells[:, :vertices])
    check_conforming(source, kind, at, points, d)
    warnings += left_out
    if apart := _coincident(points, pieces_of(at, len(points)), np.unique(at)):
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
    curves = group_entities(gmsh, source, 1) if d == 3 else {}
    alone = {
        name: np.searchsorted(used, middles)
        for name, (_, middles) in edges.items()
        if name in found and name not in curves
    }
    sides = np.searchsorted(numbers, boundary[:, : SHAPES[facet_kind(kind)].corners])
    inside = points[np.searchsorted(numbers, around)].mean(axis=1)
    sector = find_sector(points, sides, inside)
    return CleanModel(facet_groups, cell_groups, sizes, found, warnings, alone, sector=sector)


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


def _edges_of_sets(
    gmsh: Any, solid: list[int], kind: int, sets: dict[str, Ints], corners: Ints
) -> dict[str, tuple[Ints, Ints]]:
    """Find the edges of the cells that belong to node sets.

    Args:
        gmsh: the open gmsh.
        solid: the entities of the cells.
        kind: kind of the cells.
        sets: node numbers of each node set.
        corners: sorted node numbers of the vertices of the cells.

    Returns:
        For each set, the ends (k, 2) of the edges that have all their nodes in the set, and of
        those that have their middle node in the set.
    """
    if not sets:
        return {}
    sides = [cell_sides(gmsh, entity, kind, 1) for entity in solid]
    edges = np.concatenate([rows for rows in sides if len(rows)])
    edges = edges[np.isin(edges[:, :2], corners).all(axis=1)].astype(np.int64)
    inside = {name: np.isin(edges, nodes) for name, nodes in sets.items()}

    def ends(marks: Ints) -> Ints:
        return np.unique(np.sort(edges[marks, :2], axis=1), axis=0)

    return {n: (ends(of.all(axis=1)), ends(of[:, 2:].any(axis=1))) for n, of in inside.items()}


def _node_groups(
    gmsh: Any,
    source: str,
    d: int,
    sets: dict[str, Ints],
    edges: dict[str, tuple[Ints, Ints]],
    corners: Ints,
) -> tuple[dict[str, tuple[Ints, Ints]], tuple[str, ...]]:
    """Collect the node groups: points, node sets and, in 3D, curves.

    Args:
        gmsh: the open gmsh.
        source: name of the file.
        d: dimension of the cells.
        sets: node numbers of each node set.
        edges: the edges of each node set.
        corners: sorted node numbers of the vertices of the cells.

    Returns:
        Node numbers of the vertices (n,) and of the ends of the edges (k, 2) of each group, and
        warnings.
    """
    curves = group_entities(gmsh, source, 1) if d == 3 else {}
    pairs = {name: elements_of(gmsh, 1, on, 1) for name, on in curves.items()}
    single = group_entities(gmsh, source, 0)
    points = {name: elements_of(gmsh, 0, on, 15).ravel() for name, on in single.items()} | sets
    if d == 3:
        for name, (whole, _) in edges.items():
            pairs[name] = np.concatenate([pairs[name], whole]) if name in pairs else whole
    found, warnings = {}, []
    for name in sorted(pairs.keys() | points.keys()):
        ends = pairs.get(name, np.empty((0, 2), dtype=np.int64)).astype(np.int64)
        nodes = np.union1d(points.get(name, np.empty(0)).astype(np.int64), ends.ravel())
        kept = nodes[np.isin(nodes, corners)]
        if len(kept):
            found[name] = (kept, ends[np.isin(ends, corners).all(axis=1)])
        else:
            what = f"{source}: node group {name!r} has no vertex of the cells and is left out"
            warnings.append(Note(NoteKind.REMARK, what))
    return found, tuple(warnings)


def _coincident(points: Floats, piece: Ints, corners: Ints) -> int:
    """How many corners (c,) of cells coincide with an earlier one of the same piece."""
    points, piece = points[corners], piece[corners]
    size = max(float(np.ptp(points, axis=0).max()), np.finfo(float).tiny)
    places = np.round((points - points.min(axis=0)) / (COINCIDENT * size))
    return len(points) - len(np.unique(np.column_stack([places, piece]), axis=0))


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


DEGENERATE = 1e-12
"""Smaller Jacobian determinants, relative to the cell size to the power d, count as zero."""

STRAIGHT = 1e-4
"""Accepted distance of a node from its place in the straight cell, relative to the cell: the
rounding of decks, whose fields may have eight characters."""

PLANAR = 1e-9
"""Smaller variations of z in a 2D mesh, relative to the extent, count as zero."""


def check_cells(
    gmsh: Any, geometry: Geometry, solid: list[int]
) -> tuple[int, int, tuple[str, ...]]:
    """Check kind, shape and orientation of the cells.

    Args:
        gmsh: the open gmsh.
        geometry: the [geometry] of the scene.
        solid: the entities of the cells.

    Returns:
        The kind of the cells, the kind of the straight cell, and warnings.

    Raises:
        SceneError: the cells cannot be used.
    """
    source, d = str(geometry.mesh), geometry.dimension
    given, kind = _cell_kinds(gmsh, geometry, solid)
    numbers, points = model_nodes(gmsh)
    cells = [
        points[np.searchsorted(numbers, elements_of(gmsh, d, [entity], given))] for entity in solid
    ]
    cells = [x for x in cells if len(x)]
    spread = np.ptp([[x.min(axis=(0, 1)), x.max(axis=(0, 1))] for x in cells], axis=(0, 1))
    if d == 2 and spread[2] > PLANAR * spread.max():
        reason = (
            f"the cells are a surface in space (z differs by {spread[2]:g} m): shells are not "
            "supported; give a mesh of solids, or a plane body in the plane z = constant"
        )
        raise refuse(source, reason, ErrorKind.MESH, "geometry.dimension")
    moved = _check_shapes(gmsh, geometry, given, kind, [x[:, :, :d] for x in cells])
    warnings = [
        f"{source}: {line[9:]}" for line in gmsh.logger.get() if line.startswith("Warning: ")
    ]
    if not geometry.curved and moved > STRAIGHT:
        warnings.append(
            f"{source}: curved cells are made straight, which moves a node by up to "
            f"{100 * moved:.2g} % of the size of its cell; "
            "set geometry.curved = true to keep the curves"
        )
    return given, kind, tuple(warnings)


def _cell_kinds(gmsh: Any, geometry: Geometry, solid: list[int]) -> tuple[int, int]:
    """Find the one kind of the cells and the kind of the straight cell.

    Raises:
        SceneError: the kinds are mixed, unsupported, or not the ones that the scene asks for.
    """
    source, d = str(geometry.mesh), geometry.dimension

    types = sorted(
        {int(kind) for entity in solid for kind in gmsh.model.mesh.getElementTypes(d, entity)}
    )
    properties = [gmsh.model.mesh.getElementProperties(kind) for kind in types]
    names = ", ".join(entry[0] for entry in properties)
    if not types:
        raise refuse(source, f"there are no cells of dimension {d}", ErrorKind.MESH)
    if len(types) != 1:
        reason = f"the cells must be of one type, but they are {names}"
        raise refuse(source, reason, ErrorKind.MESH)
    given, vertices = types[0], properties[0][5]
    kind = STRAIGHT_KINDS.get((d, vertices))
    if kind is None:
        raise refuse(source, unsupported(f"cells of type {names}"), ErrorKind.MESH)
    if geometry.cells is not None and (geometry.cells == "simplex") != (vertices == d + 1):
        where = Where(source, "geometry.cells")
        raise where.refuse(geometry.cells, f"the cells are {names}", ErrorKind.CONFLICT)
    if geometry.curved and given != QUADRATIC[kind]:
        curved = gmsh.model.mesh.getElementProperties(QUADRATIC[kind])[0]
        where = Where(source, "geometry.curved")
        raise where.refuse(True, f"needs {curved}, but the cells are {names}", ErrorKind.CONFLICT)
    return given, kind


def _check_shapes(
    gmsh: Any, geometry: Geometry, given: int, kind: int, cells: list[Floats]
) -> float:
    """Check that no cell is inverted or degenerate.

    Args:
        gmsh: the open gmsh.
        geometry: the [geometry] of the scene.
        given: kind of the cells.
        kind: kind of the straight cell.
        cells: coordinates (c, nodes, d) of the nodes of the cells of each entity, m.

    Returns:
        The largest distance of a node from its place in the straight cell, relative to the cell.

    Raises:
        SceneError: a Jacobian determinant is zero, or its sign differs from the others.
    """
    source, d = str(geometry.mesh), geometry.dimension
    reference = np.reshape(gmsh.model.mesh.getElementProperties(given)[4], (-1, d))
    local = np.pad(reference, ((0, 0), (0, 3 - d)))
    moved = 0.0
    for x in cells:
        size = np.ptp(x, axis=1).max(axis=1)
        det = determinants(gmsh, given if geometry.curved else kind, local, x)
        bad = np.flatnonzero((det * np.sign(det.sum())).min(axis=1) <= DEGENERATE * size**d)
        if len(bad):
            where = ", ".join(f"{value:.6g}" for value in x[bad[0]].mean(axis=0))
            reason = f"{counted(len(bad), 'cell')} {are(len(bad))} inverted or degenerate, one at "
            reason += f"({where}): must have a Jacobian determinant of one sign"
            raise refuse(source, reason, ErrorKind.MESH)
        off = np.linalg.norm(straight_places(gmsh, given, x) - x, axis=2)
        moved = max(moved, (off.max(axis=1) / size).max())
    return moved


def check_facets(gmsh: Any, source: str, d: int, groups: dict[str, list[int]], kind: int) -> None:
    """Check that the facets of each group are of the kind that these cells have.

    Raises:
        SceneError: the facets of a group are of another kind.
    """
    for name, entities in groups.items():
        types = [t for entity in entities for t in gmsh.model.mesh.getElementTypes(d, entity)]
        for given in types:
            if not fits(gmsh, given, kind):
                have, need = (gmsh.model.mesh.getElementProperties(k)[0] for k in (given, kind))
                reason = f"has facets of type {have}, but the cells have facets of type {need}"
                raise refuse(source, f"group {name!r} {reason}", ErrorKind.MESH)


def determinants(gmsh: Any, kind: int, local: Floats, cells: Floats) -> Floats:
    """Jacobian determinants of cells at their own nodes.

    Args:
        gmsh: the open gmsh.
        kind: gmsh type of the cells, with p nodes.
        local: reference nodes, shape (at least p, 3).
        cells: coordinates of the nodes in m, shape (c, at least p, d).

    Returns:
        Determinants, shape (c, p).
    """
    p, d = gmsh.model.mesh.getElementProperties(kind)[3], cells.shape[2]
    _, gradients, _ = gmsh.model.mesh.getBasisFunctions(kind, local[:p].ravel(), "GradLagrange")
    gradients = np.reshape(gradients, (p, p, 3))[:, :, :d]
    parts = np.array_split(cells[:, :p], 1 + len(cells) // 10_000)
    return np.concatenate(
        [np.linalg.det(np.einsum("pni,cnj->cpij", gradients, part)) for part in parts]
    )
