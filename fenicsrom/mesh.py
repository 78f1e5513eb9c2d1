"""Meshes with named groups, from gmsh geometry with parameters (.geo) and gmsh meshes (.msh).

Rank 0 reads the file with gmsh, checks the cells and hands a clean model to dolfinx, which distributes it. What rank 0
refuses is raised on every rank.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import dolfinx.mesh
import numpy as np
import numpy.typing as npt
import ufl
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fenicsrom import compat
from fenicsrom.errors import SceneError
from fenicsrom.scene import Geometry

Ints = npt.NDArray[Any]
Floats = npt.NDArray[np.float64]

SOLID = "solid"  # the cells that are meshed; without a group of this name, all cells
FACETS = {2: 1, 3: 1, 4: 2, 5: 3}  # gmsh type of the facets of triangle, quadrilateral, tetrahedron, hexahedron
QUADRATIC = {1: 8, 2: 9, 3: 10, 4: 11, 5: 12}  # gmsh type with all nodes of degree 2
DEGENERATE = 1e-12  # smallest Jacobian determinant, relative to the size of the cell to the power of its dimension
STRAIGHT = 1e-6  # largest distance of a node from its place in the straight cell, relative to the size of the cell


@dataclass(frozen=True, eq=False)
class Mesh:
    """A distributed mesh with named groups of cells and facets.

    Attributes:
        domain: the dolfinx mesh, in metres.
        cell_tags: tags of the cells.
        facet_tags: tags of the facets in a group.
        groups: dimension and tags of each group by name; facets (or cells) with any of the tags belong to it.
        source: path of the file it came from.
        warnings: what a user should know, a sentence each.
    """

    domain: dolfinx.mesh.Mesh
    cell_tags: dolfinx.mesh.MeshTags
    facet_tags: dolfinx.mesh.MeshTags
    groups: dict[str, tuple[int, tuple[int, ...]]]
    source: str
    warnings: tuple[str, ...] = ()

    def facets(self, name: str) -> npt.NDArray[np.int32]:
        """Give the facets of a group on this rank.

        Args:
            name: a facet group.

        Returns:
            Sorted local facet indices, shape (k,). A facet between two ranks is on both; k may be 0.

        Raises:
            SceneError: the mesh has no such facet group (on every rank).
        """
        below = self.domain.topology.dim - 1
        dimension, tags = self.groups.get(name, (None, ()))
        if dimension != below:
            known = ", ".join(sorted(group for group, (dim, _) in self.groups.items() if dim == below))
            raise SceneError(f"{self.source}: no facet group {name!r}: must be one of {known or '(there are none)'}")
        return np.sort(self.facet_tags.indices[np.isin(self.facet_tags.values, tags)])

    def surface(self, name: str) -> ufl.Measure:
        """Give the measure of a facet group, inside the body as well as on its boundary.

        Each facet counts once, seen from one of its cells: right for continuous fields. UFL takes one such measure in a
        form.

        Args:
            name: a facet group.

        Returns:
            A measure for `form`: in m (2D) or m² (3D).

        Raises:
            SceneError: the mesh has no such facet group.
        """
        facets = self.facets(name)
        topology = self.domain.topology
        d = topology.dim
        topology.create_connectivity(d - 1, d)
        topology.create_connectivity(d, d - 1)
        facets = facets[facets < topology.index_map(d - 1).size_local]
        to_cells, to_facets = topology.connectivity(d - 1, d), topology.connectivity(d, d - 1)
        cells = to_cells.array[to_cells.offsets[facets]]
        local = [np.flatnonzero(to_facets.links(c) == f)[0] for c, f in zip(cells, facets, strict=True)]
        sides = np.column_stack([cells, local]).astype(np.int32).ravel()
        return ufl.Measure("ds", domain=self.domain, subdomain_data=[(1, sides)], subdomain_id=1)


def build_mesh(geometry: Geometry, comm: MPI.Comm) -> Mesh:
    """Make or read the mesh of a scene.

    A .geo file gets `geometry.parameters` by the names in its `DefineConstant`, and `structured` = 1 or 0 from
    `geometry.cells` where it has that name; `Error("...")` in the file refuses them. A .msh file may have any version
    gmsh reads. Groups are the physical groups of cells and facets (by their number where they have no name).

    Args:
        geometry: the part of the scene on the mesh.
        comm: communicator to distribute the mesh on.

    Returns:
        The mesh, its groups the same on every rank.

    Raises:
        SceneError: on every rank, if the file cannot be read or meshed, a parameter is unknown or refused, cells are
            mixed, inverted or of another dimension or kind than the scene's, or a group is empty.
        RuntimeError: gmsh is in use in this process.
    """
    source = str(geometry.mesh)
    with ExitStack() as stack:
        model, draft, failure = None, None, None
        if comm.rank == 0:
            try:
                gmsh = stack.enter_context(_gmsh())
                draft, model = _draft(gmsh, geometry), gmsh.model
            except Exception as error:
                failure = error
        failure, draft = comm.bcast((failure, draft))
        if failure is not None:
            raise failure
        domain, cell_tags, facet_tags = compat.model_to_mesh(model, comm, geometry.dimension)
    groups, warnings = _found(source, draft, facet_tags, domain)
    return Mesh(domain, cell_tags, facet_tags, groups, source, warnings)


def unclamped_pieces(mesh: Mesh, facet_groups: Sequence[str]) -> int:
    """Count the connected pieces of the mesh that no clamped facet holds.

    Cells that share a vertex are connected. Each rank joins its own cells, then the pieces of the ranks are joined
    through the vertices they share: only those are gathered. Collective.

    Args:
        mesh: the mesh.
        facet_groups: the clamped facet groups.

    Returns:
        The number of pieces free to move as a rigid body, the same on every rank.

    Raises:
        SceneError: the mesh has no such facet group.
    """
    comm, topology = mesh.domain.comm, mesh.domain.topology
    topology.create_connectivity(topology.dim - 1, 0)
    clamped = [topology.connectivity(topology.dim - 1, 0).links(f) for name in facet_groups for f in mesh.facets(name)]

    vertices, corners = topology.index_map(0), topology.connectivity(topology.dim, 0)
    cells, points = topology.index_map(topology.dim).size_local, vertices.size_local + vertices.num_ghosts
    cell = np.repeat(np.arange(cells), np.diff(corners.offsets[: cells + 1]))
    piece = _components(cell, cells + corners.array[: len(cell)], cells + points)[cells:]
    held = np.zeros(cells + points, dtype=bool)
    held[piece[np.unique(np.concatenate([*clamped, np.empty(0, dtype=np.int32)]))]] = True

    border = np.unique(np.concatenate(comm.allgather(vertices.ghosts)))
    names = vertices.local_to_global(np.arange(points, dtype=np.int32))
    shared = np.isin(names, border)
    parts = comm.allgather((held[: piece.max(initial=-1) + 1], piece[shared], np.searchsorted(border, names[shared])))
    first = np.cumsum([0] + [len(part[0]) for part in parts])
    rows = np.concatenate([part[1] + start for part, start in zip(parts, first[:-1], strict=True)])
    whole = _components(rows, first[-1] + np.concatenate([part[2] for part in parts]), first[-1] + len(border))
    pieces = whole[: first[-1]]
    return len(np.setdiff1d(pieces, pieces[np.concatenate([part[0] for part in parts])]))


def _components(rows: Ints, columns: Ints, size: int) -> Ints:
    """Number the connected components of an undirected graph of `size` nodes, by node."""
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(size, size))
    return connected_components(graph, directed=False)[1]


# What rank 0 does: from the file to a gmsh model that holds the solid and its facet groups, and nothing else.


@dataclass(frozen=True)
class _Draft:
    """What rank 0 tells the others.

    Attributes:
        groups: dimension and tags of each group.
        facets: number of facets the file has in each facet group.
        warnings: sentences.
    """

    groups: dict[str, tuple[int, tuple[int, ...]]]
    facets: dict[str, int]
    warnings: tuple[str, ...]


@contextmanager
def _gmsh() -> Iterator[Any]:
    """Open gmsh, quiet, without the user's settings and leaving interrupts to Python; close it at the end."""
    import gmsh

    if gmsh.isInitialized():
        raise RuntimeError("gmsh is in use in this process: call gmsh.finalize() before a mesh is built")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.AbortOnError", 0)  # errors go to the logger: an abort breaks gmsh's parser
        gmsh.logger.start()
        yield gmsh
    finally:
        gmsh.logger.stop()
        gmsh.finalize()


