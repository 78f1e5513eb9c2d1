"""Branches, isolated curves and estimates of errors of response curves."""

from __future__ import annotations

import contextlib
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_response import HIGH, fold_frequencies, oscillator

from fenicsrom.assess.curves import pieces, trust
from fenicsrom.assess.curves.pieces import CurveWalk
from fenicsrom.assess.curves.response import response
from fenicsrom.assess.curves.results import Response, ResponseCurve
from fenicsrom.assess.curves.stability_search import EXTRA
from fenicsrom.assess.curves.trust import BETWEEN, LARGEST, SHARE, SPREAD, richer_model, spread
from fenicsrom.assess.errors.verdicts import TIME_ERROR, in_percent
from fenicsrom.cli import main
from fenicsrom.errors import ConvergenceError
from fenicsrom.notes import AMPLITUDES, NoteKind
from fenicsrom.online.curves.curve import CurvePoint, Piece
from fenicsrom.online.model.model import reduced_model
from fenicsrom.online.model.polynomial import ElasticPolynomial
from fenicsrom.online.store.archive import StoredModel, load_model, save_model
from fenicsrom.post.curves.response_tables import summary
from fenicsrom.progress import asking

pytestmark = pytest.mark.slow

# a range with three motions at its first frequency: a march from rest finds the lower one
INSIDE = float(np.mean(fold_frequencies()))
WINDOW = (f"response.first={INSIDE}", f"loads.0.frequency={INSIDE}", f"response.last={HIGH}")


def holmes() -> StoredModel:
    """u'' + 0.3 u' + 2 u + 3 u^2 + u^3 = F sin(1.2 t), whose motions double their period."""
    frequency = 1.2 / (2.0 * np.pi)
    stored = oscillator(
        "material.mass_damping=0.3",
        f"loads.0.frequency={frequency}",
        "time.steps_per_period=200",
        'response.parameter="loads.0.force"',
        "response.first=0.15",
        "response.last=0.27",
        "response.branches=1",
    )
    elastic = ElasticPolynomial(
        np.zeros(1), np.full((1, 1), 2.0), np.full((1, 1), 6.0), np.full((1, 1), 3.0)
    )
    return replace(stored, model=stored.model._replace(elastic=elastic))


def test_isolated_curve_is_found_through_the_load() -> None:
    lower = response(oscillator(*WINDOW)).curves[0]
    both = response(oscillator(*WINDOW, f"response.isolated=[{INSIDE}]")).curves[0]
    assert [piece.origin for piece in lower.pieces] == ["march"]
    assert [piece.origin for piece in both.pieces] == ["march", "isolated"]
    upper = both.pieces[1]
    assert upper.reason == "end of the range"
    ends = upper.points[0], upper.points[-1]
    assert [point.parameter for point in ends] == pytest.approx([INSIDE, INSIDE])
    assert {point.stable for point in ends} == {True, False}
    assert [point.kind for point in upper.special] == ["fold"]
    first, known = lower.points[0].amplitude.max(), [p.amplitude.max() for p in ends]
    assert first < min(known) < max(known)


def test_branch_of_period_doubling_is_a_piece_of_two_periods(tmp_path: Path) -> None:
    save_model(tmp_path / "model.npz", holmes())
    arguments = ["response", "--from", str(tmp_path / "model.npz"), "--output", str(tmp_path)]
    assert main([*arguments, "--set", "output.pictures=false"]) == 0
    (curve,) = json.loads((tmp_path / "response.json").read_text())["curves"]
    assert [piece["periods"] for piece in curve["pieces"]] == [1, 2]
    assert curve["pieces"][1]["origin"].startswith("period doubling at loads.0.force = 0.2")
    assert curve["ends"] == ["end of the range", "end of the range"]


@pytest.mark.parametrize("before_the_end", [1, 3])
def test_interrupted_branch_is_followed_again(tmp_path: Path, before_the_end: int) -> None:
    save_model(tmp_path / "model.npz", holmes())
    stored = load_model(tmp_path / "model.npz")
    asked, limit = 0, 10_000

    def stop() -> bool:
        nonlocal asked
        asked += 1
        return asked > limit

    with asking(stop):
        whole = response(stored).curves[0]
        asked, limit = 0, asked - before_the_end
        part = response(stored, state=tmp_path)
    assert part.interrupted and part.curves[0].pieces[-1].periods == 2
    again = response(stored, resume=tmp_path).curves[0]
    assert [piece.origin for piece in again.pieces] == [piece.origin for piece in whole.pieces]
    for mine, its in zip(again.pieces, whole.pieces, strict=True):
        assert mine.reason == its.reason
        assert mine.points[-1].parameter == pytest.approx(its.points[-1].parameter, rel=1e-6)


