"""Runs of response curves: interrupted and continued, in several processes, with lost pictures."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import heard, refusal
from test_response import DAMPING, HIGH, LOW, oscillator

from fenicsrom import study
from fenicsrom.assess import jobs
from fenicsrom.assess.curves import pieces as curve_progress
from fenicsrom.assess.curves.pieces import CurveWalk
from fenicsrom.assess.curves.response import CLASSES, response
from fenicsrom.assess.curves.results import Response, curve_file
from fenicsrom.cli import main
from fenicsrom.errors import ErrorKind, SceneError
from fenicsrom.online.curves.curve import CurvePoint
from fenicsrom.online.store.archive import StoredModel, save_model
from fenicsrom.progress import asking

FAMILY = f'response.families={{key="material.mass_damping", values=[{DAMPING}, {2 * DAMPING}]}}'


def assert_same(one: Response, other: Response) -> None:
    """Compare all numbers of all points bit for bit, except for the run times."""
    assert [curve.value for curve in one.curves] == [curve.value for curve in other.curves]
    for mine, its in zip(one.curves, other.curves, strict=True):
        assert mine.step_error == its.step_error
        assert mine.marches == its.marches
        assert [piece.reason for piece in mine.pieces] == [piece.reason for piece in its.pieces]
        for part in ("points", "special"):
            pairs = zip(getattr(mine, part), getattr(its, part), strict=True)
            for a, b in pairs:
                for field in fields(CurvePoint):
                    np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name))


def assert_continued(again: Response, part: Response, whole: Response) -> None:
    """A continued run keeps the points that it had, and ends as the uninterrupted one."""
    for mine, kept, its in zip(again.curves, part.curves, whole.curves, strict=True):
        assert [piece.reason for piece in mine.pieces] == [piece.reason for piece in its.pieces]
        assert {point.parameter for point in kept.points} <= {p.parameter for p in mine.points}
        assert [point.kind for point in mine.special] == [point.kind for point in its.special]
        pairs = [*zip(mine.special, its.special, strict=True), (mine.points[-1], its.points[-1])]
        for a, b in pairs:
            assert a.parameter == pytest.approx(b.parameter, rel=1e-6)
            np.testing.assert_allclose(a.amplitude, b.amplitude, rtol=1e-4)


def interrupted(stored: StoredModel, folder: Path, points: int) -> Response:
    """A run that is stopped when its curves have so many points together."""
    count, passed = 0, CurveWalk.passed

    def counted(walk: CurveWalk) -> None:
        nonlocal count
        count += 1
        passed(walk)

    with pytest.MonkeyPatch.context() as patch, asking(lambda: count >= points):
        patch.setattr(CurveWalk, "passed", counted)
        found = response(stored, state=folder)
    assert found.interrupted
    return found


@pytest.mark.slow
@pytest.mark.parametrize("points", [0, 2, 40, 80])
def test_resumed_curve_ends_as_the_uninterrupted_one(tmp_path: Path, points: int) -> None:
    stored = oscillator()
    part = interrupted(stored, tmp_path / "state", points)
    assert sum(len(curve.points) for curve in part.curves) <= points
    again = response(stored, state=tmp_path / "state", resume=tmp_path / "state")
    assert not again.interrupted
    if points:
        assert_continued(again, part, response(stored))


@pytest.mark.slow
def test_resumed_families_compute_only_what_is_missing(tmp_path: Path) -> None:
    stored = oscillator(FAMILY)
    whole = response(stored, state=tmp_path / "whole")
    first = len(whole.curves[0].points)
    part = interrupted(stored, tmp_path / "state", first + 30)
    assert [len(curve.points) > first - 10 for curve in part.curves] == [True, False]
    lines: list[str] = []
    with heard(lines.append):
        again = response(stored, resume=tmp_path / "state")
    assert_continued(again, part, whole)
    assert not any("start at" in line for line in lines)
    assert not any("curve 1 of 2" in line for line in lines)


def test_state_is_written_while_the_curve_grows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(curve_progress, "KEEP_INTERVAL", 0.0)
    monkeypatch.setattr(curve_progress, "KEEP_SHARE", np.inf)
    stored, sizes = oscillator(), []

    def stop() -> bool:
        kept = curve_file(tmp_path, stored, 1).load(CLASSES)
        sizes.append(-1 if kept is None else len(kept.curve.points))
        return len({*sizes}) > 5

    with asking(stop):
        response(stored, state=tmp_path)
    assert sizes[-1] >= 4 and sizes == sorted(sizes)


@pytest.mark.parametrize(
    ("override", "key"),
    [
        (f"response.last={HIGH * 1.01}", "response.last"),
        ("response.points=50", "response.points"),
        (f"material.mass_damping={2 * DAMPING}", "material"),
        ("loads.0.force=0.03", "loads"),
        ("time.steps_per_period=120", "time.steps_per_period"),
    ],
)
def test_state_of_another_scene_is_refused(tmp_path: Path, override: str, key: str) -> None:
    response(oscillator("response.points=5"), state=tmp_path)
    with refusal(ErrorKind.MISMATCH, key):
        response(oscillator("response.points=5", override), resume=tmp_path)


def test_state_of_another_model_is_refused(tmp_path: Path) -> None:
    from dataclasses import replace

    stored = oscillator("response.points=5")
    response(stored, state=tmp_path)
    other = replace(stored, model=stored.model._replace(mass=2.0 * stored.model.mass))
    with pytest.raises(SceneError) as caught:
        response(other, resume=tmp_path)
    assert caught.value.kind is ErrorKind.MISMATCH


def test_damaged_state_is_refused(tmp_path: Path) -> None:
    stored = oscillator("response.points=5")
    response(stored, state=tmp_path)
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(SceneError) as caught:
        response(stored, resume=tmp_path)
    assert caught.value.kind is ErrorKind.FORMAT


@pytest.mark.slow
def test_curves_of_two_processes_are_the_serial_ones_bit_for_bit(tmp_path: Path) -> None:
    stored = oscillator(FAMILY)
    lines: list[str] = []
    with heard(lines.append):
        found = response(stored, state=tmp_path, workers=2)
    assert_same(found, response(stored))
    assert any("curve 1 of 2" in line for line in lines)
    assert any("curve 2 of 2" in line for line in lines)
    assert_same(response(stored, resume=tmp_path), found)


SHORT = f"response.last={1.02 * LOW}"


def test_run_that_is_stopped_in_its_checks_keeps_its_curve() -> None:
    lines: list[str] = []

    def is_checking() -> bool:
        return any("checking the curve" in line for line in lines)

    with heard(lines.append), asking(is_checking):
        found = response(oscillator("response.points=5"))
    assert is_checking() and found.interrupted
    assert len(found.curves[0].points) == 5 and not found.curves[0].checks


@pytest.mark.slow
def test_signal_ends_all_processes_with_files_and_state(tmp_path: Path) -> None:
    slow = "time.steps_per_period=20000"  # ten seconds on a fast machine
    save_model(tmp_path / "model.npz", oscillator(FAMILY, slow))
    words = ["response", "--from", str(tmp_path / "model.npz"), "--output", str(tmp_path / "out")]
    with subprocess.Popen(
        [sys.executable, "-m", "fenicsrom", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if ", amplitude" in line:  # of a point
                break
        os.killpg(process.pid, signal.SIGINT)  # as a terminal or a batch system does
        rest = process.stderr.read()
        assert process.wait(timeout=60) == 130
    assert "Traceback" not in rest
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"response.csv", "report.html", "response_state"} <= names
    with pytest.raises(ProcessLookupError):  # the server of processes ends an instant later
        for _ in range(200):
            os.killpg(process.pid, 0)
            time.sleep(0.05)


def test_curve_that_is_not_found_is_listed_and_the_others_are_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from fenicsrom.assess.curves import pieces as module
    from fenicsrom.errors import ConvergenceError

    start = module.start_motion

    def lost(stored: StoredModel, *arguments: Any) -> Any:
        if stored.scene.material.mass_damping > DAMPING:
            raise ConvergenceError("no periodic motion")
        return start(stored, *arguments)

    monkeypatch.setattr(module, "start_motion", lost)
    found = response(oscillator(FAMILY, SHORT))
    assert [curve.value for curve in found.curves] == [DAMPING]
    assert isinstance(found.unfinished, ConvergenceError)
    assert len(found.warnings) == 1 and f"{2 * DAMPING:g}" in found.warnings[0]


def test_unexpected_exception_of_one_curve_leaves_its_points_and_the_other_curves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from fenicsrom.assess.curves import pieces as response_pieces

    monkeypatch.setattr(jobs, "available_cores", lambda: 1)
    find = response_pieces.Continuation.between
    places: list[float] = []

    def endless(path: Any, before: CurvePoint, found: CurvePoint) -> Any:
        if path.shooting.problem.model.damping > DAMPING:
            places.append(found.parameter)
        if len(places) > 5:
            raise RecursionError("maximum recursion depth exceeded")
        return find(path, before, found)

    monkeypatch.setattr(response_pieces.Continuation, "between", endless)
    save_model(tmp_path / "model.npz", oscillator(FAMILY, SHORT))
    arguments = ["response", "--from", str(tmp_path / "model.npz"), "--output", str(tmp_path)]
    assert main([*arguments, "--set", "output.pictures=false"]) == 1
    said = capsys.readouterr()
    assert "RecursionError" in said.err and "Traceback" not in said.err
    table = np.genfromtxt(tmp_path / "response.csv", delimiter=",", names=True, dtype=None)
    values = table["materialmass_damping_1s"]
    assert set(values) == {DAMPING, 2 * DAMPING}
    assert np.sum(values == DAMPING) > np.sum(values == 2 * DAMPING) > 2


@pytest.mark.slow
def test_resume_option_continues_the_state_of_the_output_folder(
    tmp_path: Path, capsys: Any
) -> None:
    stored = oscillator()
    save_model(tmp_path / "model.npz", stored)
    interrupted(stored, tmp_path / "out" / "response_state", 50)
    command = ["response", "--from", str(tmp_path / "model.npz"), "--output"]
    state = str(tmp_path / "out" / "response_state")
    assert main([*command, str(tmp_path / "out"), "--resume", state]) == 0
    assert main([*command, str(tmp_path / "whole")]) == 0
    table, whole = (
        np.genfromtxt(tmp_path / name / "response.csv", delimiter=",", skip_header=1)
        for name in ("out", "whole")
    )
    np.testing.assert_array_equal(table[:40], whole[:40])
    np.testing.assert_allclose(table[-1, 1:3], whole[-1, 1:3], rtol=1e-6)
    assert main([*command, str(tmp_path / "out"), "--resume", str(tmp_path / "none")]) == 2


@pytest.mark.slow
def test_motions_at_marked_points_repeat_and_have_the_amplitude(tmp_path: Path) -> None:
    from fenicsrom.post.curves.response_report import marked_motions, write_motion_arrays

    stored = oscillator()
    found = response(stored)
    motions = marked_motions(found, stored)
    assert set(motions) == {"largest", "fold_1", "fold_2"}
    (curve,) = found.curves
    top = max(curve.points, key=lambda point: point.amplitude.max())
    path = write_motion_arrays(motions, tmp_path)
    with np.load(path) as arrays:
        x, q = arrays["largest_displacement"], arrays["largest_coordinates"]
        assert arrays["largest_parameter"] == top.parameter
        assert arrays["largest_time"][-1] == pytest.approx(1.0 / top.parameter, rel=1e-12)
    np.testing.assert_allclose(0.5 * np.ptp(x, axis=0), top.amplitude, rtol=1e-6)
    np.testing.assert_allclose(q[0], top.z[:1], rtol=1e-6)
    np.testing.assert_allclose(x[:, 0, 0], q[:, 0], rtol=1e-12)


def test_folder_without_curves_to_resume_is_refused_before_the_model_is_built(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fenicsrom.study.curves.source_of", lambda *_: pytest.fail("was built"))
    with refusal(ErrorKind.FILE, names="must be a folder with curve_1.npz"):
        study.response(oscillator("response.points=5"), resume=tmp_path)
