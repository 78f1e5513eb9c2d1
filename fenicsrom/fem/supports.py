"""Clamped supports, and the check that they hold the body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from dolfinx import fem
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.fem.mesh_data import Ints, Mesh
from fenicsrom.scene import Region

COINCIDENT = 1e-12
"""Smaller variances of the clamped nodes, relative to the squared extent, count as zero."""


def clamped_nodes(
    mesh: Mesh, space: fem.FunctionSpace, supports: Sequence[Region], source: str
) -> npt.NDArray[np.int32]:
    """Give the nodes that the supports clamp. Collective.

    Args:
        mesh: the mesh.
        space: the displacement space, Lagrange.
        supports: the regions that are clamped.
        source: name of the scene file, for messages.

    Returns:
        Sorted local node numbers of this rank, ghosts included.

    Raises:
        SceneError: a region is missing, or the supports do not hold the body.
    """
    nodes = np.unique(np.concatenate([mesh.nodes(support, space) for support in supports]))
    pieces = unclamped_pieces(mesh, supports)
    if pieces:
        named = ", ".join(support.group or "picked by coordinates" for support in supports)
        some = (
            "1 connected piece of the mesh touches"
            if pieces == 1
            else f"{pieces} connected pieces of the mesh touch"
        )
        raise SceneError(
            f"{mesh.source}: {some} no support ({named}), so the stiffness is singular; clamp "
            "every piece, or join the parts of the mesh (coincident nodes do not join them)",
            kind=ErrorKind.SUPPORT,
            key="supports",
            source=mesh.source,
        )
    check_no_hinge(mesh, space, nodes, source)
    return nodes


def check_no_hinge(
    mesh: Mesh, space: fem.FunctionSpace, nodes: npt.NDArray[np.int32], source: str
) -> None:
    """Check that the body cannot rotate about its clamped nodes. Collective.

    Args:
        mesh: the mesh.
        space: the displacement space.
        nodes: local numbers of the clamped nodes, ghosts included.
        source: name of the scene file, for messages.

    Raises:
        SceneError: the supports clamp a single node or, in 3D, nodes on one line.
    """
    d, owned = mesh.domain.geometry.dim, nodes[nodes < space.dofmap.index_map.size_local]
    x = space.tabulate_dof_coordinates()[owned, :d]
    y = np.column_stack([np.ones(len(x)), (x - mesh.bounds()[0][:d]) / mesh.extent()])
    moments = mesh.domain.comm.allreduce(y.T @ y)
    mean = moments[0, 1:] / moments[0, 0]
    spread = np.linalg.eigvalsh(moments[1:, 1:] / moments[0, 0] - np.outer(mean, mean))
    if spread[1] < COINCIDENT:
        what = "a single node" if spread[-1] < COINCIDENT else "nodes on one line"
        raise SceneError(
            f"{source}: supports: they clamp {what}, so the body can rotate; clamp more nodes",
            kind=ErrorKind.SUPPORT,
            key="supports",
            source=source,
        )


def unclamped_pieces(mesh: Mesh, regions: Sequence[str | Region]) -> int:
    """Count the connected pieces of the mesh that no support touches. Collective.

    Cells that share a vertex are connected. Each rank finds the connected pieces of its own cells.
    The pieces are then joined through the vertices that ranks share, so only these vertices are
    gathered.

    Args:
        mesh: the mesh.
        regions: the clamped facet groups, node groups, or regions of the scene.

    Returns:
        The number of pieces that can move as rigid bodies, the same on every rank.

    Raises:
        SceneError: the mesh has no such group, or a region is empty.
    """
    comm, topology = mesh.domain.comm, mesh.domain.topology
    clamped: list[Ints] = []
    for dimension, entities in (item for where in regions for item in mesh.entities(where).items()):
        topology.create_connectivity(dimension, 0)
        clamped += [topology.connectivity(dimension, 0).links(entity) for entity in entities]

    vertices, corners = topology.index_map(0), topology.connectivity(topology.dim, 0)
    cells = topology.index_map(topology.dim).size_local
    points = vertices.size_local + vertices.num_ghosts
    cell = np.repeat(np.arange(cells), np.diff(corners.offsets[: cells + 1]))
    piece = _components(cell, cells + corners.array[: len(cell)], cells + points)[cells:]
    held = np.zeros(cells + points, dtype=bool)
    held[piece[np.unique(np.concatenate([*clamped, np.empty(0, dtype=np.int32)]))]] = True

    # join the pieces of all ranks through the shared vertices
    border = np.unique(np.concatenate(comm.allgather(vertices.ghosts)))
    names = vertices.local_to_global(np.arange(points, dtype=np.int32))
    shared = np.isin(names, border)
    parts = comm.allgather(
        (held[: piece.max(initial=-1) + 1], piece[shared], np.searchsorted(border, names[shared]))
    )
    first = np.cumsum([0] + [len(part[0]) for part in parts])
    rows = np.concatenate([part[1] + start for part, start in zip(parts, first[:-1], strict=True)])
    columns = first[-1] + np.concatenate([part[2] for part in parts])
    pieces = _components(rows, columns, first[-1] + len(border))[: first[-1]]
    return len(np.setdiff1d(pieces, pieces[np.concatenate([part[0] for part in parts])]))


def _components(rows: Ints, columns: Ints, size: int) -> Ints:
    """Number the connected components of an undirected graph of `size` nodes, by node."""
    graph = coo_array((np.ones(len(rows), dtype=bool), (rows, columns)), shape=(size, size))
    return connected_components(graph, directed=False)[1]