def test_incomplete_curve_of_unstable_motions_says_that_nothing_settles_on_them(
    tmp_path: Path,
) -> None:
    save_model(tmp_path / "model.npz", holmes())
    stored = load_model(tmp_path / "model.npz")
    for first, last, named in ((0.15, 0.27, False), (0.27, 0.15, True)):
        overrides = [f"response.first={first}", f"response.last={last}", "response.points=4"]
        found = response(stored.with_overrides(overrides))
        assert ("unstable" in str(found.unfinished)) == named


@pytest.mark.parametrize("done", [0, 1, 2])
def test_second_branch_is_followed_after_an_interrupt(
    monkeypatch: pytest.MonkeyPatch, done: int
) -> None:
    """Two branches leave a branch point; the run ended when so many were complete."""
    at = response(oscillator("response.points=2")).curves[0].points[0]

    def motion(s: float, parameter: float, kind: str = "") -> CurvePoint:
        return replace(at, s=np.array([1.0, s]), parameter=parameter, kind=kind)

    bifurcation = motion(0.0, 0.5, "branch point")

    def follow(path: Any, begin: CurvePoint, direction: Any, origin: str, periods: int) -> Piece:
        if len(parts) - 1 == allowed:
            raise KeyboardInterrupt
        parts.append(Piece([begin, motion(5.0 * begin.s[1], 0.7)], [], "closed end", origin))
        return parts[-1]

    monkeypatch.setattr(
        pieces, "branch", lambda path, point, equation, sense: (path, motion(sense, 0.5))
    )
    parts = [Piece([motion(0.0, 0.0), motion(0.0, 1.0)], [bifurcation])]
    path = SimpleNamespace(place=lambda point: np.append(point.s, point.parameter), shooting=None)
    walk: Any = SimpleNamespace(
        curve=SimpleNamespace(pieces=parts),
        table=SimpleNamespace(branches=1, parameter="force"),
        path=lambda point, periods: path,
        follow=follow,
        _branch=lambda *given: CurveWalk._branch(walk, *given),
    )
    allowed = done
    with contextlib.suppress(KeyboardInterrupt):
        CurveWalk.branches(walk)
    assert len(parts) == 1 + done
    allowed = 9
    CurveWalk.branches(walk)
    assert [part.points[1].s[1] for part in parts[1:]] == [1.0, -1.0]


def curve_at(steps: int, richer: bool = False) -> ResponseCurve:
    """The curve with so many steps per period, compared with the same model and a spectator."""
    stored = oscillator(f"time.steps_per_period={steps}")
    if not richer:
        return response(stored).curves[0]
    return compared(stored, 30.0).curves[0]


def compared(stored: StoredModel, stiffness: float, own: float = 1.0) -> Response:
    """The curves of an oscillator, compared with a model that has a second one beside it.

    Args:
        stored: the oscillator.
        stiffness: of the second one.
        own: stiffness of the first one in this model.
    """
    one = stored.model
    cubic = np.zeros((3, 3))
    cubic[0, 0] = one.elastic.cubic[0, 0]
    quadratic = np.zeros((3, 2))
    elastic = ElasticPolynomial(np.zeros(2), np.diag([own, stiffness]), quadratic, cubic)
    points = (one.points, np.zeros((0, 2)), np.zeros(0))
    loads = np.array([[1.0], [0.0]])
    probe = np.array([[1.0, 0.0], [0.0, 0.0]])
    model = reduced_model(
        np.eye(2), one.damping, elastic, loads, one.load_histories, *points, probe, np.zeros(2)
    )
    richer_of = richer_model(replace(stored, candidates=model, further=("2V",)), 0)
    return response(stored, richer=richer_of)


def test_step_errors_at_selected_points_fall_with_the_square_of_the_step() -> None:
    coarse, fine = curve_at(50), curve_at(100)
    named = [
        [check for check in of if check.where != BETWEEN] for of in (coarse.checks, fine.checks)
    ]
    names = [check.where for check in named[0]]
    assert sorted(names) == ["first", "fold", "fold", "largest amplitude", "last"]
    unstable = [check for check in coarse.checks if check.where == BETWEEN]
    assert unstable and not any(check.contradicted_by_step for check in unstable)
    for one, other in zip(*named, strict=True):
        assert one.where == other.where
        assert one.quantity == ("parameter" if one.where == "fold" else "amplitude")
        assert one.step_error is not None and other.step_error is not None
        if one.where == "fold":
            assert 3.0 < one.step_error / other.step_error < 5.0


