"""Runs of a stored model: they warn of the same things as a run of the scene."""

from __future__ import annotations

import html
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import beam_scene, linear_model, refusal, uncoupled

from fenicsrom import study
from fenicsrom.errors import AccuracyError, ConvergenceError, ErrorKind
from fenicsrom.online.store.archive import StoredModel
from fenicsrom.online.store.scene_changes import changed_key
from fenicsrom.post.run.report import UNJUDGED

SHORT = tuple(
    """
    geometrically_nonlinear=false time.periods=2 time.steps_per_period=40 time.steady='march'
    output.pictures=false
""".split()
)


def stored(*overrides: str) -> StoredModel:
    """A linear model of one coordinate that does not become periodic within two periods."""
    scene = beam_scene(2, (*SHORT, *overrides), contacts=None, probe={"group": "tip"})
    model = uncoupled(scene, 500.0)
    return StoredModel(model, scene, "rubin", ("1V",), 9, np.array([3.6, 22.0]), {})


def warnings_of(model: StoredModel, folder: Path, given: tuple[str, ...] = ()) -> list[str]:
    """The warnings of a run, which its summary repeats."""
    found = study.rerun(model, folder, given=given)
    assert json.loads((folder / "summary.json").read_text())["warnings"] == found.warnings
    return found.warnings


def test_unsteady_run_of_stored_model_warns(tmp_path: Path) -> None:
    warning, other = warnings_of(stored(), tmp_path)
    assert "within 2 periods" in warning and other == UNJUDGED


def test_load_beyond_the_modes_of_a_stored_model_is_named(tmp_path: Path) -> None:
    """The modes at 3.6 and 22 Hz follow a load up to 14.7 Hz."""
    for frequency, warned in ((14.6, 0), (14.8, 1)):
        fast = stored().with_overrides(f"loads.0.frequency={frequency}")
        named = [text for text in warnings_of(fast, tmp_path) if "basis.modes" in text]
        assert len(named) == warned


def test_load_that_the_stored_step_misses_is_refused() -> None:
    fourth, fifth = (f"loads.0.harmonics=[[1, 1.0, 0.0], [{n}, 1.0, 0.0]]" for n in (4, 5))
    assert stored().with_overrides(fourth).scene.time.steps_per_period == 40
    with refusal(ErrorKind.CONFLICT, "time.steps_per_period", names="at least 50"):
        stored().with_overrides(fifth)


def test_stored_model_keeps_its_modes_where_a_scene_leaves_them_open() -> None:
    made = stored("basis.modes=1").scene
    assert changed_key(made, stored().scene) is None
    assert changed_key(made, stored("basis.modes=2").scene) == "basis"


@pytest.mark.parametrize("override", ["material.young=1e11", "basis.threshold=0.5"])
def test_refused_change_of_a_stored_model_is_named_with_its_table(override: str) -> None:
    table = override.split(".")[0]
    with refusal(ErrorKind.MISMATCH, table, names=override.split("=")[0]):
        stored("basis.modes=1").with_overrides([override, "material.mass_damping=3.0"])


def test_key_without_effect_on_stored_model_is_named_if_given(tmp_path: Path) -> None:
    model = stored("output.motion=true")
    for given, count in (("output.motion", 1), ("output", 1), ("title", 0), ("output.pictures", 0)):
        named = [text for text in warnings_of(model, tmp_path, (given,)) if "output.motion" in text]
        assert len(named) == count


def test_summary_and_report_of_refused_run_say_so(tmp_path: Path) -> None:
    """With so long a step, the run with twice the step gives another motion."""
    model = stored("time.steps_per_period=10", "time.periods=40", "loads.0.frequency=3.6")
    found = study.rerun(model, tmp_path)
    assert found.unfinished is not None
    name, error = found.unfinished
    assert name == "reduced" and isinstance(error, AccuracyError)
    assert error.kind is ErrorKind.TIME_STEP
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["unfinished"] == {"model": "reduced", "reason": str(error)}
    assert summary["estimated_error_percent"]["time step"] == pytest.approx(
        100.0 * found.errors["time step"].amplitude
    )
    page = html.unescape((tmp_path / "report.html").read_text())
    assert str(error) in page and "Refused" in page


def test_summary_and_report_of_good_run_give_the_estimate(tmp_path: Path) -> None:
    model = stored("time.periods=40", "time.steps_per_period=200")
    found = study.rerun(model, tmp_path)
    assert found.unfinished is None and 0.0 < found.errors["time step"].amplitude < 0.1
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert "unfinished" not in summary
    assert summary["estimated_error_percent"]["time step"] > 0.0
    assert "time step %" in (tmp_path / "report.html").read_text()


def test_run_of_stored_model_estimates_the_error_by_the_basis(tmp_path: Path) -> None:
    """The load is at the second frequency, which only the candidates have: the run is refused, and
    its files say so."""
    model = stored("loads.0.frequency=4.8", "time.periods=40")
    both = linear_model(
        np.eye(2),
        np.diag([500.0, (2.0 * np.pi * 4.8) ** 2]),
        damping=model.model.damping,
        loads=[[1.0], [0.5]],
        load_histories=model.model.load_histories,
    )
    both = both._replace(probe=np.array([[1.0, 1.0], [0.0, 0.0]]))
    found = study.rerun(replace(model, candidates=both, further=("2V",)), tmp_path)
    assert found.unfinished is not None and UNJUDGED not in found.warnings
    error = found.unfinished[1]
    assert isinstance(error, AccuracyError) and error.kind is ErrorKind.BASIS
    told = json.loads((tmp_path / "summary.json").read_text())
    assert told["unfinished"]["reason"] == str(error)
    estimates = told["estimated_error_percent"]
    assert estimates["basis"] == pytest.approx(100.0 * found.errors["basis"].amplitude)
    assert estimates["basis"] > 50.0 and len(estimates["directions by the basis"]) == 2


def test_failure_before_the_first_step_is_raised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An equilibrium that is not found keeps its iterates, which are no motion."""

    def failing(*_: object, **__: object) -> None:
        raise ConvergenceError("no equilibrium", np.zeros(3))

    monkeypatch.setattr("fenicsrom.online.run.simulate.simulate", failing)
    with pytest.raises(ConvergenceError, match="no equilibrium"):
        study.rerun(stored(), tmp_path)
