"""Stored reduced models: the scenes that they accept, and files of other versions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigvalsh
from support import beam_scene, linear_model, refusal, uncoupled

from fenicsrom import study
from fenicsrom.errors import ErrorKind
from fenicsrom.online.motion.measures import amplitude
from fenicsrom.online.run.simulate import simulate
from fenicsrom.online.store.archive import StoredModel, load_model, save_model
from fenicsrom.online.stress.stress import Deformation
from fenicsrom.scene import Scene

SHORT = ("time.periods=40", "time.steps_per_period=40", "geometrically_nonlinear=false")


def scene_with(*overrides: str) -> Scene:
    return beam_scene(2, (*SHORT, *overrides), contacts=None, probe={"group": "tip"})


@pytest.fixture
def stored() -> StoredModel:
    """A linear model of two coordinates under the load and damping of the paper's beam."""
    scene = scene_with("loads.0.force=111.0", "material.mass_damping=5.0")
    model = uncoupled(scene, 500.0, 900.0)
    return StoredModel(model, scene, "rubin", ("1V", "2V"), 9, np.array([3.6, 4.8]), {})


def test_stored_model_runs_under_the_loads_of_another_scene(stored: StoredModel) -> None:
    whole = amplitude(stored.simulate())
    small = amplitude(stored.simulate(scene_with("loads.0.force=20.0")))
    np.testing.assert_allclose(small, whole * 20.0 / 111.0, rtol=1e-6)
    faster = stored.simulate(scene_with("loads.0.frequency=4.0"))
    assert faster.period == pytest.approx(0.25)


def test_stored_model_runs_under_the_damping_of_another_scene(stored: StoredModel) -> None:
    damped = scene_with("loads.0.force=111.0", "material.mass_damping=50.0")
    assert stored.with_scene(damped).model.damping == 50.0
    assert amplitude(stored.simulate(damped))[0] < 0.5 * amplitude(stored.simulate())[0]


def test_simulate_of_stored_model_takes_loads_and_damping_of_scene(stored: StoredModel) -> None:
    other = scene_with("loads.0.force=20.0", "material.mass_damping=50.0")
    motion, same = simulate(stored, other), stored.simulate(other)
    np.testing.assert_array_equal(motion.displacement, same.displacement)


@pytest.mark.parametrize(
    ("scene", "key"),
    [
        (scene_with("loads.0.force=20.0"), "loads"),
        (scene_with("loads.0.frequency=4.0"), "loads"),
        (scene_with("loads.0.force=111.0", "material.mass_damping=6.0"), "material.mass_damping"),
        (beam_scene(2, (*SHORT, "loads.0.force=111.0")), "contacts"),
    ],
)
def test_simulate_of_bare_model_refuses_another_scene(
    stored: StoredModel, scene: Scene, key: str
) -> None:
    with refusal(ErrorKind.MISMATCH, key=key):
        simulate(stored.model, scene)


def test_scene_and_overrides_give_the_same_motion(stored: StoredModel) -> None:
    changes = ["loads.0.force=20.0", "material.mass_damping=7.0", "time.tolerance=1e-3"]
    by_overrides = stored.with_overrides(changes)
    assert by_overrides.scene.time.steps_per_period is None
    motion = stored.simulate(by_overrides.scene)
    np.testing.assert_array_equal(motion.displacement, by_overrides.simulate().displacement)
    assert stored.scene.loads[0].size == 111.0  # the stored model stays as it was


def test_scene_with_another_probe_is_refused(stored: StoredModel) -> None:
    with refusal(ErrorKind.MISMATCH, key="probe"):
        stored.simulate(beam_scene(2, SHORT, contacts=None, probe={"group": "load"}))


def test_file_of_an_earlier_version_asks_to_run_the_scene_again(
    stored: StoredModel, tmp_path: Path
) -> None:
    path = tmp_path / "model.npz"
    save_model(path, stored)
    assert load_model(path).labels == ("1V", "2V")
    with np.load(path) as file:
        arrays = {name: file[name] for name in file.files}
    header = json.loads(str(arrays["header"])) | {"format": "fenicsrom reduced model 2"}
    np.savez(path, **arrays | {"header": np.array(json.dumps(header))})
    with refusal(ErrorKind.FORMAT, file=path.name):
        load_model(path)


KEPT = {
    "beam": (3.27525, 20.5782),  # a superelement
    "casing": (np.hypot(100.0, 50.0 * 1.8**0.5), np.hypot(410.0, 50.0 * 2.5**0.5)),  # at 3000 rpm
    "duffing": (0.5 / np.pi,),  # nonlinear
}


