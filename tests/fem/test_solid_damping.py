"""Viscous damping of the solid: the full model has the damping of its reduced models."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from support import STOCKY, beam_scene, dense, enriched, free_unknowns, make_solid

from fenicsrom.fem.full.full import full_model
from fenicsrom.online.run.simulate import simulate
from fenicsrom.reduction.basis import project

pytestmark = pytest.mark.slow

DAMPING = {"stiffness": 2e-5, "ratios": [0.03, 0.0, 0.02]}
LINEAR = ("geometrically_nonlinear=false", "time.steady='march'", "time.periods=3")
STEPS = ("time.steps_per_period=40", "loads.0.frequency=100.0", "material.mass_damping=0")


def test_velocity_matrix_of_full_model_is_that_of_its_definition() -> None:
    solid = make_solid(beam_scene(2, (*STOCKY, *LINEAR, *STEPS), damping=DAMPING))
    keep = free_unknowns(solid)
    mass, stiffness = dense(solid.mass, keep), dense(solid.stiffness, keep)
    squares, modes = np.linalg.eigh(
        np.linalg.solve(np.linalg.cholesky(mass), stiffness)
        @ np.linalg.inv(np.linalg.cholesky(mass)).T
    )
    shapes = np.linalg.solve(np.linalg.cholesky(mass).T, modes)
    expected = 2e-5 * stiffness
    for k, ratio in enumerate(DAMPING["ratios"]):  # type: ignore[arg-type]
        image = mass @ shapes[:, k]
        expected += 2.0 * ratio * np.sqrt(squares[k]) * np.outer(image, image)
    unit = np.zeros((solid.local, keep.size))
    unit[keep, np.arange(keep.size)] = 1.0
    found = np.array([full_model(solid).velocity_times(column) for column in unit.T])[:, keep]
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("overrides", [LINEAR, LINEAR[1:]], ids=["linear", "nonlinear"])
def test_full_model_moves_as_its_reduced_model_of_all_modes(overrides: Any) -> None:
    """Thirty modes of a stocky beam resolve its motion."""
    scene = beam_scene(2, (*STOCKY, *overrides, *STEPS, "contacts.0.preload=0"), damping=DAMPING)
    solid = make_solid(scene)
    basis = enriched(solid, modes=30, wanted=())[2]
    reduced = simulate(project(solid, basis), scene)
    full = simulate(full_model(solid), scene)
    assert reduced.relative_imbalance < 1e-10 and full.relative_imbalance < 1e-10
    assert full.damping_dissipation[-1] > 0.0
    size = np.abs(full.displacement).max()
    np.testing.assert_allclose(reduced.displacement, full.displacement, atol=1e-3 * size)


def test_damping_follows_the_equilibrium() -> None:
    """A static axial tension stiffens the beam, and its damping with it."""
    pull = {"group": "tip", "direction": [1.0, 0.0], "force": 5e7}
    shake = {
        "group": "load",
        "at": "centre",
        "direction": [0.0, 1.0],
        "force": 1.0,
        "frequency": 100.0,
    }
    free = make_solid(beam_scene(2, (*STOCKY, *STEPS), damping=DAMPING, loads=[shake]))
    held = make_solid(beam_scene(2, (*STOCKY, *STEPS), damping=DAMPING, loads=[shake, pull]))
    shape = free.eigenmodes(free.factor, 1)[1]
    one, other = (float(s.inner(shape, s.viscous.times(shape))[0, 0]) for s in (free, held))
    assert other > 1.01 * one
