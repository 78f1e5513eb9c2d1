"""Reduced models that take coordinates until the estimate of their error is small enough."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from support import beam_scene, linear_model, refusal

from fenicsrom import study
from fenicsrom.arrays import Array
from fenicsrom.assess.curves import checks as curve_size
from fenicsrom.assess.curves import response as curves
from fenicsrom.assess.curves.checks import larger_model
from fenicsrom.assess.curves.response import response
from fenicsrom.assess.curves.trust import richer_model
from fenicsrom.assess.errors import estimates, sizing
from fenicsrom.assess.errors.estimates import MotionErrors, distances, nested_motion
from fenicsrom.assess.errors.sizing import (
    Sized,
    candidate_energies,
    limited,
    sized,
    spare_coordinates,
)
from fenicsrom.errors import ErrorKind
from fenicsrom.exchange.export import export
from fenicsrom.exchange.superelement import read_matrices
from fenicsrom.online.model.subspace import nested_model
from fenicsrom.online.motion.measures import is_unsteady
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.run.simulate import load_histories, simulate
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.progress import asking
from fenicsrom.scene import Scene

LOADS = [1.0, 0.02, 0.3, 1e-4, 0.01, 2e-3, 1e-5, 1e-5, 1e-5, 1e-5]


def stored_with(*overrides: str, **tables: Any) -> StoredModel:
    """A model of the first of ten uncoupled coordinates, with loads of several sizes."""
    scene = beam_scene(
        2,
        ("geometrically_nonlinear=false", "material.mass_damping=2.0", *overrides),
        contacts=None,
        probe={"group": "tip"},
        loads=[{"group": "tip", "direction": [0, 1], "force": 1.0, "frequency": 3.0}],
        time={"periods": 40, "steps_per_period": 40},
        **tables,
    )
    whole = linear_model(
        np.eye(10),
        np.diag(1000.0 * (1.0 + np.arange(10.0))),
        damping=2.0,
        loads=np.array(LOADS)[:, None],
        load_histories=load_histories(scene),
    )._replace(probe=np.array([[0.0] * 10, [1.0] * 10]))
    labels = tuple(f"{k + 1}V" for k in range(10))
    return StoredModel(
        nested_model(whole, [0]),
        scene,
        "rubin",
        labels[:1],
        99,
        np.array([5.0]),
        {},
        candidates=whole,
        further=labels[1:],
    )


def run(stored: StoredModel, near: tuple[Array, ...] | None = None) -> Motion:
    return simulate(stored.model, stored.scene, near=near, keep_coordinates=True)


def fit(stored: StoredModel) -> Sized:
    found = sized(stored, run(stored), run)
    assert found is not None
    return found


def test_model_takes_the_coordinates_with_the_largest_energies() -> None:
    stored = stored_with()
    found = fit(stored)
    assert found.stored.labels == ("1V", "3V", "2V", "5V")
    assert list(found.energies) == ["3V", "2V", "5V"] and not found.warning
    whole = run(stored.resized(10))
    assert distances(found.motion, whole).largest <= found.errors.largest <= 1e-3
    assert distances(run(stored), whole).largest > 0.01


def test_motion_that_judged_a_smaller_model_has_the_order_of_the_larger_one() -> None:
    found = fit(stored_with())
    assert found.other is not None and found.stored.labels == ("1V", "3V", "2V", "5V")
    assert found.stored.candidates is not None
    again = nested_motion(found.stored.candidates, found.stored.scene, found.motion)
    assert again is not None
    ours, new = (candidate_energies(found.stored, other) for other in (found.other, again))
    assert list(ours) == list(new) and ours == pytest.approx(new, rel=1e-3)


def test_energies_of_coordinates_are_those_of_the_larger_motion() -> None:
    stored = stored_with()
    other = run(stored.resized(10))
    assert other.coordinates is not None
    found = candidate_energies(stored, other)
    assert list(found)[:4] == ["3V", "2V", "5V", "6V"]
    q = other.coordinates
    wanted = np.sqrt(3.0 * np.mean(q[:, 2] ** 2) / np.mean(q[:, 0] ** 2))
    assert found["3V"] == pytest.approx(wanted, rel=1e-9)


def test_model_with_a_coarse_accuracy_stays_as_it_is() -> None:
    stored = stored_with("basis.accuracy=1.0")
    found = fit(stored)
    assert found.stored is stored and found.energies == {} and found.errors.largest > 0.01


def test_accuracy_of_a_joint_is_that_of_its_probe_and_of_its_friction() -> None:
    joint: Any = SimpleNamespace(joined=True)
    errors = MotionErrors(0.5, 9.0, (0.7,), probe=1e-3)
    assert limited(stored_with().scene, errors) == 0.5
    assert limited(joint, errors._replace(dissipation=0.015)) == 1e-3
    assert limited(joint, errors._replace(dissipation=0.03)) == 0.03
    assert (errors.deciding(False), errors.deciding(True)) == (0.7, 1e-3)


def test_model_that_cannot_reach_the_accuracy_says_so_and_keeps_judges() -> None:
    found = fit(stored_with("basis.accuracy=1e-9"))
    assert "basis.accuracy = 1e-09" in found.warning
    assert 0 < len(found.stored.further) < 9 and found.errors.largest > 1e-9


def test_model_that_grew_is_judged_on_finer_elements_by_the_coordinates_of_both() -> None:
    """The finer model has the coordinates of a smaller basis, some of which the run may lack."""
    stored = stored_with()
    grown = stored.resized(("1V", "3V", "2V"))
    small, other = stored.resized(("1V", "2V")), stored.resized(("2V", "4V"))
    finer = replace(grown, finer=small.model, finer_labels=("1V", "2V")).meshes
    assert finer is not None and finer[2] == [0, 2]
    motion = run(grown)
    near = nested_motion(finer[0], grown.scene, motion, finer[2])
    assert near is not None and distances(near, run(small)).largest < 1e-6
    lacking = replace(grown, finer=other.model, finer_labels=("2V", "4V")).meshes
    assert lacking is not None and lacking[2] == [2, -1]
    near = nested_motion(lacking[0], grown.scene, motion, lacking[2])
    assert near is not None and distances(near, run(other)).largest < 1e-6


def test_model_of_a_given_size_has_the_coordinates_with_the_largest_energies() -> None:
    whole = stored_with().resized(10)
    larger = fit(stored_with("basis.size=3"))
    assert larger.stored.labels == ("1V", "3V", "2V") and list(larger.energies) == ["3V", "2V"]
    smaller = fit(stored_with("basis.size=3").resized(6))
    assert smaller.stored.labels == ("1V", "3V", "2V") and smaller.energies == {}
    assert np.allclose(smaller.motion.displacement, larger.motion.displacement, rtol=1e-9)
    assert distances(smaller.motion, run(whole)).largest <= smaller.errors.largest
    unchanged = stored_with("basis.size=1")
    assert fit(unchanged).stored is unchanged


@pytest.mark.parametrize("size", [10, 11])
def test_model_of_all_coordinates_has_no_judge_and_is_refused(size: int) -> None:
    stored = stored_with(f"basis.size={size}")
    with refusal(ErrorKind.RANGE, "basis.size"):
        sized(stored, run(stored), run)


def test_size_that_a_model_does_not_have_is_refused_before_it_moves() -> None:
    with refusal(ErrorKind.RANGE, "basis.size"):
        stored_with().with_overrides("basis.size=10")
    alone = replace(stored_with(), candidates=None, further=())
    with refusal(ErrorKind.RANGE, "basis.size"):
        alone.with_overrides("basis.size=1")


def test_exported_model_has_the_size_that_its_scene_asks_for(tmp_path: Path) -> None:
    for stored, size in ((stored_with(), 1), (stored_with().with_overrides("basis.size=3"), 3)):
        export(stored, tmp_path / f"{size}.op4", "op4")
        assert read_matrices(tmp_path / f"{size}.op4").mass.shape == (size, size)


def test_motion_that_does_not_settle_is_judged_by_a_march_and_takes_all_at_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stored = stored_with("time.periods=4")
    motion, asked = run(stored), []

    def simulated(model: Any, scene: Scene, **options: Any) -> Motion:
        asked.append(scene.time.steady)
        return simulate(model, scene, **options)

    monkeypatch.setattr(estimates, "simulate", simulated)
    monkeypatch.setattr(sizing, "UNSETTLED_BASIS_ERROR", 1e-6)
    assert is_unsteady(motion) and stored.scene.time.steady == "newton"
    found = sized(stored, motion, run)
    assert found is not None and found.stored.size == 1 + int(0.7 * 9)
    assert asked == ["march"]


def test_direction_that_hardly_moves_takes_no_coordinates_and_is_told() -> None:
    """It misses its whole motion, which is 0.02 % of all."""
    stored = stored_with()
    probe = np.array([[0.0, 2e-2, *[0.0] * 8], [1.0, *[0.0] * 9]])
    whole = stored.resized(10).model._replace(probe=probe)
    found = fit(replace(stored, model=nested_model(whole, [0]), candidates=whole))
    assert found.stored.size == 1 and found.errors.amplitude <= 1e-3 and not found.warning
    assert found.errors.largest == found.errors.directions[0] > 1e-3


def test_motion_of_all_coordinates_is_found_once_and_starts_the_larger_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stored, searched = stored_with(), []

    def nearby(model: Any, scene: Scene, motion: Motion, *rest: Any, **more: Any) -> Motion | None:
        searched.append(model.size)
        return nested_motion(model, scene, motion, *rest, **more)

    monkeypatch.setattr(sizing, "nested_motion", nearby)
    found = fit(stored)
    assert found.stored.size == 4 and searched == [10, 4]
    alone = run(found.stored)
    assert found.motion.search is not None and alone.search is not None
    assert found.motion.search.iterations < alone.search.iterations
    assert found.motion.periods == alone.periods and distances(found.motion, alone).largest < 1e-9


@pytest.mark.slow
def test_curves_take_the_coordinates_that_their_worst_points_lack() -> None:
    sweep = {"parameter": "frequency", "first": 4.8, "last": 5.2, "points": 40}
    stored = stored_with(response=sweep)
    spare = spare_coordinates(stored)
    richer = richer_model(stored, spare)
    found = response(stored, richer=richer)
    worst = max(check.basis_error or 0.0 for curve in found.curves for check in curve.checks)
    assert worst > 1e-3
    larger = larger_model(found, stored, spare)
    assert larger is not None and larger.labels == ("1V", "3V", "2V", "5V")
    again = response(larger, richer=richer_model(larger, spare))
    assert larger_model(again, larger, spare) is None
    assert not any("basis.accuracy" in text for text in again.warnings)
    fixed = stored_with("basis.size=1", response=sweep)
    assert larger_model(found, fixed, 3) is None


def counted_runs(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Receives the number of coordinates of the curves, each time that they are followed."""
    sizes: list[int] = []
    follow = curves.response

    def counted(stored: StoredModel, **options: Any) -> Any:
        sizes.append(stored.size)
        return follow(stored, **options)

    monkeypatch.setattr(curves, "response", counted)
    return sizes


