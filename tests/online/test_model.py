"""Operations of the models with dense matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from support import NO_LOADS, first

from fenicsrom.online.model.matrices import DenseModel
from fenicsrom.online.model.model import reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial

Array = NDArray[np.float64]

MASS = np.array([[2.0, 0.3], [0.3, 1.0]])
STIFFNESS = np.array([[0.0, 5.0], [5.0, 0.0]])  # neither its first nor its last entry tells it
GYROSCOPIC = np.array([[0.0, 4.0], [-4.0, 0.0]])


def gyroscopic_model(kind: str) -> Any:
    """A linear model with gyroscopic forces, whose coordinates are its contact displacements."""
    loads, probe = np.zeros((2, 0)), np.eye(2)
    contact, end = first(2, 2), (probe, np.zeros(2), GYROSCOPIC)
    if kind == "reduced":
        elastic = ElasticPolynomial(np.zeros(2), STIFFNESS, np.zeros((0, 0)), np.zeros((0, 0)))
        return reduced_model(MASS, 0.0, elastic, loads, NO_LOADS, *contact, *end)
    return DenseModel(
        MASS,
        0.0,
        lambda q: (STIFFNESS @ q, STIFFNESS),
        lambda q: float(0.5 * q @ STIFFNESS @ q),
        loads,
        NO_LOADS,
        *contact,
        *end,
        linear=True,
        gauss_points=1,
    )


@pytest.mark.parametrize("kind", ["reduced", "dense"])
def test_linear_model_factorises_again_when_a_coefficient_changes(kind: str) -> None:
    """An adaptive step solves with and without gyroscopic forces in turn."""
    model = gyroscopic_model(kind)
    zero, residual = np.zeros(2), np.array([1.0, -2.0])
    for mass, gyroscopic, weight in [
        (3.0, 0.7, 1.0),
        (3.0, 0.0, 1.0),
        (3.0, 0.0, 0.5),
        (2.0, 0.0, 0.5),
        (2.0, 0.0, 0.5),
        (2.0, 0.7, 0.5),
    ]:
        _, tangent = model.elastic_over_step(zero, zero, zero, 0.0, np.ones(1), np.array([weight]))
        y, unit, compliance = model.solve_effective(
            mass, gyroscopic, tangent, residual, np.arange(2)
        )
        effective = mass * MASS + gyroscopic * GYROSCOPIC + weight * STIFFNESS
        np.testing.assert_allclose(y, np.linalg.solve(effective, -residual), rtol=1e-12)
        np.testing.assert_allclose(unit, np.linalg.inv(effective), rtol=1e-12)
        np.testing.assert_allclose(compliance.delassus, unit, rtol=1e-12)


@pytest.mark.parametrize("kind", ["reduced", "dense"])
def test_normal_flexibility_is_that_of_a_step_at_rest(kind: str) -> None:
    """The step that follows has its own factor."""
    model, zero, found = gyroscopic_model(kind), np.zeros(2), np.zeros(1)
    _, tangent = model.elastic_over_step(zero, zero, zero, 0.0, np.ones(1), np.ones(1))
    for h in (0.3, 0.9):
        before = model.solve_effective(3.0, 0.7, tangent, np.ones(2), np.arange(2))[0].copy()
        model.write_normal_flexibility(h, found)
        at_rest = np.linalg.inv(2.0 / h**2 * MASS + 0.5 * STIFFNESS)
        np.testing.assert_allclose(found, at_rest[0, 0], rtol=1e-12)
        after = model.solve_effective(3.0, 0.7, tangent, np.ones(2), np.arange(2))[0]
        np.testing.assert_array_equal(after, before)