@pytest.mark.parametrize("name", KEPT)
def test_kept_model_of_version_0_2_is_read(name: str) -> None:
    """A new format needs a function that reads this one: users keep their models for years."""
    stored = load_model(Path(__file__).parent / "models" / f"{name}.npz")
    squares = eigvalsh(stored.model.elastic.stiffness, stored.model.mass)[: len(KEPT[name])]
    np.testing.assert_allclose(np.sqrt(squares) / (2.0 * np.pi), KEPT[name], rtol=1e-5)
    assert (stored.whole is not None, stored.model.linear) == (name == "casing", name != "duffing")


@pytest.fixture
def judged(stored: StoredModel) -> StoredModel:
    """The stored model beside a larger one of three coordinates."""
    larger = linear_model(
        np.eye(3),
        np.diag([500.0, 900.0, 2000.0]),
        damping=5.0,
        loads=[[1.0], [0.3], [0.2]],
        load_histories=stored.model.load_histories,
    )
    finer = stored.model._replace(mass=1.5 * stored.model.mass)
    judges = {"candidates": larger, "finer": finer}
    return replace(stored, **judges, further=("3V",), finer_labels=("1V", "2V"))


def test_model_and_its_further_coordinates_are_stored(judged: StoredModel, tmp_path: Path) -> None:
    path = tmp_path / "model.npz"
    save_model(path, judged)
    read = load_model(path)
    assert (read.size, read.labels, read.further) == (2, ("1V", "2V"), ("3V",))
    assert read.meshes is not None and read.meshes[0] is read.model
    np.testing.assert_array_equal(read.meshes[1].mass, 1.5 * judged.model.mass)
    np.testing.assert_array_equal(read.meshes[1].contact_offset, judged.model.contact_offset)
    larger = read.resized(("3V", "2V", "1V")).meshes
    assert larger is not None
    np.testing.assert_array_equal(larger[0].loads, judged.model.loads)
    for ours, kept in ((read.model, judged.model), (read.candidates, judged.candidates)):
        assert ours is not None and kept is not None
        for name in ("mass", "loads", "probe"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(kept, name))
        np.testing.assert_array_equal(ours.elastic.stiffness, kept.elastic.stiffness)


def test_stored_model_runs_at_any_size(judged: StoredModel, tmp_path: Path) -> None:
    """The coordinates are uncoupled but for the probe, so each adds its own motion."""
    save_model(tmp_path / "model.npz", judged.resized(("3V", "1V")))
    read = load_model(tmp_path / "model.npz")
    assert (read.labels, read.further) == (("3V", "1V"), ("2V",))
    assert np.diag(read.model.elastic.stiffness).tolist() == [2000.0, 500.0]
    whole = read.resized(("1V", "2V", "3V"))
    assert whole.candidates is None and whole.further == ()
    assert judged.candidates is not None
    np.testing.assert_array_equal(whole.model.loads, judged.candidates.loads)
    assert whole.resized(2).labels == judged.labels
    for wrong in (0, 4, ("1V", "1V"), ("9V",)):
        with pytest.raises(ValueError, match="1V 2V 3V"):
            whole.resized(wrong)


def test_candidates_run_under_another_scene(judged: StoredModel) -> None:
    other = judged.with_scene(scene_with("loads.0.force=20.0", "material.mass_damping=50.0"))
    assert other.candidates is not None and other.candidates.damping == 50.0
    assert other.candidates.load_histories is other.model.load_histories
    assert other.finer is not None and other.finer.damping == 50.0


CRUSHED = Deformation(0.8, np.array([0.25, 0.0]), 0.85, 1.1)


def test_deformation_of_the_equilibrium_is_stored_with_the_model(
    stored: StoredModel, tmp_path: Path
) -> None:
    path = tmp_path / "model.npz"
    save_model(path, replace(stored, deformation=CRUSHED))
    found = load_model(path).deformation
    assert found is not None
    assert found.position.tolist() == CRUSHED.position.tolist()
    assert vars(found) == vars(CRUSHED) | {"position": found.position}


def test_run_of_a_stored_model_warns_of_its_crushed_equilibrium(
    stored: StoredModel, tmp_path: Path
) -> None:
    short = stored.with_overrides(["time.periods=1", "output.pictures=false"])
    assert not [text for text in study.rerun(short, tmp_path).warnings if "strain" in text]
    found = study.rerun(replace(short, deformation=CRUSHED), tmp_path)
    assert len([text for text in found.warnings if "reaches 15 %" in text]) == 1
