"""Sweeps: every combination runs once, models are shared, results are kept, failures are told."""

from __future__ import annotations

import csv
import json
from argparse import Namespace
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import beam_scene, linear_model, needs_mpirun, on_ranks, refusal, unexplained

from fenicsrom import study
from fenicsrom.assess.studies import sweep_runs
from fenicsrom.assess.studies.sweep_runs import DONE, DOUBTFUL, FAILED, Sweep
from fenicsrom.cli import main, starting
from fenicsrom.errors import ErrorKind
from fenicsrom.online.run.simulate import load_histories
from fenicsrom.online.store.archive import StoredModel, load_model, save_model
from fenicsrom.online.store.scene_changes import changed_scene
from fenicsrom.online.stress.stress import Deformation
from fenicsrom.post.studies import sweep_report
from fenicsrom.progress import asking
from fenicsrom.scene.reading.overrides import make_axes
from fenicsrom.study import sweeps

STIFFNESS, MASS = 500.0, 1.0


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """The file of a linear model of one coordinate without contact."""
    scene = beam_scene(
        2,
        ("geometrically_nonlinear=false", "time.steps_per_period=100", "output.pictures=false"),
        contacts=None,
        probe={"group": "tip"},
    )
    made = linear_model(
        np.eye(1) * MASS,
        np.eye(1) * STIFFNESS,
        damping=scene.material.mass_damping,
        loads=[[1.0]],
        load_histories=load_histories(scene),
    )
    path = tmp_path / "model.npz"
    save_model(path, StoredModel(made, scene, "rubin", ("1V",), 9, np.array([3.6]), {}))
    return path


def swept(model: Path, folder: Path, over: Sequence[str], **options: Any) -> Sweep:
    """A sweep of a stored model."""
    scene = load_model(model).scene
    return study.run_sweep(
        scene, partial(changed_scene, scene), make_axes(over), folder, stored=model, **options
    )


def amplitude(
    force: float, frequency: float, damping: float, stiffness: float = STIFFNESS
) -> float:
    """The amplitude of a linear oscillator, m."""
    omega = 2.0 * np.pi * frequency
    return float(force / abs(stiffness - MASS * omega**2 + 1j * damping * MASS * omega))


def test_each_combination_has_amplitude_of_its_scene(model: Path, tmp_path: Path) -> None:
    found = swept(model, tmp_path, ["loads.0.force=[10, 20]", "loads.0.frequency=2:3:3"])
    damping = load_model(model).scene.material.mass_damping
    assert [row["run"] for row in found.rows] == [1, 2, 3, 4, 5, 6]
    for row in found.rows:
        exact = amplitude(row["loads.0.force"], row["loads.0.frequency"], damping)
        assert row["amplitude_x_m"] == pytest.approx(exact, rel=0.01)
        assert row["outcome"] == DONE and row["settled"]
    assert found.models == 0


def test_rows_have_the_estimates_of_their_runs(model: Path, tmp_path: Path) -> None:
    """Finer elements that are 2 % softer: the distance of the amplitudes is known."""
    stored = load_model(model)
    elastic = stored.model.elastic
    finer = stored.model._replace(elastic=elastic._replace(stiffness=0.98 * elastic.stiffness))
    save_model(model, replace(stored, finer=finer, finer_labels=stored.labels))
    (row,) = swept(model, tmp_path, ["loads.0.force=[10]"]).rows
    damping = stored.scene.material.mass_damping
    ours, theirs = (amplitude(10.0, 3.2, damping, k) for k in (STIFFNESS, 0.98 * STIFFNESS))
    assert row["mesh_error"] == pytest.approx(1.5 * abs(ours / theirs - 1.0), rel=0.02)
    assert 0.0 < row["step_error"] < 0.1 and "basis_error" not in row


