"""The polynomial of the elastic force against the mesh, and the reduced model against the full
one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import (
    assert_same_motion,
    assert_tangent,
    enriched,
    isotropic_tensor,
    motions_of_all_unknowns,
    random_polynomial,
)

from fenicsrom.online.model.polynomial import (
    ElasticPolynomial,
    add_symmetric,
    elastic_force,
    elastic_polynomial,
    pairs,
    write_tangents,
)
from fenicsrom.reduction.basis import strain_products

Array = NDArray[np.float64]

METHODS = ["rubin", "craig-bampton"]
SOLIDS = ["beam2d", "beam3d", "bent2d", "bent3d"]


def evaluate(elastic: ElasticPolynomial, q: Array) -> tuple[Array, Array, float]:
    """Force, tangent and energy at q."""
    force, tangent = np.full(q.size, np.nan), np.full((q.size, q.size), np.nan)
    energy = elastic_force(elastic, q, force, tangent)
    return force, tangent, energy


def test_pair_numbering_lists_every_pair_once() -> None:
    first, second = pairs(3)
    assert list(zip(first, second, strict=True)) == [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]


@pytest.mark.parametrize("dimension", [2, 3])
def test_polynomial_energy_matches_strain_at_points(dimension: int) -> None:
    """Against the strain at each point: E = sym(G) + G^T G / 2 with the gradient G = G0 + sum q_i
    G_i."""
    rng = np.random.default_rng(0)
    points, n, lame, mu = 6, 3, 1.3, 0.7
    weights, gradients = (
        rng.uniform(0.5, 1, points),
        0.4 * rng.standard_normal((points, 1 + n, dimension, dimension)),
    )
    # in two chunks, as the mesh gives them
    chunks = [(weights[:2], gradients[:2]), (weights[2:], gradients[2:])]
    elastic = elastic_polynomial(
        strain_products(chunks, isotropic_tensor(lame, mu, dimension), n), n
    )

    def energy(q: Array) -> float:
        total = 0.0
        for weight, g in zip(weights, gradients, strict=True):
            h = g[0] + np.tensordot(q, g[1:], 1)
            strain = 0.5 * (h + h.T + h.T @ h)
            total += weight * (0.5 * lame * np.trace(strain) ** 2 + mu * np.sum(strain**2))
        return total

    q = rng.standard_normal(n)
    _, tangent, value = evaluate(elastic, q)
    assert value == pytest.approx(energy(q) - energy(np.zeros(n)), rel=1e-12)
    assert_tangent(energy, lambda q: evaluate(elastic, q)[0], q, step=0.1, tolerance=1e-10)
    assert_tangent(
        lambda q: evaluate(elastic, q)[0],
        lambda q: evaluate(elastic, q)[1],
        q,
        step=0.1,
        tolerance=1e-10,
    )
    np.testing.assert_array_equal(tangent, tangent.T)
    np.testing.assert_allclose(evaluate(elastic, np.zeros(n))[0], elastic.force, rtol=1e-14)


def test_compiled_polynomial_equals_plain_python() -> None:
    elastic, q = random_polynomial(4), np.random.default_rng(1).standard_normal(4)
    plain_force, plain_tangent = np.empty(4), np.empty((4, 4))
    plain = elastic_force.py_func(elastic, q, plain_force, plain_tangent)
    force, tangent, energy = evaluate(elastic, q)
    assert energy == pytest.approx(plain, rel=1e-13)
    np.testing.assert_allclose(force, plain_force, rtol=1e-13)
    np.testing.assert_allclose(tangent, plain_tangent, rtol=1e-13)


@pytest.mark.parametrize("count", [1, 2])
def test_weighted_tangents_of_several_points_are_sums_of_single_ones(count: int) -> None:
    elastic, rng = random_polynomial(4), np.random.default_rng(4)
    n, p = 4, elastic.cubic.shape[0]
    q, shares = rng.standard_normal((count, n)), rng.uniform(0.2, 1.0, (2, 2))
    found = np.full((2, n, n), np.nan)
    columns = np.ascontiguousarray(elastic.quadratic.T)
    write_tangents(elastic, columns, q, np.zeros((3, 2, p)), shares, *found)
    tangents = np.array([evaluate(elastic, point)[1] for point in q])
    expected = np.einsum("kg,gij->kij", shares[:, :count], tangents)
    np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13 * np.abs(expected).max())


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("n", [1, 4, 5])
def test_products_by_one_half_equal_those_by_all_coefficients(n: int, count: int) -> None:
    cubic, (first, second) = random_polynomial(n).cubic, pairs(n)
    q, start = np.random.default_rng(5).standard_normal((2, count, first.size))
    s, found, scratch = (
        np.where(first == second, 0.5, 1.0) * q,
        start.copy(),
        np.full_like(q, np.nan),
    )
    add_symmetric(n, s, scratch, cubic, found)
    np.testing.assert_allclose(found, start + s @ cubic, rtol=1e-12, atol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", SOLIDS)
def test_polynomial_matches_projected_force(
    name: str, method: str, request: pytest.FixtureRequest
) -> None:
    from fenicsrom.reduction.basis import project, project_intrusively

    solid = request.getfixturevalue(name)
    _, _, basis = enriched(solid, method, 1)
    exact, projected = project(solid, basis), project_intrusively(solid, basis)
    rng = np.random.default_rng(2)
    size = 0.1 * (2.54 if "beam" in name else 1.0) / np.abs(basis.vectors).max(axis=0)
    for _ in range(5):
        q = size * rng.standard_normal(basis.size)
        force, tangent, energy = evaluate(exact.elastic, q)
        nothing = np.zeros(basis.size), q, np.zeros(basis.size), 0.0, np.zeros(1), np.ones(1)
        other, _ = projected.elastic_over_step(*nothing)
        full = solid.equilibrium + basis.vectors @ q
        other_tangent = solid.inner(basis.vectors, solid.tangent_times(full, basis.vectors))
        # measured in the coordinates as they are scaled here
        assert np.abs(size * (force - other)).max() <= 1e-12 * np.abs(size * other).max()
        scale = np.outer(size, size)
        assert (
            np.abs(scale * (tangent - other_tangent)).max()
            <= 1e-12 * np.abs(scale * other_tangent).max()
        )
        assert energy == pytest.approx(
            solid.energy(full) - solid.energy(solid.equilibrium), rel=1e-12
        )
        assert projected.elastic_at(q)[1] == pytest.approx(energy, rel=1e-12)
    for found in (exact, projected):
        at_rest = found.contact_displacement(np.zeros(basis.size))
        np.testing.assert_allclose(at_rest, solid.contact_rows @ solid.equilibrium)


def test_terms_of_reduced_model_match_the_mesh(bent3d: Any) -> None:
    from fenicsrom.reduction.basis import project

    _, _, basis = enriched(bent3d, "rubin", 1)
    model, q = project(bent3d, basis), 1e-3 * np.random.default_rng(3).standard_normal(basis.size)
    u = bent3d.equilibrium + basis.vectors @ q
    np.testing.assert_allclose(model.contact_displacement(q), bent3d.contact_rows @ u, rtol=1e-9)
    np.testing.assert_allclose(model.probe_displacement(q), bent3d.probe_rows @ u, rtol=1e-9)
    np.testing.assert_allclose(
        model.mass, bent3d.mass_inner(basis.vectors, basis.vectors), rtol=1e-12
    )
    shake, push = bent3d.loads
    for time in (0.0, 0.01):
        full = bent3d.load_vectors @ [shake.size * np.sin(2 * np.pi * 30.0 * time), push.size]
        np.testing.assert_allclose(model.load(time), basis.vectors.T @ full, rtol=1e-10)
    # at rest in the equilibrium the static load is balanced
    force, _ = model.elastic_at(np.zeros(basis.size))
    np.testing.assert_allclose(force, model.load(0.0), rtol=0, atol=1e-8 * np.abs(force).max())
    assert model.size == basis.size and not model.linear and model.gauss_points == 2


@pytest.mark.parametrize("nonlinear", [pytest.param(True, marks=pytest.mark.slow), False])
def test_identity_basis_moves_as_full_model(nonlinear: bool) -> None:
    """R = I with the contact node first: the reduced model moves as the full model, with friction
    and lift-off."""
    load = {"group": "tip", "direction": [0.3, 1.0], "force": 4e4, "frequency": 40.0}
    push = {"group": "load", "direction": [0.0, 1.0], "force": 2e4}
    one, other = motions_of_all_unknowns([load, push], nonlinear)
    assert_same_motion(one, other, 2e-6)
