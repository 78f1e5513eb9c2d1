"""Clamped supports, and the check that they hold the body.

A support clamps components of the displacement at its nodes, or the displacement along a normal
(2). The linear rigid-body motions

    u(x) = t + w × (x − c)    (3 in the plane, 6 in space)    (1)

must all move a clamped component: the matrix of the motions, restricted to what is clamped of a
connected piece of the mesh, must have full rank.

A node that is held along the orthonormal directions n_1, .. has the displacement P u with the
orthogonal projection P = I − Σ n_k n_kᵀ. With the projection P of all nodes, the components of
vectors remain those along the global axes, and forces and matrices become

    P f,    P K P + c (I − P),    P M P.    (2)

Vectors with P u = u are an invariant space of these matrices. The other part of a solution stays
zero.
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import scipy.sparse
from dolfinx import fem
from petsc4py import PETSc
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind, SceneError, refuse
from fenicsrom.fem.mesh.gmsh_model import MOST_PIECES, WAYS_OUT, apart, boxes, ends_of
from fenicsrom.fem.mesh.mesh import NEAR, Ints, Mesh
from fenicsrom.fem.mesh.picking import ROUNDING
from fenicsrom.scene import Support
from fenicsrom.scene.keys.places import AXES
from fenicsrom.words import counted


class Held(NamedTuple):
    """The displacements that supports hold, ghosts included.

    Attributes:
        unknowns: (c,) sorted local numbers of the clamped unknowns.
        nodes: (s,) local numbers of the nodes that are also held along slanted directions.
        slanted: (s, d, d) Σ n_k n_kᵀ of these directions, which are orthogonal to the clamped axes.
    """

    unknowns: npt.NDArray[np.int32]
    nodes: npt.NDArray[np.int32]
    slanted: Array


class Slanted:
    """The projection (2) on a displacement space. Every method is collective.

    Attributes:
        rank: number of directions that are held, over all ranks.
        nodes: (s,) local numbers of the nodes of this rank.
        held: (s, d, d) Σ n_k n_kᵀ of the directions along which they are held.
        blocks: sparse (local, local), the same at the unknowns of the nodes.
    """

    def __init__(self, space: fem.FunctionSpace, held: Held):
        """Make the projection of the nodes that this rank owns."""
        index = space.dofmap.index_map
        own = held.nodes < index.size_local
        self.nodes, self.held = held.nodes[own], held.slanted[own]
        d, local = space.dofmap.index_map_bs, index.size_local * space.dofmap.index_map_bs
        self._unknowns = self.nodes[:, None] * d + np.arange(d)
        comm, first = space.mesh.comm, index.local_range[0] * d
        self.rank = round(comm.allreduce(float(np.trace(self.held, axis1=1, axis2=2).sum())))
        rows = np.repeat(self._unknowns[:, :, None], d, axis=2).ravel()
        columns = np.repeat(self._unknowns[:, None, :], d, axis=1).ravel()
        shape = local, local
        self.blocks = csr_array((self.held.ravel(), (rows, columns)), shape=shape)
        matrix: Any = scipy.sparse.eye_array(local, format="csr") - self.blocks
        size = (local, index.size_global * d)
        starts, columns = (a.astype(PETSc.IntType) for a in (matrix.indptr, matrix.indices + first))
        self._matrix = PETSc.Mat().createAIJ(
            (size, size), csr=(starts, columns, matrix.data), comm=comm
        )
        self._first = first

    def project(self, block: Array) -> None:
        """Replace a block (local,) or (local, k) by its projection."""
        values = block[self._unknowns]
        block[self._unknowns] = values - np.einsum("sij,sj...->si...", self.held, values)

    def project_matrix(self, matrix: PETSc.Mat, diagonal: float) -> None:
        """Replace an assembled matrix by (2), with the same pattern.

        Args:
            matrix: the matrix.
            diagonal: c, relative to the largest entry on the diagonal of the node. Rounding couples
                the two parts by a 1e-16 of this entry.
        """
        product = matrix.ptap(self._matrix)
        entries = np.abs(product.getDiagonal().array_r[self._unknowns]).max(axis=1, initial=0.0)
        product.copy(matrix, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        product.destroy()
        scales = diagonal * np.where(entries > 0.0, entries, 1.0)
        for unknowns, block in zip(self._unknowns, scales[:, None, None] * self.held, strict=True):
            rows = (self._first + unknowns).astype(PETSc.IntType)
            matrix.setValues(rows, rows, block, PETSc.InsertMode.ADD_VALUES)
        matrix.assemble()


SAME_DIRECTION = 1e-12
"""Directions at a node with a smaller angle, squared, are one direction that was rounded."""

ON_AXIS = 1e-12
"""An axis is clamped if the square of its part outside of the held directions is smaller."""

COINCIDENT = 1e-12
"""Smaller mean squares of the clamped components of a rigid motion count as zero.

