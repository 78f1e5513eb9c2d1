"""Places of a scene on the mesh: nodes, means over regions, and contact points.

A place is represented by rows (d, local) that give its displacement from the unknowns.
"""

import basix.ufl
import dolfinx.mesh
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI
from scipy.sparse import csr_array

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.fem.base.forms import compiled_form
from fenicsrom.fem.body.elasticity import ElasticBody
from fenicsrom.fem.mesh.mesh import NEAR
from fenicsrom.formats.mesh_file import Ints
from fenicsrom.notes import Note, NoteKind
from fenicsrom.scene import Place, Region
from fenicsrom.words import are, counted

NO_SHARE = 1e-9
"""Smaller weights of a node, relative to the largest weight, count as zero."""


class Places:
    """Finds the places of a scene on a body. Every method is collective."""

    def __init__(self, body: ElasticBody):
        """Start without places."""
        self._body = body
        self._found: dict[Place, tuple[Array, Array]] = {}

    def find(self, place: Place, key: str, among: Ints | None = None) -> tuple[Array, Array]:
        """Give the displacement and the position of a place; the result is cached.

        Args:
            place: a node, the node nearest to a point or to the centroid of a region, or the mean
                over the region: weighted by area on facets, by length on the edges of a node group,
                or with equal weights on nodes alone.
            key: key of the scene, for messages.
            among: local nodes to which the node nearest to the centroid belongs. Default: those of
                the region.

        Returns:
            (d, local) rows, without the part that supports hold, and the position (3,) in m.

        Raises:
            SceneError: the region is missing or empty, the node or the whole region is clamped, or
                no node is near the coordinates.
        """
        if among is not None:
            return self._node(place, key, among)
        if place not in self._found:
            find = self._mean if place.is_mean else self._node
            self._found[place] = find(place, key)
        return self._found[place]

    def shares(self, place: Place, key: str, measured: bool) -> tuple[Array, float]:
        """Give the share (local / d,) of each node in a place, with the sum 1, and its measure.

        The measure is the area in m², the length of a curve in m or the number of nodes. With
        `measured`, the shares are those of the measure. Other arguments and errors as `find`.
        """
        d = self._body.dimension
        if place.is_mean:
            weights, _, measure = self._weights(place, key, measured)
            return weights, measure
        rows = self._node(place, key)[0]
        return rows.any(axis=0).reshape(-1, d).any(axis=1).astype(float), 1.0

    def contact_points(self, place: Place, key: str) -> tuple[csr_array, Array, Array]:
        """Give the contact points of a place.

        The points are sorted by the coordinate in which they extend farthest, then by the next one.
        Neighbours on an edge then follow one another, on any number of ranks.

        Args:
            place: the place; with at = "nodes" every node of the region is a point.
            key: key of the scene, for messages.

        Returns:
            Sparse rows (P d, local) of the displacements of P points, their positions (P, 3) in m,
            and their tributary areas (P,): in m² of facets, in m of a curve, else 1.

        Raises:
            SceneError: as `find`; every node of the region is clamped, or a component of the
                displacement of a single point; or the region is inside the body.
        """
        mesh, name = self._body.mesh, place.group
        inside = name is not None and place.at == "nodes" and mesh.has_facets(place)
        if name in mesh.glued or (inside and mesh.reaches_inside(place)):
            reason = f"the face {name!r}, or a part of it, is inside the body"
            reason += " (bodies are glued there)" if name in mesh.glued else ""
            reason += "; choose facets of the surface, by a group, a box or a plane"
            raise self._error(f"{key}.group", reason)
        if place.at != "nodes":
            rows, position = self.find(place, key)
            products = self._body.inner(rows.T, rows.T)
            if np.linalg.matrix_rank(products, hermitian=True) < len(products):
                reason = "a support holds this point in a direction; choose a free node"
                raise self._error(key, reason)
            return csr_array(rows), position[None, :], np.ones(1)
        body, d = self._body, self._body.dimension
        weights, _, measure = self._weights(place, key, measured=True)
        x = body.space.tabulate_dof_coordinates()[: body.local // d]
        weights[body.clamped // d] = 0.0  # also of a node that moves in a plane only
        if body.slanted is not None:
            weights[body.slanted.nodes] = 0.0
        largest = body.comm.allreduce(float(np.max(weights, initial=0.0)), op=MPI.MAX)
        mine = [  # the corners of quadratic triangles have no weight
            (*x[node].round(12), float(weights[node]), body.comm.rank, int(node))
            for node in np.flatnonzero(weights > NO_SHARE * largest)
        ]
        chosen = [point for points in body.comm.allgather(mine) for point in points]
        if not chosen:
            raise self.clamped(key)
        extent = np.ptp(np.array(chosen)[:, :3], axis=0).round(9)
        along = np.argsort(-extent, kind="stable")
        chosen.sort(key=lambda point: (*(point[k] for k in along), point))
        *position, weight, rank, node = np.array(chosen).T
        own = np.flatnonzero(rank == body.comm.rank)
        rows, columns = (
            (d * points[:, None] + np.arange(d)).ravel() for points in (own, node[own].astype(int))
        )
        shape = d * len(chosen), body.local
        at = csr_array((np.ones(rows.size), (rows, columns)), shape=shape)
        return at, np.stack(position, axis=1), weight * measure

    def clamped(self, key: str) -> SceneError:
        """The error of a region that cannot move."""
        return self._error(key, "every node of the region is clamped; choose free nodes")

    def _error(self, key: str, reason: str) -> SceneError:
        source = self._body.source
        return refuse(source, reason, ErrorKind.PLACE, key)

    def _mean(self, place: Place, key: str) -> tuple[Array, Array]:
        """Rows (d, local) of the mean displacement of a region, and its centroid (3,)."""
        body, d = self._body, self._body.dimension
        rows = np.zeros((d, body.local))
        weights, position, _ = self._weights(place, key)
        for k in range(d):
            rows[k, k::d] = weights
        body.without_held(rows.T)
        if not body.comm.allreduce(bool(rows.any()), op=MPI.LOR):
            raise self.clamped(key)
        return rows, position

    def _node(self, place: Place, key: str, among: Ints | None = None) -> tuple[Array, Array]:
        """Rows (d, local) of the displacement of a node, and its position (3,)."""
        body, d = self._body, self._body.dimension
        near = np.inf
        name = "node" if place.nearest is None else "nearest"
        wanted = getattr(place, name)
        if wanted is None:
            position = self._weights(place, key)[1]
        else:
            position = np.zeros(3)
            position[:d] = wanted
            near = NEAR * body.mesh.extent()
        rows = np.zeros((d, body.local))
        x = body.space.tabulate_dof_coordinates()[: body.local // d]
        distance = np.linalg.norm(x - position, axis=1)
        if wanted is None:  # another body may touch the region there
            nodes = body.mesh.nodes(place, body.space) if among is None else among
            inside = np.isin(np.arange(len(x)), nodes)
            distance[~inside] = np.inf
        best = int(np.argmin(distance)) if distance.size else -1
        mine = (np.inf, 0, 0, 0, -1)
        if best >= 0:
            mine = (round(float(distance[best]), 12), *x[best].round(12), body.comm.rank)
        chosen = min(body.comm.allgather(tuple(float(v) for v in mine)))
        if chosen[0] > near:
            nearest = [round(v, 6) for v in chosen[1 : 1 + d]]
            away = f"the nearest node is {nearest}, {chosen[0]:.3g} m away"
            if name == "node":
                reason = f"no node has the coordinates {list(wanted)}; {away}"
                raise self._error(f"{key}.node", reason)
            text = f"{body.source}: {key}.{name} = {list(wanted)}: {away}"
            self._body.warnings.append(Note(NoteKind.WARNING, text, key))
        clamped = False
        if int(chosen[-1]) == body.comm.rank:
            for k in range(d):
                rows[k, best * d + k] = 1.0
            body.without_held(rows.T)
            clamped = not rows.any()
        if body.comm.allreduce(clamped, op=MPI.LOR):
            at = list(chosen[1 : 1 + d])
            raise self._error(key, f"the node at {at} is clamped; choose a free node")
        return rows, np.array(chosen[1:4])

    def _weights(
        self, region: Region, key: str, measured: bool = False
    ) -> tuple[Array, Array, float]:
        """Weights of the mean over a region.

        Args:
            region: the region.
            key: key of the scene, for messages.
            measured: whether the weights are those of the measure, by which a node set on an edge
                consists of its nodes.

        Returns:
            Weights (local / d,) of the nodes, with the sum 1 over all ranks; the centroid (3,) in
            m; and the measure of the region: area in m², length in m or number of nodes.
        """
        if self._body.mesh.has_facets(region):
            if measured:
                self._note_lost_nodes(region, key)
            return self._facet_weights(region, key)
        lengths = self._body.mesh.unit_lengths(region)
        by_length = lengths == 1 or (not measured and self._body.mesh.has_edges(region))
        return self._edge_or_node_weights(region, by_length)

    def _note_lost_nodes(self, region: Region, key: str) -> None:
        """Warn of nodes of a set that lie on none of its facets: they have no area."""
        mesh, topology = self._body.mesh, self._body.mesh.domain.topology
        corners = mesh.node_groups.get(region.group or "", (np.zeros(0, dtype=np.int32),))[0]
        topology.create_connectivity(topology.dim - 1, 0)
        facets = mesh.facets(region).astype(np.int32)
        on = dolfinx.mesh.compute_incident_entities(topology, facets, topology.dim - 1, 0)
        lost = np.setdiff1d(corners, on)
        own = topology.index_map(0).size_local
        number = self._body.comm.allreduce(int(np.sum(lost < own)))
        if number:
            text = f"{key}: {counted(number, 'node')} of the group {region.group!r} {are(number)} "
            text += "on none of its facets and left out: a node without a facet has no area"
            self._body.warnings.append(Note(NoteKind.WARNING, text, key))

    def _facet_weights(self, region: Region, key: str) -> tuple[Array, Array, float]:
        """Weights of the nodes of facets, by area; arguments as `_weights`."""
        body = self._body
        domain = body.mesh.domain
        ds = body.mesh.surface(region)
        scalar = fem.functionspace(domain, ("Lagrange", body.geometry.degree))
        weights = fem.Function(scalar)
        per, whole = fem.Constant(domain, 1.0), float(body.materials.thickness[0])
        if not body.materials.has_one_thickness:  # by volume: it changes along the region
            per, whole = body.thickness, 1.0
        fem.assemble_vector(weights.x.array, compiled_form(per * ufl.TestFunction(scalar) * ds))
        weights.x.scatter_reverse(dolfinx.la.InsertMode.add)
        x = ufl.SpatialCoordinate(domain)
        area = body.comm.allreduce(fem.assemble_scalar(compiled_form(per * ds)))
        if not area > 0.0:
            name = region.group
            raise self._error(f"{key}.group", f"group {name!r} has no area; name a group of facets")
        position = np.zeros(3)
        for k in range(body.dimension):
            moment = fem.assemble_scalar(compiled_form(per * x[k] * ds))
            position[k] = body.comm.allreduce(moment) / area
        local = scalar.dofmap.index_map.size_local
        return weights.x.array[:local] / area, position, float(area * whole)

    def _edge_or_node_weights(self, region: Region, by_length: bool) -> tuple[Array, Array, float]:
        """Weights by the length of edges, or equal ones of nodes; as `_weights`."""
        body = self._body
        domain, degree = body.mesh.domain, body.geometry.degree
        scalar = fem.functionspace(domain, ("Lagrange", degree))
        weights = fem.Function(scalar)
        local = scalar.dofmap.index_map.size_local
        x = scalar.tabulate_dof_coordinates()
        if by_length:
            edges = body.mesh.entities(region)[1]
            shares, dofmap = _edge_shares(degree), scalar.dofmap
            for cell, side in body.mesh.sides(1, edges):
                inner = dofmap.dof_layout.entity_closure_dofs(1, side)
                nodes = dofmap.cell_dofs(cell)[inner]
                weights.x.array[nodes] += shares * np.linalg.norm(x[nodes[1]] - x[nodes[0]])
            weights.x.scatter_reverse(dolfinx.la.InsertMode.add)
        else:
            weights.x.array[:] = body.mesh.node_counts(region, scalar)
        mine = weights.x.array[:local]
        total = body.comm.allreduce(float(mine.sum()))
        return mine / total, np.asarray(body.comm.allreduce(mine @ x[:local])) / total, float(total)


def _edge_shares(degree: int) -> Array:
    """Integrals (degree + 1,) of the shape functions of a straight edge of length 1."""
    element = basix.ufl.element("Lagrange", "interval", degree)
    points, weights = basix.make_quadrature(basix.CellType.interval, degree)
    return np.asarray(weights @ element.tabulate(0, points)[0])
