"""The estimated errors of frequencies and deflections due to the mesh, against finer meshes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import beam_scene, touching

pytest.importorskip("dolfinx")

from mpi4py import MPI

from fenicsrom import study
from fenicsrom.assess.errors.comparisons import of_model
from fenicsrom.assess.errors.estimates import distances
from fenicsrom.assess.rotation.campbell import campbell
from fenicsrom.errors import AccuracyError
from fenicsrom.online.store.archive import load_model, save_model
from fenicsrom.post.run.report import run_sentences
from fenicsrom.scene import Scene
from fenicsrom.study.stored import rerun

pytestmark = pytest.mark.slow

COARSE = "geometry.parameters.elements_along=4"
FINE = "geometry.parameters.elements_along=16"
DEAD = {"group": "load", "direction": [0.0, 1.0], "force": 10.0}


def coarse_and_fine(*changes: str, **tables: Any) -> tuple[Scene, Scene]:
    """A beam in the plane on four elements, and on sixteen."""
    coarse, fine = (
        beam_scene(2, (cells, "geometry.parameters.load_at=0.5", *changes), contacts=[], **tables)
        for cells in (COARSE, FINE)
    )
    return coarse, fine


def assert_effective(estimates: Any, ours: Any, theirs: Any) -> None:
    """Compare estimates with the relative distances of results from those of the finer mesh."""
    true = np.abs(np.array(ours) - theirs) / np.abs(theirs)
    assert np.all(true > 1e-4)  # there is something to estimate
    assert np.all(np.array(estimates) >= true)
    assert np.all(np.array(estimates) <= 2.0 * true)


def test_frequencies_of_coarse_mesh_have_their_estimate() -> None:
    coarse, fine = (study.modes(scene) for scene in coarse_and_fine())
    assert coarse.mesh_check is not None
    found = coarse.mesh_check.frequencies
    assert_effective(found, coarse.modes.frequencies_hz, fine.modes.frequencies_hz)
    assert f"{100.0 * found[0]:.2g} %" in " ".join(run_sentences(coarse))
    assert not fine.mesh_check.warnings(fine.scene)
    assert any("the mesh is too coarse" in text for text in coarse.warnings)


def test_static_deflection_of_coarse_mesh_has_its_estimate() -> None:
    coarse, fine = (
        study.run(scene) for scene in coarse_and_fine(loads=[DEAD], probe={"group": "tip"})
    )
    assert coarse.mesh_check is not None and coarse.unfinished is None
    assert_effective(coarse.mesh_check.deflection, coarse.deflection[1], fine.deflection[1])


def test_path_of_coarse_mesh_has_the_estimate_of_its_deflection() -> None:
    table = {
        "loads": [DEAD],
        "probe": {"group": "tip"},
        "geometrically_nonlinear": True,
        "statics": {"points": 3},
    }
    coarse, fine = (study.statics(scene, MPI.COMM_SELF) for scene in coarse_and_fine(**table))
    assert coarse.files == []
    slopes = [path.points[1].probe[1] / path.points[1].load_factor for path in (coarse, fine)]
    assert_effective(coarse.mesh_check.deflection, *slopes)


def test_run_on_far_too_coarse_mesh_has_no_static_deflection() -> None:
    scene, _ = coarse_and_fine("geometry.degree=1", loads=[DEAD], probe={"group": "tip"})
    found = study.run(scene)
    assert found.unfinished is not None
    name, error = found.unfinished
    assert name == "static" and isinstance(error, AccuracyError)
    assert "the mesh is too coarse" in str(error) and "geometry.degree = 2" in str(error)


def test_campbell_diagram_of_coarse_mesh_has_estimates_of_its_frequencies() -> None:
    table = {
        "loads": [],
        "rotation": {"speed_rpm": 60.0, "point": [-0.1, 0.0]},
        "campbell": {"modes": 2, "speeds_rpm": [0.0, 60.0]},
        "probe": {"group": "tip"},
    }
    coarse, fine = (campbell(scene, MPI.COMM_SELF) for scene in coarse_and_fine(**table))
    assert_effective(
        coarse.mesh_check.frequencies, coarse.frequencies_hz[0], fine.frequencies_hz[0]
    )


def test_curves_have_the_estimates_of_the_frequencies_of_their_model() -> None:
    table = {"probe": {"group": "tip"}, "geometrically_nonlinear": False}
    coarse, fine = (study.build_model(scene) for scene in coarse_and_fine(**table))
    assert_effective(of_model(coarse).frequencies, coarse.frequencies_hz, fine.frequencies_hz)


def test_errors_of_modes_keep_the_numbers_of_the_structure() -> None:
    """The load excites the modes of one plane; the basis leaves those of the other plane out."""
    cells = "geometry.parameters.elements_along=4", "geometry.parameters.load_at=0.5"
    scene = beam_scene(3, (*cells, "basis.modes=4"), contacts=None, probe={"group": "tip"})
    stored, judged = study.build_model(scene), study.modes(scene).mesh_check
    assert judged is not None and stored.labels[:2] == ("1V", "3V")
    np.testing.assert_allclose(of_model(stored).frequencies, judged.frequencies, rtol=1e-6)
    assert judged.frequencies[2] > 5.0 * judged.frequencies[1]
    large = replace(stored, finer=None, unjudged="too large")
    assert of_model(large).missing == "too large" and large.meshes is None


STRIP = tuple(
    f"geometry.parameters.{size}"
    for size in ("length=0.3", "height=0.003", "elements_along=2", "load_at=0.5")
)


def turning_strip(*changes: str, **tables: Any) -> Scene:
    """A soft strip of two elements that turns slowly, for a model of all speeds up to 6000 rpm."""
    table: dict[str, Any] = {
        "rotation": {"speed_rpm": 300.0, "speeds_rpm": [0.0, 6000.0], "point": [-0.1, 0.0]},
        "loads": [{"group": "tip", "at": "centre", "direction": [0.0, 1.0], "force": 0.1}],
        "contacts": [],
        "probe": {"group": "tip", "at": "centre"},
        "time": {"steps_per_period": 60, "periods": 100},
        "output": {"pictures": False, "paraview": False},
    }
    table["loads"][0]["frequency"] = 20.0
    table["material"] = {"young": 2.1e11, "poisson": 0.3, "density": 7800.0, "mass_damping": 20.0}
    return beam_scene(2, (*STRIP, *changes), **table | tables)


RUB = touching(at="centre", normal=[1.0, 0.0], preload=1.0, friction=0.3, tangential_stiffness=50.0)


@pytest.mark.parametrize("contacts", [[], [RUB]])
def test_motion_of_range_model_has_the_mesh_error_of_a_model_of_its_speed(
    contacts: Any, tmp_path: Path
) -> None:
    scene = turning_strip(contacts=contacts)
    assert scene.rotation is not None
    alone = study.run(replace(scene, rotation=replace(scene.rotation, speeds_rpm=None)))
    fast = study.build_model(replace(scene, rotation=replace(scene.rotation, speed_rpm=6000.0)))
    save_model(tmp_path / "model.npz", fast)
    read = load_model(tmp_path / "model.npz")
    found = rerun(read.with_overrides("rotation.speed_rpm=300"), tmp_path)
    assert of_model(read).frequencies[0] > 1.5 * of_model(found.stored).frequencies[0]
    assert found.unfinished is not None and found.unfinished[1].key == "geometry"
    ours, theirs = found.errors["mesh"], alone.errors["mesh"]
    assert ours.amplitude == pytest.approx(theirs.amplitude, rel=1e-2)
    np.testing.assert_allclose(ours.directions, theirs.directions, rtol=1e-2, atol=1e-4)


def test_run_up_on_coarse_mesh_is_refused_with_its_true_error(tmp_path: Path) -> None:
    history = "rotation.coriolis=true", "rotation.history=[[0.0, 300.0], [0.1, 600.0]]"
    time = "time={duration=0.1, step=2e-4}"
    coarse, fine = (
        rerun(study.build_model(turning_strip(*history, time, *more)), tmp_path)
        for more in ((), ("geometry.parameters.elements_along=16",))
    )
    assert coarse.unfinished is not None and coarse.unfinished[1].key == "geometry"
    assert fine.unfinished is None
    true = distances(coarse.motion, fine.motion).amplitude
    assert true <= coarse.errors["mesh"].amplitude <= 2.0 * true
    assert fine.errors["mesh"].amplitude < 0.1 * true
