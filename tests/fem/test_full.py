"""The full model: modified Newton takes the steps of Newton's method, with few factorisations."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")

from support import STOCKY, beam_scene, make_solid, rubbing_beam, scene_of

from fenicsrom import study
from fenicsrom.fem.base.linalg import Factorisation
from fenicsrom.fem.full import full as module
from fenicsrom.fem.full.full import full_model
from fenicsrom.online.model import kept_factor
from fenicsrom.online.run.simulate import simulate
from fenicsrom.post.run import report as sentences
from fenicsrom.study import motions

pytestmark = pytest.mark.slow


def moving(linear: bool, pressed: bool) -> Any:
    """A short beam whose tip touches a stiff wall, if it is pressed."""
    force = 4e4 if pressed else 4e3
    load = {"group": "tip", "direction": [0.3, 1.0], "force": force, "frequency": 40.0}
    return make_solid(rubbing_beam([load], not linear, periods=1, pressed=pressed))


def run(solid: Any, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, int]:
    """A motion of the full model, and the number of its factorisations."""
    count, update = 0, Factorisation.update

    def counted(self: Factorisation) -> None:
        nonlocal count
        count += 1
        update(self)

    scene = scene_of(solid)
    with monkeypatch.context() as patch:
        patch.setattr(Factorisation, "update", counted)
        motion = simulate(full_model(solid), scene)
    return motion, count


@pytest.mark.parametrize("pressed", [True, False])
def test_full_model_moves_as_by_newton_in_full(
    pressed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    solid = moving(False, pressed)
    motion, few = run(solid, monkeypatch)
    for name in ("MORE", "PATIENCE"):
        monkeypatch.setattr(kept_factor, name, -99)  # every iteration makes its own factor
    reference, many = run(solid, monkeypatch)
    assert motion.steps == reference.steps == 60
    scale = np.abs(reference.displacement).max()
    np.testing.assert_allclose(
        motion.displacement, reference.displacement, rtol=0, atol=1e-8 * scale
    )
    assert few < many / (2 if pressed else 3)


def test_linear_full_model_factorises_once_for_all_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    found = run(moving(True, False), monkeypatch)[1]
    assert found <= 2  # of the steps; the equilibrium may have one


def test_mean_state_of_two_tangents_has_their_weights() -> None:
    one, three = np.array([1.0]), np.array([3.0])
    wanted = module._Effective(1.0, 0.0, [(0.25, one, 2.0 * one), (0.75, three, -2.0 * one)])
    weight, state, factors = wanted.mean_state()
    assert weight == 1.0 and state[0] == 2.5 and factors[0] == -1.0
    assert wanted.has_coefficients_of(module._Effective(1.0 + 1e-13, 0.0, wanted.states))
    assert not wanted.has_coefficients_of(module._Effective(1.001, 0.0, wanted.states))


@pytest.mark.parametrize("touching", [True, False])
def test_full_model_moves_the_same_by_mumps_and_by_petsc(
    touching: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    stiffness = {"normal_stiffness": 1e7, "tangential_stiffness": 1e7}
    rubbing = {"nearest": [1.0, 0.0], "normal": [0.0, -1.0], "preload": 50.0, "friction": 0.4}
    found = []
    for small in (0, 10**6):  # from so many unknowns on MUMPS factorises, and PETSc below
        monkeypatch.setattr(Factorisation, "SMALL", small)
        solid = make_solid(
            beam_scene(
                2,
                (*STOCKY, "geometry.parameters.elements_along=2", "geometrically_nonlinear=true"),
                contacts=[rubbing | stiffness] if touching else None,
                loads=[{"group": "tip", "direction": [0, 1], "force": 4e4, "frequency": 40.0}],
                probe=None if touching else {"group": "tip"},
                time={"periods": 1, "steps_per_period": 40, "steady_tolerance": 0},
            )
        )
        scene = scene_of(solid)
        motion = simulate(full_model(solid), scene)
        assert solid.points.contact.size == int(touching)
        found.append(motion.displacement)
    np.testing.assert_allclose(found[0], found[1], rtol=0, atol=1e-9 * np.abs(found[1]).max())


def test_slow_reduced_model_is_timed_against_the_full_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scene = beam_scene(
        2,
        (*STOCKY, "geometrically_nonlinear=true", "output.pictures=false"),
        loads=[{"group": "tip", "direction": [0, 1], "force": 4.0, "frequency": 40.0}],
        time={"periods": 2, "steps_per_period": 40},
    )
    timed: list[tuple[float, float]] = []

    def say(reduced: float, full: float) -> str:
        timed.append((reduced, full))
        return "slow"

    monkeypatch.setattr(sentences, "step_sentence", say)
    assert "slow" not in study.run(scene).warnings and timed == []
    monkeypatch.setattr(motions, "LONG", 0.0)
    assert "slow" in study.run(scene).warnings and np.all(np.array(timed) > 0.0)
