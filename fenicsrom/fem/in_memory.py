"""Meshes that another program made in this process: a gmsh model, or a dolfinx mesh with tags."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import dolfinx.mesh
import numpy as np
from mpi4py import MPI

from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.fem import compat
from fenicsrom.fem.mesh import SOLID, Mesh


def mesh_from_gmsh_model(
    model: Any, dimension: int, comm: Any = None, source: str = "gmsh model"
) -> Mesh:
    """Take the mesh of a gmsh model in memory. Collective.

    The model stays as it is, except that its nodes are renumbered without gaps.

    Args:
        model: `gmsh.model` on rank 0, after `gmsh.model.mesh.generate`; anything on other ranks.
            Every cell must be in exactly one physical group. The groups of facets have the names
            (or numbers) by which a scene refers to them.
        dimension: of the cells and of space, 2 or 3; coordinates in m.
        comm: MPI communicator of the mesh; by default all ranks.
        source: name of the mesh in messages.

    Returns:
        The mesh.

    Raises:
        SceneError: on every rank, if the model has no group of cells or a group without elements.
    """
    comm = MPI.COMM_WORLD if comm is None else comm
    named: dict[str, tuple[int, tuple[int, ...]]] = {}
    if comm.rank == 0:
        model.mesh.renumberNodes()
        for below in (dimension, dimension - 1):
            for _, tag in model.getPhysicalGroups(below):
                name = model.getPhysicalName(below, tag) or str(tag)
                named[name] = (below, (tag,))
    named = comm.bcast(named)
    if not any(of == dimension for of, _ in named.values()):
        raise _refused(source, f"no physical group of dimension {dimension} holds the cells")
    domain, cell_tags, facet_tags = compat.model_to_mesh(model, comm, dimension)
    facets = {name: tags for name, (of, tags) in named.items() if of == dimension - 1}
    mesh = mesh_from_dolfinx(domain, facet_tags, facets, source=source)
    cells = {name: (of, tags) for name, (of, tags) in named.items() if of == dimension}
    return Mesh(domain, cell_tags, facet_tags, cells | mesh.groups, source)


def mesh_from_dolfinx(
    domain: dolfinx.mesh.Mesh,
    facet_tags: dolfinx.mesh.MeshTags,
    groups: Mapping[str, int | Sequence[int]],
    source: str = "dolfinx mesh",
) -> Mesh:
    """Take a dolfinx mesh with tagged facets. Collective.

    Args:
        domain: the mesh, coordinates in m; its cells are the solid.
        facet_tags: tags of facets.
        groups: the tag, or the tags, of each facet group, by the name that a scene uses.
        source: name of the mesh in messages.

    Returns:
        The mesh.

    Raises:
        SceneError: on every rank, if the tags are not those of facets or a group has no facet.
    """
    d = domain.topology.dim
    if facet_tags.dim != d - 1:
        raise _refused(source, f"the tags have dimension {facet_tags.dim}; must be {d - 1}")
    domain.topology.create_entities(d - 1)
    found: dict[str, tuple[int, tuple[int, ...]]] = {SOLID: (d, (1,))}
    for name, given in groups.items():
        tags = (int(given),) if isinstance(given, int) else tuple(map(int, given))
        if not domain.comm.allreduce(int(np.isin(facet_tags.values, tags).sum())):
            raise _refused(source, f"group {name!r} has no facet")
        found[name] = (d - 1, tags)
    index_map = domain.topology.index_map(d)
    cells = np.arange(index_map.size_local + index_map.num_ghosts, dtype=np.int32)
    cell_tags = dolfinx.mesh.meshtags(domain, d, cells, np.ones_like(cells))
    return Mesh(domain, cell_tags, facet_tags, found, source)


def _refused(source: str, reason: str) -> SceneError:
    return SceneError(f"{source}: {reason}", kind=ErrorKind.MESH, source=source)
