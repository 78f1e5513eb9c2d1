"""Meshes with named groups: made from .geo (with parameters) and .step, read from .msh, .inp, .bdf
and .vtu.

Rank 0 reads the file into gmsh (through meshio what gmsh does not read), checks the cells and hands
a clean model to dolfinx, which distributes it. What rank 0 refuses is raised on every rank.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import dolfinx.mesh
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fenicsrom.errors import SceneError
from fenicsrom.fem import compat, formats
from fenicsrom.scene import Geometry, Region

Ints = npt.NDArray[Any]
Floats = npt.NDArray[np.float64]

SOLID = "solid"  # the cells that are meshed; without a group of this name, all cells
FACETS = {
    2: 1,
    3: 1,
    4: 2,
    5: 3,
}  # gmsh type of the facets of triangle, quadrilateral, tetrahedron, hexahedron
QUADRATIC = {1: 8, 2: 9, 3: 10, 4: 11, 5: 12}  # gmsh type with all nodes of degree 2
# smallest Jacobian determinant, relative to the size of the cell to the power of its dimension
DEGENERATE = 1e-12
# largest distance of a node from its place in the straight cell, relative to the size of the cell
STRAIGHT = 1e-6
ON_PLANE = 1e-6  # default tolerance of a picking plane, relative to the extent of the mesh
FARTHEST = (
    1e15  # coordinate of a geometry, in its own unit, beyond which gmsh crashes or fills all memory
)
MOST_CELLS = 1e5  # of the size that is asked for, along the body
ROUNDING = 1e-9  # distance that counts as none, relative to the extent of the mesh

SUFFIXES = {
    ".geo": "geo",
    ".msh": "msh",
    ".step": "step",
    ".stp": "step",
    ".inp": "abaqus",
    ".bdf": "nastran",
    ".nas": "nastran",
    ".vtu": "vtu",
}

# reads a file as far as this program does, whatever comes of it: all that matters is whether the
# process survives
_READ = """
import sys, gmsh
gmsh.initialize(readConfigFiles=False, interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
gmsh.option.setNumber("General.AbortOnError", 0)
try:
    gmsh.model.add("file")
    gmsh.merge(sys.argv[1])
    gmsh.model.mesh.getNodes()
    for d, tag in gmsh.model.getEntities():
        for kind in gmsh.model.mesh.getElements(d, tag)[0]:
            gmsh.model.mesh.getElementProperties(kind)
    for d, tag in gmsh.model.getPhysicalGroups():
        gmsh.model.getEntitiesForPhysicalGroup(d, tag)
except Exception:
    pass
gmsh.finalize()
"""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A distributed mesh with named groups of cells, facets and nodes.

    Attributes:
        domain: the dolfinx mesh, in metres.
        cell_tags: tags of the cells.
        facet_tags: tags of the facets in a group.
        groups: dimension and tags of each group by name; facets (or cells) with any of the tags
        belong to it.
        source: path of the file it came from.
        warnings: what a user should know, a sentence each.
        node_groups: local vertices and, in 3D, local edges of each node group by name: of a point
            or a curve of a gmsh file, or a node set. A node set on the boundary has its facets in a
            facet group of the same name.
    """

    domain: dolfinx.mesh.Mesh
    cell_tags: dolfinx.mesh.MeshTags
    facet_tags: dolfinx.mesh.MeshTags
    groups: dict[str, tuple[int, tuple[int, ...]]]
    source: str
    warnings: tuple[str, ...] = ()
    node_groups: dict[str, tuple[Ints, Ints]] = field(default_factory=dict)

    def has_facets(self, where: str | Region) -> bool:
        """Whether a region is made of facets: a facet group or picked by coordinates, not a node
        group alone.
        """
        name = where.group if isinstance(where, Region) else where
        return name is None or self.groups.get(name, (None,))[0] == self.domain.topology.dim - 1

    def facets(self, where: str | Region) -> npt.NDArray[np.int32]:
        """Give the facets of a group or a pick on this rank. Collective.

        Args:
            where: a facet group, or a region of the scene.

        Returns:
            Sorted local facet indices, shape (k,). A facet between two ranks may be on both; k may
            be 0.

        Raises:
            SceneError: the mesh has no such facet group, or no facet of the boundary is picked (on
                every rank).
        """
        if isinstance(where, Region) and where.group is None:
            return self._picked(where)
        name = where.group if isinstance(where, Region) else where
        below = self.domain.topology.dim - 1
        dimension, tags = self.groups.get(str(name), (None, ()))
        if dimension != below:
            known = ", ".join(
                sorted(group for group, (dim, _) in self.groups.items() if dim == below)
            )
            raise SceneError(
                f"{self.source}: no facet group {name!r}: must be one of {known or '(there are none)'}"
            )
        return np.sort(self.facet_tags.indices[np.isin(self.facet_tags.values, tags)])

    def _picked(self, region: Region) -> npt.NDArray[np.int32]:
        """Facets of the boundary in a box or on a plane. Collective."""
        d = self.domain.geometry.dim
        low, high = self.bounds()
        extent = float(np.max(high - low))
        if region.box is not None:
            corners = np.array(region.box)
            what = f"box = {corners.tolist()}"

            def inside(x: Floats) -> npt.NDArray[np.bool_]:
                margin = ROUNDING * extent
                above, below = (
                    x[:d] >= corners[0, :, None] - margin,
                    x[:d] <= corners[1, :, None] + margin,
                )
                return np.all(above & below, axis=0)
        else:
            assert region.plane is not None
            point, normal = np.array(region.plane.point), np.array(region.plane.normal)
            tolerance = region.plane.tolerance or ON_PLANE * extent
            what = f"plane = {{ point = {point.tolist()}, normal = {normal.tolist()}, tolerance = {tolerance:.3g} }}"

            def inside(x: Floats) -> npt.NDArray[np.bool_]:
                return np.abs(normal @ (x[:d] - point[:, None])) <= tolerance

        facets = dolfinx.mesh.locate_entities_boundary(
            self.domain, self.domain.topology.dim - 1, inside
        )
        if not self.domain.comm.allreduce(len(facets)):
            reach = " to ".join(
                f"({', '.join(f'{v:.6g}' for v in corner[:d])})" for corner in (low, high)
            )
            raise SceneError(
                f"{self.source}: {what}: no facet of the boundary lies there: the mesh is from {reach}"
            )
        return np.sort(facets)

    def entities(self, where: str | Region) -> dict[int, Ints]:
        """Give what a region is made of on this rank: facets, and the vertices and edges of a node
        group. Collective.

        Args:
            where: a facet or node group, or a region of the scene.

        Returns:
            Local entities by their dimension.

        Raises:
            SceneError: the mesh has no such group, or nothing is picked.
        """
        name = where.group if isinstance(where, Region) else where
        below = self.domain.topology.dim - 1
        if name not in self.node_groups:
            if self.node_groups and not self.has_facets(where):
                known = {
                    group for group, (dim, _) in self.groups.items() if dim == below
                } | self.node_groups.keys()
                raise SceneError(
                    f"{self.source}: no facet group {name!r}, nor a node group: must be one of "
                    f"{', '.join(sorted(known)) or '(there are none)'}"
                )
            return {below: self.facets(where)}
        vertices, edges = self.node_groups[name]
        found: dict[int, Ints] = {0: vertices} | ({1: edges} if below == 2 else {})
        return found | ({below: self.facets(where)} if self.has_facets(where) else {})

    def nodes(self, where: str | Region, space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """Give the nodes of a Lagrange space on a region: on its facets, edges and vertices.
        Collective.

        Args:
            where: a facet or node group, or a region of the scene.
            space: a Lagrange space, blocked or not.

        Returns:
            Sorted local node (block) numbers of this rank, ghosts included.

        Raises:
            SceneError: the mesh has no such group, or nothing is picked.
        """
        topology = self.domain.topology
        found = [np.empty(0, dtype=np.int32)]
        for dimension, entities in sorted(self.entities(where).items()):
            topology.create_connectivity(dimension, topology.dim)
            found.append(fem.locate_dofs_topological(space, dimension, entities.astype(np.int32)))
        return np.unique(np.concatenate(found))

    def bounds(self) -> tuple[Floats, Floats]:
        """Give the lowest and the highest coordinates in m, shape (3,), over all ranks."""
        x, comm = self.domain.geometry.x, self.domain.comm
        low = np.min(comm.allgather(x.min(axis=0, initial=np.inf)), axis=0)
        return low, np.max(comm.allgather(x.max(axis=0, initial=-np.inf)), axis=0)

    def surface(self, where: str | Region) -> ufl.Measure:
        """Give the measure of a facet group or a pick, inside the body as well as on its boundary.
        Collective.

        Each facet counts once, seen from one of its cells: right for continuous fields. UFL takes
        one such measure in a form.

        Args:
            where: a facet group, or a region of the scene.

        Returns:
            A measure for `form`: in m (2D) or m² (3D).

        Raises:
            SceneError: the mesh has no such facet group, or no facet of the boundary is picked.
        """
        facets = self.facets(where)
        topology = self.domain.topology
        d = topology.dim
        topology.create_connectivity(d - 1, d)
        topology.create_connectivity(d, d - 1)
        facets = facets[facets < topology.index_map(d - 1).size_local]
        to_cells, to_facets = topology.connectivity(d - 1, d), topology.connectivity(d, d - 1)
        cells = to_cells.array[to_cells.offsets[facets]]
        local = [
            np.flatnonzero(to_facets.links(c) == f)[0] for c, f in zip(cells, facets, strict=True)
        ]
        sides = np.column_stack([cells, local]).astype(np.int32).ravel()
        return ufl.Measure("ds", domain=self.domain, subdomain_data=[(1, sides)], subdomain_id=1)


def build_mesh(geometry: Geometry, comm: MPI.Comm) -> Mesh:
    """Make or read the mesh of a scene.

    A .geo file gets `geometry.parameters` by the names in its `DefineConstant`, and `structured` =
    1 or 0 from `geometry.cells` where it has that name; `Error("...")` in the file refuses them. A
    .msh file may have any version gmsh reads. Groups are the physical groups (by their number where
    they have no name).

    A .step file is brought to metres and meshed with simplices of `geometry.size`; its faces are
    groups by their names or numbers. Of other files the groups are:
    .inp: element sets and node sets. .bdf: the elements of each property, by its number. .vtu: each
    integer field of cells or points that is 0 or 1, and `name:value` for each value of the other
    integer fields. Nodes that make up facets of the boundary are a facet group too.

    Args:
        geometry: the part of the scene on the mesh.
        comm: communicator to distribute the mesh on.

    Returns:
        The mesh, its groups the same on every rank.

    Raises:
        SceneError: on every rank, if the file cannot be read or meshed, a parameter is unknown or
            refused, cells are mixed, inverted or of another dimension or kind than the scene's, or
            a group is empty, or meshio is missing.
        RuntimeError: gmsh is in use in this process.
    """
    source = str(geometry.mesh)
    with ExitStack() as stack:
        model, draft, failure = None, None, None
        if comm.rank == 0:
            try:
                gmsh = stack.enter_context(_gmsh())
                draft, model = _draft(gmsh, geometry), gmsh.model
            except UnicodeDecodeError:
                failure = SceneError(f"{source}: names in it must be UTF-8 text")
            except Exception as error:
                failure = error
        failure, draft = comm.bcast((failure, draft))
        if failure is not None:
            raise failure
        domain, cell_tags, facet_tags = compat.model_to_mesh(model, comm, geometry.dimension)
    domain.topology.create_entities(geometry.dimension - 1)
    groups, warnings = _found(source, draft, facet_tags, domain)
    return Mesh(
        domain, cell_tags, facet_tags, groups, source, warnings, _local(draft.nodes, domain)
    )


def _local(
    nodes: dict[str, tuple[Ints, Ints]], domain: dolfinx.mesh.Mesh
) -> dict[str, tuple[Ints, Ints]]:
    """Find the vertices and edges of the node groups on this rank.

    Args:
        nodes: numbers in the model of the vertices, shape (n,), and of the ends of the edges, shape
        (k, 2).
        domain: the mesh.

    Returns:
        The local vertices and edges of each group.
    """
    if not nodes:
        return {}
    topology = domain.topology
    for pair in ((0, topology.dim), (1, 0), (1, topology.dim)):
        topology.create_entities(pair[0])
        topology.create_connectivity(*pair)
    number = [topology.index_map(k).size_local + topology.index_map(k).num_ghosts for k in (0, 1)]
    vertices = np.arange(number[0], dtype=np.int32)
    places = dolfinx.mesh.entities_to_geometry(domain, 0, vertices).reshape(-1)
    model = np.asarray(domain.geometry.input_global_indices)[places]
    ends = np.sort(model[topology.connectivity(1, 0).array].reshape(number[1], 2), axis=1)
    found = {}
    for name, (points, pairs) in nodes.items():
        lines = np.flatnonzero(np.isin(_keys(ends), _keys(np.sort(pairs, axis=1))))
        found[name] = (
            np.flatnonzero(np.isin(model, points)).astype(np.int32),
            lines.astype(np.int32),
        )
    return found


def _keys(pairs: Ints) -> Ints:
    """One number for each pair of node numbers, shape (k, 2)."""
    return pairs[:, 0].astype(np.int64) * 2**31 + pairs[:, 1].astype(np.int64)


def unclamped_pieces(mesh: Mesh, regions: Sequence[str | Region]) -> int:
    """Count the connected pieces of the mesh that no clamped facet or node holds.

    Cells that share a vertex are connected. Each rank joins its own cells, then the pieces of the
    ranks are joined through the vertices they share: only those are gathered. Collective.

    Args:
        mesh: the mesh.
        regions: what is clamped: facet or node groups, or regions of the scene.

    Returns:
        The number of pieces free to move as a rigid body, the same on every rank.

    Raises:
        SceneError: the mesh has no such group, or nothing is picked.
    """
    comm, topology = mesh.domain.comm, mesh.domain.topology
    clamped: list[Ints] = []
    for dimension, entities in (item for where in regions for item in mesh.entities(where).items()):
        topology.create_connectivity(dimension, 0)
        clamped += [topology.connectivity(dimension, 0).links(entity) for entity in entities]

    vertices, corners = topology.index_map(0), topology.connectivity(topology.dim, 0)
    cells, points = (
        topology.index_map(topology.dim).size_local,
        vertices.size_local + vertices.num_ghosts,
    )
    cell = np.repeat(np.arange(cells), np.diff(corners.offsets[: cells + 1]))
    piece = _components(cell, cells + corners.array[: len(cell)], cells + points)[cells:]
    held = np.zeros(cells + points, dtype=bool)
    held[piece[np.unique(np.concatenate([*clamped, np.empty(0, dtype=np.int32)]))]] = True

    border = np.unique(np.concatenate(comm.allgather(vertices.ghosts)))
    names = vertices.local_to_global(np.arange(points, dtype=np.int32))
    shared = np.isin(names, border)
    parts = comm.allgather(
        (held[: piece.max(initial=-1) + 1], piece[shared], np.searchsorted(border, names[shared]))
    )
    first = np.cumsum([0] + [len(part[0]) for part in parts])
    rows = np.concatenate([part[1] + start for part, start in zip(parts, first[:-1], strict=True)])
    whole = _components(
        rows, first[-1] + np.concatenate([part[2] for part in parts]), first[-1] + len(border)
    )
    pieces = whole[: first[-1]]
    return len(np.setdiff1d(pieces, pieces[np.concatenate([part[0] for part in parts])]))


def _components(rows: Ints, columns: Ints, size: int) -> Ints:
    """Number the connected components of an undirected graph of `size` nodes, by node."""
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(size, size))
    return connected_components(graph, directed=False)[1]


# What rank 0 does: from the file to a gmsh model that holds the solid and its facet groups, and
# nothing else.


@dataclass(frozen=True)
class _Draft:
    """What rank 0 tells the others.

    Attributes:
        groups: dimension and tags of each group.
        facets: number of facets the file has in each facet group.
        nodes: numbers of the vertices, shape (n,), and of the ends of the edges, shape (k, 2), of
        each node group.
        warnings: sentences.
    """

    groups: dict[str, tuple[int, tuple[int, ...]]]
    facets: dict[str, int]
    nodes: dict[str, tuple[Ints, Ints]]
    warnings: tuple[str, ...]


@contextmanager
def _gmsh() -> Iterator[Any]:
    """Open gmsh, quiet, without the user's settings and leaving interrupts to Python; close it at
    the end.
    """
    import gmsh

    if gmsh.isInitialized():
        raise RuntimeError(
            "gmsh is in use in this process: call gmsh.finalize() before a mesh is built"
        )
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber(
            "General.AbortOnError", 0
        )  # errors go to the logger: an abort breaks gmsh's parser
        gmsh.open(
            os.devnull
        )  # or the tolerances are those of the extent of the last model of this process
        gmsh.logger.start()
        yield gmsh
    finally:
        gmsh.logger.stop()
        gmsh.finalize()


def _draft(gmsh: Any, geometry: Geometry) -> _Draft:
    """Read the file, check it, and put a clean model in its place."""
    source, d = str(geometry.mesh), geometry.dimension
    sets = _load(gmsh, geometry)
    in_cells, in_facets = _entities(gmsh, source, d), _entities(gmsh, source, d - 1)
    if shared := {SOLID, *in_cells} & in_facets.keys():
        raise SceneError(
            f"{source}: group {min(shared)!r} has dimension {d - 1}: must have {d} or another name"
        )
    in_cells.setdefault(SOLID, [entity for _, entity in gmsh.model.getEntities(d)])
    given, kind, warnings = _check_cells(gmsh, geometry, in_cells[SOLID])
    cell, facet = (
        (QUADRATIC[kind], QUADRATIC[FACETS[kind]]) if geometry.curved else (kind, FACETS[kind])
    )
    _check_facets(gmsh, source, d - 1, in_facets, facet)

    cells, cell_tags, groups = _combine(
        {name: _elements(gmsh, d, on, cell) for name, on in in_cells.items()}
    )
    solid = np.isin(cell_tags, groups[SOLID])
    cells, cell_tags = cells[solid], cell_tags[solid]
    cell_groups = {
        name: (d, tags) for name, tags in groups.items() if np.isin(tags, cell_tags).any()
    }
    rows = {name: _elements(gmsh, d - 1, on, facet) for name, on in in_facets.items()}
    used = np.unique(cells)
    corners = np.unique(cells[:, : gmsh.model.mesh.getElementProperties(kind)[5]])
    nodes, lost = _node_groups(gmsh, source, d, in_cells[SOLID], given, sets, corners)
    if sets:
        width = gmsh.model.mesh.getElementProperties(facet)[3]
        boundary = _boundary(gmsh, d, in_cells[SOLID], given, FACETS[kind])
        on_sets = {
            name: boundary[np.isin(boundary, nodes_of).all(axis=1), :width]
            for name, nodes_of in sets.items()
        }
        rows = {
            name: on for name, on in on_sets.items() if len(on) and name not in cell_groups
        } | rows
    facets, facet_tags, groups = _combine(rows)
    facet_groups = {name: (d - 1, tags) for name, tags in groups.items()}
    sizes = {name: int(np.isin(facet_tags, tags).sum()) for name, tags in groups.items()}
    near = np.isin(facets, used).all(axis=1)
    if groups and not near.any():
        raise SceneError(
            f"{source}: facet groups {', '.join(groups)}: must touch the cells, to be clamped"
        )
    numbers, points = _nodes(gmsh)
    points = points * geometry.scale
    apart = _coincident(points[np.searchsorted(numbers, corners)])
    warnings += lost
    if apart:
        warnings += (
            f"{source}: {apart} nodes lie where another one lies: the cells there are not joined",
        )

    gmsh.model.remove()
    gmsh.model.add(SOLID)
    gmsh.model.addDiscreteEntity(d, 1)
    gmsh.model.mesh.addNodes(
        d, 1, np.arange(len(used)) + 1, points[np.searchsorted(numbers, used)].ravel()
    )
    _add(gmsh, d, cell, np.searchsorted(used, cells) + 1, cell_tags)
    _add(gmsh, d - 1, facet, np.searchsorted(used, facets[near]) + 1, facet_tags[near])
    found = {
        name: (np.searchsorted(used, a), np.searchsorted(used, b)) for name, (a, b) in nodes.items()
    }
    return _Draft(cell_groups | facet_groups, sizes, found, warnings)


def _node_groups(
    gmsh: Any,
    source: str,
    d: int,
    solid: list[int],
    kind: int,
    sets: dict[str, Ints],
    corners: Ints,
) -> tuple[dict[str, tuple[Ints, Ints]], tuple[str, ...]]:
    """Collect the node groups: points, in 3D curves, and node sets.

    Args:
        gmsh: the open gmsh.
        source: name of the file.
        d: dimension of the cells.
        solid: the entities of the cells.
        kind: gmsh type of the cells.
        sets: node numbers of the node sets.
        corners: sorted node numbers of the vertices of the cells.

    Returns:
        Node numbers of the vertices, shape (n,), and of the ends of the edges, shape (k, 2), of
        each group; warnings.
    """
    pairs = (
        {name: _elements(gmsh, 1, on, 1) for name, on in _entities(gmsh, source, 1).items()}
        if d == 3
        else {}
    )
    points = {
        name: _elements(gmsh, 0, on, 15).ravel() for name, on in _entities(gmsh, source, 0).items()
    } | sets
    if d == 3 and sets:
        edges = [_sides(gmsh, entity, kind, 1) for entity in solid]
        whole = np.concatenate([edge for edge in edges if len(edge)])
        for name, nodes in sets.items():
            inside = np.unique(
                np.sort(whole[np.isin(whole, nodes).all(axis=1), :2], axis=1), axis=0
            )
            pairs[name] = np.concatenate([pairs[name], inside]) if name in pairs else inside
    found, warnings = {}, []
    for name in sorted(pairs.keys() | points.keys()):
        ends = pairs.get(name, np.empty((0, 2), dtype=np.int64)).astype(np.int64)
        nodes = np.union1d(points.get(name, np.empty(0)).astype(np.int64), ends.ravel())
        kept = nodes[np.isin(nodes, corners)]
        if len(kept):
            found[name] = (kept, ends[np.isin(ends, corners).all(axis=1)])
        else:
            warnings.append(
                f"{source}: node group {name!r} has no vertex of the cells and is left out"
            )
    return found, tuple(warnings)


def _sides(gmsh: Any, entity: int, kind: int, d: int) -> Ints:
    """Node numbers of the edges (d = 1) or faces (d = 2) of an entity's cells, vertices first,
    shape (k, nodes).
    """
    number = len(gmsh.model.mesh.getElementsByType(kind, entity)[0])
    if d == 1:
        sides = {2: 3, 3: 4, 4: 6, 5: 12}[_straight(gmsh, kind)]
        nodes = gmsh.model.mesh.getElementEdgeNodes(kind, entity, False)
    else:
        sides, vertices = {4: (4, 3), 5: (6, 4)}[_straight(gmsh, kind)]
        nodes = gmsh.model.mesh.getElementFaceNodes(kind, vertices, entity, False)
    return np.reshape(nodes, (number * sides, -1)) if number else np.empty((0, 0), dtype=np.uint64)


def _boundary(gmsh: Any, d: int, solid: list[int], kind: int, facet: int) -> Ints:
    """Node numbers of the facets that only one cell has, shape (k, nodes)."""
    sides = [rows for entity in solid if len(rows := _sides(gmsh, entity, kind, d - 1))]
    rows = np.concatenate(sides)
    vertices = gmsh.model.mesh.getElementProperties(facet)[5]
    _, first, count = np.unique(
        np.sort(rows[:, :vertices], axis=1), axis=0, return_index=True, return_counts=True
    )
    return rows[first[count == 1]]


def _straight(gmsh: Any, kind: int) -> int:
    """The gmsh type of degree 1 of the same shape."""
    _, d, _, _, _, vertices = gmsh.model.mesh.getElementProperties(kind)
    return {(2, 3): 2, (2, 4): 3, (3, 4): 4, (3, 8): 5}.get((d, vertices), 0)


def _coincident(points: Floats) -> int:
    """Number of points that lie on an earlier one, shape (n, 3)."""
    if not len(points):
        return 0
    size = max(float(np.ptp(points, axis=0).max()), np.finfo(float).tiny)
    return len(points) - len(
        np.unique(np.round((points - points.min(axis=0)) / (ROUNDING * size)), axis=0)
    )


def _load(gmsh: Any, geometry: Geometry) -> dict[str, Ints]:
    """Read the file and, if it is a geometry, mesh it; give the node numbers of its node sets."""
    source, d, form = (
        str(geometry.mesh),
        geometry.dimension,
        SUFFIXES.get(geometry.mesh.suffix.lower()),
    )
    if not geometry.mesh.is_file() or form is None:
        raise SceneError(
            f"geometry.mesh = {source!r}: must be an existing file of one of {', '.join(SUFFIXES)}"
        )
    gmsh.model.add("file")
    if form == "geo":
        _set_parameters(gmsh, geometry)
    sets = {}
    with _errors(gmsh, source):
        if form in ("msh", "step"):
            _survive(source)
        if form in ("geo", "msh"):
            gmsh.merge(source)
        elif form == "step":
            gmsh.option.setString("Geometry.OCCTargetUnit", "M")
            gmsh.model.occ.importShapes(source)
            gmsh.model.occ.synchronize()
        else:
            sets = _import(gmsh, geometry.mesh, form, geometry.curved)
    if form in ("geo", "step"):
        _check_reach(gmsh, geometry)
    if gmsh.model.getDimension() != d:
        raise SceneError(
            f"{source}: geometry.dimension = {d}: must be {gmsh.model.getDimension()} for this file"
        )
    if form == "step":
        _name_faces(gmsh, d)
        for limit in ("Min", "Max"):
            gmsh.option.setNumber(f"Mesh.MeshSize{limit}", geometry.size)
    if form in ("geo", "step"):
        with _errors(gmsh, source):
            gmsh.model.mesh.generate(d)
            if geometry.curved:
                gmsh.model.mesh.setOrder(2)
    return sets


def _check_reach(gmsh: Any, geometry: Geometry) -> None:
    """Refuse a body that is nowhere, reaches too far, or takes too many cells: gmsh would crash, or
    fill all memory.

    Raises:
        SceneError: it is such a body.
    """
    source, places = (
        str(geometry.mesh),
        [gmsh.model.getValue(0, tag, []) for _, tag in gmsh.model.getEntities(0)],
    )
    with suppress(Exception):  # of gmsh, which has no type of its own: the box is empty
        places += np.reshape(gmsh.model.getBoundingBox(-1, -1), (2, 3)).tolist()
    wrong = [place for place in places if not np.all(np.abs(place) <= FARTHEST)]
    if wrong:
        where = ", ".join(f"{value:.6g}" for value in wrong[0])
        raise SceneError(
            f"{source}: it reaches to ({where}): coordinates must be numbers of at most {FARTHEST:g}"
        )
    extent = float(np.ptp(places or np.zeros((1, 3)), axis=0).max())
    if extent == 0.0:
        raise SceneError(f"{source}: there is no body in it that has a size")
    if geometry.size is not None and geometry.size * MOST_CELLS < extent:
        allowed = f"must be at least {extent / MOST_CELLS:.3g} for a body of {extent:.3g} m"
        raise SceneError(f"{source}: geometry.size = {geometry.size:g}: {allowed}")


def _survive(source: str) -> None:
    """Read a .msh or .step file in a process of its own first: a damaged one can crash gmsh, or
    keep it busy for ever.

    Raises:
        SceneError: it does.
    """
    seconds = 60.0 + 1e-6 * Path(source).stat().st_size
    try:
        code = subprocess.run(
            [sys.executable, "-c", _READ, source],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=seconds,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        raise SceneError(
            f"{source}: gmsh does not get through it in {seconds:.0f} s: is it damaged?"
        ) from None
    if code:
        raise SceneError(f"{source}: gmsh crashes over it: the file is damaged")


def _set_parameters(gmsh: Any, geometry: Geometry) -> None:
    """Hand the parameters to gmsh, by the names the .geo file has."""
    known = _parameters(geometry.mesh)
    if "structured" in known:
        gmsh.parser.setNumber("structured", [float(geometry.cells != "simplex")])
    for name, value in geometry.parameters.items():
        if name not in known - {"structured"}:
            allowed = (
                ", ".join(sorted(known - {"structured"}))
                or "none, as the file has no DefineConstant"
            )
            raise SceneError(
                f"{geometry.mesh}: geometry.parameters.{name} = {value:g}: name must be one of {allowed}"
            )
        gmsh.parser.setNumber(name, [value])


def _name_faces(gmsh: Any, d: int) -> None:
    """Make a group of each face of a .step file, by its name or, without one, its number."""
    faces: dict[str, list[int]] = {}
    for _, face in gmsh.model.getEntities(d - 1):
        faces.setdefault(
            gmsh.model.getEntityName(d - 1, face).rpartition("/")[2] or str(face), []
        ).append(face)
    for name, members in faces.items():
        gmsh.model.addPhysicalGroup(d - 1, members, name=name)


def _import(gmsh: Any, path: Path, form: str, curved: bool) -> dict[str, Ints]:
    """Read a file with meshio into gmsh; give the node numbers of each node set."""
    file = formats.read(path, form, curved)
    dimensions = [gmsh.model.mesh.getElementProperties(kind)[1] for kind, _ in file.blocks]
    gmsh.model.addDiscreteEntity(max(dimensions), 1)
    gmsh.model.mesh.addNodes(
        max(dimensions), 1, np.arange(len(file.points)) + 1, file.points.ravel()
    )
    entities: dict[tuple[int, str], list[int]] = {}
    for index, ((kind, cells), d) in enumerate(zip(file.blocks, dimensions, strict=True)):
        member = np.array([marks[index] for marks in file.groups.values()], dtype=bool)
        kinds, which = np.unique(
            member.reshape(len(file.groups), len(cells)).T, axis=0, return_inverse=True
        )
        for k, marks in enumerate(kinds):
            entity = gmsh.model.addDiscreteEntity(d)
            gmsh.model.mesh.addElementsByType(
                entity, kind, [], (cells[which.ravel() == k] + 1).ravel()
            )
            for name in (name for name, marked in zip(file.groups, marks, strict=True) if marked):
                entities.setdefault((d, name), []).append(entity)
    for (d, name), members in entities.items():  # once each: gmsh gives a second group no name
        gmsh.model.addPhysicalGroup(d, members, name=name)
    return {name: nodes + 1 for name, nodes in file.nodes.items()}


@contextmanager
def _errors(gmsh: Any, source: str) -> Iterator[None]:
    """Raise the first error of gmsh, which is in its log whether it raised anything or not."""
    failure = None
    try:
        yield
    except SceneError:
        raise
    except Exception as error:  # gmsh has no type of its own
        failure = error
    errors = [line.partition(":")[2] for line in gmsh.logger.get() if line.startswith("Error")]
    if errors or failure is not None:
        raise SceneError(
            f"{source}: " + " ".join((errors or [str(failure)])[0].split())
        ) from failure


def _parameters(path: Path) -> set[str]:
    """Names in the DefineConstant of a .geo file."""
    text = re.sub(
        r'"[^"\n]*"|//[^\n]*|/\*.*?\*/', "", path.read_text(errors="replace"), flags=re.DOTALL
    )
    while (inner := re.sub(r"\{[^{}]*\}", "", text)) != text:
        text = inner
    blocks = re.findall(r"\bDefineConstant\s*\[([^]]*)\]", text)
    return {entry.partition("=")[0].strip() for block in blocks for entry in block.split(",")} - {
        ""
    }


def _entities(gmsh: Any, source: str, d: int) -> dict[str, list[int]]:
    """Entities of each physical group of dimension d, by its name or, without one, its number."""
    groups = {}
    for _, tag in gmsh.model.getPhysicalGroups(d):
        name = gmsh.model.getPhysicalName(d, tag) or str(tag)
        groups[name] = [*groups.get(name, []), *gmsh.model.getEntitiesForPhysicalGroup(d, tag)]
    for name, entities in groups.items():
        if not any(
            len(block) for entity in entities for block in gmsh.model.mesh.getElements(d, entity)[1]
        ):
            raise SceneError(
                f"{source}: group {name!r} is empty: must have cells or facets of the mesh"
            )
    return groups


def _nodes(gmsh: Any) -> tuple[Ints, Floats]:
    """Sorted numbers of the nodes, shape (n,), and their coordinates, shape (n, 3)."""
    numbers, coordinates, _ = gmsh.model.mesh.getNodes()
    order = np.argsort(numbers)
    return numbers[order], coordinates.reshape(-1, 3)[order]


def _fits(gmsh: Any, given: int, kind: int) -> bool:
    """Whether elements of a type can be used as those of another: are the same, or of higher degree
    than straight.
    """
    _, _, degree, _, _, vertices = gmsh.model.mesh.getElementProperties(kind)
    return given == kind or (
        degree == 1 and gmsh.model.mesh.getElementProperties(given)[5] == vertices
    )


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
        groups: node numbers of the elements of each group, shape (m, nodes); an element may be in
            many groups.

    Returns:
        The elements, once each, shape (k, nodes); their tags from 1, shape (k,); the tags of each
        group.
    """
    if not groups:
        return np.empty((0, 0), dtype=np.int64), np.empty(0, dtype=np.int64), {}
    rows = np.concatenate(list(groups.values()))
    group = np.repeat(np.arange(len(groups)), [len(elements) for elements in groups.values()])
    _, first, element = np.unique(
        np.sort(rows, axis=1), axis=0, return_index=True, return_inverse=True
    )
    member = np.zeros((len(first), len(groups)), dtype=bool)
    member[element.ravel(), group] = True
    kinds, tags = np.unique(member, axis=0, return_inverse=True)
    found = {
        name: tuple((np.flatnonzero(kinds[:, i]) + 1).tolist()) for i, name in enumerate(groups)
    }
    return rows[first], tags.ravel() + 1, found


def _check_cells(
    gmsh: Any, geometry: Geometry, solid: list[int]
) -> tuple[int, int, tuple[str, ...]]:
    """Check type, shape and orientation of the cells.

    Args:
        gmsh: the open gmsh.
        geometry: what the scene asks for.
        solid: the entities of the cells.

    Returns:
        The gmsh type of the cells, that of the straight cell, and warnings.
    """
    source, d = str(geometry.mesh), geometry.dimension
    types = sorted(
        {int(kind) for entity in solid for kind in gmsh.model.mesh.getElementTypes(d, entity)}
    )
    properties = [gmsh.model.mesh.getElementProperties(kind) for kind in types]
    names = ", ".join(entry[0] for entry in properties)
    if len(types) != 1:
        raise SceneError(f"{source}: cells {names or '(none)'}: must be of one type")
    given, reference, vertices = types[0], np.reshape(properties[0][4], (-1, d)), properties[0][5]
    kind = {(2, 3): 2, (2, 4): 3, (3, 4): 4, (3, 8): 5}.get((d, vertices))
    if kind is None:
        raise SceneError(
            f"{source}: cells {names}: must be triangles, quadrilaterals, tetrahedra or hexahedra"
        )
    if geometry.cells is not None and (geometry.cells == "simplex") != (vertices == d + 1):
        raise SceneError(
            f"{source}: geometry.cells = {geometry.cells!r}: must be the other, the file makes {names}"
        )
    if geometry.curved and given != QUADRATIC[kind]:
        curved = gmsh.model.mesh.getElementProperties(QUADRATIC[kind])[0]
        raise SceneError(
            f"{source}: geometry.curved = true: cells must be {curved}, the file has {names}"
        )

    numbers, points = _nodes(gmsh)
    cells = [
        points[np.searchsorted(numbers, _elements(gmsh, d, [entity], given))] for entity in solid
    ]
    spread = np.ptp(
        [[np.min(x, axis=(0, 1)), np.max(x, axis=(0, 1))] for x in cells if len(x)], axis=(0, 1)
    )
    if d == 2 and spread[2] > 1e-9 * spread.max():
        raise SceneError(
            f"{source}: z differs by {spread[2]:g} m: must be constant where geometry.dimension = 2"
        )
    local = np.pad(reference, ((0, 0), (0, 3 - d)))
    _, weights, _ = gmsh.model.mesh.getBasisFunctions(kind, local.ravel(), "Lagrange")
    moved = 0.0
    for x in (x[:, :, :d] for x in cells if len(x)):
        size = np.ptp(x, axis=1).max(axis=1)
        det = _determinants(gmsh, given if geometry.curved else kind, local, x)
        bad = np.flatnonzero((det * np.sign(det.sum())).min(axis=1) <= DEGENERATE * size**d)
        if len(bad):
            where = ", ".join(f"{value:.6g}" for value in x[bad[0]].mean(axis=0))
            raise SceneError(
                f"{source}: {len(bad)} cells are inverted or degenerate, one at ({where}): "
                "must have a Jacobian determinant of one sign"
            )
        straight = np.einsum("pn,cnj->cpj", np.reshape(weights, (-1, vertices)), x[:, :vertices])
        moved = max(moved, (np.linalg.norm(straight - x, axis=2).max(axis=1) / size).max())
    warnings = [
        f"{source}: {line[9:]}" for line in gmsh.logger.get() if line.startswith("Warning: ")
    ]
    if not geometry.curved and moved > STRAIGHT:
        warnings.append(
            f"{source}: curved cells are made straight, a node moves by up to {100 * moved:.2g} % of the "
            "size of its cell: geometry.curved = true keeps the curves"
        )
    return given, kind, tuple(warnings)


def _check_facets(gmsh: Any, source: str, d: int, groups: dict[str, list[int]], kind: int) -> None:
    """Refuse facets that cannot be facets of the cells because of their type."""
    for name, entities in groups.items():
        types = {
            int(given)
            for entity in entities
            for given in gmsh.model.mesh.getElementTypes(d, entity)
        }
        for given in sorted(types):
            if not _fits(gmsh, given, kind):
                have, need = (
                    gmsh.model.mesh.getElementProperties(type_)[0] for type_ in (given, kind)
                )
                raise SceneError(
                    f"{source}: group {name!r} has facets {have}: must be {need} for these cells"
                )


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
    return np.concatenate(
        [np.linalg.det(np.einsum("pni,cnj->cpij", gradients, part)) for part in parts]
    )


def _found(
    source: str, draft: _Draft, facet_tags: dolfinx.mesh.MeshTags, domain: dolfinx.mesh.Mesh
) -> tuple[dict[str, tuple[int, tuple[int, ...]]], tuple[str, ...]]:
    """Leave out the facets that are not facets of a cell, and say so. Collective."""
    below = domain.topology.dim - 1
    tags = facet_tags.values[facet_tags.indices < domain.topology.index_map(below).size_local]
    number = domain.comm.allreduce(
        np.bincount(tags, minlength=1 + max(max(t) for _, t in draft.groups.values()))
    )
    groups, warnings = dict(draft.groups), list(draft.warnings)
    for name, size in draft.facets.items():
        lost = size - int(number[list(groups[name][1])].sum())
        if lost:
            what = f"{lost} of {size} facets are not facets of a cell and are left out"
            warnings.append(f"{source}: group {name!r}: {what}")
        if lost == size:
            del groups[name]
    return groups, tuple(warnings)
