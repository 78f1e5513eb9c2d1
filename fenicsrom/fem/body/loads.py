"""Load vectors of point forces, tractions, pressures and accelerations."""

from __future__ import annotations

import dolfinx.mesh
import numpy as np
import ufl
from mpi4py import MPI

from fenicsrom.arrays import Array
from fenicsrom.errors import ErrorKind
from fenicsrom.fem.base.forms import compiled_form
from fenicsrom.fem.body.elasticity import ElasticBody
from fenicsrom.fem.body.places import Places
from fenicsrom.scene import Load
from fenicsrom.scene.base.rules import Where

LOAD_DEGREE = 6
"""Degree of the quadrature rule on loaded facets.

It is exact for tractions and pressures on quadratic cells with straight edges. It is also exact for
pressures on curved cells: the normal times the area of a curved quadratic quadrilateral is a cubic
in each direction.
"""


def load_vector(body: ElasticBody, places: Places, load: Load, key: str) -> Array:
    """Assemble the load vector of a load of size 1. Collective.

    On the undeformed body, a traction t does the work ∫ t · v dA, a pressure p the work
    −∫ p n · v dA, an acceleration a the work ∫ ρ a · v dV, and an acceleration of the supports the
    opposite work; in 2D each is multiplied by the thickness. The vector includes the clamped
    unknowns, except for a point force.

    Args:
        body: the body.
        places: its places.
        load: the load.
        key: key of the load in the scene, for messages.

    Returns:
        (local,) load vector.

    Raises:
        SceneError: as `Places.find`; or a pressure acts on facets inside the body.
    """
    if load.kind == "force":
        return np.array(load.direction) @ places.find(load.place, key)[0]
    test = ufl.TestFunction(body.space)
    if load.everywhere:
        direction = body.constant(load.direction)
        spread = body.assembled(compiled_form(body.density * ufl.dot(direction, test) * body.dx))
        spread += body.point_masses * np.tile(load.direction, body.local // body.dimension)
        return -spread if load.moves_supports else spread
    surface = body.mesh.surface(load.place).reconstruct(metadata={"quadrature_degree": LOAD_DEGREE})
    thickness = body.thickness
    if load.kind == "traction":
        direction = body.constant(load.direction)
        return body.assembled(compiled_form(thickness * ufl.dot(direction, test) * surface))
    check_on_boundary(body, load, key)
    normal = ufl.FacetNormal(body.mesh.domain)
    return body.assembled(compiled_form(-thickness * ufl.dot(normal, test) * surface))


def check_on_boundary(body: ElasticBody, load: Load, key: str) -> None:
    """Check that a pressure acts on the boundary. Collective.

    Raises:
        SceneError: a facet lies inside the body.
    """
    topology = body.mesh.domain.topology
    d = topology.dim
    topology.create_connectivity(d - 1, d)
    boundary = dolfinx.mesh.exterior_facet_indices(topology)
    facets = body.mesh.facets(load.place)
    owned = facets[facets < topology.index_map(d - 1).size_local]
    if body.comm.allreduce(bool(np.any(~np.isin(owned, boundary))), op=MPI.LOR):
        where = Where(body.source, f"{key}.pressure")
        allowed = "must act on the boundary, but some of these facets lie inside the body"
        raise where.refuse(load.size, allowed, ErrorKind.PLACE)