def test_richer_basis_that_adds_nothing_has_no_error() -> None:
    curve = curve_at(50, richer=True)
    assert curve.basis_error is not None
    for check in curve.checks:
        if check.where != "fold":
            assert check.basis_error is not None and check.basis_error < 1e-5


def test_basis_that_must_grow_is_compared_at_the_named_points_only() -> None:
    for accuracy, others in (("1e-9", False), ("1.0", True)):
        stored = oscillator("time.steps_per_period=50", f"basis.accuracy={accuracy}")
        where = {check.where for check in compared(stored, 30.0, 0.999).curves[0].checks}
        assert LARGEST in where and (BETWEEN in where) == others


def test_motion_that_a_richer_basis_finds_unstable_is_a_warning() -> None:
    """The richer model has a direction that the motion leaves at rest, and that diverges."""
    stored = oscillator("time.steps_per_period=50")
    found = compared(stored, -0.01)
    (curve,) = found.curves
    spread = [check for check in curve.checks if check.where == BETWEEN and check.point.stable]
    assert 8 <= len(spread) <= min(SPREAD, len(curve.points) / SHARE + 1)
    for check in spread:
        assert check.point.stable and check.richer_verdict == "fold"
        assert check.basis_error is not None and check.basis_error < 1e-5
    (warning,) = found.warnings
    assert stored.scene.response is not None
    values = [check.point.parameter for check in curve.checks if check.contradicted]
    range_of = [f"{value:.6g}" for value in (min(values), max(values))]
    for part in (stored.scene.response.parameter, *range_of, f"{len(values)} points", "(fold)"):
        assert part in warning
    rows = summary(found)["curves"][0]["checks"]
    assert {row["stability_with_a_richer_basis"] for row in rows if row["where"] != "fold"} == {
        "fold"
    }


def test_stretch_between_spread_points_that_only_a_richer_basis_sees_is_a_warning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The multipliers at the two compared motions beside the stretch are 0.993."""
    stored = oscillator("time.steps_per_period=50")
    (piece,) = response(stored).curves[0].pieces
    *_, last, end = sorted(point.parameter for _, point in spread([piece]))
    middle, width = 0.5 * (last + end), 0.7 * (end - last)

    def motion(point: CurvePoint, *_: Any) -> Any:
        size = 0.96 + 0.05 / (1.0 + ((point.parameter - middle) / width) ** 2)
        verdict = "stable" if size < 1.0 else "torus"
        multipliers = np.array([size + 0.0j])
        if not point.stable:  # the unstable stretch of the curve itself stays unstable
            verdict, multipliers = point.verdict, point.multipliers
        return SimpleNamespace(
            amplitude=point.amplitude,
            multipliers=multipliers,
            free_sliders=0,
            verdict=verdict,
            stable=verdict == "stable",
        )

    monkeypatch.setattr(trust, "richer_motion", motion)
    found = compared(stored, 30.0)
    added = [check for check in found.curves[0].checks if check.where == trust.NEAR_CHANGE]
    assert 0 < len(added) <= EXTRA
    contradicted = [check for check in found.curves[0].checks if check.contradicted]
    assert contradicted and {check.where for check in contradicted} == {trust.NEAR_CHANGE}
    assert all(check.point.stable for check in added)
    # half the step has its fold earlier, and no motion at the last of these points
    assert any(check.step_error is not None for check in added)
    (warning,) = on_stability(found)
    values = [check.point.parameter for check in contradicted]
    assert f"{min(values):.6g}" in warning and f"{max(values):.6g}" in warning
    outside = max(check.richer_multiplier for check in contradicted) - 1.0
    assert f" {outside:.2g} outside of the unit circle" in warning


def on_stability(found: Response) -> list[str]:
    """The warnings on the stability of motions."""
    return [said for said in found.warnings if "stability" in said]


def test_error_that_a_run_refuses_is_a_warning() -> None:
    found = compared(oscillator("time.steps_per_period=12"), 30.0)
    worst = max(check.step_error or 0.0 for check in found.curves[0].checks)
    assert worst > TIME_ERROR
    assert any(
        f"by {in_percent(worst)}" in said and "steps_per_period" in said for said in found.warnings
    )


def test_motions_that_a_richer_basis_does_not_find_are_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def lost(*arguments: Any, **options: Any) -> None:
        raise ConvergenceError("lost")

    monkeypatch.setattr(trust, "solve", lost)
    found = compared(oscillator("time.steps_per_period=50"), 30.0)
    asked = sum(check.compared for check in found.curves[0].checks)
    assert asked > SPREAD // 2 and found.curves[0].basis_error is None
    (note,) = found.warnings
    assert f"unknown at {asked} of {asked}" in note
    assert note.kind is NoteKind.UNCHECKED and note.quantity == AMPLITUDES
