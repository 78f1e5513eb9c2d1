"""Checks of a dolfinx mesh and of its tags, which a user has made."""

from collections.abc import Iterable
from typing import Any

import dolfinx.mesh
import numpy as np
import ufl
from dolfinx import fem
from mpi4py import MPI

from fenicsrom.errors import ErrorKind, refuse
from fenicsrom.fem.base.forms import compiled_form
from fenicsrom.scene.base.rules import Where

VOLUME_TOLERANCE = 1e-6
"""Largest relative difference of the two volumes of a mesh whose cells do not overlap.

A cell that is inside out adds twice its volume. The tolerance allows for the quadrature of curved
cells; a mesh of more than a million cells may hide one small cell that is inside out.
"""

QUADRATURE_DEGREE = 6
"""Exact for the volumes of straight cells."""


def check_dolfinx_mesh(domain: dolfinx.mesh.Mesh, source: str) -> None:
    """Check that a body can be made of a mesh. Collective.

    The divergence theorem gives the volume of the body by its boundary,

        V = 1/d ∮ x · n ds,

    which equals the sum of the volumes of the cells only if no cell is inside out.

    Raises:
        SceneError: on every rank, if the mesh is not plane or solid, its coordinates are not finite
            numbers of float64, or its cells overlap.
    """
    d, gdim, x = domain.topology.dim, domain.geometry.dim, domain.geometry.x
    if d not in (2, 3) or d != gdim:
        reason = f"cells of dimension {d} in {gdim} dimensions: must be 2 in 2D or 3 in 3D"
        raise refuse(source, reason, ErrorKind.MESH)
    if x.dtype != np.float64:
        raise refuse(source, f"coordinates of {x.dtype}: must be float64", ErrorKind.MESH)
    if not domain.comm.allreduce(bool(np.all(np.isfinite(x))), MPI.LAND):
        raise refuse(source, "a node has coordinates that are not finite", ErrorKind.MESH)
    metadata = {"quadrature_degree": QUADRATURE_DEGREE}
    dx, ds = ufl.dx(domain, metadata=metadata), ufl.ds(domain, metadata=metadata)
    place, normal = ufl.SpatialCoordinate(domain), ufl.FacetNormal(domain)
    inside, around = (
        domain.comm.allreduce(float(fem.assemble_scalar(compiled_form(form))))
        for form in (fem.Constant(domain, 1.0) * dx, ufl.dot(place, normal) / d * ds)
    )
    if not abs(inside - around) <= VOLUME_TOLERANCE * inside:
        reason = f"cells overlap or are inside out: their volumes add up to {inside:.6g}, and the "
        raise refuse(source, f"{reason}boundary encloses {around:.6g}", ErrorKind.MESH)


def check_tags(
    domain: dolfinx.mesh.Mesh, tags: Any, dimension: int, name: str, source: str
) -> None:
    """Check that tags belong to the entities of this dimension of a mesh. Collective.

    Raises:
        SceneError: on every rank, if they do not.
    """
    kind = "facets" if dimension < domain.topology.dim else "cells"
    reason = ""
    if not isinstance(tags, dolfinx.mesh.MeshTags):
        reason = f"must be the tags of the {kind}, not {type(tags).__name__}"
    elif tags.dim != dimension:
        reason = f"tags of dimension {tags.dim}: the {kind} have dimension {dimension}"
    else:
        entities = domain.topology.index_map(dimension)
        number = entities.size_local + entities.num_ghosts
        if tags.indices.size and tags.indices.max() >= number:
            reason = f"tags of another mesh: this mesh has {number} {kind}"
    reasons = sorted(filter(None, domain.comm.allgather(reason)))
    if reasons:
        raise refuse(source, reasons[0], ErrorKind.MESH, name)


def group_tags(name: str, tags: Any, present: set[int], source: str) -> tuple[int, ...]:
    """Give the tags of a group, which must be tags of facets.

    Args:
        name: name of the group.
        tags: an integer or some integers, also of numpy.
        present: the tags of the facets of all ranks.
        source: name of the mesh, for messages.

    Raises:
        SceneError: a tag is not an integer, or no facet has it.
    """
    wanted = np.atleast_1d(list(tags) if isinstance(tags, Iterable) else tags)
    key = f"groups.{name}"
    if wanted.dtype.kind not in "iu" or not wanted.size:
        allowed = "must be an integer tag or a list of them"
        raise Where(source, key).refuse(tags, allowed, ErrorKind.TYPE)
    found = tuple(map(int, wanted))
    missing = sorted({*found} - present)
    if missing:
        reason = f"no facet has the tag {missing[0]}; the facets have the tags {sorted(present)}"
        raise refuse(source, reason, ErrorKind.PLACE, key)
    return found
