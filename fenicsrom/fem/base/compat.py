"""All code that depends on the version of dolfinx (0.9 to 0.11)."""

from typing import Any

import dolfinx.mesh
import numpy as np
from mpi4py import MPI

try:
    from dolfinx.io import gmsh as _gmsh_io
except ImportError:  # dolfinx 0.9
    from dolfinx.io import gmshio as _gmsh_io


def model_to_mesh(
    model: Any, comm: MPI.Comm, dimension: int
) -> tuple[dolfinx.mesh.Mesh, dolfinx.mesh.MeshTags, dolfinx.mesh.MeshTags]:
    """Distribute the mesh of a gmsh model held by rank 0.

    Args:
        model: the gmsh model on rank 0 (anything elsewhere), nodes numbered from 1 without gaps,
            every cell in exactly one physical group.
        comm: the communicator of the mesh.
        dimension: dimension of space, 2 or 3.

    Returns:
        The mesh, the tags of its cells and the tags of its facets: the tags of the physical groups.
    """
    domain, cell_tags, facet_tags = _gmsh_io.model_to_mesh(model, comm, 0, gdim=dimension)[:3]
    if facet_tags is None:  # dolfinx after 0.9, for a model without facets
        nothing = np.empty(0, dtype=np.int32)
        facet_tags = dolfinx.mesh.meshtags(domain, domain.topology.dim - 1, nothing, nothing)
    return domain, cell_tags, facet_tags


def entity_nodes(domain: dolfinx.mesh.Mesh, dimension: int, entities: Any) -> np.ndarray:
    """The nodes (k, n) of entities (k,) of a dimension, as indices of the geometry.

    dolfinx ends the program if k is 0.
    """
    if not len(entities):
        return np.empty((0, 2**dimension), dtype=np.int32)
    return dolfinx.mesh.entities_to_geometry(domain, dimension, np.asarray(entities, np.int32))


def cells_of(geometry: dolfinx.mesh.Geometry) -> tuple[Any, np.ndarray]:
    """The map from the reference cell of a mesh with one kind of cells; the nodes of each cell."""
    if hasattr(geometry, "cmaps"):
        return geometry.cmaps[0], geometry.dofmaps[0]
    return geometry.cmap, geometry.dofmap  # dolfinx 0.9, 0.10