def test_files_hold_all_rows(model: Path, tmp_path: Path) -> None:
    found = swept(model, tmp_path, ["loads.0.force=[10, 20]"])
    with (tmp_path / "sweep.csv").open() as file:
        listed = [float(row["amplitude_x_m"]) for row in csv.DictReader(file)]
    assert listed == [row["amplitude_x_m"] for row in found.rows]
    written = json.loads((tmp_path / "sweep.json").read_text())
    assert written["axes"] == [{"keys": ["loads.0.force"], "values": [[10], [20]]}]
    assert (tmp_path / "report.html").is_file()


def test_columns_of_sweep_csv_are_explained(model: Path, tmp_path: Path) -> None:
    found = swept(model, tmp_path, ["loads.0.force=[10]"])
    sweep_report.report(found).write(tmp_path)
    head = (tmp_path / "sweep.csv").read_text().splitlines()[0].split(",")
    assert "loads.0.force_N" in head and unexplained(head, "sweep.csv") == []


def test_runs_of_a_crushed_model_are_named_once(model: Path, tmp_path: Path) -> None:
    crushed = Deformation(0.8, np.zeros(2), 0.85, 1.1)
    save_model(model, replace(load_model(model), deformation=crushed))
    found = swept(model, tmp_path, ["loads.0.force=[10, 20]"])
    assert [row["outcome"] for row in found.rows] == [DONE, DONE]
    (said,) = sweep_report.remarks(found)
    assert said.startswith("runs 1, 2: ") and "15 %" in said