The lengths of the motion are relative to the extent of the mesh.
"""


def held_displacements(
    mesh: Mesh, space: fem.FunctionSpace, supports: Sequence[Support], source: str
) -> Held:
    """Give the displacements that the supports hold. Collective.

    Directions of several supports may meet at a node; almost equal directions count as one.

    Args:
        mesh: the mesh.
        space: the displacement space, Lagrange.
        supports: the supports.
        source: name of the scene file, for messages.

    Raises:
        SceneError: a region is missing.
    """
    d = mesh.domain.geometry.dim
    dyads = np.zeros((space.tabulate_dof_coordinates().shape[0], d, d))
    sets: dict[tuple[float, ...], list[Ints]] = defaultdict(list)
    for support in supports:
        nodes, directions = support_directions(mesh, space, support, source)
        dyads[nodes] += directions.T @ directions
        if support.group in mesh.node_groups:
            for direction in directions.tolist():
                sets[tuple(direction)].append(mesh.node_groups[support.group][0])
    for direction, corners in sets.items():
        dyads[_nodes_between(mesh, space, corners)] += np.outer(direction, direction)
    diagonal = np.einsum("nii->ni", dyads)
    axial = diagonal > 0.0
    nodes = np.flatnonzero(np.abs(dyads).sum(axis=(1, 2)) > diagonal.sum(axis=1))
    values, vectors = np.linalg.eigh(dyads[nodes])
    vectors = vectors * (values > SAME_DIRECTION)[:, None, :]
    slanted = vectors @ vectors.transpose(0, 2, 1)
    axial[nodes] = np.einsum("nii->ni", slanted) > 1.0 - ON_AXIS
    whole = axial[nodes]
    slanted[whole[:, :, None] | whole[:, None, :]] = 0.0
    kept = np.trace(slanted, axis1=1, axis2=2) > 0.5
    unknowns = np.flatnonzero(axial.reshape(-1)).astype(np.int32)
    return Held(unknowns, nodes[kept].astype(np.int32), slanted[kept])


def support_directions(
    mesh: Mesh, space: fem.FunctionSpace, support: Support, source: str
) -> tuple[npt.NDArray[np.int32], Array]:
    """Give the nodes (k,) of one support, ghosts included, and its orthonormal directions (c, d).

    Arguments and errors as `held_displacements`.
    """
    if support.node is None:
        nodes = mesh.nodes(support, space)
    else:
        nodes = _node_at(mesh, space, support.node, source)
    if support.normal is not None:
        return nodes, np.array([support.normal])
    d = mesh.domain.geometry.dim
    axes = [AXES.index(axis) for axis in support.components or AXES[:d]]
    return nodes, np.eye(d)[axes]


def _nodes_between(
    mesh: Mesh, space: fem.FunctionSpace, sets: Sequence[Ints]
) -> npt.NDArray[np.int32]:
    """The nodes of the facets whose corners are in several node sets together. Collective.

    The sets hold one direction. The nodes inside such a facet that the file does not have would be
    free in it.
    """
    if len(sets) < 2:
        return np.empty(0, dtype=np.int32)
    facets = mesh.facets_between(np.concatenate(sets)).astype(np.int32)
    return fem.locate_dofs_topological(space, mesh.domain.topology.dim - 1, facets)


def _node_at(
    mesh: Mesh, space: fem.FunctionSpace, point: Sequence[float], source: str
) -> npt.NDArray[np.int32]:
    """The node at a point, on each rank that has it. Collective."""
    d, comm, extent = mesh.domain.geometry.dim, mesh.domain.comm, mesh.extent()
    distance = np.linalg.norm(space.tabulate_dof_coordinates()[:, :d] - point, axis=1)
    nearest = min(comm.allgather(float(np.min(distance, initial=np.inf))))
    if nearest > NEAR * extent:
        away = f"the nearest node is {nearest:.3g} m away"
        reason = f"no node has the coordinates {list(point)}; {away}"
        raise refuse(source, reason, ErrorKind.PLACE, "supports")
    return np.flatnonzero(distance <= nearest + ROUNDING * extent).astype(np.int32)


def conditions(
    space: fem.FunctionSpace, zero: fem.Function, unknowns: npt.NDArray[np.int32]
) -> list[fem.DirichletBC]:
    """Give the boundary conditions of clamped unknowns: of whole nodes, then by component."""
    d = space.dofmap.index_map_bs
    nodes, held = np.unique(unknowns // d, return_counts=True)
    found = [fem.dirichletbc(zero, nodes[held == d].astype(np.int32))]
    rest = unknowns[np.isin(unknowns // d, nodes[held < d])]
    for component in range(d):
        part = space.sub(component)
        some = rest[rest % d == component].astype(np.int32)
        found.append(fem.dirichletbc(np.float64(0.0), some, part))
    return found if space.mesh.comm.allreduce(rest.size) else found[:1]


class RigidMotions(NamedTuple):
    """The rigid motions (1) of the k pieces of a mesh, m of each, and those that nothing holds.

    Attributes:
        fields: sparse (local, k m) displacements.
        moments: (k m, k m) mean products of what is held of them.
        free: (k m, r) combinations that nothing holds.
    """

    fields: csr_array
    moments: Array
    free: Array


def free_motions(body: Any, springs: Sequence[csr_array]) -> RigidMotions:
    """Find the rigid motions of pieces that neither supports nor springs hold. Collective.

    Args:
        body: the body.
        springs: sparse, symmetric (local, size) stiffnesses, N/m; the size of each is no matter.
    """
    d, comm = body.dimension, body.comm
    piece, count = node_pieces(body.mesh, body.space)
    low, high = body.mesh.bounds()
    x = body.space.tabulate_dof_coordinates()[: body.local // d]
    motions = rigid_motions((x - 0.5 * (low + high)) / body.extent, d)
    m = motions.shape[2]
    columns = np.broadcast_to(m * piece[: len(x), None, None] + np.arange(m), motions.shape)
    fields = csr_array(
        (motions.ravel(), columns.ravel(), np.arange(0, motions.size + 1, m)),
        shape=(body.local, count * m),
    )
    held = body.held_matrix
    times = np.bincount(piece[np.arange(body.local) // d], held.diagonal(), count)
    moments = comm.allreduce((fields.T @ held @ fields).toarray())
    moments /= np.maximum(comm.allreduce(times), 1.0).repeat(m)
    # relative to the sum of absolute values, whose rounding springs within a piece leave
    for some in springs:
        products = (fields, some), (abs(fields), abs(some))
        sprung, size = (comm.allreduce((f.T @ body.coupled(k, f)).toarray()) for f, k in products)
        moments += sprung / max(float(size.max()), np.finfo(float).tiny)
    values, vectors = np.linalg.eigh(moments)
    return RigidMotions(fields, moments, vectors[:, values < COINCIDENT])


def loose(body: Any, found: RigidMotions) -> SceneError:
    """The error of supports that leave rigid motions free."""
    d, supports = body.dimension, body.supports
    pieces = found.moments.diagonal().reshape(-1, 3 * (d - 1)).max(axis=1)
    if untouched := int((pieces == 0.0).sum()):
        return _untouched(body.mesh, supports, untouched)
    reason = f"they leave {free_pieces(body, found)} free, so the stiffness is "
    reason += "singular; clamp more nodes or components, or hold them by springs or contacts"
    return refuse(body.source, reason, ErrorKind.SUPPORT, "supports")


def free_pieces(body: Any, found: RigidMotions) -> str:
    """Name the motions that nothing holds, and the pieces of the mesh that have them. Collective.

    Such as "1 translation of the piece of the mesh at (0 to 1, 0 to 2) m".
    """
    d, (low, high) = body.dimension, _ends(body.mesh, body.space)
    motions = _named_motions(found.free, d)
    if len(low) == 1:
        return motions
    moves = np.abs(found.free).reshape(len(low), -1).max(axis=1) > np.sqrt(COINCIDENT)
    named = boxes(low[moves], high[moves])
    more = ", .." * (len(named) > MOST_PIECES)
    some = "the piece" if len(named) == 1 else "the pieces"
    return f"{motions} of {some} of the mesh at {', '.join(named[:MOST_PIECES])}{more} m"


def pieces_apart(mesh: Mesh, space: fem.FunctionSpace) -> str:
    """A sentence on the pieces of the mesh that share no node; empty for one. Collective."""
    return apart(*_ends(mesh, space))


def _ends(mesh: Mesh, space: fem.FunctionSpace) -> tuple[Array, Array]:
    """Lowest and highest coordinates (k, d) of the pieces of the mesh, m. Collective."""
    d, (piece, count) = mesh.domain.geometry.dim, node_pieces(mesh, space)
    ends = ends_of(piece, space.tabulate_dof_coordinates()[:, :d], count)
    lows, highs = zip(*mesh.domain.comm.allgather(ends), strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)


def rigid_motions(arm: Array, d: int) -> Array:
    """The motions (1) of places (k, 3) about the origin: (k, d, 3 or 6)."""
    motions = np.zeros((len(arm), d, 3 * (d - 1)))
    motions[:, :, :d] = np.eye(d)
    for k, axis in enumerate(np.eye(3)[2:] if d == 2 else np.eye(3)):
        motions[:, :, d + k] = np.cross(axis, arm)[:, :d]
    return motions


def _named_motions(free: Array, d: int) -> str:
    """Name rigid motions, such as "2 translations and 1 rotation".

    Args:
        free: (pieces · m, r) motions as combinations of the m motions (1) of each piece.
        d: dimension of space; the first d motions of a piece are its translations.
    """
    turns = free.reshape(-1, 3 * (d - 1), free.shape[1])[:, d:].reshape(-1, free.shape[1])
    turning = int(np.linalg.matrix_rank(turns, tol=np.sqrt(COINCIDENT)))
    counts = {"translation": free.shape[1] - turning, "rotation": turning}
    return " and ".join(counted(n, name) for name, n in counts.items() if n)


def _untouched(mesh: Mesh, supports: Sequence[Support], pieces: int) -> SceneError:
    """The error of pieces of the mesh that no support touches."""
    named = ", ".join(support.group or "picked by coordinates" for support in supports)
    some = (
        f"{counted(pieces, 'connected piece')} of the mesh {'touches' if pieces == 1 else 'touch'}"
    )
    reason = f"{some} no support ({named}), so the stiffness is singular; clamp every piece, or "
    reason += f"join the pieces (coincident nodes do not join them); {WAYS_OUT}"
    return refuse(mesh.source, reason, ErrorKind.SUPPORT, "supports")


def node_pieces(mesh: Mesh, space: fem.FunctionSpace) -> tuple[Ints, int]:
    """The piece of each node of a space, ghosts included, and the number of pieces. Collective."""
    topology, cells = mesh.domain.topology, space.dofmap.list
    pieces, count = connected_pieces(mesh)
    corners = topology.connectivity(topology.dim, 0)
    piece = np.zeros(len(space.tabulate_dof_coordinates()), dtype=np.int64)
    piece[cells] = pieces[corners.array[corners.offsets[: len(cells)]]][:, None]
    return piece, count


def connected_pieces(mesh: Mesh) -> tuple[Ints, int]:
    """Number the connected pieces of the mesh. Collective.

    Cells that share a vertex are connected. Each rank finds the connected pieces of its own cells.
    The pieces are then joined through the vertices that ranks share, so only these vertices are
    gathered.

    Returns:
        The piece of each local vertex, ghosts included, and the number of pieces; the numbers are
        the same on every rank.
    """
    comm, topology = mesh.domain.comm, mesh.domain.topology
    vertices, corners = topology.index_map(0), topology.connectivity(topology.dim, 0)
    cells = topology.index_map(topology.dim).size_local
    points = vertices.size_local + vertices.num_ghosts
    cell = np.repeat(np.arange(cells), np.diff(corners.offsets[: cells + 1]))
    piece = _components(cell, cells + corners.array[: len(cell)], cells + points)[cells:]

    # join the pieces of all ranks through the shared vertices
    border = np.unique(np.concatenate(comm.allgather(vertices.ghosts)))
    names = vertices.local_to_global(np.arange(points, dtype=np.int32))
    shared = np.isin(names, border)
    parts = comm.allgather(
        (int(piece.max(initial=-1)) + 1, piece[shared], np.searchsorted(border, names[shared]))
    )
    first = np.cumsum([0] + [part[0] for part in parts])
    rows = np.concatenate([part[1] + start for part, start in zip(parts, first[:-1], strict=True)])
    columns = first[-1] + np.concatenate([part[2] for part in parts])
    joined = _components(rows, columns, first[-1] + len(border))[: first[-1]]
    found, numbers = np.unique(joined, return_inverse=True)
    return numbers[first[comm.rank] + piece], len(found)


def _components(rows: Ints, columns: Ints, size: int) -> Ints:
    """Number the connected components of an undirected graph of `size` nodes, by node."""
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(size, size))
    return connected_components(graph, directed=False)[1]
