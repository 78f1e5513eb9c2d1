"""Projection of the solid on a basis: the reduced model."""

from __future__ import annotations

from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model import DenseModel, ReducedModel, reduced_model
from fenicsrom.online.polynomial import ElasticPolynomial, elastic_polynomial, strain_products
from fenicsrom.reduction.basis import ReducedBasis


def project(solid: Any, basis: ReducedBasis, nonlinear: bool = True) -> ReducedModel:
    """Project the solid on a basis, with the exact polynomial of its elastic force about the
    equilibrium.

    Args:
        solid: a `fenicsrom.fem.solid.Solid`.
        basis: the basis.
        nonlinear: False gives the linear model of the tangent at the equilibrium.
    """
    r, n = basis.vectors, basis.size
    if nonlinear:
        products = strain_products(solid.tabulate(r), solid.first_lame, solid.shear_modulus, n)
        elastic = elastic_polynomial(solid.comm.allreduce(products), n)
        if solid.rotation is not None:  # its potential is quadratic
            centrifugal = solid.inner(r, solid.rotation.force(solid.equilibrium)[:, None])[:, 0]
            softening = solid.rotation.square * solid.inner(r, solid.rotation.mass_times(r))
            elastic = elastic._replace(
                force=elastic.force - centrifugal, stiffness=elastic.stiffness - softening
            )
    else:
        force = solid.inner(r, solid.rest_force[:, None])[:, 0]
        elastic = ElasticPolynomial(
            force, solid.inner(r, solid.stiffness_times(r)), np.zeros((0, 0)), np.zeros((0, 0))
        )
    return reduced_model(elastic=elastic, **_projections(solid, r))


def project_intrusively(solid: Any, basis: ReducedBasis) -> DenseModel:
    """The same model with the full elastic force assembled on the mesh and projected at every
    evaluation (the paper's way).
    """
    r, u0 = basis.vectors, solid.equilibrium
    rest = solid.energy(u0)

    def elastic(q: Array) -> tuple[Array, Array]:
        u = u0 + r @ q
        return solid.inner(r, solid.internal_force(u)), solid.inner(r, solid.tangent_times(u, r))

    def energy(q: Array) -> float:
        return float(solid.energy(u0 + r @ q) - rest)

    parts = _projections(solid, r)
    return DenseModel(
        elastic=elastic,
        energy=energy,
        linear=False,
        gauss_points=solid.gauss_points,
        **parts,
    )


def projected_gyroscopic(solid: Any, r: Array) -> Array:
    """R^T G R (n, n) of vectors R (local, n), skew, N s/m; (0, 0) where the scene leaves the
    Coriolis force out.
    """
    if solid.gyroscopic is None:
        return np.zeros((0, 0))
    return np.asarray(solid.inner(r, solid.gyroscopic_times(r)))


def _projections(solid: Any, r: Array) -> dict[str, Any]:
    """Everything but the elastic force."""
    u0 = solid.equilibrium
    return {
        "mass": solid.inner(r, solid.mass_times(r)),
        "damping": solid.scene.material.mass_damping,
        "loads": solid.inner(r, solid.load_vectors),
        "load_histories": solid.load_histories,
        "points": solid.points,
        "contact_rows": solid.comm.allreduce(solid.contact_rows @ r),
        "contact_offset": solid.comm.allreduce(solid.contact_rows @ u0),
        "probe": solid.comm.allreduce(solid.probe_rows @ r),
        "probe_offset": solid.comm.allreduce(solid.probe_rows @ u0),
        "gyroscopic_matrix": projected_gyroscopic(solid, r),
    }