def test_doubtful_run_keeps_its_warnings(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = sweep_runs.simulate
    monkeypatch.setattr(sweep_runs, "simulate", lambda *a, **k: replace(real(*a, **k), buckled=1))
    (row,) = swept(model, tmp_path, ["time.steps_per_period=[10]"]).rows
    assert row["outcome"] == DOUBTFUL
    assert row["sentence"].startswith("time.steps_per_period") and "buckles" in row["sentence"]
    assert [note[0] for note in row["notes"][:2]] == ["ERROR", "SEVERAL"]


def test_failed_runs_keep_their_sentence_and_the_others_run(model: Path, tmp_path: Path) -> None:
    found = swept(model, tmp_path, ["loads.0.frequency=[2, -1]", "loads.0.force=[1, 2]"])
    assert [row["outcome"] for row in found.rows] == [DONE, DONE, FAILED, FAILED]
    assert "frequency = -1" in found.rows[2]["sentence"]
    failed = "a computation that failed, in 2 runs: 3, 4"
    assert failed in found.warnings and failed in sweep_report.report(found).verdict.text


def test_key_of_offline_stage_fails_on_stored_model(model: Path, tmp_path: Path) -> None:
    found = swept(model, tmp_path, ["material.young=[1e9, 2e9]"])
    assert [row["outcome"] for row in found.rows] == [FAILED, FAILED]


def test_resumed_sweep_computes_only_what_is_missing(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    over = ["loads.0.force=[10, 20, 30]"]
    whole = swept(model, tmp_path, over)
    kept = sorted((tmp_path / sweeps.RUNS).iterdir(), key=lambda file: file.stat().st_mtime_ns)
    kept[1].write_text("{")
    computed: list[int] = []
    real = sweep_runs.compute

    def counted(run: sweep_runs.SweepRun) -> Any:
        computed.append(run.number)
        return real(run)

    monkeypatch.setattr(sweep_runs, "compute", counted)
    again = swept(model, tmp_path, over, resume=True)
    assert computed == [1] and again.reused == 2
    for row, other in zip(again.rows, whole.rows, strict=True):
        assert row["amplitude_x_m"] == other["amplitude_x_m"]
    computed.clear()
    swept(model, tmp_path, ["loads.0.force=[10, 20, 31]"], resume=True)
    assert computed == [2]
    computed.clear()
    finer = swept(model, tmp_path, ["loads.0.force=[5, 10, 20, 30]"], resume=True)
    assert computed == [0] and [row["run"] for row in finer.rows] == [1, 2, 3, 4]
    assert finer.rows[3]["amplitude_x_m"] == whole.rows[2]["amplitude_x_m"]
    computed.clear()
    swept(model, tmp_path, over)
    assert computed == [0, 1, 2]


def test_results_of_another_model_are_not_reused(model: Path, tmp_path: Path) -> None:
    stored = load_model(model)
    swept(model, tmp_path, ["loads.0.force=[10]"])
    softer = stored.model._replace(mass=2.0 * stored.model.mass)
    save_model(model, StoredModel(softer, stored.scene, "rubin", ("1V",), 9, np.ones(1), {}))
    assert swept(model, tmp_path, ["loads.0.force=[10]"], resume=True).reused == 0


def test_interrupted_sweep_keeps_finished_runs(model: Path, tmp_path: Path) -> None:
    def stop() -> bool:
        return len(list((tmp_path / sweeps.RUNS).glob("*.npz"))) == 2

    with asking(stop):
        found = swept(model, tmp_path, ["loads.0.force=[10, 20, 30, 40]"])
    assert found.interrupted
    assert [row.get("outcome") for row in found.rows] == [DONE, DONE, None, None]
    assert (tmp_path / "sweep.csv").is_file()


@pytest.mark.slow
@pytest.mark.parametrize(
    "workers", ["processes", pytest.param("ranks", marks=needs_mpirun), "cluster"]
)
def test_workers_give_rows_of_one_process(workers: str, model: Path, tmp_path: Path) -> None:
    over = "loads.0.force=[10, 20, 30]"
    one = swept(model, tmp_path / "one", [over]).rows
    words = ["sweep", "--from", str(model), "--over", over, "--output", str(tmp_path / "two")]
    if workers == "ranks":
        on_ranks(2, "-m", "fenicsrom", *words)
    elif workers == "cluster":
        cluster = pytest.importorskip("distributed").LocalCluster(
            n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0"
        )
        with cluster:
            assert main([*words, "--scheduler", cluster.scheduler_address]) == 0
    if workers == "processes":
        two = swept(model, tmp_path / "two", [over], workers=2).rows
    else:
        two = json.loads((tmp_path / "two" / "sweep.json").read_text())["runs"]
    for row, other in zip(one, two, strict=True):
        assert {**row, "run_time_s": 0} == {**other, "run_time_s": 0}


@pytest.mark.slow
def test_scheduler_that_does_not_answer_is_refused(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(starting, "PATIENCE", 0.3)
    with refusal(ErrorKind.FILE, "--scheduler"), starting.workers(Namespace(scheduler="nowhere")):
        pass
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_runs_share_models_unless_offline_keys_change(tmp_path: Path) -> None:
    scene = beam_scene(2, ("time.periods=3", "output.pictures=false", "basis.derivatives='none'"))

    over = ["basis.modes=[1, 2]", "contacts.0.preload=[10, 20]"]
    found = study.run_sweep(scene, partial(changed_scene, scene), make_axes(over), tmp_path)
    assert found.models == 2
    assert len(list((tmp_path / sweeps.MODELS).glob("*.npz"))) == 2
    assert len({row["peak_normal_force_N"] for row in found.rows}) == 4


@pytest.mark.slow
@needs_mpirun
def test_ranks_build_models(tmp_path: Path) -> None:
    """PETSc starts on all ranks together, though rank 0 builds none."""
    demo = Path(__file__).parents[2] / "demos" / "open_2d.toml"
    changes = ["geometry.parameters.elements_along=10", "output.pictures=false"]
    options = [part for change in changes for part in ("--set", change)]
    options += ["--over", "basis.modes=[1, 2]", "--output", str(tmp_path / "out")]
    on_ranks(2, "-m", "fenicsrom", "sweep", str(demo), *options)
    written = json.loads((tmp_path / "out" / "sweep.json").read_text())
    assert written["models"] == 2
    assert [row["outcome"] for row in written["runs"]] == [DONE, DONE]


def test_results_of_a_version_with_another_format_are_not_reused(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep_runs, "FORMAT", "fenicsrom reduced model 0")
    swept(model, tmp_path, ["loads.0.force=[10]"])
    monkeypatch.undo()
    assert swept(model, tmp_path, ["loads.0.force=[10]"], resume=True).reused == 0
