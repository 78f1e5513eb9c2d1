"""Projection of a structure on a basis: the reduced model.

The displacement is u = u₀ + R q. Every matrix of the structure is projected by Galerkin's method,
for example the mass Rᵀ M R; the elastic force is Rᵀ f(u₀ + R q).
"""

from typing import Any

import numpy as np

from fenicsrom.arrays import Array
from fenicsrom.online.model.dense_model import DenseModel
from fenicsrom.online.model.loads import static_factors
from fenicsrom.online.model.model import ReducedModel, reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial
from fenicsrom.online.model.pressure import PressurePolynomial
from fenicsrom.online.model.unique_cubic import paired_cubic, unique_cubic
from fenicsrom.reduction.basis import ReducedBasis
from fenicsrom.reduction.protocols import Structure

COUPLING = 1e-3
"""A smaller relative change of the frequencies by the skew part of the tangent does not count."""


def project(structure: Structure, basis: ReducedBasis, nonlinear: bool = True) -> ReducedModel:
    """Project a structure on a basis, with the exact polynomials of its forces.

    Args:
        structure: the structure.
        basis: the basis.
        nonlinear: False gives the linear model of the tangent at the equilibrium, with its skew
            part by static follower pressures. Pressures that vary in time then have constant
            directions.

    Returns:
        The reduced model; its elastic force needs no mesh.

    Raises:
        SceneError: the internal force of the structure is not a polynomial.
    """
    r = basis.vectors
    pressure = None
    if nonlinear:
        elastic = structure.elastic_polynomial(r)
        n = r.shape[1]  # exactly symmetric, as the file of the model stores it
        elastic = elastic._replace(cubic=paired_cubic(unique_cubic(elastic.cubic, n), n))
        pressure = structure.pressure_polynomial(r)
    else:
        force = structure.inner(r, structure.rest_force[:, None])[:, 0]
        stiffness, none = structure.inner(r, structure.stiffness_times(r)), np.zeros((0, 0))
        elastic = ElasticPolynomial(force, stiffness, none, none)
        pressure = None if structure.symmetric else _skew_pressure(structure, r, elastic.stiffness)
    return reduced_model(elastic=elastic, pressure=pressure, **projected_terms(structure, r))


def _skew_pressure(structure: Structure, r: Array, stiffness: Array) -> PressurePolynomial | None:
    """The skew parts of the tangents of the static follower pressures on vectors R (local, n).

    Args:
        structure: the structure.
        r: the vectors R.
        stiffness: (n, n) symmetric part of the stiffness, N/m.

    Returns:
        Linear forces; None if they change no frequency by more than `COUPLING`.
    """
    found = structure.pressure_polynomial(r)
    sizes = static_factors(structure.load_histories)[found.numbers]
    skew = 0.5 * (found.linear - found.linear.transpose(0, 2, 1))
    skew[sizes == 0.0] = 0.0
    mass = structure.inner(r, structure.mass_times(r))
    both = np.linalg.solve(mass, stiffness), np.linalg.solve(mass, np.tensordot(sizes, skew, 1))
    plain, coupled = (
        np.sort_complex(np.sqrt(np.linalg.eigvals(matrix).astype(complex)))
        for matrix in (both[0], both[0] - both[1])
    )
    if np.all(np.abs(coupled - plain) <= COUPLING * np.abs(plain)):
        return None
    return PressurePolynomial(found.numbers, skew, np.zeros((len(skew), 0, *skew.shape[1:])))


def project_intrusively(structure: Structure, basis: ReducedBasis) -> DenseModel:
    """Project a structure on a basis, with the full internal force evaluated at every call.

    Mashayekhi and Zucca (2024) evaluate the elastic force in this way. The result equals that of
    `project` to round-off, and is much slower.
    """
    r, u0 = basis.vectors, structure.equilibrium
    rest = structure.energy(u0)

    def elastic(q: Array) -> tuple[Array, Array]:
        u = u0 + r @ q
        force = structure.inner(r, structure.internal_force(u))
        return force, structure.inner(r, structure.tangent_times(u, r))

    def energy(q: Array) -> float:
        return float(structure.energy(u0 + r @ q) - rest)

    return DenseModel(
        elastic=elastic,
        energy=energy,
        linear=False,
        gauss_points=structure.gauss_points,
        **projected_terms(structure, r),
    )


def projected_gyroscopic(structure: Structure, r: Array) -> Array:
    """Project the gyroscopic matrix on vectors R (local, n).

    Returns:
        Rᵀ G R (n, n), skew, N s/m; (0, 0) where no Coriolis force acts.
    """
    if structure.gyroscopic is None:
        return np.zeros((0, 0))
    return np.asarray(structure.inner(r, structure.gyroscopic_times(r)))


def projected_velocity_matrix(structure: Structure, r: Array) -> Array:
    """Project the gyroscopic matrix and the viscous damping on vectors R (local, n).

    Returns:
        Rᵀ D R (n, n), N s/m; (0, 0) without such forces.
    """
    found = projected_gyroscopic(structure, r)
    if not structure.viscous.acts:
        return found
    viscous = np.asarray(structure.inner(r, structure.viscous.times(r)))
    viscous = 0.5 * (viscous + viscous.T)
    return found + viscous if found.size else viscous


def projected_terms(structure: Structure, r: Array) -> dict[str, Any]:
    """All arguments of a reduced model except its elastic force, by their names."""
    u0, total = structure.equilibrium, structure.comm.allreduce
    return {
        "mass": structure.inner(r, structure.mass_times(r)),
        "damping": structure.mass_damping,
        "loads": structure.inner(r, structure.load_vectors),
        "load_histories": structure.load_histories,
        "points": structure.points,
        "contact_rows": total(structure.contact_rows @ r),
        "contact_offset": total(structure.contact_rows @ u0),
        "probe": total(structure.probe_rows @ r),
        "probe_offset": total(structure.probe_rows @ u0),
        "velocity_matrix": projected_velocity_matrix(structure, r),
    }
