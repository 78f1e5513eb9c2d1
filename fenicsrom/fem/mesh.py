"""Meshes with named groups.

`build_mesh` makes or reads the mesh of a scene, `mesh_from_gmsh_model` takes the model of an open
gmsh, and `mesh_from_dolfinx` a dolfinx mesh with tags. Rank 0 checks the cells of a file in gmsh,
and dolfinx distributes a clean model. An error on rank 0 is raised on every rank.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import dolfinx.mesh
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.fem import compat
from fenicsrom.fem.gmsh_files import load_file, open_gmsh
from fenicsrom.fem.gmsh_model import CleanModel, clean_model
from fenicsrom.scene import Geometry, Region

Ints = npt.NDArray[Any]
Floats = npt.NDArray[np.float64]

ON_PLANE = 1e-6
"""Default tolerance of a picking plane, relative to the extent of the mesh."""

ROUNDING = 1e-9
"""Smaller distances, relative to the extent of the mesh, count as zero."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """A distributed mesh with named groups of cells, facets and nodes.

    Attributes:
        domain: the dolfinx mesh, in metres.
        cell_tags: tags of the cells.
        facet_tags: tags of the facets in a group.
        groups: dimension and tags of each group by name; facets (or cells) with any of the tags
        belong to it.
        source: path of the file of the mesh.
        warnings: sentences for the user.
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
        """Whether a region has facets, as facet groups and picks by coordinates do."""
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
                f"{self.source}: there is no facet group {name!r}; the mesh has "
                f"{f'the facet groups {known}' if known else 'none'}",
                kind=ErrorKind.PLACE,
                source=self.source,
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
            what = (
                f"plane = {{ point = {point.tolist()}, normal = {normal.tolist()}, "
                f"tolerance = {tolerance:.3g} }}"
            )

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
                f"{self.source}: {what}: no facet of the boundary lies there; "
                f"the mesh extends from {reach}",
                kind=ErrorKind.PLACE,
                source=self.source,
            )
        return np.sort(facets)

    def entities(self, where: str | Region) -> dict[int, Ints]:
        """Give the entities of a region on this rank. Collective.

        They are facets, and the vertices and edges of a node group.

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
                    f"{self.source}: there is no facet group or node group {name!r}; the mesh has "
                    f"the groups {', '.join(sorted(known))}",
                    kind=ErrorKind.PLACE,
                    source=self.source,
                )
            return {below: self.facets(where)}
        vertices, edges = self.node_groups[name]
        found: dict[int, Ints] = {0: vertices} | ({1: edges} if below == 2 else {})
        return found | ({below: self.facets(where)} if self.has_facets(where) else {})

    def nodes(self, where: str | Region, space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """Give the nodes of a Lagrange space on a region. Collective.

        They lie on its facets, edges and vertices.

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

    def extent(self) -> float:
        """The largest extent along an axis in m, over all ranks."""
        low, high = self.bounds()
        return float(np.max(high - low))

    def surface(self, where: str | Region) -> ufl.Measure:
        """Give the measure of a facet group or a pick. Collective.

        The facets may lie on the boundary or inside the body. Each facet counts once, seen from one
        of its cells, which is correct for continuous fields. A UFL form may contain only one such
        measure.

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
    """Make or read the mesh of a scene. Collective.

    In a .geo file, `geometry.parameters` sets the names in its `DefineConstant`. If `structured` is
    one of these names, `geometry.cells` sets it to 1 or 0. The file may refuse values with
    `Error("...")`. A .msh file may have any version that gmsh reads. The groups of both formats are
    the physical groups, by their names or numbers.

    A .step file is converted to metres and meshed with simplices of `geometry.size`; its faces are
    groups by their names or numbers. The groups of other files are: element sets and node sets in
    .inp; the elements of each property, by its number, in .bdf; and in .vtu each integer field of
    cells or points that is 0 or 1, and `name:value` for each value of the other integer fields.
    If a node set contains all nodes of some boundary facets, these facets are a facet group of the
    same name.

    Args:
        geometry: the [geometry] of the scene.
        comm: communicator to distribute the mesh on.

    Returns:
        The mesh, with the same groups on every rank.

    Raises:
        SceneError: on every rank, if the file cannot be read or meshed; a parameter is unknown or
            refused; cells are mixed, inverted, or of another dimension or kind than those of the
            scene; a group is empty; or meshio is missing.
        RuntimeError: gmsh is in use in this process.
    """
    with ExitStack() as stack:

        def draft() -> tuple[CleanModel, Any]:
            gmsh = stack.enter_context(open_gmsh())
            sets = load_file(gmsh, geometry)
            return clean_model(gmsh, geometry, sets), gmsh.model

        return _distributed(draft, geometry, comm)


def mesh_from_gmsh_model(
    dimension: int,
    *,
    comm: MPI.Comm = MPI.COMM_WORLD,
    curved: bool = False,
    scale: float = 1.0,
    source: str = "the gmsh model",
) -> Mesh:
    """Take the mesh of the current model of the open gmsh on rank 0. Collective.

    Groups are the physical groups, by their names or numbers. The cells are those of the group
    "solid" or, without this group, all cells of this dimension. The model is not changed.

    Args:
        dimension: 2 or 3.
        comm: communicator to distribute the mesh on.
        curved: keep quadratic cells curved; otherwise they are made straight.
        scale: length in m of the unit of the coordinates.
        source: name of the mesh, for messages.

    Returns:
        The mesh, with the same groups on every rank.

    Raises:
        SceneError: on every rank, if gmsh is not initialised on rank 0, or the mesh cannot be used,
            as in `build_mesh`.
    """
    geometry = Geometry(mesh=Path(source), dimension=dimension, curved=curved, scale=scale)
    with ExitStack() as stack:

        def draft() -> tuple[CleanModel, Any]:
            import gmsh

            if not gmsh.isInitialized():
                raise SceneError(
                    f"{source}: gmsh is not initialised on rank 0",
                    kind=ErrorKind.MESH,
                    source=source,
                )
            current = gmsh.model.getCurrent()
            found = clean_model(gmsh, geometry, {})
            stack.callback(gmsh.model.setCurrent, current)
            stack.callback(gmsh.model.remove)
            return found, gmsh.model

        return _distributed(draft, geometry, comm)


def mesh_from_dolfinx(
    domain: dolfinx.mesh.Mesh,
    facet_tags: dolfinx.mesh.MeshTags,
    groups: Mapping[str, int | Iterable[int]],
    cell_tags: dolfinx.mesh.MeshTags | None = None,
    source: str = "the dolfinx mesh",
) -> Mesh:
    """Name the groups of a dolfinx mesh. Collective.

    Args:
        domain: the mesh, with coordinates in m.
        facet_tags: tags of the facets.
        groups: tag, or tags, of the facets of each group.
        cell_tags: tags of the cells, or None.
        source: name of the mesh, for messages.

    Returns:
        The mesh with these groups.

    Raises:
        SceneError: on every rank, if no facet has a tag of a group.
    """
    d = domain.topology.dim
    domain.topology.create_entities(d - 1)
    present = set().union(*domain.comm.allgather(set(facet_tags.values.tolist())))
    named: dict[str, tuple[int, tuple[int, ...]]] = {}
    for name, tags in groups.items():
        wanted = (tags,) if isinstance(tags, int) else tuple(tags)
        if not present & set(wanted):
            raise SceneError(
                f"{source}: group {name!r}: no facet has a tag of {list(wanted)}; "
                f"the facets have the tags {sorted(present)}",
                kind=ErrorKind.PLACE,
                source=source,
            )
        named[name] = (d - 1, wanted)
    if cell_tags is None:
        cells = np.arange(domain.topology.index_map(d).size_local, dtype=np.int32)
        cell_tags = dolfinx.mesh.meshtags(domain, d, cells, np.ones_like(cells))
    return Mesh(domain, cell_tags, facet_tags, named, source)


def _distributed(
    draft: Callable[[], tuple[CleanModel, Any]], geometry: Geometry, comm: MPI.Comm
) -> Mesh:
    """Distribute the clean model that rank 0 makes.

    Args:
        draft: function called on rank 0; returns the description of the clean model, and gmsh.
        geometry: the dimension, and the name of the mesh for messages.
        comm: communicator to distribute the mesh on.

    Raises:
        Exception: on every rank, the exception that `draft` raised on rank 0.
    """
    source = str(geometry.mesh)
    model, clean, failure = None, None, None
    if comm.rank == 0:
        try:
            clean, model = draft()
        except UnicodeDecodeError:
            failure = SceneError(
                f"{source}: the names in the file must be UTF-8 text",
                kind=ErrorKind.FORMAT,
                source=source,
            )
        except Exception as error:
            failure = error
    failure, clean = comm.bcast((failure, clean))
    if failure is not None:
        raise failure
    domain, cell_tags, facet_tags = compat.model_to_mesh(model, comm, geometry.dimension)
    domain.topology.create_entities(geometry.dimension - 1)
    groups, warnings = _groups_on_cells(source, clean, facet_tags, domain)
    nodes = _local_node_groups(clean.nodes, domain)
    return Mesh(domain, cell_tags, facet_tags, groups, source, warnings, nodes)


def _local_node_groups(
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


def _groups_on_cells(
    source: str, clean: CleanModel, facet_tags: dolfinx.mesh.MeshTags, domain: dolfinx.mesh.Mesh
) -> tuple[dict[str, tuple[int, tuple[int, ...]]], tuple[str, ...]]:
    """Leave out facets that do not belong to a cell; give groups and warnings. Collective."""
    below = domain.topology.dim - 1
    tags = facet_tags.values[facet_tags.indices < domain.topology.index_map(below).size_local]
    number = domain.comm.allreduce(
        np.bincount(tags, minlength=1 + max(max(t) for _, t in clean.groups.values()))
    )
    groups, warnings = dict(clean.groups), list(clean.warnings)
    for name, size in clean.facets.items():
        lost = size - int(number[list(groups[name][1])].sum())
        if lost:
            what = f"{lost} of {size} facets are not facets of a cell and are left out"
            warnings.append(f"{source}: group {name!r}: {what}")
        if lost == size:
            del groups[name]
    return groups, tuple(warnings)