def _draft(gmsh: Any, geometry: Geometry) -> _Draft:
    """Read the file, check it, and put a clean model in its place."""
    source, d = str(geometry.mesh), geometry.dimension
    _load(gmsh, geometry)
    in_cells, in_facets = _entities(gmsh, source, d), _entities(gmsh, source, d - 1)
    if shared := {SOLID, *in_cells} & in_facets.keys():
        raise SceneError(f"{source}: group {min(shared)!r} has dimension {d - 1}: must have {d} or another name")
    if not in_facets:
        raise SceneError(f"{source}: no facet group: must have at least one, to be clamped")
    in_cells.setdefault(SOLID, [entity for _, entity in gmsh.model.getEntities(d)])
    kind, warnings = _check_cells(gmsh, geometry, in_cells[SOLID])
    cell, facet = (QUADRATIC[kind], QUADRATIC[FACETS[kind]]) if geometry.curved else (kind, FACETS[kind])
    _check_facets(gmsh, source, d - 1, in_facets, facet)

    cells, cell_tags, groups = _combine({name: _elements(gmsh, d, on, cell) for name, on in in_cells.items()})
    solid = np.isin(cell_tags, groups[SOLID])
    cells, cell_tags = cells[solid], cell_tags[solid]
    cell_groups = {name: (d, tags) for name, tags in groups.items() if np.isin(tags, cell_tags).any()}
    facets, facet_tags, groups = _combine({name: _elements(gmsh, d - 1, on, facet) for name, on in in_facets.items()})
    facet_groups = {name: (d - 1, tags) for name, tags in groups.items()}
    sizes = {name: int(np.isin(facet_tags, tags).sum()) for name, tags in groups.items()}
    used = np.unique(cells)
    near = np.isin(facets, used).all(axis=1)
    if not near.any():
        raise SceneError(f"{source}: facet groups {', '.join(groups)}: must touch the cells, to be clamped")
    numbers, points = _nodes(gmsh)

    gmsh.model.remove()
    gmsh.model.add(SOLID)
    gmsh.model.addDiscreteEntity(d, 1)
    gmsh.model.mesh.addNodes(d, 1, np.arange(len(used)) + 1, points[np.searchsorted(numbers, used)].ravel())
    _add(gmsh, d, cell, np.searchsorted(used, cells) + 1, cell_tags)
    _add(gmsh, d - 1, facet, np.searchsorted(used, facets[near]) + 1, facet_tags[near])
    return _Draft(cell_groups | facet_groups, sizes, warnings)


