"""Runs that are interrupted in their checks keep the motion, and repeat only the checks."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from support import STOCKY, beam_scene, uncoupled

from fenicsrom import study
from fenicsrom.assess.errors import sizing, verdicts
from fenicsrom.cli import main
from fenicsrom.online.motion.motion import Motion
from fenicsrom.online.periodic import steady
from fenicsrom.online.run import simulate
from fenicsrom.online.step.state import Checkpoint
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.store.store import load_start
from fenicsrom.post.run.report import HALF_CHECKED, UNCHECKED

SCENE = Path(__file__).parents[2] / "demos" / "slip_liftoff_2d.toml"
SHORT = ("geometrically_nonlinear=false", "output.pictures=false")
SPANS = {
    "period": ("time.periods=3", "time.steady='march'", "time.steps_per_period=40"),
    "duration": (
        "time={duration=0.3, step=0.002}",
        "loads.0={group='tip', direction=[0, 1], force=1, pulse={duration=0.1}}",
    ),
}


def stored(*overrides: str) -> StoredModel:
    """A linear model of one coordinate."""
    scene = beam_scene(2, (*SHORT, *overrides), contacts=None, probe={"group": "tip"})
    return StoredModel(
        uncoupled(scene, 500.0), scene, "rubin", ("1V",), 9, np.array([3.6, 22.0]), {}
    )


def interrupt(*_: object) -> None:
    raise KeyboardInterrupt


def assert_same(motion: Motion, whole: Motion) -> None:
    """Every array and number of two motions is the same, bit for bit."""
    for entry in fields(Motion):
        if entry.name not in ("seconds", "end"):
            np.testing.assert_array_equal(getattr(motion, entry.name), getattr(whole, entry.name))
    assert motion.end is not None and whole.end is not None
    np.testing.assert_array_equal(motion.end.state.q, whole.end.state.q)


@pytest.mark.parametrize("span", ["period", "duration"])
def test_run_that_is_interrupted_in_its_checks_repeats_only_these(
    span: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, folder = stored(*SPANS[span]), tmp_path / "interrupted"
    whole = study.rerun(model, tmp_path / "whole")
    estimate = verdicts.estimate_errors
    monkeypatch.setattr(verdicts, "estimate_errors", interrupt)
    with pytest.raises(KeyboardInterrupt):
        study.rerun(model, folder)
    told = json.loads((folder / "summary.json").read_text())
    assert UNCHECKED in told["warnings"] and not told["estimated_error_percent"]
    assert (folder / "history.npz").read_bytes() == (tmp_path / "whole/history.npz").read_bytes()
    monkeypatch.setattr(verdicts, "estimate_errors", estimate)
    path = folder / "checkpoint.npz"
    found = study.rerun(model, tmp_path / "resumed", resume=path)
    assert_same(found.motion, whole.motion)
    assert isinstance(load_start(path, model.model, model.scene), Motion)
    assert found.errors == whole.errors and UNCHECKED not in found.warnings


def test_run_that_is_interrupted_in_the_search_for_its_motion_keeps_its_march(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = stored("time.steps_per_period=40")
    monkeypatch.setattr(steady, "attempt", interrupt)
    with pytest.raises(KeyboardInterrupt):
        study.rerun(model, tmp_path)
    kept = load_start(tmp_path / "checkpoint.npz", model.model, model.scene)
    assert isinstance(kept, Checkpoint) and kept.spans >= 1


def test_run_that_is_interrupted_in_its_pictures_keeps_its_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = stored(*SPANS["period"], "output.pictures=true")
    with monkeypatch.context() as patched:
        patched.setattr("fenicsrom.post.run.pictures.write_rerun_pictures", interrupt)
        with pytest.raises(KeyboardInterrupt):
            study.rerun(model, tmp_path)
    kept = load_start(tmp_path / "checkpoint.npz", model.model, model.scene)
    assert isinstance(kept, Motion)
    found = study.rerun(model, tmp_path, resume=tmp_path / "checkpoint.npz")
    assert_same(found.motion, kept)


def test_run_that_is_interrupted_between_its_checks_says_which_errors_are_known(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = stored(*SPANS["period"], "basis.derivatives='none'")
    monkeypatch.setattr(verdicts, "basis_errors", interrupt)
    with pytest.raises(KeyboardInterrupt):
        study.rerun(replace(model, candidates=model.model), tmp_path)
    told = json.loads((tmp_path / "summary.json").read_text())
    known = told["estimated_error_percent"]
    assert "time step" in known and "basis" not in known
    assert HALF_CHECKED in told["warnings"] and UNCHECKED not in told["warnings"]


@pytest.mark.slow
def test_command_says_how_an_unchecked_motion_is_checked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("dolfinx")
    monkeypatch.setattr(verdicts, "estimate_errors", interrupt)
    sets = ("basis.modes=1", "basis.derivatives='none'", "time.periods=2")
    sets += ("reference.full=false", "reference.beam=false", "geometry.parameters.elements_along=4")
    sets += ("output.pictures=false", "time.steady='march'")
    call = ["run", str(SCENE), *(word for value in sets for word in ("--set", value)), "--output"]
    assert main([*call, str(tmp_path)]) == 130
    said = capsys.readouterr().err
    again = f"--output {tmp_path} --resume {tmp_path / 'checkpoint.npz'}"
    assert "not checked" in said and again in said
    told = json.loads((tmp_path / "summary.json").read_text())
    assert UNCHECKED in told["warnings"] and (tmp_path / "history.npz").exists()
    monkeypatch.setattr(verdicts, "estimate_errors", lambda *_: None)
    monkeypatch.setattr(sizing, "candidate_motion", lambda *_: None)
    monkeypatch.setattr(simulate, "integrate", lambda *_, **__: pytest.fail("a motion is run"))
    resume = ["--resume", str(tmp_path / "checkpoint.npz")]
    with monkeypatch.context() as patched:  # then in the report
        patched.setattr("fenicsrom.post.run.report.write_run_report", interrupt)
        assert main([*call, str(tmp_path), *resume]) == 130
    said = capsys.readouterr().err
    assert "not checked" not in said and again in said
    assert main([*call, str(tmp_path), *resume]) == 0
    kept = json.loads((tmp_path / "summary.json").read_text())
    assert kept["response"] == told["response"] and UNCHECKED not in kept["warnings"]


def test_longer_run_continues_from_the_end_of_an_unchecked_motion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = stored(*SPANS["period"])
    monkeypatch.setattr(verdicts, "estimate_errors", interrupt)
    with pytest.raises(KeyboardInterrupt):
        study.rerun(model, tmp_path)
    longer = model.with_overrides("time.periods=5")
    begin = load_start(tmp_path / "checkpoint.npz", longer.model, longer.scene)
    motion = simulate.simulate(longer.model, longer.scene, resume=begin)
    whole = simulate.simulate(longer.model, longer.scene)
    np.testing.assert_array_equal(motion.displacement, whole.displacement[-motion.time.size :])
    assert motion.periods == 5


@pytest.mark.slow
def test_resumed_run_keeps_the_coordinates_that_joined_its_basis(tmp_path: Path) -> None:
    pytest.importorskip("dolfinx")
    scene = beam_scene(
        2,
        (
            *STOCKY,
            "basis.modes=1",
            "basis.accuracy=1e-4",
            "material.mass_damping=100.0",
            "time={periods=60, steps_per_period=40}",
            "loads.0.force=1e5",
            "loads.0.frequency=60.0",
            "output={pictures=false, paraview=false, stresses='none'}",
        ),
        contacts=None,
        probe={"group": "tip"},
    )
    first = study.run(scene, folder=tmp_path / "first")
    assert first.sized is not None and first.sized.energies
    path = tmp_path / "first" / "checkpoint.npz"
    again = study.run(scene, folder=tmp_path / "again", resume=path)
    assert again.basis is not None and again.basis.labels == first.basis.labels