SWEEP = {"parameter": "frequency", "first": 4.8, "last": 5.2, "points": 40}


def test_curves_are_followed_once_with_the_size_that_a_few_motions_choose(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sizes = counted_runs(monkeypatch)
    found = study.response(stored_with(response=SWEEP))
    assert sizes == [4] == [found.size]
    assert not found.warnings and found.unfinished is None


def test_interrupted_repetition_with_more_coordinates_keeps_the_curves(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    sizes = counted_runs(monkeypatch)
    monkeypatch.setattr(curve_size, "model_before_curves", lambda *_: None)
    with asking(lambda: len(sizes) == 2):
        found = study.response(
            stored_with("output.pictures=false", response=SWEEP), folder=tmp_path, workers=1
        )
    assert sizes == [1, 4] and found.size == 1
    assert found.interrupted and found.curves[0].pieces[0].reason == "end of the range"
    assert any("4 was interrupted" in warning for warning in found.warnings)
    assert (tmp_path / "response.csv").exists()


def test_curve_of_a_model_that_cannot_grow_is_compared_at_all_points() -> None:
    sweep = {"parameter": "frequency", "first": 4.8, "last": 5.2, "points": 40}
    stored = stored_with(response=sweep)
    spare = [spare_coordinates(stored), len(stored.further)]
    grows, ends = (response(stored, richer=richer_model(stored, k)).curves[0] for k in spare)
    assert all(check.where not in ("between", "fold") for check in grows.checks)
    assert len(ends.checks) > 4 and any(check.where == "between" for check in ends.checks)
