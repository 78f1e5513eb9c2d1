"""The residual of the full equations along a motion judges its basis."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from support import beam_scene

from fenicsrom import study
from fenicsrom.assess.errors import judge
from fenicsrom.assess.errors.comparisons import unseen
from fenicsrom.assess.errors.estimates import MotionErrors, basis_errors, distances
from fenicsrom.assess.errors.judge import Judged, judge_with_residual
from fenicsrom.assess.errors.sizing import Sized, candidate_motion, sized
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.reduction.basis import ReducedBasis, build_basis, project
from fenicsrom.reduction.beam import BeamStructure, beam_structure
from fenicsrom.reduction.candidates import extended_basis
from fenicsrom.reduction.stages import Reduction
from fenicsrom.scene import Scene

SLENDER = {"length": 1.0, "height": 0.01, "width": 0.01, "elements": 8, "load_at": 0.5}
STEP = {"table": [[0.0, 0.0], [1e-4, 1.0]]}
STOP = {"group": "tip", "gap": 3e-5, "normal_stiffness": 1e8, "tangential_stiffness": 1e7}
SHORT = {"duration": 1.5e-3, "step": 5e-6}


def axial(*overrides: str, **tables: Any) -> Scene:
    """A slender beam that is pushed along its axis and hits a stop; its lowest modes bend."""
    push = {"group": "tip", "at": "centre", "direction": [1.0, 0.0], "force": 1e3} | STEP
    stop = STOP | {"at": "centre", "normal": [1.0, 0.0], "friction": 0.2}
    reference = {"beam": True, "beam_section": SLENDER}
    given = {"loads": [push], "contacts": [stop], "time": SHORT, "reference": reference} | tables
    return beam_scene(2, ("geometrically_nonlinear=false", *overrides), **given)


class Reduced(NamedTuple):
    """A reduced model of a beam with its motion and its errors against the full model."""

    body: BeamStructure
    found: Reduction
    extended: ReducedBasis
    stored: StoredModel
    motion: Motion
    true: MotionErrors


def reduced(scene: Scene, bending: bool = False) -> Reduced:
    """Reduce and run a scene; with `bending` the only candidates are the next modes, which bend."""
    body = beam_structure(scene)
    found = Reduction(body, scene, lambda stage: nullcontext())
    basis, extended = found.basis, extended_basis(body, scene.basis, found)
    if bending:
        kept = [k for k, label in enumerate(extended.labels) if label[-1] == "V"]
        labels = [*basis.labels[basis.masters :], "4V", "5V", "6V"]
        vectors = [basis.vectors[:, basis.masters :], extended.vectors[:, kept[3:6]]]
        extended = build_basis(body, found.modes, np.concatenate(vectors, axis=1), labels)
    model, further = found.model, extended.labels[basis.size :]
    whole = project(body, extended, body.geometrically_nonlinear)
    stored = StoredModel(
        model, scene, "rubin", basis.labels, body.free, found.modes.frequencies_hz, {},
        candidates=whole, further=further,
    )  # fmt: skip
    motion = simulate(model, scene, keep_coordinates=True)
    true = distances(motion, simulate(body.full_model(), scene))
    return Reduced(body, found, extended, stored, motion, true)


def judged(case: Reduced, found: Sized | None = None) -> Judged:
    """Judge the basis of a case, or the one that it became."""
    stored, motion, other = case.stored, case.motion, found and found.other
    if found is None:
        other = candidate_motion(stored, motion)
    else:
        stored, motion = found.stored, found.motion
    assert other is not None
    given = case.body, case.found.modes, case.extended
    return judge_with_residual(*given, stored, motion, other)


def fit(case: Reduced) -> Sized:
    def run(larger: StoredModel, near: Any) -> Motion:
        return simulate(larger.model, larger.scene, near=near, keep_coordinates=True)

    found = sized(case.stored, case.motion, run)
    assert found is not None
    return found


PULSE = {"group": "load", "direction": [1.0, 0.0], "force": 2e3, "pulse": {"duration": 3e-4}}
WALL = STOP | {"normal": [1.0, 0.0], "at": "centre", "approach": [[0, 0], [5e-4, 8e-5], [1e-3, 0]]}
SINE = {"group": "tip", "direction": [1.0, 0.0], "force": 1e3, "frequency": 1000.0, "at": "centre"}
CHIRP = SINE | {"frequency": 500.0, "sweep": {"to": 2000.0, "duration": 1.5e-3}}
DAMPED = "material.mass_damping=1000"


@pytest.mark.parametrize(
    "scene",
    [
        axial(),
        axial(contacts=None, probe={"group": "tip"}, loads=[PULSE]),
        axial(contacts=[WALL | {"friction": 0.2}], loads=None),
        axial(loads=[CHIRP]),
        axial(DAMPED, loads=[SINE], time={"periods": 20, "steps_per_period": 100}),
    ],
    ids=["step", "pulse", "approaching wall", "chirp", "sine"],
)
@pytest.mark.slow
def test_error_of_axial_motion_is_seen_although_all_candidates_bend(scene: Scene) -> None:
    case = reduced(replace(scene, basis=replace(scene.basis, modes=3)), bending=True)
    assert case.true.amplitude > 0.005
    blind = basis_errors(case.motion, candidate_motion(case.stored, case.motion))
    assert blind.amplitude < 1e-3 * case.true.amplitude
    found = judged(case).errors
    pairs = [(found.amplitude, case.true.amplitude), (found.peak_force, case.true.peak_force)]
    for estimate, true in pairs if scene.contacts else pairs[:1]:
        assert 0.8 * true < estimate < 2.0 * true


def test_basis_of_axial_impact_takes_what_it_lacks() -> None:
    case = reduced(axial())
    fitted = fit(case)
    full = simulate(case.body.full_model(), case.stored.scene)
    true = distances(fitted.motion, full)
    assert case.true.amplitude > 0.1 and true.amplitude < 0.1 * case.true.amplitude
    stated = judged(case, fitted).errors.amplitude
    assert 0.8 * true.amplitude < stated < 3.0 * max(true.amplitude, 1e-3)
    assert not any(label.endswith("R") for label in (*fitted.stored.labels, *fitted.stored.further))


def test_residual_of_motion_of_all_unknowns_is_rounding() -> None:
    scene = axial()
    body = beam_structure(scene)
    found = Reduction(body, scene, lambda stage: nullcontext())
    free = np.eye(body.local)[:, np.abs(body.stiffness).sum(axis=0) > 0.0]
    basis = build_basis(body, found.modes, free, [f"{k}V" for k in range(free.shape[1])])
    motion = simulate(project(body, basis, False), scene, keep_coordinates=True)
    small = unseen(body, found.modes, basis, motion, scene)[1]
    few = simulate(found.model, scene, keep_coordinates=True)
    large = unseen(body, found.modes, found.basis, few, scene)[1]
    assert large.max() > 0.1 and small.max(initial=0.0) < 1e-6


def test_judge_of_sufficient_candidates_stays_as_it_is() -> None:
    slow = {"group": "load", "direction": [0.0, 1.0], "force": 1.0, "frequency": 2.0}
    scene = axial(DAMPED, contacts=None, probe={"group": "tip"}, loads=[slow],
                  time={"periods": 20, "steps_per_period": 50})  # fmt: skip
    case = reduced(scene)
    assert judged(case).stored.candidates is None


def test_responses_join_all_candidates_of_bodies_that_touch(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The friction answers to both together: a clamped plate lost 0.98 %, and each alone saw 0.1 %.

    With both, `tests/evidence/joints.py` says 1.4 %.
    """
    case = reduced(replace(axial(), basis=replace(axial().basis, modes=3)), bending=True)
    monkeypatch.setattr(judge, "ROUNDS", 0)
    for joint in (False, True):
        monkeypatch.setattr(Scene, "joined", joint)
        further = judged(case).stored.further
        assert any(label.endswith("R") for label in further)
        assert ({*case.stored.further} < {*further}) == joint


@pytest.mark.slow
@pytest.mark.parametrize("direction", [[1.0, 0.0], [0.6, 0.8]])
def test_run_of_nonlinear_impact_states_its_error(direction: list[float]) -> None:
    pytest.importorskip("dolfinx")
    size = {"length": 1.0, "height": 0.01, "elements_along": 6, "load_at": 0.5}
    geometry = {"mesh": "beam2d.geo", "dimension": 2, "thickness": 0.01, "parameters": size}
    push = {"group": "tip", "direction": direction, "force": 1e3} | STEP
    contacts = [STOP | {"normal": [1.0, 0.0], "friction": 0.2}]
    tables = {"geometry": geometry, "loads": [push], "contacts": contacts, "time": SHORT}
    found = study.run(beam_scene(2, ("basis.accuracy=1.0",), reference={"full": True}, **tables))
    true = distances(found.motions["reduced"], found.motions["full"])
    estimate = found.errors["basis"]
    assert true.amplitude > 0.01
    for stated, exact in zip(estimate[:2], true[:2], strict=True):
        assert 0.8 * exact < stated < 2.0 * exact
