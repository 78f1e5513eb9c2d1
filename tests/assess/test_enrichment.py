"""The estimate of the error due to the basis, against models whose residuals are known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support import beam_scene, linear_model, random_model

from fenicsrom.assess import enrichment, estimates, verdicts
from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.online.measures import amplitude
from fenicsrom.online.model import ReducedModel
from fenicsrom.online.motion import Motion
from fenicsrom.online.polynomial import elastic_force
from fenicsrom.online.simulate import load_histories, simulate
from fenicsrom.scene import Scene


def force(model: ReducedModel, q: Any) -> Any:
    found, tangent = np.empty(model.size), np.empty((model.size, model.size))
    elastic_force(model.elastic, np.ascontiguousarray(q), found, tangent)
    return found


def test_transformed_model_has_the_transformed_force() -> None:
    model = random_model(5)
    rng = np.random.default_rng(4)
    t, y = rng.standard_normal((5, 3)), rng.standard_normal(3)
    other = enrichment.transformed(model, t)
    np.testing.assert_allclose(force(other, y), t.T @ force(model, t @ y), rtol=1e-12)
    np.testing.assert_allclose(other.mass, t.T @ model.mass @ t)


def test_elastic_residual_is_the_force_on_the_candidates() -> None:
    model = random_model(5)
    x = np.random.default_rng(5).standard_normal((4, 5))
    expected = [force(model, row)[2:] for row in x]
    found = enrichment.elastic_residual(model, 2, x[:, :2], x[:, 2:])
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def two_modes(kind: str) -> tuple[ReducedModel, ReducedModel, Scene]:
    """A model of the first of two modes, and the model of both; the load excites both."""
    times: dict[str, dict[str, Any]] = {
        "periodic": {"periods": 60},
        "transient": {"periods": 6, "steady": "march"},
    }
    scene = beam_scene(
        2,
        ("material.mass_damping=2.0", "geometrically_nonlinear=false"),
        contacts=None,
        probe={"group": "tip"},
        time=times[kind],
    )
    options: dict[str, Any] = {"damping": 2.0, "load_histories": load_histories(scene)}
    both = linear_model(np.eye(2), np.diag([900.0, 500.0]), loads=[[1.0], [0.2]], **options)
    both = both._replace(probe=np.array([[0.0, 0.0], [1.0, 1.0]]))
    one = linear_model(np.eye(1), np.eye(1) * 900.0, loads=[[1.0]], **options)
    return one._replace(probe=np.array([[0.0], [1.0]])), both, scene


@pytest.mark.parametrize("kind", ["periodic", "transient"])
def test_missing_mode_is_the_estimated_error(kind: str) -> None:
    """The model of both modes is exact, so the estimate is `BASIS_SAFETY` times the error."""
    one, both, scene = two_modes(kind)
    motion, exact = simulate(one, scene, keep_coordinates=True), simulate(both, scene)
    error = estimates.distances(motion, exact).amplitude
    found = estimates.basis_errors(both, 1, scene, motion)
    assert error > 0.3
    assert found.amplitude == pytest.approx(estimates.BASIS_SAFETY * error, rel=1e-3)
    assert found.directions[1] == found.largest and found.directions[0] == 0.0


def test_error_of_a_small_direction_is_seen() -> None:
    """The second direction has 6 % of the motion and is wrong by a quarter."""
    motion = two_directions(0.06)
    errors = estimates.distances(motion, scaled(motion, [1.0, 1.25]))
    assert errors.amplitude < 0.02 and errors.largest == pytest.approx(0.2, rel=1e-6)
    motion = two_directions(1e-4)
    errors = estimates.distances(motion, scaled(motion, [1.0, 2.0]))
    assert errors.largest == pytest.approx(1e-4 / estimates.SMALL_DIRECTION, rel=1e-3)


def two_directions(part: float) -> Motion:
    """A motion along two axes, the second of them a part of the first."""
    one, _, scene = two_modes("periodic")
    model = one._replace(probe=np.array([[1.0], [part]]))
    return simulate(model, scene)


def scaled(motion: Motion, factors: list[float]) -> Motion:
    """The motion with other sizes of its directions."""
    return replace(motion, displacement=motion.displacement * np.array(factors))


def test_rule_refuses_an_estimate_above_its_limit() -> None:
    """Also of a transient; a motion that does not settle has a wider limit."""
    one, both, scene = two_modes("periodic")
    motion = simulate(one, scene, keep_coordinates=True)
    errors: dict[str, estimates.MotionErrors] = {}
    with pytest.raises(AccuracyError) as refusal:
        verdicts.estimate_errors(one, both, scene, motion, errors)
    assert refusal.value.kind is ErrorKind.BASIS and set(errors) == {"time step", "basis"}
    verdicts.estimate_errors(one, None, scene, motion, errors)
    between = 0.5 * (verdicts.BASIS_ERROR + verdicts.UNSETTLED_ERROR)
    verdicts.check_basis_error(scene, between, unsteady=True)
    with pytest.raises(AccuracyError):
        verdicts.check_basis_error(scene, between)


def test_directions_hold_the_response_of_the_candidates() -> None:
    """Of three candidates the load excites two, at 1 and 1e-9 of the energy: one is kept."""
    scene = two_modes("periodic")[2]
    options: dict[str, Any] = {"damping": 2.0, "load_histories": load_histories(scene)}
    loads = [[1.0], [0.0], [1.0], [1e-5]]
    model = linear_model(np.eye(4), np.diag([900.0, 2e3, 3e3, 4e3]), loads=loads, **options)
    one = linear_model(np.eye(1), np.eye(1) * 900.0, loads=[[1.0]], **options)
    motion = simulate(one, scene, keep_coordinates=True)
    found = enrichment.directions(model, 1, motion)
    np.testing.assert_allclose(np.abs(found), [[0.0], [1.0], [0.0]], atol=1e-4)
    assert amplitude(motion).size
