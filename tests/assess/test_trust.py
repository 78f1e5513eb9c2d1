"""The shift of a bifurcation is told from a contradiction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from motions import curve_point

from fenicsrom.assess.curves import trust
from fenicsrom.assess.curves.trust import Check, Richer, checks
from fenicsrom.online.curves.curve import UNSURE, CurvePoint, Piece

PLACE = 100.32  # of a torus bifurcation


def growing(p: float) -> float:
    """The size of a pair that leaves the unit circle at `PLACE`."""
    return 1.0 + p - PLACE


def motion(parameter: float, size: float, kind: str = "") -> CurvePoint:
    """A motion with a pair of multipliers; nothing else matters."""
    pair = size * np.exp(1j * np.array([1.0, -1.0]))
    verdict = "torus" if size > 1.0 else "stable"
    return curve_point(parameter, multipliers=pair, verdict=verdict, kind=kind)


Size = Callable[[float], float]


def checked(
    monkeypatch: pytest.MonkeyPatch, finer: Size, own: Size, places: tuple[float, ...]
) -> list[Check]:
    """The checks of a curve from 99 to 101.

    Args:
        monkeypatch: replaces the motions with half the step.
        finer: the size of the pair with half the step, by the parameter.
        own: the size of the pair on the curve.
        places: where it passes 1.
    """
    points = [motion(p, own(p)) for p in np.linspace(99.0, 101.0, 41)]
    events = [motion(place, 1.0, "torus") for place in places]

    def other(point: CurvePoint, _: object) -> CurvePoint:
        return replace(motion(point.parameter, finer(point.parameter)), kind=point.kind)

    monkeypatch.setattr(trust, "finer_motion", other)
    monkeypatch.setattr(trust, "NEAR", np.inf)
    monkeypatch.setattr(trust, "SHARE", 1)
    return checks([Piece(points, events)], lambda value: None)  # type: ignore[arg-type]


@pytest.mark.parametrize("shift", [-0.15, 0.15, 0.6])
def test_point_beside_a_bifurcation_that_moves_is_no_contradiction(
    monkeypatch: pytest.MonkeyPatch, shift: float
) -> None:
    found = checked(monkeypatch, lambda p: growing(p) + shift, growing, (PLACE,))
    assert any(c.point.stable != (c.finer_verdict == "stable") for c in found)
    assert not any(c.contradicted_by_step for c in found)
    (moved,) = (c for c in found if c.quantity == "parameter")
    assert (moved.where, moved.point.parameter) == ("torus", PLACE)
    assert moved.step_error == pytest.approx(abs(shift) / PLACE, rel=1e-9)
    assert moved.finer_verdict == ("torus" if shift > 0.0 else "stable") and not moved.judged


def test_single_point_of_another_stability_widens_the_place_of_its_bifurcation(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The multiplier errs by 0.3 at one point only, and by nothing at the bifurcation."""

    def finer(p: float) -> float:
        return growing(p) + 0.3 * (abs(p - 100.1) < 0.01)

    found = checked(monkeypatch, finer, growing, (PLACE,))
    points = [c for c in found if c.quantity == "amplitude"]
    (other,) = (c for c in points if c.point.stable != (c.finer_verdict == "stable"))
    assert other.point.parameter == pytest.approx(100.1) and not other.contradicted_by_step
    (moved,) = (c for c in found if c.quantity == "parameter")
    assert moved.step_error == pytest.approx(0.3 / PLACE, rel=1e-9)


@pytest.mark.parametrize(
    "finer",
    [
        lambda p: growing(p) + 1.1,  # the bifurcation moves by 1.1 %
        lambda p: 1.1 if 99.1 < p < 99.7 else growing(p) + 0.1,  # another stretch
    ],
)
def test_stretch_of_another_stability_is_a_contradiction(
    monkeypatch: pytest.MonkeyPatch, finer: Callable[[float], float]
) -> None:
    found = checked(monkeypatch, finer, growing, (PLACE,))
    assert any(c.contradicted_by_step for c in found)


def test_stretch_that_vanishes_with_half_the_step_is_a_contradiction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def bump(p: float) -> float:
        return 1.0401 - (p - 100.0) ** 2 / 4.0

    ends = tuple(100.0 + sign * (4.0 * 0.0401) ** 0.5 for sign in (-1.0, 1.0))
    found = checked(monkeypatch, lambda p: bump(p) - 0.05, bump, ends)
    wrong = [c for c in found if c.contradicted_by_step]
    assert wrong and all(c.point.verdict == "torus" for c in wrong)
    found = checked(monkeypatch, lambda p: bump(p) - 0.02, bump, ends)
    assert not any(c.contradicted_by_step for c in found)


def test_single_unstable_point_that_half_the_step_does_not_have_is_a_contradiction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Between its two bifurcations no other point of the curve lies."""

    def bump(p: float) -> float:
        return 1.0004 - (p - 100.0) ** 2

    found = checked(monkeypatch, lambda p: bump(p) - 0.01, bump, (99.98, 100.02))
    (wrong,) = (c for c in found if c.contradicted_by_step)
    assert wrong.point.parameter == 100.0 and wrong.point.verdict == "torus"
    found = checked(monkeypatch, lambda p: bump(p) - 0.0002, bump, (99.98, 100.02))
    assert not any(c.contradicted_by_step for c in found)


@pytest.mark.parametrize(("shift", "contradicted"), [(0.03, False), (0.9, True)])
def test_bifurcation_that_moves_past_the_end_of_the_curve_is_no_contradiction(
    monkeypatch: pytest.MonkeyPatch, shift: float, contradicted: bool
) -> None:
    """The last point is the only unstable one; with half the step the torus lies beyond it."""

    def own(p: float) -> float:
        return 1.0 + 0.5 * (p - 100.98)

    found = checked(monkeypatch, lambda p: own(p) - shift, own, (100.98,))
    (last,) = (c for c in found if c.where == "last")
    assert last.point.verdict == "torus" and last.finer_verdict == "stable"
    assert last.contradicted_by_step == contradicted


@pytest.mark.parametrize(("half", "verdict"), [(0.9, UNSURE), (1.001, "torus")])
def test_instability_of_a_richer_basis_counts_if_half_the_step_finds_it(
    monkeypatch: pytest.MonkeyPatch, half: float, verdict: str
) -> None:
    def richer_motion(point: CurvePoint, _: Richer, finer: int = 1) -> CurvePoint:
        return motion(point.parameter, half if finer == 2 else 1.00001)

    monkeypatch.setattr(trust, "finer_motion", lambda point, _: point)
    monkeypatch.setattr(trust, "richer_motion", richer_motion)
    richer = Richer(None, np.eye(1))  # type: ignore[arg-type]
    found = checks([Piece([motion(p, 0.5) for p in (99.0, 100.0, 101.0)])], None, richer)  # type: ignore[arg-type]
    assert {c.richer_verdict for c in found} == {verdict}
    assert {c.contradicted for c in found} == {verdict == "torus"}


def test_richer_motions_of_a_region_of_contact_take_as_long_as_the_curve() -> None:
    """A root of 110 points: a march with derivatives takes 0.15 s, of the richer basis 1.9 s."""
    points = [replace(motion(100.0, 0.5), z=np.zeros(28 + 220), marches=(2, 1))] * 340
    richer = Richer(None, np.zeros((44, 14)))  # type: ignore[arg-type]
    count = trust._affordable([Piece(points)], richer)
    assert 0.5 <= 3 * 1.9 * count / (0.15 * 340) <= 2.0
