"""Verdicts on the stability that finer time steps deny."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from motions import curve_point

from fenicsrom.assess.curves import denials
from fenicsrom.assess.curves.denials import Denials
from fenicsrom.online.curves.curve import CurvePoint, Piece

Range = tuple[float, float] | None


def point(parameter: float, unstable: Range, kind: str = "") -> CurvePoint:
    """A point at whose parameter one step finds a torus, if it lies in a range."""
    is_torus = unstable is not None and unstable[0] < parameter < unstable[1]
    return curve_point(
        parameter,
        s=np.array([parameter]),
        multipliers=np.array([1.1 if is_torus else 0.9], dtype=np.complex128),
        verdict="torus" if is_torus else "stable",
        kind=kind,
    )


def judged(
    monkeypatch: pytest.MonkeyPatch, own: Range, half: Range, quarter: Range
) -> tuple[Piece, list[float]]:
    """A piece from 1 to 2 with a torus in one range, and with finer steps in other ranges.

    With it come the parameters at which half the step was asked.
    """
    asked: list[float] = []

    def with_finer_steps(of: CurvePoint, family: Any, finer: int) -> CurvePoint:
        asked.extend([of.parameter] * (finer == 2))
        return point(of.parameter, half if finer == 2 else quarter)

    monkeypatch.setattr(denials, "finer_motion", with_finer_steps)
    piece = Piece([point(p, own) for p in np.linspace(1.0, 2.0, 21)])
    piece.special = [point(p, own, "torus") for p in own or () if 1.0 < p < 2.0]
    Denials(lambda value: SimpleNamespace(), lambda: None).apply([piece])
    return piece, asked


def unsure(piece: Piece) -> list[float]:
    return [round(p.parameter, 2) for p in piece.points if p.known_stability == "unsure"]


@pytest.mark.parametrize(("half", "last"), [(None, 1.5), ((1.32, 1.52), 1.5), ((1.37, 1.62), 1.6)])
def test_instability_that_finer_steps_lack_is_left_out(
    monkeypatch: pytest.MonkeyPatch, half: Range, last: float
) -> None:
    """Half the step may have it at some of the motions, by chance."""
    piece, _ = judged(monkeypatch, own=(1.32, 1.52), half=half, quarter=None)
    assert unsure(piece) == pytest.approx(np.arange(1.35, last + 0.01, 0.05))
    assert not piece.special and not any(p.known_unstable for p in piece.points)


def test_stable_point_between_unsure_ones_is_unsure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(denials, "finer_motion", lambda of, *_: point(of.parameter, None))
    tongues = (1.32, 1.38), (1.42, 1.48)
    piece = Piece([point(p, tongues[int(p > 1.4)]) for p in np.linspace(1.0, 2.0, 21)])
    piece.special = [point(p, tongue, "torus") for tongue in tongues for p in tongue]
    Denials(lambda value: SimpleNamespace(), lambda: None).apply([piece])
    assert unsure(piece) == [1.35, 1.4, 1.45] and not piece.special


@pytest.mark.parametrize(("place", "kept"), [(1.325, 1), (1.47, 0), (None, 0)])
def test_torus_between_unstable_motions_stays_if_finer_steps_have_it(
    monkeypatch: pytest.MonkeyPatch, place: float | None, kept: int
) -> None:
    """Finer steps have the torus at another place, or find no motions there."""

    def motion(p: float, torus: float) -> CurvePoint:
        return replace(point(p, (0.0, 3.0)), multipliers=np.full(1 + 2 * (p > torus), 1.1 + 0j))

    monkeypatch.setattr(
        denials, "finer_motion", lambda of, *_: place and motion(of.parameter, place)
    )
    piece = Piece([motion(p, 1.32) for p in np.linspace(1.0, 2.0, 21)])
    piece.special = [replace(motion(1.32, 1.32), kind="torus")]
    Denials(lambda value: SimpleNamespace(), lambda: None).apply([piece])
    assert len(piece.special) == kept and not unsure(piece)


def test_instability_that_moves_with_the_step_is_unsure_where_the_steps_differ(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    piece, asked = judged(monkeypatch, own=(1.32, 1.62), half=(1.42, 1.72), quarter=(1.44, 1.74))
    assert unsure(piece) == [1.35, 1.4, 1.65, 1.7]
    assert [p.parameter for p in piece.points if p.known_unstable] == pytest.approx(
        [1.45, 1.5, 1.55, 1.6]
    )
    first, last = piece.special
    assert first.within == pytest.approx(1.45 - 1.32) and last.within == pytest.approx(1.75 - 1.62)
    assert len(asked) == len(set(asked)) < 12


def test_instability_on_which_all_steps_agree_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    piece, asked = judged(monkeypatch, (1.32, 1.62), (1.31, 1.63), (1.305, 1.635))
    assert not unsure(piece) and [p.within for p in piece.special] == [0.0, 0.0]
    assert len(asked) == 4


def test_stable_gap_that_half_the_step_lacks_is_unsure(monkeypatch: pytest.MonkeyPatch) -> None:
    """An unstable stretch for half the step covers the stable end of the curve."""
    piece, _ = judged(monkeypatch, own=(0.0, 1.92), half=(0.0, 3.0), quarter=(0.0, 3.0))
    assert unsure(piece) == [1.95, 2.0]
    assert not piece.special


def test_other_motion_of_half_the_step_denies_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    def other(of: CurvePoint, family: Any, finer: int) -> CurvePoint:
        return replace(point(of.parameter, None), amplitude=2.0 * of.amplitude)

    monkeypatch.setattr(denials, "finer_motion", other)
    own = (1.32, 1.52)
    piece = Piece([point(p, own) for p in np.linspace(1.0, 2.0, 21)])
    piece.special = [point(p, own, "torus") for p in own]
    Denials(lambda value: SimpleNamespace(), lambda: None).apply([piece])
    assert not unsure(piece) and len(piece.special) == 2
