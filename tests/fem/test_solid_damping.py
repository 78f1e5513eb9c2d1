"""Viscous damping of the solid: the full model has the damping of its reduced models."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import STOCKY, beam_scene, dense, enriched, free_unknowns, make_solid

from fenicsrom.fem.body.supports import node_pieces
from fenicsrom.fem.full.full import full_model
from fenicsrom.online.run.simulate import simulate
from fenicsrom.reduction.basis import project
from tests.boxes import stacked
from tests.fem.test_pairs import scene_of as pair_scene

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


def test_stiffness_damping_is_that_of_strains_and_no_stress_changes_it() -> None:
    """A static pull stiffens the beam by 11 %."""
    pull = {"group": "tip", "direction": [1.0, 0.0], "force": 1e6}
    shake = {
        "group": "load",
        "at": "centre",
        "direction": [0.0, 1.0],
        "force": 1.0,
        "frequency": 100.0,
    }
    free, held = (
        make_solid(beam_scene(2, (*STOCKY, *STEPS), damping={"stiffness": 2e-5}, loads=loads))
        for loads in ([shake], [shake, pull])
    )
    shape = free.eigenmodes(free.factor, 1)[1]
    stiffness, damping = (
        [float(s.inner(shape, times(s))[0, 0]) for s in (free, held)]
        for times in (lambda s: s.stiffness_times(shape), lambda s: s.viscous.times(shape))
    )
    assert stiffness[1] > 1.1 * stiffness[0]
    assert damping[1] == pytest.approx(damping[0], rel=1e-3)
    assert damping[0] == pytest.approx(2e-5 * stiffness[0], rel=1e-9)


def test_stiffness_damping_of_a_body_that_contact_alone_holds_takes_energy(tmp_path: Path) -> None:
    """A dead force that presses a block has a negative stiffness as the block turns."""
    scene = pair_scene(
        stacked(tmp_path / "two.vtu", 2, 4, 3),
        2,
        {"group": "1 low y", "against": "0 high y"},
        geometrically_nonlinear=True,
        supports=[{"group": "0 low y"}],
        loads=[{"group": "1 high y", "force": 1e8, "direction": [0.0, -1.0]}],
        damping={"stiffness": 1e-5},
        time={"duration": 1.0, "step": 0.1},
    )
    body = make_solid(scene)
    keep = free_unknowns(body)
    unit = np.zeros((body.local, keep.size))
    unit[keep, np.arange(keep.size)] = 1.0
    values = np.linalg.eigvalsh(body.viscous.times(unit)[keep])
    assert values.min() > -1e-12 * values.max()
    piece = node_pieces(body.mesh, body.space)[0]
    x = body.space.tabulate_dof_coordinates()[:, :2] + body.equilibrium.reshape(-1, 2)
    upper = piece == piece[np.argmax(x[:, 1])]
    turned = (upper[:, None] * (x @ [[0.0, 1.0], [-1.0, 0.0]])).reshape(-1, 1)
    assert turned.T @ body.stiffness_times(turned) < -1e5
    assert abs(turned.T @ body.viscous.times(turned)) < 1e-12 * values.max()