def _load(gmsh: Any, geometry: Geometry) -> None:
    """Read the file and, if it is a geometry, mesh it."""
    source, d, parametric = str(geometry.mesh), geometry.dimension, geometry.mesh.suffix == ".geo"
    if not geometry.mesh.is_file() or geometry.mesh.suffix not in (".geo", ".msh"):
        raise SceneError(f"geometry.mesh = {source!r}: must be an existing .geo or .msh file")
    gmsh.model.add("file")
    if parametric:
        known = _parameters(geometry.mesh)
        if "structured" in known:
            gmsh.parser.setNumber("structured", [float(geometry.cells != "simplex")])
        for name, value in geometry.parameters.items():
            if name not in known - {"structured"}:
                allowed = ", ".join(sorted(known - {"structured"})) or "none, as the file has no DefineConstant"
                raise SceneError(f"{source}: geometry.parameters.{name} = {value:g}: name must be one of {allowed}")
            gmsh.parser.setNumber(name, [value])
    with _errors(gmsh, source):
        gmsh.merge(source)
    if gmsh.model.getDimension() != d:
        raise SceneError(f"{source}: geometry.dimension = {d}: must be {gmsh.model.getDimension()} for this file")
    if parametric:
        with _errors(gmsh, source):
            gmsh.model.mesh.generate(d)
            if geometry.curved:
                gmsh.model.mesh.setOrder(2)


@contextmanager
def _errors(gmsh: Any, source: str) -> Iterator[None]:
    """Raise the first error of gmsh, which is in its log whether it raised anything or not."""
    failure = None
    try:
        yield
    except Exception as error:  # gmsh has no type of its own
        failure = error
    errors = [line.partition(":")[2] for line in gmsh.logger.get() if line.startswith("Error")]
    if errors or failure is not None:
        raise SceneError(f"{source}: " + " ".join((errors or [str(failure)])[0].split())) from failure


def _parameters(path: Path) -> set[str]:
    """Names in the DefineConstant of a .geo file."""
    text = re.sub(r'"[^"\n]*"|//[^\n]*|/\*.*?\*/', "", path.read_text(errors="replace"), flags=re.DOTALL)
    while (inner := re.sub(r"\{[^{}]*\}", "", text)) != text:
        text = inner
    blocks = re.findall(r"\bDefineConstant\s*\[([^]]*)\]", text)
    return {entry.partition("=")[0].strip() for block in blocks for entry in block.split(",")} - {""}


