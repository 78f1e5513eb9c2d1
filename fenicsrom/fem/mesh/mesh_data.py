"""The mesh of a scene, whose facets and nodes are found by name or by coordinates."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import Any

import dolfinx.mesh
import numpy as np
import numpy.typing as npt
import ufl
from dolfinx import fem

from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.fem.mesh.sector import Sector
from fenicsrom.scene import Region
from fenicsrom.words import brief

Ints = npt.NDArray[Any]
Floats = npt.NDArray[np.float64]

ON_PLANE = 1e-6
"""Default tolerance of a picking plane, relative to the extent of the mesh."""

NEAR = 1e-3
"""Accepted distance of a node from the coordinates of a place, relative to the extent."""

ROUNDING = 1e-9
"""Smaller distances, relative to the extent of the mesh, count as zero."""


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
        node_sets: names of the node groups that are node sets of the file. Where the numbers of a
            contact are those of its nodes, each of their nodes counts as one, on an edge too.
        glued: names of the faces of a CAD file along which bodies are glued.
        sector: set if the body is one sector of a disk.
        has_middles: whether the cells of the file have nodes in the middle of their edges.
    """

    domain: dolfinx.mesh.Mesh
    cell_tags: dolfinx.mesh.MeshTags
    facet_tags: dolfinx.mesh.MeshTags
    facet_groups: dict[str, tuple[int, ...]]
    cell_groups: dict[str, tuple[int, ...]]
    source: str
    warnings: tuple[str, ...] = ()
    node_groups: dict[str, tuple[Ints, Ints]] = field(default_factory=dict)
    node_sets: frozenset[str] = frozenset()
    glued: Collection[str] = ()
    sector: Sector | None = None
    has_middles: bool = False

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
        extent = float(np.max(high - low))
        if region.box is not None:
            low_corner, high_corner = np.array(region.box)[:, :, None]
            what, margin = f"box = {np.array(region.box).tolist()}", ROUNDING * extent

            def inside(x: Floats) -> npt.NDArray[np.bool_]:
                above, below = x[:d] >= low_corner - margin, x[:d] <= high_corner + margin
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
            if self.node_groups and not self.has_facets(where):
                known = self.facet_groups.keys() | self.node_groups.keys()
                raise self._unknown("facet or node group", str(name), known)
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

    def reaches_inside(self, where: str | Region) -> bool:
        """Whether facets of a region lie inside the body. Collective.

        Args:
            where: a facet group, or a region of the scene with facets.

        Raises:
            SceneError: the mesh has no such group, or nothing is picked.
        """
        topology, below = self.domain.topology, self.domain.topology.dim - 1
        topology.create_connectivity(below, below + 1)
        boundary = dolfinx.mesh.exterior_facet_indices(topology)
        facets = self.facets(where)
        owned = facets[facets < topology.index_map(below).size_local]
        return any(self.domain.comm.allgather(bool(np.any(~np.isin(owned, boundary)))))

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
        found, dofmap = self.entities(where), space.dofmap
        counts = fem.Function(space, dtype=np.float64)
        if self.has_middles:
            for cell, side in self.sides(1, found.get(1, np.empty(0, dtype=np.int32))):
                inside = dofmap.dof_layout.entity_dofs(1, side)
                inside = inside or dofmap.dof_layout.entity_closure_dofs(1, side)
                counts.x.array[dofmap.cell_dofs(cell)[inside]] += 1.0 / len(inside)
            counts.x.scatter_reverse(dolfinx.la.InsertMode.add)
            counts.x.scatter_forward()
        self.domain.topology.create_connectivity(0, self.domain.topology.dim)
        counts.x.array[fem.locate_dofs_topological(space, 0, found[0].astype(np.int32))] += 1.0
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
