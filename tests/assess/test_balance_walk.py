"""Response curves by harmonic balance: harmonics by their estimate, stability, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support import refusal

from fenicsrom.assess.curves.balance_walk import FIRST, balanced_motion
from fenicsrom.assess.curves.response import response
from fenicsrom.assess.curves.results import Response
from fenicsrom.errors import AccuracyError, ErrorKind
from fenicsrom.post.curves.response_report import report
from fenicsrom.scene.checks.curve_checks import uses_balance
from tests.assess.test_response import oscillator, scene_with

pytestmark = pytest.mark.slow

BALANCE = 'response.method="balance"'


@pytest.fixture(scope="module")
def found() -> Response:
    return response(oscillator(BALANCE, "loads.0.force=0.05"))


def test_balance_follows_the_curve_of_shooting_with_its_stability(found: Response) -> None:
    """Of short steps; the stable and unstable stretches end at the folds."""
    shot = response(oscillator("loads.0.force=0.05", "time.steps_per_period=400"))
    ours, theirs = found.curves[0], shot.curves[0]
    folds = [[p.parameter for p in curve.special if p.kind == "fold"] for curve in (ours, theirs)]
    assert len(folds[0]) == 2
    np.testing.assert_allclose(*folds, rtol=8e-5)
    tops = [max(p.amplitude.max() for p in curve.points) for curve in (ours, theirs)]
    assert tops[0] == pytest.approx(tops[1], rel=3e-5)
    parameters = [point.parameter for point in ours.points]
    stable = [point.verdict == "stable" for point in ours.points]
    turns = [k for k in range(1, len(stable)) if stable[k] != stable[k - 1]]
    assert all(point.known for point in ours.points) and len(turns) == 2
    for k, fold in zip(turns, folds[0], strict=True):
        assert min(abs(parameters[k + i] - fold) for i in (-1, 0)) < 1e-4
    judged = [point for point in ours.points if point.multipliers.size]
    assert len(judged) < 0.4 * len(ours.points)


def test_harmonics_join_until_the_estimate_is_small(
    found: Response, monkeypatch: pytest.MonkeyPatch
) -> None:
    curve = found.curves[0]
    assert curve.harmonics == FIRST and curve.step_error is not None and curve.step_error < 2e-4
    monkeypatch.setattr("fenicsrom.assess.curves.balance_walk.FIRST", 2)
    grown = response(oscillator(BALANCE, "loads.0.force=0.05")).curves[0]
    assert grown.harmonics == 3 and max(check.step_error or 1.0 for check in grown.checks) < 2e-4
    tops = [max(p.amplitude.max() for p in c.points) for c in (curve, grown)]
    assert tops[0] == pytest.approx(tops[1], rel=2e-4)


def test_motion_of_a_point_has_its_amplitude_and_returns(found: Response) -> None:
    stored = oscillator(BALANCE, "loads.0.force=0.05")
    top = max(found.curves[0].points, key=lambda point: float(point.amplitude.max()))
    motion = balanced_motion(stored, top)
    assert np.ptp(motion.displacement[:, 0, 0]) / 2.0 == pytest.approx(
        top.amplitude[0, 0], rel=1e-4
    )
    np.testing.assert_allclose(motion.displacement[0], motion.displacement[-1])


def test_too_few_harmonics_are_an_error_that_keeps_the_curve(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("fenicsrom.assess.curves.balance_walk.FIRST", 2)
    monkeypatch.setattr("fenicsrom.assess.curves.balance_walk.MOST", 2)
    kept = response(oscillator(BALANCE, "loads.0.force=0.05", "response.accuracy=1e-6"))
    assert isinstance(kept.unfinished, AccuracyError)
    assert "3 instead of 2 harmonics change amplitudes" in str(kept.unfinished)
    assert len(kept.curves[0].points) > 50
    report(kept).write_numbers(tmp_path)
    told = json.loads((tmp_path / "response.json").read_text())["curves"][0]
    assert told["harmonics"] == 2


@pytest.mark.parametrize(
    ("key", "value"), [("branches", "1"), ("isolated", "[0.15]"), ("full", "3")]
)
def test_what_the_balance_cannot_do_is_refused(key: str, value: str) -> None:
    assert uses_balance(scene_with(BALANCE))
    with refusal(ErrorKind.CONFLICT, key=f"response.{key}", names="harmonic balance"):
        scene_with(BALANCE, f"response.{key}={value}")