def _entities(gmsh: Any, source: str, d: int) -> dict[str, list[int]]:
    """Entities of each physical group of dimension d, by its name or, without one, its number."""
    groups = {}
    for _, tag in gmsh.model.getPhysicalGroups(d):
        name = gmsh.model.getPhysicalName(d, tag) or str(tag)
        groups[name] = [*groups.get(name, []), *gmsh.model.getEntitiesForPhysicalGroup(d, tag)]
    for name, entities in groups.items():
        if not any(len(block) for entity in entities for block in gmsh.model.mesh.getElements(d, entity)[1]):
            raise SceneError(f"{source}: group {name!r} is empty: must have cells or facets of the mesh")
    return groups


def _nodes(gmsh: Any) -> tuple[Ints, Floats]:
    """Sorted numbers of the nodes, shape (n,), and their coordinates, shape (n, 3)."""
    numbers, coordinates, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(numbers)
    return numbers[order], coordinates.reshape(-1, 3)[order]


def _fits(gmsh: Any, given: int, kind: int) -> bool:
    """Whether elements of a type can be used as those of another: are the same, or of higher degree than straight."""
    _, _, degree, _, _, vertices = gmsh.model.mesh.getElementProperties(kind)
    return given == kind or (degree == 1 and gmsh.model.mesh.getElementProperties(given)[5] == vertices)


def _elements(gmsh: Any, d: int, entities: list[int], kind: int) -> Ints:
    """Node numbers of the elements that fit a type, shape (m, nodes of the type)."""
    width = gmsh.model.mesh.getElementProperties(kind)[3]
    blocks = [np.empty((0, width), dtype=np.uint64)]
    for entity in entities:
        for given, elements, nodes in zip(*gmsh.model.mesh.getElements(d, entity), strict=True):
            if _fits(gmsh, given, kind):
                blocks.append(nodes.reshape(len(elements), -1)[:, :width])
    return np.concatenate(blocks)


def _add(gmsh: Any, d: int, kind: int, elements: Ints, tags: Ints) -> None:
    """Add elements of a type to the model, in a physical group for each tag."""
    for tag in np.unique(tags):
        entity = gmsh.model.addDiscreteEntity(d)
        gmsh.model.mesh.addElementsByType(entity, kind, [], elements[tags == tag].ravel())
        gmsh.model.addPhysicalGroup(d, [entity], int(tag))


def _combine(groups: dict[str, Ints]) -> tuple[Ints, Ints, dict[str, tuple[int, ...]]]:
    """Give each element one tag that says which groups it is in.

    Args:
        groups: node numbers of the elements of each group, shape (m, nodes); an element may be in many groups.

    Returns:
        The elements, once each, shape (k, nodes); their tags from 1, shape (k,); the tags of each group.
    """
    rows = np.concatenate(list(groups.values()))
    group = np.repeat(np.arange(len(groups)), [len(elements) for elements in groups.values()])
    _, first, element = np.unique(np.sort(rows, axis=1), axis=0, return_index=True, return_inverse=True)
    member = np.zeros((len(first), len(groups)), dtype=bool)
    member[element.ravel(), group] = True
    kinds, tags = np.unique(member, axis=0, return_inverse=True)
    found = {name: tuple((np.flatnonzero(kinds[:, i]) + 1).tolist()) for i, name in enumerate(groups)}
    return rows[first], tags.ravel() + 1, found


