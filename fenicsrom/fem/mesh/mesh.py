"""The mesh of a scene, whose facets and nodes are found by name or by coordinates.

`build_mesh` makes or reads the mesh of a scene, `mesh_from_gmsh_model` takes the model of an open
gmsh, and `mesh_from_dolfinx` a dolfinx mesh with tags. Rank 0 checks the cells of a file in gmsh,
and dolfinx distributes a clean model. An error on rank 0 is raised on every rank.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import dolfinx.mesh
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem
from mpi4py import MPI

from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.fem.base import compat
from fenicsrom.fem.mesh.gmsh_files import open_gmsh
from fenicsrom.fem.mesh.gmsh_model import CleanModel, clean_model
from fenicsrom.fem.mesh.gmsh_parts import load_files, make_disk
from fenicsrom.fem.mesh.picking import picking
from fenicsrom.fem.mesh.sector import Sector
from fenicsrom.fem.mesh.tagged_mesh import check_dolfinx_mesh, check_tags, group_tags
from fenicsrom.scene import Cyclic, Geometry, Region
from fenicsrom.scene.base.rules import Where, choice, number
from fenicsrom.words import brief

Ints = npt.NDArray[Any]
Floats = npt.NDArray[np.float64]

NEAR = 1e-3
"""Accepted distance of a node from the coordinates of a place, relative to the extent."""


@brief("source", "facet_groups", "cell_groups", "node_groups", "warnings")
@dataclass(frozen=True, eq=False, repr=False)
class Mesh:
    """A distributed mesh with named groups of cells, facets and nodes.

    Attributes:
        domain: the dolfinx mesh, in metres.
        cell_tags: tags of the cells.
        facet_tags: tags of the facets in a group.
        facet_groups: tags of each facet group by name; facets with any of the tags belong to it.
        cell_groups: tags of each cell group by name; it may have the name of a facet group.
        source: path of the file of the mesh.
        warnings: sentences for the user.
        node_groups: local vertices and, in 3D, local edges of each node group by name: of a point
            or a curve of a gmsh file, or a node set. A node set on the boundary has its facets in a
            facet group of the same name.
        node_sets: for each node group that is a node set of the file, the local edges whose middle
            node is in the set. Where the numbers of a contact are those of its nodes, each node of
            the file counts as one.
        glued: names of the faces of a CAD file along which bodies are glued.
        sector: set if the body is one sector of a disk.
    """

    domain: dolfinx.mesh.Mesh
    cell_tags: dolfinx.mesh.MeshTags
    facet_tags: dolfinx.mesh.MeshTags
    facet_groups: dict[str, tuple[int, ...]]
    cell_groups: dict[str, tuple[int, ...]]
    source: str
    warnings: tuple[str, ...] = ()
    node_groups: dict[str, tuple[Ints, Ints]] = field(default_factory=dict)
    node_sets: dict[str, Ints] = field(default_factory=dict)
    glued: Collection[str] = ()
    sector: Sector | None = None

    def has_facets(self, where: str | Region) -> bool:
        """Whether a region has facets, as facet groups and picks by coordinates do."""
        if isinstance(where, Region) and where.group is None:
            return where.box is not None or where.plane is not None
        return (where.group if isinstance(where, Region) else where) in self.facet_groups

    def cells(self, name: str) -> npt.NDArray[np.int32]:
        """Give the cells of a group on this rank.

        Args:
            name: a cell group.

        Returns:
            Sorted local cell indices, shape (k,), ghosts included; k may be 0.

        Raises:
            SceneError: the mesh has no such cell group.
        """
        if name not in self.cell_groups:
            raise self._unknown("cell group", name, self.cell_groups)
        tags = self.cell_groups[name]
        return np.sort(self.cell_tags.indices[np.isin(self.cell_tags.values, tags)])

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
        name = str(where.group if isinstance(where, Region) else where)
        if name not in self.facet_groups:
            raise self._unknown("facet group", name, self.facet_groups)
        tags = self.facet_groups[name]
        return np.sort(self.facet_tags.indices[np.isin(self.facet_tags.values, tags)])

    def _unknown(self, kind: str, name: str, groups: Iterable[str]) -> SceneError:
        """The error that the mesh has no group of a kind with a name."""
        known = ", ".join(sorted(groups))
        present = f"the {kind}s {known}" if known else "none"
        reason = f"there is no {kind} {name!r}; the mesh has {present}"
        return refuse(self.source, reason, ErrorKind.PLACE)

    def _picked(self, region: Region) -> npt.NDArray[np.int32]:
        """Facets of the boundary in a box or on a plane. Collective."""
        d = self.domain.geometry.dim
        low, high = self.bounds()
        inside, what = picking(region, float(np.max(high - low)))
        facets = dolfinx.mesh.locate_entities_boundary(
            self.domain, self.domain.topology.dim - 1, inside
        )
        if not self.domain.comm.allreduce(len(facets)):
            ends = [", ".join(f"{value:.6g}" for value in corner[:d]) for corner in (low, high)]
            reach = f"({ends[0]}) to ({ends[1]})"
            reason = f"no facet of the boundary lies there; the mesh extends from {reach}"
            raise refuse(self.source, f"{what}: {reason}", ErrorKind.PLACE)
        return np.sort(facets)

    def entities(self, where: str | Region) -> dict[int, Ints]:
        """Give the entities of a region on this rank. Collective.

        The entities are facets, and the vertices and edges of a node group.

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
            return {below: self.facets(where)}
        vertices, edges = self.node_groups[name]
        found: dict[int, Ints] = {0: vertices} | ({1: edges} if below == 2 else {})
        return found | ({below: self.facets(where)} if self.has_facets(where) else {})

    def unit_lengths(self, where: str | Region) -> int:
        """How many unit lengths complete the measure of a region to an area. Collective.

        Returns:
            0 of facets, 1 of the edges of a curve in 3D, 2 of nodes.

        Raises:
            SceneError: the mesh has no such group, or nothing is picked.
        """
        if self.has_facets(where):
            return 0
        name = where.group if isinstance(where, Region) else where
        return 1 if self.has_edges(where) and name not in self.node_sets else 2

    def has_edges(self, where: str | Region) -> bool:
        """Whether a node group has edges of cells; errors as `entities`. Collective."""
        edges = self.entities(where).get(1, np.empty(0, dtype=np.int32))
        return bool(self.domain.comm.allreduce(edges.size))

    def facets_between(self, corners: Ints) -> Ints:
        """Local facets (f,) of the surface, all of whose corners are among local vertices (v,).

        Collective.
        """
        topology, boundary = self.domain.topology, self.outside()
        below = topology.dim - 1
        topology.create_connectivity(below, 0)
        of = topology.connectivity(below, 0)
        missed = np.add.reduceat(~np.isin(of.array, corners), of.offsets[:-1])
        found: Ints = boundary[missed[boundary] == 0]
        return found

    def reaches_inside(self, where: str | Region) -> bool:
        """Whether facets of a region lie inside the body. Collective.

        Args:
            where: a facet group, or a region of the scene with facets.

        Raises:
            SceneError: the mesh has no such group, or nothing is picked.
        """
        topology, facets = self.domain.topology, self.facets(where)
        owned = facets[facets < topology.index_map(topology.dim - 1).size_local]
        return any(self.domain.comm.allgather(bool(np.any(~np.isin(owned, self.outside())))))

    def outside(self) -> Ints:
        """Local facets of the surface that this rank owns. Collective."""
        topology = self.domain.topology
        topology.create_connectivity(topology.dim - 1, topology.dim)
        found: Ints = dolfinx.mesh.exterior_facet_indices(topology)
        return found

    def nodes(self, where: str | Region, space: fem.FunctionSpace) -> npt.NDArray[np.int32]:
        """Give the nodes of a Lagrange space on a region. Collective.

        The nodes lie on the facets, edges and vertices of the group.

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

    def node_counts(self, where: str | Region, space: fem.FunctionSpace) -> Floats:
        """Give how many nodes of the file each node of a space stands for. Collective.

        A node in the middle of an edge is shared equally by the nodes inside the edge or, with
        elements of degree 1, by its ends. Nodes that the file does not have count as zero.

        Args:
            where: a node group, or a region of the scene that names one.
            space: a scalar Lagrange space.

        Returns:
            Counts of the local nodes, ghosts included; their sum is that of the group at any
            degree.

        Raises:
            SceneError: the mesh has no such group.
        """
        vertices, dofmap = self.entities(where)[0], space.dofmap
        name = where.group if isinstance(where, Region) else where
        counts = fem.Function(space, dtype=np.float64)
        for cell, side in self.sides(1, self.node_sets.get(str(name), np.empty(0, dtype=np.int32))):
            inside = dofmap.dof_layout.entity_dofs(1, side)
            inside = inside or dofmap.dof_layout.entity_closure_dofs(1, side)
            counts.x.array[dofmap.cell_dofs(cell)[inside]] += 1.0 / len(inside)
        counts.x.scatter_reverse(dolfinx.la.InsertMode.add)
        counts.x.scatter_forward()
        self.domain.topology.create_connectivity(0, self.domain.topology.dim)
        counts.x.array[fem.locate_dofs_topological(space, 0, vertices.astype(np.int32))] += 1.0
        return np.asarray(counts.x.array)

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
        sides = self.sides(self.domain.topology.dim - 1, self.facets(where)).ravel()
        return ufl.Measure("ds", domain=self.domain, subdomain_data=[(1, sides)], subdomain_id=1)

    def sides(self, dimension: int, entities: Ints) -> npt.NDArray[np.int32]:
        """For each facet or edge that this rank owns, one of its cells, and its number there.

        Args:
            dimension: dimension of the entities.
            entities: their numbers on this rank.

        Returns:
            (k, 2) pairs.
        """
        topology, d = self.domain.topology, self.domain.topology.dim
        topology.create_connectivity(dimension, d)
        topology.create_connectivity(d, dimension)
        own = entities[entities < topology.index_map(dimension).size_local]
        to_cells, to_own = topology.connectivity(dimension, d), topology.connectivity(d, dimension)
        cells = to_cells.array[to_cells.offsets[own]]
        pairs = zip(cells, own, strict=True)
        numbers = [np.flatnonzero(to_own.links(cell) == entity)[0] for cell, entity in pairs]
        return np.column_stack([cells, numbers]).astype(np.int32)


def build_mesh(
    geometry: Geometry,
    comm: MPI.Comm,
    disk: Cyclic | None = None,
    picks: Mapping[str, Region] = MappingProxyType({}),
) -> Mesh:
    """Make or read the mesh of a scene. Collective.

    In a .geo file, `geometry.parameters` sets the names in its `DefineConstant`. If `structured` is
    one of these names, `geometry.cells` sets it to 1 or 0. The file may refuse values with
    `Error("...")`. A .msh file may have any version that gmsh reads. The groups of both formats are
    the physical groups, by their names or numbers.

    A .step file is converted to metres and meshed with simplices of `geometry.size`; its faces are
    groups by their names or numbers. Bodies that touch are glued there: a face keeps its name on
    the surface, and its part inside is a group of both names, such as "6+11". The groups of other
    files are: node sets, element sets and surfaces in .inp; the elements of each property, by its
    number, in .bdf; components in .cdb; and in .vtu each integer field of cells or points that is 0
    or 1, and `name:value` for each value of the other integer fields. If a node set contains all
    nodes of some boundary facets, these facets are a facet group of the same name. A group of cells
    may have the name of a group of facets.

    Args:
        geometry: the [geometry] of the scene.
        comm: communicator to distribute the mesh on.
        disk: the disk of which the file is a sector, to make the mesh of all sectors, in which
            "tip@3" is the group "tip" of sector 3.
        picks: boxes and planes of a sector, by the names of the groups that the disk has of them.

    Returns:
        The mesh, with the same groups on every rank.

    Raises:
        SceneError: on every rank, if the file cannot be read or meshed; a parameter is unknown or
            refused; cells are mixed, inverted, overlapping, or of another dimension or kind than
            those of the scene; a node hangs; a group is empty; or meshio is missing.
        RuntimeError: gmsh is in use in this process.
    """
    with ExitStack() as stack:

        def draft() -> tuple[CleanModel, Any]:
            gmsh = stack.enter_context(open_gmsh())
            loaded = load_files(gmsh, geometry)
            if disk:
                loaded = make_disk(gmsh, geometry, disk, picks, loaded)
            clean = clean_model(gmsh, geometry, loaded.node_sets)
            warnings = (*loaded.warnings, *clean.warnings)
            sector = None if disk else clean.sector
            clean = replace(clean, warnings=warnings, glued=loaded.glued, sector=sector)
            return clean, gmsh.model

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
        SceneError: on every rank, if an argument is not allowed, gmsh is not initialised on rank 0,
            or the mesh cannot be used, as in `build_mesh`.
    """
    choice(2, 3)(dimension, Where(source, "dimension"))
    number(above=0.0)(scale, Where(source, "scale"))
    geometry = Geometry(mesh=Path(source), dimension=dimension, curved=curved, scale=scale)
    with ExitStack() as stack:

        def draft() -> tuple[CleanModel, Any]:
            import gmsh

            if not gmsh.isInitialized():
                raise refuse(source, "gmsh is not initialised on rank 0", ErrorKind.MESH)
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
        domain: the mesh in 2D or 3D, with coordinates of float64 in m.
        facet_tags: tags of the facets.
        groups: tag, or tags, of the facets of each group.
        cell_tags: tags of the cells, or None.
        source: name of the mesh, for messages.

    Returns:
        The mesh with these groups.

    Raises:
        SceneError: on every rank, if the coordinates are not finite or the cells overlap, the tags
            are not those of the facets or cells of this mesh, or no facet has a tag of a group.
    """
    d = domain.topology.dim
    check_dolfinx_mesh(domain, source)
    domain.topology.create_entities(d - 1)
    check_tags(domain, facet_tags, d - 1, "facet_tags", source)
    if cell_tags is not None:
        check_tags(domain, cell_tags, d, "cell_tags", source)
    present = set().union(*domain.comm.allgather(set(facet_tags.values.tolist())))
    named = {name: group_tags(name, tags, present, source) for name, tags in groups.items()}
    if cell_tags is None:
        cells = np.arange(domain.topology.index_map(d).size_local, dtype=np.int32)
        cell_tags = dolfinx.mesh.meshtags(domain, d, cells, np.ones_like(cells))
    return Mesh(domain, cell_tags, facet_tags, named, {}, source)


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
            failure = refuse(source, "the names in the file must be UTF-8 text")
        except Exception as error:
            failure = error
    failure, clean = comm.bcast((failure, clean))
    if failure is not None:
        raise failure
    domain, cell_tags, facet_tags = compat.model_to_mesh(model, comm, geometry.dimension)
    domain.topology.create_entities(geometry.dimension - 1)
    facet_groups, warnings = _facet_groups_on_cells(source, clean, facet_tags, domain)
    nodes, middles = _local_node_groups(clean.nodes, clean.node_sets, domain)
    return Mesh(
        domain,
        cell_tags,
        facet_tags,
        facet_groups,
        clean.cell_groups,
        source,
        warnings,
        node_groups=nodes,
        node_sets=middles,
        glued=clean.glued,
        sector=clean.sector,
    )


def _local_node_groups(
    nodes: dict[str, tuple[Ints, Ints]], middles: dict[str, Ints], domain: dolfinx.mesh.Mesh
) -> tuple[dict[str, tuple[Ints, Ints]], dict[str, Ints]]:
    """Find the vertices and edges of the node groups on this rank.

    Args:
        nodes: for each group, numbers in the model of the vertices, shape (n,), and of the ends of
            the edges, shape (k, 2).
        middles: numbers of the ends of other edges of some groups, shape (k, 2).
        domain: the mesh.

    Returns:
        The local vertices and edges of each group, and the local edges of `middles`.
    """
    if not nodes:
        return {}, {}
    topology = domain.topology
    for pair in ((0, topology.dim), (1, 0), (1, topology.dim)):
        topology.create_entities(pair[0])
        topology.create_connectivity(*pair)
    number = [topology.index_map(k).size_local + topology.index_map(k).num_ghosts for k in (0, 1)]
    vertices = np.arange(number[0], dtype=np.int32)
    places = compat.entity_nodes(domain, 0, vertices).reshape(-1)
    model = np.asarray(domain.geometry.input_global_indices)[places]
    ends = _keys(np.sort(model[topology.connectivity(1, 0).array].reshape(number[1], 2), axis=1))

    def local(numbers: Ints, among: Ints) -> Ints:
        return np.flatnonzero(np.isin(among, numbers)).astype(np.int32)

    def edges(pairs: Ints) -> Ints:
        return local(_keys(np.sort(pairs, axis=1)), ends)

    found = {name: (local(points, model), edges(pairs)) for name, (points, pairs) in nodes.items()}
    return found, {name: edges(pairs) for name, pairs in middles.items()}


def _keys(pairs: Ints) -> Ints:
    """One number for each pair of node numbers, shape (k, 2)."""
    return pairs[:, 0].astype(np.int64) * 2**31 + pairs[:, 1].astype(np.int64)


def _facet_groups_on_cells(
    source: str, clean: CleanModel, facet_tags: dolfinx.mesh.MeshTags, domain: dolfinx.mesh.Mesh
) -> tuple[dict[str, tuple[int, ...]], tuple[str, ...]]:
    """Leave out facets that do not belong to a cell; give groups and warnings. Collective."""
    below = domain.topology.dim - 1
    tags = facet_tags.values[facet_tags.indices < domain.topology.index_map(below).size_local]
    highest = max((max(tags) for tags in clean.facet_groups.values()), default=0)
    number = domain.comm.allreduce(np.bincount(tags, minlength=1 + highest))
    groups, warnings = dict(clean.facet_groups), list(clean.warnings)
    for name, size in clean.facets.items():
        lost = size - int(number[list(groups[name])].sum())
        if lost:
            what = f"{lost} of {size} facets are not facets of a cell and are left out"
            warnings.append(f"{source}: group {name!r}: {what}")
        if lost == size:
            del groups[name]
    return groups, tuple(warnings)
