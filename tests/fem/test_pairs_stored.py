"""Stored models of bodies that touch under other contacts and bolts, against new models."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("dolfinx")
from mpi4py import MPI

import fenicsrom as fr
from fenicsrom.assess.studies.sweep_runs import _measured
from fenicsrom.errors import ErrorKind
from fenicsrom.notes import DISSIPATION, PEAK_FORCE
from fenicsrom.online.contact.points import contacts_of, trial_forces
from fenicsrom.online.contact.together import all_closed
from fenicsrom.online.model.bolts import no_bolts
from fenicsrom.online.step.statics import together
from fenicsrom.online.store.scene_changes import Trained, changed_scene
from fenicsrom.reduction.training import beyond
from fenicsrom.scene.keys.unit_system import Units
from tests.fem.test_pairs import COARSE, forces, lap, solid
from tests.support import refusal

pytestmark = pytest.mark.slow

BOLTS = {"bolts.0.force": 2000.0, "bolts.1.force": 3000.0}
BASIS = {"modes": 2, "masters": "all", "derivatives": "none"}
TRAINED = Trained((60.0,), (0.3,), amplitude=1.0, duration=1.0, dissipation=1.0)


@pytest.fixture(scope="module", params=[False, True], ids=["linear", "nonlinear"])
def stored(request: pytest.FixtureRequest) -> fr.StoredModel:
    """The model of a lap joint."""
    scene = lap(geometrically_nonlinear=request.param, geometry=COARSE, basis=BASIS)
    return fr.build_model(scene, comm=MPI.COMM_SELF)


@pytest.mark.parametrize(
    ("changes", "accuracy"),
    [
        (BOLTS, 1e-3),
        ({"contacts.0.normal_stiffness": 4e13}, 1e-3),
        ({"contacts.0.gap": -2e-6}, 1e-6),
        ({"contacts.0.preload": 2e6, "contacts.0.friction": 0.1}, 1e-6),
        ({"contacts.0.tangential_stiffness": 1e12}, 1e-6),
    ],
    ids=["bolts", "stiffness", "gap", "preload", "tangential"],
)
def test_changed_joint_has_the_equilibrium_and_the_frequencies_of_a_new_one(
    stored: fr.StoredModel, changes: dict[str, Any], accuracy: float
) -> None:
    body = solid(changed_scene(stored.scene, changes))
    found = stored.with_overrides(changes)
    contacts = contacts_of(found.scene, found.model.points)
    pressed = trial_forces(contacts, found.model.contact_offset).clip(0.0)
    assert np.abs(pressed - forces(body)).sum() < accuracy * forces(body).sum()
    moved = found.model.probe_offset - body.probe_rows @ body.equilibrium
    assert np.linalg.norm(moved) < accuracy * np.linalg.norm(body.probe_rows @ body.equilibrium)
    squares = body.eigenmodes(body.factor, 2)[0]
    assert found.frequencies_hz == pytest.approx(np.sqrt(squares) / (2.0 * np.pi), rel=accuracy)
    body.destroy()


def test_changed_joint_moves_as_a_new_one() -> None:
    time = {"periods": 1, "steps_per_period": 100, "steady": "march"}
    made = lap(geometrically_nonlinear=False, geometry=COARSE, basis=BASIS, time=time)
    before, new = (
        fr.build_model(scene, comm=MPI.COMM_SELF) for scene in (made, changed_scene(made, BOLTS))
    )
    old, found, wanted = (one.simulate() for one in (before, before.with_overrides(BOLTS), new))
    np.testing.assert_allclose(found.probe, wanted.probe, rtol=0.0, atol=1e-3 * np.ptp(old.probe))
    spent = wanted.friction_dissipation[-1]
    assert found.friction_dissipation[-1] == pytest.approx(spent, rel=5e-3)
    assert abs(old.friction_dissipation[-1] - spent) > 0.1 * spent
    row = _measured(replace(before, trained=TRAINED).with_overrides(BOLTS))
    assert "bolts.1.force is 3000.0, and was 4000.0" in row["sentence"]  # of a sweep


def test_changed_joint_has_no_estimate_of_the_friction_of_other_vectors(
    stored: fr.StoredModel,
) -> None:
    found = replace(stored, trained=TRAINED).with_overrides(BOLTS)
    (note,) = beyond(found.trained, found.scene, 0.0)
    assert "bolts.1.force is 3000.0, and was 4000.0" in str(note)
    fitted = replace(stored, trained=TRAINED).with_overrides({"contacts.0.gap": -2e-6})
    (note,) = beyond(fitted.trained, fitted.scene, 0.0)
    assert "contacts.0.gap is -2e-06, and was not given" in str(note)
    (note,) = beyond(fitted.trained, replace(fitted.scene, units=Units(length="mm")), 0.0)
    assert "contacts.0.gap is -0.002, and was not given" in str(note)
    softer = replace(stored, trained=TRAINED).with_overrides({"contacts.0.normal_stiffness": 2e12})
    force, friction = beyond(softer.trained, softer.scene, 0.0)
    assert (force.quantity, friction.quantity) == (PEAK_FORCE, DISSIPATION)
    back = found.with_overrides(dict.fromkeys(BOLTS, 4000.0))
    assert not beyond(back.trained, back.scene, 0.0)
    moved = back.model.contact_offset - stored.model.contact_offset
    assert np.abs(moved).max() < 1e-6 * np.abs(stored.model.contact_offset).max()


def test_joint_whose_bolts_push_has_no_equilibrium(stored: fr.StoredModel) -> None:
    model, scene = stored.model, stored.scene
    pulls = np.array([-1.01 * bolt.force for bolt in scene.bolts])
    elastic = model.bolts.pulled(model.elastic, pulls, scene.geometrically_nonlinear)
    contacts, paired = contacts_of(scene, model.points), np.full(model.points.contact.size, True)
    start = all_closed(contacts, paired), np.zeros(model.size)
    with pytest.raises(fr.ConvergenceError, match="press the body on"):
        together(model._replace(elastic=elastic), contacts, *start)


def test_joint_that_needs_its_mesh_is_refused(stored: fr.StoredModel) -> None:
    whole = stored.candidates
    assert whole is not None
    earlier = replace(stored, candidates=whole._replace(bolts=no_bolts(2, 1 + whole.size)))
    assert earlier.with_overrides({"contacts.0.normal_stiffness": 4e13}).frequencies_hz.all()
    with refusal(ErrorKind.MISMATCH, "bolts"):
        earlier.with_overrides(BOLTS)
    with refusal(ErrorKind.MISMATCH, "contacts[0].reach"):
        stored.with_overrides({"contacts.0.reach": 1e-3})
    with refusal(ErrorKind.RANGE, "contacts[0].gap"):
        changed_scene(fr.read_scene("demos/slip_liftoff_2d.toml"), {"contacts.0.gap": -1e-6})
