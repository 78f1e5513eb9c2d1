"""The model for a range of speeds: polynomials on subspaces, equilibria, models at one speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import root
from support import random_model, random_polynomial

from fenicsrom.online.model.polynomial import elastic_force
from fenicsrom.online.model.subspace import change_of_tangent, projected, shifted
from fenicsrom.online.step.speed_range import RangeErrors, RangeModel, _Space

Array = NDArray[np.float64]
N = 11


def force_of(elastic: object, q: Array) -> tuple[Array, Array]:
    """Force and tangent of a polynomial at q."""
    force, tangent = np.empty(q.size), np.empty((q.size, q.size))
    elastic_force(elastic, q, force, tangent)
    return force, tangent


def turning(speeds: tuple[float, ...] = (0.0, 0.5), masters: int = 2) -> RangeModel:
    """A random range model; the equilibria at its speeds are only a start."""
    rng = np.random.default_rng(8)
    lower, skew = rng.standard_normal((2, N, N))
    model = random_model(N, masters=masters)
    return RangeModel(
        model,
        rng.standard_normal(N),
        0.1 * lower @ lower.T,
        skew - skew.T,
        rng.standard_normal(N),
        np.ones(1),
        rng.standard_normal((1, 1 + N)),
        np.array(speeds),
        np.zeros((len(speeds), N)),
        modes=2,
        masters=masters,
        errors=RangeErrors(*np.zeros((4, 1))),
    )


@pytest.mark.slow
def test_shifted_and_projected_polynomials_are_exact() -> None:
    rng = np.random.default_rng(2)
    elastic, q0, z = random_polynomial(N), rng.standard_normal(N), rng.standard_normal((N, 4))
    part = projected(shifted(elastic, q0), z)
    for y in rng.standard_normal((3, 4)):
        (force, tangent), (wanted, all_of_it) = (force_of(part, y), force_of(elastic, q0 + z @ y))
        np.testing.assert_allclose(force, z.T @ wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
        inner = z.T @ all_of_it @ z
        np.testing.assert_allclose(tangent, inner, rtol=0, atol=1e-12 * np.abs(inner).max())


def test_change_of_tangent_matches_differences() -> None:
    rng = np.random.default_rng(3)
    elastic, q0, x = shifted(random_polynomial(N), np.ones(N)), *rng.standard_normal((2, N))
    del q0
    ends = [force_of(elastic, side * x)[1] for side in (1.0, -1.0)]
    wanted = 0.5 * (ends[0] - ends[1])  # exact: the tangent is quadratic
    found = change_of_tangent(elastic, x)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13 * np.abs(wanted).max())


@pytest.mark.parametrize("omega", [0.3, 0.5, 0.7])
def test_equilibrium_at_speed_balances_the_centrifugal_force(omega: float) -> None:
    """Against another solver of nonlinear equations."""
    whole = turning()
    q = whole.equilibrium(omega)

    def balance(x: Array) -> Array:
        force = force_of(whole.model.elastic, x)[0]
        return force - omega**2 * (whole.centrifugal + whole.softening @ x)

    found = root(balance, np.zeros(N), tol=1e-14)
    assert np.linalg.norm(q) > 1e-2
    np.testing.assert_allclose(q, found.x, rtol=1e-9)


@pytest.mark.parametrize("interface_modes", [False, True])
def test_model_at_one_speed_is_the_range_model_on_its_subspace(interface_modes: bool) -> None:
    whole, omega = turning(), 0.5
    at = whole.at(omega, interface_modes, nonlinear=True)
    q0 = whole.equilibrium(omega)
    _, z, labels, count = _Space(whole, shifted(whole.elastic(omega), q0), q0).basis(
        interface_modes
    )
    assert at.labels == labels[:count] and at.model.size == count < at.candidates.size
    rng = np.random.default_rng(5)
    for model, size in ((at.model, count), (at.candidates, len(labels))):
        y = rng.standard_normal(size)
        here = z[:, :size]
        force = force_of(whole.model.elastic, q0 + here @ y)[0]
        force = force - omega**2 * (whole.centrifugal + whole.softening @ (q0 + here @ y))
        found = model.elastic_at(y)[0]
        np.testing.assert_allclose(found, here.T @ force, rtol=0, atol=1e-11)
        np.testing.assert_allclose(
            model.contact_displacement(y), whole.model.contact_rows @ (q0 + here @ y), atol=1e-13
        )
        np.testing.assert_allclose(
            model.velocity_matrix, omega * here.T @ whole.coriolis @ here, atol=1e-12
        )
    mass, stiffness = at.model.mass, at.model.elastic.stiffness
    m = whole.masters
    np.testing.assert_allclose(mass[m:, m:], np.eye(count - m), atol=1e-12)
    squares = np.linalg.eigvals(np.linalg.solve(mass, stiffness)).real
    full = np.linalg.solve(whole.model.mass, whole.tangent(omega, q0))
    lowest = np.sort(np.linalg.eigvals(full).real)[:2]
    np.testing.assert_allclose(np.sort(squares)[:2], lowest, rtol=1e-10)
    np.testing.assert_allclose((2.0 * np.pi * at.frequencies_hz) ** 2, lowest, rtol=1e-10)


def test_model_at_one_speed_has_the_flexibility_of_its_masters() -> None:
    whole, omega = turning(), 0.5
    at = whole.at(omega, False, nonlinear=False)
    assert at.model.linear
    q0 = whole.equilibrium(omega)
    exact = np.linalg.inv(whole.tangent(omega, q0))[:2, :2]
    rows, stiffness = at.model.contact_rows[:2], at.model.elastic.stiffness
    np.testing.assert_allclose(rows @ np.linalg.solve(stiffness, rows.T), exact, rtol=1e-9)


def test_equilibrium_without_a_near_start_follows_the_speed_from_rest() -> None:
    """Wrong equilibria of the basis as a start: Newton's method fails from them, and the load steps
    give the same result."""
    whole = turning()
    lost = replace(whole, equilibria=np.full((2, N), np.nan))
    np.testing.assert_allclose(lost.equilibrium(0.5), whole.equilibrium(0.5), rtol=1e-9)