def _check_cells(gmsh: Any, geometry: Geometry, solid: list[int]) -> tuple[int, tuple[str, ...]]:
    """Check type, shape and orientation of the cells.

    Args:
        gmsh: the open gmsh.
        geometry: what the scene asks for.
        solid: the entities of the cells.

    Returns:
        The gmsh type of the straight cell, and warnings.
    """
    source, d = str(geometry.mesh), geometry.dimension
    types = sorted({int(kind) for entity in solid for kind in gmsh.model.mesh.getElementTypes(d, entity)})
    properties = [gmsh.model.mesh.getElementProperties(kind) for kind in types]
    names = ", ".join(entry[0] for entry in properties)
    if len(types) != 1:
        raise SceneError(f"{source}: cells {names or '(none)'}: must be of one type")
    given, reference, vertices = types[0], np.reshape(properties[0][4], (-1, d)), properties[0][5]
    kind = {(2, 3): 2, (2, 4): 3, (3, 4): 4, (3, 8): 5}.get((d, vertices))
    if kind is None:
        raise SceneError(f"{source}: cells {names}: must be triangles, quadrilaterals, tetrahedra or hexahedra")
    if geometry.cells is not None and (geometry.cells == "simplex") != (vertices == d + 1):
        raise SceneError(f"{source}: geometry.cells = {geometry.cells!r}: must be the other, the file makes {names}")
    if geometry.curved and given != QUADRATIC[kind]:
        curved = gmsh.model.mesh.getElementProperties(QUADRATIC[kind])[0]
        raise SceneError(f"{source}: geometry.curved = true: cells must be {curved}, the file has {names}")

    numbers, points = _nodes(gmsh)
    cells = [points[np.searchsorted(numbers, _elements(gmsh, d, [entity], given))] for entity in solid]
    spread = np.ptp([[np.min(x, axis=(0, 1)), np.max(x, axis=(0, 1))] for x in cells if len(x)], axis=(0, 1))
    if d == 2 and spread[2] > 1e-9 * spread.max():
        raise SceneError(f"{source}: z differs by {spread[2]:g} m: must be constant where geometry.dimension = 2")
    local = np.pad(reference, ((0, 0), (0, 3 - d)))
    _, weights, _ = gmsh.model.mesh.getBasisFunctions(kind, local.ravel(), "Lagrange")
    moved = 0.0
    for x in (x[:, :, :d] for x in cells if len(x)):
        size = np.ptp(x, axis=1).max(axis=1)
        det = _determinants(gmsh, given if geometry.curved else kind, local, x)
        bad = np.flatnonzero((det * np.sign(det.sum())).min(axis=1) <= DEGENERATE * size**d)
        if len(bad):
            where = ", ".join(f"{value:.6g}" for value in x[bad[0]].mean(axis=0))
            raise SceneError(f"{source}: {len(bad)} cells are inverted or degenerate, one at ({where}): "
                             "must have a Jacobian determinant of one sign")
        straight = np.einsum("pn,cnj->cpj", np.reshape(weights, (-1, vertices)), x[:, :vertices])
        moved = max(moved, (np.linalg.norm(straight - x, axis=2).max(axis=1) / size).max())
    warnings = [f"{source}: {line[9:]}" for line in gmsh.logger.get() if line.startswith("Warning: ")]
    if not geometry.curved and moved > STRAIGHT:
        warnings.append(f"{source}: curved cells are made straight, a node moves by up to {100 * moved:.2g} % of the "
                        "size of its cell: geometry.curved = true keeps the curves")
    return kind, tuple(warnings)


def _check_facets(gmsh: Any, source: str, d: int, groups: dict[str, list[int]], kind: int) -> None:
    """Refuse facets that cannot be facets of the cells because of their type."""
    for name, entities in groups.items():
        types = {int(given) for entity in entities for given in gmsh.model.mesh.getElementTypes(d, entity)}
        for given in sorted(types):
            if not _fits(gmsh, given, kind):
                have, need = (gmsh.model.mesh.getElementProperties(type_)[0] for type_ in (given, kind))
                raise SceneError(f"{source}: group {name!r} has facets {have}: must be {need} for these cells")


def _determinants(gmsh: Any, kind: int, local: Floats, cells: Floats) -> Floats:
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
    return np.concatenate([np.linalg.det(np.einsum("pni,cnj->cpij", gradients, part)) for part in parts])


def _found(
    source: str, draft: _Draft, facet_tags: dolfinx.mesh.MeshTags, domain: dolfinx.mesh.Mesh
) -> tuple[dict[str, tuple[int, tuple[int, ...]]], tuple[str, ...]]:
    """Leave out the facets that are not facets of a cell, and say so. Collective."""
    below = domain.topology.dim - 1
    tags = facet_tags.values[facet_tags.indices < domain.topology.index_map(below).size_local]
    number = domain.comm.allreduce(np.bincount(tags, minlength=1 + max(max(t) for _, t in draft.groups.values())))
    groups, warnings = dict(draft.groups), list(draft.warnings)
    for name, size in draft.facets.items():
        lost = size - int(number[list(groups[name][1])].sum())
        if lost:
            what = f"{lost} of {size} facets are not facets of a cell and are left out"
            warnings.append(f"{source}: group {name!r}: {what}")
        if lost == size:
            del groups[name]
    return groups, tuple(warnings)
